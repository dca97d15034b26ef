"""``doppelgait live``: decisions on arriving frames, as lines of JSON."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing, nullcontext, suppress
from dataclasses import asdict, replace
from pathlib import Path
from threading import Event
from time import process_time
from typing import TYPE_CHECKING, Annotated, Any
from urllib.parse import urlsplit

import typer

from doppelgait.cli.analyze import ReaderOptions, takes_windows
from doppelgait.cli.classify import ModelOption, describe_model, explain_model
from doppelgait.cli.output import print_message, print_warning
from doppelgait.core.errors import ConfigError, DoppelgaitError, OutputError
from doppelgait.core.interrupt import stop_in_order

if TYPE_CHECKING:
    from doppelgait.classify.live import Live
    from doppelgait.radar.streams import Stream
    from doppelgait.viewer.live_page import Rolling

STATUS_S = 60.0
"""Interval, s of radar time, between lines on the stream's state while no frame is lost."""
MAX_QUEUED, QUEUE_IS_FULL, END_S = 1000, 15, 2.0
"""Lines that wait for a broker, the answer to further ones, and the longest wait, s, at the end."""


class MqttSink:
    """Publish lines as ``TOPIC/KIND``; what a broker cannot be given is queued up to a limit."""

    def __init__(self, url: str) -> None:
        try:
            from paho.mqtt import client as paho
            from paho.mqtt.enums import CallbackAPIVersion
        except ImportError:
            raise ConfigError("--mqtt: needs paho-mqtt, which is missing: pip install 'doppelgait[mqtt]'") from None
        try:
            parts = urlsplit(url)
            port = parts.port or {"mqtt": 1883, "mqtts": 8883}[parts.scheme]
            if not parts.hostname or not (topic := parts.path.strip("/")) or {*"+#@?"} & {*url}:
                raise ValueError
        except (KeyError, ValueError):
            raise ConfigError(
                f"--mqtt {url.rpartition('@')[2].partition('?')[0]}: must be mqtt://HOST/TOPIC or mqtts://HOST/TOPIC, "
                "with :PORT if it is another one; MQTT_USERNAME and MQTT_PASSWORD have name and password"
            ) from None
        self._url, self._topic, self.lost, self._was_said = url, topic, 0, False
        self._client = paho.Client(CallbackAPIVersion.VERSION2)
        self._client.max_queued_messages_set(MAX_QUEUED)
        self._client.reconnect_delay_set(1, 60)
        self._client.on_connect = self._client.on_disconnect = self._client.on_connect_fail = self._report
        if user := os.environ.get("MQTT_USERNAME"):
            self._client.username_pw_set(user, os.environ.get("MQTT_PASSWORD"))
        if parts.scheme == "mqtts":
            self._client.tls_set()
        self._client.will_set(f"{topic}/state", "offline", qos=1, retain=True)
        self._client.connect_async(parts.hostname, port)
        self._client.loop_start()

    def write(self, kind: str, line: str) -> None:
        """Publish a line, or count it as lost."""
        self.lost += self._client.publish(f"{self._topic}/{kind}", line, qos=1).rc == QUEUE_IS_FULL

    def close(self) -> None:
        """Publish what is queued, within a limit, and disconnect."""
        with suppress(ValueError, RuntimeError):
            self._client.publish(f"{self._topic}/state", "offline", qos=1, retain=True).wait_for_publish(END_S)
        self._client.disconnect()
        self._client.loop_stop()

    def _report(self, *facts: Any) -> None:
        """Report a fault once, until the broker is connected again."""
        is_lost = len(facts) < 4 or facts[3].is_failure  # only a connection has a reason
        if is_lost and not self._was_said:
            fault = "cannot be reached" if len(facts) < 4 else f"no connection: {facts[3]}"
            print_message(f"error: --mqtt {self._url}: {fault}; decisions continue on standard output")
        elif not is_lost:
            self._client.publish(f"{self._topic}/state", "online", qos=1, retain=True)
        self._was_said = is_lost


class DecisionLog:
    """Append lines to a file; a power failure loses at most the line that is being written."""

    def __init__(self, path: Path) -> None:
        self.path, self.lost = path, 0
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
            if os.name == "posix":  # other systems cannot open a folder
                folder = os.open(path.resolve().parent, os.O_RDONLY)
                os.fsync(folder)  # sync the directory entry of a new file
                os.close(folder)
            size = os.fstat(self._file).st_size
            os.lseek(self._file, max(size - 1, 0), os.SEEK_SET)
            if size and os.read(self._file, 1) != b"\n":
                self._append(b"\n")
        except OSError as error:
            raise OutputError(f"--log {path}: cannot be written: {error.strerror}; give another file") from None

    def write(self, line: str) -> None:
        """Write a line, or report failure once."""
        try:
            self._append(line.encode() + b"\n")
        except OSError as error:
            if not self.lost:
                print_message(
                    f"error: --log {self.path}: {error.strerror}; decisions continue on standard output, "
                    "and in the log when it can be written again"
                )
            self.lost += 1
            return
        if self.lost:
            print_message(f"note: --log {self.path}: continues; {self.lost:,} lines are missing")
            self.lost = 0

    def _append(self, content: bytes) -> None:
        """Append and sync, undoing a failed write."""
        size, done = os.fstat(self._file).st_size, 0  # another program may have truncated it, or written to it
        try:
            while done < len(content):
                done += os.write(self._file, content[done:])
            os.fsync(self._file)
        except OSError:
            with suppress(OSError):
                if os.fstat(self._file).st_size == size + done:
                    os.ftruncate(self._file, size)
            raise


@takes_windows("gate")
def live(
    source: Annotated[
        str,
        typer.Argument(help="A file, which may still grow; - for standard input; tcp://HOST:PORT or udp://HOST:PORT."),
    ],
    model: ModelOption = None,
    log: Annotated[
        Path | None, typer.Option("--log", help="File to append the lines to; each line is synced to the disk.")
    ] = None,
    mqtt: Annotated[
        str | None, typer.Option("--mqtt", help="Broker to publish the lines to, mqtt://HOST:PORT/TOPIC or mqtts://...")
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="End with the first sender of a socket.")] = False,
    options: ReaderOptions = None,
    timeout_s: Annotated[
        float,
        typer.Option(
            "--timeout-s", min=0.0, help="Time without frames, s, after which a source ends, or a client is dropped."
        ),
    ] = 10.0,
    view: Annotated[
        bool, typer.Option("--view", help="Show pictures, tracks and decisions in the browser until Ctrl-C.")
    ] = False,
    port: Annotated[
        int | None,
        typer.Option("--port", min=0, max=65535, help="With --view: port of the page; any free one by default."),
    ] = None,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="With --view: print the address without opening the browser.")
    ] = False,
    **windows: Any,
) -> None:
    """Classify targets while the frames of a radar arrive.

    Every line on standard output is one JSON document: a start, a decision about a track at the end of a window, the
    state of the stream, the end. Sockets accept connections from this machine only, unless a host is named; they take
    one sensor after the other until Ctrl-C.

    Example: doppelgait live tcp://:7290 --log decisions.jsonl --mqtt mqtt://localhost/home/hall
    """
    from doppelgait.classify.live import live as run_live
    from doppelgait.classify.model_file import load_model_for_radar, open_model
    from doppelgait.core.config import apply_overrides, convert_to_json
    from doppelgait.radar import open_stream
    from doppelgait.viewer.live_page import Rolling
    from doppelgait.viewer.server import open_in_browser, serve_live

    if not view and (no_browser or port is not None):
        unused = "--no-browser" if port is None else f"--port {port}"
        raise ConfigError(f"{unused}: has no effect without --view; add --view to see the page, or leave it out")
    window_s, hop_s = (windows[name] for name in ("window_s", "hop_s"))
    wrong_s = [one for one in (window_s, hop_s) if one is not None and not 0.05 <= one <= 600.0]
    if wrong_s or (hop_s or 0.0) > (window_s or 600.0):
        raise ConfigError(f"--window-s {window_s}, --hop-s {hop_s}: 0.05 to 600 s is allowed, a hop up to the window")
    is_sensor = source.startswith(("tcp://", "udp://"))  # does not wait for the reader
    is_service = is_sensor and not once
    own = None if model is None else open_model(model)
    kept = None if log is None else DecisionLog(log)
    with ExitStack() as ends:
        broker = None if mqtt is None else ends.enter_context(closing(MqttSink(mqtt)))
        stream = open_stream(source, timeout_s=timeout_s, once=not is_service, **apply_overrides({}, options or []))
        ends.callback(lambda: stream.close())
        print_message(f"listening: {stream.source}")
        page, run, next_track, explained = Rolling(stream.source) if view else None, 0, 0, False
        if page is not None:
            url = ends.enter_context(serve_live(page, port or 0))
            print_message(f"page: {url}")
            ends.enter_context(nullcontext() if no_browser else open_in_browser(url))

        def put(kind: str, facts: Mapping[str, Any]) -> None:
            nonlocal next_track
            next_track = max(next_track, facts.get("track", -1) + 1)
            numbered = {"kind": kind, "run": run, **facts} if is_service else {"kind": kind, **facts}
            line = json.dumps(convert_to_json(numbered), allow_nan=False)
            if kept is not None:
                kept.write(line)
            if broker is not None:
                broker.write(kind, line)
            print(line, flush=True)

        while True:
            try:
                radar = stream.radar  # waits for a sensor
                loaded = (own or load_model_for_radar(radar)).of_tracks
                if page is not None:
                    page.begin(radar.name, loaded)
                running = run_live(stream, radar, loaded, range_m=stream.range_m, skip=is_sensor, **windows)
                facts = {"source": stream.source, "radar": radar.name, "carrier_hz": radar.carrier_hz}
                facts |= {"prf_hz": radar.prf_hz, "model": describe_model(loaded, model)}
                put("start", {**facts, "window_s": running.window_s, "hop_s": running.hop_s})
                if not explained:
                    explain_model(loaded, model)
                explained = True
                _follow(stream, running, put, page, next_track)
            except (DoppelgaitError, MemoryError) as error:
                if not is_service or isinstance(error, OutputError):
                    raise
                print_message(f"error: run {run}: {error}; the next sensor is waited for")
            if not is_service:
                break
            print_warning.cache_clear()
            stream, run = stream.next_run(), run + 1
        if page is not None:
            print_message("the page remains available until Ctrl-C")
            Event().wait()
    if not stream.complete:
        raise typer.Exit(1)


def _follow(
    stream: Stream, running: Live, put: Callable[[str, Mapping[str, Any]], None], page: Rolling | None, first_track: int
) -> None:
    """Print the decisions of one run, with tracks from a number on."""

    def count_losses() -> list[int]:
        facts = [*asdict(running.counts).items(), *asdict(stream.counts).items()]
        return [n for name, n in facts if name not in ("frames", "windows", "received")]

    def state() -> dict[str, Any]:
        return {**asdict(running.counts), "stream": asdict(stream.counts)}

    said_s, lost, reason = float("-inf"), count_losses(), "stopped"
    began_s, clock_s = None, process_time()
    try:
        with stop_in_order():
            for window, decisions, results in running.windows():
                numbered = [replace(one, track=one.track + first_track) for one in decisions]
                for decision in numbered:
                    put("decision", decision.as_dict())
                if page is not None:
                    began_s = window.start_s if began_s is None else began_s
                    share = (process_time() - clock_s) / (window.stop_s - began_s)
                    page.add(window, numbered, results, state(), share)
                if count_losses() != lost or window.stop_s - said_s >= STATUS_S:
                    said_s, lost = window.stop_s, count_losses()
                    put("status", {"time_s": window.stop_s, **state()})
        reason = stream.reason
    except Exception as error:
        reason = str(error)
        raise
    finally:
        running.close()
        put("end", {"reason": reason, **state()})
        print_message(stream.summary())
        if page is not None:
            page.end(reason, state())
