"""``doppelgait live`` as a service: told to stop, or killed, while frames arrive."""

import json
import shutil
import signal
import socket
import subprocess
import sys
import threading
from contextlib import ExitStack, contextmanager

import pytest

import processes
from checkout import ROOT
from doppelgait.core.rng import rng
from doppelgait.motion import boulic_walk
from doppelgait.pipeline import simulate
from doppelgait.radar import Radar
from doppelgait.radar.frames import END_RECORD, write_frames
from doppelgait.scene import Scene, Target


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
        threading.Thread(target=process.stderr.read, daemon=True).start()
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
        for run in range(3):
            sensor = connect()
            for number, part in enumerate(parts):
                sensor.sendall(part)
                if number % 10 == 9:
                    threading.Event().wait(0.002)
            sensor.sendall(END_RECORD if run else b"")
            sensor.close()
            processes.wait_until(lambda run=run: len(ends_of(process)) > run)
    assert process.returncode == 130
    assert [line["run"] for line in process.lines if line["kind"] == "start"] == [0, 1, 2]
    reasons = [line["reason"].partition(" after ")[0] for line in ends_of(process)]
    assert reasons == ["the sender stopped without an end record", "the source ended", "the source ended"]
    tracks = [
        {line["track"] for line in process.lines if (line["kind"], line["run"]) == ("decision", n)} for n in range(3)
    ]
    assert all(tracks)
    assert not tracks[0] & tracks[1] | tracks[1] & tracks[2]


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
