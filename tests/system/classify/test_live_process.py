"""``doppelgait live`` as a service: told to stop, or killed, while frames arrive."""

import json
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

import processes
from checkout import ROOT
from doppelgait.core.rng import rng
from doppelgait.motion import boulic_walk
from doppelgait.pipeline import simulate
from doppelgait.radar import Radar
from doppelgait.radar.frames import END_RECORD, FrameParser, Header, encode_frame, encode_header, write_frames
from doppelgait.scene import Scene, Target


def open_with(**changes):
    """The record that opens a stream of an X4 with changes."""
    radar = Radar.preset("x4", **changes)
    return encode_header(Header(radar, radar.range_axis_m()))


@pytest.fixture(scope="module")
def growing(tmp_path_factory):
    """Frames of a walk without the record of their end."""
    path = tmp_path_factory.mktemp("live") / "walk.dgf"
    walk = Target(boulic_walk(speed_mps=1.2, duration_s=5.0), range_m=5.0)
    radar = Radar.preset("x4", prf_hz=700.0)
    write_frames(simulate(Scene([walk]), radar, rng=rng(3), snr_db=20.0), path)
    content = path.read_bytes()
    path.write_bytes(content[: -len(END_RECORD)])
    return path


@pytest.mark.parametrize(
    "ends", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.release), signal.SIGKILL]
)
def test_the_log_holds_whole_lines_however_it_ends(growing, tmp_path, ends):
    options = ["--timeout-s", "100", "--log", str(tmp_path / "log")]
    command = [*processes.COMMAND, "live", str(growing), *options]
    with processes.started(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        limit = threading.Timer(processes.LIMIT_S, process.kill)
        limit.start()
        lines = []
        for line in process.stdout:
            lines.append(json.loads(line))
            if lines[-1]["kind"] == "decision" and lines[-1]["stop_s"] > 4.0:
                process.send_signal(ends)
                break
        lines += [json.loads(line) for line in process.stdout]
        said = process.stderr.read()
        process.wait(timeout=processes.LIMIT_S)
        limit.cancel()
    kept = [json.loads(line) for line in (tmp_path / "log").read_text().splitlines()]
    assert kept[: len(lines)] == lines
    assert len(kept) <= len(lines) + 1
    assert kept[0]["kind"] == "start"
    if ends is signal.SIGKILL:
        assert kept[-1]["kind"] in ("decision", "status")
    else:
        assert (kept[-1]["kind"], kept[-1]["reason"]) == ("end", "stopped")
        assert process.returncode == 130
        assert "Traceback" not in said


@contextmanager
def listening(*options, source="tcp://127.0.0.1:0"):
    """A process that listens, and its port; its lines of JSON are read in a thread."""
    command = [*processes.COMMAND, "live", source, "--hop-s", "1", *options]
    with processes.started(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.lines = []
        reader = threading.Thread(target=lambda: process.lines.extend(map(json.loads, process.stdout)))
        address = process.stderr.readline().rpartition(":")[2]
        process.said = []
        threading.Thread(target=lambda: process.said.extend(process.stderr), daemon=True).start()
        reader.start()
        yield process, int(address)
        process.send_signal(signal.SIGTERM)
        process.wait(timeout=processes.LIMIT_S)
        processes.join(reader)


def ends_of(process):
    return [line for line in process.lines if line["kind"] == "end"]


@pytest.mark.parametrize("kind", ["tcp", pytest.param("udp", marks=pytest.mark.release)])
def test_the_service_takes_one_sensor_after_the_other(growing, kind):
    content = growing.read_bytes()
    form = socket.SOCK_STREAM if kind == "tcp" else socket.SOCK_DGRAM
    parts = [content] if kind == "tcp" else [b"DGfr" + record for record in content.split(b"DGfr")[1:]]
    with listening("--timeout-s", "3", source=f"{kind}://127.0.0.1:0") as (process, port), ExitStack() as clients:

        def connect():
            client = clients.enter_context(socket.socket(socket.AF_INET, form))
            client.connect(("127.0.0.1", port))
            return client

        connect().close()
        connect().send(b"nonsense")
        for run in range(4):
            sensor = connect()
            for number, part in enumerate(parts):
                sensor.sendall(part)
                if number % 10 == 9:
                    threading.Event().wait(0.002)
            sensor.sendall([b"", b"", open_with(prf_hz=600.0), END_RECORD][run])
            sensor.close()
            processes.wait_until(lambda run=run: len(ends_of(process)) > run)
    assert process.returncode == 130
    assert [line["run"] for line in process.lines if line["kind"] == "start"] == [0, 1, 2, 3]
    reasons = [line["reason"].partition(" after ")[0] for line in ends_of(process)]
    error = f"{kind}://127.0.0.1:{port}: frames of another radar are refused: prf_hz is 600, expected is 700"
    assert reasons == [*["the sender stopped without an end record"] * 2, error, "the source ended"]
    assert sum("stopped without an end record after 3,500 frames" in line for line in process.said) == 2
    tracks = [
        {line["track"] for line in process.lines if (line["kind"], line["run"]) == ("decision", n)} for n in range(4)
    ]
    assert all(tracks)
    assert len(set.union(*tracks)) == sum(map(len, tracks))


ENDS = {  # source, what is sent to it, and the status: 0 only for an end that somebody asked for
    "end record": ("-", True, 0),
    "cut off": ("-", False, 1),
    "file, cut off": ("file", False, 1),
    "once, end record": ("tcp", True, 0),
    "once, cut off": ("tcp", False, 1),
    "once, nothing": ("tcp", None, 1),
}


@pytest.mark.parametrize("kind", ENDS)
def test_the_status_is_0_only_for_an_end_that_was_asked_for(growing, kind):
    source, ended, status = ENDS[kind]
    content = b"" if ended is None else growing.read_bytes() + (END_RECORD if ended else b"")
    if source == "tcp":
        with listening("--once") as (process, port):
            with socket.create_connection(("127.0.0.1", port)) as sensor:
                sensor.sendall(content)
            process.wait(timeout=processes.LIMIT_S)
    else:
        name = str(growing) if source == "file" else source
        command = [*processes.COMMAND, "live", name, "--timeout-s", "0"]
        process = processes.run(command, input=content, capture_output=True)
        process.lines = list(map(json.loads, process.stdout.splitlines()))
    assert process.returncode == status
    expected = {0: "the source ended", 1: "the sender stopped without an end record after 3,500 frames"}
    assert [line["reason"] for line in ends_of(process)] == [expected[status]] * (ended is not None)


def test_a_port_that_is_in_use_is_one_error_with_status_1():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        source = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        done = processes.run([*processes.COMMAND, "live", source], capture_output=True, text=True)
    said = f"error: {source}: cannot be opened: Address already in use\n"
    assert (done.returncode, done.stdout, done.stderr) == (1, "", said)


def test_lost_frames_and_jumps_of_the_clock_are_in_status_end_and_log(growing, tmp_path):
    header, *frames = FrameParser("test").feed(growing.read_bytes())
    del frames[1000]
    sent = [encode_frame(one.counter, one.clock_s + 3600.0 * (one.counter > 2000), one.row) for one in frames]
    content = b"".join([encode_header(header), *sent, END_RECORD])
    command = [*processes.COMMAND, "live", "-", "--log", str(tmp_path / "log")]
    done = processes.run(command, input=content, capture_output=True)
    assert (tmp_path / "log").read_bytes() == done.stdout
    *lines, end = map(json.loads, done.stdout.splitlines())
    assert {name: count for name, count in end["stream"].items() if count} == {
        "received": 3499,
        "missing": 1,
        "jumps": 1,
    }
    assert (end["kind"], end["frames"], end["filled"], end["jumps"]) == ("end", 3499, 1, 0)
    assert [(line["filled"], line["stream"]["missing"]) for line in lines if line["kind"] == "status"] == [(1, 1)]
    assert b"the sender's clock jumps from" in done.stderr


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the system states no peak of memory")
@pytest.mark.parametrize(
    ("range_stop_m", "most_mb"), [(2400.0, 400), pytest.param(300.0, 2000, marks=pytest.mark.release)]
)
def test_memory_is_bounded_whatever_a_header_states(range_stop_m, most_mb):
    opening = open_with(prf_hz=700.0, range_stop_m=range_stop_m, fold_echoes=False)
    row = np.ones(json.loads(opening[12:-4])["range_bins"], dtype=np.complex64)
    with listening() as (process, port), socket.create_connection(("127.0.0.1", port)) as sensor:
        with suppress(ConnectionError):  # 261 MB/s are refused, 33 MB/s are not
            for number in range(3000):
                sensor.sendall((b"" if number else opening) + encode_frame(number, number / 700.0, row))
            processes.wait_until(lambda: any(line["kind"] == "status" for line in process.lines))
        peak = re.search(r"VmHWM:\s*(\d+) kB", Path(f"/proc/{process.pid}/status").read_text())
    assert int(peak[1]) < 1000 * most_mb


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="the system has no systemd-analyze")
def test_the_unit_file_is_valid_and_hardened(tmp_path):
    unit = (ROOT / "examples/doppelgait-live.service").read_text()
    path = tmp_path / "doppelgait-live.service"
    path.write_text(unit.replace("/opt/doppelgait/bin/doppelgait", sys.executable))
    done = processes.run(["systemd-analyze", "verify", "--man=no", str(path)], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    shown = ["systemd-analyze", "security", "--offline=yes", "--threshold=15", "--no-pager", str(path)]
    assert processes.run(shown, capture_output=True).returncode == 0


@pytest.mark.release
def test_a_day_of_the_service_in_simulated_time():
    done = processes.run([sys.executable, str(ROOT / "examples/live_day.py")], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
