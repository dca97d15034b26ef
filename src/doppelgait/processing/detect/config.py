"""Parameters of the detector."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel

Threshold = Literal["noise_map", "os_cfar", "ca_cfar"]
ClutterKind = Literal["none", "mean", "median", "exponential", "mti"]


class Detector(FrozenModel):
    """Parameters of the detector.

    The defaults suit an impulse radar with cells of 5 cm that observes people and dogs.

    method: Reference of a cell: the noise floor of its range bin over time and Doppler, or the
        cells around it in range at the same Doppler, as an ordered statistic (OS) or averaged (CA).
    clutter: Clutter removal before detection
        (:func:`doppelgait.processing.clutter.remove_static_clutter`); harmless where the clutter
        has been removed already.
    cpi_s: Coherent processing interval of a scan T_d.
    hop_s: Time from scan to scan.
    window_steepness: sigma_w of the Gaussian window (E-23).
    pfa: False-alarm probability of a cell that may belong to a body.
    peak_pfa: False-alarm probability of a peak, a cell that makes its cluster a body; not above
        ``pfa``.
    min_snr: A cluster without a peak is a body if the sum of its cells' power over the noise of one
        cell is at least this. At 50, noise alone reaches this about 10 times per minute (1 kHz, 188
        range bins, the other defaults), and has a cell above ``peak_pfa`` as often. If range bins
        share noise, the value is divided by the recording's independent noise values per bin.
    dynamic_range_db: Cells this far below the strongest Doppler cell of the same range bin and scan
        are its side lobes (43.8 dB for sigma_w = 0.4) and are ignored.
    slow_mps: Below this speed, the half width of a Doppler line, a cell is also compared with its
        permanent power (lower quartile of the scans), so that residual static clutter is not
        detected. A body that moves more slowly for half of the recording or longer is not detected.
        0 switches this off.
    near_m: Range bins nearer than this contain the direct path between the antennas and are
        ignored, unless there is only one bin.
    window_m: Half length of the CFAR window in range.
    guard_m: Part of the window next to the cell that is left out; a body must fit into it.
    rank: Rank of the ordered statistic among the cells of the window, as a share.
    resolution_m: Spacing of the cells of the CFAR window, chosen so that their noise is
        independent.
    join_range_m: Gaps in range up to this are closed before connected components are formed.
    join_doppler_hz: Gaps in Doppler up to this are closed.
    merge_range_m: Clusters are one body if their centres are closer than this in range and the gap
        between their Doppler boxes is at most ``merge_velocity_mps``.
    merge_velocity_mps: Largest gap between the Doppler boxes of clusters that are one body.
    limb_velocity_mps: Largest gap for a much weaker cluster with the same direction of motion, such
        as a swinging foot.
    box_quantile: Share of a cluster's power left out on either side of its box.
    min_cells: Fewest cells of a body.
    """

    method: Threshold = "noise_map"
    clutter: ClutterKind = "median"
    cpi_s: float = Field(default=0.1, gt=0, le=10)
    hop_s: float = Field(default=0.1, gt=0, le=10)
    window_steepness: float = Field(default=0.4, gt=0, le=10)
    pfa: float = Field(default=1e-3, gt=0, le=0.1)
    peak_pfa: float = Field(default=1e-6, gt=0, le=0.1)
    min_snr: float = Field(default=50.0, gt=0, le=1e9)
    dynamic_range_db: float = Field(default=40.0, gt=0, le=200)
    slow_mps: float = Field(default=0.5, ge=0, le=10)
    near_m: float = Field(default=0.4, ge=0, le=1e4)
    window_m: float = Field(default=2.0, gt=0, le=100)
    guard_m: float = Field(default=0.75, ge=0, le=100)
    rank: float = Field(default=0.6, gt=0, le=1)
    resolution_m: float = Field(default=0.09, gt=0, le=10)
    join_range_m: float = Field(default=0.36, ge=0, le=10)
    join_doppler_hz: float = Field(default=55.0, ge=0, le=1e4)
    merge_range_m: float = Field(default=0.8, ge=0, le=10)
    merge_velocity_mps: float = Field(default=0.5, ge=0, le=20)
    limb_velocity_mps: float = Field(default=3.0, ge=0, le=20)
    box_quantile: float = Field(default=0.01, ge=0, lt=0.5)
    min_cells: int = Field(default=2, ge=1, le=100_000)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.peak_pfa > self.pfa:
            raise ValueError(f"peak_pfa {self.peak_pfa:g} must not be above pfa {self.pfa:g}")
        if self.guard_m >= self.window_m:
            raise ValueError(f"guard_m {self.guard_m:g} must be below window_m {self.window_m:g}")
        return self
