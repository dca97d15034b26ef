"""Continuous wave: one complex sample per frame, no range."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import numpy as np
import xarray as xr

from doppelgait.core.plugins import plugin
from doppelgait.core.samples import Matrix
from doppelgait.radar.link import compute_scatterer_arrays, path_phase_rad
from doppelgait.radar.parameters import Radar, Waveform


@plugin("waveform")
class Cw(Waveform):
    """Continuous wave: one sample per frame, one range bin.

    The sample is the sum of all echoes at all ranges; the bin represents the whole frame.
    """

    takes: ClassVar[tuple[str, ...]] = ("noise_bandwidth_hz", "integration_share")
    ranged: ClassVar[bool] = False

    kind: Literal["cw"] = "cw"

    def fill(self, table: Mapping[str, Any]) -> Mapping[str, Any]:
        """Set the default sampling rate, the frame rate.

        The sampling rate has no effect for this waveform.
        """
        if "sample_rate_hz" in table or "prf_hz" not in table:
            return table
        return {**table, "sample_rate_hz": table["prf_hz"]}

    def synthesise(self, scatterers: xr.Dataset, radar: Radar) -> Matrix:
        """Sum the echoes of all scatterers at all ranges.

        Each echo is a exp(j(theta + phi - 4 pi R / lambda)).
        """
        range_m, amplitude_v = compute_scatterer_arrays(scatterers, radar)
        turns = range_m * (2.0 / radar.wavelength_m)
        phase_rad = -2.0 * np.pi * (turns - np.rint(turns)) + radar.transmit_phase_rad
        extra_rad = path_phase_rad(scatterers)
        if extra_rad is not None:
            phase_rad += extra_rad
        total = (amplitude_v * np.exp(1j * phase_rad)).sum(axis=1, keepdims=True)
        return np.asarray(total, dtype=np.complex64)

    def n_range_bins(self, radar: Radar) -> int:
        """Return 1, the single range bin."""
        return 1

    def first_bin_m(self, radar: Radar) -> float:
        """Return the middle of the frame."""
        return 0.5 * (radar.range_start_m + radar.range_stop_m)

    def bin_spacing_m(self, radar: Radar) -> float:
        """Return the span of the frame."""
        return radar.range_stop_m - radar.range_start_m

    def resolution_m(self, radar: Radar) -> float:
        """Return the span of the frame."""
        return self.bin_spacing_m(radar)

    def noise_bandwidth_hz(self, radar: Radar) -> float:
        """Return the noise bandwidth of a sample.

        For a mean over T_i it is 1 / T_i. Without integration (``integration_share`` 0) an ideal low-pass with the
        width of the frame rate is assumed, which does not attenuate unambiguous echoes.
        """
        return radar.prf_hz / (radar.integration_share or 1.0)

    def unambiguous_range_m(self, radar: Radar) -> float:
        """Return inf: echoes do not fold."""
        return float("inf")
