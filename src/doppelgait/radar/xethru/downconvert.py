"""Convert RF frames (of chips that sample the carrier) to complex baseband and back.

Units: one unit of the X4's files is 1024 codes of its threshold DAC, in RF frames and in the chip's
own baseband, where a sinusoid with the RF amplitude A has 0.78 A, the gain of the chip's taps.
``volts_per_unit`` of a preset refers to the baseband: 1 unit of RF is 0.78 ``volts_per_unit``.
Readers of RF frames therefore multiply the output of a filter by :func:`compute_chip_gain`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import RecordingError
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.radar.measured import adapt_preset
from doppelgait.radar.parameters import Radar

FrameFilter = Literal["hamming", "chip"]

DECIMATION = 8  # decimation of the chip
HAMMING_TAPS = 27
CHUNK_SAMPLES = 1 << 22
"""Number of RF samples per block, which limits the working memory to 100 MB for recordings of any length."""


def _make_chip_taps(text: str, shift: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the filter of I, and that of Q: the same in reverse, earlier by some taps."""
    in_phase = tuple(map(int, text.split()))
    return in_phase, (*in_phase[::-1][shift:], *(0,) * shift)


CHIP_TAPS = {
    "low": _make_chip_taps(
        "1 -1 -1 5 -3 -6 12 -2 -16 18 6 -27 16 17 -31 6 25 -25 -5 24 -13 -10 16 -3 -7 6 0 -3 1 0 0 0", 2
    ),
    "high": _make_chip_taps(
        "1 -2 1 3 -8 11 -5 -8 21 -24 10 12 -30 31 -13 -12 29 -27 10 8 -17 15 -5 -3 5 -4 1 0 0 0 0 0", 4
    ),
}
"""The X4's two real filters (I, Q) for each band: integer taps of the chip driver."""
CHIP_CENTRE = {"low": 14.5, "high": 13.5}
"""Centre of the envelope of those filters, RF samples after their first tap."""
CHIP_CARRIER = {"low": 5.0 / 16.0, "high": 3.0 / 8.0}
"""Ratio of carrier to sampling rate of each pair: 7.29 and 8.748 GHz at 23.328 GS/s."""

DRIVER_SPEED_OF_LIGHT_MPS = 3.0e8
"""Speed of light in the driver, on which the bin lengths in its files are based."""


def down_convert_frames(
    frames: npt.NDArray[np.floating],
    *,
    carrier_hz: float,
    sample_rate_hz: float,
    decimation: int = 8,
    range_start_m: float = 0.0,
    bin_length_m: float | None = None,
    filter: FrameFilter = "hamming",
) -> tuple[npt.NDArray[np.complex64], npt.NDArray[np.float64]]:
    """Convert real RF frames to complex baseband (E-17).

    ``y[m] = sum_k h[k] x[D m + k] exp(-j 2 pi f_c t[D m + k])``, with the delay ``t[n] = (r_0 / b +
    n) / f_s`` of sample n of a frame that starts at r_0 with bins of length b: the phase of an echo
    falls with its range, and an approaching target has positive Doppler.

    Parameters
    ----------
    frames : ndarray, shape (I, N)
        Real RF samples, any unit; N at least the length of the filter (27 or 32).
    carrier_hz, sample_rate_hz : float
        Carrier f_c, above 0 and below half of the RF sampling rate f_s.
    decimation : int
        Decimation factor D, 1 to 1024.
    range_start_m : float
        Range r_0 of the first RF sample.
    bin_length_m : float, optional
        Range spacing of the RF samples in the file (0.00643004 m in X4 files, computed with c = 3e8
        m/s); by default c / (2 f_s) with the true speed of light.
    filter : {"hamming", "chip"}
        ``"hamming"``: symmetric low-pass with 27 taps, Hamming window, cut-off f_s / (2 D) and gain
        1 at the carrier; an RF sinusoid of amplitude A becomes A / 2, as in the vendor's user
        guide. ``"chip"``: the X4's integer filters for the band of the carrier, with Q negated and
        divided by the sum of their magnitudes as in its driver; A becomes 0.78 A.

    Returns
    -------
    baseband : ndarray, shape (I, M)
        complex64; only outputs with the complete filter inside the frame: M = floor((N - taps) / D) + 1.
    range_m : ndarray, shape (M,)
        Range of every output, at the centre of its filter.

    Raises
    ------
    RecordingError
        If the frames are not a real matrix or are too short, or a parameter is not allowed.
    """
    samples = np.asarray(frames)
    if samples.ndim != 2 or samples.dtype.kind not in "fiu":
        raise RecordingError(
            f"RF frames must be a real matrix (frame, sample); these are {samples.dtype} of shape {samples.shape}"
        )
    if not 0.0 < carrier_hz < sample_rate_hz / 2.0:
        raise RecordingError(
            f"carrier_hz {carrier_hz:g} is not allowed: it must be above 0 and below half the sampling rate, "
            f"{sample_rate_hz / 2.0:g} Hz"
        )
    if not 1 <= decimation <= 1024:
        raise RecordingError(f"decimation {decimation} is not allowed: it must be 1 to 1024")
    spacing_m = SPEED_OF_LIGHT_MPS / (2.0 * sample_rate_hz) if bin_length_m is None else float(bin_length_m)
    if not spacing_m > 0.0 or not np.isfinite(range_start_m):
        raise RecordingError(
            f"bin_length_m {bin_length_m} and range_start_m {range_start_m}: the first must be above 0, both finite"
        )
    taps, centre = _make_complex_taps(carrier_hz / sample_rate_hz, decimation, filter)
    if samples.shape[1] < taps.size:
        raise RecordingError(
            f"RF frames of {samples.shape[1]} samples are shorter than the {taps.size} taps of the {filter} filter; "
            f"record {taps.size} RF bins or more"
        )
    starts = np.arange(0, samples.shape[1] - taps.size + 1, decimation)
    cycles = carrier_hz / sample_rate_hz * (range_start_m / spacing_m + starts)
    mixer = np.exp(-2j * np.pi * np.mod(cycles, 1.0))
    # filter only at the starts that are kept
    result = np.empty((samples.shape[0], starts.size), dtype=np.complex64)
    pair = np.stack([taps.real, taps.imag], axis=1)  # real products: half the operations, and BLAS
    step = max(1, CHUNK_SAMPLES // (starts.size * taps.size))
    for first in range(0, samples.shape[0], step):
        rows = np.asarray(samples[first : first + step], dtype=float)
        windows = np.lib.stride_tricks.sliding_window_view(rows, taps.size, axis=1)[:, starts]
        parts = windows.reshape(-1, taps.size) @ pair
        result[first : first + step].reshape(-1)[:] = parts[:, 0] + 1j * parts[:, 1]
    return result * mixer.astype(np.complex64), range_start_m + spacing_m * (starts + centre)


def compute_chip_gain(carrier_hz: float, sample_rate_hz: float, filter: FrameFilter) -> float:
    """Return the gain of the chip's filter relative to another filter."""
    if filter == "chip":
        return 1.0
    band = min(CHIP_CARRIER, key=lambda name: abs(CHIP_CARRIER[name] - carrier_hz / sample_rate_hz))
    return _compute_gain(CHIP_CARRIER[band], "chip") / _compute_gain(CHIP_CARRIER[band], filter)


def _change_filter_noise(radar: Radar, filter: FrameFilter) -> Radar:
    """Return a chip's radar with another filter's response to white RF noise (E-18c)."""
    if filter == "chip" or not radar.noise_correlation:
        return radar
    cycles = radar.carrier_hz / radar.sample_rate_hz
    taps, _ = _make_complex_taps(cycles, DECIMATION, filter)
    energy = float((np.abs(taps) ** 2).sum())
    correlation = []
    for shift in range(DECIMATION, taps.size, DECIMATION):
        product = (taps[:-shift].conj() * taps[shift:]).sum() * np.exp(2j * np.pi * cycles * shift)
        correlation.append(float(product.real) / energy)
    bandwidth_hz = radar.sample_rate_hz * energy / (2.0 * _compute_gain(cycles, filter)) ** 2
    return radar.model_copy(update={"noise_bandwidth_hz": bandwidth_hz, "noise_correlation": tuple(correlation)})


def _compute_gain(cycles_per_sample: float, filter: FrameFilter) -> float:
    """Return the baseband amplitude of a unit carrier."""
    taps, _ = _make_complex_taps(cycles_per_sample, DECIMATION, filter)
    return float(abs((taps * np.exp(2j * np.pi * cycles_per_sample * np.arange(taps.size))).sum())) / 2.0


def _make_complex_taps(
    cycles_per_sample: float, decimation: int, filter: FrameFilter
) -> tuple[npt.NDArray[np.complex128], float]:
    """Return the taps ``h[k] exp(-j 2 pi f_c k / f_s)``, and the envelope's centre in samples."""
    if filter == "chip":
        bands = [band for band, value in CHIP_CARRIER.items() if abs(value - cycles_per_sample) < 1e-3]
        if not bands or decimation != DECIMATION:
            raise RecordingError(
                "filter 'chip' is made for carriers of 5/16 and 3/8 of the sampling rate (7.29 and 8.748 GHz on the "
                f"X4) and decimation 8; this carrier is {cycles_per_sample:.4f} of it and the decimation {decimation}; "
                "use filter 'hamming'"
            )
        in_phase, quadrature = (np.array(taps, dtype=float) for taps in CHIP_TAPS[bands[0]])
        pair = (in_phase - 1j * quadrature) / np.abs(in_phase).sum()
        # The chip's phase at the first tap is constant in each band; without it both filters have the same phase.
        gain = (pair * np.exp(2j * np.pi * cycles_per_sample * np.arange(pair.size))).sum()
        return pair * np.abs(gain) / gain, CHIP_CENTRE[bands[0]]
    if filter != "hamming":
        raise RecordingError(f"filter {filter!r} is not allowed; allowed are 'hamming' and 'chip'")
    from scipy.signal import firwin

    cutoff = min(1.0 / (2.0 * decimation), 0.49)
    taps = firwin(HAMMING_TAPS, cutoff, window="hamming", fs=1.0)
    return taps * np.exp(-2j * np.pi * cycles_per_sample * np.arange(HAMMING_TAPS)), (HAMMING_TAPS - 1) / 2.0


def convert_rf_frames(
    path: Path,
    frames: npt.NDArray[np.floating],
    facts: Mapping[str, float],
    filter: FrameFilter,
    preset: str,
    sample_rate_hz: float | None = None,
) -> tuple[npt.NDArray[np.complex64], npt.NDArray[np.float64], Radar, list[str]]:
    """Down-convert a file's frames to volts; also return ranges, radar and notes."""
    rate_hz = sample_rate_hz or DRIVER_SPEED_OF_LIGHT_MPS / (2.0 * facts["bin_spacing_m"])
    try:
        values, range_m = down_convert_frames(
            frames,
            carrier_hz=facts["carrier_hz"],
            sample_rate_hz=rate_hz,
            range_start_m=facts["range_start_m"],
            bin_length_m=facts["bin_spacing_m"],
            filter=filter,
        )
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None
    values = np.float32(compute_chip_gain(facts["carrier_hz"], rate_hz, filter)) * values
    volts, radar, notes = scale_by_preset(path, values, range_m, facts, preset)
    return volts, range_m, _change_filter_noise(radar, filter), notes


def scale_by_preset(
    path: Path, values: npt.NDArray[Any], range_m: npt.NDArray[np.float64], facts: Mapping[str, float], preset: str
) -> tuple[npt.NDArray[np.complex64], Radar, list[str]]:
    """Return a baseband in V by the unit of a preset, its radar, and notes."""
    stated = {key: facts[key] for key in ("prf_hz", "carrier_hz")}
    start_m = float(range_m[0])
    made = adapt_preset(path, preset, n_range_bins=range_m.size, range_start_m=start_m, **stated)
    scale_v = made.volts_per_unit or 1.0
    notes = [
        f"radar = {preset}: not in the file; pulse, power and antennas are the preset's",
        f"1 unit of baseband = {scale_v:g} V (volts_per_unit of the preset): not in the file",
    ]
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(scale_v * values, dtype=np.complex64), made, notes


def up_convert_frames(
    baseband: npt.NDArray[np.complexfloating],
    *,
    carrier_hz: float,
    sample_rate_hz: float,
    decimation: int = 8,
    range_start_m: float = 0.0,
    bin_length_m: float | None = None,
) -> npt.NDArray[np.float64]:
    """Convert complex baseband to real RF frames.

    ``x[n] = 2 Re(y(t[n]) exp(j 2 pi f_c t[n]))``, with the factor 2 for the ``"hamming"`` filter of
    :func:`down_convert_frames`. It is inaccurate within a few bins of both ends.

    Parameters
    ----------
    baseband : ndarray, shape (I, M)
    carrier_hz, sample_rate_hz, decimation, range_start_m, bin_length_m
        As in :func:`down_convert_frames`; ``range_start_m`` is the range of the first baseband sample.

    Returns
    -------
    ndarray, shape (I, (M - 1) D + 1)
        RF samples from the first baseband sample to the last.
    """
    from scipy.signal import resample_poly

    spacing_m = SPEED_OF_LIGHT_MPS / (2.0 * sample_rate_hz) if bin_length_m is None else float(bin_length_m)
    n_samples = (baseband.shape[1] - 1) * decimation + 1
    cycles = carrier_hz / sample_rate_hz * (range_start_m / spacing_m + np.arange(n_samples))
    fine = resample_poly(np.asarray(baseband, dtype=np.complex128), decimation, 1, axis=1)[:, :n_samples]
    return np.asarray(2.0 * (fine * np.exp(2j * np.pi * np.mod(cycles, 1.0))).real)
