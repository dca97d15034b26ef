"""Steps that differ: from step to step at random, and between left and right."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import ConfigError
from doppelgait.core.rng import RandomSource, as_generator
from doppelgait.motion.models.curves import cubic_spline
from doppelgait.motion.models.strides import LARGEST_DEVIATION, autoregressive

FloatArray = npt.NDArray[np.float64]
Steps = tuple[FloatArray, FloatArray, FloatArray]
"""Touchdowns: times in s, phases in cycles (a left one at every half, a right one at every whole), way done in m."""

_MARGIN = 5
"""Touchdowns before the first and after the last frame, so that the ends of the splines do not show."""


def step_series(
    duration_s: float,
    *,
    stride_s: float,
    stride_m: float,
    start_phase: float = 0.0,
    time_sd: float = 0.0,
    length_sd: float = 0.0,
    time_asymmetry: float = 0.0,
    length_asymmetry: float = 0.0,
    rng: RandomSource | None = None,
) -> Steps:
    """Touchdowns of both feet from well before time 0 to well after ``duration_s``.

    Parameters
    ----------
    duration_s : float
        Time that must be covered.
    stride_s, stride_m : float
        Mean time and length of two steps.
    start_phase : float
        Phase in cycles at time 0.
    time_sd, length_sd : float
        Standard deviation of the time and the length of a step, relative to their means; each is a first-order
        autoregressive sequence with correlation 0.5, drawn one apart from the other, within 3 deviations.
    time_asymmetry, length_asymmetry : float
        (left - right) / mean of the step; a left step ends when the left foot lands.
    rng : Streams or numpy.random.Generator, optional
        Needed when a standard deviation is above 0.

    Returns
    -------
    times_s, phases, way_m : ndarray, shape (K,)
        All rising; time and way are 0 at the start phase.

    Raises
    ------
    ConfigError
        If variation is asked for without ``rng``.
    """
    if rng is None and (time_sd > 0 or length_sd > 0):
        raise ConfigError(
            f"step_time_sd = {time_sd:g}, step_length_sd = {length_sd:g} need a random generator "
            "(rng=dg.rng(seed)), or set both 0"
        )
    source = None if rng is None else as_generator(rng, "motion")
    shortest = 1 - LARGEST_DEVIATION * time_sd - abs(time_asymmetry) / 2
    count = 2 * _MARGIN + math.ceil(2 * duration_s / (stride_s * shortest)) + 1
    first = math.floor(2 * start_phase) - _MARGIN
    left = np.where(np.arange(first + 1, first + count) % 2, 0.5, -0.5)
    times = _sums(stride_s / 2 * (1 + time_asymmetry * left + _deviations(time_sd, count - 1, source)))
    way = _sums(stride_m / 2 * (1 + length_asymmetry * left + _deviations(length_sd, count - 1, source)))
    phases = (first + np.arange(count)) / 2
    return _begin_at(start_phase, times, phases, way)


def _sums(steps: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(steps)])


def _deviations(sd: float, count: int, rng: np.random.Generator | None) -> FloatArray:
    if sd == 0 or rng is None:
        return np.zeros(count)
    return sd * autoregressive(count, rng)


def _begin_at(start_phase: float, times: FloatArray, phases: FloatArray, way: FloatArray) -> Steps:
    """Shift time and way so that both are 0 at the start phase."""
    start_s, start_m = cubic_spline(times, phases).where(start_phase), cubic_spline(phases, way)(start_phase)
    return times - float(start_s), phases, way - float(start_m)
