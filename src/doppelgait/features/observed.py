"""Intermediate results of one target that several features share.

Envelopes, the torso line and the powers around it are computed once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.labels import Signal, sampling_rate_hz
from doppelgait.features.doppler import compute_quantile, envelopes_hz, raised_by_noise_v2, width_level_v2
from doppelgait.features.feature_set import Extraction, FloatArray, GaitFeatures

TIME_SHARES = (0.05, 0.95)
OCCUPIED_SIGMAS = 3.0
LEAST_SPEED_MPS = 0.2
"""Lowest radial speed at which a target has a direction; below it the sign of the velocity is random."""
SEEN_SHARE = 0.5
TORSO_REACH_MPS = 0.8
"""Largest distance of the torso's velocity from the main line (E-33: 40 Hz at 7.29 GHz)."""
TORSO_BAND_MPS = 0.4
NEAR_REACH_MPS = 1.6
"""Limits of the bands of the power shares (20 and 80 Hz at 7.29 GHz), as velocities that are valid for any carrier."""
CADENCE_HZ = (0.5, 20.0)
MIN_PERIODS_OF_HALVES = 2.0
"""Fewest periods at which a component at f_mu / 2 can be distinguished from the removed polynomial."""
SMOOTHED_OVER_S = 0.04
"""Standard deviation of the Gaussian that smooths the torso line (E-33)."""

REASONS = {
    "signal": "no_signal",
    "gait_frequency": "needs_a_gait_frequency",
    "direction": "slower_than_0.2_mps_towards_or_away",
    "envelope": "signal_in_too_few_columns",
    "line": "main_line_lost_in_noise",
}
"""Reason why a feature is None, by the requirement that is not met."""


ORDERS = np.arange(1, 5)
"""Multiples of f_mu / 2 that are the components of the torso's swing."""


class Envelopes(NamedTuple):
    """Envelopes around the main line (E-35b).
    They cover the columns with power above the noise. The leading envelope is in the direction of motion.
    """

    seen_share: float
    lead_mean_mps: float
    lead_sd_mps: float
    lag_mean_mps: float
    lag_sd_mps: float
    lead_low_mps: float
    lead_high_mps: float
    lag_low_mps: float
    lag_high_mps: float
    least_width_mps: float
    full_width_mps: float
    swing_share: float


class LinePower(NamedTuple):
    """Power above noise around the main line, range removed (E-28)."""

    torso_v2: float
    near_v2: float
    total_v2: float
    near_mean_v2: float
    near_sd_v2: float


@dataclass(eq=False)
class Observation:
    """Processed signature of one target, with cached intermediate results.

    Velocities are radial. "Forward" is the direction in which the target moves along the line of sight, so that an
    approaching and a receding target have the same features.

    Parameters
    ----------
    signature : Signal (time, doppler)
        mu, V^2.
    floor_v2 : float
        Noise floor nu.
    strongest_v2, peaks_hz : ndarray, shape (J,)
        Strongest cell of every column, and its Doppler.
    main_line_hz : ndarray, shape (J,)
        Straight main line.
    excess : Signal (time, doppler)
        mu - nu, aligned as ``aligned``.
    aligned : Signal (time, doppler)
        Normalised signature, aligned to the main line if that drifts.
    cadence_parts : CadenceParts
        Single rows of the cadence map of :attr:`rows`.
    spectrum : Signal (cadence)
        Power spectrum S.
    n_independent : float
        Independent columns J_eff.
    track_mps : float, optional
        Mean radial velocity of the gate's range; None for a fixed gate.
    bend_mps : float
        Mean velocity minus the mean of a straight line (:class:`doppelgait.processing.main_line.TrackVelocity`).
    agreed : bool
        True if main line and track agree on the velocity, or if their difference is resolved.
    drift_hz : ndarray, shape (J,), optional
        Line to which ``aligned`` and ``excess`` are aligned; None if it does not drift.
    extraction : Extraction
        The six features with quality and flags; empty until :func:`doppelgait.features.extract` has been called.

    See Also
    --------
    doppelgait.features.extract : extract the six features of an observation.
    """

    signature: Signal
    floor_v2: float
    strongest_v2: npt.NDArray[Any]
    peaks_hz: FloatArray
    main_line_hz: FloatArray
    excess: Signal
    aligned: Signal
    cadence_parts: Any
    spectrum: Signal
    observation_s: float
    n_independent: float

    track_mps: float | None = None
    bend_mps: float = 0.0
    agreed: bool = True
    drift_hz: FloatArray | None = None
    extraction: Extraction = field(default_factory=lambda: Extraction(GaitFeatures(), None, None, None))

    def describe_missing(self, needs: tuple[str, ...]) -> str | None:
        """Return why a requirement is not met, or None.

        A signal is always required.
        """
        if not self.has_signal:
            return REASONS["signal"]
        for need in needs:
            if not getattr(self, f"has_{need}"):
                return REASONS[need]
        return None

    @cached_property
    def has_signal(self) -> bool:
        """True if any cell is above the noise."""
        return self.extraction.torso_doppler_hz is not None

    @cached_property
    def has_gait_frequency(self) -> bool:
        """True if f_mu is known."""
        return self.extraction.gait_frequency_hz is not None

    @cached_property
    def has_direction(self) -> bool:
        """True if the target approaches or recedes."""
        return self.direction != 0.0

    @cached_property
    def has_envelope(self) -> bool:
        """True if half of the columns exceed the noise."""
        return self.edges.seen_share >= SEEN_SHARE

    @cached_property
    def has_line(self) -> bool:
        """True if the main line follows the torso."""
        return math.isfinite(self.torso_ripple_rms_mps)

    @cached_property
    def power_v2(self) -> npt.NDArray[Any]:
        """Signature, shape (J, K)."""
        return self.signature.values

    @cached_property
    def envelopes_hz(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper Doppler envelope (E-35b); shapes (J,)."""
        return envelopes_hz(self.signature, self.floor_v2)

    @cached_property
    def width_level_v2(self) -> FloatArray:
        """Power above the floor for B_mu (E-35), shape (J,)."""
        return width_level_v2(self.strongest_v2, self.floor_v2, self.range_weight)

    def count_above_level(self, edges: npt.NDArray[np.int64]) -> FloatArray:
        """Count cells above the raised level of B_mu (E-35).

        The blocks lie between ``edges``, in columns; the result has the shape (blocks, K).
        """
        counts = np.empty((edges.size - 1, self.excess.shape[1]))
        native.count_above(self.excess.values, self.raised_level_v2, edges, counts)
        return counts

    @cached_property
    def raised_level_v2(self) -> npt.NDArray[Any]:
        """Level of B_mu raised by noise (E-35), (J,).

        It has the same precision as the cells that are compared with it.
        """
        n_bins = max(1.0, float(self.signature.attrs["n_gate_bins"]))
        return raised_by_noise_v2(self.width_level_v2, self.floor_v2, n_bins).astype(self.excess.values.dtype)

    @cached_property
    def period_edges(self) -> npt.NDArray[np.int64]:
        """Ends of whole gait periods in columns, centred."""
        return self.compute_block_edges(1.0 / self.frequency_hz)

    def compute_block_edges(self, seconds: float) -> npt.NDArray[np.int64]:
        """Compute the ends of whole blocks in columns, centred."""
        n_columns = self.power_v2.shape[0]
        length = seconds * self.rate_hz
        count = int(n_columns / length + 1e-9)
        first = (n_columns - count * length) / 2.0
        return np.array([round(first + length * n) for n in range(count + 1)])

    @cached_property
    def noise_sd_v2(self) -> float:
        """Standard deviation of a noise cell, nu / sqrt(N_g)."""
        return self.floor_v2 / float(np.sqrt(max(1.0, float(self.signature.attrs["n_gate_bins"]))))

    @cached_property
    def rows(self) -> Signal:
        """Aligned normalised signature, detrended (E-31); (time, doppler)."""
        found: Signal = self.cadence_parts.detrend()
        return found

    @cached_property
    def mean_row(self) -> FloatArray:
        """Mean aligned normalised signature, D_1; shape (K,)."""
        return _average_rows(self.aligned.values)

    @cached_property
    def occupied(self) -> npt.NDArray[np.bool_]:
        """Doppler rows K+ above the noise (E-38), shape (K,).

        Their mean power is 3 standard deviations above the noise.
        """
        spread = self.floor_v2 / np.sqrt(self.signature.attrs["n_gate_bins"] * self.n_independent)
        return np.asarray(_average_rows(self.excess.values) > OCCUPIED_SIGMAS * spread)

    @cached_property
    def occupied_rows(self) -> npt.NDArray[np.int64]:
        """Numbers of the rows K+."""
        return np.flatnonzero(self.occupied)

    @cached_property
    def occupied_columns(self) -> FloatArray:
        """Aligned normalised signature in rows K+, (J, K+)."""
        return np.take(self.aligned.values, self.occupied_rows, axis=1, mode="clip")

    @cached_property
    def mps_per_hz(self) -> float:
        """Half a wavelength: speed per hertz of Doppler (E-05)."""
        return float(self.signature.attrs["wavelength_m"]) / 2.0

    @cached_property
    def velocity_mps(self) -> FloatArray:
        """Velocity of every Doppler row; shape (K,)."""
        return np.asarray(self.signature.axis("doppler") * self.mps_per_hz)

    @cached_property
    def bin_mps(self) -> float:
        """Velocity of one Doppler bin."""
        return float(self.velocity_mps[1] - self.velocity_mps[0])

    @cached_property
    def rate_hz(self) -> float:
        """Columns per second."""
        return sampling_rate_hz(self.signature.axis("time"))

    @cached_property
    def line_mps(self) -> FloatArray:
        """Straight main line; shape (J,)."""
        return np.asarray(self.main_line_hz * self.mps_per_hz)

    @cached_property
    def frequency_hz(self) -> float:
        """f_mu; only for features that need a gait frequency."""
        found = self.extraction.gait_frequency_hz
        return float("nan") if found is None else found

    @cached_property
    def direction(self) -> float:
        """1 approaching, -1 receding, 0 unknown."""
        mean_mps = float(self.line_mps.mean())
        return float(np.sign(mean_mps)) if abs(mean_mps) >= LEAST_SPEED_MPS else 0.0

    @cached_property
    def edges(self) -> Envelopes:
        """Envelopes around the main line (E-35b)."""
        found, (low_hz, high_hz) = np.empty(len(Envelopes._fields)), self.envelopes_hz
        native.edge_statistics(low_hz, high_hz, self.main_line_hz, self.direction, *TIME_SHARES, found)
        found[1:-1] *= self.mps_per_hz
        return Envelopes(*found.tolist())

    @cached_property
    def edges_mps(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper envelope (E-35b) as velocities; shapes (J,).

        NaN in columns without power above the noise.
        """
        low_hz, high_hz = self.envelopes_hz
        return low_hz * self.mps_per_hz, high_hz * self.mps_per_hz

    @property
    def forward_mps(self) -> FloatArray:
        """Lead of the leading envelope over the main line (E-35b).

        It has the columns with power above the noise.
        """
        low, high = self.edges_mps
        lead = high - self.line_mps if self.direction >= 0 else self.line_mps - low
        return np.asarray(lead[np.isfinite(low)])

    @property
    def backward_mps(self) -> FloatArray:
        """Lag of the trailing envelope behind the main line.

        It has the columns with power above the noise and is positive behind the line.
        """
        low, high = self.edges_mps
        lag = self.line_mps - low if self.direction >= 0 else high - self.line_mps
        return np.asarray(lag[np.isfinite(low)])

    @property
    def envelope_width_hz(self) -> float | None:
        """Bandwidth between the envelopes (E-35b).

        It is the 95th percentile over time of the upper envelope minus the 5th percentile of the lower one. It is None
        if less than half of the columns are above the noise.
        """
        return self.edges.full_width_mps / self.mps_per_hz if self.has_envelope else None

    @cached_property
    def range_weight(self) -> FloatArray:
        """Factor that removes the radar equation (E-28); shape (J,).

        It is (range / mean range)^4 of the gate.
        """
        centre_m = self.signature.axis("centre_range")
        return np.asarray((centre_m / centre_m.mean()) ** 4)

    @cached_property
    def about_line(self) -> tuple[LinePower, FloatArray, FloatArray]:
        """Power around the main line.

        Also returns the sum (V^4) and the moment (V^4 bins) of the squared power within 0.8 m/s of it, shapes (J,).
        """
        sums, (square, moment) = np.empty(len(LinePower._fields)), np.empty((2, self.power_v2.shape[0]))
        line = (self.line_mps - self.velocity_mps[0]) / self.bin_mps
        reaches = np.array([TORSO_BAND_MPS, NEAR_REACH_MPS, TORSO_REACH_MPS]) / self.bin_mps
        native.powers_about_line(
            self.power_v2, float(self.floor_v2), line, reaches, self.range_weight, sums, square, moment
        )
        return LinePower(*sums.tolist()), square, moment

    @cached_property
    def torso_ripple_mps(self) -> FloatArray:
        """Torso velocity around the main line, detrended, shape (J,).

        It is the smoothed centroid of the squared power near the line. Columns without power are filled from their
        neighbours; the result is NaN if half of the columns have no power. The removed slow part is a polynomial with
        the order of E-29.
        """
        _, square, moment = self.about_line
        basis = make_slow_basis(square.size, 1 if self.observation_s < 1.3 else 2 if self.observation_s < 2.5 else 3)
        return self.bin_mps * measure_swing(square, moment, SMOOTHED_OVER_S * self.rate_hz, basis)

    @cached_property
    def torso_ripple_rms_mps(self) -> float:
        """Root mean square of :attr:`torso_ripple_mps`."""
        return math.sqrt(float(self.torso_ripple_mps @ self.torso_ripple_mps) / self.torso_ripple_mps.size)

    @cached_property
    def ripple_parts(self) -> dict[int, float]:
        """Torso swing amplitudes by order of f_mu / 2."""
        halves = self.frequency_hz * self.observation_s >= MIN_PERIODS_OF_HALVES
        orders = ORDERS if halves else ORDERS[1::2]
        turn_rad = math.pi * self.frequency_hz / self.rate_hz
        return dict(zip(orders.tolist(), fit_waves(self.torso_ripple_mps, turn_rad, orders).tolist(), strict=True))

    @cached_property
    def cadence(self) -> tuple[FloatArray, FloatArray]:
        """Cadence axis and power spectrum, 0.5 to 20 Hz (E-32)."""
        cadence_hz = self.spectrum.axis("cadence")
        first, last = np.searchsorted(cadence_hz, CADENCE_HZ)
        return cadence_hz[first:last], self.spectrum.values[first:last]

    @cached_property
    def harmonic_powers(self) -> list[float]:
        """Power of four harmonics of f_mu above the noise.

        Each is the highest value of S within half a resolution cell. The noise is the median of S between the harmonics
        (E-38), and 0 if there are no values between them.
        """
        cadence_hz, power = self.cadence
        turns = cadence_hz / self.frequency_hz
        between = power[(np.abs(turns - np.floor(turns) - 0.5) <= 0.2) & (turns > 1.0) & (turns < 4.0)]
        noise = compute_quantile(between, 0.5) if between.size else 0.0
        centre_hz, half_cell_hz = self.frequency_hz * ORDERS, 0.5 / self.observation_s
        first = np.searchsorted(cadence_hz, centre_hz - half_cell_hz).tolist()
        last = np.searchsorted(cadence_hz, centre_hz + half_cell_hz).tolist()
        highest = [
            float(power[a : max(b, a + 1)].max()) if a < power.size else 0.0 for a, b in zip(first, last, strict=True)
        ]
        return [max(value - noise, 0.0) for value in highest]


def measure_swing(square: FloatArray, moment: FloatArray, sd: float, basis: FloatArray) -> FloatArray:
    """Smooth the centroid along a line and remove its slow part, in bins.
    It is NaN if too few columns have power. Shapes: square, moment (J,); basis (J, P).
    """
    seen, swing = np.flatnonzero(square > 0.0), np.full(square.size, np.nan)
    if seen.size >= SEEN_SHARE * square.size:
        line = np.interp(np.arange(square.size), seen, moment[seen] / square[seen])
        native.smooth(line, sd, False, swing)
        swing -= basis @ (basis.T @ swing)
    return swing


def fit_waves(values: FloatArray, turn_rad: float, orders: npt.NDArray[np.int64]) -> FloatArray:
    """Fit the amplitudes of multiples of a frequency together by least squares."""
    # the frequency is in radians per column, the orders rise; the cosines and sines need not be orthogonal
    phase = turn_rad * np.arange(values.size)
    turns = np.broadcast_to(np.cos(phase) + 1j * np.sin(phase), (int(orders[-1]), values.size))
    powers = np.multiply.accumulate(turns)[orders - 1]
    waves = np.concatenate([powers.real, powers.imag])
    parts = np.linalg.solve(waves @ waves.T, waves @ values)
    return np.asarray(np.hypot(*parts.reshape(2, -1)))


def _average_rows(values: npt.NDArray[Any]) -> FloatArray:
    found = np.empty(values.shape[1])
    native.row_means(values, found)
    return found


@lru_cache(maxsize=8)
def make_slow_basis(n_columns: int, order: int) -> FloatArray:
    """Compute orthonormal polynomials over the observation."""
    # the result has the shape (J, order + 1) and is read-only
    positions = np.linspace(-1.0, 1.0, n_columns)
    basis = np.asarray(np.linalg.qr(np.polynomial.legendre.legvander(positions, order))[0], dtype=np.float64)
    basis.flags.writeable = False
    return basis


def compute_square_difference(rows: FloatArray, first: int = 0, last: int | None = None) -> FloatArray:
    """Compute the rows' normalised square-difference autocorrelation (E-33)."""
    found = np.empty((rows.shape[0] if last is None else last + 1) - first)
    native.square_difference(rows, first, found)
    return found


def compute_autocorrelation_at(rows: FloatArray, lag: float) -> float | None:
    """Compute the normalised autocorrelation at a fractional lag (E-33).
    The autocorrelation is the square-difference form; it is None for lags longer than the record. Shapes: rows (J,).
    """
    whole = int(np.floor(lag))
    if whole < 1 or whole + 1 >= rows.shape[0]:
        return None
    values = compute_square_difference(rows.reshape(rows.shape[0], -1), whole, whole + 1)
    return float(values[0] + (lag - whole) * (values[1] - values[0]))
