"""What all gait models share: sample times, a clock that counts strides, footfall times and trunk facts."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import ConfigError
from doppelgait.core.rng import RandomSource, as_generator
from doppelgait.motion.models.curves import cubic_spline

FloatArray = npt.NDArray[np.float64]

STRIDE_CORRELATION = 0.5
"""Lag-one correlation of successive stride times, assumed."""
LARGEST_DEVIATION = 3.0
"""Stride times stay within this many standard deviations, so that time never runs backwards."""
_MARGIN = 2
"""Strides before the first and after the last sample, so that the ends of the spline do not show."""


def sample_times_s(duration_s: float, rate_hz: float) -> FloatArray:
    """Times of the frames from 0 to the first one at or after ``duration_s``.

    Raises
    ------
    ConfigError
        If the duration is not positive and finite.
    """
    if not (math.isfinite(duration_s) and duration_s > 0):
        raise ConfigError(f"duration_s: {duration_s!r} is not allowed: must be a number above 0 s")
    return np.arange(math.ceil(duration_s * rate_hz - 1e-9) + 1) / rate_hz


def stride_clock(
    duration_s: float,
    *,
    period_s: float,
    start_phase: float = 0.0,
    variation: float = 0.0,
    rng: RandomSource | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Knots of the clock that says how many strides are done at a time.

    Parameters
    ----------
    duration_s : float
        Time that the clock must cover, from 0.
    period_s : float
        Mean stride time T.
    start_phase : float
        Phase in cycles at time 0.
    variation : float
        Standard deviation of the relative stride time; its sequence is first-order autoregressive.
    rng : Streams or numpy.random.Generator, optional
        Needed when ``variation`` is above 0.

    Returns
    -------
    times_s, phases : ndarray, shape (K,)
        Rising; the phase grows by one from knot to knot. Time 0 is a knot.

    Raises
    ------
    ConfigError
        If variation is asked for without ``rng``.
    """
    ahead = math.ceil(duration_s / (period_s * (1 - LARGEST_DEVIATION * variation))) + _MARGIN
    deviation = np.zeros(_MARGIN + ahead)
    if variation > 0:
        if rng is None:
            raise ConfigError(f"stride_variation: {variation!r} needs a random generator (rng=dg.rng(seed)), or set 0")
        deviation = variation * autoregressive(deviation.size, as_generator(rng, "motion"))
    lengths_s = period_s * (1 + deviation)
    times_s = np.concatenate([-np.cumsum(lengths_s[_MARGIN - 1 :: -1])[::-1], [0.0], np.cumsum(lengths_s[_MARGIN:])])
    return times_s, start_phase + np.arange(-_MARGIN, ahead + 1.0)


def autoregressive(count: int, rng: np.random.Generator) -> FloatArray:
    """First-order autoregressive numbers of unit variance, within :data:`LARGEST_DEVIATION`."""
    noise = rng.standard_normal(count)
    values = np.empty(count)
    values[0] = noise[0]
    fresh = math.sqrt(1 - STRIDE_CORRELATION**2)
    for k in range(1, count):
        values[k] = STRIDE_CORRELATION * values[k - 1] + fresh * noise[k]
    return np.clip(values, -LARGEST_DEVIATION, LARGEST_DEVIATION)


def phase_at(clock: tuple[FloatArray, FloatArray], times_s: npt.ArrayLike) -> FloatArray:
    """Phase in cycles at given times: a cubic spline through the clock, hence with continuous rate."""
    return cubic_spline(*clock)(times_s)


def footfall_times_s(
    clock: tuple[FloatArray, FloatArray], touchdown_phase: Mapping[str, float], end_s: float
) -> dict[str, list[float]]:
    """Times in [0, ``end_s``] at which each foot lands; ``touchdown_phase`` in cycles by name of the foot."""
    spline = cubic_spline(*clock)
    first, last = (float(p) for p in spline([0.0, end_s]))
    phases = [
        offset + np.arange(math.ceil(first - offset - 1e-9), math.floor(last - offset + 1e-9) + 1)
        for offset in touchdown_phase.values()
    ]
    found_s = np.clip(spline.where(np.concatenate(phases)), 0.0, end_s) if phases else np.empty(0)
    parts = np.split(found_s, np.cumsum([part.size for part in phases])[:-1])
    return {foot: part.tolist() for foot, part in zip(touchdown_phase, parts, strict=True)}


def mean_stride_frequency_hz(times_s: FloatArray, phase: FloatArray) -> float:
    """Strides per second over a whole motion."""
    return float((phase[-1] - phase[0]) / (times_s[-1] - times_s[0]))
