"""Separation of several bodies within one track, by range profile."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from doppelgait.core.frames import Frames
from doppelgait.core.units import FloatArray, decimal_logarithm
from doppelgait.processing.config import gaussian_window
from doppelgait.processing.track.live import Track

REACH_M, STEP_M = 1.6, 0.05
OFFSETS_M = STEP_M * np.arange(-round(REACH_M / STEP_M), round(REACH_M / STEP_M) + 1)
"""Ranges of a profile relative to its track."""
BAND_MPS, N_BAND = 0.35, 7
"""Doppler band around that of the track: a torso stays inside, a swinging limb passes through."""
LEAST_SPEED_MPS = 0.4
"""Lowest speed of a track that is split; a slower track has the same Doppler band as bodies at rest nearby."""
WINDOW_STEEPNESS = 0.4
SMOOTHED_SCANS = 9
"""Number of scans in the median of profiles; a limb stays in the band for a shorter time."""
APART_M = 0.6
"""Distance of torso echoes above which they are two bodies; chest and rump of dogs and crawlers have 0.45 m."""
WEAKEST_DB, DEEP_DB = 16.0, 10.0  # largest level of the first peak over the second, least valley between them
FLOOR_FROM_M, FLOOR_QUANTILE, FLOOR_FACTOR = 1.0, 0.3, 2.0
SPLIT_S, SPLIT_SHARE = 2.0, 0.75
"""Shortest continuous time of a second body, and its smallest share of the usable scans.
In a usable scan the track is fast and no other track is near."""
RUN_SHARE = 0.9
READ_SCANS = 64  # number of scans for which pulses are read together
SAME_M, SAME_S = 0.4, 0.5
"""Differences in range and time below which a second peak belongs to another track."""


def sum_torso_profiles(clean: Frames, found: Track, *, wavelength_m: float, cpi_s: float) -> FloatArray:
    """Compute the moving power along range around a track. Shapes: returns (T, D)."""
    slow_time, range_m = clean.slow_time, clean.range_m
    times_s, prf_hz, burst = slow_time.time_s, slow_time.pulse_rate_hz, slow_time.burst_pulses
    size = burst or min(max(1, round(cpi_s * prf_hz)), times_s.size)
    window = gaussian_window(size, WINDOW_STEEPNESS)
    slow_s = np.arange(size) / prf_hz
    profiles = np.zeros((found.times_s.size, OFFSETS_M.size))
    pulses = np.round((found.times_s - times_s[0]) * prf_hz - size / 2).astype(np.int64)
    pulses = np.clip(pulses, 0, times_s.size - size)
    if burst is not None:  # a track has its times in the middle of bursts
        chosen = np.searchsorted(slow_time.split_bursts()[:, -1], found.times_s)
        pulses = burst * np.minimum(chosen, times_s.size // burst - 1)
    for number, (first, centre_m, velocity_mps) in enumerate(
        zip(pulses, found.range_m, found.velocity_mps, strict=True)
    ):
        if number % READ_SCANS == 0:
            start, read = first, clean.read(first, int(pulses[number : number + READ_SCANS][-1]) + size)
        low, high = np.searchsorted(range_m, [centre_m - REACH_M - STEP_M, centre_m + REACH_M + STEP_M])
        if high - low < 2:
            continue
        doppler_hz = 2.0 * (velocity_mps + np.linspace(-BAND_MPS, BAND_MPS, N_BAND)) / wavelength_m
        kernel = np.exp(-2j * np.pi * doppler_hz[:, None] * slow_s) * window
        power = (np.abs(kernel @ read[first - start : first - start + size, low:high]) ** 2).sum(axis=0)
        profiles[number] = np.interp(centre_m + OFFSETS_M, range_m[low:high], power, left=0.0, right=0.0)
    return profiles


def smooth_profiles(profiles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Smooth profiles over time, and measure their floor. Shapes: (T, D), (T, 1)."""
    from scipy.ndimage import median_filter

    smooth = median_filter(profiles, size=(min(SMOOTHED_SCANS, profiles.shape[0]), 1), mode="nearest")
    floor = np.quantile(smooth[:, np.abs(OFFSETS_M) > FLOOR_FROM_M], FLOOR_QUANTILE, axis=1)[:, None]
    return smooth, FLOOR_FACTOR * floor


def find_echoes(smooth: FloatArray, floor: FloatArray, found: Track, others: Sequence[Track]) -> FloatArray:
    """Find the near and the far one of two torsos. Shapes: returns (2, T), NaN for one."""
    from scipy.signal import find_peaks

    smooth = np.maximum(smooth, floor)
    top = np.maximum(smooth.max(axis=1, keepdims=True), 1e-300)
    level_db = 10.0 * decimal_logarithm(np.maximum(smooth / top, 1e-6))
    echoes_m = np.full((2, smooth.shape[0]), np.nan)
    taken = [np.interp(found.times_s, one.times_s, one.range_m, left=np.nan, right=np.nan) for one in others]
    for number in np.flatnonzero(np.abs(found.velocity_mps) >= LEAST_SPEED_MPS):
        row = level_db[number]
        padded = np.concatenate([[-99.0], row, [-99.0]])
        peaks, facts = find_peaks(padded, height=-WEAKEST_DB, prominence=DEEP_DB)
        if peaks.size < 2:
            continue
        places_m = found.range_m[number] + OFFSETS_M[peaks - 1]
        own_off_m = np.abs(places_m - found.range_m[number])
        mine = np.ones(peaks.size, dtype=bool)
        for one in taken:
            off_m = np.abs(places_m - one[number])
            mine &= ~((off_m < SAME_M) & (off_m < own_off_m))
        heights = np.where(mine, facts["peak_heights"], -np.inf)
        best = int(np.argmax(heights))
        free = mine & mine[best] & (np.abs(places_m - places_m[best]) >= APART_M - 1e-9)
        if not free.any():
            continue
        second = int(np.argmax(np.where(free, facts["peak_heights"], -np.inf)))
        echoes_m[:, number] = np.sort(places_m[[best, second]])
    return echoes_m


def split_tracks(tracks: Sequence[Track], clean: Frames, *, wavelength_m: float, cpi_s: float) -> list[Track]:
    """Divide tracks that follow two bodies.

    A second echo at 0.6 m or more from the strongest, with a valley of 10 dB between them for 2 s, becomes a track.
    """
    found = list(tracks)
    for number in range(len(tracks)):
        one = found[number]
        others = [other for other in found if other is not one]
        profiles = smooth_profiles(sum_torso_profiles(clean, one, wavelength_m=wavelength_m, cpi_s=cpi_s))
        echoes_m = find_echoes(*profiles, one, others)
        deep = np.isfinite(echoes_m[0])
        alone = np.abs(one.velocity_mps) >= LEAST_SPEED_MPS
        for other in others:
            near_m = np.interp(one.times_s, other.times_s, other.range_m, left=np.nan, right=np.nan) - one.range_m
            alone &= ~(np.abs(near_m) < REACH_M)
        step_s = float(np.median(np.diff(one.times_s))) if one.times_s.size > 1 else np.inf
        run = _find_longest_run(deep, max(1, round(SPLIT_S / step_s)))
        if run is not None and deep.sum() >= SPLIT_SHARE * alone.sum():
            found = _replace(found, number, echoes_m, run)
    return sorted(found, key=lambda one: one.first_s)


def _find_longest_run(seen: npt.NDArray[np.bool_], least: int) -> tuple[int, int] | None:
    if seen.size < least:
        return None
    full = np.convolve(seen, np.ones(least), mode="valid") >= RUN_SHARE * least
    covered = np.convolve(full, np.ones(least), mode="full") > 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], covered, [False]])))
    if not edges.size:
        return None
    first, stop = max(edges.reshape(-1, 2), key=lambda ends: ends[1] - ends[0])
    return int(first), int(stop)


def _replace(tracks: list[Track], number: int, echoes_m: FloatArray, run: tuple[int, int]) -> list[Track]:
    # one of them lasts as long as the original track
    found, one = list(tracks), tracks[number]
    for echo in (1, 0):
        second = _move_to_echo(one, echoes_m[echo], run, whole=False)
        for place, other in enumerate(found):
            joined = _join(second, other) or _join(other, second)
            if place != number and joined is not None:
                found[place] = joined
                found[number] = _move_to_echo(one, echoes_m[1 - echo], run, whole=True)
                return found
    found[number] = _move_to_echo(one, echoes_m[0], run, whole=True)
    return [*found, _move_to_echo(one, echoes_m[1], run, whole=False)]


def _move_to_echo(one: Track, place_m: FloatArray, run: tuple[int, int], *, whole: bool) -> Track:
    inside = slice(*run)
    known = np.flatnonzero(np.isfinite(place_m[inside])) + run[0]
    width = min(SMOOTHED_SCANS, known.size)
    filled = np.interp(np.arange(*run), known, (place_m - one.range_m)[known])
    padded = np.pad(filled, (width // 2, width - 1 - width // 2), mode="edge")
    smooth = np.convolve(padded, np.ones(width) / width, mode="valid")
    offset_m = np.interp(np.arange(one.times_s.size), np.arange(*run), smooth)
    half_m = (one.range_high_m - one.range_low_m) / 4.0
    centre_m = one.range_m + offset_m
    moved = replace(one, range_m=centre_m, range_low_m=centre_m - half_m, range_high_m=centre_m + half_m)
    if whole:
        return moved
    confirmed_at_s = max(one.confirmed_at_s, float(one.times_s[run[0]]))
    return moved.change_arrays(lambda _, values: values[inside], confirmed_at_s=confirmed_at_s)


def _join(before: Track, after: Track) -> Track | None:
    """Join two consecutive tracks of a body, or return None."""
    gap_s = after.first_s - before.last_s
    place_m = float(np.interp(after.first_s, before.times_s, before.range_m))
    place_m -= float(before.velocity_mps[-1]) * max(gap_s, 0.0)
    if not -SAME_S <= gap_s <= 2.0 * SAME_S or abs(place_m - float(after.range_m[0])) > 2.0 * SAME_M:
        return None
    early = before.times_s < after.first_s - 1e-9
    return before.change_arrays(lambda name, values: np.concatenate([values[early], getattr(after, name)]))
