"""Scatterer table -> complex baseband data matrix, by the closed form of the down-converted echo (E-18)."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import xarray as xr

from doppelgait.core.config import canonical_json
from doppelgait.core.errors import ConfigError, DoppelgaitWarning
from doppelgait.core.labels import BASEBAND, axis, make_array
from doppelgait.core.units import SPEED_OF_LIGHT_MPS, velocity_to_doppler_hz
from doppelgait.radar.config import Radar
from doppelgait.radar.link import echo_amplitude_v, noise_power_v2


def synthesise(scatterers: xr.Dataset, radar: Radar) -> xr.DataArray:
    """Noise-free baseband of all scatterers, sampled directly at the radar's decimated rate.

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
        Needs ``range``, ``rcs`` and ``path_gain``; any source will do.
    radar : Radar

    Returns
    -------
    DataArray (slow_time, range)
        complex64, V at the receiver output. Superposition of all scatterers; range constant within a frame
        (stop-and-hop), migration from frame to frame kept.
    """
    from doppelgait.core.kernels.synthesis import add_echoes

    range_m, amplitude_v = scatterer_arrays(scatterers, radar)
    out = np.empty((range_m.shape[0], radar.n_range_bins), dtype=np.complex64)
    add_echoes(
        range_m,
        amplitude_v,
        radar.range_start_m,
        radar.bin_spacing_m,
        radar.sigma_s * SPEED_OF_LIGHT_MPS / 2.0,
        radar.wavelength_m,
        radar.transmit_phase_rad,
        out,
    )
    return label_baseband(out, axis(scatterers, "slow_time"), radar)


def scatterer_arrays(scatterers: xr.Dataset, radar: Radar) -> tuple[Any, Any]:
    """Contiguous float64 ranges (m) and echo amplitudes (V) of a scatterer table, both (slow_time, scatterer)."""
    range_m = np.ascontiguousarray(scatterers["range"].values, dtype=np.float64)
    amplitude_v = echo_amplitude_v(
        radar, range_m=range_m, rcs_m2=_row(scatterers["rcs"].values), path_gain=_row(scatterers["path_gain"].values)
    )
    return range_m, np.ascontiguousarray(amplitude_v)


def _row(values: Any) -> Any:
    """The values; of a table that repeats one row (a broadcast view) that row, which saves a pass over memory."""
    return values[:1] if values.strides[0] == 0 else values


def label_baseband(values: Any, slow_time_s: Any, radar: Radar) -> xr.DataArray:
    """Data matrix with its axes and the radar that made it."""
    coords = {"slow_time": slow_time_s, "range": radar.range_axis_m()}
    return make_array(BASEBAND, values, coords, {"radar": canonical_json(radar)})


def add_noise(baseband: xr.DataArray, *, noise_power_v2: float, rng: np.random.Generator) -> xr.DataArray:
    """Baseband with complex white Gaussian receiver noise of mean square ``noise_power_v2`` in every bin (E-18).

    Takes a single 64-bit key from ``rng``; the value in a bin of a frame is a function of (key, frame, bin) only.
    """
    from doppelgait.core.kernels.noise import add_noise_matrix, draw_key

    noisy = np.array(baseband.values, dtype=np.result_type(baseband.dtype, np.complex64), order="C")
    add_noise_matrix(noisy, draw_key(rng), float(np.sqrt(noise_power_v2)))
    return baseband.copy(data=noisy)


def frame_power_v2(baseband: xr.DataArray) -> float:
    """Signal level of SNR_frame: time mean of the strongest bin's |y|^2, V^2."""
    values = baseband.values
    return float((values.real**2 + values.imag**2).max(axis=1).mean(dtype=np.float64))


def noise_level_v2(radar: Radar, signal_v2: float, snr_db: float | None) -> float:
    """Noise level to add: thermal (E-18), or what gives the wanted SNR_frame in dB; inf gives 0.

    Raises
    ------
    ConfigError
        If an SNR is asked for but there is no signal: every target lies outside the frame.
    """
    if snr_db is None:
        return noise_power_v2(radar)
    if math.isnan(snr_db):
        raise ConfigError("snr_db is nan; it must be a number of dB, or inf for no noise")
    if not signal_v2 > 0:
        raise ConfigError(
            f"snr_db = {snr_db:g} cannot be set: no echo falls into the frame of {radar.range_start_m:g} to "
            f"{radar.range_stop_m:g} m; move the targets or change the frame"
        )
    return float(signal_v2 / 10.0 ** (snr_db / 10.0))


def snr_frame_db(signal_v2: float, noise_v2: float) -> float:
    """SNR_frame in dB: inf without noise, -inf where no echo falls into the frame."""
    if not noise_v2 > 0:
        return math.inf
    return 10.0 * math.log10(signal_v2 / noise_v2) if signal_v2 > 0 else -math.inf


def warn_of_limits(scatterers: xr.Dataset, radar: Radar) -> None:
    """Warn, naming the values, of scatterers that alias in Doppler or leave the frame, and of sparse range bins.

    Limits: E-06 for Doppler, E-15 for the frame, twice the half-power width of an echo (E-11) for the bins.
    """
    if radar.bin_spacing_m > 2.0 * radar.range_resolution_m:
        warnings.warn(
            f"sparse range bins: they are {radar.bin_spacing_m:.3g} m apart, but an echo is only "
            f"{radar.range_resolution_m:.3g} m wide, so that targets between two bins vanish; lower radar.decimation "
            f"({radar.decimation}) or raise radar.sample_rate_hz",
            DoppelgaitWarning,
            stacklevel=3,
        )
    speeds = scatterers["radial_velocity"].values
    fastest = max(float(speeds.max()), -float(speeds.min()))
    if fastest >= radar.unambiguous_velocity_mps:
        needed = 2.0 * float(velocity_to_doppler_hz(fastest, radar.wavelength_m)) + 60.0
        warnings.warn(
            f"aliasing: a scatterer reaches {fastest:.2f} m/s, but prf_hz = {radar.prf_hz:g} is unambiguous only to "
            f"{radar.unambiguous_velocity_mps:.2f} m/s; set radar.prf_hz to {np.ceil(needed / 10) * 10:g} or more",
            DoppelgaitWarning,
            stacklevel=3,
        )
    ranges = scatterers["range"].values
    nearest, farthest = float(ranges.min()), float(ranges.max())
    if nearest < radar.range_start_m or farthest > radar.range_stop_m:
        outside = float(((ranges < radar.range_start_m) | (ranges > radar.range_stop_m)).mean())
        share = f"{100 * outside:.0f} %" if outside >= 0.005 else "less than 1 %"
        warnings.warn(
            f"outside the frame: {share} of all scatterer samples (ranges {nearest:.2f} to "
            f"{farthest:.2f} m) lie outside {radar.range_start_m:g} to {radar.range_stop_m:g} m and are lost; move "
            "the target or change radar.range_start_m / range_stop_m",
            DoppelgaitWarning,
            stacklevel=3,
        )


def lowest_prf_hz(scatterers: xr.Dataset, radar: Radar, cpi_s: float) -> float:
    """Lowest frame rate at which no scatterer aliases: 2 (max |f_d| + 3 / T_d), rounded up to 1 Hz (E-06).

    For reproducing the report only: chosen per recording it tells the speed to every feature.
    """
    fastest = float(np.abs(scatterers["radial_velocity"].values).max())
    doppler_hz = float(velocity_to_doppler_hz(fastest, radar.wavelength_m))
    return float(np.ceil(2.0 * (doppler_hz + 3.0 / cpi_s)))
