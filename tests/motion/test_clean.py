"""Cleaning and describing motions whose truth is known."""

import json
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
    find_stationary_points,
)
from doppelgait.motion.describe import describe_motion
from recorded import read_quietly

RATE_HZ = 120.0
HEIGHTS_M = np.array([1.7, 1.5, 1.0, 0.5, 0.08, 0.04, 0.04])
PARTS = ["head", "torso", "torso", "left_thigh", "left_shank", "left_foot", "right_foot"]
UP = np.array([0.0, 0.0, 1.0])
SWING_M = np.array([0.0, 0.0, 0.0, 0.1, 0.2, 0.3, -0.3])


def walk(
    *, n_frames: int = 480, speed_mps: float = 1.2, rate_hz: float = RATE_HZ, stride_hz: float = 0.9
) -> np.ndarray:
    time = np.arange(n_frames)[:, None] / rate_hz
    x = speed_mps * time + SWING_M * np.sin(2 * np.pi * stride_hz * time)
    z = HEIGHTS_M + 0.03 * np.sin(4 * np.pi * stride_hz * time)
    return np.stack([x, np.zeros_like(x), z], axis=2)


def motion_of(position: np.ndarray, *, rate_hz: float = RATE_HZ, parts: list[str] | None = None) -> Motion:
    parts = PARTS if parts is None else parts
    names = [f"m{i}" for i in range(position.shape[1])]
    return make_motion(
        position, rate_hz=rate_hz, markers=names, parts=parts, facts={"source": "walk.c3d", "kind": "recording"}
    )


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
    from scipy.interpolate import CubicSpline

    omega, time = 2 * np.pi * 2.0, np.arange(int(3 * rate_hz)) / rate_hz
    fine = np.arange(0.0, time[-1], 1e-3)
    x = 0.3 * np.sin(omega * time + phase) + 1.3 * time
    smooth = filter_lowpass(np.repeat(x[:, None, None], 3, axis=2), rate_hz=rate_hz, cutoff_hz=12.0)[:, 0, 0]
    error = np.abs(CubicSpline(time, smooth)(fine, 1) - 0.3 * omega * np.cos(omega * fine + phase) - 1.3)
    error /= 0.3 * omega
    assert error[100:-100].max() < 5e-3
    assert error.max() < 2e-2


@pytest.mark.parametrize("offset_m", [-0.8, 0.0, 0.5])
def test_floor_is_zero_and_stature_is_measured_from_it(offset_m: float) -> None:
    clean = clean_motion(motion_of(walk() + offset_m * UP))
    lowest = clean.position_m[:, 5:, 2].min()
    assert abs(lowest) < 2e-3
    assert clean.facts.height_m == pytest.approx(1.7 - 0.01, abs=5e-3)


def test_floor_without_known_parts_is_that_of_the_lowest_points() -> None:
    clean = clean_motion(motion_of(walk() + 0.5 * UP, parts=[""] * 7))
    assert abs(clean.position_m[:, :, 2].min()) < 2e-3


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


def test_description_of_a_stander_has_no_stride() -> None:
    facts = describe_motion(motion_of(walk(speed_mps=0.0)))
    assert facts["stride_hz"] is None
    assert abs(facts["mean_speed_mps"]) < 0.02


@pytest.mark.filterwarnings("error")
def test_description_of_a_body_never_half_seen_has_no_stride() -> None:
    holed = np.full((480, 7, 3), np.nan)
    for p in range(7):
        holed[60 * p : 60 * p + 50, p] = walk()[60 * p : 60 * p + 50, p]
    assert describe_motion(motion_of(holed))["stride_hz"] is None


def test_no_frames_have_no_still_points_and_no_centre() -> None:
    assert not find_stationary_points(np.empty((0, 7, 3))).any()
    assert find_body_centre(np.empty((0, 7, 3))).shape == (0, 3)


def test_description_is_json() -> None:
    json.dumps(describe_motion(motion_of(walk())), allow_nan=False)
    json.dumps(describe_motion(motion_of(np.full((10, 7, 3), np.nan))), allow_nan=False)


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
