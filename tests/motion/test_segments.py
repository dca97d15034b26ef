"""Straight stretches at constant velocity, in paths made in the test."""

import csv
import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from typer.testing import CliRunner

from doppelgait.cli.app import app
from doppelgait.core.errors import MotionError
from doppelgait.motion import Motion, make_motion
from doppelgait.motion.gait import smooth_path
from doppelgait.motion.models import boulic_walk, quadruped_gait
from doppelgait.motion.readers import bvh, read  # noqa: F401  (BVH registers itself)
from doppelgait.motion.segments import PERSON, QUADRUPED, Segment, SegmentLimits, crop, find_segments
from recorded import read_quietly

RATE_HZ = 100.0


def moving_along(path_m: npt.ArrayLike, *, rate_hz: float = RATE_HZ, species: str = "human") -> Motion:
    """A rigid body of four points that follows a ground path (T, 2)."""
    path = np.asarray(path_m, dtype=float)
    body = np.array([[0.0, 0.2, 0.5], [0.0, -0.2, 0.5], [0.1, 0.0, 1.0], [-0.1, 0.0, 1.6]])
    points = np.concatenate([path, np.zeros((len(path), 1))], axis=1)[:, None] + body
    facts = {"species": species}
    return make_motion(points, rate_hz=rate_hz, markers=list("abcd"), parts=["torso"] * 4, facts=facts)


def legs(*parts: tuple[float, float, float], rate_hz: float = RATE_HZ) -> npt.NDArray[np.float64]:
    """Path of legs of (duration in s, speed in m/s, heading in degrees)."""
    steps = [
        np.tile(speed / rate_hz * np.array([np.cos(np.radians(deg)), np.sin(np.radians(deg))]), (round(s * rate_hz), 1))
        for s, speed, deg in parts
    ]
    return np.concatenate([np.zeros((1, 2)), np.cumsum(np.concatenate(steps), axis=0)])


def test_straight_walk_is_one_segment() -> None:
    (segment,) = find_segments(moving_along(legs((4.0, 1.3, 30.0))))
    assert (segment.start_s, segment.stop_s) == (0.0, pytest.approx(4.0))
    assert segment.mean_speed_mps == pytest.approx(1.3)
    assert segment.heading_deg == pytest.approx(30.0)
    assert segment.straightness == pytest.approx(1.0)
    assert segment.lateral_m == pytest.approx(0.0, abs=1e-9)
    assert segment.speed_deviation == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("path", "why"),
    [
        (legs((10, 0.0, 0)), "stands"),
        (legs((10, 0.35, 0)), "too slow"),
        (legs((0.9, 2.0, 0)), "too brief"),
        (0.5 * np.stack([np.cos(np.linspace(0, 25, 1000)), np.sin(np.linspace(0, 25, 1000))], axis=1), "circles"),
        (np.zeros((2, 2)), "two frames"),
    ],
)
def test_no_segment(path: npt.NDArray[np.float64], why: str) -> None:
    assert find_segments(moving_along(path)) == [], why


def test_quadrupeds_have_their_own_limits() -> None:
    path = legs((0.9, 1.0, 0))
    assert find_segments(moving_along(path)) == []
    assert len(find_segments(moving_along(path, species="dog"))) == 1
    assert len(find_segments(moving_along(path), limits=QUADRUPED)) == 1


def _by_brute_force(motion: Motion, limits: SegmentLimits) -> list[tuple[int, int]]:
    """The definition, word by word: all pairs of ends, all samples between them, longest first."""
    rate = motion.rate_hz
    path = smooth_path(motion.position_m, rate_hz=rate, smoothing_s=limits.smoothing_s)
    speed = np.linalg.norm(np.gradient(path, 1 / rate, axis=0), axis=1)
    step = round(0.05 * rate)
    path, speed = path[::step], speed[::step]
    allowed = []
    for a in range(len(path)):
        for b in range(a + 2, len(path)):
            chord, part = path[b] - path[a], speed[a : b + 1]
            length, lasts_s = np.hypot(*chord), (b - a) * 0.05
            if lasts_s < limits.min_duration_s - 1e-9 or length < max(
                limits.min_length_m, limits.min_speed_mps * lasts_s
            ):
                continue
            offset = path[a : b + 1] - path[a]
            away = np.abs(offset[:, 0] * chord[1] - offset[:, 1] * chord[0]) / length
            if away.max() <= limits.lateral_m and np.abs(part / part.mean() - 1).max() <= limits.speed_deviation:
                allowed.append((a, b))
    chosen: list[tuple[int, int]] = []
    for a, b in sorted(allowed, key=lambda ends: (ends[0] - ends[1], ends[0])):
        if all(b < c or a > d for c, d in chosen):
            chosen.append((a, b))
    return sorted(chosen)


@pytest.mark.parametrize("turn", [0.0, np.pi])  # the second one crosses from pi to -pi
@pytest.mark.parametrize("seed", range(3))
def test_search_agrees_with_brute_force(seed: int, turn: float) -> None:
    rng = np.random.default_rng(seed)
    heading = np.cumsum(np.repeat(rng.normal(0, 0.4, 9), 20)) * 0.05 + rng.normal(0, 0.3) + turn
    speed = np.clip(np.interp(np.arange(180), np.arange(0, 180, 30), rng.uniform(0.0, 2.0, 6)), 0, None)
    path = np.cumsum(speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1) / 20, axis=0)
    motion = moving_along(path, rate_hz=20.0)
    found = [(round(s.start_s * 20), round(s.stop_s * 20)) for s in find_segments(motion)]
    assert found == _by_brute_force(motion, PERSON)


def test_gait_of_each_segment() -> None:
    (person,) = find_segments(boulic_walk(speed_mps=1.4, duration_s=4.0))
    assert person.gait.gait == "walk"
    assert person.gait.stride_frequency_hz == pytest.approx(0.949, rel=0.005)  # 1 / 1.054 s of the model's equation
    dog_motion = quadruped_gait(gait="gallop", duration_s=4.0)
    (dog,) = find_segments(dog_motion)
    assert dog.gait.gait == "gallop"
    paw_m = dog_motion.position_m[:, dog_motion.markers.index("left_hind_paw"), 0]
    stride_m = np.diff(np.interp(dog_motion.facts.footfalls["left_hind"], dog_motion.time_s, paw_m)).mean()
    assert dog.mean_speed_mps == pytest.approx(dog_motion.facts.stride_frequency_hz * stride_m, rel=0.02)


def test_crop_gives_a_motion_of_its_own() -> None:
    walk = boulic_walk(speed_mps=1.4, duration_s=6.0)
    footfalls = {foot: [10.0 + t for t in times] for foot, times in walk.facts.footfalls.items()}
    motion = make_motion(
        np.concatenate([walk.position_m, np.repeat(walk.position_m[-1:], 500, axis=0)]),
        rate_hz=250.0,
        markers=walk.markers,
        parts=walk.parts,
        facts=replace(walk.facts, footfalls=footfalls),
        start_s=10.0,
    )
    (segment,) = find_segments(motion)
    part = crop(motion, segment)
    assert (part.time_s[0], part.report["segment_from_s"]) == (0.0, segment.start_s)
    assert part.time_s[-1] == pytest.approx(segment.duration_s)
    first = round((segment.start_s - 10.0) * 250)
    np.testing.assert_array_equal(part.position_m, motion.position_m[first : first + part.n_frames])
    kept = [t - segment.start_s for t in footfalls["left_foot"] if segment.start_s <= t <= segment.stop_s]
    np.testing.assert_allclose(part.facts.footfalls["left_foot"], kept, atol=1e-9)
    with pytest.raises(MotionError, match="not in this motion"):
        crop(part, segment)


def _overlap(row: dict[str, str], segment: Segment) -> float:
    start, stop = (float(row[key]) / float(row["frame_rate_hz"]) for key in ("start_frame", "end_frame"))
    both = min(stop, segment.stop_s) - max(start, segment.start_s)
    return max(0.0, both) / (max(stop, segment.stop_s) - min(start, segment.start_s))


@cache
def _pairs(shared: Path, kind: str) -> tuple[tuple[dict[str, str], Segment | None], ...]:
    """Rows of the table and the segment that overlaps each most, None when none does by more than half."""
    with (shared / "data" / "mocap" / "segments.csv").open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["class"] == kind and row["file"].endswith((".c3d", ".bvh"))]
    found: dict[str, list[Segment]] = {}
    for name in {row["file"] for row in rows}:
        motion = read_quietly(shared / "data" / "mocap" / name, clean=False)
        found[name] = find_segments(motion, limits=QUADRUPED if kind == "rat" else None)
    pairs = []
    for row in rows:
        best = max(found[row["file"]], key=lambda segment: _overlap(row, segment), default=None)
        pairs.append((row, best if best and _overlap(row, best) > 0.5 else None))
    return tuple(pairs)


def _found(shared: Path, kind: str) -> list[tuple[dict[str, str], Segment]]:
    """Rows whose segment was found; of dogs without those that jump or change their gait."""
    return [(row, segment) for row, segment in _pairs(shared, kind) if segment and not row["footfall_note"]]


@pytest.mark.shared
@pytest.mark.parametrize(("kind", "share"), [("human", 1.0), ("dog", 0.93), ("rat", 1.0)])
def test_segments_of_the_table_are_found(shared: Path, kind: str, share: float) -> None:
    pairs = _pairs(shared, kind)
    speeds = [segment.mean_speed_mps / float(row["speed_mps"]) - 1 for row, segment in pairs if segment]
    assert len(speeds) >= share * len(pairs) > 0
    # where two equally long stretches overlap, the other one may have been taken
    assert np.median(np.abs(speeds)) < 0.01
    assert np.percentile(np.abs(speeds), 90) < 0.05


@pytest.mark.shared
def test_people_walk_and_run_as_labelled(shared: Path) -> None:
    pairs = _found(shared, "human")
    named = [(row, segment.gait.gait) for row, segment in pairs if segment.gait.gait]
    assert len(named) >= 0.9 * len(pairs)
    differ = {row["file"] for row, gait in named if gait != row["action_label"].replace("jog", "run")}
    # its feet are never both off the ground: a walk by our definition and by its free fall
    assert differ <= {"human/bvh/bandai2_run_elderly_001.bvh"}


@pytest.mark.shared
def test_stride_frequencies_of_people(shared: Path) -> None:
    """The table gives spectral peaks, to about 0.1 Hz."""
    pairs = _found(shared, "human")
    differences = [segment.gait.stride_frequency_hz - float(row["stride_hz"]) for row, segment in pairs]
    assert np.isfinite(differences).all()
    assert np.median(np.abs(differences)) < 0.05
    assert np.mean(np.abs(differences) < 0.1) > 0.85


@pytest.mark.shared
def test_stride_frequencies_and_lags_of_dogs(shared: Path) -> None:
    """Against paw contacts found in other code."""
    pairs = _found(shared, "dog")
    ratios = [segment.gait.stride_frequency_hz / float(row["footfall_stride_hz"]) - 1 for row, segment in pairs]
    assert np.isfinite(ratios).mean() > 0.9
    assert np.nanmedian(np.abs(ratios)) < 0.025
    assert np.nanpercentile(np.abs(ratios), 90) < 0.10
    lags = []
    for row, segment in pairs:
        for name, lag in segment.gait.phases.items():
            if row[f"footfall_phase_{name}"]:
                wrong = lag - float(row[f"footfall_phase_{name}"])
                lags.append(abs((wrong + 0.5) % 1 - 0.5))
    assert len(lags) > 2.5 * len(pairs)
    assert np.median(lags) < 0.03
    assert np.percentile(lags, 90) < 0.09


@pytest.mark.shared
def test_gaits_of_dogs(shared: Path) -> None:
    """Symmetrical and asymmetrical gaits are never mixed up; pace, walk and trot differ only near their borders."""
    pairs = _found(shared, "dog")
    same = 0
    for row, segment in pairs:
        named, gait = row["gait"], segment.gait.gait
        fast = named == "canter/gallop/bound"
        if gait:
            assert (gait in ("canter", "gallop", "transverse_gallop", "bound")) == fast, row["file"]
        same += gait == named or (fast and gait != "")
    assert same > 0.7 * len(pairs)


@pytest.mark.shared
def test_motion_info_lists_segments(shared: Path) -> None:
    path = str(shared / "data" / "mocap" / "human" / "c3d" / "cmu_82_08.c3d")
    shown = CliRunner().invoke(app, ["motion", "info", path])
    (segment,) = json.loads(CliRunner().invoke(app, ["motion", "info", path, "--json"]).stdout)["segments"]
    # rows of the table: frames 1158 to 1596 at 120 Hz, 0.848 m/s, 0.75 Hz
    assert segment["start_s"] == pytest.approx(1158 / 120, abs=0.11)
    assert segment["stop_s"] == pytest.approx(1596 / 120, abs=0.11)
    assert segment["mean_speed_mps"] == pytest.approx(0.848, rel=0.02)
    assert segment["stride_frequency_hz"] == pytest.approx(0.75, rel=0.05)
    last = shown.stdout.strip().splitlines()[-1].split()
    assert last[:2] == ["1", f"{segment['start_s']:.6g}"]
    assert "walk" in last
