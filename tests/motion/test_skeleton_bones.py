"""Bones from the motion of points alone, and checks of hybrids: lengths, and feet that rest, slide or are unknown."""

import math

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.core.errors import MotionError
from doppelgait.motion import Motion, make_motion
from doppelgait.motion.hybrid import check_hybrid, measure_foot_slide
from doppelgait.motion.models import human_gait
from doppelgait.motion.skeleton import find_bones, measure_pair_lengths


def test_foot_slide_of_a_known_slide() -> None:
    """One foot rests for half of each second and slides forward at a tenth of the body's 1 m/s while it does."""
    time_s = np.arange(0.0, 6.0, 0.005)
    speeds = [np.where((time_s + shift) % 1.0 < 0.5, 0.1, 1.9) for shift in (0.0, 0.5)]
    feet = [np.cumsum(speed) * 0.005 for speed in speeds]
    x = np.stack([time_s, *feet], axis=1)
    position = np.stack([x, np.broadcast_to([0.0, 0.1, -0.1], x.shape), np.broadcast_to([1.0, 0.0, 0.0], x.shape)], 2)
    walk = make_motion(
        position, rate_hz=200, markers=["c7", "l", "r"], parts=["torso", "left_foot", "right_foot"], facts={}
    )
    assert measure_foot_slide(walk) == pytest.approx(0.1, rel=0.02)


def _checked_pairs(lengths_m: list[float], wanted_m: list[float]) -> Motion:
    """Check bars at rest on top of each other."""
    ends = np.concatenate([[[0.0, n, 1.0], [length, n, 1.0]] for n, length in enumerate(lengths_m)])
    still = make_motion(
        np.repeat(ends[np.newaxis], 20, axis=0),
        rate_hz=20.0,
        markers=[f"m{n}" for n in range(len(ends))],
        parts=[""] * len(ends),
    )
    pairs = np.arange(len(ends), dtype=np.int32).reshape(-1, 2)
    wanted = np.repeat([wanted_m], 20, axis=0)
    return check_hybrid(still, [still], pairs, wanted, still.position_m, {})


def test_the_length_that_is_furthest_beyond_its_own_limit_counts() -> None:
    """0.9 mm of 50 mm is allowed (1 mm), 5.5 mm of 1 m is not (5 mm)."""
    assert _checked_pairs([0.0509, 1.0045], [0.05, 1.0]).report["hybrid"]["length_error_m"] == pytest.approx(4.5e-3)
    with pytest.raises(MotionError, match=r"m2 and m3 would be 5\.5 mm nearer or further"):
        _checked_pairs([0.0509, 1.0055], [0.05, 1.0])


def test_feet_that_no_longer_rest_are_refused() -> None:
    walk = human_gait(speed_mps=1.2, duration_s=4.0)
    feet = [n for n, part in enumerate(walk.parts) if part.endswith("foot")]
    position = walk.position_m.copy()
    position[:, feet] = position[:, :1] + np.array([0.0, 0.1, -0.8])
    glides, pairs = walk.with_positions(position), np.array([[0, 1]], dtype=np.int32)
    assert math.isnan(measure_foot_slide(glides))
    with pytest.raises(MotionError, match="no foot would rest on the ground"):
        check_hybrid(glides, [walk], pairs, measure_pair_lengths(position, pairs), position, {})


def test_the_bones_of_the_walking_model_are_those_of_its_skeleton() -> None:
    walk = dg.motion.boulic_walk(speed_mps=1.2, height_m=1.75, duration_s=3.0)
    names = [str(name) for name in walk.positions.coords["marker"].values]
    found = {frozenset((names[a], names[b])) for a, b in find_bones(walk.position_m)}
    assert len(found) == len(names) - 1
    legs_and_arms = [
        frozenset((f"{side}_{one}", f"{side}_{two}"))
        for side in ("left", "right")
        for one, two in (("hip", "knee"), ("knee", "ankle"), ("ankle", "toe"), ("shoulder", "elbow"), ("elbow", "hand"))
    ]
    assert all(bone in found for bone in legs_and_arms), (found, names)


def test_a_hand_that_passes_the_thigh_is_not_joined_to_it() -> None:
    time_s = np.linspace(0.0, 2.0, 100)
    swing = 0.6 * np.sin(2 * np.pi * time_s)
    hip, shoulder = np.array([0.0, 0.0, 0.9]), np.array([0.0, 0.0, 1.45])
    hand = shoulder + 0.56 * np.stack([np.sin(swing), 0 * swing, -np.cos(swing)], axis=1)
    points = np.stack([np.tile(hip, (100, 1)), np.tile(shoulder, (100, 1)), hand], axis=1)
    assert np.linalg.norm(points[:, 2] - points[:, 0], axis=1).min() < 0.02
    assert find_bones(points).tolist() == [[0, 1], [1, 2]]


def test_points_that_are_never_seen_get_no_bone_and_gaps_do_no_harm() -> None:
    walk = dg.motion.boulic_walk(speed_mps=1.2, height_m=1.75, duration_s=3.0).position_m.copy()
    whole = find_bones(walk)
    walk[100:200, 3] = np.nan
    assert find_bones(walk).tolist() == whole.tolist()
    walk[:, 3] = np.nan
    assert 3 not in find_bones(walk)
    assert len(find_bones(walk)) == len(whole) - 1


def test_one_point_has_no_bone() -> None:
    assert find_bones(np.zeros((10, 1, 3))).shape == (0, 2)
