"""How steps of recorded walkers and runners differ: the spreads of ``sample_person``.

    python studies/step_variation.py MOTION_FOLDER [--half held]

Time and length of steps and the peak speed of swinging feet, measured twice, at the ankle and at the toe: what both
share is the person's own, the rest is error of measurement. Left and right have means of their own; their difference is
the asymmetry. Correlations of successive steps are corrected for the few steps of a clip by simulation.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from recorded_motion import SPEED_WINDOW_S, find_clips, find_points, is_tuning
from scipy.signal import find_peaks, savgol_filter
from scipy.special import digamma, polygamma

from doppelgait.core.errors import DoppelgaitError
from doppelgait.motion.motion import Motion

FloatArray = npt.NDArray[np.float64]

FEWEST_STEPS = 3
SAME_S = 0.15
"""Ankle and toe of a foot are furthest ahead within this time."""
STANDING = 0.25
"""A foot stands where its speed is below this share of the body's; its place is the median there."""
QUANTITIES = ("time", "length", "foot_speed")


@dataclass(frozen=True)
class StepSeries:
    """Successive steps of one clip, relative to their mean; rows are ankle and toe.

    Parameters
    ----------
    time, length, foot_speed : ndarray, shape (2, K)
    left : ndarray of bool, shape (K,)
        True where the left foot lands.
    """

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


def report(series: list[tuple[str, StepSeries]]) -> None:
    """Print spreads, correlations and asymmetries."""
    counts = [item.left.size for _, item in series]
    free = np.array(counts) - 2.0
    print(f"{len(series)} clips, {sum(counts)} steps")
    pairs: dict[str, FloatArray] = {}
    for name in QUANTITIES:
        split = [clean_deviations(getattr(item, name), item.left) for _, item in series]
        means = [deviation.mean(axis=0) for deviation, _ in split]
        variances = np.array([mean @ mean for mean in means]) / free
        error = sum(((deviation[0] - deviation[1]) ** 2).sum() for deviation, _ in split) / free.sum() / 2
        lags = np.array([lag_one(mean) for mean in means])
        again = np.random.default_rng(0).choice(lags, (500, lags.size)).mean(axis=1)
        low, middle, high = correct_correlation(np.append(np.quantile(again, (0.05, 0.95)), lags.mean()), counts)[
            [0, 2, 1]
        ]
        typical, spread = lognormal_sd(variances, free)
        sides = np.array([side.mean() for _, side in split])
        chance = typical**2 * np.mean([1 / item.left.sum() + 1 / (~item.left).sum() for _, item in series])
        print(
            f"{name}: sd of a step {typical:.3f} times exp({spread:.2f} normal), error of one measurement "
            f"{np.sqrt(error):.3f}; correlation {middle:+.2f} ({low:+.2f} to {high:+.2f}); left less right: mean "
            f"{sides.mean():+.3f}, sd {np.sqrt(max((sides**2).mean() - chance, 0)):.3f}, chance {np.sqrt(chance):.3f}"
        )
        pairs[name] = np.concatenate(means)
    for one, other in (("time", "length"), ("time", "foot_speed"), ("length", "foot_speed")):
        print(f"{one} with {other}: {np.corrcoef(pairs[one], pairs[other])[0, 1]:+.2f}")
    slopes, chances = [], []
    for _, item in series:
        pace = (item.length / item.time).mean(axis=0)
        pace, at = pace - pace.mean(), np.arange(pace.size) - (pace.size - 1) / 2
        slope = at @ pace / (at @ at)
        slopes.append(slope)
        chances.append(np.sum((pace - slope * at) ** 2) / (pace.size - 2) / (at @ at))
    print(
        f"pace, change a step: median size {np.median(np.abs(slopes)):.4f}, by chance {np.sqrt(np.mean(chances)):.4f}"
    )


def main() -> None:
    """Measure one half of the people."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("motion_folder", type=Path)
    parser.add_argument("--half", choices=("tuning", "held"), default="tuning")
    arguments = parser.parse_args()
    walks = list(find_series(arguments.motion_folder, tuning=arguments.half == "tuning", gait="walk"))
    with (arguments.motion_folder / "clinic" / "manifest.csv").open() as file:
        group = {row["file"]: row["group"] for row in csv.DictReader(file)}
    groups: dict[str, list[tuple[str, StepSeries]]] = {}
    for file_name, series in walks:
        groups.setdefault(group.get(file_name, "others"), []).append((file_name, series))
    well = [item for name, items in groups.items() if name in ("others", "Healthy") for item in items]
    for title, found in {"all": walks, "without complaints": well, **groups}.items():
        print(f"--- walk, {title}")
        report(found)


if __name__ == "__main__":
    main()
