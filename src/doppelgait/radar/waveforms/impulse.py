"""The impulse radar: a sampled Gaussian pulse (E-11, E-15, E-18).

It is down-converted and sampled along fast time.
"""

from __future__ import annotations

import math
from typing import ClassVar, Literal

import numpy as np
import xarray as xr

from doppelgait.core.plugins import plugin
from doppelgait.core.samples import Matrix, Samples, borrow_planes
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.radar.link import compute_scatterer_arrays, path_phase_rad
from doppelgait.radar.parameters import PULSE_SIGMA_S, Radar, Waveform


@plugin("waveform")
class Impulse(Waveform):
    """A Gaussian pulse."""

    takes: ClassVar[tuple[str, ...]] = (
        "bandwidth_hz",
        "bandwidth_level_db",
        "pulse_sigma_s",
        "decimation",
        "noise_bandwidth_hz",
        "noise_correlation",
        "sweep_levels",
        "threshold_step_v",
        "pulse_rate_hz",
        "integration_share",
        "fold_echoes",
    )

    kind: Literal["impulse"] = "impulse"

    def check(self, radar: Radar) -> None:
        """Check the pulse.

        It must be stated once, have an allowed length, and a band that does not extend below 0 Hz.
        """
        if (radar.bandwidth_hz is None) == (radar.pulse_sigma_s is None):
            raise ValueError("give exactly one of bandwidth_hz and pulse_sigma_s")
        shortest_s, longest_s = PULSE_SIGMA_S
        if not shortest_s <= radar.sigma_s <= longest_s:
            key = "bandwidth_hz" if radar.pulse_sigma_s is None else "pulse_sigma_s"
            raise ValueError(
                f"{key} {getattr(radar, key)} makes a pulse of sigma {radar.sigma_s:.3g} s; allowed are "
                f"{shortest_s:g} to {longest_s:g} s"
            )
        half_band_hz = radar.pulse_bandwidth_hz(10) / 2.0
        if radar.carrier_hz < half_band_hz:
            raise ValueError(
                f"carrier_hz {radar.carrier_hz:g} is below half the pulse's 10 dB bandwidth, {half_band_hz:.4g} Hz: "
                "the band would extend below 0 Hz; raise carrier_hz or use a longer pulse"
            )

    def synthesise(self, scatterers: xr.Dataset, radar: Radar) -> Matrix:
        """Sum Gaussian echoes exactly, with an extra phase per path."""
        from doppelgait.core.kernels.synthesis import add_echoes

        range_m, amplitude_v = compute_scatterer_arrays(scatterers, radar)
        out = np.empty((range_m.shape[0], radar.n_range_bins), dtype=np.complex64)
        add_echoes(range_m, amplitude_v, *_make_geometry(radar), out, path_phase_rad(scatterers))
        return out

    def synthesise_planes(self, scatterers: xr.Dataset, radar: Radar) -> Samples:
        """Sum Gaussian echoes in the layout of the kernel."""
        if type(self).synthesise is not Impulse.synthesise:  # a subclass with samples of its own
            return super().synthesise_planes(scatterers, radar)
        from doppelgait.core.kernels.synthesis import LANES, echo_planes

        range_m, amplitude_v = compute_scatterer_arrays(scatterers, radar)
        n_pulses = range_m.shape[0]
        planes = borrow_planes((2, radar.n_range_bins, -(-n_pulses // LANES) * LANES))
        echo_planes(
            range_m, amplitude_v, *_make_geometry(radar), 0, 0, planes[0], planes[1], path_phase_rad(scatterers)
        )
        return Samples.from_planes(planes, n_pulses)

    def resolution_m(self, radar: Radar) -> float:
        """Return the half-power width of one echo, c sqrt(ln 2) tau (E-11)."""
        return SPEED_OF_LIGHT_MPS * math.sqrt(math.log(2)) * radar.sigma_s

    def noise_bandwidth_hz(self, radar: Radar) -> float:
        """Return the bandwidth of the down-conversion filter.

        It is the bandwidth of the pulse at 10 dB below its peak.
        """
        return radar.pulse_bandwidth_hz(10)

    def figures(self, radar: Radar) -> dict[str, float]:
        """Return pulse width and bandwidths (E-11)."""
        return {
            "pulse_sigma_s": radar.sigma_s,
            "pulse_bandwidth_3db_hz": radar.pulse_bandwidth_hz(3),
            "pulse_bandwidth_10db_hz": radar.pulse_bandwidth_hz(10),
        }


def _make_geometry(radar: Radar) -> tuple[float, float, float, float, float]:
    """Return the pulse geometry for the kernels."""
    sigma_m = radar.sigma_s * SPEED_OF_LIGHT_MPS / 2.0
    return radar.range_start_m, radar.bin_spacing_m, sigma_m, radar.wavelength_m, radar.transmit_phase_rad
