"""``doppelgait live``: decisions on arriving frames, as lines of JSON."""

from __future__ import annotations

import json
import os
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import asdict
from pathlib import Path
from time import process_time, sleep
from typing import Annotated, Any

import typer

from doppelgait.cli.analyze import HopS, ReaderOptions, WindowS
from doppelgait.cli.classify import ModelOption, describe_model, explain_model
from doppelgait.cli.output import print_message
from doppelgait.core.errors import ConfigError, OutputError

WAIT_S = 0.2
"""Interval, s, at which Ctrl-C is checked after the end of the stream."""
STATUS_S = 60.0
"""Interval, s of radar time, between lines on the stream's state while no frame is lost."""
SENSORS = ("tcp://", "udp://")
"""Prefixes of the sources that do not wait for the reader."""


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
        size = os.fstat(self._file).st_size  # another program may have truncated the file, or written to it
        done = 0
        try:
            while done < len(content):
                done += os.write(self._file, content[done:])
            os.fsync(self._file)
        except OSError:
            with suppress(OSError):
                if os.fstat(self._file).st_size == size + done:
                    os.ftruncate(self._file, size)
            raise


def live(
    source: Annotated[
        str,
        typer.Argument(help="A file, which may still grow; - for standard input; tcp://HOST:PORT or udp://HOST:PORT."),
    ],
    model: ModelOption = None,
    window_s: WindowS = None,
    hop_s: HopS = None,
    log: Annotated[
        Path | None, typer.Option("--log", help="File to append the lines to; each line is synced to the disk.")
    ] = None,
    options: ReaderOptions = None,
    timeout_s: Annotated[
        float,
        typer.Option("--timeout-s", min=0.0, help="Time without data, s, after which the source counts as ended."),
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
) -> None:
    """Classify targets while the frames of a radar arrive.

    Every line on standard output is one JSON document: a start, a decision about a track at the end of a window, the
    state of the stream, the end. Sockets accept connections from this machine only, unless a host is named.

    Example: doppelgait live tcp://:7290 --log decisions.jsonl

    Example: doppelgait live frames.dgf --model home-alarm-model.npz --window-s 4 --hop-s 1

    Example: doppelgait live tcp://:7290 --view
    """
    from doppelgait.classify.live import live as run_live
    from doppelgait.classify.model_file import load_model_for_radar, open_model
    from doppelgait.core.config import apply_overrides, convert_to_json
    from doppelgait.core.interrupt import raise_if_stopped, stop_in_order
    from doppelgait.radar import open_stream
    from doppelgait.viewer.live_page import Rolling
    from doppelgait.viewer.server import open_in_browser, serve_live

    asked = {f"--port {port}": port is not None, "--no-browser": no_browser}
    unused = [option for option, is_set in asked.items() if is_set and not view]
    if unused:
        raise ConfigError(f"{unused[0]}: has no effect without --view; add --view to see the page, or leave it out")
    loaded = None if model is None else open_model(model)
    kept = None if log is None else DecisionLog(log)

    def put(kind: str, facts: dict[str, Any]) -> None:
        line = json.dumps(convert_to_json({"kind": kind, **facts}), allow_nan=False)
        if kept is not None:
            kept.write(line)
        print(line, flush=True)

    with ExitStack() as ends:
        stream = ends.enter_context(open_stream(source, timeout_s=timeout_s, **apply_overrides({}, options or [])))
        print_message(f"listening: {stream.source}")
        radar = stream.radar
        loaded = (loaded or load_model_for_radar(radar)).of_tracks
        page = Rolling(stream.source, radar.name, loaded) if view else None
        if page is not None:
            url = ends.enter_context(serve_live(page, port or 0))
            print_message(f"page: {url}")
            ends.enter_context(nullcontext() if no_browser else open_in_browser(url))
        running = run_live(
            stream,
            radar,
            loaded,
            window_s=window_s,
            hop_s=hop_s,
            range_m=stream.range_m,
            skip=source.startswith(SENSORS),
        )

        def state() -> dict[str, Any]:
            return {**running.counts.as_dict(), "stream": asdict(stream.counts)}

        def losses() -> list[int]:
            facts = state()
            inner = facts.pop("stream")
            return [n for name, n in {**facts, **inner}.items() if name not in ("frames", "windows", "received")]

        put(
            "start",
            {
                "source": stream.source,
                "radar": radar.name,
                "carrier_hz": radar.carrier_hz,
                "prf_hz": radar.prf_hz,
                "model": describe_model(loaded, model),
                "window_s": running.window_s,
                "hop_s": running.hop_s,
            },
        )
        explain_model(loaded, model)
        said_s, lost, reason = float("-inf"), losses(), "stopped"
        began_s, clock_s = None, process_time()
        try:
            with stop_in_order():
                for window, decisions, results in running.windows():
                    for decision in decisions:
                        put("decision", decision.as_dict())
                    if page is not None:
                        began_s = window.start_s if began_s is None else began_s
                        share = (process_time() - clock_s) / (window.stop_s - began_s)
                        page.add(window, decisions, results, state(), share)
                    if losses() != lost or window.stop_s - said_s >= STATUS_S:
                        said_s, lost = window.stop_s, losses()
                        put("status", {"time_s": window.stop_s, **state()})
            reason = "the source ended"
        except Exception as error:
            reason = str(error)
            raise
        finally:
            running.close()
            put("end", {"reason": reason, **state()})
            print_message(stream.summary())
            if page is not None:
                page.end(reason, state())
        if page is not None:
            print_message("the page remains available until Ctrl-C")
            with stop_in_order():
                while True:
                    sleep(WAIT_S)
                    raise_if_stopped()
