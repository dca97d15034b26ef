"""Frame rate of a recording whose frames carry their times as text."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import MotionError

FloatArray = npt.NDArray[np.float64]

MAX_RATE_HZ = 10_000.0
MIN_RATE_HZ = 1.0
JITTER = 0.01
"""Part of a frame by which a frame may be off; more would show as a false velocity."""
COARSEST = 0.4
"""Part of a frame by which printing may round its time; a frame that lacks shows as 0.5."""
INSTEAD = "or give rate_hz= if the frames are evenly spaced nevertheless"


def check_rate(path: Path, rate_hz: float | str | None, *, said: str) -> float:
    """Frame rate in Hz, if it can be one.

    Parameters
    ----------
    path : Path
        For the message.
    rate_hz : float, str or None
        What was found or given.
    said : str
        Where it comes from, for the message (``"declares"``, ``"was given"``).

    Raises
    ------
    MotionError
        If it is no number above 0 and up to 10000.
    """
    try:
        rate = float(rate_hz) if rate_hz is not None and not isinstance(rate_hz, bool) else np.nan
    except (TypeError, ValueError):
        rate = np.nan
    if not 0.0 < rate <= MAX_RATE_HZ:
        raise MotionError(
            f"{path}: {said} a frame rate of {rate_hz!r} Hz; it must be a number above 0 and at most {MAX_RATE_HZ:g}. "
            "Give the true one: rate_hz=..."
        )
    return rate


def rate_of_times(
    path: Path, time_s: FloatArray, lines: Sequence[int], *, digit_s: float, declared_hz: float | None = None
) -> float:
    """Frame rate that the times of the frames tell.

    The declared rate if the times agree with it; else the roundest that explains all times to their last printed
    digit (times printed 0.0083, 0.0167 are 120 Hz, not 120.0008 Hz); else frames by first and last time.

    Parameters
    ----------
    path : Path
        For messages.
    time_s : ndarray, shape (T,)
        Times in s, T at least 2.
    lines : sequence of int, length T
        Line of each frame, for messages.
    digit_s : float
        One unit of the last printed digit (:func:`last_digit`), s.
    declared_hz : float, optional
        What the header says.

    Returns
    -------
    float
        Hz, 1 to 10000.

    Raises
    ------
    MotionError
        If a time is missing, times do not increase, or frames are not evenly spaced to 1 % of a frame; names the line.
    """
    step = np.diff(time_s)
    if np.isnan(time_s).any():
        raise MotionError(f"{path}: line {lines[int(np.isnan(time_s).argmax())]} has no time. Put it in, {INSTEAD}.")
    if not (step > 0).all():
        k = int((step <= 0).argmax())
        raise MotionError(
            f"{path}: line {lines[k + 1]}: the time does not increase ({time_s[k]:g} s, then {time_s[k + 1]:g} s). "
            f"Correct it, {INSTEAD}."
        )
    fit = (len(time_s) - 1) / float(time_s[-1] - time_s[0])
    candidates = [declared_hz or 0.0, *(round(fit, decimals) for decimals in range(7))]
    rate = next((hz for hz in candidates if hz > 0 and _offset_s(time_s, hz) <= _rounding_s(digit_s, hz)), fit)
    if not MIN_RATE_HZ <= rate <= MAX_RATE_HZ:
        raise MotionError(
            f"{path}: its times step by {1 / fit:.6g} s, {fit:.4g} frames a second; allowed are {MIN_RATE_HZ:g} to "
            f"{MAX_RATE_HZ:g}. If they are no seconds, give the rate: rate_hz=..."
        )
    if _offset_s(time_s, rate) > max(_rounding_s(digit_s, rate), JITTER / rate):
        odd = int(np.abs(step - np.median(step)).argmax())
        raise MotionError(
            f"{path}: line {lines[odd + 1]}: the time steps by {step[odd]:.6g} s, the frames are mostly "
            f"{np.median(step):.6g} s apart. Frames must be evenly spaced: put missing ones in with blank cells, "
            f"resample, {INSTEAD}."
        )
    return rate


def _offset_s(time_s: FloatArray, rate_hz: float) -> float:
    """Largest distance of a time from evenly spaced frames that lie as near as they can."""
    return float(np.ptp(time_s - np.arange(len(time_s)) / rate_hz)) / 2.0


def _rounding_s(digit_s: float, rate_hz: float) -> float:
    """Distance that rounding to the last digit explains."""
    return min(0.5 * digit_s * (1.0 + 1e-6), COARSEST / rate_hz)


def last_digit(cells: Sequence[str], time_s: FloatArray, factor: float = 1.0) -> float:
    """One unit of the last printed digit of a column of times, in s; at least 1e-8 of the largest time.

    Parameters
    ----------
    cells : sequence of str
        Times as printed.
    time_s : ndarray
        The same in s, NaN where missing.
    factor : float
        Seconds per printed unit.
    """
    decimals = max((len(cell.strip().partition(".")[2]) for cell in cells if "e" not in cell.lower()), default=15)
    # numbers printed to nine significant digits have fewer decimals where they are large
    return max(10.0**-decimals * factor, 1e-8 * float(np.abs(np.nan_to_num(time_s)).max()))
