"""Footfalls and gaits: against the exact footfalls of the models, and of feet made in the test."""

import csv
from pathlib import Path

import numpy as np
import pytest

from doppelgait.motion import Motion, make_motion
from doppelgait.motion import gait as motion_gait
from doppelgait.motion.clean import clean_motion
from doppelgait.motion.models import boulic_walk, human_gait, quadruped_gait
from doppelgait.motion.models.quadruped_gaits import GAITS
from doppelgait.motion.readers import read

NAMED_LAGS = {
    # lags lh_lf, lh_rh, lf_rf from tables of gaits (not from the model)
    "walk": [(0.25, 0.5, 0.5), (0.17, 0.5, 0.5), (0.31 - 0.12, 0.52, 0.48)],
    "pace": [(0.0, 0.5, 0.5), (0.98, 0.48, 0.51), (0.05, 0.5, 0.5)],
    "trot": [(0.5, 0.5, 0.5), (0.45, 0.49, 0.46)],
    "canter": [(0.275, 0.275, 0.275), (0.275, 0.725, 0.725)],
    "transverse_gallop": [(0.4, 0.15, 0.15), (0.4, 0.85, 0.85)],
    "gallop": [(0.163, 0.832, 0.181), (0.5, 0.1, 0.9)],
    "bound": [(0.45, 0.0, 0.0), (0.4, 0.99, 0.02)],
}


@pytest.mark.parametrize("gait", NAMED_LAGS)
def test_gait_of_known_lags(gait: str) -> None:
    for lh_lf, lh_rh, lf_rf in NAMED_LAGS[gait]:
        assert motion_gait.name_quadruped_gait({"lh_lf": lh_lf, "lh_rh": lh_rh, "lf_rf": lf_rf}) == gait
        # seen in a mirror: left and right change places
        right_hind_to_fore = (lh_lf + lf_rf - lh_rh) % 1
        mirrored = {"lh_lf": right_hind_to_fore, "lh_rh": -lh_rh % 1, "lf_rf": -lf_rf % 1}
        assert motion_gait.name_quadruped_gait(mirrored) == gait


@pytest.mark.parametrize("lags", [{"lh_lf": 0.2, "lh_rh": 0.5}, {"lh_lf": 0.2, "lh_rh": 0.5, "lf_rf": 0.1}, {}])
def test_no_gait_without_all_lags_or_with_one_even_pair(lags: dict[str, float]) -> None:
    assert motion_gait.name_quadruped_gait(lags) == ""


def _check_against_truth(motion: Motion, frames: float) -> None:
    found, truth = motion_gait.measure_gait(motion), motion.facts.footfalls
    last_s = float(motion.time_s[-1])
    assert found.measured_from == "footfalls"
    assert found.stride_frequency_hz == pytest.approx(motion.facts.stride_frequency_hz, rel=0.005)
    assert set(found.footfalls) == set(truth)
    for foot, times in found.footfalls.items():
        # within one stride of the ends a footfall may be cut
        inner = [t for t in truth[foot] if 0.3 < t < last_s - 0.1]
        assert len(times) >= len(inner) > 0
        for t in inner:
            assert np.abs(np.array(times) - t).min() <= frames / motion.rate_hz + 1e-9
        assert all(np.abs(np.array(truth[foot]) - t).min() < 0.02 for t in times if t < last_s - 0.02)


@pytest.mark.parametrize("speed_mps", [0.5, 1.3, 2.5])
def test_walker_lands_where_the_model_says(speed_mps: float) -> None:
    motion = boulic_walk(speed_mps=speed_mps, duration_s=6.0)
    _check_against_truth(motion, frames=2)
    assert motion_gait.measure_gait(motion).gait == "walk"
    assert motion_gait.measure_gait(motion).phases["l_r"] == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("gait", GAITS)
@pytest.mark.parametrize("share", [0.05, 0.95])
def test_dog_lands_where_the_model_says_and_goes_in_its_gait(gait: str, share: float) -> None:
    low, high, _ = GAITS[gait].froude
    motion = quadruped_gait(gait=gait, froude=low * (high / low) ** share, duration_s=4.0)
    _check_against_truth(motion, frames=2)
    found = motion_gait.measure_gait(motion)
    assert found.gait == gait
    touchdown = GAITS[gait].touchdown
    lags = {"lh_lf": "left_fore", "lh_rh": "right_hind"}
    for name, foot in lags.items():
        wrong = found.phases[name] - (touchdown[foot] - touchdown["left_hind"])
        assert abs((wrong + 0.5) % 1 - 0.5) < 0.02


@pytest.mark.parametrize(
    ("gait", "speed_mps", "low", "high"), [("walk", 1.3, 0.55, 0.75), ("run", 1.8, 0.4, 0.5), ("run", 3.0, 0.25, 0.5)]
)
def test_run_has_flight_and_walk_has_none(gait: str, speed_mps: float, low: float, high: float) -> None:
    motion = human_gait(gait=gait, speed_mps=speed_mps, duration_s=4.0)
    found = motion_gait.measure_gait(motion)
    assert (found.gait, found.measured_from) == (gait, "footfalls")
    assert found.stride_frequency_hz == pytest.approx(motion.facts.stride_frequency_hz, rel=0.002)
    assert found.step_frequency_hz == found.gait_frequency_hz == pytest.approx(2 * found.stride_frequency_hz)
    # feet below half the body's speed: the stance and the slow ends of the swing
    assert low < found.duty_factor < high


def test_standing_body_has_no_footfalls() -> None:
    rng = np.random.default_rng(1)
    still = np.array([0.0, 0.0, 1.0]) * np.arange(6)[:, None] * 0.3 + rng.normal(0, 0.002, (400, 6, 3))
    motion = make_motion(still, rate_hz=100.0, markers=list("abcdef"), parts=["left_foot", "right_foot", *[""] * 4])
    found = motion_gait.add_gait_facts(motion)
    assert found.facts.gait == ""
    assert np.isnan(found.facts.stride_frequency_hz)
    assert not any(found.facts.footfalls.values())


def test_feet_without_names_are_the_lowest_points_left_and_right() -> None:
    named = boulic_walk(duration_s=5.0)
    bare = named.with_points(named.position_m, named.markers, [""] * len(named.markers)).with_facts(species="")
    markers = named.markers
    feet = {foot: {str(markers[n]) for n in points} for foot, points in motion_gait.find_feet(bare).items()}
    assert set(feet) == {"left_foot", "right_foot"}
    assert all(name.startswith(foot.split("_")[0]) for foot, names in feet.items() for name in names)
    found = motion_gait.measure_gait(bare)
    assert found.stride_frequency_hz == pytest.approx(named.facts.stride_frequency_hz, rel=0.005)


def test_stated_facts_stay_and_unknown_ones_are_filled() -> None:
    keys = ("stride_frequency_hz", "step_frequency_hz", "gait_frequency_hz")
    gallop = quadruped_gait(gait="gallop", duration_s=2.0)
    facts = motion_gait.add_gait_facts(gallop).facts
    assert (facts.gait, facts.footfalls, facts.stride_frequency_hz) == (
        "gallop", gallop.facts.footfalls, gallop.facts.stride_frequency_hz
    )  # fmt: skip
    assert np.isnan(facts.step_frequency_hz)  # not defined for a gallop
    stated = gallop.with_facts(stride_frequency_hz=9.0, gait="trot", gait_frequency_hz=np.nan)
    wrong = motion_gait.add_gait_facts(stated).facts
    assert (wrong.stride_frequency_hz, wrong.gait_frequency_hz) == (9.0, 18.0)
    model = boulic_walk(speed_mps=1.2, duration_s=5.0)
    bare = model.with_facts(gait="", footfalls={}, **dict.fromkeys(keys, np.nan))
    filled = motion_gait.add_gait_facts(bare)
    assert (bare.facts.gait, filled.facts.gait, filled.report["gait"]["stride_from"]) == ("", "walk", "footfalls")
    for key in keys:
        assert getattr(filled.facts, key) == pytest.approx(getattr(model.facts, key), rel=0.005)


def test_a_gap_is_bridged_and_a_foot_never_seen_left_out() -> None:
    motion = quadruped_gait(gait="trot", duration_s=3.0)
    values = motion.position_m.copy()
    names = motion.markers
    values[200:205, names.index("left_hind_paw")] = np.nan
    values[:, names.index("right_fore_paw")] = np.nan
    steps = motion_gait.find_steps(motion.with_positions(values))
    assert set(steps) == {"left_hind", "right_hind", "left_fore"}
    assert motion_gait.measure_gait(motion.with_positions(values)).gait == ""


def test_a_gallop_whose_paws_stop_in_the_air_is_a_leap() -> None:
    gallop = quadruped_gait(gait="gallop", withers_m=0.5, duration_s=2.0)
    assert motion_gait.measure_gait(gallop).gait in ("gallop", "transverse_gallop")
    leap_m = 0.8 * np.sin(np.pi * gallop.time_s / gallop.duration_s) ** 2
    leap = gallop.with_positions(gallop.position_m + leap_m[:, np.newaxis, np.newaxis] * [0.0, 0.0, 1.0])
    assert motion_gait.measure_gait(leap).gait == ""


def test_speed_is_not_measured_where_the_body_was_not_seen() -> None:
    walk = human_gait(speed_mps=1.2, height_m=1.75, duration_s=4.0, rate_hz=60)
    before = np.full((120, *walk.position_m.shape[1:]), np.nan)
    facts = motion_gait.measure_travel(np.concatenate([before, walk.position_m, before]), rate_hz=60)
    assert facts["mean_speed_mps"] == pytest.approx(1.2, rel=0.03)


# Stride frequency of short segments: the limbs' repetition, not a bin of a spectrum

WALK = human_gait(speed_mps=1.2, height_m=1.75, duration_s=6.0, rate_hz=120)
TROT = quadruped_gait(gait="trot", speed_mps=2.0, withers_m=0.5, duration_s=6.0)


def relative_errors(motion: Motion, duration_s: float, true_hz: float) -> np.ndarray:
    """Return the relative errors of all windows of a duration; NaN where no stride is found."""
    frames = round(duration_s * motion.rate_hz)
    starts = range(0, motion.n_frames - frames, frames // 2)
    found = [motion_gait.measure_gait(motion.frames(first, first + frames)).stride_frequency_hz for first in starts]
    return np.array(found) / true_hz - 1.0


@pytest.mark.parametrize("motion", [WALK, TROT], ids=["walk", "trot"])
@pytest.mark.parametrize("duration_s", [0.95, 1.6])
def test_a_stride_or_less_gives_the_stride_frequency(motion: Motion, duration_s: float) -> None:
    true_hz = motion.facts.stride_frequency_hz
    errors = relative_errors(motion, duration_s, true_hz)
    assert np.isfinite(errors).mean() > 0.9
    assert np.nanmax(np.abs(errors)) < 0.03


def test_motion_that_does_not_repeat_has_no_stride() -> None:
    rng = np.random.default_rng(1)
    time_s = np.arange(240) / 120
    swing = np.cumsum(rng.normal(0.0, 2e-3, (240, 17, 3)), axis=0)
    swing[..., 0] += 1.2 * time_s[:, np.newaxis]
    wandering = WALK.frames(0, 240).with_positions(swing)
    assert motion_gait.measure_gait(wandering).measured_from in ("", "autocorrelation")
    assert np.isnan(motion_gait.measure_gait(wandering).stride_frequency_hz)


@pytest.mark.shared
def test_short_windows_of_recorded_walks_and_runs(shared: Path) -> None:
    folder = shared / "data" / "mocap" / "human"
    errors = []
    for name in ("c3d/cmu_07_01.c3d", "c3d/cmu_02_01.c3d", "amc/cmu_07_10.amc", "bvh/bandai2_walk_normal_001.bvh"):
        motion = read(folder / name)
        errors.append(relative_errors(motion, 1.2, motion_gait.measure_gait(motion).stride_frequency_hz))
    every = np.abs(np.concatenate(errors))
    assert np.isfinite(every).mean() > 0.9
    assert np.nanmedian(every) < 0.02  # 13 % with the peak of the spectrum
    assert np.nanmax(every) < 0.10


@pytest.mark.release
@pytest.mark.shared
def test_dog_segments_without_a_beat_agree_with_the_footfalls_of_the_table(shared: Path) -> None:
    folder = shared / "data" / "mocap"
    with (folder / "segments.csv").open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["footfall_stride_hz"] and not row["footfall_note"]]
    errors, recordings = [], {}
    for row in rows:
        motion = recordings.get(row["file"]) or read(folder / row["file"], clean=False)
        recordings[row["file"]] = motion
        found = motion_gait.measure_gait(clean_motion(motion.cut(int(row["start_frame"]), int(row["end_frame"]) + 1)))
        if found.measured_from == "autocorrelation":
            errors.append(found.stride_frequency_hz / float(row["footfall_stride_hz"]) - 1.0)
    assert len(errors) >= 8
    assert np.median(np.abs(errors)) < 0.045  # 7.5 % with the peak of the spectrum
