"""How a body travels: its smoothed path, where and how straight it goes, and the spectrum of its limbs' swing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.motion.clean import body_centre, stationary_points
from doppelgait.motion.gaps import fill_linear, runs

FloatArray = npt.NDArray[np.float64]

SMOOTHING_S = 0.5
"""The path of the body centre is averaged over this time: about one step of a person."""
MIN_TRAVEL_M = 0.5
"""Below this displacement there is no direction of travel, hence no fore-aft motion and no stride."""
STRIDE_BAND_HZ = (0.4, 6.0)


def smooth_path(position: FloatArray, *, rate_hz: float, smoothing_s: float = SMOOTHING_S) -> FloatArray:
    """Horizontal path of the body centre, averaged over a time, shape (T, 2).

    Parameters
    ----------
    position : ndarray, shape (T, P, 3)
        In m, NaN where missing.
    rate_hz : float
        Frames per second.
    smoothing_s : float
        Length of the average in s, 0 or more.
    """
    from scipy.ndimage import uniform_filter1d

    path = body_centre(position)[:, :2]
    width = max(1, round(smoothing_s * rate_hz)) | 1
    # a straight continuation of the ends: repeating the last value would shorten the path
    edge = min(width // 2, len(path) - 1)
    longer = np.pad(path, ((edge, edge), (0, 0)), mode="reflect", reflect_type="odd") if edge else path
    return np.asarray(uniform_filter1d(longer, width, axis=0, mode="nearest")[edge : edge + len(path)])


def travel_facts(position: FloatArray, *, rate_hz: float) -> dict[str, Any]:
    """Where and how straight the body goes: displacement, path, straightness, mean speed.

    Parameters
    ----------
    position : ndarray, shape (T, P, 3)
        In m, NaN where missing.
    rate_hz : float
        Frames per second.
    """
    path = smooth_path(position, rate_hz=rate_hz)
    if len(path) < 2 or not np.isfinite(path).all():
        return {}
    step = np.diff(path, axis=0)
    net = path[-1] - path[0]
    length = float(np.linalg.norm(step, axis=1).sum())
    along = principal_direction(path)
    offset = path - path.mean(axis=0)
    lateral = offset - np.outer(offset @ along, along)
    speed = step @ along * rate_hz
    mean_speed = float(speed.mean())
    return {
        "travel_direction": f"{along[0]:+.2f}x{along[1]:+.2f}y".replace("-0.00", "+0.00"),
        "net_displacement_m": float(np.linalg.norm(net)),
        "path_length_m": length,
        "straightness": float(np.linalg.norm(net)) / length if length > 0 else None,
        "lateral_rms_m": float(np.sqrt((lateral**2).sum(axis=1).mean())),
        "mean_speed_mps": mean_speed,
        "speed_cv": float(speed.std() / mean_speed) if mean_speed > 0 else None,
    }


def principal_direction(path: FloatArray) -> FloatArray:
    """Unit vector along which a path (T, 2) spreads most, pointing the way the body goes."""
    offset = path - path.mean(axis=0)
    along = np.linalg.svd(offset, full_matrices=False)[2][0]
    return np.asarray(-along if (path[-1] - path[0]) @ along < 0 else along)


def stride_facts(position: FloatArray, *, rate_hz: float) -> dict[str, Any]:
    """Stride and step frequency from the fore-aft motion of all points about the centre; None for a standing body.

    The spectra of all points are summed; limbs swing once per stride, so its peak is the stride frequency. A step is
    half a stride (person; trot and walk of a dog).

    Parameters
    ----------
    position : ndarray, shape (T, P, 3)
        In m, NaN where missing.
    rate_hz : float
        Frames per second.
    """
    none = {"stride_hz": None, "step_hz": None}
    position = _while_present(position)
    if len(position) < rate_hz * 0.8:
        return none
    path = smooth_path(position, rate_hz=rate_hz)
    if not np.isfinite(path).all() or np.linalg.norm(path[-1] - path[0]) < MIN_TRAVEL_M:
        return none
    from scipy.signal import detrend

    filled = fill_linear(position)
    filled = filled[:, np.isfinite(filled).all(axis=(0, 2)) & ~stationary_points(position)]
    centre = body_centre(position)
    swing = (filled[:, :, :2] - centre[:, np.newaxis, :2]) @ principal_direction(path)
    swing = detrend(swing, axis=0) * np.hanning(len(swing))[:, np.newaxis]
    n_fft = 1 << math.ceil(math.log2(len(swing) * 16))
    power = (np.abs(np.fft.rfft(swing, n_fft, axis=0)) ** 2).sum(axis=1)
    frequency = np.fft.rfftfreq(n_fft, 1.0 / rate_hz)
    band = (frequency >= STRIDE_BAND_HZ[0]) & (frequency <= STRIDE_BAND_HZ[1])
    if not power[band].any():
        return none
    best = int(np.argmax(power[band]))
    if best == 0:  # still rising towards slower motion: no stride
        return none
    stride = float(frequency[band][best])
    return {"stride_hz": stride, "step_hz": 2.0 * stride}


def _while_present(position: FloatArray) -> FloatArray:
    """Longest stretch in which at least half of the points are seen: outside it there is no gait to measure."""
    seen = np.asarray(np.isfinite(position).all(axis=2))
    seen = seen[:, seen.any(axis=0)]
    if not seen.size:
        return position
    first, stop = max(runs(seen.mean(axis=1) >= 0.5), key=lambda run: run[1] - run[0], default=(0, 0))
    return position[first:stop]
