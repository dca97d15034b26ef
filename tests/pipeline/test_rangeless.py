"""Targets and sitters before a radar without range."""

import numpy as np
import pytest

from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.core.rng import rng
from doppelgait.motion import boulic_walk
from doppelgait.motion.models.primitives import breathing_person
from doppelgait.pipeline import Conditions, analyze, simulate
from doppelgait.pipeline.rangeless import Motion, find_motion, has_both_directions, transform_motion
from doppelgait.processing.bursts import average_bursts
from doppelgait.processing.detect import Detector
from doppelgait.processing.track import Tracker
from doppelgait.radar import Radar
from doppelgait.radar.readers.cw_text import read_cw_text
from doppelgait.scene import Scene, Target

RADAR = Radar.preset("xband-cw", prf_hz=1000)
WALK = boulic_walk(speed_mps=1.2, height_m=1.75, duration_s=4.0)
ROOM = Conditions(impairments=[{"kind": "phase_noise", "white_rad": 0.003}])
VELOCITY_MPS = np.linspace(-4.0, 3.9, 80)


def observed(*targets, seconds=4.0):
    snr_db = 15.0 if targets else None
    return simulate(Scene(list(targets), duration_s=seconds), RADAR, rng=rng(3), conditions=ROOM, snr_db=snr_db)


def walker(start_m=7.0, heading_deg=180.0):
    return Target(WALK, start_position_m=(start_m, 0.0), heading_deg=heading_deg)


def in_bursts(recording, *, pulses=100, period=200):
    kept = (np.arange(recording.n_pulses) % period) < pulses
    return recording.with_baseband(recording.baseband.isel(slow_time=kept).assign_attrs(burst_pulses=pulses))


def lines(*ways, scans=40):
    """Spectra with one strong cell a line over unit noise: (velocity, level) each."""
    power = np.random.default_rng(0).exponential(size=(scans, VELOCITY_MPS.size))
    for velocity_mps, level in ways:
        power[:, np.abs(VELOCITY_MPS - velocity_mps).argmin()] += level
    return Motion(np.arange(scans) * 0.1, VELOCITY_MPS, power.astype(np.float32), 1.0)


@pytest.mark.parametrize(("make", "rel"), [(lambda recording: recording, 0.03), (in_bursts, 0.08)])
def test_a_walker_is_one_target_with_the_default_gate(make, rel):
    (found,) = analyze(make(observed(walker())))
    assert found.features.torso_velocity_mps == pytest.approx(1.2, rel=rel)  # five columns a second in bursts
    assert found.quality["stop_s"] - found.quality["start_s"] > 3.0
    assert found.quality["ground_speed_mps"] is None
    assert found.quality["aspect_deg"] is None
    assert not any(flag.startswith("more_than_one_body") for flag in found.flags)


def test_two_who_pass_each_other_are_flagged():
    (found,) = analyze(observed(walker(), walker(2.5, 0.0)))
    assert "more_than_one_body:some_approach_while_others_recede" in found.flags


def test_who_turns_back_has_a_segment_for_each_way():
    there, back = observed(walker()), observed(walker(2.2, 0.0))
    values = np.concatenate([there.baseband.values, back.baseband.values])
    times_s = np.arange(values.shape[0]) / RADAR.prf_hz
    axes = {"slow_time": times_s, "range": there.range_m}
    both = there.with_baseband(make_array(BASEBAND, values, axes, there.baseband.attrs))
    (found,) = analyze(both)
    assert [round(segment.features.torso_velocity_mps, 1) for segment in found.segments] == [1.2, -1.2]
    assert not any(flag.startswith("more_than_one_body") for flag in found.flags)


@pytest.mark.parametrize("make", [lambda recording: recording, in_bursts])
def test_who_sits_is_found_by_the_breath_and_has_no_bandwidth(make):
    breath = breathing_person(breathing_hz=0.3, amplitude_m=0.004, duration_s=20.0)
    sitter = Target(breath, start_position_m=(2.0, 0.0), heading_deg=180.0)
    (found,) = analyze(make(observed(sitter, seconds=20.0)))
    assert found.quality["breathing_rate_hz"] == pytest.approx(0.3, abs=0.02)
    assert found.features.doppler_bandwidth_hz is None
    assert "keeps_still:found_by_breathing" in found.flags


def test_nobody_is_an_empty_list_with_a_reason():
    found = analyze(observed(seconds=12.0))
    assert not found
    assert "no steady breathing" in found.reason
    assert "0.5 m/s" in found.reason


def test_time_of_motion_is_that_of_the_line():
    motion = lines()
    motion.power_v2[10:30, 60] += 100.0  # 2 m/s
    assert find_motion(motion, Detector(), Tracker()) == [pytest.approx((1.0, 2.9))]
    motion.power_v2[34, 60] += 100.0  # one more cell in a while does not count: too few of the scans
    assert find_motion(lines(), Detector(), Tracker()) == []


def test_both_ways_is_more_than_limbs_noise_or_an_image():
    whole = (0.0, 3.9)
    assert has_both_directions(lines((1.2, 1000.0), (-0.9, 400.0)), *whole)
    assert not has_both_directions(lines((1.2, 1000.0)), *whole)
    assert not has_both_directions(lines((1.2, 1000.0), (-0.9, 30.0)), *whole)  # 15 dB down
    assert not has_both_directions(
        lines((0.2, 5000.0), (1.2, 1000.0), (-0.9, 400.0)), *whole
    )  # the limbs of who passes
    assert not has_both_directions(lines((1.2, 1000.0), (-1.2, 130.0)), *whole)  # an uneven receiver
    assert not has_both_directions(lines((1.2, 1000.0), (-0.9, 400.0), scans=2), *whole)


def test_power_of_bursts_and_of_the_whole_agree():
    whole = observed(walker())
    one = transform_motion(whole.frames, Detector(), wavelength_m=RADAR.wavelength_m)
    other = transform_motion(in_bursts(whole).frames, Detector(), wavelength_m=RADAR.wavelength_m)
    assert np.median(one.peaks_mps()) == pytest.approx(np.median(other.peaks_mps()), abs=0.1)
    means = average_bursts(in_bursts(whole).frames)
    assert means.matrix[3, 0] == pytest.approx(whole.baseband.values[600:700, 0].mean(), rel=1e-5)


@pytest.mark.shared
@pytest.mark.filterwarnings("ignore::doppelgait.core.errors.DoppelgaitWarning")  # clipped, and uneven pauses
@pytest.mark.parametrize(("step", "most_wrong"), [(4, 1), pytest.param(1, 3, marks=pytest.mark.release)])
def test_every_measured_burst_recording_has_one_target(shared, step, most_wrong):
    """150 people and 2 recordings of a dog, one body each, from 4 to 7 m to the radar."""
    files = sorted((shared / "data/radar/cw24_kmkim036").glob("*/*_RE.txt"))
    assert len(files) == 152
    found = [analyze(read_cw_text(file)) for file in files[::step]]
    assert all(len(targets) == 1 for targets in found)
    assert sum(flag.startswith("more_than_one") for (one,) in found for flag in one.flags) <= most_wrong
