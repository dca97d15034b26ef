"""Merging of points closer than a fraction of the wavelength (E-08)."""

import numpy as np
import pytest

from doppelgait.core.errors import ConfigError
from doppelgait.motion import make_motion
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.scene import RcsSpec, Scene, Target, assemble
from doppelgait.scene.scatterers import close_groups, median_distances_m, merge_close

RATE_HZ = 50.0


def cloud(places_m, parts=None, moving=True):
    """Points that stay together while they go along x."""
    t = np.arange(0, 1.01, 1 / RATE_HZ)
    start = np.asarray(places_m, dtype=float)[None]
    position = start + (np.array([1.0, 0.2, 0.0]) * t[:, None, None] if moving else 0 * t[:, None, None])
    names = [f"m{n}" for n in range(start.shape[1])]
    return make_motion(position, rate_hz=RATE_HZ, markers=names, parts=parts or ["torso"] * len(names))


CLOSE = [[0, 0, 1], [0.5, 0, 1], [0.006, 0, 1], [0.003, 0.002, 1], [0.5, 0.011, 1]]


def test_close_points_become_one_at_their_mean_with_their_sum():
    motion = cloud(CLOSE, parts=["torso", "head", "head", "torso", "head"])
    merged, rcs = merge_close(motion, [0.1, 0.2, 0.3, 0.05, 0.4], closer_than_m=0.0103)
    assert merged.markers == ["m0+m2+m3", "m1", "m4"]
    assert merged.parts == ["head", "head", "head"]  # of the strongest
    np.testing.assert_allclose(rcs, [0.45, 0.2, 0.4])
    np.testing.assert_allclose(merged.position_m[:, 0], motion.position_m[:, [0, 2, 3]].mean(axis=1), atol=1e-15)
    np.testing.assert_array_equal(merged.position_m[:, 1:], motion.position_m[:, [1, 4]])
    assert merged.report["merged"] == [["m0", "m2", "m3"]]
    assert "merged" not in motion.report


def test_a_chain_is_not_drawn_together():
    """Complete linkage: what is merged is closer than the limit, every pair."""
    motion = cloud([[0.008 * n, 0, 1] for n in range(10)])
    groups = close_groups(motion, 0.0103)
    distance = median_distances_m(motion)
    assert all(distance[a, b] < 0.0103 for group in groups for a in group for b in group)
    assert max(len(group) for group in groups) == 2
    assert sorted(n for group in groups for n in group) == list(range(10))


def test_the_median_over_time_decides():
    t = np.arange(0, 1.01, 1 / RATE_HZ)
    for apart_share, n_scatterers in ((0.3, 1), (0.7, 2)):
        position = np.zeros((t.size, 2, 3))
        position[:, 1, 0] = np.where(t < apart_share, 0.3, 0.005)
        motion = make_motion(position, rate_hz=RATE_HZ, markers=["a", "b"], parts=["", ""])
        assert merge_close(motion, [1.0, 1.0], closer_than_m=0.01)[1].size == n_scatterers


def test_the_limit_itself_is_not_below_the_limit():
    motion = cloud([[0, 0, 0], [0.25, 0, 0]], moving=False)
    assert len(close_groups(motion, 0.25)) == 2
    assert len(close_groups(motion, 0.2500001)) == 1
    assert close_groups(cloud([[0, 0, 0]]), 0.25) == [[0]]


def test_distances_against_every_pair_of_a_walk():
    walk = boulic_walk(duration_s=0.5)
    found = median_distances_m(walk)
    frames = walk.position_m
    wanted = np.median(np.linalg.norm(frames[:, :, None] - frames[:, None], axis=-1), axis=0)
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_in_a_scene_the_total_stays_and_what_is_close_adds_once():
    motion = cloud(CLOSE)
    apart = assemble(Scene([Target(motion)]), [0.0, 0.5])
    merged = assemble(Scene([Target(motion, rcs=RcsSpec(merge_closer_than_m=0.0103))]), [0.0, 0.5])
    assert (apart.sizes["scatterer"], merged.sizes["scatterer"]) == (5, 3)
    np.testing.assert_allclose(merged["rcs"].values.sum(axis=1), apart["rcs"].values.sum(axis=1), rtol=1e-12)
    same = assemble(Scene([Target(motion, rcs=RcsSpec(merge_closer_than_m=1e-4))]), [0.0, 0.5])
    np.testing.assert_array_equal(same["range"].values, apart["range"].values)
    for wrong in (0.0, -0.01, 2.0):
        with pytest.raises(ConfigError, match="merge_closer_than_m"):
            Target(motion, rcs={"merge_closer_than_m": wrong})
