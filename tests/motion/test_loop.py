"""Looped clips: against the same model walking on, and for the absence of a seam."""

import numpy as np
import numpy.typing as npt
import pytest

from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.core.rng import Streams
from doppelgait.motion import Motion
from doppelgait.motion.gait import measure_gait
from doppelgait.motion.loop import loop
from doppelgait.motion.models import boulic_walk, quadruped_gait
from doppelgait.motion.models.curves import load_tables
from doppelgait.motion.models.human import human_gait
from doppelgait.motion.retime import body_centre_m, resample

FRAME_S = 1 / 250


few_strides = pytest.mark.filterwarnings("ignore:.* fewer than 2:doppelgait.core.errors.DoppelgaitWarning")


@few_strides
@pytest.mark.parametrize(
    ("speed_mps", "clip_s", "start_phase"), [(1.2, 3.0, 0.0), (1.2, 1.6, 0.3), (0.6, 4.0, 0.1), (2.4, 2.0, 0.7)]
)
def test_looped_walk_is_the_long_walk(speed_mps: float, clip_s: float, start_phase: float) -> None:
    clip = boulic_walk(speed_mps=speed_mps, duration_s=clip_s, start_phase=start_phase)
    looped = loop(clip, duration_s=20.0, variation=0.0)
    phase = start_phase + looped.report["loop"]["from_s"] * clip.facts.stride_frequency_hz
    long = boulic_walk(speed_mps=speed_mps, duration_s=float(looped.time_s[-1]), start_phase=phase % 1)
    long = long.with_positions(long.position_m + (looped.position_m[0] - long.position_m[0]).mean(axis=0))
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
    looped, varied = (loop(clip, duration_s=15.0, variation=variation) for variation in (0.0, 1.0))
    # no jump in position or velocity: speed and acceleration stay those of the clip itself
    assert _biggest_change(looped.position_m, 1) < 1.15 * _biggest_change(clip.position_m, 1)
    assert _biggest_change(looped.position_m, 2) < 1.15 * _biggest_change(clip.position_m, 2)
    # a stride that is 12 % faster has a quarter more acceleration
    assert _biggest_change(varied.position_m, 2) < 1.35 * _biggest_change(clip.position_m, 2)
    seam = looped.report["loop"]
    assert seam["seam_position_m"] <= seam["usual_position_m"]
    assert seam["seam_velocity_mps"] <= seam["usual_velocity_mps"]
    assert seam["usual_position_m"] > 1e-3


def test_result_keeps_rate_parts_and_facts_and_measures_as_it_states() -> None:
    clip = boulic_walk(speed_mps=1.4, duration_s=2.5, rate_hz=120.0)
    unknown = dict.fromkeys(["stride_frequency_hz", "step_frequency_hz", "gait_frequency_hz"], np.nan)
    looped = loop(clip.with_facts(subject="A", gait="", footfalls={}, **unknown), duration_s=12.0, variation=0.0)
    assert (looped.rate_hz, looped.parts) == (120.0, clip.parts)
    assert looped.time_s[-1] == pytest.approx(12.0)
    facts = looped.facts
    assert (facts.source, facts.subject, facts.gait) == ("boulic", "A", "walk")
    found = measure_gait(looped)
    assert facts.stride_frequency_hz == pytest.approx(found.stride_frequency_hz, rel=2e-3)
    assert facts.gait_frequency_hz == pytest.approx(2 * facts.stride_frequency_hz, rel=1e-12)
    for foot, times in facts.footfalls.items():
        np.testing.assert_allclose(np.diff(times), 1 / facts.stride_frequency_hz, atol=1.5 / 120)
        assert len(times) >= len(found.footfalls[foot])


def test_heading_does_not_matter() -> None:
    clip = _varied("walk")
    turn = np.array([[np.cos(1.0), np.sin(1.0), 0], [-np.sin(1.0), np.cos(1.0), 0], [0, 0, 1]])
    turned = loop(clip.with_positions(clip.position_m @ turn), duration_s=6.0)
    np.testing.assert_allclose(turned.position_m, loop(clip, duration_s=6.0).position_m @ turn, atol=1e-3)


def _accelerating(strides: float) -> Motion:
    """A walk that becomes faster by half: frames come later and later in the even walk."""
    stride_s = 1 / boulic_walk(speed_mps=1.2).facts.stride_frequency_hz
    even = boulic_walk(speed_mps=1.2, duration_s=strides * stride_s + 0.5)
    times = np.arange(round(strides * stride_s / FRAME_S)) * FRAME_S
    share = times / times[-1]
    return (
        even.frames(0, times.size)
        .with_positions(resample(even, times * (0.8 + 0.2 * share))[0])
        .with_facts(footfalls={})
    )


def _ground_speed(motion: Motion) -> float:
    centre = body_centre_m(motion)[:, :2]
    return float(np.hypot(*(centre[-1] - centre[0])) / motion.duration_s)


@pytest.mark.parametrize("variation", [0.0, 1.0])
def test_the_loop_keeps_the_speed_of_the_clip(variation: float) -> None:
    clip = _accelerating(2.8)  # the cut of two strides is 4 % faster than the clip
    looped = loop(clip, duration_s=30.0, variation=variation)
    assert _ground_speed(looped) == pytest.approx(_ground_speed(clip), rel=0.01)


@pytest.mark.release
def test_successive_strides_vary_as_measured() -> None:
    clip = boulic_walk(speed_mps=1.2, duration_s=2.6)
    looped = loop(clip, duration_s=200.0)
    person, strides = load_tables()["variation"]["person"], looped.report["loop"]["strides"]
    times = np.array(looped.facts.footfalls["left_foot"])
    stride_s = np.diff(times)
    wanted = np.hypot(person["time"], np.sqrt(2) * person["limb_phase"] * np.sqrt(1 - 0.5)) / np.sqrt(strides)
    assert stride_s.std() / stride_s.mean() == pytest.approx(wanted, rel=0.25)
    foot = looped.positions.sel(marker="left_ankle")
    place = np.interp(times, looped.time_s, foot.sel(space="x"))
    stride_m = np.diff(place)
    assert 0.4 < stride_m.std() / stride_m.mean() / person["length"] * np.sqrt(strides) < 1.8
    assert np.corrcoef(stride_s[:-1], stride_s[1:])[0, 1] > 0.1
    again = np.diff(loop(clip, duration_s=200.0, variation=0.0).facts.footfalls["left_foot"])
    assert again.std() < 1e-5


def _slide(motion: Motion) -> float:
    """Root mean square speed over the ground of feet in stance, m/s."""
    feet = [n for n, part in enumerate(motion.parts) if part.endswith(("_paw", "_foot"))]
    speed = np.linalg.norm(np.gradient(motion.position_m[:, feet, :2], FRAME_S, axis=0), axis=2)
    return float(np.sqrt((speed[speed < 0.35 * _ground_speed(motion)] ** 2).mean()))


def test_feet_stand_still_in_a_varied_loop() -> None:
    clip = human_gait(speed_mps=1.2, duration_s=4.0)
    plain, varied = (_slide(loop(clip, duration_s=20.0, variation=variation)) for variation in (0.0, 1.0))
    assert varied < plain + 0.02  # m/s, next to 1.2 m/s of the body


def test_the_same_clip_gives_the_same_loop_and_another_seed_another() -> None:
    clip = _varied("trot")
    first, again = loop(clip, duration_s=6.0), loop(clip, duration_s=6.0)
    assert first.position_m.tobytes() == again.position_m.tobytes()
    assert first.facts == again.facts
    seeded = [loop(clip, duration_s=6.0, rng=Streams(seed)).position_m for seed in (1, 1, 2)]
    assert seeded[0].tobytes() == seeded[1].tobytes()
    assert np.abs(seeded[0] - seeded[2]).max() > 0.01
    elsewhere = loop(clip.with_facts(file_time_s=3.0), duration_s=6.0)
    assert np.abs(elsewhere.position_m - first.position_m).max() > 0.01


@pytest.mark.parametrize("extra", [0.01, 0.05, 0.09, 0.23, 0.25, 0.27, 0.3])
def test_the_shortest_clips_loop_with_a_warning(extra: float) -> None:
    stride_s = 1 / boulic_walk(speed_mps=1.2).facts.stride_frequency_hz
    clip = boulic_walk(speed_mps=1.2, duration_s=stride_s * (1.0 + extra), rate_hz=60.0)
    if extra > 0.2:
        with pytest.warns(DoppelgaitWarning, match=r"has 1\.\d strides, fewer than 2.* vary by 1\.6 %"):
            assert loop(clip, duration_s=3.0).n_frames == 181
    else:
        with pytest.raises(MotionError, match="a loop needs"):
            loop(clip, duration_s=3.0)


def test_feet_of_uneven_strides_slide_no_more_than_in_the_clip() -> None:
    """What does not come back after a cycle is taken off while a foot swings."""
    clip = _varied("walk", seed=7)
    clip = clip.frames(0, round(1.6 / clip.facts.stride_frequency_hz * 250)).with_facts(footfalls={})
    with pytest.warns(DoppelgaitWarning, match=r"has 1\.6 strides, fewer than 2"):
        looped = loop(clip, duration_s=10.0, variation=0.0)
    assert _slide(looped) < 1.12 * _slide(clip)
