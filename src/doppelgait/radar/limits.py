"""Warnings where a scene does not fit the radar."""

from __future__ import annotations

import warnings

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.core.labels import axis
from doppelgait.core.units import velocity_to_doppler_hz
from doppelgait.radar.parameters import Radar


def warn_of_limits(scatterers: xr.Dataset, radar: Radar) -> None:
    """Warn, naming the values, of what the radar cannot show of these scatterers.

    Sparse range bins (further apart than twice the half-power width of an echo), aliasing in Doppler (E-06), and
    targets outside the frame (E-15) or beyond the range at which echoes fold. Scatterers that belong to no target
    (number -1) may lie anywhere. A carrier too low for its band is refused where the radar is made. Range migration
    needs no warning: from frame to frame it is simulated, and within a sweep a scatterer that does not alias moves by
    less than a quarter wavelength and its range-Doppler coupling, f_c v T_c / B, stays below c / (4 B), half a cell.
    """
    _warn_of_sparse_bins(radar)
    if scatterers.sizes["scatterer"] == 0:
        return
    speeds = scatterers["radial_velocity"].values
    fastest_mps = max(float(speeds.max()), -float(speeds.min()))
    _warn_of_aliasing(fastest_mps, radar)
    _warn_of_frame(_target_ranges_m(scatterers), radar)


def _warn(text: str) -> None:
    warnings.warn(text, DoppelgaitWarning, stacklevel=5)


def _target_ranges_m(scatterers: xr.Dataset) -> npt.NDArray[np.float64]:
    ranges_m = np.asarray(scatterers["range"].values)
    if "target" not in scatterers.coords:
        return ranges_m
    own = axis(scatterers, "target") >= 0
    return ranges_m if own.all() else ranges_m[:, own]


def _warn_of_sparse_bins(radar: Radar) -> None:
    if radar.n_range_bins > 1 and radar.bin_spacing_m > 2.0 * radar.range_resolution_m:
        _warn(
            f"sparse range bins: they are {radar.bin_spacing_m:.3g} m apart, but an echo is only "
            f"{radar.range_resolution_m:.3g} m wide, so that targets between two bins vanish; lower radar.decimation "
            f"({radar.decimation}) or raise radar.sample_rate_hz"
        )


def _warn_of_aliasing(fastest_mps: float, radar: Radar) -> None:
    if fastest_mps >= radar.unambiguous_velocity_mps:
        needed = 2.0 * float(velocity_to_doppler_hz(fastest_mps, radar.wavelength_m)) + 60.0
        _warn(
            f"aliasing: a scatterer reaches {fastest_mps:.2f} m/s, but prf_hz = {radar.prf_hz:g} is unambiguous only "
            f"to {radar.unambiguous_velocity_mps:.2f} m/s; set radar.prf_hz to {np.ceil(needed / 10) * 10:g} or more"
        )


def _warn_of_frame(ranges_m: npt.NDArray[np.float64], radar: Radar) -> None:
    """Outside the frame, or beyond the range at which echoes fold; a radar without range sees all of them."""
    if ranges_m.size == 0 or not radar.waveform.ranged:
        return
    nearest, farthest = float(ranges_m.min()), float(ranges_m.max())
    waveform = radar.waveform
    folding_m = waveform.unambiguous_range_m(radar)
    if waveform.folds and farthest >= folding_m:
        _warn(
            f"folding: a scatterer is {farthest:.2f} m away, beyond the unambiguous range of {folding_m:.4g} m, where "
            "echoes appear again from 0 m on; move the target, raise radar.sample_rate_hz or lower radar.bandwidth_hz"
        )
    elif nearest < radar.range_start_m or farthest > radar.range_stop_m:
        outside = float(((ranges_m < radar.range_start_m) | (ranges_m > radar.range_stop_m)).mean())
        share = f"{100 * outside:.0f} %" if outside >= 0.005 else "less than 1 %"
        _warn(
            f"outside the frame: {share} of all scatterer samples (ranges {nearest:.2f} to "
            f"{farthest:.2f} m) lie outside {radar.range_start_m:g} to {radar.range_stop_m:g} m and are lost; move "
            "the target or change radar.range_start_m / range_stop_m"
        )
