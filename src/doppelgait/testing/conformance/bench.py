"""What is put through the suite: a simulator and the parts it may have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.errors import AnalysisError
from doppelgait.radar.parameters import Radar
from doppelgait.testing.conformance import theory

Complex = npt.NDArray[np.complex128]
Float = npt.NDArray[np.float64]

Simulator = Callable[[xr.Dataset, Radar], Any]
"""``(scatterers, radar) -> baseband``: DataArray (slow_time, range), or ndarray (I, N) on the radar's range axis, V."""


class Sweep(Protocol):
    """De-chirped samples of every sweep of an fmcw radar."""

    def __call__(self, scatterers: xr.Dataset, radar: Radar, /) -> Any:
        """Complex samples (I, S), the sweep's first sample first; the sign of the beat does not matter."""


class Noise(Protocol):
    """Receiver noise in the range bins of an empty room."""

    def __call__(self, radar: Radar, /, *, n_pulses: int, rng: np.random.Generator) -> Any:
        """Complex noise (n_pulses, N), V."""


class Quantise(Protocol):
    """Analogue-to-digital conversion of complex samples."""

    def __call__(self, samples: npt.NDArray[np.complex64], /, *, bits: int, full_scale_v: float) -> Any:
        """Samples as converted, I and Q with 2^bits levels from -full_scale_v to full_scale_v."""


class Wall(Protocol):
    """A wall square to +x between the radar and all scatterers; vertical polarisation."""

    def __call__(
        self, scatterers: xr.Dataset, /, *, permittivity: float, conductivity_s_per_m: float, thickness_m: float,
        carrier_hz: float,
    ) -> xr.Dataset:  # fmt: skip
        """Table with changed ``range``, ``path_gain`` and perhaps ``path_phase``; azimuth and elevation are given."""


class TwoRay(Protocol):
    """A smooth floor at height 0; vertical polarisation."""

    def __call__(
        self, scatterers: xr.Dataset, /, *, permittivity: float, conductivity_s_per_m: float, radar_height_m: float,
        carrier_hz: float,
    ) -> xr.Dataset:  # fmt: skip
        """Table with the reflected echoes as further rows; azimuth and elevation are given."""


@dataclass(frozen=True)
class Bench:
    """A simulator and its parts; None for a part that it does not have."""

    simulator: Simulator
    sweep: Sweep | None = None
    noise: Noise | None = None
    quantise: Quantise | None = None
    wall: Wall | None = None
    two_ray: TwoRay | None = None


def bins_of(bench: Bench, scatterers: xr.Dataset, radar: Radar) -> tuple[Float, Complex]:
    """Range axis (N,) and baseband (I, N) that the simulator gives.

    Raises
    ------
    AnalysisError
        If the baseband has another shape or other dimensions.
    """
    result = bench.simulator(scatterers, radar)
    if isinstance(result, xr.DataArray):
        if result.dims != ("slow_time", "range") or "range" not in result.coords:
            raise AnalysisError(
                f"the simulator's DataArray has the dimensions {result.dims}; it must have (slow_time, range) and a "
                "coordinate range, m"
            )
        axis_m, values = np.asarray(result["range"].values, dtype=float), result.values
    else:
        axis_m, values = theory.range_axis_m(radar), result
    wanted = (scatterers.sizes["slow_time"], axis_m.size)
    return axis_m, complex_of(values, wanted, what=f"the simulator's baseband for waveform {radar.waveform.kind!r}")


def complex_of(values: Any, shape: tuple[int, int], *, what: str) -> Complex:
    """Values as complex128, after a look at their shape."""
    array = np.asarray(values)
    if array.shape != shape:
        raise AnalysisError(f"{what} has the shape {array.shape}; it must be {shape}")
    return array.astype(np.complex128)
