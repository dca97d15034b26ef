"""Cleaning of recordings: swapped names, jumps, gaps, spikes, noise and foreign points."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import DoppelgaitWarning, MotionError, warn_caller
from doppelgait.core.units import FloatArray
from doppelgait.motion.ground import belt_velocity_mps, format_belt_note, level_floor, measure_floor
from doppelgait.motion.motion import Motion, make_motion
from doppelgait.motion.skeleton import (
    BODY_CENTRE_PARTS,
    DOG_PARTS,
    FOOT_PARTS,
    HUMAN_PARTS,
    RIGID_M,
    find_bones,
    measure_height,
    restore_lengths,
)

BoolArray = npt.NDArray[np.bool_]


JUMP = {"floor_m": 0.05, "jerk_mps3": 6_000.0}
"""Limits of a jump between two frames: more than 5 cm and more than this jerk explains."""
SWAP = {"floor_m": 0.02, "jerk_mps3": 1_300.0}
"""Limits of both steps of a swap, smaller than for a jump: matching steps are rarely noise."""
SWAP_RATIO = 0.3
"""Maximum ratio of the steps of two points after and before an exchange."""
MAX_BRIDGE_S = 0.1
"""Longest gap across which a path is continued."""
MAX_SWAPS = 200
SAME_PLACE_M, NEARLY_SAME_PLACE_M = 0.005, 0.02
"""Distances below which two points are the same: in half of the frames, and in 95 % of them."""
MOVING_M = 0.03
FAR_M, FAR_FACTOR = 1.5, 4.0
SHORT_LIVED = 0.2
N_LOOKS = 200
"""Number of evenly spaced frames at which distances between points are compared."""


def repair_swaps(position: FloatArray, names: Sequence[str], *, rate_hz: float) -> list[dict[str, Any]]:
    """Exchange the paths of swapped names, in place. Shapes: position (T, P, 3)."""
    swaps: list[dict[str, Any]] = []
    step, limit = find_steps(position, rate_hz=rate_hz, **SWAP)
    frame = 0
    while len(swaps) < MAX_SWAPS:
        pair, frame = _find_next_swap(position, step, limit, first=frame, rate_hz=rate_hz)
        if not pair:
            break
        position[frame:, pair] = position[frame:, pair[::-1]]
        step[:, pair], limit[:, pair] = find_steps(position[:, pair], rate_hz=rate_hz, **SWAP)
        swaps.append({"frame": frame, "points": sorted(names[i] for i in pair)})
    return swaps


def _find_next_swap(
    position: FloatArray, step: FloatArray, limit: FloatArray, *, first: int, rate_hz: float
) -> tuple[list[int], int]:
    # if several pairs have swapped, those with the largest reduction are returned
    stepping = step[first:] > limit[first:]
    for frame in (int(k) + first for k in np.flatnonzero(stepping.sum(axis=1) >= 2)):
        points = np.flatnonzero(stepping[frame - first])
        # remaining step [i, j] if the path of point i continues as that of j from this frame on
        start = max(0, frame - 2 - max(1, round(MAX_BRIDGE_S * rate_hz)))
        near = position[start : frame + 2, points]
        last, arriving, leaving, gap = (values[frame - start] for values in _find_paths(near, rate_hz))
        predicted = last[:, np.newaxis] + gap[:, np.newaxis, np.newaxis] * (arriving[:, np.newaxis] + leaving) / 2
        rest, before = np.linalg.norm(near[frame - start] - predicted, axis=2), step[frame, points]
        least = np.minimum(before[:, np.newaxis], before)
        fits = np.maximum(rest, rest.T) < SWAP_RATIO * least
        gain = np.where(fits, before[:, np.newaxis] + before - rest - rest.T, 0.0)
        np.fill_diagonal(gain, 0.0)
        if gain.max() > 0.0:
            i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
            return [int(points[i]), int(points[j])], frame
    return [], len(step)


def find_jumps(position: FloatArray, names: Sequence[str], *, rate_hz: float) -> list[dict[str, Any]]:
    """Find steps off a smooth path. The positions are not changed. Shapes: position (T, P, 3)."""
    step, limit = find_steps(position, rate_hz=rate_hz, **JUMP)
    known = np.pad(np.nan_to_num(step, nan=-1.0), ((1, 1), (0, 0)), constant_values=-1.0)
    # a jump disturbs the adjacent velocities: the frames before and after have apparent steps of half the size
    peak = (step > limit) & (known[1:-1] > known[:-2]) & (known[1:-1] >= known[2:])
    found = [{"frame": int(k), "point": names[p], "step_m": round(float(step[k, p]), 4)} for k, p in np.argwhere(peak)]
    return sorted(found, key=lambda jump: (jump["frame"], jump["point"]))


def find_steps(
    position: FloatArray, *, rate_hz: float, floor_m: float, jerk_mps3: float
) -> tuple[FloatArray, FloatArray]:
    """Measure every step against its prediction."""
    # the prediction is the sample before, continued with the mean of both adjacent velocities
    last, before, after, gap = _find_paths(position, rate_hz)
    step = np.linalg.norm(position - last - gap[..., np.newaxis] * (before + after) / 2, axis=2)
    return step, np.maximum(floor_m, jerk_mps3 * (gap / rate_hz) ** 2 * (gap / rate_hz) / 2)


def _find_paths(position: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return each point's last sample, velocity and gap."""
    # velocities are per frame, at the last sample and from the frame on; the gap is in frames
    n_frames, n_points = position.shape[:2]
    seen, point = np.isfinite(position).all(axis=2), np.arange(n_points)
    frames = np.arange(n_frames)[:, np.newaxis]
    latest = np.maximum.accumulate(np.where(seen, frames, 0), axis=0)
    previous = np.concatenate([np.zeros((1, n_points), dtype=int), latest[:-1]])
    gap = (frames - previous).astype(np.float64)
    gap[(gap > max(1, round(MAX_BRIDGE_S * rate_hz))) | (gap < 1)] = np.nan
    none = np.full((1, n_points, 3), np.nan)
    velocity = np.concatenate([none, np.diff(position, axis=0), none])
    return position[previous, point], velocity[previous, point], velocity[1:], gap


def find_useless_points(position: FloatArray, names: Sequence[str], parts: Sequence[str]) -> dict[int, str]:
    """Find short-lived, duplicate and distant points. Shapes: position (T, P, 3)."""
    n_seen = np.isfinite(position).all(axis=2).sum(axis=0)
    usual = float(np.median(n_seen[n_seen > 0])) if (n_seen > 0).any() else 0.0
    brief = [i for i, part in enumerate(parts) if not part and 0 < n_seen[i] < SHORT_LIVED * usual]
    reasons = dict.fromkeys(brief, "short-lived unknown point")
    n_frames = len(position)
    frames = np.unique(np.linspace(0, max(0, n_frames - 1), min(n_frames, N_LOOKS)).round().astype(int))
    position = position[frames]
    # points far from the middle of the body
    occupied = position[np.asarray(np.isfinite(position).all(axis=2)).any(axis=1)]
    if occupied.size:
        distance = np.linalg.norm(occupied - np.nanmedian(occupied, axis=1, keepdims=True), axis=2)
        seen = np.asarray(np.isfinite(distance).sum(axis=0) > 0)
        typical = np.full(len(seen), np.nan)
        typical[seen] = np.nanmedian(distance[:, seen], axis=0)
        limit = max(FAR_M, FAR_FACTOR * float(np.nanmedian(typical)))
        far = (int(i) for i in np.flatnonzero(typical > limit))
        reasons |= {i: "far away from the body" for i in far if i not in reasons}
    # points of lower rank at the place of one of higher rank
    rank = sorted(range(len(names)), key=lambda i: (i in reasons, -n_seen[i], not parts[i], names[i]))
    doubles: dict[int, str] = {}
    for n, i in enumerate(rank):
        others = np.array([j for j in rank[n + 1 :] if j not in doubles], dtype=int)
        if i in doubles or not others.size:
            continue
        distance = np.linalg.norm(position[:, others] - position[:, [i]], axis=2)
        for k in np.flatnonzero((distance < SAME_PLACE_M).sum(axis=0) >= 2):
            seen = np.isfinite(distance[:, k])
            median, nearly_all = np.percentile(distance[seen, k], (50, 95))
            # points at rest are not compared
            moves = float(np.linalg.norm(np.ptp(position[seen, others[k]], axis=0))) > MOVING_M
            if moves and median < SAME_PLACE_M and nearly_all < NEARLY_SAME_PLACE_M:
                doubles[int(others[k])] = f"at the place of {names[i]}"
    return reasons | {i: why for i, why in doubles.items() if i not in reasons}


SPIKE_M, SPIKE_ACCELERATION_MPS2, BESIDE_MPS = 0.05, 400.0, 30.0
"""A spike is farther from its neighbours than this and, beside a gap, than this speed explains."""


def remove_spikes(position: FloatArray, *, rate_hz: float) -> int:
    """Replace spikes of one or two frames by gaps. Shapes: position (T, P, 3)."""
    if position.shape[0] < 5:
        return 0
    limit = max(SPIKE_M, SPIKE_ACCELERATION_MPS2 / rate_hz**2)
    padded = np.pad(position, ((2, 2), (0, 0), (0, 0)), mode="reflect", reflect_type="odd")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 5, axis=0)
    usual = np.median(windows, axis=-1)
    beside = np.isnan(usual).any(axis=2) & np.isfinite(position).all(axis=2)
    usual[beside] = np.nanmedian(windows[beside], axis=-1)
    away = np.linalg.norm(position - usual, axis=2)
    spiky = away > np.where(beside, max(limit, BESIDE_MPS * 2 / rate_hz), limit)  # it flies off before it is lost
    position[spiky] = np.nan
    return int(spiky.sum())


HELD_M, HELD_RATIO, LANDS, DIGITS = 0.005, 1.5, 0.7, 3.0
"""A held sample ends in a step of more than 5 mm that exceeds the next one by this factor: a foot that starts to move
speeds up. At an end of the recording, it follows steps that do not shrink by this factor: a landing foot slows down."""


def remove_held_samples(position: FloatArray) -> int:
    """Replace repeated samples that end in a jump by gaps, in place. Shapes: position (T, P, 3)."""
    # programs write the last position of a lost marker again, or every frame of a slow camera twice
    step = np.full((len(position) + 1, position.shape[1]), np.nan)
    moves = np.abs(np.diff(position, axis=0))
    step[1:-1] = np.linalg.norm(moves, axis=2)
    count = 0
    for p in np.flatnonzero((step == 0.0).any(axis=0)):
        # a step of rounded positions is no jump
        least_m = max(HELD_M, DIGITS * float(moves[:, p][moves[:, p] > 0].min(initial=math.inf)))
        for first, stop in find_runs(step[:, p] == 0.0):  # samples first to stop - 1 equal the one before
            before, after = step[first - 1, p], step[stop, p]
            beyond = [step[k, p] if 0 < k < len(position) else math.nan for k in (first - 2, stop + 1)]
            if stop == len(position) or first == 1:
                near, next_m = (before, beyond[0]) if stop == len(position) else (after, beyond[1])
                held = stop - first > 1 and near > least_m and near > LANDS * next_m
            else:
                held = after > max(least_m, HELD_RATIO * np.nan_to_num(beyond[1])) and before > 0
            if held:
                a, b = (first - 1, stop - 1) if first == 1 else (first, stop)
                position[a:b, p] = np.nan
                count += b - a
    return count


def fill_linear(position: FloatArray) -> FloatArray:
    """Fill every gap by linear interpolation. Shapes: position (T, P, 3)."""
    # at the ends, the nearest value is repeated. Points that are never seen stay NaN.
    filled = position.copy()
    frames = np.arange(position.shape[0])
    for p in range(position.shape[1]):
        seen = np.asarray(np.isfinite(position[:, p]).all(axis=1))
        if seen.any() and not seen.all():
            for k in range(3):
                filled[:, p, k] = np.interp(frames, frames[seen], position[seen, p, k])
    return filled


def fill_gaps(position: FloatArray, *, gap_limit: int) -> tuple[FloatArray, dict[str, Any]]:
    """Fill gaps in paths (T, P, 3) by a cubic spline."""
    from scipy.interpolate import CubicSpline

    filled = position.copy()
    lengths: list[int] = []
    for p in range(position.shape[1]):
        seen = np.asarray(np.isfinite(position[:, p]).all(axis=1))
        gaps = [(a, b) for a, b in find_runs(~seen) if a > 0 and b < len(seen) and b - a <= gap_limit]
        filled[~seen, p] = np.nan
        if not gaps or seen.sum() < 4:
            continue
        spline = CubicSpline(np.flatnonzero(seen), position[seen, p])
        for a, b in gaps:
            filled[a:b, p] = spline(np.arange(a, b))
            lengths.append(b - a)
    return filled, {
        "gaps_filled": len(lengths),
        "samples_filled": sum(lengths),
        "longest_gap_filled": max(lengths, default=0),
    }


MIN_KEPT = 0.5
"""Share of the samples below which frames and points are chosen anew after filling by segments."""
FEWEST_NEIGHBOURS, MOST_NEIGHBOURS, MOST_BONES = 2, 6, 3
FILL_RIDGE, FILL_STEPS = 0.02, 10


def fill_from_segment(position: FloatArray, *, gap_limit: int) -> tuple[FloatArray, int]:
    """Fill longer gaps (T, P, 3) from points at constant distances."""
    # markers of one rigid segment keep their distances, and so does a marker on a joint to both its segments. Three
    # points fix a position; with two, the positions before and after the gap are also needed
    from scipy.interpolate import CubicSpline
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    seen: BoolArray = np.asarray(np.isfinite(position).all(axis=2))
    filled, count = position.copy(), 0
    apart: FloatArray | None = None
    for p in range(position.shape[1]):
        gaps = [(a, b) for a, b in find_runs(~seen[:, p]) if b - a > gap_limit and a > 0 and b < len(position)]
        if not gaps:
            continue
        if apart is None:  # number of bones between two points: limbs swing together at constant distances, too
            ends = find_bones(position).T
            bones = coo_matrix((np.ones(ends.shape[1]), ends), shape=(seen.shape[1],) * 2)
            apart = dijkstra(bones, directed=False, unweighted=True)
        distance = np.linalg.norm(position - position[:, [p]], axis=2)
        together = np.isfinite(distance).sum(axis=0)
        mean_m = np.nansum(distance, axis=0) / np.maximum(together, 1)
        sway_m = np.sqrt(np.nansum((distance - mean_m) ** 2, axis=0) / np.maximum(together, 1))
        sway_m[(together < max(gap_limit, MIN_MARKERS)) | (apart[p] > MOST_BONES) | (apart[p] == 0)] = math.inf
        steady = np.argsort(sway_m, kind="stable")
        steady = steady[sway_m[steady] < RIGID_M]
        for a, b in gaps:
            near = steady[seen[a - 1 : b + 1, steady].all(axis=0)][:MOST_NEIGHBOURS].tolist()
            if len(near) < FEWEST_NEIGHBOURS:
                continue
            share = np.linspace(0.0, 1.0, b - a + 2)[:, np.newaxis]
            middle = position[:, near].mean(axis=1)
            both = np.flatnonzero(seen[:, [p, *near]].all(axis=1))
            start = middle[a - 1 : b + 1] + CubicSpline(both, (position[:, p] - middle)[both])(np.arange(a - 1, b + 1))
            bars = np.array([[0, n + 1] for n in range(len(near))], dtype=np.int32)
            points = np.concatenate([start[:, np.newaxis], position[a - 1 : b + 1, near]], axis=1)
            weights = np.array([1.0] + [1e9] * len(near))
            made = restore_lengths(points, bars, mean_m[near], weights, ridge=FILL_RIDGE, steps=FILL_STEPS)[:, 0]
            rest = position[[a - 1, b], p] - made[[0, -1]]
            filled[a:b, p] = (made + (1.0 - share) * rest[0] + share * rest[1])[1:-1]
            count += b - a
    return filled, count


def find_runs(mask: BoolArray) -> list[tuple[int, int]]:
    """Return start and stop of every run of true values."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


MIN_RATE_PER_CUTOFF = 3.0  # frames per period of the cut-off that the filter needs
FILTER_ORDER = 4
MOST_GROWTH = 1.5
MEMORY_S, FIT_S, PREDICTION_NOISE_M = 0.1, 1.0, 1e-3
"""Memory of the linear prediction, time that it is fitted to, and assumed noise. The ends are
continued for twice the memory. The assumed noise keeps the prediction from growing."""


def filter_lowpass(position: FloatArray, *, rate_hz: float, cutoff_hz: float | None) -> FloatArray:
    """Low-pass positions with zero phase (E-02)."""
    # a fourth-order Butterworth filter, forwards and backwards, with half power at the cutoff
    from scipy.signal import butter, sosfiltfilt

    if cutoff_hz is None:
        return position
    # two passes attenuate by 3 dB where each does by 1.5 dB: pre-warped bilinear corner of one pass
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


NOISE_MPS = 0.1
"""Largest error of a point's velocity from noise, rms per coordinate. More widens the trunk's line in a signature."""
NOISE_FROM_HZ = 10.0


def measure_noise(position: FloatArray, *, rate_hz: float) -> float:
    """Measure the white noise of positions, m per coordinate. Shapes: position (T, P, 3)."""
    from scipy.signal import periodogram

    # a body moves little above 10 Hz; the spectrum of noise is flat there. The median ignores points that differ
    steps = np.arange(len(position)) - (len(position) - 1) / 2
    trend = steps[:, np.newaxis, np.newaxis] * (np.tensordot(steps, position, 1) / (steps @ steps))
    frequency, power = periodogram(position - trend, rate_hz, window="hann", axis=0)
    band = (frequency >= max(rate_hz / 4, min(NOISE_FROM_HZ, 0.4 * rate_hz))) & (frequency < 0.49 * rate_hz)
    return math.sqrt(float(np.median(power[band].mean(axis=0))) * rate_hz / 2) if band.sum() > 2 else 0.0


def velocity_error_mps(noise_m: float, bandwidth_hz: float, *, rate_hz: float) -> float:
    """Return the velocity error of white noise up to a frequency, rms per coordinate."""
    # noise of the density noise^2 / (rate / 2), times (2 pi f)^2, integrated up to the bandwidth
    return 2 * math.pi * noise_m * math.sqrt(2 * bandwidth_hz**3 / (3 * rate_hz))


def choose_cutoff_hz(noise_m: float, *, rate_hz: float, cutoff_hz: float | None) -> float | None:
    """Return the cut-off of the low-pass, lower for noisy positions."""
    if cutoff_hz is None:
        return None
    usual_hz = cutoff_hz if rate_hz >= MIN_RATE_PER_CUTOFF * cutoff_hz else None
    if velocity_error_mps(noise_m, usual_hz or rate_hz / 2, rate_hz=rate_hz) <= NOISE_MPS:
        return usual_hz
    return math.cbrt(1.5 * rate_hz * (NOISE_MPS / (2 * math.pi * noise_m)) ** 2)


def _continue(recent: FloatArray, n_frames: int, memory: int) -> FloatArray:
    """Continue columns by linear prediction about their trend."""
    # a jump in the recent frames can make the prediction grow
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
    predicted = np.array(ahead[memory:])
    reflected = 2.0 * rest[-1] - rest[::-1][1 : n_frames + 1]
    grows = np.abs(predicted).max(axis=0) > MOST_GROWTH * np.abs(rest).max(axis=0)
    return np.asarray(np.where(grows, reflected, predicted) + trend[len(recent) :], dtype=np.float64)


MIN_MARKERS = 3
LARGEST_M = 1e4
MIN_DURATION_S = 0.5
GAP_LIMIT_S = 0.25  # longest gap that is filled without other points of the segment
STATIONARY_M = 0.03
MOVING_BODY_M = 0.5
MAX_MISSING = 0.6
"""Largest share of missing frames of a point that contributes to the centre of the body."""


def clean_motion(
    motion: Motion, *, lowpass_hz: float | None = 12.0, floor: bool = True, whole: Motion | None = None
) -> Motion:
    """Make a recording smooth, complete and on the floor."""
    # swapped names are corrected and spikes become gaps, longer jumps are only reported; then gaps
    # are filled, points dropped, positions low-passed (E-02) and put on the floor (E-01)
    where, rate, gap_limit = motion.label, motion.rate_hz, round(GAP_LIMIT_S * motion.rate_hz)
    position = np.array(motion.position_m, dtype=np.float64)
    largest_m = np.abs(position[np.isfinite(position)]).max(initial=0.0)
    if largest_m > LARGEST_M:
        raise MotionError(
            f"{where}: a coordinate is {largest_m:.3g} m, but at most {LARGEST_M:g} m is allowed; give the "
            "right unit (units=...), or repair the file"
        )
    names, parts = motion.markers, motion.parts
    # all change the positions in place
    held = remove_held_samples(position)
    swaps = repair_swaps(position, names, rate_hz=rate)
    spikes = remove_spikes(position, rate_hz=rate)
    jumps = find_jumps(position, names, rate_hz=rate)
    unmoved = {int(i): "never seen" for i in np.flatnonzero(~np.isfinite(position).all(axis=2).any(axis=0))}
    centre = find_body_centre(position)
    path = centre[np.isfinite(centre).all(axis=1), :2]
    if path.size and float(np.linalg.norm(np.ptp(path, axis=0))) > MOVING_BODY_M:
        still = map(int, np.flatnonzero(find_stationary_points(position)))
        unmoved |= {i: "stands still while the body moves" for i in still if i not in unmoved}
    dropped = find_useless_points(position, names, parts) | unmoved
    kept = np.array([i for i in range(len(names)) if i not in dropped], dtype=int)
    filled, fill_facts = fill_gaps(position[:, kept], gap_limit=gap_limit)
    kept_names = [names[i] for i in kept]
    first, stop, complete = _find_best_segment(np.asarray(np.isfinite(filled).all(axis=2)), kept_names)
    few = (stop - first) * complete.sum() < MIN_KEPT * filled[..., 0].size
    filled, n_from_segment = fill_from_segment(filled, gap_limit=gap_limit)
    if n_from_segment and few:
        first, stop, complete = _find_best_segment(np.asarray(np.isfinite(filled).all(axis=2)), kept_names)
    complete |= np.asarray(np.isfinite(filled[first:stop]).all(axis=(0, 2))) & (stop > first)
    dropped |= {int(i): f"not seen throughout (gaps up to {GAP_LIMIT_S:g} s are filled)" for i in kept[~complete]}
    kept, filled = kept[complete], filled[first:stop, complete]
    duration_s = (stop - first) / rate
    if len(kept) < MIN_MARKERS or not duration_s >= MIN_DURATION_S:
        reasons = sorted(set(dropped.values()))
        raise MotionError(
            f"{where}: {len(kept)} of {len(names)} points over {duration_s:.2f} s remain after cleaning; {MIN_MARKERS} "
            f"points over {MIN_DURATION_S:g} s are needed. Points dropped: {'; '.join(reasons) or 'none'}. Give "
            "another part: start_s, stop_s."
        )
    dropped_names = {reason: list(points) for reason, points in motion.report.get("dropped", {}).items()}
    for i in sorted(dropped):
        dropped_names.setdefault(dropped[i], []).append(names[i])
    noise_m = measure_noise(filled, rate_hz=rate)
    cutoff_hz = choose_cutoff_hz(noise_m, rate_hz=rate, cutoff_hz=lowpass_hz)
    smooth = filter_lowpass(filled, rate_hz=rate, cutoff_hz=cutoff_hz)
    kept_names, kept_parts = [names[i] for i in kept], [parts[i] for i in kept]
    ground = measure_floor(smooth, kept_names, kept_parts, rate_hz=rate) if floor else None
    if ground is not None and ground.kind == "tilted axes":
        smooth = level_floor(smooth, ground)
    floor_m = find_floor_height(smooth, kept_parts) if floor else 0.0
    smooth = smooth - np.array([0.0, 0.0, floor_m])
    facts, height_m, size_note = motion.facts, math.nan, ""
    if not math.isfinite(facts.height_m):
        if whole is not None:
            with warnings.catch_warnings(), suppress(MotionError):  # unknown if it cannot be cleaned
                warnings.simplefilter("ignore", DoppelgaitWarning)  # they are about the whole recording
                cleaned = clean_motion(whole, lowpass_hz=lowpass_hz, floor=floor)
                height_m, size_note = measure_height(cleaned.position_m, cleaned.markers, cleaned.parts)
        if not math.isfinite(height_m):
            raised = smooth if ground is None else ground.remove_slope(smooth, kept_parts)
            height_m, size_note = measure_height(raised, kept_names, kept_parts)
        facts = replace(facts, height_m=height_m)
    belt = belt_velocity_mps(smooth, kept_parts, rate_hz=rate)
    sides = _check_sides(smooth, kept_parts, rate_hz=rate, belt_mps=belt)
    for note in (note for note in sides if note.endswith(EXCHANGED)):
        warn_caller(f"{where}: {note}; the measured gait is therefore that of the exchanged names.")
    notes = [*sides, *([] if belt is None else [format_belt_note(belt)]), *([size_note] if size_note else [])]
    report = {
        **motion.report,
        **fill_facts,
        "samples_held": held,
        "samples_from_segment": n_from_segment,
        "swaps_repaired": swaps,
        "spikes_removed": spikes,
        "jumps": [jump for jump in jumps if jump["point"] in kept_names],
        "notes": [*motion.report.get("notes", []), *notes],
        "dropped": dropped_names,
        "points_kept": len(kept),
        "parts": describe_known_parts(kept_parts),
        "unknown_parts": [name for name, part in zip(kept_names, kept_parts, strict=True) if not part],
        "kept_from_s": first / rate,
        "kept_to_s": (stop - 1) / rate,
        "lowpass_hz": cutoff_hz,
        "noise_m": noise_m,
        **({} if ground is None else ground.describe()),
        "floor_shift_m": -floor_m,
    }
    facts = replace(facts, file_time_s=facts.file_time_s + first / rate)
    return make_motion(smooth, rate_hz=rate, markers=kept_names, parts=kept_parts, facts=facts, report=report)


def describe_known_parts(parts: Sequence[str]) -> str:
    """Describe how many points have a known body part."""
    # the scatterers of a body without a known trunk share its cross section equally
    known = sum(part in HUMAN_PARTS or part in DOG_PARTS for part in parts)
    if known in (0, len(parts)):
        return "known" if known else "unknown: equal split"
    split = "" if any(part in BODY_CENTRE_PARTS for part in parts) else ": equal split"
    return f"{known} of {len(parts)} known{split}"


EXCHANGED = "their names are exchanged"
HEADING_S = 0.25
"""The direction of the path at a frame is measured from this time before to this time after it."""
SLOWEST_MPS = 0.2
WRONG_SIDE = 0.25
"""A pair of parts is exchanged if its lateral distance is negative by more than this share of the widest pair's."""


def pair_sides(parts: Sequence[str]) -> dict[str, list[list[int]]]:
    """Return left and right points, by number, of every part with both."""
    return {
        part.removeprefix("left_"): [[i for i, own in enumerate(parts) if own == name] for name in (part, other)]
        for part in dict.fromkeys(parts)
        if part.startswith("left_") and (other := part.replace("left_", "right_", 1)) in parts
    }


def _check_sides(
    position: FloatArray, parts: Sequence[str], *, rate_hz: float, belt_mps: FloatArray | None = None
) -> list[str]:
    """Return a note if left parts are on the right."""
    pairs = pair_sides(parts)
    half = max(1, round(HEADING_S * rate_hz))
    path = position[:, :, :2].mean(axis=1)
    if not pairs or len(path) <= 2 * half:
        return []
    velocity = (path[2 * half :] - path[: -2 * half]) * rate_hz / (2 * half)
    if belt_mps is not None:
        velocity = velocity - belt_mps
    speed = np.linalg.norm(velocity, axis=1)
    moves = speed > SLOWEST_MPS
    if float(speed[moves].sum()) / rate_hz < MOVING_BODY_M:
        return []
    to_left = np.stack([-velocity[:, 1], velocity[:, 0]], axis=1)[moves] / speed[moves, np.newaxis]
    inner = position[half:-half][moves]
    apart_m = {}
    for name, (left, right) in pairs.items():
        offset = inner[:, left, :2].mean(axis=1) - inner[:, right, :2].mean(axis=1)
        apart_m[name] = float(np.median(np.einsum("tk,tk->t", offset, to_left)))
    usual = float(np.mean(list(apart_m.values())))
    if usual < 0.0:
        return ["left parts are on the right side of the path: walked backwards, mirrored axes or exchanged names"]
    wrong = [name for name, apart in apart_m.items() if apart < -WRONG_SIDE * max(apart_m.values())]
    return [f"left_{name} and right_{name} are on each other's side: {EXCHANGED}" for name in wrong]


def find_stationary_points(position: FloatArray, *, limit_m: float = STATIONARY_M) -> BoolArray:
    """Find the points that hardly move, shape (P,). Shapes: position (T, P, 3)."""
    # their total excursion, the diagonal of the bounding box of the path, is below a limit
    if not len(position):
        return np.zeros(position.shape[1], dtype=bool)
    excursion = np.fmax.reduce(position, axis=0) - np.fmin.reduce(position, axis=0)
    return np.asarray(np.linalg.norm(excursion, axis=1) < limit_m)


def find_body_centre(position: FloatArray) -> FloatArray:
    """Return the path of the body centre."""
    # the mean of the points that move and are seen in 40 % of the frames, gaps filled linearly
    if not len(position):
        return np.empty((0, 3))
    missing = np.isnan(position).any(axis=2).mean(axis=0)
    moving = ~find_stationary_points(position)
    chosen = moving & (missing <= MAX_MISSING)
    for fallback in (moving & (missing < 1.0), missing < 1.0):
        chosen = chosen if chosen.any() else fallback
    if not chosen.any():
        return np.full((position.shape[0], 3), np.nan)
    return np.asarray(fill_linear(position[:, chosen]).mean(axis=1))


def _find_best_segment(seen: BoolArray, names: Sequence[str]) -> tuple[int, int, BoolArray]:
    """Find the gap-free segment and points with most samples. Samples are frames times points."""
    best, score = (0, 0), -1
    order = np.lexsort((np.array(names, dtype=str), seen.sum(axis=0)))
    for n_dropped in range(max(1, len(order) - MIN_MARKERS + 1)):
        rest = order[n_dropped:]
        whole = find_runs(np.asarray(seen[:, rest].all(axis=1))) if rest.size else []
        a, b = max(whole, key=lambda run: run[1] - run[0], default=(0, 0))
        if (b - a) * len(rest) > score:
            best, score = (a, b), (b - a) * len(rest)
    first, stop = best
    complete = np.asarray(seen[first:stop].all(axis=0)) & (stop > first)
    return first, stop, complete


def find_floor_height(position: FloatArray, parts: Sequence[str]) -> float:
    """Return the height of the floor in m (E-01). Shapes: position (T, P, 3)."""
    # it is the 1st percentile of the feet's z, or of the z of the three lowest points
    feet = [i for i, part in enumerate(parts) if part in FOOT_PARTS]
    lowest = feet or list(np.argsort(position[:, :, 2].min(axis=0))[:3])
    height = float(np.percentile(position[:, lowest, 2], 1))
    return min(height, 0.0) if any(parts) and not feet else height
