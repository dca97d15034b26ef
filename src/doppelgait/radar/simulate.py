"""Synthesise receiver samples and baseband of scatterers, with noise.

The full-rate RF samples and their digital down-conversion (E-16, E-17) are slow and for validation only.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.errors import AnalysisError, ConfigError, warn_caller
from doppelgait.core.labels import BASEBAND, AnyTable, ScattererTable, make_array, replace_array_values, takes_arrays
from doppelgait.core.lazy import read_tiles, xr
from doppelgait.core.rng import draw_key
from doppelgait.core.samples import WHITE, Samples
from doppelgait.core.units import exponential, range_to_delay_s, velocity_to_doppler_hz
from doppelgait.radar.link import compute_echoes, fold_scatterers, make_noise_taps, noise_power_v2
from doppelgait.radar.parameters import Radar
from doppelgait.radar.recording import make_baseband_facts


def synthesise(scatterers: AnyTable, radar: Radar) -> xr.DataArray:
    """Synthesise the noise-free baseband of all scatterers.

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
        Table with ``range``, ``rcs`` and ``path_gain``, ``radial_velocity`` for waveforms with a
        sweep, and optionally ``path_phase``. It may have any source.
    radar : Radar

    Returns
    -------
    DataArray (slow_time, range)
        Superposition of all scatterers, complex64, V at the receiver output. Range migration from frame to frame is
        included; motion within a frame depends on the waveform (E-18, :mod:`doppelgait.radar.waveforms`).
    """
    table = ScattererTable.of(scatterers)
    bins = radar.waveform.synthesise_bins(fit_waveform(fold_scatterers(table, radar), radar), radar)  # without planes
    return label_baseband(bins, table.slow_time_s, radar)


def synthesise_samples(scatterers: AnyTable, radar: Radar) -> npt.NDArray[np.complex64]:
    """Synthesise noise-free receiver samples of all scatterers.

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
        As for :func:`synthesise`.
    radar : Radar

    Returns
    -------
    ndarray, shape (I, S)
        complex64, V. The samples are the range bins for impulse, rectangular and lfm, the samples
        of every sweep for fmcw, the frequency steps for stepped, and one sample per frame for cw.
    """
    table = fold_scatterers(ScattererTable.of(scatterers), radar)
    return radar.waveform.synthesise(fit_waveform(table, radar), radar)


def fit_waveform(table: ScattererTable, radar: Radar) -> AnyTable:
    """Label a table for a waveform that takes no plain arrays."""
    kind = type(radar.waveform)
    plain = all(map(takes_arrays, (kind.synthesise, kind.synthesise_planes, kind.synthesise_bins)))
    return table if plain else table.label()


def synthesise_echoes(scatterers: ScattererTable, radar: Radar, *, compressed: bool) -> Samples:
    """Synthesise echoes of folded scatterers without noise: range bins, or samples in any layout."""
    table, waveform = fit_waveform(scatterers, radar), radar.waveform
    if compressed and not waveform.samples_are_bins:
        return Samples.own(waveform.synthesise_bins(table, radar))
    return waveform.synthesise_planes(table, radar)


def compress(samples: Samples | npt.NDArray[Any], radar: Radar) -> npt.NDArray[np.complex64]:
    """Compress receiver samples to range bins.

    For fmcw and stepped this is a window and a transform; for other waveforms the samples do not change.

    Parameters
    ----------
    samples : Samples or ndarray, shape (I, S), complex
        V.
    radar : Radar

    Returns
    -------
    ndarray, shape (I, N)
        complex64, V. The amplitude of a point echo does not change; noise with the mean square s^2
        per sample has s^2 times the waveform's ``noise_gain`` per bin.

    Raises
    ------
    AnalysisError
        If the number of samples per row is not that of the radar.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2})], duration_s=3.0)
    >>> radar = dg.Radar.preset("ti-77")
    >>> samples = dg.radar.synthesise_samples(dg.scene.assemble(scene, [0.0, 1.0]), radar)
    >>> bins = dg.radar.compress(samples, radar)
    >>> radar.range_axis_m()[abs(bins).argmax(axis=1)].round(1)  # range of the strongest echo after 0 and 1 s
    array([6.8, 5.5])
    """
    waveform, samples = radar.waveform, np.asarray(samples)
    if samples.ndim != 2 or samples.shape[1] != waveform.n_samples(radar):
        raise AnalysisError(
            f"receiver samples have the shape {samples.shape}; a radar of waveform {radar.waveform.kind!r} with these "
            f"parameters has {waveform.n_samples(radar)} samples per frame, shape (frames, samples)"
        )
    return waveform.compress(samples, radar)


def label_baseband(values: Any, slow_time_s: Any, radar: Radar) -> xr.DataArray:
    """Label a data matrix with its axes and radar."""
    coords = {"slow_time": slow_time_s, "range": radar.range_axis_m()}
    return make_array(BASEBAND, values, coords, make_baseband_facts(radar))


def add_noise(baseband: xr.DataArray, *, noise_power_v2: float, rng: np.random.Generator) -> xr.DataArray:
    """Add Gaussian receiver noise to a baseband (E-18).

    It is complex with the mean square ``noise_power_v2`` in every bin, and correlated over range as
    the baseband's radar states. The value in a bin is a function of (a key of ``rng``, frame, bin).

    Examples
    --------
    >>> import doppelgait as dg
    >>> import numpy as np
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2})], duration_s=3.0)
    >>> radar = dg.Radar.preset("x4")
    >>> table = dg.scene.assemble(scene, [0.0, 1.0])
    >>> closed, exact = dg.radar.synthesise(table, radar), dg.radar.synthesise_rf(table, radar)
    >>> round(float(abs(exact - closed).max() / abs(exact).max()), 2)  # relative difference
    0.0
    >>> rng = np.random.default_rng(1)
    >>> noisy = dg.radar.add_noise(closed, noise_power_v2=1e-12, rng=rng)
    >>> f"{float((abs(noisy - closed) ** 2).mean()):.0e} V^2"
    '1e-12 V^2'
    """
    stated = baseband.attrs.get("radar")
    factor = WHITE if stated is None else make_noise_taps(Radar.model_validate_json(stated))
    noisy = np.array(baseband.values, dtype=np.result_type(baseband.dtype, np.complex64), order="C")
    native.add_noise_matrix(noisy, draw_key(rng), float(np.sqrt(noise_power_v2)), factor)
    return replace_array_values(baseband, noisy)


def strongest_powers_v2(bins: Samples) -> npt.NDArray[np.float32]:
    """Return the strongest bin's |y|^2 of every pulse, V^2."""
    strongest = np.empty(bins.shape[0], dtype=np.float32)
    native.strongest_power(*bins.planes, strongest)
    return strongest


def noise_level_v2(radar: Radar, signal_v2: float, snr_db: float | None) -> float:
    """Return the noise level to add, V^2: thermal (E-18), or for an SNR_frame in dB."""
    if snr_db is None:
        return noise_power_v2(radar)
    if math.isnan(snr_db) or snr_db == -math.inf:
        raise ConfigError(f"snr_db is {snr_db}; it must be a number of dB, or inf for no noise")
    if not signal_v2 > 0:
        raise ConfigError(
            f"snr_db = {snr_db:g} is not possible: no echo is in the frame of {radar.range_start_m:g} to "
            f"{radar.range_stop_m:g} m; move the targets or change the frame"
        )
    return float(signal_v2 / 10.0 ** (snr_db / 10.0))


def snr_frame_db(signal_v2: float, noise_v2: float) -> float:
    """Return SNR_frame in dB. It is inf without noise, and -inf without an echo in the frame."""
    ratio = signal_v2 / noise_v2 if noise_v2 > 0 else math.inf
    return 10.0 * math.log10(ratio) if ratio > 0 else -math.inf


def lowest_prf_hz(scatterers: AnyTable, radar: Radar, cpi_s: float) -> float:
    """Return the lowest frame rate without Doppler aliasing (E-06).

    It is 2 (max |f_d| + 3 / T_d), rounded up to 1 Hz.
    Use it only to reproduce the report: a rate per recording reveals the speed to every feature.
    """
    fastest = float(np.abs(ScattererTable.of(scatterers)["radial_velocity"]).max(initial=0.0))
    doppler_hz = float(velocity_to_doppler_hz(fastest, radar.wavelength_m))
    return float(np.ceil(2.0 * (doppler_hz + 3.0 / cpi_s)))


def warn_of_limits(scatterers: AnyTable, radar: Radar, *, has_jumps: bool = False) -> None:
    """Warn of scatterers that the radar cannot show. The warnings state the values (E-06, E-15)."""
    if radar.n_range_bins > 1 and radar.bin_spacing_m > 2.0 * radar.range_resolution_m:
        warn_caller(
            f"sparse range bins: their spacing is {radar.bin_spacing_m:.3g} m, but an echo is only "
            f"{radar.range_resolution_m:.3g} m wide, so that targets between two bins vanish; lower radar.decimation "
            f"({radar.decimation}) or raise radar.sample_rate_hz"
        )
    table = ScattererTable.of(scatterers)
    if table.shape[1] == 0:
        return
    fastest_mps = 0.0
    for _, speeds in read_tiles(table["radial_velocity"]):
        fastest_mps = max(fastest_mps, float(speeds.max()), -float(speeds.min()))
    if fastest_mps >= radar.unambiguous_velocity_mps and not has_jumps:  # a jump is no speed for a higher rate
        needed = 2.0 * float(velocity_to_doppler_hz(fastest_mps, radar.wavelength_m)) + 60.0
        warn_caller(
            f"aliasing: a scatterer reaches {fastest_mps:.2f} m/s, but prf_hz = {radar.prf_hz:g} is unambiguous only "
            f"to {radar.unambiguous_velocity_mps:.2f} m/s; set radar.prf_hz to {np.ceil(needed / 10) * 10:g} or more"
        )
    own = table["target"] >= 0 if "target" in table else np.ones(1, dtype=bool)
    if not own.any() or not radar.waveform.ranged:
        return
    nearest, farthest, outside = math.inf, -math.inf, 0.0
    for _, ranges_m in read_tiles(table["range"]):
        ranges_m = ranges_m if own.all() else ranges_m[:, own]
        low_m, high_m = float(ranges_m.min()), float(ranges_m.max())
        nearest, farthest = min(nearest, low_m), max(farthest, high_m)
        if low_m < radar.range_start_m or high_m > radar.range_stop_m:
            beyond = (ranges_m < radar.range_start_m) | (ranges_m > radar.range_stop_m)
            outside += float(beyond.mean()) * ranges_m.shape[0] / table.shape[0]
    waveform = radar.waveform
    folding_m = waveform.unambiguous_range_m(radar)
    folds = radar.folds_pulses or not waveform.samples_are_bins
    if folds and farthest >= folding_m:
        remedy = (
            "lower radar.pulse_rate_hz, or set radar.fold_echoes = false for a hypothetical radar"
            if radar.folds_pulses
            else "raise radar.sample_rate_hz or lower radar.bandwidth_hz"
        )
        warn_caller(
            f"folding: a scatterer is {farthest:.2f} m away, beyond the unambiguous range of {folding_m:.4g} m; its "
            f"echo appears at {farthest % folding_m:.2f} m, the truth keeps the range; move the target, {remedy}"
        )
    elif nearest < radar.range_start_m or farthest > radar.range_stop_m:
        share = f"{100 * outside:.0f} %" if outside >= 0.005 else "less than 1 %"
        warn_caller(
            f"outside the frame: {share} of all scatterer samples (ranges {nearest:.2f} to "
            f"{farthest:.2f} m) lie outside {radar.range_start_m:g} to {radar.range_stop_m:g} m and are lost; move "
            "the target or change radar.range_start_m / range_stop_m"
        )


FILTER_TAPS = 129
FILTER_CUTOFF_HZ = 3.2e9
FILTER_BETA = 9.5


def sample_rf_frames(scatterers: AnyTable, radar: Radar, *, margin: int) -> npt.NDArray[np.float64]:
    """Return full-rate real samples (I, n_full + 2 margin) of the received RF frames (E-16)."""
    n_full = (radar.n_range_bins - 1) * radar.decimation + 1
    first_s = range_to_delay_s(radar.range_start_m) - margin / radar.sample_rate_hz
    time_s = first_s + np.arange(n_full + 2 * margin) / radar.sample_rate_hz
    range_m, amplitude_v, extra_rad = compute_echoes(fold_scatterers(ScattererTable.of(scatterers), radar), radar)
    frames = np.zeros((range_m.shape[0], time_s.size))
    for i in range(range_m.shape[0]):
        delay_s = range_to_delay_s(range_m[i])[:, None]
        phase = (
            radar.transmit_phase_rad
            + (0.0 if extra_rad is None else extra_rad[i][:, None])
            - 4.0 * np.pi * np.mod(range_m[i], radar.wavelength_m)[:, None] / radar.wavelength_m
        )
        carrier = np.cos(2.0 * np.pi * radar.carrier_hz * time_s + phase)
        pulse = exponential(-0.5 * ((time_s - delay_s) / radar.sigma_s) ** 2)
        frames[i] = (amplitude_v[i][:, None] * pulse * carrier).sum(axis=0)
    return frames


def down_convert(frames: npt.NDArray[np.float64], radar: Radar, *, margin: int) -> npt.NDArray[np.complex128]:
    """Convert real RF frames (I, n_full + 2 margin) to baseband: mix, low-pass, decimate (E-17)."""
    from scipy.signal import firwin, oaconvolve

    first_s = range_to_delay_s(radar.range_start_m) - margin / radar.sample_rate_hz
    time_s = first_s + np.arange(frames.shape[1]) / radar.sample_rate_hz
    mixed = 2.0 * frames * np.exp(-2j * np.pi * radar.carrier_hz * time_s)
    # a symmetric low-pass that rejects the image
    taps = firwin(FILTER_TAPS, FILTER_CUTOFF_HZ, window=("kaiser", FILTER_BETA), fs=radar.sample_rate_hz)
    filtered = oaconvolve(mixed, taps[None, :], mode="same", axes=1)
    stop = frames.shape[1] - margin
    return np.asarray(filtered[:, margin : stop : radar.decimation])


def synthesise_rf(scatterers: AnyTable, radar: Radar) -> xr.DataArray:
    """Synthesise the baseband by RF sampling and down-conversion.

    It is the reference for the closed form of :func:`synthesise`, with the same parameters and axes.
    """
    margin = FILTER_TAPS + int(np.ceil(5.5 * radar.sigma_s * radar.sample_rate_hz))
    table = ScattererTable.of(scatterers)
    frames = sample_rf_frames(table, radar, margin=margin)
    values = down_convert(frames, radar, margin=margin)
    return label_baseband(values, table.slow_time_s, radar)
