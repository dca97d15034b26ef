"""Looped clips: against the same model walking on, and for the absence of a seam."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from doppelgait.core.errors import MotionError
from doppelgait.motion import Motion
from doppelgait.motion.gait import measure_gait
from doppelgait.motion.loop import loop
from doppelgait.motion.models import boulic_walk, quadruped_gait
from doppelgait.motion.retime import resample

FRAME_S = 1 / 250


def _long_walk(clip: Motion, looped: Motion, start_phase: float, **options: float) -> Motion:
    """The model started in the phase of the loop's first frame, and put at its place."""
    phase = start_phase + looped.report["loop"]["from_s"] * clip.facts.stride_frequency_hz
    long = boulic_walk(duration_s=float(looped.time_s[-1]), start_phase=phase % 1, **options)
    return long.with_positions(long.position_m + (looped.position_m[0] - long.position_m[0]).mean(axis=0))


@pytest.mark.parametrize(
    ("speed_mps", "clip_s", "start_phase"), [(1.2, 3.0, 0.0), (1.2, 1.6, 0.3), (0.6, 4.0, 0.1), (2.4, 2.0, 0.7)]
)
def test_looped_walk_is_the_long_walk(speed_mps: float, clip_s: float, start_phase: float) -> None:
    clip = boulic_walk(speed_mps=speed_mps, duration_s=clip_s, start_phase=start_phase)
    looped = loop(clip, duration_s=20.0)
    long = _long_walk(clip, looped, start_phase, speed_mps=speed_mps)
    assert looped.positions.shape == long.positions.shape
    np.testing.assert_allclose(looped.position_m, long.position_m, atol=5e-4)  # m, after 20 s
    between = np.arange(0.1, 19.9, 0.0137)
    moved, expected = resample(looped, between), resample(long, between)
    np.testing.assert_allclose(moved[1], expected[1], atol=0.02)  # m/s, beside 9 m/s of the foot
    assert looped.facts.stride_frequency_hz == pytest.approx(clip.facts.stride_frequency_hz, rel=1e-5)
    for foot, times in looped.facts.footfalls.items():
        expected_times = [t for t in long.facts.footfalls[foot] if t < 19.9]
        np.testing.assert_allclose([t for t in times if t < 19.9], expected_times, atol=1e-3)


def _varied(gait: str, seed: int = 3) -> Motion:
    rng = np.random.default_rng(seed)
    return quadruped_gait(gait=gait, duration_s=4.0, stride_variation=0.04, rng=rng)


def _biggest_change(values: npt.NDArray[np.float64], order: int) -> float:
    return float(np.abs(np.diff(values, n=order, axis=0) / FRAME_S**order).max())


@pytest.mark.parametrize("gait", ["walk", "trot", "gallop"])
def test_uneven_strides_loop_without_a_seam(gait: str) -> None:
    clip = _varied(gait)
    looped = loop(clip, duration_s=15.0)
    # no jump in position or velocity: speed and acceleration stay those of the clip itself
    assert _biggest_change(looped.position_m, 1) < 1.15 * _biggest_change(clip.position_m, 1)
    assert _biggest_change(looped.position_m, 2) < 1.15 * _biggest_change(clip.position_m, 2)
    seam = looped.report["loop"]
    assert seam["seam_position_m"] <= seam["usual_position_m"]
    assert seam["seam_velocity_mps"] <= seam["usual_velocity_mps"]
    assert seam["usual_position_m"] > 1e-3


def test_every_cycle_is_the_same_and_advances_evenly() -> None:
    clip = _varied("trot")
    looped = loop(clip, duration_s=15.0)
    seam = looped.report["loop"]
    cycle_s = seam["to_s"] - seam["from_s"]
    assert looped.facts.stride_frequency_hz == pytest.approx(seam["strides"] / cycle_s, rel=1e-12)
    at = np.arange(0.5, 6.0, 0.05)
    first, again, third = (resample(looped, at + turn * cycle_s)[0] for turn in range(3))
    advance = (again - first).mean(axis=(0, 1))
    np.testing.assert_allclose(again - first, np.broadcast_to(advance, first.shape), atol=1e-4)
    np.testing.assert_allclose(third - again, again - first, atol=1e-4)
    assert abs(advance[2]) < 1e-6
    assert np.hypot(*advance[:2]) / cycle_s == pytest.approx(4.0, rel=0.6)


def test_a_velocity_jump_would_show() -> None:
    """The measure of the tests above sees a cut that is made without care."""
    clip = _varied("trot")
    part = clip.position_m[100:211]
    step = (part[-1] - part[0]).mean(axis=0) * np.array([1.0, 1.0, 0.0])
    careless = np.concatenate([part[:-1] + k * step for k in range(4)])
    assert _biggest_change(careless, 2) > 1.5 * _biggest_change(clip.position_m, 2)


def test_result_keeps_rate_parts_and_facts_and_measures_as_it_states() -> None:
    clip = boulic_walk(speed_mps=1.4, duration_s=2.5, rate_hz=120.0)
    nan = float("nan")
    bare = clip.with_facts(
        source="some walk", subject="A", gait="", footfalls={}, stride_frequency_hz=nan, step_frequency_hz=nan,
        gait_frequency_hz=nan,
    )  # fmt: skip
    looped = loop(bare, duration_s=12.0)
    assert looped.rate_hz == 120.0
    assert looped.time_s[-1] == pytest.approx(12.0)
    assert looped.parts == clip.parts
    assert (looped.facts.source, looped.facts.subject, looped.facts.gait) == ("some walk", "A", "walk")
    found = measure_gait(looped)
    assert looped.facts.stride_frequency_hz == pytest.approx(found.stride_frequency_hz, rel=2e-3)
    assert looped.facts.gait_frequency_hz == pytest.approx(2 * looped.facts.stride_frequency_hz, rel=1e-12)
    for foot, times in looped.facts.footfalls.items():
        gaps = np.diff(times)
        np.testing.assert_allclose(gaps, 1 / looped.facts.stride_frequency_hz, atol=1.5 / 120)
        assert len(times) >= len(found.footfalls[foot])
    assert bare.facts.footfalls == {}


def test_heading_does_not_matter() -> None:
    clip = _varied("walk")
    turn = np.array([[np.cos(1.0), np.sin(1.0), 0], [-np.sin(1.0), np.cos(1.0), 0], [0, 0, 1]])
    turned = loop(clip.with_positions(clip.position_m @ turn), duration_s=9.0)
    np.testing.assert_allclose(turned.position_m, loop(clip, duration_s=9.0).position_m @ turn, atol=1e-3)


@pytest.mark.parametrize(
    ("clip", "duration_s", "says"),
    [
        (boulic_walk(speed_mps=0.8, duration_s=1.0), 5.0, "a loop needs"),
        (boulic_walk(), 0.0, "duration_s"),
        (boulic_walk(), float("nan"), "duration_s"),
    ],
)
def test_what_cannot_be_looped_is_refused(clip: Motion, duration_s: float, says: str) -> None:
    with pytest.raises(MotionError, match=says):
        loop(clip, duration_s=duration_s)


def test_gaps_and_standing_bodies_are_refused() -> None:
    clip = boulic_walk()
    holed = clip.with_positions(
        np.where(np.arange(clip.positions.shape[0])[:, None, None] == 50, np.nan, clip.position_m)
    )
    with pytest.raises(MotionError, match="clean it first"):
        loop(holed, duration_s=5.0)
    nan = float("nan")
    still = clip.with_positions(np.broadcast_to(clip.position_m[:1], clip.positions.shape).copy()).with_facts(
        stride_frequency_hz=nan
    )
    with pytest.raises(MotionError, match="no gait cycle"):
        loop(still, duration_s=5.0)


@pytest.mark.parametrize("extra", [0.01, 0.05, 0.09, 0.21, 0.23, 0.25, 0.27, 0.3])
def test_the_shortest_clips_loop(extra: float) -> None:
    """Right at the limit nothing but a result or the stated refusal comes out."""
    stride_s = 1 / boulic_walk(speed_mps=1.2).facts.stride_frequency_hz
    clip = boulic_walk(speed_mps=1.2, duration_s=stride_s * (1.0 + extra), rate_hz=60.0)
    if extra > 0.2:
        assert loop(clip, duration_s=3.0).positions.sizes["time"] == 181
    elif extra < 0.1:
        with pytest.raises(MotionError, match="a loop needs"):
            loop(clip, duration_s=3.0)
