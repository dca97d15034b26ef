"""Bones to draw: found from the points' motion alone."""

import numpy as np

import doppelgait as dg
from doppelgait.motion.rigid import find_bones


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
