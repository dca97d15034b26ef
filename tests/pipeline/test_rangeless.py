"""Targets and sitters before a radar without range."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import hilbert

from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.core.rng import rng
from doppelgait.motion import boulic_walk
from doppelgait.motion.models.primitives import breathing_person
from doppelgait.pipeline import Conditions, analyze, simulate
from doppelgait.pipeline.rangeless import Motion, has_both_directions, observe_motion
from doppelgait.processing import Analysis
from doppelgait.radar import Radar, Recording, concat
from doppelgait.radar.readers.text import read_cw_text
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
    return recording.with_baseband(recording.baseband.isel(slow_time=kept).assign_attrs(burst_pulses=pulses), truth=())


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
    assert not any(flag == "may_be_more_than_one_body" for flag in found.flags)


def module(change, *, speed_mps=1.1, range_m=5.0, level=1.0):
    """Record with a module of 24 GHz a trunk and four limbs that approach at ``speed_mps``, 1.8 steps a second."""
    time_s, generator = np.arange(8000) / 1000.0, np.random.default_rng(4)
    way_m = np.cumsum(np.broadcast_to(speed_mps, time_s.shape)) / 1000.0
    turn, size = 2 * np.pi * 0.9 * time_s, np.abs(np.mean(speed_mps)) / 1.1
    swings = [(1.0, 0.012 * size, 2.0, 0.0), *((0.3, 0.19 * size, 1.0, phase) for phase in (0.0, 0.4, 3.1, 3.5))]
    echo = sum(
        level * (6.0 / (12.0 - way_m)) ** 2 * np.exp(4j * np.pi / 0.0125 * (way_m + swing_m * np.sin(n * turn + phase)))
        for level, swing_m, n, phase in swings
    )
    echo = level * echo + 0.03 * (generator.standard_normal((8000, 2)) @ [1, 1j])
    values = np.asarray(change(echo, 2 * np.pi * time_s), dtype=np.complex64)[:, None]
    axes = {"slow_time": time_s, "range": np.array([range_m])}
    radar = Radar.preset("xband-cw", prf_hz=1000, carrier_hz=299792458.0 / 0.0125)
    return Recording.from_baseband(make_array(BASEBAND, values, axes), radar)


def mix(gain, phase_deg, offset=0.0):
    return lambda y, turn: y.real + 1j * gain * (y * np.exp(1j * np.radians(phase_deg))).imag + offset


KINDS = [
    (mix(1.41, 20), ""),
    (mix(0.71, -20, 5 - 3j), ""),
    (lambda y, turn: y.real + 2.0, "no_direction"),
    (lambda y, turn: y.real * (1 - 1j) + 3j, "no_direction"),
    (lambda y, turn: y.real * (1 + 2j) + 0.03j * np.sin(turn**2), "no_direction"),
    (lambda y, turn: y + 3 * np.cos(50.07 * turn), "mains_lines_removed:50_hz"),
    (lambda y, turn: y + 30 * np.cos(59.9 * turn) + 12j * np.sin(59.9 * turn + 1), "mains_lines_removed:60_hz"),
    (lambda y, turn: y + 2 * np.exp(-149.9j * turn), "mains_lines_removed:150_hz;mains_line_or_body:150_hz"),
    (lambda y, turn: y + 4 * np.cos(1200.6 * turn) + np.cos(120.06 * turn), "mains_lines_removed:120_1200_hz"),
    (
        lambda y, turn: y.real + 2 * np.cos(50.02 * turn) + (1 + 0.05 * turn) * np.cos(100.04 * turn),
        "mains_lines_removed:50_100_hz;no_direction",
    ),
]
"""What a module makes of the samples of a good one, and the flags of the receiver."""


@pytest.mark.parametrize("gate", ["track", (0.0, 10.0)])
@pytest.mark.parametrize(("change", "flags"), KINDS)
def test_a_cheap_module_has_the_features_of_a_good_one(change, flags, gate):
    good, found = (
        analyze(module(chosen, speed_mps=-1.1), gate=gate, analysis=Analysis(clutter="mean"))[0]
        for chosen in (lambda y, turn: y, change)
    )
    speed_mps = 1.1 if "no_direction" in flags else -1.1  # of one output, the speed without direction
    assert found.features.torso_velocity_mps == pytest.approx(speed_mps, rel=0.02)
    assert found.gait_frequency_hz == pytest.approx(1.8, rel=0.02)
    assert found.features.doppler_bandwidth_hz == pytest.approx(good.features.doppler_bandwidth_hz, rel=0.1)
    assert found.signature.attrs.get("receiver", "") == flags
    assert set(filter(None, flags.split(";"))) <= set(found.flags)
    assert not any(flag == "may_be_more_than_one_body" for flag in found.flags)


@pytest.mark.parametrize("speed_mps", [0.3, np.linspace(0.8, 1.5, 8000)])
def test_one_side_has_bandwidth_and_power_of_both(speed_mps):
    """The second body's line drifts: its signature is aligned."""
    both, one = (module(change, speed_mps=speed_mps) for change in (lambda y, turn: y, lambda y, turn: y.real))
    (good,), (found,) = analyze(both, gate=(0.0, 10.0)), analyze(one, gate=(0.0, 10.0))
    assert found.features.doppler_bandwidth_hz == pytest.approx(good.features.doppler_bandwidth_hz, rel=0.05)
    assert float(found.signature.sum()) == pytest.approx(float(good.signature.sum()) / 2, rel=0.1)


def test_one_output_can_be_stated():
    """An analytic signal has a Q that does not repeat I."""
    frames = module(lambda y, turn: hilbert(y.real), speed_mps=-1.1)
    stated = frames.with_baseband(frames.baseband.assign_attrs(one_output=True))
    speeds_mps = [analyze(recording)[0].features.torso_velocity_mps for recording in (stated, frames)]
    assert speeds_mps == pytest.approx([1.1, 1.1], rel=0.02)
    assert ["no_direction" in analyze(recording)[0].flags for recording in (stated, frames)] == [True, False]


@pytest.mark.parametrize("range_m", [0.0, 5.0])
@pytest.mark.parametrize("normalisation", ["sum", "r4"])
def test_a_radar_without_range_has_no_range_weight(range_m, normalisation):
    with np.errstate(divide="raise", invalid="raise"):
        (found,) = analyze(module(lambda y, turn: y, range_m=range_m), analysis=Analysis(normalisation=normalisation))
    (other,) = analyze(module(lambda y, turn: y, range_m=7.0), analysis=Analysis(normalisation=normalisation))
    assert found.features.as_dict() == pytest.approx(other.features.as_dict(), rel=1e-9)


@pytest.mark.parametrize(
    ("change", "speed_mps", "flags"),
    [
        (lambda y, turn: y + 0.5 * np.cos(100.1 * turn) + 0.2j * np.cos(200.2 * turn), None, ()),  # a lamp
        (lambda y, turn: y + sum(np.cos(50 * n * turn + n) * (0.3 + 0.1j) / n for n in range(1, 12)), None, ()),
        (lambda y, turn: y + (1 + 0.02 * turn) * np.exp(54j * turn), 0.3375, ()),  # bodies that approach
        (lambda y, turn: y + (1 + 0.02 * turn) * np.exp(100j * turn), 0.625, ("mains_line_or_body:100_hz",)),
        (lambda y, turn: y.real + (1 + 0.02 * turn) * np.cos(100 * turn), 0.625, ("mains_line_or_body:100_hz",)),
    ],
)
def test_lamps_and_supplies_are_no_targets_and_bodies_at_constant_speed_are(change, speed_mps, flags):
    found = analyze(module(change, level=0.0), gate=(0.0, 10.0) if speed_mps else "track")
    assert len(found) == (speed_mps is not None)
    for target in found:
        assert target.features.torso_velocity_mps == pytest.approx(speed_mps, abs=0.01)
        assert tuple(flag for flag in target.flags if flag.startswith("mains")) == flags


def test_a_lamp_is_no_target_between_pauses_of_a_second():
    lit = module(lambda y, turn: y + 0.5 * np.cos(100.1 * turn), level=0.0)
    parts = [lit.between(start_s, start_s + 1.4) for start_s in (0.0, 2.4, 4.8)]
    assert len(analyze(concat(parts))) == 0


@pytest.mark.parametrize("change", [lambda y, turn: y, lambda y, turn: y.real])
def test_a_segment_ends_where_the_body_rests(change):
    """A path without range could also be that of a body that passes by, so the segments do not find the rest."""
    speed_mps = 1.1 * np.interp(np.arange(8000), [2800, 3400, 4400, 5000], [1, 0, 0, 1])
    (found,) = analyze(module(change, speed_mps=speed_mps))
    assert found.features.torso_velocity_mps == pytest.approx(1.1, rel=0.1)
    assert all(segment.quality["stop_s"] < 3.6 or segment.quality["start_s"] > 4.2 for segment in found.segments)
    assert len(found.segments) == 2


def test_hum_in_all_bins_is_removed_and_bodies_in_single_bins_stay():
    spur = [{"kind": "spur", "frequency_hz": 50.05, "level_db": -60.0}]
    radar, scene = Radar.preset("x4", prf_hz=640), Scene([walker()], duration_s=4.0)
    good, found = (
        analyze(simulate(scene, radar, rng=rng(3), snr_db=15.0, conditions=Conditions(impairments=kinds)))[0]
        for kinds in ([], spur)
    )
    assert found.flags[0] == "mains_lines_removed:50_hz"
    assert found.features.torso_velocity_mps == pytest.approx(good.features.torso_velocity_mps, rel=0.01)
    assert found.features.doppler_bandwidth_hz == pytest.approx(good.features.doppler_bandwidth_hz, rel=0.05)
    assert found.gait_frequency_hz == pytest.approx(good.gait_frequency_hz, rel=0.01)
    assert "receiver" not in good.signature.attrs


def test_two_who_pass_each_other_are_flagged():
    (found,) = analyze(observed(walker(), walker(2.5, 0.0)))
    assert "may_be_more_than_one_body" in found.flags
    assert found.n_bodies == 2


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


def test_both_ways_is_more_than_limbs_noise_or_an_image():
    def both(*cells, scans=40):
        motion = lines(*cells, scans=scans)
        return has_both_directions(observe_motion(motion, 0.0, 3.9), motion.floor_v2)

    assert both((1.2, 1000.0), (-0.9, 400.0))
    assert not both((1.2, 1000.0))
    assert not both((1.2, 1000.0), (-0.9, 30.0))  # 15 dB down
    assert not both((0.2, 5000.0), (1.2, 1000.0), (-0.9, 400.0))  # the limbs of who passes
    assert not both((1.2, 1000.0), (-1.2, 130.0))  # an uneven receiver
    assert not both((1.2, 1000.0), (-0.9, 400.0), scans=2)


@pytest.mark.parametrize(("speed_mps", "gap_s", "bodies"), [(1.0, 1.0, 1), (1.0, 3600.0, 2), (1.6, 1.0, 2)])
def test_a_body_without_range_continues_after_a_short_pause_at_its_speed(speed_mps, gap_s, bodies):
    def walk(speed_mps):
        motion = boulic_walk(speed_mps=speed_mps, height_m=1.75, duration_s=4.0)
        return replace(observed(Target(motion, range_m=9.0)), truth=())

    targets = analyze(concat([walk(1.0), walk(speed_mps)], gap_s=gap_s))
    assert [len(one.segments) for one in targets] == ([2] if bodies == 1 else [1, 1])


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
