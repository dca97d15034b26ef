"""Stride frequency of short segments: the limbs' repetition, not a bin of a spectrum."""

import csv
from pathlib import Path

import numpy as np
import pytest

from doppelgait.motion import Motion
from doppelgait.motion.clean import clean_motion
from doppelgait.motion.gait import measure_gait
from doppelgait.motion.models import human_gait, quadruped_gait
from doppelgait.motion.readers import read

WALK = human_gait(speed_mps=1.2, height_m=1.75, duration_s=6.0, rate_hz=120)
TROT = quadruped_gait(gait="trot", speed_mps=2.0, withers_m=0.5, duration_s=6.0)


def relative_errors(motion: Motion, duration_s: float, true_hz: float) -> np.ndarray:
    """Return the relative errors of all windows of a duration; NaN where no stride is found."""
    frames = round(duration_s * motion.rate_hz)
    starts = range(0, motion.n_frames - frames, frames // 2)
    found = [measure_gait(motion.frames(first, first + frames)).stride_frequency_hz for first in starts]
    return np.array(found) / true_hz - 1.0


@pytest.mark.parametrize("motion", [WALK, TROT], ids=["walk", "trot"])
@pytest.mark.parametrize("duration_s", [0.95, 1.2, 1.6, 2.2])
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
    assert measure_gait(wandering).measured_from in ("", "autocorrelation")
    assert np.isnan(measure_gait(wandering).stride_frequency_hz)


@pytest.mark.shared
def test_short_windows_of_recorded_walks_and_runs(shared: Path) -> None:
    folder = shared / "data" / "mocap" / "human"
    errors = []
    for name in ("c3d/cmu_07_01.c3d", "c3d/cmu_02_01.c3d", "amc/cmu_07_10.amc", "bvh/bandai2_walk_normal_001.bvh"):
        motion = read(folder / name)
        errors.append(relative_errors(motion, 1.2, measure_gait(motion).stride_frequency_hz))
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
        found = measure_gait(clean_motion(motion.cut(int(row["start_frame"]), int(row["end_frame"]) + 1)))
        if found.measured_from == "autocorrelation":
            errors.append(found.stride_frequency_hz / float(row["footfall_stride_hz"]) - 1.0)
    assert len(errors) >= 8
    assert np.median(np.abs(errors)) < 0.045  # 7.5 % with the peak of the spectrum
