"""How the steps of recorded walkers differ: the spreads of `sample_person`.

    python studies/step_variation.py MOTION_FOLDER --page

Question: how much do time and length of steps and the peak speed of feet vary from step to step, between people and
between left and right?

All are measured twice, at the ankle and at the toe: what both share is the person's own, the rest is error of
measurement. Left and right have means of their own; their difference is the asymmetry. Correlations of successive steps
(with 90 % intervals) are corrected for the few steps of a clip by simulation. The model has the spreads of the tuning
half. It takes 1 minute of one core.

Not shown: drifts of pace over more than 6 s, for which the clips are too short.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
from harness import FloatArray, bootstrap_interval, finish, make_parser
from recorded_motion import SPEED_WINDOW_S, find_clips, find_points, is_tuning
from scipy.signal import find_peaks, savgol_filter
from scipy.special import digamma, polygamma

from doppelgait.core.errors import DoppelgaitError
from doppelgait.motion.motion import Motion

FEWEST_STEPS = 3
SAME_S = 0.15
"""Ankle and toe of a foot are furthest ahead within this time."""
STANDING = 0.25
"""A foot stands where its speed is below this share of the body's; its place is the median there."""
QUANTITIES = ("time", "length", "foot_speed")


@dataclass(frozen=True)
class StepSeries:
    """Successive steps of one clip, relative to their mean; rows are ankle and toe."""

    time: FloatArray
    length: FloatArray
    foot_speed: FloatArray
    left: npt.NDArray[np.bool_]


def measure_steps(motion: Motion) -> StepSeries | None:
    """Measure the steps of a motion; None with too few of them or without ankles and toes."""
    found, times_s = find_points(list(motion.markers)), motion.time_s
    if any(point not in found for point in ("pelvis", "l_ankle", "r_ankle", "l_toe", "r_toe")):
        return None
    rate_hz = 1 / float(times_s[1] - times_s[0])
    place = {point: np.nanmean(motion.position_m[:, markers], axis=1) for point, markers in found.items()}
    way = (place["pelvis"][-1] - place["pelvis"][0])[:2]
    speed_mps, forward = float(np.linalg.norm(way)) / float(times_s[-1]), way / np.linalg.norm(way)
    x = {point: at[:, :2] @ forward for point, at in place.items()}
    window = max(5, round(SPEED_WINDOW_S * rate_hz) | 1)
    steps = []
    for point in ("ankle", "toe"):
        rows = []
        for side in "lr":
            foot = x[f"{side}_{point}"]
            speed = savgol_filter(foot, window, 3, deriv=1, delta=1 / rate_hz)
            ahead = savgol_filter(foot - x["pelvis"], window, 3)
            peaks, _ = find_peaks(ahead, prominence=0.4 * np.ptp(ahead), distance=max(int(0.35 * rate_hz), 1))
            for number, peak in enumerate(peaks):
                before = ahead[peak - 1 : peak + 2]
                bend = before[0] - 2 * before[1] + before[2]
                landed = peak + (before[0] - before[2]) / (2 * bend)
                last = peaks[number - 1] if number else max(0, peak - round(1.2 * rate_hz))
                end = peaks[number + 1] if number + 1 < peaks.size else foot.size
                standing = peak + np.flatnonzero(np.abs(speed[peak:end]) < STANDING * speed_mps)
                swing = speed[last:peak]
                if swing.size < 0.25 * rate_hz or swing.max() < 1.5 * speed_mps or standing.size < 3:
                    continue
                rows.append((landed / rate_hz, float(np.median(foot[standing])), swing.max(), side == "l"))
        steps.append(sorted(rows))
    both = np.array(
        [
            (ankle, toe)
            for ankle in steps[0]
            for toe in steps[1]
            if toe[3] == ankle[3] and abs(toe[0] - ankle[0]) < SAME_S
        ],
        dtype=float,
    )
    if len(both) <= FEWEST_STEPS:
        return None
    both = np.moveaxis(both, 1, 0)
    left = both[0, :, 3] > 0.5
    if (left[1:] == left[:-1]).any():
        return None
    values = np.diff(both[:, :, 0]), np.diff(both[:, :, 1]), both[:, 1:, 2]
    return StepSeries(*(value / value.mean(axis=1, keepdims=True) for value in values), left=left[1:])


def clean_deviations(values: FloatArray, left: npt.NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Split values (2, K) into deviations from the mean of their side, and left less right (2,)."""
    means = [values[:, side].mean(axis=1, keepdims=True) for side in (left, ~left)]
    return values - np.where(left, *means), (means[0] - means[1])[:, 0]


def lognormal_sd(variances: FloatArray, freedom: FloatArray) -> tuple[float, float]:
    """Return median over people of a standard deviation and the sd of its logarithm.

    Variances of few steps scatter by chance as chi-squared: mean and variance of its logarithm are taken off.
    """
    logs = np.log(variances) - (digamma(freedom / 2) - np.log(freedom / 2))
    spread = logs.var(ddof=1) - polygamma(1, freedom / 2).mean()
    return float(np.exp(logs.mean() / 2)), float(np.sqrt(max(spread, 0.0)) / 2)


def correct_correlation(measured: FloatArray, counts: list[int]) -> FloatArray:
    """Find the correlations of steps that clips of these lengths show as measured."""
    rng = np.random.default_rng(0)
    tried = np.linspace(-0.6, 0.95, 32)
    shown = []
    for correlation in tried:
        seen = []
        for count in counts * 40:
            values = rng.standard_normal(count)
            for k in range(1, count):
                values[k] = correlation * values[k - 1] + np.sqrt(1 - correlation**2) * values[k]
            seen.append(lag_one(clean_deviations(values[None], np.arange(count) % 2 == 0)[0][0]))
        shown.append(np.mean(seen))
    return np.interp(measured, np.maximum.accumulate(shown), tried)


def lag_one(deviation: FloatArray) -> float:
    """Return the correlation of successive deviations."""
    return float(deviation[1:] @ deviation[:-1] / (deviation @ deviation) * deviation.size / (deviation.size - 1))


def find_series(folder: Path, *, tuning: bool, gait: str) -> Iterator[tuple[str, StepSeries]]:
    """Yield the steps of a half's clips."""
    for clip in find_clips(folder):
        if is_tuning(clip, folder) is not tuning or clip.gait != gait:
            continue
        try:
            series = measure_steps(clip.read(folder))
        except DoppelgaitError:
            continue
        if series is not None:
            yield clip.file, series


def summarise(title: str, series: list[StepSeries]) -> list[dict[str, object]]:
    """Return spreads, correlations and asymmetries of a group, a row a quantity."""
    counts = [item.left.size for item in series]
    free, rows = np.array(counts) - 2.0, []
    for name in QUANTITIES:
        split = [clean_deviations(getattr(item, name), item.left) for item in series]
        means = [deviation.mean(axis=0) for deviation, _ in split]
        variances = np.array([mean @ mean for mean in means]) / free
        error = sum(((deviation[0] - deviation[1]) ** 2).sum() for deviation, _ in split) / free.sum() / 2
        lags = np.array([lag_one(mean) for mean in means])
        shown = np.array([*bootstrap_interval(lags, share=0.9), lags.mean()])
        low, high, middle = correct_correlation(shown, counts)
        typical, spread = lognormal_sd(variances, free)
        sides = np.array([side.mean() for _, side in split])
        chance = typical**2 * np.mean([1 / item.left.sum() + 1 / (~item.left).sum() for item in series])
        rows.append(
            {
                "people": title,
                "clips, steps": f"{len(series)}, {sum(counts)}",
                "of a step": name,
                "sd": f"{typical:.3f}",
                "log sd between people": spread,
                "error of measurement": f"{np.sqrt(error):.3f}",
                "correlation of steps": f"{middle:+.2f} ({low:+.2f} to {high:+.2f})",
                "left minus right: mean, sd": f"{sides.mean():+.3f}, {np.sqrt(max((sides**2).mean() - chance, 0)):.3f}",
            }
        )
    return rows


def main() -> None:
    """Measure both halves of the people."""
    options = make_parser(__doc__, motion_folder="folder of the motion recordings").parse_args()
    folder, sections = options.motion_folder, {}
    with (folder / "clinic" / "manifest.csv").open() as file:
        group = {row["file"]: row["group"] for row in csv.DictReader(file)}
    for half in ("tuning", "held-out"):
        groups: dict[str, list[StepSeries]] = {}
        for file_name, series in find_series(folder, tuning=half == "tuning", gait="walk"):
            groups.setdefault(group.get(file_name, "others"), []).append(series)
        well = [item for name, items in groups.items() if name in ("others", "Healthy") for item in items]
        rows = [row for title, own in {"without complaints": well, **groups}.items() for row in summarise(title, own)]
        sections[f"Walkers, {half} half"] = pd.DataFrame(rows)
    finish(__file__, __doc__, sections, page=options.page)


if __name__ == "__main__":
    main()
