"""The tested simulator and its parts, and those of doppelgait."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.radar import Radar
from doppelgait_conformance import theory

Complex = npt.NDArray[np.complex128]
Float = npt.NDArray[np.float64]

Simulator = Callable[[xr.Dataset, Radar], Any]
"""``(scatterers, radar) -> baseband``: DataArray (slow_time, range), or ndarray (I, N) on the radar's range axis, V."""


class Sweep(Protocol):
    """De-chirped samples of every sweep of an FMCW radar."""

    def __call__(self, scatterers: xr.Dataset, radar: Radar, /) -> Any:
        """Return complex samples (I, S) in order of time."""


class Noise(Protocol):
    """Receiver noise in the range bins of an empty room."""

    def __call__(self, radar: Radar, /, *, n_pulses: int, rng: np.random.Generator) -> Any:
        """Return complex noise (n_pulses, N), V."""


class Quantise(Protocol):
    """Analogue-to-digital conversion of complex samples."""

    def __call__(self, samples: npt.NDArray[np.complex64], /, *, bits: int, full_scale_v: float) -> Any:
        """Convert I and Q to 2^bits levels within full scale."""


class Wall(Protocol):
    """Wall between radar and scatterers, normal along +x; the polarisation is vertical."""

    def __call__(
        self,
        scatterers: xr.Dataset,
        /,
        *,
        permittivity: float,
        conductivity_s_per_m: float,
        thickness_m: float,
        carrier_hz: float,
    ) -> xr.Dataset:
        """Change ``range``, ``path_gain`` and, if used, ``path_phase`` of a table with angles."""


class TwoRay(Protocol):
    """A smooth floor at height 0; vertical polarisation."""

    def __call__(
        self,
        scatterers: xr.Dataset,
        /,
        *,
        permittivity: float,
        conductivity_s_per_m: float,
        radar_height_m: float,
        carrier_hz: float,
    ) -> xr.Dataset:
        """Append reflected echoes to a table with angles."""


@dataclass(frozen=True)
class Bench:
    """A simulator and its parts; None for a missing part."""

    simulator: Simulator
    sweep: Sweep | None = None
    noise: Noise | None = None
    quantise: Quantise | None = None
    wall: Wall | None = None
    two_ray: TwoRay | None = None


def simulate_baseband(bench: Bench, scatterers: xr.Dataset, radar: Radar) -> tuple[Float, Complex]:
    """Return the simulator's range axis (N,) and baseband (I, N)."""
    result = bench.simulator(scatterers, radar)
    if isinstance(result, xr.DataArray):
        if result.dims != ("slow_time", "range") or "range" not in result.coords:
            raise ValueError(
                f"the simulator's DataArray has the dimensions {result.dims}; it must have (slow_time, range) and a "
                "coordinate range, m"
            )
        axis_m, values = np.asarray(result["range"].values, dtype=float), result.values
    else:
        axis_m, values = theory.range_axis_m(radar), result
    wanted = (scatterers.sizes["slow_time"], axis_m.size)
    return axis_m, check_complex(values, wanted, what=f"the simulator's baseband for waveform {radar.waveform.kind!r}")


def check_complex(values: Any, shape: tuple[int, int], *, what: str) -> Complex:
    """Check the shape of values and return them as complex128."""
    array = np.asarray(values)
    if array.shape != shape:
        raise ValueError(f"{what} has the shape {array.shape}; it must be {shape}")
    return array.astype(np.complex128)


def simulate_bins(scatterers: xr.Dataset, radar: Radar) -> xr.DataArray:
    """Simulate the noise-free baseband."""
    from doppelgait.radar import synthesise

    return synthesise(scatterers, radar)


def simulate_sweep(scatterers: xr.Dataset, radar: Radar, /) -> npt.NDArray[np.complex64]:
    """Simulate the receiver samples of every sweep."""
    from doppelgait.radar import synthesise_samples

    return synthesise_samples(scatterers, radar)


def sample_receiver_noise(radar: Radar, /, *, n_pulses: int, rng: np.random.Generator) -> npt.NDArray[np.complex64]:
    """Sample thermal noise of the receiver, compressed to range bins."""
    from doppelgait.radar import compress
    from doppelgait.radar.impairments import ThermalNoise, apply_impairments

    silence = np.zeros((n_pulses, radar.waveform.n_samples(radar)), dtype=np.complex64)
    return compress(apply_impairments(silence, [ThermalNoise()], radar=radar, rng=rng), radar)


def quantise_samples(
    samples: npt.NDArray[np.complex64], /, *, bits: int, full_scale_v: float
) -> npt.NDArray[np.complex64]:
    """Pass samples through the uniform converter."""
    from doppelgait.radar.impairments import Adc, apply_impairments
    from doppelgait_conformance.radars import list_suite_radars

    spec = Adc(bits=bits, full_scale_v=full_scale_v)
    return apply_impairments(samples, [spec], radar=list_suite_radars("cw")["cw"], rng=np.random.default_rng(0)).matrix


def apply_wall(
    scatterers: xr.Dataset,
    /,
    *,
    permittivity: float,
    conductivity_s_per_m: float,
    thickness_m: float,
    carrier_hz: float,
) -> xr.Dataset:
    """Apply a wall of the material to a table."""
    material = {"permittivity": permittivity, "conductivity_s_per_m": conductivity_s_per_m}
    return _apply_effect(
        scatterers, {"kind": "wall", "material": material, "thickness_m": thickness_m}, carrier_hz, height_m=1.0
    )


def apply_floor(
    scatterers: xr.Dataset,
    /,
    *,
    permittivity: float,
    conductivity_s_per_m: float,
    radar_height_m: float,
    carrier_hz: float,
) -> xr.Dataset:
    """Apply a floor of the material to a table."""
    material = {"permittivity": permittivity, "conductivity_s_per_m": conductivity_s_per_m}
    return _apply_effect(
        scatterers, {"kind": "ground_bounce", "material": material}, carrier_hz, height_m=radar_height_m
    )


def _apply_effect(scatterers: xr.Dataset, effect: dict[str, Any], carrier_hz: float, *, height_m: float) -> xr.Dataset:
    from doppelgait.scene.environment import Setting, apply_environment, make_effect

    setting = Setting(theory.C_MPS / carrier_hz, (0.0, 0.0, height_m))
    return apply_environment(scatterers, [make_effect(effect)], setting)
