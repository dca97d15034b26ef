"""Targets found without the truth, against the truth."""

import math
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

from doppelgait.core.config import read_toml
from doppelgait.core.errors import AnalysisError, DoppelgaitWarning
from doppelgait.core.labels import SIGNATURE, Signal, make_array
from doppelgait.core.rng import rng
from doppelgait.data import DEMO
from doppelgait.motion import boulic_walk
from doppelgait.motion.models.primitives import breathing_person
from doppelgait.pipeline import Conditions, analyze, describe_results, parse_run, run_simulation, simulate
from doppelgait.pipeline.analyze import flag_overlaps
from doppelgait.pipeline.result import Result
from doppelgait.pipeline.target import SHARED, Gated, mark_other_bodies
from doppelgait.pipeline.tracking import _link
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.breathing import BreathingTarget
from doppelgait.processing.clutter import remove_static_clutter
from doppelgait.processing.detect import Detector, find_scans
from doppelgait.processing.track import Track
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target

RADAR = Radar.preset("x4")
WALK = boulic_walk(speed_mps=1.2, height_m=1.75, duration_s=4.5)


def make_room(far_db, **drift):
    clutter = {"kind": "static_clutter", "in_units": True, "levels": [[0.8, -60.0], [8.0, far_db]]}
    return Conditions(impairments=[clutter, {"kind": "phase_noise", "white_rad": 0.003, **drift}])


class Untold:
    """A truth that nobody may look at."""

    def __iter__(self):
        raise AssertionError("the truth was read")

    __len__ = __getitem__ = __bool__ = __iter__


def test_a_walker_is_found_in_clutter_with_the_features_of_the_true_gate():
    scene = Scene([Target(WALK, label="human", range_m=4.5)])
    told = simulate(scene, RADAR, rng=rng(3), snr_db=20.0, conditions=make_room(-85.0))
    blind = replace(told)
    object.__setattr__(blind, "truth", Untold())
    found, true = analyze(blind), analyze(told, gate="truth", analysis=Analysis(clutter="mean"))[0]
    assert len(found) == 1
    (result,) = found
    assert result.gate.source == "track"
    assert result.label is None
    assert result.features.torso_velocity_mps == pytest.approx(true.features.torso_velocity_mps, abs=0.03)
    assert result.gait_frequency_hz == pytest.approx(true.gait_frequency_hz, rel=0.02)
    times = result.gate.time_s
    apart = result.gate.centre_m - np.interp(times, told.baseband.slow_time.values, told.truth[0].centre_range_m)
    assert np.sqrt((apart**2).mean()) < 0.15
    assert times[-1] - times[0] > 0.85 * 4.5


@pytest.mark.parametrize("gate", ["truth", "track"])
def test_a_crossing_costs_neither_body_of_the_demonstration_anything(gate):
    scene, _ = read_toml(DEMO)
    targets, unseen = scene["targets"], {"background": True, "rcs": {"total_m2": 1e-9}}
    results = analyze(run_simulation(parse_run(scene)), gate=gate)
    for result, target in zip(results, targets, strict=True):
        others = [one if one is target else one | unseen for one in targets]  # that the draw of the body stays
        (alone,) = analyze(run_simulation(parse_run({**scene, "targets": others})), gate="truth")
        assert result.features.torso_velocity_mps == pytest.approx(alone.features.torso_velocity_mps, rel=0.06)
        assert result.gait_frequency_hz == pytest.approx(alone.gait_frequency_hz, rel=0.01)
        assert result.features.doppler_bandwidth_hz == pytest.approx(alone.features.doppler_bandwidth_hz, rel=0.05)
        assert not {"gates_overlap", "low_confidence"} & {*result.flags}


@pytest.mark.parametrize(
    ("other_mps", "counted_s", "sides"),
    [(-1.0, 8.0, {0, 2}), (0.3, 8.0 - 2 * 1.6 / 0.7, {0, 3}), (-0.3, 8.0 - 2 * 1.6 / 1.3, {0, 3}), (0.5, 8.0, set())],
)
def test_what_another_body_occupies_is_marked(other_mps, counted_s, sides):
    """It approaches while the target recedes, moves the same way, hardly moves or leaves less than 2 s."""
    time_s = np.arange(0.0, 8.0, 0.002)
    gates = [Gate.around(time_s, 9.0 + speed_mps * (time_s - 4.0), span_m=1.6) for speed_mps in (1.0, other_mps)]
    coords = {"time": time_s, "doppler": [-1.0, 0.0], "velocity": ("doppler", [-1.0, 0.0])}
    mu = Signal.of(make_array(SIGNATURE, np.ones((time_s.size, 2)), coords), SIGNATURE)
    marked = mark_other_bodies(Gated(mu, gates[0], Analysis(), None), gates[1:]).signature
    assert set(marked.axis("other_sides") if "other_sides" in marked.coords else ()) == sides
    assert marked.counted.mean() * 8.0 == pytest.approx(counted_s, abs=0.01)


def result_at(range_m, *flags, times_s=(0.0, 4.0)):
    gate = Gate.around(np.linspace(*times_s, 41), np.full(41, range_m), span_m=1.6, source="track")
    return Result(Analysis(), gate_limits=gate, flags=flags)


def test_an_echo_in_the_gate_of_its_own_body_is_no_other_target():
    body, echo, other = flag_overlaps([result_at(3.0), result_at(3.5, "reflection_of:0"), result_at(9.0)])
    assert body.flags == ("own_echo_in_gate",)
    assert echo.flags == ("reflection_of:0", "gates_overlap")
    assert other.flags == ()
    body, echo, other = flag_overlaps([result_at(3.0), result_at(3.5, "reflection_of:2"), result_at(9.0)])
    assert body.flags == ("gates_overlap",)


def test_the_overlap_of_a_tracked_target_is_that_of_its_longest_segment():
    other = result_at(3.0, times_s=(2.0, 4.0))
    early = replace(result_at(3.0), segments=(result_at(3.0),), quality={"start_s": 0.0, "stop_s": 1.9})
    late = replace(early, quality={"start_s": 1.0, "stop_s": 3.0})
    assert flag_overlaps([early, other])[0].flags == ()
    assert flag_overlaps([late, other])[0].flags == ("gates_overlap",)
    for share, flags in ((0.3, ()), (0.4, ("gates_overlap",))):  # left out of the analysis
        assert flag_overlaps([replace(late, quality={**late.quality, SHARED: share}), other])[0].flags == flags


def test_an_empty_list_names_the_strongest_cell_and_the_level_that_it_needs():
    """The level is that of exponential noise, its place and speed those of a walker below it."""
    walker = Target(WALK, range_m=4.5)
    made = simulate(Scene([walker], duration_s=4.0), RADAR, rng=rng(0), snr_db=-25.0)
    found = analyze(made)
    assert found == []
    values = re.search(r"is ([0-9.]+) dB above the noise \(([0-9.]+) m, .* needs ([0-9.]+) dB", found.reason)
    best_db, place_m, needed_db = map(float, values.groups())
    assert needed_db == pytest.approx(10 * math.log10(-math.log(1e-6)), abs=0.2)
    assert 8.0 < best_db < needed_db + 4.0
    assert RADAR.range_start_m < place_m < RADAR.range_stop_m
    assert "4.0 s are too short to detect breathing, which needs 10 s" in found.reason
    assert describe_results(made, found)["reason"] == found.reason


@pytest.mark.parametrize("prf_hz", [100.0, 640.0])
def test_a_torso_in_another_fold_than_its_track_is_flagged(prf_hz):
    scene, radar = Scene([Target(WALK, range_m=4.5)], duration_s=4.0), Radar.preset("x4", prf_hz=prf_hz)
    with warnings.catch_warnings(action="ignore", category=DoppelgaitWarning):  # it says that limbs alias
        found = analyze(simulate(scene, radar, rng=rng(0), snr_db=20.0))[0]
    is_folded = radar.unambiguous_velocity_mps < found.quality["track_velocity_mps"]
    assert ("torso_velocity,step_length:main_line_differs_from_track" in found.flags) == is_folded == (prf_hz == 100.0)


@pytest.mark.parametrize("kind", ["boulic", "quadruped", "curtain"])
def test_an_empty_list_says_that_the_sign_of_doppler_is_wrong(kind):
    made = simulate(Scene([Target(kind, range_m=3.0)], duration_s=4.0), RADAR, rng=rng(4), snr_db=20.0)
    turned = made.with_baseband(made.baseband.copy(data=made.baseband.values.conj()))
    assert ("contradict each other: conjugate" in analyze(turned).reason) == (kind != "curtain")
    assert "contradict each other" not in analyze(made).reason


def test_an_empty_list_says_that_frames_are_too_few():
    made = simulate(Scene([], duration_s=12.0), Radar.preset("x4-17fps"), rng=rng(1))
    with pytest.warns(DoppelgaitWarning, match="only people who keep still"):
        found = analyze(made)
    assert found == []
    assert found.reason == (
        "moving bodies cannot be detected at 17 frames/s; no range bin shows steady breathing for 12 s"
    )


def track_of(start_s, stop_s, range_m, velocity_mps):
    """A track at 10 Hz with these ranges and velocities at its ends."""
    times = np.arange(start_s, stop_s, 0.1)
    ends = np.array([0.0, 1.0])
    place = np.linspace(0.0, 1.0, times.size)
    flat, seen = np.full(times.size, 0.02), np.ones(times.size, dtype=bool)
    return Track(
        times_s=times, range_m=np.interp(place, ends, range_m), velocity_mps=np.interp(place, ends, velocity_mps),
        range_sd_m=flat, velocity_sd_mps=flat, measured=seen, shared=~seen, range_low_m=-flat, range_high_m=flat,
        velocity_low_mps=-flat, velocity_high_mps=flat, confirmed_at_s=start_s + 0.5, mean_nis=1.0, mean_power_v2=1.0,
    )  # fmt: skip


FRAME_M = np.linspace(0.4, 9.4, 180)
BREATH = BreathingTarget(4.1, 0.25, 0.004, 20.0, 0.9, 5.0, 55.0)
COMES, GOES = track_of(0, 4, (8, 4), (1.2, 0.0)), track_of(50, 55, (4.2, 9), (-0.5, -1.2))


@pytest.mark.parametrize(
    ("late", "persons", "n_bodies"),
    [
        (GOES, [BREATH], 1),
        (GOES, [], 2),  # too long without a sign of life
        (track_of(12, 16, (4.2, 9), (-0.5, -1.2)), [], 1),
        (track_of(12, 16, (5.2, 9), (-0.5, -1.2)), [], 2),  # another place
        (track_of(12, 16, (4.2, 9), (-1.2, -1.2)), [], 2),  # was on the way when first seen
        (track_of(3, 16, (4.2, 9), (-0.5, -1.2)), [], 2),  # at the same time
    ],
)
def test_who_rests_and_goes_on_from_there_is_one(late, persons, n_bodies):
    found = _link([late, COMES], persons, FRAME_M)
    assert len(found) == n_bodies
    if n_bodies == 1:
        assert (found[0].first_s, found[0].last_s) == (COMES.first_s, late.last_s)
        np.testing.assert_array_equal(found[0].range_m, np.concatenate([COMES.range_m, late.range_m]))


def test_two_who_could_go_on_are_not_linked_nor_who_leaves_the_frame():
    assert len(_link([COMES, GOES, track_of(51, 55, (3.9, 1), (0.5, 1.2))], [BREATH], FRAME_M)) == 3
    assert len(_link([COMES, GOES], [BREATH], np.linspace(3.7, 9.4, 100))) == 2


def test_somebody_else_in_between_does_not_matter():
    late, other = track_of(12, 16, (4.2, 9), (-0.5, -1.2)), track_of(5, 7, (7, 8), (-0.5, -0.5))
    assert len(_link([COMES, other, late], [], FRAME_M)) == 2


@pytest.mark.filterwarnings("ignore::doppelgait.core.errors.DoppelgaitWarning")
def test_a_pause_of_nine_seconds_is_inside_one_result():
    path = {"kind": "stop_and_go", "stops": [{"at_m": 3.6, "pause_s": 9.0}]}
    walk = boulic_walk(speed_mps=1.2, height_m=1.75, duration_s=30.0)
    target = Target(walk, start_position_m=(8.9, 0.0), heading_deg=180.0, path=path)
    made = simulate(Scene([target], duration_s=16.0), Radar.preset("x4", prf_hz=500), rng=rng(1), snr_db=25.0)
    (found,) = analyze(made)
    speed_mps = np.abs(made.truth[0].centre_velocity_mps)
    rests = made.baseband.slow_time.values[speed_mps < 0.1]
    assert found.quality["still_start_s"] == pytest.approx(rests[0], abs=1.5)
    assert found.quality["still_stop_s"] == pytest.approx(rests[-1], abs=1.5)
    assert all(one.features.torso_velocity_mps == pytest.approx(1.2, abs=0.12) for one in found.segments)


@pytest.mark.filterwarnings("ignore::doppelgait.core.errors.DoppelgaitWarning")
def test_a_drifting_clock_makes_nobody_of_an_empty_room():
    drifting = make_room(-70.0, drift_rad_per_min=1.0, walk_rad_per_sqrt_min=0.5)
    made = simulate(Scene([], duration_s=12.0), RADAR, rng=rng(0), conditions=drifting)
    assert analyze(made) == []
    as_it_is = remove_static_clutter(made.baseband, kind="mean")
    scans = find_scans(as_it_is, Detector(clutter="none"), wavelength_m=RADAR.wavelength_m)
    assert sum(len(scan.detections) for scan in scans) > 30


def test_one_who_sits_is_found_by_the_breath():
    radar = Radar.preset("x4-17fps")
    sitter = Target(breathing_person(duration_s=40.0, breathing_hz=0.25), range_m=2.0)
    made = simulate(Scene([sitter]), radar, rng=rng(1))
    with pytest.warns(DoppelgaitWarning, match="only people who keep still"):
        found = analyze(made)
    assert len(found) == 1
    quality = found[0].quality
    assert quality["breathing_rate_hz"] == pytest.approx(0.25, rel=0.02)
    assert quality["track_range_m"] == pytest.approx(made.truth[0].centre_range_m.mean(), abs=0.2)
    assert found[0].gait_frequency_hz is None
    assert any(flag.startswith("keeps_still") for flag in found[0].flags)
    assert math.isfinite(found[0].to_json(arrays=False)["quality"]["breathing_rate_hz"])


def test_frames_that_were_filled_in_are_flagged():
    """A recorder that repeats frames: counted exactly, flagged above 2 %."""
    lost = {"kind": "dropped_frames", "probability": 0.06, "mean_length": 5.0}
    scene = Scene([Target(WALK, start_position_m=(7.0, 0.0), heading_deg=180.0)])
    shares = {}
    for name, impairments in (("whole", []), ("lost", [lost])):
        made = simulate(scene, RADAR, rng=rng(4), snr_db=15.0, conditions=Conditions(impairments=impairments))
        (found,) = analyze(made)
        inside = (made.slow_time_s >= found.quality["start_s"]) & (made.slow_time_s < found.quality["stop_s"])
        frames = made.baseband.values[inside]
        shares[name] = np.mean([np.array_equal(one, other) for one, other in zip(frames[1:], frames[:-1], strict=True)])
        assert found.quality["lost_frame_share"] == pytest.approx(shares[name], abs=1e-3)
        assert any("frames_were_lost" in flag for flag in found.flags) == (name == "lost")
    assert shares["whole"] == 0.0
    assert shares["lost"] > 0.02


def test_values_that_are_not_finite_are_an_error_and_no_empty_list():
    made = simulate(Scene([Target(WALK, range_m=4.0)]), RADAR, rng=rng(4), snr_db=15.0)
    values = made.baseband.values.copy()
    values[100, 7] = np.nan
    made = made.with_baseband(made.baseband.copy(data=values))
    with pytest.raises(AnalysisError, match=r"1 of \d+ frames .*not finite \(first: frame 100\)"):
        analyze(made)
