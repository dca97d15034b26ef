"""From a raw recording to a motion without gaps, spikes, jitter and points that are no part of the body."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.errors import MotionError
from doppelgait.motion.gaps import fill_gaps, fill_linear, remove_spikes, runs
from doppelgait.motion.schema import FACTS, make_motion
from doppelgait.motion.skeleton import FOOT_PARTS

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

MIN_MARKERS = 3
MIN_DURATION_S = 0.5
STATIONARY_M = 0.03
MOVING_BODY_M = 0.5
MIN_RATE_PER_CUTOFF = 3.0
MAX_MISSING = 0.6
"""Points missing in a larger part of the frames do not count for the centre of the body."""
FILTER_ORDER = 4
MEMORY_S, FIT_S, PREDICTION_NOISE_M = 0.1, 1.0, 1e-3
"""Ends are continued for twice the memory of the prediction, which is fitted to the last second as if it had 1 mm of
noise: that keeps it from growing."""


def clean_motion(
    motion: xr.DataArray,
    *,
    gap_limit_s: float = 0.25,
    lowpass_hz: float | None = 12.0,
    floor: bool = True,
    min_duration_s: float = MIN_DURATION_S,
) -> xr.DataArray:
    """Prepare a recording for the radar: no gaps, only points of the body, smooth, floor at z = 0.

    Spikes become gaps; points that never show or stand still while the body walks away are dropped; gaps are filled
    by a cubic spline; the stretch and the points that together give the most complete data are kept; positions are
    low-passed (E-02) and put on the floor (E-01).

    Parameters
    ----------
    motion : xarray.DataArray
        Motion (time, marker, space) in m, z up, NaN where a point was not seen.
    gap_limit_s : float
        Longest gap that is filled, in s, 0 or more.
    lowpass_hz : float or None
        Corner frequency of the low-pass in Hz, above 0; None leaves the positions as they are. Recordings with fewer
        than three frames per period of it are left as they are, too.
    floor : bool
        Shift z so that the floor is at 0.
    min_duration_s : float
        Shortest stretch that is accepted, in s.

    Returns
    -------
    xarray.DataArray
        Motion without NaN; what was done is in ``attrs["report"]``.

    Raises
    ------
    MotionError
        If a parameter is out of range, or fewer than 3 points or less than ``min_duration_s`` remain.
    """
    _check_parameters(gap_limit_s, lowpass_hz)
    where, rate = motion.attrs["source"] or "motion", float(motion.attrs["rate_hz"])
    position = np.array(motion.values, dtype=np.float64)
    names, parts = [str(n) for n in motion.marker.values], [str(p) for p in motion.part.values]
    spikes = remove_spikes(position, rate_hz=rate)
    dropped = _useless_points(position, parts)
    kept = np.array([i for i in range(len(names)) if i not in dropped], dtype=int)
    filled, fill_facts = fill_gaps(position[:, kept], gap_limit=round(gap_limit_s * rate))
    first, stop, complete = _best_stretch(np.asarray(np.isfinite(filled).all(axis=2)))
    dropped |= {int(i): f"not seen throughout (gaps up to {gap_limit_s:g} s are filled)" for i in kept[~complete]}
    kept, filled = kept[complete], filled[first:stop, complete]
    _check_remains(where, len(kept), (stop - first) / rate, min_duration_s, names, dropped)
    smooth = lowpass(filled, rate_hz=rate, cutoff_hz=lowpass_hz) if _can_lowpass(rate, lowpass_hz) else filled
    kept_names, kept_parts = [names[i] for i in kept], [parts[i] for i in kept]
    floor_m = floor_height(smooth, kept_parts) if floor else 0.0
    smooth = smooth - np.array([0.0, 0.0, floor_m])
    report = {
        **motion.attrs["report"],
        **fill_facts,
        "spikes_removed": spikes,
        "dropped": _merge(motion.attrs["report"].get("dropped", {}), names, dropped),
        "points_kept": len(kept),
        "kept_from_s": first / rate,
        "kept_to_s": (stop - 1) / rate,
        "lowpass_hz": lowpass_hz if _can_lowpass(rate, lowpass_hz) else None,
        "floor_shift_m": -floor_m,
    }
    facts = {key: motion.attrs[key] for key in FACTS if key in motion.attrs} | {"report": report}
    if not math.isfinite(facts["height_m"]):
        facts["height_m"] = stature(smooth, kept_parts)
    return make_motion(smooth, rate_hz=rate, markers=kept_names, parts=kept_parts, facts=facts)


def _check_parameters(gap_limit_s: float, lowpass_hz: float | None) -> None:
    if not gap_limit_s >= 0.0:
        raise MotionError(f"gap_limit_s={gap_limit_s!r} is not allowed; it must be 0 s or more")
    if lowpass_hz is not None and not lowpass_hz > 0.0:
        raise MotionError(f"lowpass_hz={lowpass_hz!r} is not allowed; it must be above 0 Hz, or None for no low-pass")


def _can_lowpass(rate_hz: float, lowpass_hz: float | None) -> bool:
    return lowpass_hz is not None and rate_hz >= MIN_RATE_PER_CUTOFF * lowpass_hz


def _merge(before: dict[str, list[str]], names: Sequence[str], dropped: dict[int, str]) -> dict[str, list[str]]:
    table = {reason: list(points) for reason, points in before.items()}
    for i in sorted(dropped):
        table.setdefault(dropped[i], []).append(names[i])
    return table


def _check_remains(
    where: str, n_markers: int, duration_s: float, min_duration_s: float, names: Sequence[str], dropped: dict[int, str]
) -> None:
    if n_markers >= MIN_MARKERS and duration_s >= min_duration_s:
        return
    reasons = sorted(set(dropped.values()))
    raise MotionError(
        f"{where}: {n_markers} of {len(names)} points over {duration_s:.2f} s remain after cleaning, {MIN_MARKERS} "
        f"points over {min_duration_s:g} s are needed. Points dropped: {'; '.join(reasons) or 'none'}. Give another "
        "part (start_s, stop_s) or a larger gap_limit_s."
    )


def _useless_points(position: FloatArray, parts: Sequence[str]) -> dict[int, str]:
    """Points never seen, and points that stand still while the body moves away from them."""
    seen = np.isfinite(position).all(axis=2)
    reasons = {int(i): "never seen" for i in np.flatnonzero(~seen.any(axis=0))}
    still = stationary_points(position)
    centre = body_centre(position)
    path = centre[np.isfinite(centre).all(axis=1), :2]
    if path.size and float(np.linalg.norm(np.ptp(path, axis=0))) > MOVING_BODY_M:
        reasons |= {int(i): "stands still while the body moves" for i in np.flatnonzero(still) if int(i) not in reasons}
    return reasons


def stationary_points(position: FloatArray, *, limit_m: float = STATIONARY_M) -> BoolArray:
    """Points whose total excursion (diagonal of the box that holds them) stays below a limit, shape (P,).

    Parameters
    ----------
    position : ndarray, shape (T, P, 3)
        In m, NaN where missing.
    limit_m : float
        Excursion in m.
    """
    low = np.where(np.isnan(position), np.inf, position).min(axis=0, initial=np.inf)
    high = np.where(np.isnan(position), -np.inf, position).max(axis=0, initial=-np.inf)
    with np.errstate(invalid="ignore"):
        excursion = np.linalg.norm(high - low, axis=1)
    return np.asarray(np.isfinite(excursion) & (excursion < limit_m))


def body_centre(position: FloatArray) -> FloatArray:
    """Mean of the points that move and are seen in at least 40 % of the frames, gaps filled linearly, shape (T, 3).

    Parameters
    ----------
    position : ndarray, shape (T, P, 3)
        In m, NaN where missing.
    """
    if not len(position):
        return np.empty((0, 3))
    missing = np.isnan(position).any(axis=2).mean(axis=0)
    moving = ~stationary_points(position)
    chosen = moving & (missing <= MAX_MISSING)
    for fallback in (moving & (missing < 1.0), missing < 1.0):
        chosen = chosen if chosen.any() else fallback
    if not chosen.any():
        return np.full((position.shape[0], 3), np.nan)
    return np.asarray(fill_linear(position[:, chosen]).mean(axis=1))


def _best_stretch(seen: BoolArray) -> tuple[int, int, BoolArray]:
    """Stretch without gaps and its points, for the largest number of samples: frames times points.

    Points are given up one by one, the one seen least first; what is complete in the stretch stays all the same.
    """
    best, score = (0, 0), -1
    order = np.argsort(-(~seen).sum(axis=0), kind="stable")
    for given_up in range(max(1, len(order) - MIN_MARKERS + 1)):
        rest = order[given_up:]
        whole = runs(np.asarray(seen[:, rest].all(axis=1))) if rest.size else []
        a, b = max(whole, key=lambda run: run[1] - run[0], default=(0, 0))
        if (b - a) * len(rest) > score:
            best, score = (a, b), (b - a) * len(rest)
    first, stop = best
    complete = np.asarray(seen[first:stop].all(axis=0)) & (stop > first)
    return first, stop, complete


def lowpass(position: FloatArray, *, rate_hz: float, cutoff_hz: float | None) -> FloatArray:
    """Zero-phase low-pass: a fourth-order Butterworth, forwards and backwards, half power at the cutoff (E-02).

    Before filtering, the ends are continued by linear prediction. The usual point reflection alone bends the path at
    the ends and spoils the velocity there by a tenth of its peak.

    Parameters
    ----------
    position : ndarray, shape (T, P, 3)
        In m, no NaN.
    rate_hz : float
        Frames per second, more than twice the cutoff.
    cutoff_hz : float or None
        Frequency at which half the power is left, in Hz; None for no filter.
    """
    from scipy.signal import butter, sosfiltfilt

    if cutoff_hz is None:
        return position
    # two passes lose 3 dB together where each loses 1.5 dB: pre-warped bilinear corner of one pass
    widening = (math.sqrt(2.0) - 1.0) ** (-1.0 / (2 * FILTER_ORDER))
    corner = 2.0 / math.pi * math.atan(math.tan(math.pi * cutoff_hz / rate_hz) * widening)
    sections = butter(FILTER_ORDER, corner, output="sos")
    n_edge, memory = round(2 * MEMORY_S * rate_hz), max(4, round(MEMORY_S * rate_hz))
    flat = position.reshape(len(position), -1)
    recent = round(FIT_S * rate_hz)
    before = _continue(flat[::-1][-recent:], n_edge, memory)[::-1]
    longer = np.concatenate([before, flat, _continue(flat[-recent:], n_edge, memory)])
    smooth = sosfiltfilt(sections, longer, axis=0, padlen=min(memory, len(longer) - 1))
    return np.asarray(smooth[n_edge : n_edge + len(flat)], dtype=np.float64).reshape(position.shape)


def _continue(recent: FloatArray, n_frames: int, memory: int) -> FloatArray:
    """Next ``n_frames`` of each column: its straight trend plus the linear prediction of what remains."""
    steps = np.arange(len(recent) + n_frames) - (len(recent) - 1.0)
    trend = np.polynomial.polynomial.polyval(steps, np.polynomial.polynomial.polyfit(steps[: len(recent)], recent, 1)).T
    rest = recent - trend[: len(recent)]
    memory = min(memory, len(recent) // 3)
    windows = np.lib.stride_tricks.sliding_window_view(rest, memory + 1, axis=0)
    past, now = windows[..., :memory], windows[..., memory]
    normal = np.einsum("tci,tcj->cij", past, past) + len(past) * PREDICTION_NOISE_M**2 * np.eye(memory)
    weights = np.linalg.solve(normal, np.einsum("tci,tc->ci", past, now)[..., np.newaxis])[..., 0]
    ahead = list(rest[len(rest) - memory :])
    for _ in range(n_frames):
        ahead.append(np.einsum("ic,ci->c", np.array(ahead[-memory:]), weights))
    return np.asarray(np.array(ahead[memory:]) + trend[len(recent) :], dtype=np.float64)


def floor_height(position: FloatArray, parts: Sequence[str]) -> float:
    """Height of the floor in m: 1st percentile of the feet's z (E-01), or of the three lowest points' z.

    A body whose parts are known but whose feet were not recorded stays where it is, unless it reaches below z = 0.

    Parameters
    ----------
    position : ndarray, shape (T, P, 3)
        In m, z up, no NaN.
    parts : sequence of str, length P
        Body part of each point.
    """
    feet = [i for i, part in enumerate(parts) if part in FOOT_PARTS]
    lowest = feet or list(np.argsort(position[:, :, 2].min(axis=0))[:3])
    height = float(np.percentile(position[:, lowest, 2], 1))
    return min(height, 0.0) if any(parts) and not feet else height


def stature(position: FloatArray, parts: Sequence[str]) -> float:
    """Height of a person in m: median over time of the highest head point, or of the highest point, above z = 0.

    Parameters
    ----------
    position : ndarray, shape (T, P, 3)
        In m, floor at z = 0, no NaN.
    parts : sequence of str, length P
        Body part of each point.
    """
    head = [i for i, part in enumerate(parts) if part == "head"] or list(range(len(parts)))
    return float(np.median(position[:, head, 2].max(axis=1)))
