"""Frame rate and lost frames of a recording, from what its records say."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

COUNTER_PERIOD = 2**32
LARGEST_GAP = 1_000_000
"""A counter that jumps further was restarted or is damaged; nothing follows from it."""


def frame_numbers(counters: npt.NDArray[np.uint32]) -> tuple[npt.NDArray[np.int64], int, int]:
    """Number of every frame from its 32-bit counter, and how many are lost.

    Parameters
    ----------
    counters : ndarray, shape (n,)
        Frame counters; they may run over their end.

    Returns
    -------
    numbers : ndarray, shape (n,)
        From 0, gaps included; 0, 1, 2 ... where the counters do not rise and so tell nothing.
    n_lost : int
        Frames missing between the first and the last.
    n_gaps : int
        Places where they are missing.
    """
    steps = np.mod(np.diff(counters.astype(np.int64)), COUNTER_PERIOD)
    if steps.size and (steps.min() < 1 or steps.max() > LARGEST_GAP):
        return np.arange(counters.size), 0, 0
    lost = steps - 1
    return np.concatenate([[0], np.cumsum(steps)]), int(lost.sum()), int(np.count_nonzero(lost))


def measured_rate_hz(time_ms: npt.NDArray[np.int64], numbers: npt.NDArray[np.int64]) -> float | None:
    """Frame rate from the times of the records, which are whole milliseconds and may come in bursts.

    Parameters
    ----------
    time_ms : ndarray, shape (n,)
        Times.
    numbers : ndarray, shape (n,)
        Rising numbers of the frames, gaps included.

    Returns
    -------
    float or None
        From the least-squares line through the times that lie near the line of the median slope over half the
        recording; None if there are fewer than two times or they do not rise.
    """
    n = min(time_ms.size, numbers.size)
    if n < 2:
        return None
    times, at = time_ms[:n].astype(float), numbers[:n].astype(float)
    lag = n // 2
    slope = float(np.median((times[lag:] - times[:-lag]) / (at[lag:] - at[:-lag])))
    if not slope > 0.0:
        return None
    distance = times - slope * at
    distance = np.abs(distance - np.median(distance))
    near = distance <= max(1.0, 3.0 * float(np.median(distance)))
    if np.count_nonzero(near) > 2:
        centred = at[near] - at[near].mean()
        fitted = float((centred * times[near]).sum() / (centred * centred).sum())
        slope = fitted if fitted > 0.0 else slope
    return 1000.0 / slope
