"""The page of a stream: what it shows, in fixed memory, without a change of the decisions."""

from types import SimpleNamespace

import numpy as np
import pytest

from doppelgait.classify.live import live
from doppelgait.classify.model_file import load_shipped_model
from doppelgait.core.rng import rng
from doppelgait.motion import boulic_walk
from doppelgait.pipeline import simulate
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target
from doppelgait.viewer.live_page import MOST_ROWS, SPAN_S, STEP_S, Rolling
from viewer_client import unpack

MODEL = load_shipped_model("x4")


@pytest.fixture(scope="module")
def walk():
    scene = Scene([Target(boulic_walk(speed_mps=1.2, duration_s=6.0), range_m=5.0)])
    return simulate(scene, Radar.preset("x4", prf_hz=700.0), rng=rng(3), snr_db=20.0)


def a_page():
    page = Rolling("walk")
    assert unpack(page.payload())[0]["state"] == "waiting"
    page.begin("X4", MODEL)
    return page


def frames_of(recording):
    return zip(recording.slow_time_s, recording.samples.matrix, strict=True)


@pytest.fixture(scope="module")
def followed(walk):
    """A page that has followed the walk, and the decisions."""
    page, decisions = a_page(), []
    running = live(frames_of(walk), walk.radar, MODEL)
    for window, found, results in running.windows():
        page.add(window, found, results, vars(running.counts), 0.1)
        decisions += found
    return page, decisions


def test_the_walker_is_where_it_was_and_as_fast(walk, followed):
    page, decisions = followed
    facts, arrays = unpack(page.payload())
    image = facts["range_time"]
    codes = arrays[image["array"]]
    times_s = image["x"]["first"] + image["x"]["step"] * np.arange(image["x"]["n"])
    ranges_m = image["y"]["first"] + image["y"]["step"] * np.arange(image["y"]["n"])
    truth_m = np.interp(times_s, walk.slow_time_s, walk.truth[0].centre_range_m)
    assert np.median(np.abs(ranges_m[codes.argmax(axis=1)] - truth_m)) < 0.3
    assert image["x"]["step"] == pytest.approx(STEP_S)
    image = facts["signature"]
    doppler_hz = image["y"]["first"] + image["y"]["step"] * np.arange(image["y"]["n"])
    strongest = doppler_hz[arrays[image["array"]].astype(float).sum(axis=0).argmax()]
    assert strongest * image["y"]["second"]["scale"] == pytest.approx(1.2, abs=0.4)
    assert [mark["time_s"] for mark in facts["marks"]] == [one.stop_s for one in decisions]
    assert facts["marks"][-1]["evidence"] == pytest.approx(decisions[-1].probabilities["human"])
    assert facts["alarm_threshold"] == MODEL.facts.alarm_threshold
    assert facts["state"] == "running"


def test_memory_does_not_grow(walk):
    page, running = a_page(), live(frames_of(walk), walk.radar, MODEL)
    seen = [item for item in running.windows() if item[1]]
    sizes = []
    for turn in range(120):  # ten minutes of it, moved in time
        window, decisions, results = seen[turn % len(seen)]
        by_s = 5.0 * turn - window.start_s
        moved = window._replace(start_s=window.start_s + by_s, stop_s=window.stop_s + by_s)
        marks = [SimpleNamespace(**{**vars(one), "stop_s": moved.stop_s}) for one in decisions]
        page.add(moved, marks, results, {}, 0.1)
        if turn >= 20 and turn % 4 == 3:
            sizes.append(len(page.payload()))
    assert max(sizes) < 1.3 * min(sizes)
    facts, _ = unpack(page.payload())
    for name in ("range_time", "signature"):
        assert facts[name]["x"]["n"] <= SPAN_S / STEP_S + 1
        assert facts[name]["y"]["n"] <= MOST_ROWS
    assert facts["stop_s"] - facts["start_s"] == pytest.approx(SPAN_S)
    assert all(mark["time_s"] >= facts["start_s"] for mark in facts["marks"])


def test_the_page_before_a_window_and_after_the_end(walk, followed):
    page = a_page()
    facts, arrays = unpack(page.payload())
    assert (facts["state"], facts["stop_s"], facts["range_time"], arrays) == ("waiting", None, None, {})
    page.end("the sender was killed", {"frames": 3})
    facts, _ = unpack(page.payload())
    assert (facts["state"], facts["reason"], facts["counts"]) == ("ended", "the sender was killed", {"frames": 3})
