"""The page of a stream in Chromium: pictures, tracks, the threshold, and what the lines of JSON say."""

import json
import re
import signal
import subprocess

import pytest
from playwright.sync_api import expect

import processes
from doppelgait.core.rng import rng
from doppelgait.motion import boulic_walk
from doppelgait.pipeline import simulate
from doppelgait.radar import Radar
from doppelgait.radar.frames import write_frames
from doppelgait.scene import Scene, Target
from viewer_page import look

SLOW = 60_000


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    path = tmp_path_factory.mktemp("live") / "walk.dgf"
    target = Target(boulic_walk(speed_mps=1.2, duration_s=6.0), range_m=5.0)
    write_frames(simulate(Scene([target]), Radar.preset("x4", prf_hz=700.0), rng=rng(3), snr_db=20.0), path)
    return path


def test_a_stream_is_shown_and_stays_after_its_end(walk, page, tmp_path):
    alone = processes.run([*processes.COMMAND, "live", str(walk)], capture_output=True, text=True)
    command = [*processes.COMMAND, "live", str(walk), "--view", "--no-browser"]
    with (
        (tmp_path / "lines").open("w") as lines,
        processes.started(command, stdout=lines, stderr=subprocess.PIPE, text=True) as process,
    ):
        url = next(found[1] for line in process.stderr if (found := re.match(r"page: (http\S+)", line)))
        page.goto(url)
        expect(page.locator("#live-status")).to_contain_text("the source ended", timeout=SLOW)
        expect(page.locator("#live-status")).not_to_contain_text("ended: ")
        expect(page.locator("#live-tracks tbody tr")).to_have_count(1)
        assert page.locator("#tabs button").all_inner_texts() == ["Live"]
        for name in ("range-time", "signature"):
            assert look(page, f"live-{name}")[1] > 100
        assert look(page, "live-evidence")[1] > 10
        decisions = [json.loads(line) for line in (tmp_path / "lines").read_text().splitlines()]
        last = [one for one in decisions if one["kind"] == "decision"][-1]
        row = page.locator("#live-tracks tbody tr td")
        assert row.nth(1).inner_text() == last["label"]
        assert float(row.nth(2).inner_text()) == pytest.approx(last["probability"], abs=0.006)
        assert float(row.nth(4).inner_text()) == pytest.approx(last["range_m"], abs=0.006)
        assert decisions == [json.loads(line) for line in alone.stdout.splitlines()]
        process.send_signal(signal.SIGINT)
        process.wait(timeout=processes.LIMIT_S)
    assert process.returncode == 130
