"""What several features need of one target's signature: envelopes, the torso's line, powers about it; made once."""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.labels import axis, sampling_rate_hz
from doppelgait.features.doppler import envelopes_hz

if TYPE_CHECKING:
    from doppelgait.features.gait import Evidence, Extraction

FloatArray = npt.NDArray[np.float64]

LEAST_SPEED_MPS = 0.2
"""Slower than this along the line of sight a target has no direction: the sign of its velocity is chance."""
SEEN_SHARE = 0.5
TORSO_REACH_MPS = 0.8
"""The torso's velocity is sought this close to the main line (E-33: 40 Hz at 7.29 GHz)."""
TORSO_BAND_MPS = 0.4
NEAR_REACH_MPS = 1.6
"""Bands of the power shares: 20 and 80 Hz at 7.29 GHz, stated as velocities to hold for any carrier."""
TIME_SHARES = (0.05, 0.95)
CADENCE_HZ = (0.5, 20.0)
SMOOTHED_OVER_S = 0.04
"""Standard deviation of the Gaussian that smooths the torso's line (E-33)."""

REASONS = {
    "signal": "no_signal",
    "gait_frequency": "needs_a_gait_frequency",
    "direction": "slower_than_0.2_mps_towards_or_away",
    "envelope": "signal_in_too_few_columns",
    "line": "main_line_lost_in_noise",
}
"""Why a feature is None, by what it lacks."""


class Observed:
    """One target's evidence and extraction, with intermediate results that are made when first asked for.

    Velocities are radial. "Forward" is the direction in which the target moves along the line of sight, so that an
    approaching and a receding target have the same features.

    Parameters
    ----------
    evidence : Evidence
    extraction : Extraction
    """

    def __init__(self, evidence: Evidence, extraction: Extraction) -> None:
        self.evidence = evidence
        self.extraction = extraction

    def lacks(self, needs: tuple[str, ...]) -> str | None:
        """Reason why one of these cannot be had, or None; a signal is always needed."""
        return next((REASONS[need] for need in ("signal", *needs) if not getattr(self, f"has_{need}")), None)

    @cached_property
    def has_signal(self) -> bool:
        """Whether anything stands above the noise."""
        return self.extraction.torso_doppler_hz is not None

    @cached_property
    def has_gait_frequency(self) -> bool:
        """Whether f_mu is known."""
        return self.extraction.gait_frequency_hz is not None

    @cached_property
    def has_direction(self) -> bool:
        """Whether the target moves towards or away from the radar."""
        return self.direction != 0.0

    @cached_property
    def has_envelope(self) -> bool:
        """Whether half of the columns or more have power above the noise."""
        return bool(self.seen.mean() >= SEEN_SHARE)

    @cached_property
    def has_line(self) -> bool:
        """Whether the torso can be followed along the main line."""
        return bool(np.isfinite(self.torso_line_mps).all())

    # .values of an xarray object costs more than many of the sums made of them: asked for once
    @cached_property
    def power_v2(self) -> npt.NDArray[Any]:
        """The signature, shape (J, K)."""
        return np.asarray(self.evidence.signature.values)

    @cached_property
    def aligned(self) -> FloatArray:
        """Normalised signature, aligned if its line drifts; shape (J, K)."""
        return np.asarray(self.evidence.aligned.values)

    @cached_property
    def mean_row(self) -> FloatArray:
        """Time mean of the aligned normalised signature, D_1; shape (K,)."""
        return np.asarray(np.einsum("jk->k", self.aligned) / self.aligned.shape[0])

    @cached_property
    def occupied(self) -> npt.NDArray[np.int64]:
        """Numbers of the Doppler rows whose mean power stands above the noise, K+ (E-38)."""
        from doppelgait.features.gait import occupied_rows

        return np.flatnonzero(occupied_rows(self.evidence))

    @cached_property
    def occupied_columns(self) -> FloatArray:
        """The aligned normalised signature in the rows K+ alone; shape (J, K+)."""
        return np.asarray(np.take(self.aligned, self.occupied, axis=1))

    @cached_property
    def mps_per_hz(self) -> float:
        """Half a wavelength: radial velocity of one hertz of Doppler (E-05)."""
        return float(self.evidence.signature.attrs["wavelength_m"]) / 2.0

    @cached_property
    def velocity_mps(self) -> FloatArray:
        """Velocity of every Doppler row; shape (K,)."""
        return np.asarray(axis(self.evidence.signature, "doppler") * self.mps_per_hz)

    @cached_property
    def bin_mps(self) -> float:
        """Velocity of one Doppler bin."""
        return float(self.velocity_mps[1] - self.velocity_mps[0])

    @cached_property
    def rate_hz(self) -> float:
        """Columns per second."""
        return sampling_rate_hz(axis(self.evidence.signature, "time"))

    @cached_property
    def line_mps(self) -> FloatArray:
        """Straight main line; shape (J,)."""
        return np.asarray(self.evidence.main_line_hz * self.mps_per_hz)

    @cached_property
    def frequency_hz(self) -> float:
        """f_mu; only for features that need a gait frequency."""
        found = self.extraction.gait_frequency_hz
        return float("nan") if found is None else found

    @cached_property
    def direction(self) -> float:
        """1 approaching, -1 receding, 0 where that is not known."""
        mean_mps = float(self.line_mps.mean())
        return float(np.sign(mean_mps)) if abs(mean_mps) >= LEAST_SPEED_MPS else 0.0

    @cached_property
    def edges_mps(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper envelope (E-35), NaN in columns without power above the noise; shapes (J,)."""
        low_hz, high_hz = envelopes_hz(self.evidence.signature, self.evidence.floor_v2)
        return low_hz * self.mps_per_hz, high_hz * self.mps_per_hz

    @cached_property
    def seen(self) -> npt.NDArray[np.bool_]:
        """Columns with power above the noise; shape (J,)."""
        return np.asarray(np.isfinite(self.edges_mps[0]))

    @cached_property
    def width_mps(self) -> FloatArray:
        """Upper minus lower envelope (E-35) of the seen columns."""
        low, high = self.edges_mps
        return np.asarray((high - low)[self.seen])

    @cached_property
    def forward_mps(self) -> FloatArray:
        """How far the leading envelope (E-35) is ahead of the main line, in the seen columns."""
        return self._reach_mps(self.edges_mps[1 if self.direction >= 0 else 0], 1.0)

    @cached_property
    def backward_mps(self) -> FloatArray:
        """How far the trailing envelope is behind the main line, in the seen columns; positive behind."""
        return self._reach_mps(self.edges_mps[0 if self.direction >= 0 else 1], -1.0)

    def _reach_mps(self, edge: FloatArray, side: float) -> FloatArray:
        sense = side if self.direction >= 0 else -side
        return np.asarray(sense * (edge - self.line_mps)[self.seen])

    @cached_property
    def forward_limits_mps(self) -> tuple[float, float]:
        """5th and 95th percentile over time of the leading envelope's reach."""
        return limits(self.forward_mps)

    @cached_property
    def backward_limits_mps(self) -> tuple[float, float]:
        """5th and 95th percentile over time of the trailing envelope's reach."""
        return limits(self.backward_mps)

    @cached_property
    def range_weight(self) -> FloatArray:
        """Fourth power of the gate's range over its mean: undoes the radar equation (E-28); shape (J,)."""
        centre_m = axis(self.evidence.signature, "centre_range")
        return np.asarray((centre_m / centre_m.mean()) ** 4)

    @cached_property
    def near_line(self) -> tuple[FloatArray, FloatArray]:
        """Power above the noise and velocity relative to the main line of the cells about it, shapes (J, 2 h + 1)."""
        values, line = self.power_v2, self.line_mps
        reach = int(np.ceil(NEAR_REACH_MPS / self.bin_mps)) + 1
        reach = min(reach, (values.shape[1] - 1) // 2)
        centre = np.rint((line - self.velocity_mps[0]) / self.bin_mps).astype(np.int64)
        rows = centre[:, None] + np.arange(-reach, reach + 1)
        relative = self.velocity_mps[0] + rows * self.bin_mps - line[:, None]
        flat = rows % values.shape[1] + values.shape[1] * np.arange(values.shape[0])[:, None]
        cells = values.take(flat).astype(np.float64)
        cells -= self.evidence.floor_v2
        return cells, relative

    def _power_within_v2(self, reach_mps: float) -> FloatArray:
        """Power of every column within a velocity of the main line, cells at the edge in part, range taken out."""
        power, relative = self.near_line
        share = np.clip((reach_mps - np.abs(relative)) / self.bin_mps + 0.5, 0.0, 1.0)
        return np.asarray(np.einsum("jk,jk->j", power, share) * self.range_weight)

    @cached_property
    def torso_power_v2(self) -> FloatArray:
        """Power above the noise within 0.4 m/s of the main line, range taken out; shape (J,)."""
        return self._power_within_v2(TORSO_BAND_MPS)

    @cached_property
    def near_power_v2(self) -> FloatArray:
        """Power above the noise within 1.6 m/s of the main line, range taken out; shape (J,)."""
        return self._power_within_v2(NEAR_REACH_MPS)

    @cached_property
    def total_power_v2(self) -> FloatArray:
        """Power above the noise of all rows, range taken out; shape (J,)."""
        excess = self.power_v2.sum(axis=1, dtype=np.float64)
        excess -= self.evidence.floor_v2 * self.velocity_mps.size
        return np.asarray(excess * self.range_weight)

    @cached_property
    def torso_line_mps(self) -> FloatArray:
        """Velocity of the torso relative to the main line: centroid of the squared power near it, smoothed (E-33).

        Shape (J,); columns without power are filled from their neighbours, NaN where half of them have none.
        """
        from scipy.ndimage import gaussian_filter1d

        power, relative = self.near_line
        weight = np.where(np.abs(relative) <= TORSO_REACH_MPS, np.maximum(power, 0.0), 0.0) ** 2
        total = weight.sum(axis=1)
        found = total > 0
        if found.mean() < SEEN_SHARE:
            return np.full(found.size, np.nan)
        column = np.flatnonzero(found)
        centroid = np.einsum("jk,jk->j", weight, relative)[column] / total[column]
        filled = np.interp(np.arange(found.size), column, centroid)
        return np.asarray(gaussian_filter1d(filled, SMOOTHED_OVER_S * self.rate_hz, mode="nearest"))

    @cached_property
    def torso_ripple_mps(self) -> FloatArray:
        """The torso's line without its slow part: a polynomial of the order that E-29 allows; shape (J,)."""
        line = self.torso_line_mps
        basis = slow_basis(line.size, 1 if self.evidence.observation_s < 1.3 else self._slow_order)
        return np.asarray(line - basis @ (basis.T @ line))

    @property
    def _slow_order(self) -> int:
        return 2 if self.evidence.observation_s < 2.5 else 3

    @cached_property
    def cadence(self) -> tuple[FloatArray, FloatArray]:
        """Cadence axis and power spectrum S from 0.5 to 20 Hz (E-32)."""
        cadence_hz = axis(self.evidence.spectrum, "cadence")
        first, last = np.searchsorted(cadence_hz, CADENCE_HZ)
        return cadence_hz[first:last], self.evidence.spectrum.values[first:last]

    @cached_property
    def between_harmonics(self) -> float:
        """Median of S between the first four harmonics of f_mu, 0 where there is nothing between them (E-38)."""
        cadence_hz, power = self.cadence
        off = np.abs(np.mod(cadence_hz / self.frequency_hz, 1.0) - 0.5) <= 0.2
        found = power[off & (cadence_hz > self.frequency_hz) & (cadence_hz < 4.0 * self.frequency_hz)]
        return float(np.median(found)) if found.size else 0.0


def limits(values: FloatArray) -> tuple[float, float]:
    """5th and 95th percentile, interpolated as np.percentile does at three times the cost."""
    ordered = np.sort(values)
    low, high = np.interp(np.array(TIME_SHARES) * (ordered.size - 1), np.arange(ordered.size), ordered)
    return float(low), float(high)


@lru_cache(maxsize=8)
def slow_basis(n_columns: int, order: int) -> FloatArray:
    """Orthonormal polynomials over the observation, shape (J, order + 1); read only."""
    positions = np.linspace(-1.0, 1.0, n_columns)
    basis = np.asarray(np.linalg.qr(np.polynomial.legendre.legvander(positions, order))[0], dtype=np.float64)
    basis.flags.writeable = False
    return basis


def likeness_at(rows: FloatArray, lag: float) -> float | None:
    """Normalised square-difference autocorrelation at a lag that need not be whole (E-33), None beyond the record.

    Parameters
    ----------
    rows : ndarray, shape (J,) or (J, K)
        Without their mean.
    lag : float
        Columns; between two whole lags the value is interpolated.
    """
    whole = int(np.floor(lag))
    if whole < 1 or whole + 1 >= rows.shape[0]:
        return None
    flat = rows.reshape(rows.shape[0], -1)
    energy = np.einsum("jk,jk->j", flat, flat)  # no BLAS: its threads cost more than these few sums
    values = []
    for tau in (whole, whole + 1):
        total = float(energy[:-tau].sum() + energy[tau:].sum())
        product = float(np.einsum("jk,jk->", flat[:-tau], flat[tau:]))
        values.append(2.0 * product / total if total > 0 else 0.0)
    return values[0] + (lag - whole) * (values[1] - values[0])
