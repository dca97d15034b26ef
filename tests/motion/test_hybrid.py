"""Hybrids of clips: against the laws they state, against models of the wanted phase, and what is refused."""

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from doppelgait.core.config import validate
from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.motion import Motion, blend, hybrid, retarget
from doppelgait.motion.loop import fit_cycle, loop
from doppelgait.motion.models import boulic_walk, human_gait
from doppelgait.motion.retime import travel_speed_mps
from doppelgait.motion.skeleton import find_rigid_pairs, restore_lengths
from recorded import read_quietly


def _walk(**options: Any) -> Motion:
    return human_gait(**{"speed_mps": 1.2, "duration_s": 4.0, **options})


def _lengths(motion: Motion, pairs: np.ndarray) -> np.ndarray:
    return np.linalg.norm(motion.position_m[:, pairs[:, 0]] - motion.position_m[:, pairs[:, 1]], axis=2)


@pytest.mark.parametrize(
    ("speed", "size", "stride"),
    [(1.0, 1.0, 1.0), (1.15, 1.0, 1.0), (0.85, 1.0, 1.0), (1.0, 1.2, 1.0), (1.0, 1.0, 1.08), (1.1, 0.85, 0.95)],
)
def test_speed_stride_and_size_follow_the_law(speed: float, size: float, stride: float) -> None:
    walk = _walk()
    made = retarget(walk, speed_factor=speed, size_factor=size, stride_factor=stride)
    speed_mps, before_mps = travel_speed_mps(made), travel_speed_mps(walk)
    assert speed_mps == pytest.approx(before_mps * speed * math.sqrt(size), rel=2e-3)
    before_m = before_mps / walk.facts.stride_frequency_hz
    assert speed_mps / made.facts.stride_frequency_hz == pytest.approx(before_m * size * speed**0.63 * stride, rel=2e-3)
    # measured again, not only stated
    measured = retarget(made.with_facts(stride_frequency_hz=math.nan, footfalls={}))
    assert measured.facts.stride_frequency_hz == pytest.approx(made.facts.stride_frequency_hz, rel=5e-3)
    assert made.facts.height_m == pytest.approx(size * walk.facts.height_m)
    assert made.facts.mass_kg == pytest.approx(size**3 * walk.facts.mass_kg)
    pairs = find_rigid_pairs(walk.position_m)
    np.testing.assert_allclose(_lengths(made, pairs), size * _lengths(walk, pairs), atol=1e-3)
    assert hybrid.measure_foot_slide(made) < hybrid.measure_foot_slide(walk) + 0.01
    assert made.report["hybrid"]["speed_factor"] == speed
    slower = walk.facts.stride_frequency_hz / made.facts.stride_frequency_hz
    touch_s = np.array(walk.facts.footfalls["left_foot"]) * slower
    np.testing.assert_allclose(made.facts.footfalls["left_foot"], touch_s)
    if speed == size == stride:
        np.testing.assert_allclose(made.position_m, walk.position_m, atol=1e-12)


def test_blend_of_one_walk_in_two_phases_is_the_walk() -> None:
    first, second = (boulic_walk(speed_mps=1.2, duration_s=4.0, start_phase=phase) for phase in (0.0, 0.37))
    mixed = blend(first, second.with_positions(second.position_m + np.array([3.0, -2.0, 0.0])), share=0.5)
    assert mixed.report["hybrid"]["likeness"] > 0.999
    start = mixed.position_m[0].mean(axis=0) - loop(first, duration_s=1.0, variation=0.0).position_m[0].mean(axis=0)
    whole = loop(first, duration_s=mixed.duration_s, variation=0.0).position_m[: mixed.n_frames]
    np.testing.assert_allclose(mixed.position_m - start, whole, atol=5e-3)
    assert mixed.facts.stride_frequency_hz == pytest.approx(first.facts.stride_frequency_hz, rel=1e-4)


def test_a_blend_lies_between_its_clips() -> None:
    slow, fast = _walk(speed_mps=1.1), _walk(speed_mps=1.35, height_m=1.85)
    ends = [loop(clip, duration_s=4.0, variation=0.0) for clip in (slow, fast)]
    hz = []
    for share in (0.0, 0.3, 1.0):
        mixed = blend(slow, fast, share=share)
        hz.append(mixed.facts.stride_frequency_hz)
        assert mixed.report["hybrid"]["length_error_m"] < 1e-3
        assert hybrid.measure_foot_slide(mixed) < max(map(hybrid.measure_foot_slide, ends)) + 0.02
        # as tall as the first: the second is scaled to it
        assert mixed.facts.height_m == pytest.approx(slow.facts.height_m, rel=0.02)
    slower = math.sqrt(slow.facts.height_m / fast.facts.height_m)
    assert hz[0] == pytest.approx(slow.facts.stride_frequency_hz, rel=1e-3)
    assert hz[2] == pytest.approx(fast.facts.stride_frequency_hz / slower, rel=5e-3)
    assert 1 / hz[1] == pytest.approx(0.7 / hz[0] + 0.3 / hz[2], rel=1e-3)


def test_a_blend_names_both_and_keeps_both_licences() -> None:
    clips = [
        _walk(speed_mps=1.1 + 0.1 * n).with_facts(source=f"{n}.c3d", subject=f"p{n}", licence=licence)
        for n, licence in enumerate(("MIT", "CC-BY-4.0"))
    ]
    facts = blend(*clips, share=0.5).facts
    assert (facts.source, facts.subject, facts.licence) == ("0.c3d + 1.c3d", "p0 + p1", "MIT AND CC-BY-4.0")
    # unknown where one of them is
    assert blend(clips[0], clips[1].with_facts(licence=""), share=0.5).facts.licence == ""


def test_points_are_matched_by_name() -> None:
    first, second = _walk(speed_mps=1.1), _walk(speed_mps=1.25)
    order = np.random.default_rng(2).permutation(len(second.markers))
    mixed_up = second.with_points(
        second.position_m[:, order], [f"ann:{second.markers[n]}" for n in order], [second.parts[n] for n in order]
    )
    expected, found = blend(first, second, share=0.4), blend(first, mixed_up, share=0.4)
    assert found.markers == first.markers
    np.testing.assert_allclose(found.position_m, expected.position_m, atol=1e-6)


def test_limits_are_those_of_recordings_and_hold_the_clip() -> None:
    brisk = _walk(speed_mps=1.6)
    now, (low, high) = hybrid.compute_dimensionless_speed(brisk), hybrid.find_speed_limits(brisk)
    assert now == pytest.approx(1.6 / math.sqrt(9.81 * 0.491 * brisk.facts.height_m), rel=0.02)
    assert low == pytest.approx(0.8)
    assert high == pytest.approx(hybrid.WALK.speed[1] / now)
    # a clip that is faster than all of them may be slowed down only
    assert hybrid.find_speed_limits(_walk(speed_mps=2.0))[1] == 1.0
    assert hybrid.find_speed_limits(brisk.with_facts(height_m=math.nan)) == (0.8, 1.25)
    assert hybrid.find_stride_limits(hybrid.RUN)[1] == pytest.approx(math.exp(hybrid.RUN.spread))


def test_restored_lengths_need_the_least_moves() -> None:
    position, pairs = (
        np.random.default_rng(4).normal(size=(1, 4, 3)),
        np.array([[0, 1], [1, 2], [2, 3]], dtype=np.int32),
    )

    def lengths(points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(np.diff(points.reshape(4, 3), axis=0), axis=1)

    wanted, weights = 1.02 * lengths(position), np.array([100.0, 1.0, 1.0, 1.0])
    found = restore_lengths(position, pairs, wanted[None], weights, ridge=0.01, steps=8)
    np.testing.assert_allclose(lengths(found), wanted, atol=1e-4)

    def moves(x: np.ndarray) -> float:
        return float((weights[:, None] * (x.reshape(4, 3) - position[0]) ** 2).sum())

    same = {"type": "eq", "fun": lambda x: lengths(x) - wanted}
    best = minimize(moves, position.ravel(), constraints=same, method="SLSQP", options={"ftol": 1e-14, "maxiter": 500})
    assert moves(found) == pytest.approx(best.fun, rel=0.02)
    assert np.linalg.norm(found[0, 0] - position[0, 0]) < 0.1 * np.linalg.norm(found[0, 1] - position[0, 1])


def test_a_body_without_feet_is_made_with_a_note() -> None:
    walk = _walk()
    assert "note" not in retarget(walk, speed_factor=1.05).report["hybrid"]
    chosen = [n for n, part in enumerate(walk.parts) if not part.endswith("foot")]
    position, names = walk.position_m[:, chosen], [walk.markers[n] for n in chosen]
    footless = walk.with_points(position, names, [walk.parts[n] for n in chosen])
    # the lowest point that is left is a knee in the middle of the body
    level = footless.position_m.copy()
    level[:, 0, 2] = -1.0
    made = retarget(footless.with_positions(level), speed_factor=1.05).report["hybrid"]
    assert math.isnan(made["foot_slide"])
    assert "whether feet slide was not checked" in made["note"]


def test_the_cycle_of_a_clip_is_fitted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    searched: list[Motion] = []
    search = fit_cycle.__globals__["_find_best_seam"]
    monkeypatch.setitem(
        fit_cycle.__globals__, "_find_best_seam", lambda motion, *rest: searched.append(motion) or search(motion, *rest)
    )
    clips = [_walk(speed_mps=1.1), _walk(speed_mps=1.3)]
    before = blend(*clips, share=0.3).position_m
    for clip in clips:
        clip.position_m.setflags(write=False)
    del searched[:]
    for share in (0.3, 0.3, 0.4):
        np.testing.assert_array_equal(blend(*clips, share=0.3).position_m, before)
        blend(*clips, share=share)
    assert len(searched) == 2


def test_the_table_of_a_scene_is_made() -> None:
    clips = {"b.c3d": _walk(speed_mps=1.3)}
    table = {"speed_factor": 1.1, "other": {"kind": "file", "path": "b.c3d"}, "share": 0.25}
    made = hybrid.make_hybrid(
        _walk(), validate(hybrid.Hybrid, table, where="hybrid"), lambda other: clips[other["path"]]
    )
    expected = retarget(blend(_walk(), clips["b.c3d"], share=0.25), speed_factor=1.1)
    np.testing.assert_array_equal(made.position_m, expected.position_m)
    assert (made.report["hybrid"]["share"], made.report["hybrid"]["speed_factor"]) == (0.25, 1.1)


PAIRS = [
    ("clinic/SubjectB4_Cycle1.bvh", "clinic/SubjectC9_Cycle1.bvh"),
    ("human/amc/cmu_07_01.amc", "human/amc/cmu_02_02.amc"),
    ("human/c3d/cmu_07_01.c3d", "human/c3d/cmu_07_12.c3d"),
    ("dog/mann-bvh/D1_053_KAN01_001.bvh", "dog/mann-bvh/D1_ex01_KAN01_001.bvh"),
]


@pytest.mark.shared
@pytest.mark.parametrize("files", PAIRS)
def test_two_recordings_make_a_target_between_them_that_does_not_slide(shared: Path, files: tuple[str, str]) -> None:
    clips = [read_quietly(shared / "data" / "mocap" / file, segment="longest") for file in files]
    speeds, slide = [travel_speed_mps(clip) for clip in clips], max(map(hybrid.measure_foot_slide, clips))
    mixed = blend(*clips, share=0.5)
    assert mixed.report["hybrid"]["length_error_m"] < 2e-3
    assert hybrid.measure_foot_slide(mixed) < slide + 0.01
    assert 0.95 * min(speeds) < travel_speed_mps(mixed) < 1.1 * max(speeds)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)
        assert hybrid.measure_foot_slide(loop(mixed, duration_s=6.0)) < slide + 0.03
    wanted = min(1.1, hybrid.find_speed_limits(clips[0])[1])
    made = retarget(clips[0], speed_factor=wanted, size_factor=1.05)
    assert travel_speed_mps(made) == pytest.approx(speeds[0] * wanted * np.sqrt(1.05), rel=5e-3)
    assert hybrid.measure_foot_slide(made) < hybrid.measure_foot_slide(clips[0]) + 0.01
