"""Range-Doppler maps of a recording, scan by scan."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.frames import Frames
from doppelgait.core.units import FloatArray, doppler_to_velocity_mps
from doppelgait.processing.config import Analysis
from doppelgait.processing.detect.config import Detector
from doppelgait.processing.signature import compute_cell_power, plan_columns

FIRST_QUANTILE = 0.3
CUT_AT = 4.0  # cells above this many floors are left out of the second estimate
ROUNDS = 3
RESIDUE_QUANTILE = 0.25
MIN_SCANS = 10  # fewest scans from which the level of a cell over time is estimated


def noise_factor(pfa: float, *, n_summed: int = 1) -> float:
    r"""Compute the threshold factor for a known mean noise power.

    A cell of noise with mean :math:`\nu` is exponential, :math:`P(x > T) = e^{-T / \nu}`, and the
    sum of ``n_summed`` cells is a Gamma variable. For one cell the factor is :math:`-\ln P_{fa}`.
    """
    if n_summed == 1:
        return -math.log(pfa)
    from scipy.stats import gamma

    return float(gamma.isf(pfa, n_summed)) / n_summed


def estimate_noise_map(power_v2: npt.NDArray[np.floating[Any]]) -> npt.NDArray[np.float64]:
    r"""Estimate the mean noise power of each range bin.

    The first value is the 0.3-quantile over time and Doppler, divided by :math:`-\ln 0.7`. It is
    refined three times: the mean of the cells below four times the value is divided by :math:`1 - 4
    e^{-4} / (1 - e^{-4})`, the mean of an exponential variable truncated at 4. Bodies are far above
    this limit and hardly influence the result, while nearly all noise cells are used.

    Parameters
    ----------
    power_v2 : ndarray, shape (J, K, N)
        Range-Doppler power of J scans, one noise level per range bin.

    Returns
    -------
    ndarray, shape (N,)
        In the unit of ``power_v2``.
    """
    cells = power_v2[:, ::2].reshape(-1, power_v2.shape[2])  # neighbours add little (E-23)
    place = int(FIRST_QUANTILE * cells.shape[0])
    floor = np.partition(cells, place, axis=0)[place].astype(np.float64) / -math.log1p(-FIRST_QUANTILE)
    share = 1.0 - CUT_AT * math.exp(-CUT_AT) / -math.expm1(-CUT_AT)
    for _ in range(ROUNDS):
        below = cells < (CUT_AT * floor).astype(cells.dtype)
        total = np.einsum("in,in->n", cells, below)
        floor = total / np.maximum(np.count_nonzero(below, axis=0), 1) / share
    return np.asarray(floor, dtype=np.float64)


def estimate_residue_map(power_v2: npt.NDArray[np.floating[Any]]) -> npt.NDArray[np.float64]:
    """Estimate the mean power of permanent echoes per cell, (K, N)."""
    if power_v2.shape[0] < MIN_SCANS:
        return np.zeros(power_v2.shape[1:])
    quantile = np.quantile(power_v2, RESIDUE_QUANTILE, axis=0)
    return np.asarray(quantile / -math.log1p(-RESIDUE_QUANTILE), dtype=np.float64)


BLOCK_SCANS = 600  # number of scans with a common noise map: one minute at 10 Hz


@dataclass(frozen=True)
class Maps:
    """Range-Doppler maps of some scans; the mean of white noise is its variance."""

    time_s: FloatArray
    doppler_hz: FloatArray
    velocity_mps: FloatArray
    range_m: FloatArray
    power_v2: npt.NDArray[np.float32]
    floor_v2: FloatArray

    @property
    def bin_spacing_m(self) -> float:
        """Spacing of range bins, infinite for a radar without range."""
        size = self.range_m.size
        return float(self.range_m[-1] - self.range_m[0]) / (size - 1) if size > 1 else math.inf

    @property
    def velocity_spacing_mps(self) -> float:
        """Spacing of Doppler bins as a velocity."""
        return float(self.velocity_mps[1] - self.velocity_mps[0])


def compute_maps(frames: Frames, settings: Detector, *, wavelength_m: float) -> Iterator[Maps]:
    """Compute maps in blocks of about a minute. Each block has its own noise map."""
    hop = max(1, round(settings.hop_s * frames.slow_time.rate_hz))
    analysis = Analysis(cpi_s=settings.cpi_s, hop=hop, window_steepness=settings.window_steepness)
    transform, times_s, doppler_hz, prf_hz, apart = plan_columns(frames.slow_time, analysis)
    window = transform.window / np.sqrt((transform.window**2).sum())  # so that the mean of white noise is its variance
    columns = np.arange(0, transform.n_columns, max(1, round(settings.hop_s * prf_hz / apart)))  # not every burst
    for scans in np.array_split(columns, math.ceil(columns.size / BLOCK_SCANS)):
        power = compute_cell_power(frames, transform, window, scans)
        yield Maps(
            time_s=times_s[scans],
            doppler_hz=doppler_hz,
            velocity_mps=doppler_to_velocity_mps(doppler_hz, wavelength_m),
            range_m=frames.range_m,
            power_v2=power,
            floor_v2=estimate_noise_map(power),
        )
        del power  # before the next block is computed
