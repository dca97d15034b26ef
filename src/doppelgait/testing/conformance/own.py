"""Simulator of doppelgait and its parts, in the form that the suite takes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.radar.parameters import Radar


def simulate_bins(scatterers: xr.Dataset, radar: Radar) -> xr.DataArray:
    """Noise-free baseband."""
    from doppelgait.radar.simulate import synthesise

    return synthesise(scatterers, radar)


def sweep_samples(scatterers: xr.Dataset, radar: Radar, /) -> npt.NDArray[np.complex64]:
    """Receiver samples of every sweep."""
    from doppelgait.radar.simulate import synthesise_samples

    return synthesise_samples(scatterers, radar)


def receiver_noise(radar: Radar, /, *, n_pulses: int, rng: np.random.Generator) -> npt.NDArray[np.complex64]:
    """Thermal noise of the receiver's samples, compressed to range bins."""
    from doppelgait.radar.impairments import ThermalNoise, apply_impairments
    from doppelgait.radar.simulate import compress

    silence = np.zeros((n_pulses, radar.waveform.n_samples(radar)), dtype=np.complex64)
    return compress(apply_impairments(silence, [ThermalNoise()], radar=radar, rng=rng), radar)


def quantised(samples: npt.NDArray[np.complex64], /, *, bits: int, full_scale_v: float) -> npt.NDArray[np.complex64]:
    """Samples behind the uniform converter."""
    from doppelgait.radar.impairments import Adc, apply_impairments
    from doppelgait.testing.conformance.radars import suite_radars

    spec = Adc(bits=bits, full_scale_v=full_scale_v)
    return apply_impairments(samples, [spec], radar=suite_radars("cw")["cw"], rng=np.random.default_rng(0))


def behind_wall(
    scatterers: xr.Dataset, /, *, permittivity: float, conductivity_s_per_m: float, thickness_m: float,
    carrier_hz: float,
) -> xr.Dataset:  # fmt: skip
    """Table behind a wall of the material."""
    material = {"permittivity": permittivity, "conductivity_s_per_m": conductivity_s_per_m}
    return _in_surroundings(
        scatterers, {"kind": "wall", "material": material, "thickness_m": thickness_m}, carrier_hz, height_m=1.0
    )


def over_floor(
    scatterers: xr.Dataset, /, *, permittivity: float, conductivity_s_per_m: float, radar_height_m: float,
    carrier_hz: float,
) -> xr.Dataset:  # fmt: skip
    """Table over a floor of the material."""
    material = {"permittivity": permittivity, "conductivity_s_per_m": conductivity_s_per_m}
    return _in_surroundings(
        scatterers, {"kind": "ground_bounce", "material": material}, carrier_hz, height_m=radar_height_m
    )


def _in_surroundings(
    scatterers: xr.Dataset, effect: dict[str, Any], carrier_hz: float, *, height_m: float
) -> xr.Dataset:
    from doppelgait.core.units import carrier_to_wavelength_m
    from doppelgait.scene.environment import Setting, apply_environment, make_effect

    setting = Setting(carrier_to_wavelength_m(carrier_hz), (0.0, 0.0, height_m))
    return apply_environment(scatterers, [make_effect(effect)], setting)
