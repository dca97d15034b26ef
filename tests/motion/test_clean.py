"""Cleaning and describing motions whose truth is known."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy.interpolate import CubicSpline

from doppelgait.core.errors import MotionError
from doppelgait.motion import Motion, make_motion
from doppelgait.motion.clean import (
    choose_cutoff_hz,
    clean_motion,
    filter_lowpass,
    find_body_centre,
    find_jumps,
    find_stationary_points,
    find_steps,
    find_useless_points,
    repair_swaps,
)
from doppelgait.motion.describe import describe_motion
from doppelgait.motion.models import boulic_walk, quadruped_gait
from recorded import read_quietly

RATE_HZ = 120.0
HEIGHTS_M = np.array([1.7, 1.5, 1.0, 0.5, 0.08, 0.04, 0.04])
PARTS = ["head", "torso", "torso", "left_thigh", "left_shank", "left_foot", "right_foot"]
UP = np.array([0.0, 0.0, 1.0])
SWING_M = np.array([0.0, 0.0, 0.0, 0.1, 0.2, 0.3, -0.3])


def walk(*, n_frames: int = 480, speed_mps: float = 1.2, stride_hz: float = 0.9) -> np.ndarray:
    time = np.arange(n_frames)[:, None] / RATE_HZ
    x = speed_mps * time + SWING_M * np.sin(2 * np.pi * stride_hz * time)
    z = HEIGHTS_M + 0.03 * np.sin(4 * np.pi * stride_hz * time)
    return np.stack([x, np.zeros_like(x), z], axis=2)


def motion_of(position: np.ndarray, parts: list[str] = PARTS, names: list[str] | None = None) -> Motion:
    names = names or [f"m{i}" for i in range(position.shape[1])]
    facts = {"source": "walk.c3d", "kind": "recording"}
    return make_motion(position, rate_hz=RATE_HZ, markers=names, parts=parts, facts=facts)


def test_a_complete_motion_keeps_everything_but_the_floor() -> None:
    truth = walk()
    clean = clean_motion(motion_of(truth))
    assert clean.positions.shape == truth.shape
    shift = clean.report["floor_shift_m"]
    np.testing.assert_allclose(clean.position_m, truth + shift * UP, atol=5e-4)
    assert clean.report["dropped"] == {}
    assert clean.facts.source == "walk.c3d"
    json.dumps(clean.report, allow_nan=False)


@pytest.mark.parametrize(("length", "error_m"), [(1, 1e-6), (6, 2e-5), (30, 6e-3)])
def test_short_gap_is_filled_on_the_path(length: int, error_m: float) -> None:
    truth, holed = walk(), walk()
    holed[100 : 100 + length, 5] = np.nan
    clean = clean_motion(motion_of(holed), lowpass_hz=None, floor=False)
    np.testing.assert_allclose(clean.position_m, truth, atol=error_m)
    facts = clean.report
    assert (facts["gaps_filled"], facts["samples_filled"], facts["longest_gap_filled"]) == (1, length, length)


@pytest.mark.parametrize(
    ("point", "frames", "value", "reason"),
    [
        (5, slice(200, 231), np.nan, "not seen throughout (gaps up to 0.25 s are filled)"),
        (2, slice(None), np.nan, "never seen"),
        (2, slice(None), [1.0, 2.0, 0.5], "stands still while the body moves"),
    ],
)
def test_a_useless_point_costs_the_point_not_the_recording(point: int, frames: slice, value: Any, reason: str) -> None:
    holed = walk()
    holed[frames, point] = value
    clean = clean_motion(motion_of(holed))
    assert clean.positions.shape == (480, 6, 3)
    assert np.isfinite(clean.position_m).all()
    assert clean.report["dropped"] == {reason: [f"m{point}"]}


def test_recording_is_cropped_to_the_presence_of_the_subject() -> None:
    holed = walk()
    for p in range(7):
        holed[: 60 + 3 * p, p] = np.nan
        holed[400 - 2 * p :, p] = np.nan
    clean = clean_motion(motion_of(holed), lowpass_hz=None, floor=False)
    np.testing.assert_allclose(clean.position_m, walk()[78:388], atol=1e-9)
    assert clean.report["kept_from_s"] == pytest.approx(78 / RATE_HZ)
    assert clean.report["kept_to_s"] == pytest.approx(387 / RATE_HZ)
    assert clean.time_s[0] == 0.0


def test_a_standing_or_squatting_person_keeps_its_feet() -> None:
    for depth_m in (0.0, 0.4):
        squat = walk(speed_mps=0.0)
        squat[:, :4, 2] -= depth_m * (1 - np.cos(np.linspace(0, 8 * np.pi, 480)))[:, None] * HEIGHTS_M[:4] / 1.7
        squat[:, 4:] = squat[:1, 4:]
        assert clean_motion(motion_of(squat)).positions.sizes["marker"] == 7


@pytest.mark.parametrize(("length", "away_m", "lost"), [(1, 0.4, 0), (2, 0.4, 0), (1, 50.0, 2)])
def test_spikes_are_replaced(length: int, away_m: float, lost: int) -> None:
    spiky = walk()
    spiky[150 : 150 + length, 3] += [0.0, away_m, 0.0]
    spiky[150 + length : 150 + length + lost, 3] = np.nan
    clean = clean_motion(motion_of(spiky), lowpass_hz=None, floor=False)
    assert clean.report["spikes_removed"] == length
    np.testing.assert_allclose(clean.position_m, walk(), atol=1e-4)


def test_a_fast_foot_is_no_spike() -> None:
    run = walk(speed_mps=4.0, stride_hz=1.5)
    run[:, 5:, 0] += 0.5 * np.sin(2 * np.pi * 1.5 * np.arange(480) / RATE_HZ)[:, None] * [1, -1]
    assert clean_motion(motion_of(run)).report["spikes_removed"] == 0


@pytest.mark.parametrize("rate_hz", [60.0, 250.0])
@pytest.mark.parametrize("phase", np.arange(4) * np.pi / 4)
def test_lowpass_keeps_the_velocity_up_to_the_ends(rate_hz: float, phase: float) -> None:
    omega, time = 2 * np.pi * 2.0, np.arange(int(3 * rate_hz)) / rate_hz
    fine = np.arange(0.0, time[-1], 1e-3)
    x = 0.3 * np.sin(omega * time + phase) + 1.3 * time
    smooth = filter_lowpass(np.repeat(x[:, None, None], 3, axis=2), rate_hz=rate_hz, cutoff_hz=12.0)[:, 0, 0]
    error = np.abs(CubicSpline(time, smooth)(fine, 1) - 0.3 * omega * np.cos(omega * fine + phase) - 1.3)
    error /= 0.3 * omega
    assert error[100:-100].max() < 5e-3
    assert error.max() < 2e-2


@pytest.mark.parametrize("parts", [PARTS, [""] * 7])
@pytest.mark.parametrize("offset_m", [-0.8, 0.5])
def test_floor_is_zero_and_stature_is_measured_from_it(offset_m: float, parts: list[str]) -> None:
    clean = clean_motion(motion_of(walk() + offset_m * UP, parts=parts))
    assert abs(clean.position_m[:, 5:, 2].min()) < 2e-3
    assert parts != PARTS or clean.facts.height_m == pytest.approx(1.7 - 0.01, abs=5e-3)


def test_body_without_feet_stays_at_its_height() -> None:
    clean = clean_motion(motion_of(walk()[:, :3], parts=PARTS[:3]))
    assert clean.report["floor_shift_m"] == 0.0
    assert clean.facts.height_m == pytest.approx(1.7, abs=5e-3)


def test_too_little_is_refused_with_a_reason() -> None:
    with pytest.raises(MotionError, match=r"walk.c3d: 7 of 7 points over 0.33 s"):
        clean_motion(motion_of(walk(n_frames=40)))
    holed = walk()
    holed[:, 2:] = np.nan
    with pytest.raises(MotionError, match=r"2 of 7 points.*never seen"):
        clean_motion(motion_of(holed))
    with pytest.raises(MotionError, match="0 of 7 points"):
        clean_motion(motion_of(np.full((100, 7, 3), np.nan)))
    with pytest.raises(MotionError, match=r"a coordinate is 1e\+30 m, but at most 10000 m"):
        clean_motion(motion_of(np.where(walk() > 1.0, 1e30, walk())))


def test_input_is_not_changed() -> None:
    holed = walk()
    holed[150, 3] += 0.4
    motion = motion_of(holed)
    before = motion.positions.copy(deep=True)
    clean_motion(motion)
    xr.testing.assert_identical(motion.positions, before)


@pytest.mark.parametrize("heading_deg", [0.0, 30.0, 135.0, 270.0])
def test_description_recovers_speed_direction_and_stride(heading_deg: float) -> None:
    angle = np.radians(heading_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    facts = describe_motion(motion_of(walk() @ turn.T))
    assert facts["mean_speed_mps"] == pytest.approx(1.2, rel=0.01)
    assert facts["net_displacement_m"] == pytest.approx(1.2 * 479 / RATE_HZ, rel=0.01)
    assert facts["straightness"] == pytest.approx(1.0, abs=1e-3)
    assert facts["stride_hz"] == pytest.approx(0.9, abs=0.03)
    assert facts["step_hz"] == pytest.approx(1.8, abs=0.06)
    assert facts["lateral_rms_m"] < 1e-3
    assert facts["travel_direction"] == f"{np.cos(angle):+.2f}x{np.sin(angle):+.2f}y".replace("-0.00", "+0.00")
    assert facts["height_m"] == pytest.approx(1.66, abs=1e-6)


def test_description_counts_gaps_and_still_points() -> None:
    holed = walk()
    holed[:48, 0] = np.nan
    holed[:, 1] = np.nan
    holed[:, 2] = 1.0
    facts = describe_motion(motion_of(holed))
    assert facts["gap_fraction"] == pytest.approx((48 + 480) / (480 * 7))
    assert (facts["points_with_gaps"], facts["points_all_missing"], facts["stationary_points"]) == (2, 1, 1)


@pytest.mark.filterwarnings("error")
def test_description_of_a_stander_or_a_body_never_half_seen_has_no_stride() -> None:
    holed = np.full((480, 7, 3), np.nan)
    for p in range(7):
        holed[60 * p : 60 * p + 50, p] = walk()[60 * p : 60 * p + 50, p]
    for position in (walk(speed_mps=0.0), holed, np.full((10, 7, 3), np.nan)):
        facts = describe_motion(motion_of(position))
        assert facts["stride_hz"] is None
        json.dumps(facts, allow_nan=False)


def test_no_frames_have_no_still_points_and_no_centre() -> None:
    assert not find_stationary_points(np.empty((0, 7, 3))).any()
    assert find_body_centre(np.empty((0, 7, 3))).shape == (0, 3)


FINE_HZ = 250.0


def peak_speed_mps(path: np.ndarray) -> float:
    time = np.arange(len(path)) / FINE_HZ
    inner = np.arange(250, len(path) - 250, 0.25) / FINE_HZ
    return float(np.linalg.norm(CubicSpline(time, path)(inner, 1), axis=1).max())


@pytest.mark.parametrize("frequency_hz", [3.0, 8.0, 12.0, 16.0, 40.0])
def test_speed_of_an_oscillation_is_lowered_by_the_known_gain(frequency_hz: float) -> None:
    """Two fourth-order passes that leave half the power at the cutoff: gain 1 / (1 + (sqrt(2) - 1) (tan / tan)^8)."""
    time = np.arange(2000) / FINE_HZ
    path = np.zeros((2000, 3))
    path[:, 0] = 0.1 * np.sin(2 * np.pi * frequency_hz * time)
    smooth = filter_lowpass(path[:, np.newaxis], rate_hz=FINE_HZ, cutoff_hz=12.0)[:, 0]
    ratio = np.tan(np.pi * frequency_hz / FINE_HZ) / np.tan(np.pi * 12.0 / FINE_HZ)
    gain = 1.0 / (1.0 + (np.sqrt(2.0) - 1.0) * ratio**8)
    assert peak_speed_mps(smooth) / peak_speed_mps(path) == pytest.approx(gain, rel=2e-3)
    np.testing.assert_allclose(smooth[200:-200], gain * path[200:-200], atol=2e-4)  # without delay


def test_three_frames_per_period_are_needed() -> None:
    for rate_hz, cutoff_hz, chosen_hz in ((36.0, 12.0, 12.0), (35.9, 12.0, None), (100.0, None, None)):
        assert choose_cutoff_hz(0.0, rate_hz=rate_hz, cutoff_hz=cutoff_hz) == chosen_hz


@pytest.mark.parametrize("rate_hz", [60.0, 120.0])
@pytest.mark.parametrize("frame", [2, -2, 15, -15])
def test_a_jump_near_an_end_stays_where_it_is(rate_hz, frame):
    """The continuation of the ends must not grow: a step of 0.7 m may ring, not leave the room."""
    t = np.arange(0, 3, 1 / rate_hz)
    path = np.stack([1.2 * t, 0.2 * np.sin(2 * np.pi * t), 1 + 0 * t], axis=-1)[:, None]
    path[frame if frame < 0 else slice(0, frame), :, :] += 0.7
    smooth = filter_lowpass(path, rate_hz=rate_hz, cutoff_hz=12.0)
    assert np.abs(smooth - path).max() < 0.7


JUMPING = {"cmu_07_01.c3d": ["LTOE"], "cmu_16_07.c3d": ["LFIN"]}
"""Single frames that lie 4 cm beside the path: too little for a spike, too much for a limb."""
GOOD = (
    "btk_coda_walk.c3d", "btk_pig_walk_full.c3d", "c3dorg_ist_walk_metres.c3d", "cmu_02_01.c3d", "cmu_07_01.c3d",
    "cmu_07_12.c3d", "cmu_16_07.c3d", "cmu_16_08.c3d", "cmu_77_02.c3d", "cmu_82_08.c3d", "ezc3d_qualisys_walk.c3d",
    "ktk_optitrack_walk_legs.c3d", "opensim_walking2.c3d",
)  # fmt: skip


@pytest.mark.shared
@pytest.mark.parametrize("name", GOOD)
def test_good_recordings_raise_no_false_alarm(shared: Path, name: str) -> None:
    report = read_quietly(shared / "data/mocap/human/c3d" / name).report
    assert report["swaps_repaired"] == []
    assert [jump["point"] for jump in report["jumps"]] == JUMPING.get(name, [])
    for reason in report["dropped"]:
        assert not reason.startswith(("at the place of", "short-lived", "far away"))


@pytest.mark.shared
def test_second_names_of_the_same_markers_are_dropped(shared: Path) -> None:
    dropped = read_quietly(shared / "data/c3d-edge-cases/phoenix_golfswing.c3d").report["dropped"]
    doubles = {reason: names for reason, names in dropped.items() if reason.startswith("at the place of")}
    assert doubles == {f"at the place of Channel{n}": [f"Channel{n + 8}"] for n in (807, 808, 809, 810, 823)}


def person(speed_mps: float = 1.4) -> Motion:
    return boulic_walk(speed_mps=speed_mps, height_m=1.75, duration_s=3.0, rate_hz=RATE_HZ)


def noise(shape: tuple[int, ...], sd_m: float = 0.002, seed: int = 7) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, sd_m, shape)


@pytest.mark.parametrize(
    ("first", "second", "missing"),
    [
        ("left_knee", "right_knee", 0), ("head", "left_toe", 0), ("left_hand", "left_hip", 0),
        ("left_ankle", "left_toe", 0), ("left_knee", "right_hand", 1), ("left_knee", "right_hand", 10),
    ],
)  # fmt: skip
@pytest.mark.parametrize("sd_m", [0.0, 0.002])
def test_a_swap_is_found_where_it_is_and_undone(first: str, second: str, missing: int, sd_m: float) -> None:
    walk = person()
    names, truth = walk.markers, walk.position_m + noise(walk.positions.shape, sd_m)
    i, j = names.index(first), names.index(second)
    frame = 150 + missing
    truth[150:frame, [i, j]] = np.nan
    swapped = truth.copy()
    swapped[frame:, [i, j]] = swapped[frame:, [j, i]]
    assert repair_swaps(swapped, names, rate_hz=RATE_HZ) == [{"frame": frame, "points": sorted([first, second])}]
    np.testing.assert_array_equal(swapped, truth)


def test_three_points_that_change_places_in_a_ring_are_put_back() -> None:
    walk = person()
    names, truth = walk.markers, walk.position_m + noise(walk.positions.shape)
    ring = [names.index(name) for name in ("left_knee", "left_elbow", "head")]
    pairs = [names.index(name) for name in ("left_hip", "right_hand", "right_toe", "right_elbow")]
    swapped = truth.copy()
    swapped[100:, pairs] = swapped[100:, [pairs[k] for k in (1, 0, 3, 2)]]
    assert len(repair_swaps(swapped, names, rate_hz=RATE_HZ)) == 2
    np.testing.assert_array_equal(swapped, truth)
    swapped[100:, ring] = swapped[100:, [ring[k] for k in (1, 2, 0)]]
    assert repair_swaps(swapped, names, rate_hz=RATE_HZ) == []  # no exchange of two mends a ring
    assert {jump["frame"] for jump in find_jumps(swapped, names, rate_hz=RATE_HZ)} == {100}


def test_a_step_is_what_is_no_constant_acceleration() -> None:
    time = np.arange(20) / 50.0
    path = np.stack([1 + 2 * time, 3 * time**2, 0 * time], axis=1)[:, np.newaxis]
    step, _ = find_steps(path, rate_hz=50.0, floor_m=0.05, jerk_mps3=0.0)
    assert np.isnan(step[[0, 1, -1]]).all()
    np.testing.assert_allclose(step[2:-1], 0.0, atol=1e-12)
    cubic = np.stack([7.0 * time**3 / 6, 0 * time, 0 * time], axis=1)[:, np.newaxis]
    step, limit = find_steps(cubic, rate_hz=50.0, floor_m=0.0, jerk_mps3=12.0)
    np.testing.assert_allclose(step[2:-1], 7.0 / 50**3 / 2, rtol=1e-6)  # by hand: j h^3 / 2
    np.testing.assert_allclose(limit[2:-1], 12.0 / 50**3 / 2)


WALKS = [person(speed) for speed in (0.5, 1.1, 1.7, 2.57)]
DOGS = [quadruped_gait(gait=gait, duration_s=3.0, rate_hz=RATE_HZ) for gait in ("trot", "gallop")]


@pytest.mark.parametrize("sd_m", [0.0, 0.002])
@pytest.mark.parametrize("motion", [*WALKS, *DOGS], ids=lambda motion: str(motion.facts.gait))
def test_clean_motions_raise_no_alarm(motion: Motion, sd_m: float) -> None:
    position, names = motion.position_m + noise(motion.positions.shape, sd_m), motion.markers
    before = position.copy()
    assert repair_swaps(position, names, rate_hz=RATE_HZ) == []
    np.testing.assert_array_equal(position, before)
    assert find_jumps(position, names, rate_hz=RATE_HZ) == []
    assert find_useless_points(position, names, motion.parts) == {}


def test_each_useless_point_goes_for_its_own_reason() -> None:
    walk = person()
    body, n = walk.position_m, walk.n_frames
    double = body[:, [4]] + noise((n, 1, 3), 0.001)
    short = body[:, [2]] + [0.1, 0.0, 0.0]
    short[40:] = np.nan
    far = np.stack([np.linspace(0, 3, n), np.full(n, 6.0), np.ones(n)], axis=1)[:, np.newaxis]
    position = np.concatenate([body, double, short, far], axis=1)
    names, parts = [*walk.markers, "a_double", "short", "far"], [*walk.parts, "", "", ""]
    clean = clean_motion(motion_of(position, parts, names))
    assert clean.report["dropped"] == {
        f"at the place of {names[4]}": ["a_double"],
        "short-lived unknown point": ["short"],
        "far away from the body": ["far"],
    }
    assert clean.markers == walk.markers


def test_of_two_points_at_one_place_the_better_seen_stays() -> None:
    walk = person()
    position = np.concatenate([walk.position_m, walk.position_m[:, [4]]], axis=1)
    position[:30, 4] = np.nan
    names, parts = [*walk.markers, "double"], [*walk.parts, ""]
    assert find_useless_points(position, names, parts) == {4: "at the place of double"}


def test_a_named_point_is_kept_though_it_is_seen_briefly() -> None:
    walk = person()
    position = walk.position_m.copy()
    position[20:, 5] = np.nan
    assert find_useless_points(position, walk.markers, walk.parts) == {}


def test_noise_alone_ends() -> None:
    names = [f"m{i}" for i in range(30)]
    chaos = noise((600, 30, 3), sd_m=1.0)
    assert len(repair_swaps(chaos, names, rate_hz=RATE_HZ)) <= 200
    assert len(find_jumps(chaos, names, rate_hz=RATE_HZ)) > 1000


def spoilt() -> Motion:
    """A walk with one of every fault."""
    walk = person()
    names, position = walk.markers, walk.position_m + noise(walk.positions.shape, 0.001)
    position = np.concatenate([position, position[:, [6]]], axis=1)
    i, j = names.index("left_knee"), names.index("right_elbow")
    position[120:, [i, j]] = position[120:, [j, i]]
    position[60, 8] += 0.4
    position[200:207, 9] = np.nan
    position[:50, [2, 10]] = np.nan
    position[250:, 13, 1] += 0.1
    return motion_of(position, [*walk.parts, ""], [*names, "double"])


def test_one_of_every_fault_is_reported_with_its_place() -> None:
    clean = clean_motion(spoilt())
    report, names = clean.report, person().markers
    assert report["swaps_repaired"] == [{"frame": 120, "points": ["left_knee", "right_elbow"]}]
    assert [(jump["frame"], jump["point"]) for jump in report["jumps"]] == [(250, names[13])]
    assert (report["spikes_removed"], report["gaps_filled"]) == (1, 2)
    assert report["dropped"] == {
        f"at the place of {names[6]}": ["double"],
        "not seen throughout (gaps up to 0.25 s are filled)": [names[2], names[10]],
    }
    assert report["parts"] == "known"


def test_cleaning_goes_with_the_place_and_the_heading_and_in_any_order_of_points() -> None:
    motion, shift_m = spoilt(), np.array([-40.0, 25.0, 0.0])
    order = np.random.default_rng(0).permutation(len(motion.markers))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    moved = motion.with_positions(motion.position_m @ turn.T + shift_m)
    straight, other = clean_motion(motion), clean_motion(replace(moved, positions=moved.positions.isel(marker=order)))
    found = other.positions.sel(marker=straight.markers).values
    np.testing.assert_allclose(found, straight.position_m @ turn.T + shift_m, atol=1e-6)
    for key in ("swaps_repaired", "spikes_removed", "gaps_filled", "kept_from_s", "kept_to_s"):
        assert other.report[key] == straight.report[key]
    dropped = [{why: sorted(who) for why, who in m.report["dropped"].items()} for m in (straight, other)]
    assert dropped[0] == dropped[1]


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        (["head"] * 3, "known"),
        (["torso", "", ""], "1 of 3 known"),
        (["head", "", ""], "1 of 3 known: equal split"),
        ([""] * 3, "unknown: equal split"),
    ],
)
def test_report_says_how_many_parts_are_known(parts: list[str], said: str) -> None:
    walk = person()
    motion = motion_of(walk.position_m[:, [0, 2, 14]], parts)
    assert clean_motion(motion).report["parts"] == said
