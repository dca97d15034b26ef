"""The whole chain on real motion capture of walking people (the shared test data)."""

import csv

import numpy as np
import pytest

from doppelgait.motion import read
from doppelgait.pipeline import analyze, simulate
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target

pytestmark = pytest.mark.shared

FRAME_RATE_HZ = 120.0
WALKS = {
    "human/c3d/cmu_07_01.c3d": {},
    "human/c3d/cmu_02_01.c3d": {},
    # the straight stretch of a recording in which the person first stands for eight seconds
    "human/c3d/cmu_82_08.c3d": {"start_s": 1158 / FRAME_RATE_HZ, "stop_s": 1596 / FRAME_RATE_HZ},
}


@pytest.fixture(scope="module")
def segments(shared):
    with (shared / "data" / "mocap" / "segments.csv").open() as handle:
        return {row["file"]: row for row in csv.DictReader(handle) if row["file"] in WALKS}


@pytest.fixture(scope="module", params=list(WALKS))
def walk(request, shared, segments):
    motion = read(shared / "data" / "mocap" / request.param, **WALKS[request.param])
    recording = simulate(Scene([Target(motion, label="human")]), Radar.preset("x4"))
    return recording, analyze(recording, gate="truth")[0], segments[request.param]


def torso_speed_mps(recording, result):
    """Approach of the mean range of the torso markers over the observed frames: the way over the time."""
    rows = recording.truth[0].scatterers
    torso = rows["range"].values[:, rows.coords["part"].values == "torso"].mean(axis=1)
    times = rows.coords["slow_time"].values
    observed = result.signature.coords["time"].values
    first_m, last_m = np.interp(observed[[0, -1]], times, torso)
    return (first_m - last_m) / (observed[-1] - observed[0])


def test_torso_velocity_follows_the_torso_markers(walk):
    recording, result, segment = walk
    velocity = result.features.torso_velocity_mps
    assert velocity == pytest.approx(torso_speed_mps(recording, result), rel=0.03)
    assert velocity == pytest.approx(float(segment["speed_mps"]), rel=0.05)


def test_gait_frequency_is_the_step_frequency(walk):
    _, result, segment = walk
    assert result.gait_frequency_hz == pytest.approx(2 * float(segment["stride_hz"]), rel=0.05)


def test_the_signature_reaches_the_fastest_foot_and_no_further(walk):
    recording, result, _ = walk
    fastest_hz = recording.truth[0].doppler_hz(recording.radar.wavelength_m).max()
    mu = result.signature.values
    doppler_hz = result.signature.coords["doppler"].values
    assert mu[:, doppler_hz > fastest_hz + 40].max() < 1e-3 * mu.max()
    assert mu[:, np.abs(doppler_hz - 0.9 * fastest_hz) < 20].max() > 1e-4 * mu.max()


@pytest.mark.parametrize("aspect_deg", [180.0])
def test_a_receding_person_has_negative_velocity(shared, aspect_deg):
    motion = read(shared / "data" / "mocap" / "human/c3d/cmu_07_01.c3d")
    recording = simulate(Scene([Target(motion, aspect_deg=aspect_deg)]), Radar.preset("x4"))
    result = analyze(recording, gate="truth")[0]
    assert result.features.torso_velocity_mps == pytest.approx(-1.366, rel=0.05)
    assert result.features.step_length_m > 0
