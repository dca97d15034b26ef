"""``doppelgait live`` as a service: told to stop, or killed, while frames arrive."""

import json
import signal
import subprocess
import threading

import pytest

import processes
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
