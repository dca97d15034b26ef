"""What no body can do is named: wrong units, rates, axes and names, noise, held samples and treadmills."""

import math
import re
import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.motion import crawling_person, human_gait, quadruped_gait
from doppelgait.motion.checks import check_motion
from doppelgait.motion.clean import clean_motion, fill_from_segment, fill_gaps, measure_noise
from doppelgait.motion.ground import belt_velocity_mps, move_over_ground
from doppelgait.motion.motion import Motion, make_motion

RATE_HZ = 60.0
WALK = human_gait(speed_mps=1.2, height_m=1.75, duration_s=4.0, rate_hz=RATE_HZ)
RUN = human_gait(speed_mps=3.0, gait="run", duration_s=3.0, rate_hz=RATE_HZ)
DOG = quadruped_gait(duration_s=4.0, rate_hz=RATE_HZ)


def record(motion: Motion, position_m: np.ndarray | None = None, *, rate: float = 1.0) -> Motion:
    """Return a motion as a recording without facts, at another frame rate."""
    position_m = motion.position_m if position_m is None else position_m
    report = {"metres_per_unit": 1e-3}
    return make_motion(
        position_m, rate_hz=rate * motion.rate_hz, markers=motion.markers, parts=motion.parts, report=report
    )


def tilt(motion: Motion, axis: int, angle_deg: float) -> np.ndarray:
    angle, turn = math.radians(angle_deg), np.eye(3)
    turn[np.ix_([axis, 2], [axis, 2])] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    return motion.position_m @ turn.T


def climb(motion: Motion, angle_deg: float) -> np.ndarray:
    rise = np.zeros((1, 1, 3))
    rise[..., 2] = math.tan(math.radians(angle_deg))
    return motion.position_m + motion.position_m[..., :1] * rise


def shake(motion: Motion, noise_m: float) -> np.ndarray:
    return motion.position_m + np.random.default_rng(5).normal(0.0, noise_m, motion.position_m.shape)


def hold(motion: Motion, points: list[str], frames: int) -> np.ndarray:
    position = motion.position_m.copy()
    for point in (motion.markers.index(name) for name in points):
        for start in (40, 120):
            position[start : start + frames, point] = position[start, point]
    return position


def shift(motion: Motion, point: str, by_m: list[float], first: int = 0) -> np.ndarray:
    position = motion.position_m.copy()
    position[first:, motion.markers.index(point)] += by_m
    return position


def on_belt(motion: Motion, speed_mps: float = 1.2) -> np.ndarray:
    return motion.position_m - speed_mps * motion.time_s[:, np.newaxis, np.newaxis] * [1.0, 0.0, 0.0]


def record_legs(size: float) -> Motion:
    joints = {"hip": "HJC", "knee": "KNE", "ankle": "ANK", "toe": "TOE"}
    points = {f"{side}_{joint}": side[0].upper() + name for side in ("left", "right") for joint, name in joints.items()}
    chosen = [WALK.markers.index(point) for point in points]
    parts = [WALK.parts[n] for n in chosen]
    return record(WALK).with_points(size * WALK.position_m[:, chosen], list(points.values()), parts)


SHORT = human_gait(speed_mps=1.3, duration_s=1.5, rate_hz=RATE_HZ)
AWAY, JUMP = shift(WALK, "left_shoulder", [0, 1.4, 0]), shift(WALK, "left_hand", [0, 0, 0.5], 100)
SWINGS = [f"left_{joint}" for joint in ("knee", "ankle", "toe")]
FAULTS = {
    "cm read as mm": (lambda: record(WALK, 0.1 * WALK.position_m), r"a person of 0\.18 m.*units='cm'", True),
    "giant": (lambda: record(WALK, 2.54 * WALK.position_m), r"a person of 4\.4 m.*unit wrong", True),
    "legs in cm": (lambda: record_legs(0.1), r"a person of 0\.18 m.*units='cm'", True),
    "dog of 3 m": (lambda: record(DOG, 7.0 * DOG.position_m), r"an animal of 3\.\d m", True),
    "on its side": (lambda: record(WALK, tilt(WALK, 1, 90.0)), r"its head is only 0\.\d\d m above.*up_axis", False),
    "4 times too slow": (lambda: record(WALK, rate=0.25), r"15 Hz is probably 4\.\d times higher, about 6\d Hz", True),
    "1.5 s, 4 times too slow": (lambda: record(SHORT, rate=0.24), r"14\.4 Hz is probably [34]\.\d times higher", True),
    "5 times too fast": (lambda: record(RUN, rate=5.0), r"300 Hz is probably 5\.\d times lower, about 5\d Hz", True),
    "dog at 24 of 100": (lambda: record(DOG, rate=0.24), r"14\.4 Hz is probably 4\.\d times higher", True),
    "shoulder 1.4 m away": (lambda: record(WALK, AWAY), "torso.* are 1.*several", True),
    "tilted 12 degrees": (lambda: record(WALK, tilt(WALK, 0, 12.0)), "tilted by 12 degrees.*levelled", False),
    "tilted sideways": (lambda: record(WALK, tilt(WALK, 1, -9.0)), "tilted by 9 degrees.*levelled", False),
    "tilted dog": (lambda: record(DOG, tilt(DOG, 0, -10.0)), "rises by 10 degrees: a slope, or tilted", False),
    "noise of 10 mm": (lambda: record(WALK, shake(WALK, 0.01)), r"noise of 10 mm.*low-pass of [56]\.\d Hz", False),
    "held for 0.4 s": (lambda: record(WALK, hold(WALK, SWINGS, 25)), "samples repeat.*left_ankle.*left out", False),
    "every second frame": (lambda: record(WALK, np.repeat(WALK.position_m[::2], 2, axis=0)), "samples repeat", False),
    "one jump": (lambda: record(WALK, JUMP), r"1 jump.*left_hand.*up to 0\.5\d m at frame 100", False),
    "treadmill": (lambda: record(WALK, on_belt(WALK)), "walks on a treadmill.*1.20 m/s", False),
}  # fmt: skip
RIGHT = {
    "walk": lambda: record(WALK),
    "run": lambda: record(RUN),
    "dog": lambda: record(DOG),
    "child": lambda: record(human_gait(speed_mps=0.7, height_m=0.9, duration_s=4.0, rate_hz=RATE_HZ)),
    "old and slow": lambda: record(human_gait(speed_mps=0.5, duration_s=6.0, rate_hz=RATE_HZ)),
    "legs": lambda: record_legs(1.0),
    "crawls": lambda: record(crawling_person(duration_s=5.0, rate_hz=RATE_HZ)),
    "slope": lambda: record(WALK, climb(WALK, 9.0)),  # 8 is unclear: the feet, to their tips, are 2.7 ahead of the body
    "down": lambda: record(WALK, climb(WALK, -10.0)),
    "rounded to 5 mm": lambda: record(WALK, (WALK.position_m / 0.005).round() * 0.005),
}


def find_messages(motion: Motion) -> tuple[list[str], Motion]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DoppelgaitWarning)
        checked = check_motion(clean_motion(motion))
    return [str(warning.message) for warning in caught], checked


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named_once(name: str) -> None:
    make, pattern, refuses = FAULTS[name]
    messages, checked = find_messages(make())
    assert len(messages) == 1
    assert re.search(pattern, messages[0])
    assert bool(checked.report["implausible"]) == refuses
    assert sum(note in messages[0] for note in checked.report["notes"]) == 1


@pytest.mark.parametrize("name", RIGHT)
def test_a_body_that_moves_as_bodies_do_is_not_flagged(name: str) -> None:
    messages, checked = find_messages(RIGHT[name]())
    assert messages == checked.report["implausible"] == []


@pytest.mark.parametrize("position", [tilt(WALK, 0, 12.0), tilt(WALK, 1, 15.0), climb(WALK, 9.0)])
def test_stature_is_measured_over_the_feet(position: np.ndarray) -> None:
    other, level = (find_messages(record(WALK, values))[1] for values in (position, WALK.position_m))
    assert other.facts.height_m == pytest.approx(level.facts.height_m, rel=0.01)
    assert any("slope" in note for note in other.report["notes"]) == (other.report["floor"] == "slope")


def walk_at(rate_hz: float) -> Motion:
    walk = human_gait(speed_mps=1.3, duration_s=4.0, rate_hz=4 * rate_hz)
    return make_motion(walk.position_m[::4], rate_hz=rate_hz, markers=walk.markers, parts=walk.parts)


@pytest.mark.parametrize(("rate_hz", "noise_m"), [(25.0, 0.01), (100.0, 0.02)])
def test_noise_is_measured_and_smoothed_at_any_rate(rate_hz: float, noise_m: float) -> None:
    walk = walk_at(rate_hz)
    noisy = shake(walk, noise_m)
    assert measure_noise(noisy, rate_hz=rate_hz) == pytest.approx(noise_m, rel=0.1)
    smooth = clean_motion(record(walk, noisy), floor=False)
    kept = [walk.markers.index(name) for name in smooth.markers]
    assert len(kept) == len(walk.markers)
    error = np.gradient(smooth.position_m - walk.position_m, 1.0 / rate_hz, axis=0)[5:-5]
    trunk = [n for n, part in enumerate(walk.parts) if part == "torso"]
    assert error[:, trunk].std() < 0.15
    assert error.std() < min(0.2, np.gradient(noisy - walk.position_m, 1.0 / rate_hz, axis=0).std())


@pytest.mark.parametrize("neighbours", [3, 2])
def test_a_marker_lost_for_half_a_second_is_filled_from_its_segment(neighbours: int) -> None:
    # a box that turns and swings as a thigh does; its fourth corner is lost
    time_s = np.arange(0.0, 4.0, 0.01)
    angle = 0.5 * np.sin(2 * np.pi * 0.9 * time_s)
    swing = Rotation.from_rotvec(np.outer(angle, [0.0, -1.0, 0.0])).as_matrix()
    corners = np.array([[0.0, 0.0, -0.3], [0.05, 0.0, -0.1], [0.0, 0.08, -0.2], [0.06, 0.06, -0.25]])[3 - neighbours :]
    truth = np.einsum("tij,pj->tpi", swing, corners) + 1.3 * time_s[:, None, None] * [1.0, 0.0, 0.0]
    truth += np.random.default_rng(2).normal(0.0, 1e-3, truth.shape)
    seen = truth.copy()
    seen[150:200, -1] = np.nan
    filled, count = fill_from_segment(seen, gap_limit=25)
    spline, _ = fill_gaps(seen, gap_limit=100)
    error_m, spline_m = (np.linalg.norm(values - truth, axis=2)[150:200, -1].max() for values in (filled, spline))
    assert count == 50
    assert error_m < (0.01 if neighbours == 3 else 0.02) < spline_m


def test_the_belt_gives_the_speed_back() -> None:
    moved = move_over_ground(clean_motion(record(WALK, on_belt(WALK))))
    travel = (moved.position_m[-1] - moved.position_m[0]).mean(axis=0)
    assert travel[0] / moved.duration_s == pytest.approx(1.2, rel=0.03)
    assert moved.report["belt_speed_mps"] == pytest.approx(1.2, rel=0.03)
    assert not any("treadmill" in note for note in check_motion(moved).report["notes"])


def test_a_walk_over_ground_and_a_standing_body_have_no_belt() -> None:
    still = WALK.with_positions(np.repeat(WALK.position_m[:1], WALK.n_frames, axis=0))
    for motion in (WALK, still):
        assert belt_velocity_mps(motion.position_m, motion.parts, rate_hz=motion.rate_hz) is None
    with pytest.raises(MotionError, match="no treadmill belt"):
        move_over_ground(WALK)


def circle_walk(*, turns: float) -> Motion:
    """Return a walk bent to a circle; over whole turns its ends face all ways."""
    walk = human_gait(speed_mps=1.2, height_m=1.75, duration_s=8.0, rate_hz=60)
    x, y, z = np.moveaxis(walk.position_m, -1, 0)
    radius_m = 1.2 * 8.0 / (2 * np.pi * turns)
    across, along = (radius_m - y) * [np.sin(x / radius_m), np.cos(x / radius_m)]
    return walk.with_positions(np.stack([across, radius_m - along, z], axis=-1))


def side_notes(motion: Motion) -> list[str]:
    return [note for note in clean_motion(motion).report["notes"] if "side" in note]


@pytest.mark.parametrize("turns", [0.6, 0.9])
def test_sides_are_judged_along_the_path(turns: float) -> None:
    motion = circle_walk(turns=turns)
    assert side_notes(motion) == []
    mirrored = motion.with_positions(motion.position_m * [1.0, -1.0, 1.0])
    assert ["left parts are on the right side" in note for note in side_notes(mirrored)] == [True]


def test_one_exchanged_pair_of_feet_is_noted_and_warned_of() -> None:
    walk = human_gait(speed_mps=1.2, height_m=1.75, duration_s=4.0, rate_hz=60)
    swap = {"left_foot": "right_foot", "right_foot": "left_foot"}
    exchanged = walk.with_points(walk.position_m, walk.markers, [swap.get(part, part) for part in walk.parts])
    with pytest.warns(DoppelgaitWarning, match="left_foot and right_foot are on each other's side"):
        assert len(side_notes(exchanged)) == 1
