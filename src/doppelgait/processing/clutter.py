"""Removal of static clutter, and of the common phase that it shows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import AnalysisError
from doppelgait.core.frames import Frames
from doppelgait.core.labels import SHARE_REMOVED, make_array, replace_array_values
from doppelgait.core.lazy import xr
from doppelgait.core.samples import ROWS, Planes, Samples, borrow_planes
from doppelgait.core.units import FloatArray, arctangent
from doppelgait.processing.config import Analysis
from doppelgait.processing.gate import Gate

ClutterKind = Literal["auto", "none", "mean", "median", "exponential", "mti"]
Values = npt.NDArray[np.complex64]

CLUTTER_TIME_S = 2.0
MTI_CUTOFF_HZ = 3.0
"""3 dB point of the high-pass filter, chosen from the possible 2 to 5 Hz: a torso at 0.3 m/s loses 0.01 dB."""
MTI_ORDER = 2
MEDIAN_BLOCK_S = 0.1
"""Length of the blocks for the median of block means; a walking body hardly changes such a mean."""


def remove_clutter(baseband: xr.DataArray, analysis: Analysis) -> xr.DataArray:
    """Remove static clutter by ``analysis.clutter``, as :func:`remove_static_clutter`.

    Parameters
    ----------
    baseband : DataArray (slow_time, range)
    analysis : Analysis
    """
    return remove_static_clutter(baseband, kind=analysis.clutter, time_s=analysis.clutter_time_s)


def remove_static_clutter(
    baseband: xr.DataArray, *, kind: ClutterKind, time_s: float = CLUTTER_TIME_S, cutoff_hz: float = MTI_CUTOFF_HZ
) -> xr.DataArray:
    r"""Remove static clutter from the baseband.

    ``mean`` subtracts the time mean of each range bin. This is a notch of width :math:`1 / T_o` at 0 Hz, which keeps
    all motion of more than half a wavelength within the recording. If a body stands still for a share p of the
    recording, the mean contains p times its echo, which then appears at this range for the rest of the time.

    ``median`` subtracts the median of the means over 0.1 s, for real and imaginary part separately.
    The notch is the same as for the mean, and a body that stands still for less than half of the
    recording leaves no echo.

    ``exponential`` subtracts a running mean

    .. math:: c_i = c_{i-1} + \alpha (y_i - c_{i-1}), \quad \alpha = 1 - e^{-1 / (f_p \tau)}, \quad c_0 = \bar y

    with the time constant :math:`\tau`, which also follows slow drift. It is a high-pass filter with its 3 dB point at
    :math:`1 / 2 \pi \tau`; :math:`c_0` is the mean of the first :math:`\tau`. Slower motion is attenuated: below
    1.6 mm/s at 2 s and 7.29 GHz. Breathing is kept, and the torso of a person who crosses at 90 degrees loses only the
    power within 0.08 Hz of 0.

    ``mti`` is a Butterworth high-pass filter of order 2 at ``cutoff_hz``. Its initial state is the
    mean of its first period. It also removes swaying motion (breathing, curtains, phase drift) and,
    at 3 Hz and 7.29 GHz, everything slower than 0.06 m/s, including a crossing torso.

    :func:`clutter_gain` returns the gain at a Doppler frequency, and :func:`measure_share_removed` the share of the
    power in a gate that was removed. A two-pulse canceller, :math:`|2 \sin(\pi f / f_p)|`, is not available: at 1 kHz
    it attenuates 20 Hz by 18 dB.

    Parameters
    ----------
    baseband : DataArray (slow_time, range)
    kind : {"auto", "none", "mean", "median", "exponential", "mti"}
        ``"auto"`` removes nothing here: without tracking it means ``"none"``.
    time_s : float
        Time constant of ``exponential``.
    cutoff_hz : float
        3 dB point of ``mti``, below half the frame rate.

    Returns
    -------
    DataArray (slow_time, range)
        complex64, V. The same object for ``"none"`` and ``"auto"``.

    Raises
    ------
    AnalysisError
        If the frame rate is too low for ``cutoff_hz``.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> cleaned = dg.processing.remove_static_clutter(recording.baseband, kind="mean")
    >>> left = abs(cleaned.mean("slow_time")).max() / abs(recording.baseband.mean("slow_time")).max()
    >>> round(float(left), 3)  # share of the static echoes that is left
    0.0
    """
    frames = Frames.of(baseband)
    if kind in ("none", "auto"):
        return baseband
    clean = remove_from_frames(frames, kind=kind, time_s=time_s, cutoff_hz=cutoff_hz)
    return replace_array_values(baseband, clean.get_values())


def clean_frames(frames: Frames, analysis: Analysis, *, bins: slice | None = None) -> Frames:
    """Remove static clutter by ``analysis.clutter``."""
    return remove_from_frames(frames, kind=analysis.clutter, time_s=analysis.clutter_time_s, bins=bins)


def remove_from_frames(
    frames: Frames,
    *,
    kind: ClutterKind,
    time_s: float = CLUTTER_TIME_S,
    cutoff_hz: float = MTI_CUTOFF_HZ,
    bins: slice | None = None,
) -> Frames:
    """Remove static clutter from frames, or from some range bins."""
    # the other bins are then undefined; more than one tile is cleaned tile by tile, on demand
    if kind in ("none", "auto"):
        return frames
    chosen = slice(0, frames.n_bins) if bins is None else bins
    block = min(max(round(MEDIAN_BLOCK_S * frames.slow_time.rate_hz), 1), frames.n_pulses)
    size = frames.count_tile_pulses(block)
    tile_pulses = [slice(n, min(n + size, frames.n_pulses)) for n in range(0, frames.n_pulses, size)]
    whole = [frames.samples.read_tile(tile_pulses[0], chosen)] if frames.is_short else []  # once

    def tiles() -> Iterator[Planes]:
        yield from whole or (frames.samples.read_tile(pulses, chosen) for pulses in tile_pulses)

    if kind in ("mean", "median"):
        if kind == "mean":
            level = sum(planes.sum(axis=-1, dtype=np.float64, keepdims=True) for planes in tiles()) / frames.n_pulses
        else:
            means = np.empty((2, chosen.stop - chosen.start, frames.n_pulses // block))
            for number, planes in enumerate(tiles()):
                n_blocks, first = planes.shape[-1] // block, number * (size // block)
                blocks = planes[..., : n_blocks * block].reshape(*planes.shape[:2], n_blocks, block)
                means[..., first : first + n_blocks] = blocks.mean(axis=-1, dtype=np.float64)
            level = np.median(means, axis=-1, keepdims=True, overwrite_input=True)
        static = np.asarray(level, dtype=np.float32)
        clean: Clean = lambda planes, state: (np.subtract(planes, static, out=planes), None)  # noqa: E731
    else:
        clean = _make_filter(frames, chosen, kind, time_s=time_s, cutoff_hz=cutoff_hz)
    if whole:
        return frames.with_samples(_make_samples(clean(whole[0], None)[0], chosen, frames.shape))
    states = [None]  # before each tile
    if kind in ("mean", "median"):  # no tile needs the state before it
        size = min(size, 4096)
    else:
        for planes in tiles():
            states.append(clean(planes, states[-1])[1])
    last: dict[int, Values] = {}

    def rows(first: int, stop: int) -> Values:
        values = np.empty((stop - first, frames.n_bins), dtype=np.complex64)
        for number in range(first // size, -(-stop // size)):
            tile = last.get(number)  # other threads may change the rest
            if tile is None:
                last.clear()  # before the next tile is in memory
                pulses = slice(number * size, min((number + 1) * size, frames.n_pulses))
                planes = clean(frames.samples.read_tile(pulses, chosen), states[number] if states[1:] else None)[0]
                tile = last[number] = _make_samples(planes, chosen, (planes.shape[-1], frames.n_bins)).matrix
            start = number * size - first
            values[max(start, 0) : start + size] = tile[max(-start, 0) : stop - first - start]
        return values

    return frames.with_samples(Samples.stored(frames.shape, rows))


def _make_samples(planes: Planes, bins: slice, shape: tuple[int, int]) -> Samples:
    """Make samples from the planes of some bins; the others are undefined."""
    if planes.shape[1] == shape[1]:
        return Samples.from_planes(planes, shape[0])
    whole = borrow_planes((2, shape[1], shape[0]))
    whole[:, bins] = planes
    return Samples.from_planes(whole, shape[0])


Clean = Callable[[Planes, Any], tuple[Planes, Any]]
"""Filter of a tile of planes: from planes and the state before the tile to filtered planes and the state after it."""


def _make_filter(frames: Frames, bins: slice, kind: str, *, time_s: float, cutoff_hz: float) -> Clean:
    """Return a filter along the pulses; it starts at the mean of a time constant or period."""
    from scipy.signal import butter, lfilter, sosfilt, sosfilt_zi

    prf_hz = frames.slow_time.rate_hz
    if kind == "exponential":
        start_pulses = max(round(time_s * prf_hz), 1)
    elif not 0.0 < cutoff_hz < prf_hz / 2.0:
        raise AnalysisError(
            f"clutter removal 'mti' at {cutoff_hz:g} Hz needs more than {2 * cutoff_hz:g} frames per second, and the "
            f"recording has {prf_hz:g}; use 'mean', 'median' or 'exponential'"
        )
    else:
        start_pulses = max(round(prf_hz / cutoff_hz), 1)
    start = frames.samples.read_tile(slice(0, min(start_pulses, frames.n_pulses)), bins)
    level = start.mean(axis=-1, dtype=np.float64, keepdims=True)
    if kind == "exponential":
        alpha = -math.expm1(-1.0 / (time_s * prf_hz))
        rest = (1.0 - alpha) * level
    else:
        sections = np.asarray(butter(MTI_ORDER, cutoff_hz, "highpass", fs=prf_hz, output="sos"))
        rest = sosfilt_zi(sections)[:, None, None, :] * level

    def clean(planes: Planes, state: Any) -> tuple[Planes, Any]:
        state = (rest if state is None else state).copy()
        for begin in range(0, planes.shape[1], ROWS):  # the filters compute in double precision
            rows, before = planes[:, begin : begin + ROWS], state[..., begin : begin + ROWS, :]
            if kind == "exponential":
                mean, before[:] = lfilter([alpha], [1.0, alpha - 1.0], rows, axis=-1, zi=before)
                rows -= mean
            else:
                rows[:], before[:] = sosfilt(sections, rows, axis=-1, zi=before)
        return planes, state

    return clean


def clutter_gain(
    doppler_hz: npt.ArrayLike,
    *,
    kind: ClutterKind,
    prf_hz: float,
    n_pulses: int | None = None,
    time_s: float = CLUTTER_TIME_S,
    cutoff_hz: float = MTI_CUTOFF_HZ,
) -> FloatArray:
    r"""Compute the amplitude of an echo after clutter removal.

    The echo has a constant Doppler frequency f, with :math:`\theta = \pi f / f_p`. The gain is

    - for ``mean`` over I pulses, as a mean over the recording,
      :math:`\sqrt{1 - D^2}, D = \sin(I \theta) / (I \sin \theta)`;
    - for ``median`` the same to within 0.04;
    - for ``exponential``, in the steady state,
      :math:`|2 \sin \theta| (1 - \alpha) / |1 - (1 - \alpha) e^{-2 j \theta}|`;
    - for ``mti``, in the steady state, :math:`1 / \sqrt{1 + (\tan(\pi f_c / f_p) / \tan \theta)^4}`, the Butterworth
      gain after the bilinear transform.

    Parameters
    ----------
    doppler_hz : array_like
    kind : {"none", "mean", "median", "exponential", "mti"}
    prf_hz : float
    n_pulses : int, optional
        I, length of the recording; required for ``mean`` and ``median``.
    time_s, cutoff_hz : float
        As for :func:`remove_static_clutter`.

    Returns
    -------
    ndarray
        0 to 1, in the shape of ``doppler_hz``; 0 at 0 Hz for all but ``none``.

    Raises
    ------
    AnalysisError
        If ``n_pulses`` is missing for ``mean`` or ``median``.

    Examples
    --------
    >>> import doppelgait as dg
    >>> gain = dg.processing.clutter_gain([0.0, 100.0], kind="mean", prf_hz=500.0, n_pulses=1000)
    >>> gain.round(2)
    array([0., 1.])
    """
    angle = np.pi * np.asarray(doppler_hz, dtype=float) / prf_hz
    sine = np.abs(np.sin(angle))
    if kind == "none":
        return np.ones(angle.shape)
    if kind in ("mean", "median"):
        if n_pulses is None:
            raise AnalysisError(f"the gain of clutter removal {kind!r} depends on the recording: set n_pulses")
        kernel = np.divide(np.sin(n_pulses * angle), n_pulses * np.sin(angle), out=np.ones_like(angle), where=sine > 0)
        return np.asarray(np.sqrt(np.maximum(1.0 - kernel**2, 0.0)))
    if kind == "exponential":
        kept = math.exp(-1.0 / (prf_hz * time_s))
        return np.asarray(2.0 * sine * kept / np.abs(1.0 - kept * np.exp(-2j * angle)))
    low = (math.tan(math.pi * cutoff_hz / prf_hz) * np.abs(np.cos(angle))) ** 2
    low, high = low**MTI_ORDER, (sine**2) ** MTI_ORDER
    return np.asarray(np.sqrt(high / (high + low)))


def measure_share_removed(
    before: xr.DataArray,
    after: xr.DataArray,
    gate: Gate,
    *,
    total: npt.NDArray[np.complex128] | None = None,
    block_s: float = 0.1,
    reference_share: float = 0.2,
) -> xr.DataArray:
    r"""Measure the power share of a body lost to clutter removal.

    The share refers to the gate of the body and is a function of time.

    Static clutter is in a range bin all the time, a body only while its gate covers the bin. The
    mean c of each bin over the pulses at which the gate does *not* cover it is therefore clutter
    without the body. The body alone is the baseband before removal minus c:

    .. math:: \text{share} = 1 - \frac{\sum |y_{after}|^2}{\sum |y_{before} - c|^2}

    summed over the gate's bins and the pulses of a time block, and limited to 0 or more. Both sums
    contain noise, so the share refers to body and noise together. A bin that the gate covers nearly
    all the time has no reference, because a radar cannot distinguish a body that stays from
    clutter. The result is then NaN, and :func:`predict_torso_share_removed` predicts the share from
    the range history alone. Drifting clutter is counted as removed power of the body.

    Parameters
    ----------
    before, after : DataArray (slow_time, range)
        Baseband before and after clutter removal.
    gate : Gate
    total : ndarray, shape (range,), optional
        Sum of ``before`` over all pulses. If it is set, only the pulses of the gate are read.
    block_s : float
        Length of a time block.
    reference_share : float
        Smallest share of the recording in which the gate does not cover a bin, for the bin to be used; 0 to 1.

    Returns
    -------
    DataArray (time)
        One share per block of the gate's times, 0 to 1; NaN where fewer than half of the gate's
        bins have a reference.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> gate = dg.Gate.around([0.0, 3.0], [6.8, 3.2], span_m=1.5)
    >>> cleaned = dg.processing.remove_clutter(recording.baseband, dg.Analysis(clutter="mean"))
    >>> share = dg.processing.measure_share_removed(recording.baseband, cleaned, gate)
    >>> round(abs(float(share.mean())), 2)  # nothing of a walk
    0.0
    """
    times_s, share = measure_removed(
        Frames.of(before), Frames.of(after), gate, total=total, block_s=block_s, reference_share=reference_share
    )
    return make_array(SHARE_REMOVED, share, {"time": times_s})


def measure_removed(
    before: Frames,
    after: Frames,
    gate: Gate,
    *,
    total: npt.NDArray[np.complex128] | None = None,
    block_s: float = 0.1,
    reference_share: float = 0.2,
) -> tuple[FloatArray, FloatArray]:
    """Return times and shares of :func:`measure_share_removed`."""
    n_pulses = before.n_pulses
    if total is None:
        total = sum_pulses(before)
    before, after = gate.crop(before), gate.crop(after)
    times = before.slow_time.time_s
    bins = np.arange(before.n_bins)

    def covered(first: int, size: int) -> npt.NDArray[np.bool_]:
        low, high = gate.edges(before.range_m, times[first : first + size, None], sharp=True)
        return np.asarray((bins > low) & (bins < high))

    elsewhere, count = total, np.full(bins.size, n_pulses)
    for first, values in before.read_tiles():
        inside = covered(first, values.shape[0])
        elsewhere = elsewhere - np.einsum("in,in->n", values, inside, dtype=np.complex128)
        count -= inside.sum(axis=0)
    clutter, usual = elsewhere / np.maximum(count, 1), count >= reference_share * n_pulses
    length = min(max(1, round(block_s * before.slow_time.rate_hz)), times.size)
    n_blocks, step = times.size // length, 40 * length  # pulses that are in memory together
    # per block: remaining power, power of the body, bins with a reference, bins of the gate
    sums = np.empty((4, n_blocks))
    for first in range(0, times.size, step):
        values, cleaned = (frames.read(first, min(first + step, times.size)) for frames in (before, after))
        inside = covered(first, values.shape[0])
        known = inside & usual
        pulses = (
            np.einsum("in,in->i", _compute_power(cleaned), known),
            np.einsum("in,in->i", _compute_power(values - clutter), known),
            known.sum(axis=1),
            inside.sum(axis=1),
        )
        whole = values.shape[0] // length
        for row, per_pulse in zip(sums, pulses, strict=True):
            row[first // length :][:whole] = _sum_blocks(per_pulse, length)
    left, body, n_known, n_inside = sums
    usable = (n_known >= 0.5 * n_inside) & (body > 0)
    share = np.where(usable, np.maximum(1.0 - left / np.where(usable, body, 1.0), 0.0), np.nan)
    return _sum_blocks(times, length) / length, share


def _sum_blocks(values: npt.NDArray[Any], length: int) -> FloatArray:
    whole = values.size // length
    blocks = values[: whole * length].reshape(whole, length)
    return np.asarray(blocks.sum(axis=1, dtype=np.float64))


def sum_pulses(frames: Frames) -> npt.NDArray[np.complex128]:
    """Sum frames over their pulses, for :func:`measure_removed`."""
    return np.asarray(sum(values.sum(axis=0, dtype=np.complex128) for _, values in frames.read_tiles()))


def predict_torso_share_removed(
    gate: Gate,
    time_s: npt.ArrayLike,
    *,
    kind: ClutterKind,
    wavelength_m: float,
    prf_hz: float,
    n_pulses: int | None = None,
    clutter_time_s: float = CLUTTER_TIME_S,
    cutoff_hz: float = MTI_CUTOFF_HZ,
) -> FloatArray:
    r"""Predict the share of torso power that clutter removal removes.

    The prediction uses the gain of the filter and the range history of the gate only.

    The torso's Doppler frequency is that of the gate's centre, :math:`f = -2 \dot R / \lambda`, and the share is
    :math:`1 - |H(f)|^2` with the gain of :func:`clutter_gain`. No data are read, so the prediction also holds where
    body and clutter cannot be distinguished, for example for a person who crosses at 90 degrees within one gate. Limbs
    move faster and lose less.

    Parameters
    ----------
    gate : Gate
        Two or more times.
    time_s : array_like, shape (J,)
        Times of the prediction, for example the columns of a signature.
    kind, prf_hz, n_pulses, clutter_time_s, cutoff_hz
        As for :func:`clutter_gain`.
    wavelength_m : float

    Returns
    -------
    ndarray, shape (J,)
        0 to 1.

    Examples
    --------
    >>> import doppelgait as dg
    >>> gate = dg.Gate.around([0.0, 1.0, 2.0, 3.0], [5.0, 5.0, 5.0, 3.8], span_m=1.5)  # stands, then walks
    >>> share = dg.processing.predict_torso_share_removed(
    ...     gate, [0.0, 3.0], kind="mean", wavelength_m=0.04, prf_hz=500.0, n_pulses=1500
    ... )
    >>> share.round(2)
    array([1., 0.])
    """
    times = gate.time_s
    rate_mps = np.gradient(gate.centre_at(times), times)
    doppler_hz = -2.0 * np.interp(np.asarray(time_s, dtype=float), times, rate_mps) / wavelength_m
    gain = clutter_gain(
        doppler_hz, kind=kind, prf_hz=prf_hz, n_pulses=n_pulses, time_s=clutter_time_s, cutoff_hz=cutoff_hz
    )
    return np.asarray(1.0 - gain**2)


def _compute_power(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return np.asarray(values.real**2 + values.imag**2)


ComplexArray = npt.NDArray[np.complex128]

ZONE_M = 0.75
ZONE_BINS = 5
"""Zones of range nearer than this are no reference for a zone: they may show the same body."""
LEAST_WEIGHT = 1e3
"""Smallest power of the static echoes over their fluctuation for a reference; the phase error is then 0.02 rad."""
MARGIN = 10.0
"""Smallest ratio of a reference's weight to that of a static echo; the phase error then adds 1/20 of its noise."""
BLOCK_S = 0.1  # time in which the phase of a clock hardly changes
LEAST_VARIANCE = 1e-14
"""Variance of |y| over its power that rounding errors cause in a constant echo."""
TINY = float(np.finfo(np.float32).tiny)


def remove_common_phase(frames: Frames) -> Frames:
    """Subtract the phase that the bins of other zones have in common."""
    range_m, count = frames.range_m, frames.n_pulses
    zone_m = max(ZONE_M, ZONE_BINS * float(range_m[1] - range_m[0])) if range_m.size > 1 else ZONE_M
    block = max(round(BLOCK_S * frames.slow_time.rate_hz), 1)
    if range_m[-1] - range_m[0] < 2 * zone_m or count < 2 * block:
        return frames
    tiles = partial(frames.read_tiles, block)
    zone = ((range_m - range_m[0]) / zone_m).astype(np.int64)
    member = (zone[:, None] == np.arange(zone[-1] + 1)).astype(np.float32)
    far = (np.abs(np.subtract.outer(np.arange(zone[-1] + 1), np.arange(zone[-1] + 1))) > 1).astype(np.float32)
    power, variance = _compute_moments(lambda: (np.abs(values) for _, values in tiles()), count)
    weight = 1.0 / np.maximum(variance, LEAST_VARIANCE * power + TINY)
    # mean of each bin over the blocks, after the far bins have aligned each with the one before
    blocks = average_blocks(frames, block)
    steps = (blocks[1:] * blocks[:-1].conj() * weight) @ (member @ far)[:, zone]
    phase_rad = np.cumsum(arctangent(steps.imag, steps.real), axis=0)
    static = (blocks[0] + (blocks[1:] * np.exp(-1j * phase_rad)).sum(axis=0)) / blocks.shape[0]
    own = weight * np.abs(static) ** 2
    wanted = np.maximum(LEAST_WEIGHT, MARGIN * own) / np.maximum(own @ member @ far, TINY)[zone]
    served = wanted <= block
    if not served.any():
        return frames
    pointing = ((weight / weight.max() * static.conj())[:, None] * member).astype(np.complex64)
    zones = np.unique(zone[served])
    turns = np.empty((count, zones.size), dtype=np.complex64)
    for first, values in tiles():
        turns[first : first + values.shape[0]] = (values @ pointing @ far)[:, zones]
    for column, number in enumerate(zones):  # the rotation that corrects a zone
        pointer, pulses = turns[:, column], math.ceil(wanted[served & (zone == number)].max())
        if pulses > 1:
            place = np.arange(count)
            total = np.concatenate([[0.0], np.cumsum(pointer, dtype=np.complex128)])
            stop = np.minimum(place + pulses - pulses // 2, count)
            pointer = np.asarray(total[stop] - total[np.maximum(place - pulses // 2, 0)], dtype=np.complex64)
        turns[:, column] = pointer.conj() / np.maximum(np.abs(pointer), TINY)
    place = np.searchsorted(zones, zone)

    def turned(bins: npt.NDArray[np.bool_], values: Values, first: int) -> Values:
        changed = values.copy()
        changed[:, bins] *= turns[first : first + values.shape[0], place[bins]]
        return changed

    trial = _compute_moments(lambda: (turned(served, values, first) for first, values in tiles()), count)[1]
    better = served & (trial < _compute_moments(lambda: (values for _, values in tiles()), count)[1])
    return frames.map_tiles(partial(turned, better)) if better.any() else frames


def average_blocks(frames: Frames, block_pulses: int) -> ComplexArray:
    """Average frames over whole blocks of pulses, (K, N)."""
    averages = np.empty((frames.n_pulses // block_pulses, frames.n_bins), dtype=np.complex128)
    for first, values in frames.read_tiles(block_pulses):
        n_blocks = values.shape[0] // block_pulses
        blocks = values[: n_blocks * block_pulses].reshape(n_blocks, block_pulses, frames.n_bins)
        blocks.mean(axis=1, dtype=np.complex128, out=averages[first // block_pulses :][:n_blocks])
    return averages


def _compute_moments(tiles: Callable[[], Iterator[npt.NDArray[Any]]], count: int) -> tuple[FloatArray, FloatArray]:
    """Compute each column's power of the mean and variance, in two passes."""
    mean = variance = np.zeros(())
    for values in tiles():
        mean = mean + values.sum(axis=0, dtype=np.complex128 if np.iscomplexobj(values) else np.float64)
    mean = mean / count
    for values in tiles():
        rest = values - mean.astype(values.dtype)
        variance = variance + (np.einsum("in,in->n", rest, rest.conj()).real / count).astype(np.float64)
    return np.abs(mean) ** 2, np.asarray(variance, dtype=np.float64)
