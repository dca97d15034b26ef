"""Standard deviations of features between gait periods.

The record is divided into blocks of one gait period. Periodic effects are equal in all blocks and cancel. The rest
(noise, uneven strides, glints) differs between blocks, and its scatter gives the error of a mean over the blocks. Only
the constants were chosen, on simulated and recorded people and dogs (``studies/gait_frequency.py``, half A; SNR from
5 dB on, within 45 degrees of the line of sight); its table has the other half.

The values are valid if the gait frequency is correct, and not its half or double. They describe the
scatter of a value between records. They do not include a bias that noise causes in every record.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.units import FloatArray
from doppelgait.features.doppler import compute_quantile, width_of_bins
from doppelgait.features.feature_set import Extraction
from doppelgait.features.gait_frequency import END_SHARE
from doppelgait.features.observed import Observation

CAUCHY_TUNING = 2.385
VELOCITY_BLOCK_S = 0.5  # block length for targets without a gait frequency
VELOCITY_LEAST_MPS, VELOCITY_RIPPLE_SHARE = 0.006, 0.05
RATE_SHARE, FREQUENCY_LEAST_SHARE = 0.5, 0.0025  # of the difference between f_mu and the phases' rate, and of f_mu
RATIO_FACTOR, RATIO_END_SHARE = 0.6, 0.05
"""Factor from scatter to error of rho, and effect of an incomplete period at the ends, relative to its share."""
HARMONIC_FACTOR = 1.45
MIN_BLOCKS = 3
GROUPS = 8  # number of groups of periods in the jackknife estimate for the bandwidth
HARMONICS = np.arange(1.0, 4.0)
ADVANCES_RAD = np.linspace(-0.4, 0.4, 161)  # of a period's phase against that of the period before: up to 6 % of f_mu
TURNED_BACK = np.exp(-1j * np.outer(HARMONICS, ADVANCES_RAD))

UNCERTAIN_SHARE = {
    "gait_frequency_hz": 0.05,
    "step_length_m": 0.1,
    "torso_velocity_mps": 0.2,
    "doppler_bandwidth_hz": 0.2,
    "limb_torso_ratio": 0.2,
}
"""Standard deviation as a share of the value above which the feature is flagged."""


def estimate_uncertainties(observations: Sequence[Observation]) -> list[dict[str, float | None]]:
    """Estimate standard deviations of features of targets with equal axes."""
    # each standard deviation has the unit of its feature
    audible = [seen for seen in observations if seen.has_signal]
    wide = [s for s in audible if s.has_gait_frequency and s.extraction.features.doppler_bandwidth_hz is not None]
    velocity_sd = dict(zip(map(id, audible), estimate_velocity_sd(audible), strict=True))
    bandwidth_sd = dict(zip(map(id, wide), estimate_bandwidth_sd(wide), strict=True))
    return [_collect(seen, velocity_sd.get(id(seen)), bandwidth_sd.get(id(seen))) for seen in observations]


def _collect(observed: Observation, velocity_sd: float | None, bandwidth_sd: float | None) -> dict[str, float | None]:
    features, frequency_hz = observed.extraction.features, observed.extraction.gait_frequency_hz
    found: dict[str, float | None] = dict.fromkeys((*features.as_dict(), "gait_frequency_hz"))
    found |= {"torso_velocity_mps": velocity_sd, "doppler_bandwidth_hz": bandwidth_sd}
    periods = None if frequency_hz is None or not observed.has_signal else _measure_periods(observed)
    if periods is not None and frequency_hz is not None:
        found["gait_frequency_hz"] = frequency_sd = frequency_sd_hz(periods, observed.extraction.n_periods or 1.0)
        if features.step_length_m is not None and velocity_sd is not None:
            # L_m = v_m / f_mu: relative variances add (E-36)
            found["step_length_m"] = math.hypot(velocity_sd, features.step_length_m * frequency_sd) / frequency_hz
        if features.limb_torso_ratio is not None:
            found["limb_torso_ratio"] = estimate_ratio_sd(periods)
        if features.harmonic_ratio_2 is not None:
            found["harmonic_ratio_2"] = estimate_harmonic_ratio_sd(periods, 2)
    return {name: value if value is not None and math.isfinite(value) else None for name, value in found.items()}


def flag_uncertain_features(extraction: Extraction, sd: Mapping[str, float | None]) -> tuple[str, ...]:
    """Flag features with a large standard deviation."""
    values = {**extraction.features.as_dict(), "gait_frequency_hz": extraction.gait_frequency_hz}
    flags = []
    for name, share in UNCERTAIN_SHARE.items():
        value, spread = values[name], sd.get(name)
        if value is not None and spread is not None and spread > share * abs(value):
            flags.append(f"{name}:uncertain_by_more_than_{100 * share:.0f}_per_cent")
    return tuple(flags)


def estimate_velocity_sd(observations: Sequence[Observation]) -> list[float | None]:
    """Estimate the standard deviation of v_m in m/s (E-34)."""
    # the main line is an M-estimate with Cauchy weights; this is the sandwich estimate for clusters
    # (Huber 1967): blocks are independent, and columns within a block may depend on each other
    starts = []
    for seen in observations:
        edges = seen.period_edges if seen.has_gait_frequency else seen.compute_block_edges(VELOCITY_BLOCK_S)
        starts.append(np.concatenate([[0], edges[1:-1]]))  # remaining columns at the ends belong to the blocks there
    found: list[float | None] = [None] * len(starts)
    chosen = [n for n, edges in enumerate(starts) if edges.size >= MIN_BLOCKS]
    if chosen:
        residual = np.stack([observations[n].peaks_hz * observations[n].mps_per_hz for n in chosen])
        residual -= np.stack([observations[n].line_mps for n in chosen])
        least_scale = observations[0].bin_mps / 4.0
        scatter = compute_block_scatter(residual, least_scale, [starts[n] for n in chosen], observations[0].counted)
        for n, sandwich_mps in zip(chosen, scatter, strict=True):
            ripple_mps = observations[n].torso_ripple_rms_mps if observations[n].has_line else 0.0
            found[n] = math.hypot(sandwich_mps, VELOCITY_RIPPLE_SHARE * ripple_mps, VELOCITY_LEAST_MPS)
    return found


def compute_block_scatter(
    residual: FloatArray, least_scale: float, starts: Sequence[npt.NDArray[np.int64]], counted: npt.NDArray[np.bool_]
) -> list[float]:
    """Compute the sd of tapered Cauchy means of dependent values: residual (B, J), counted (J,)."""
    # blocks begin at the starts, the first at 0; the slope is positive: half of the values are below a third of scale
    medians = np.array([[compute_quantile(row[counted], 0.5)] for row in np.abs(residual)])
    square = (residual / (CAUCHY_TUNING * np.maximum(1.4826 * medians, least_scale))) ** 2
    weight = (1.001 - np.linspace(-1.0, 1.0, residual.shape[-1]) ** 2) * counted / (1.0 + square)
    slopes, products = (weight * (1.0 - square) / (1.0 + square)).sum(axis=-1), weight * residual
    scatter = []
    for product, slope, edges in zip(products, slopes.tolist(), starts, strict=True):
        blocks, n = np.add.reduceat(product, edges), np.count_nonzero(np.add.reduceat(counted.astype(int), edges))
        scatter.append(math.sqrt(float(blocks @ blocks) * n / (n - 2)) / slope if n >= MIN_BLOCKS else math.nan)
    return scatter


def estimate_bandwidth_sd(observations: Sequence[Observation]) -> list[float | None]:
    """Estimate the standard deviation of B_mu in Hz (E-35)."""
    # the estimate is a jackknife over groups of periods, plus the rounding to Doppler bins
    found: list[float | None] = [None] * len(observations)
    for n, seen in enumerate(observations):
        edges = seen.period_edges
        n_groups = min(edges.size - 1, GROUPS)
        if n_groups >= MIN_BLOCKS:
            edges = edges[np.arange(n_groups + 1) * (edges.size - 1) // n_groups]
            counts = seen.count_above_level(edges)
            counted = np.concatenate([[0], seen.counted.cumsum()])[edges]
            lengths = counted[-1] - counted[0] - (counted[1:] - counted[:-1])
            without = width_of_bins((counts.sum(axis=0) - counts) / lengths[:, np.newaxis])
            difference = without - without.sum() / n_groups
            scatter = (n_groups - 1) / n_groups * float((difference**2).sum())
            found[n] = math.sqrt(scatter + 1.0 / 6.0) * seen.bin_mps / seen.mps_per_hz
    return found


@dataclass(frozen=True)
class Periods:
    """Fourier coefficients of single gait periods. Shapes: harmonics (B, 3, K+); centre_s (B,)."""

    harmonics: npt.NDArray[np.complex128]
    means: FloatArray
    centre_s: FloatArray
    frequency_hz: float

    @cached_property
    def phase_parts(self) -> tuple[FloatArray, FloatArray, float]:
        """Harmonics of each period relative to their mean, turned back by a steady rate, and this rate in Hz."""
        advance = np.einsum("bhk,bhk->h", self.harmonics[1:], self.harmonics[:-1].conj())
        rate_hz = self.frequency_hz * float(ADVANCES_RAD[(advance @ TURNED_BACK).real.argmax()]) / (2.0 * math.pi)
        turns = np.outer(rate_hz * (self.centre_s - self.centre_s[0]), HARMONICS)
        steady = self.harmonics * np.exp(-2j * np.pi * turns)[:, :, np.newaxis]
        products = np.einsum("bhk,hk->bh", steady, (steady.sum(axis=0) / len(steady)).conj())
        return products.imag, products.real.sum(axis=0) / len(steady), rate_hz


def _measure_periods(observed: Observation) -> Periods | None:
    frequency_hz, rate_hz = observed.frequency_hz, observed.rate_hz
    length = int(rate_hz / frequency_hz)
    starts = np.minimum(observed.period_edges[:-1], observed.aligned.shape[0] - length)
    starts = starts[[bool(observed.counted[start : start + length].all()) for start in starts]]
    if starts.size < MIN_BLOCKS or length < 2 * HARMONICS.size + 1 or not observed.occupied_rows.size:
        return None
    n_harmonics, n_rows = HARMONICS.size, observed.occupied_rows.size
    parts = np.empty((starts.size, 1 + 2 * n_harmonics, n_rows))  # means, real and imaginary parts
    rows = parts.reshape(-1, n_rows)
    native.period_harmonics(observed.occupied_columns, starts, length, frequency_hz / rate_hz, rows)
    harmonics = parts[:, 1 : 1 + n_harmonics] + 1j * parts[:, 1 + n_harmonics :]
    return Periods(harmonics, parts[:, 0], (starts + length / 2.0) / rate_hz, frequency_hz)


def frequency_sd_hz(periods: Periods, n_periods: float) -> float:
    """Estimate the standard deviation of f_mu."""
    # the phases of the periods have their own rate: its difference from f_mu, its error, and the ends of the record
    imaginary, real, rate_hz = periods.phase_parts
    slope, variance = _fit_phase_rate(periods, imaginary @ HARMONICS / float(HARMONICS**2 @ real))
    apart_hz = math.hypot(RATE_SHARE * (slope / (2.0 * math.pi) + rate_hz), math.sqrt(variance) / (2.0 * math.pi))
    return math.hypot(apart_hz, periods.frequency_hz * math.hypot(END_SHARE / n_periods**2, FREQUENCY_LEAST_SHARE))


def _fit_phase_rate(periods: Periods, phase_rad: FloatArray) -> tuple[float, float]:
    n = periods.centre_s.size
    time_s = periods.centre_s - float(periods.centre_s.sum()) / n
    square_s2 = float(time_s @ time_s)
    slope = float(time_s @ phase_rad) / square_s2
    residual = phase_rad - float(phase_rad.sum()) / n - slope * time_s
    return slope, float(residual @ residual) / (n - 2) / square_s2  # in rad/s, and its variance


def estimate_ratio_sd(periods: Periods) -> float:
    """Estimate the sd of rho (E-38) from that of single periods."""
    parts = periods.harmonics.reshape(len(periods.means), -1).view(np.float64)  # real and imaginary
    energy, base = np.einsum("bk,bk->b", parts, parts), np.einsum("bk,bk->b", periods.means, periods.means)
    ratio = np.sqrt(4.0 * energy / base)
    mean = float(ratio.sum()) / ratio.size
    ratio -= mean
    scatter = math.sqrt(float(ratio @ ratio) / (ratio.size - 1) / ratio.size)
    return math.hypot(RATIO_FACTOR * scatter, RATIO_END_SHARE * mean / ratio.size)


def estimate_harmonic_ratio_sd(periods: Periods, harmonic: int) -> float:
    """Estimate the standard deviation of beta (E-37)."""
    # the estimate uses the deviations of the phases of the harmonic and of f_mu from straight lines
    imaginary, real, _ = periods.phase_parts  # each in phase of the fundamental
    spread = sum(_fit_phase_rate(periods, imaginary[:, h - 1] / (h * real[h - 1]))[1] for h in (1, harmonic))
    return HARMONIC_FACTOR * harmonic * math.sqrt(spread) / (2.0 * math.pi * periods.frequency_hz)
