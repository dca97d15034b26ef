"""Intermediate results of one target that several features share.

Envelopes, the torso line and the powers around it are computed once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Generic, NamedTuple, TypeVar, overload

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.labels import Signal, sampling_rate_hz
from doppelgait.core.straight import make_orthonormal_basis
from doppelgait.core.units import FloatArray, doppler_to_velocity_mps
from doppelgait.features.doppler import (
    WIDTH_SHARE,
    compute_quantile,
    compute_snr_db,
    envelopes_hz,
    raised_by_noise_v2,
    width_level_v2,
    width_of_bins,
)
from doppelgait.features.feature_set import Extraction, GaitFeatures
from doppelgait.features.gait_frequency import GaitFrequency, estimate_gait_frequencies, measure_target_rhythms

MIN_SNR_DB = 0.0
TIME_SHARES = (0.05, 0.95)
OCCUPIED_SIGMAS = 3.0
LEAST_SPEED_MPS = 0.2
"""Lowest radial speed at which a target has a direction; below it the sign is random."""
SEEN_SHARE = 0.5
TORSO_REACH_MPS = 0.8
"""Largest distance of the torso's velocity from the main line (E-33: 40 Hz at 7.29 GHz)."""
TORSO_BAND_MPS = 0.4
NEAR_REACH_MPS = 1.6
"""Limits of the bands of the power shares (20 and 80 Hz at 7.29 GHz), as velocities that are valid for any carrier."""
CADENCE_HZ = (0.5, 20.0)
MIN_PERIODS_OF_HALVES = 2.0
"""Fewest periods at which a component at f_mu / 2 differs from the removed polynomial."""
SMOOTHED_OVER_S = 0.04  # standard deviation of the Gaussian that smooths the torso line (E-33)

REASONS = {
    "signal": "no_signal",
    "gait_frequency": "needs_a_gait_frequency",
    "direction": "slower_than_0.2_mps_towards_or_away",
    "envelope": "signal_in_too_few_columns",
    "line": "main_line_lost_in_noise",
}
"""Reason why a feature is None, by the requirement that is not met."""

ORDERS = np.arange(1, 5)  # multiples of f_mu / 2 that are the components of the torso's swing


class Envelopes(NamedTuple):
    """Envelopes around the main line (E-35b); the leading one is in the direction of motion."""

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


T = TypeVar("T")


class Shared(Generic[T]):
    """Value that a function of many observations computes at once."""

    def __init__(self, measure: Callable[[Sequence[Observation]], Iterable[T]]) -> None:
        self.measure, self.__doc__ = measure, measure.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, observed: None, kind: type) -> Shared[T]: ...

    @overload
    def __get__(self, observed: Observation, kind: type) -> T: ...

    def __get__(self, observed: Observation | None, kind: type) -> Shared[T] | T:
        if observed is None:
            return self
        self.fill([observed])  # alone: a batch of one; from now on Python reads the observation's own value
        value: T = observed.__dict__[self.name]
        return value

    def fill(self, observations: Sequence[Observation]) -> None:
        """Compute the value of observations with equal axes."""
        if observations:
            for observed, value in zip(observations, self.measure(observations), strict=True):
                observed.__dict__[self.name] = value


def measure_gaits(observations: Sequence[Observation]) -> list[GaitFrequency]:
    """Estimate f_mu with its probabilities (E-33)."""
    rhythms = measure_target_rhythms((seen.aligned, seen.excess, seen.floor_v2) for seen in observations)
    return estimate_gait_frequencies(rhythms, np.array([seen.torso_mps for seen in observations]))


def measure_widths(observations: Sequence[Observation]) -> list[float]:
    """Measure the width above the level of B_mu in bins (E-35), NaN without any."""
    n_columns = observations[0].power_v2.shape[0]
    counts = np.concatenate([seen.count_above_level(np.array([0, n_columns])) for seen in observations])
    return list(map(float, width_of_bins(counts / np.count_nonzero(observations[0].counted))))


def measure_ripples(observations: Sequence[Observation]) -> FloatArray:
    """Measure the torso velocity around the main line, (J,), without the polynomial of E-29."""
    # NaN if half of the columns have no power; otherwise these are filled from their neighbours
    any_one, (square, moment) = observations[0], np.array([seen.about_line[1:] for seen in observations]).swapaxes(0, 1)
    seconds = any_one.observation_s
    basis = make_orthonormal_basis(square.shape[-1], 1 if seconds < 1.3 else 2 if seconds < 2.5 else 3)
    return any_one.bin_mps * measure_swing(square, moment, SMOOTHED_OVER_S * any_one.rate_hz, basis)


def measure_ripple_parts(observations: Sequence[Observation]) -> list[dict[int, float]]:
    """Measure the torso swing amplitudes by order of f_mu / 2."""
    frequency_hz = np.array([seen.frequency_hz for seen in observations])
    swing = np.stack([seen.torso_ripple_mps for seen in observations])
    parts: list[dict[int, float]] = [{} for _ in observations]
    halves = frequency_hz * observations[0].observation_s >= MIN_PERIODS_OF_HALVES
    for orders, chosen in ((ORDERS, np.flatnonzero(halves)), (ORDERS[1::2], np.flatnonzero(~halves))):
        if chosen.size:
            turns_rad = math.pi * frequency_hz[chosen] / observations[0].rate_hz
            waves = fit_waves(swing[chosen], turns_rad, orders, observations[0].counted)
            for n, fitted in zip(chosen, waves.tolist(), strict=True):
                parts[n] = dict(zip(orders.tolist(), fitted, strict=True))
    return parts


@dataclass(eq=False)
class Observation:
    """Processed signature of one target, with cached intermediate results.

    Velocities are radial. "Forward" is the direction in which the target moves along the line of
    sight, so that an approaching and a receding target have the same features.

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
    make_excess : Callable
        Returns :attr:`excess`.
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
    make_excess: Callable[[], Signal]
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

    gait = Shared(measure_gaits)
    width_bins = Shared(measure_widths)
    torso_ripple_mps = Shared(measure_ripples)
    ripple_parts = Shared(measure_ripple_parts)

    def __post_init__(self) -> None:
        wavelength_m = float(self.signature.attrs["wavelength_m"])
        self.power_v2: npt.NDArray[Any] = self.signature.values  # (J, K)
        self.counted = self.signature.counted
        self.counted_share = float(self.counted.mean())
        self.chosen = slice(None) if self.counted.all() else self.counted  # to index columns without a copy
        self.rate_hz = sampling_rate_hz(self.signature.axis("time"))  # columns per second
        self.mps_per_hz = wavelength_m / 2.0  # speed per hertz of Doppler (E-05)
        self.velocity_mps: FloatArray = self.signature.axis("doppler") * self.mps_per_hz  # of every Doppler row, (K,)
        self.bin_mps = float(self.velocity_mps[1] - self.velocity_mps[0])
        self.line_mps: FloatArray = self.main_line_hz * self.mps_per_hz  # straight main line, (J,)
        self.mean_line_mps = float(self.line_mps.sum()) / self.line_mps.size
        is_fast = abs(self.mean_line_mps) >= LEAST_SPEED_MPS
        self.direction = math.copysign(1.0, self.mean_line_mps) if is_fast else 0.0  # 1 approaching, -1 receding
        self.has_direction = self.direction != 0.0
        self.n_bins = max(1.0, float(self.signature.attrs["n_gate_bins"]))
        self.noise_sd_v2 = self.floor_v2 / math.sqrt(self.n_bins)  # of a noise cell, nu / sqrt(N_g)
        # mean Doppler and radial velocity v_m of the torso
        self.torso_hz = float(self.main_line_hz.sum()) / self.line_mps.size + self.bend_mps / self.mps_per_hz
        self.torso_mps = float(doppler_to_velocity_mps(self.torso_hz, wavelength_m))

    def describe_missing(self, needs: tuple[str, ...]) -> str | None:
        """Return why a requirement is not met, or None; a signal is always required."""
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

    @property
    def is_folded(self) -> bool:
        """True if the Doppler axis has one side, and the body's band reaches its end at 0 Hz."""
        low_hz = self.envelopes_hz[0]
        starts_at_zero = self.velocity_mps[0] == 0.0
        return bool(starts_at_zero and np.nanmean(low_hz < 2.0 * self.bin_mps / self.mps_per_hz) > WIDTH_SHARE)

    @cached_property
    def has_envelope(self) -> bool:
        """True if half of the columns exceed the noise."""
        return self.edges.seen_share >= SEEN_SHARE

    @cached_property
    def has_line(self) -> bool:
        """True if the main line follows the torso."""
        return math.isfinite(self.torso_ripple_rms_mps)

    @cached_property
    def envelopes_hz(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper Doppler envelope (E-35b); shapes (J,)."""
        return envelopes_hz(self.signature, self.floor_v2)

    @cached_property
    def width_level_v2(self) -> FloatArray:
        """Power above the floor for B_mu (E-35), shape (J,)."""
        strongest_v2, weight = self.strongest_v2[self.chosen], self.range_weight[self.chosen]
        return np.asarray(width_level_v2(strongest_v2, self.floor_v2, weight) / self.range_weight)

    def count_above_level(self, edges: npt.NDArray[np.int64]) -> FloatArray:
        """Count cells above the raised level of B_mu between edges (E-35), (blocks, K)."""
        counts = np.empty((edges.size - 1, self.power_v2.shape[1]))
        native.count_above(self.excess.values, self.raised_level_v2, edges, counts)
        return counts

    @cached_property
    def raised_level_v2(self) -> npt.NDArray[Any]:
        """Level of B_mu raised by noise (E-35), (J,), in the precision of the cells."""
        return raised_by_noise_v2(self.width_level_v2, self.floor_v2, self.n_bins).astype(self.power_v2.dtype)

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
    def rows(self) -> Signal:
        """Aligned normalised signature, detrended (E-31); (time, doppler)."""
        found: Signal = self.cadence_parts.detrend()
        return found

    @property
    def excess(self) -> Signal:
        """Power above the floor, mu - nu, aligned as ``aligned``; (J, K)."""
        return self.make_excess()  # of a long recording too large to keep

    @cached_property
    def mean_row(self) -> FloatArray:
        """Mean aligned normalised signature, D_1; shape (K,)."""
        return _average_rows(self.aligned.values) / self.counted_share

    @cached_property
    def occupied(self) -> npt.NDArray[np.bool_]:
        """Doppler rows K+, 3 standard deviations above the noise (E-38), (K,)."""
        spread = self.floor_v2 / math.sqrt(self.signature.attrs["n_gate_bins"] * self.n_independent)
        return np.asarray(_average_rows(self.excess.values) / self.counted_share > OCCUPIED_SIGMAS * spread)

    @cached_property
    def occupied_rows(self) -> npt.NDArray[np.int64]:
        """Numbers of the rows K+."""
        return np.flatnonzero(self.occupied)

    @property
    def occupied_columns(self) -> FloatArray:
        """Aligned normalised signature in rows K+, (J, K+)."""
        columns = np.empty((self.aligned.shape[0], self.occupied_rows.size))
        native.copy_rows(self.aligned.values, self.occupied_rows, columns)
        return columns

    @cached_property
    def frequency_hz(self) -> float:
        """f_mu; only for features that need a gait frequency."""
        found = self.extraction.gait_frequency_hz
        return float("nan") if found is None else found

    @cached_property
    def snr_db(self) -> float:
        """Ratio of the signature to the noise in dB."""
        return compute_snr_db(self.strongest_v2[self.chosen], self.floor_v2)

    @cached_property
    def edges(self) -> Envelopes:
        """Envelopes around the main line (E-35b)."""
        found, lines = np.empty(len(Envelopes._fields)), (*self.envelopes_hz, self.main_line_hz)
        native.edge_statistics(*(line[self.chosen] for line in lines), self.direction, *TIME_SHARES, found)
        found[1:-1] *= self.mps_per_hz
        return Envelopes(*found.tolist())

    @cached_property
    def edges_mps(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper envelope (E-35b) as velocities, (J,); NaN without power."""
        low_hz, high_hz = self.envelopes_hz
        return low_hz * self.mps_per_hz, high_hz * self.mps_per_hz

    @property
    def forward_mps(self) -> FloatArray:
        """Lead of the leading envelope over the main line (E-35b), in columns with power."""
        low, high = self.edges_mps
        lead = high - self.line_mps if self.direction >= 0 else self.line_mps - low
        return np.asarray(lead[np.isfinite(low)])

    @property
    def backward_mps(self) -> FloatArray:
        """Lag of the trailing envelope behind the main line, positive, in columns with power."""
        low, high = self.edges_mps
        lag = self.line_mps - low if self.direction >= 0 else high - self.line_mps
        return np.asarray(lag[np.isfinite(low)])

    @property
    def envelope_width_hz(self) -> float | None:
        """Bandwidth between the envelopes, from 5 to 95 % of the time (E-35b)."""
        return self.edges.full_width_mps / self.mps_per_hz if self.has_envelope else None

    @cached_property
    def range_weight(self) -> FloatArray:
        """Factor (range / mean range)^4 that removes the radar equation (E-28), (J,)."""
        # the equation is one of the far field; a radar without range has the range 0, and every factor is 1
        centre_m = np.maximum(self.signature.axis("centre_range"), float(self.signature.attrs["wavelength_m"]))
        return np.asarray(((centre_m / (centre_m.sum() / centre_m.size)) ** 2) ** 2)

    @cached_property
    def about_line(self) -> tuple[LinePower, FloatArray, FloatArray]:
        """Power around the main line.

        Also returns the sum (V^4) and the moment (V^4 bins) of the squared power within 0.8 m/s of it, shapes (J,).
        """
        sums, (square, moment) = np.empty(len(LinePower._fields)), np.zeros((2, self.power_v2.shape[0]))
        line = (self.line_mps - self.velocity_mps[0]) / self.bin_mps
        reaches = np.array([TORSO_BAND_MPS, NEAR_REACH_MPS, TORSO_REACH_MPS]) / self.bin_mps
        power_v2, line, weight = (values[self.chosen] for values in (self.power_v2, line, self.range_weight))
        found = np.empty((2, line.size))
        native.powers_about_line(power_v2, float(self.floor_v2), line, reaches, weight, sums, *found)
        square[self.chosen], moment[self.chosen] = found
        return LinePower(*sums.tolist()), square, moment

    @cached_property
    def torso_ripple_rms_mps(self) -> float:
        """Root mean square of :attr:`torso_ripple_mps`."""
        ripple_mps = self.torso_ripple_mps[self.chosen]
        return math.sqrt(float(ripple_mps @ ripple_mps) / ripple_mps.size)

    @cached_property
    def cadence(self) -> tuple[FloatArray, FloatArray]:
        """Cadence axis and power spectrum, 0.5 to 20 Hz (E-32)."""
        cadence_hz = self.spectrum.axis("cadence")
        first, last = cadence_hz.searchsorted(CADENCE_HZ)
        return cadence_hz[first:last], self.spectrum.values[first:last]

    @cached_property
    def harmonic_powers(self) -> list[float]:
        """Power of four harmonics of f_mu above the noise, the median of S between them (E-38)."""
        cadence_hz, power = self.cadence
        turns = cadence_hz / self.frequency_hz
        between = power[(np.abs(turns - np.floor(turns) - 0.5) <= 0.2) & (turns > 1.0) & (turns < 4.0)]
        noise = compute_quantile(between, 0.5) if between.size else 0.0
        centre_hz, half_cell_hz = self.frequency_hz * ORDERS, 0.5 / self.observation_s
        first = cadence_hz.searchsorted(centre_hz - half_cell_hz).tolist()
        last = cadence_hz.searchsorted(centre_hz + half_cell_hz).tolist()
        highest = [
            float(power[a : max(b, a + 1)].max()) if a < power.size else 0.0 for a, b in zip(first, last, strict=True)
        ]
        return [max(value - noise, 0.0) for value in highest]


def share_set_f(observations: Sequence[Observation]) -> None:
    """Compute together what the set F needs of observations with equal axes."""
    audible = [seen for seen in observations if seen.snr_db > MIN_SNR_DB]
    for shared in (Observation.gait, Observation.width_bins):
        shared.fill(audible)


def share_extended(observations: Sequence[Observation]) -> None:
    """Compute together what further features and uncertainties need, after the set F."""
    audible = [seen for seen in observations if seen.has_signal]
    Observation.torso_ripple_mps.fill(audible)
    Observation.ripple_parts.fill([seen for seen in audible if seen.has_gait_frequency and seen.has_line])


def measure_swing(square: FloatArray, moment: FloatArray, sd: float, basis: FloatArray) -> FloatArray:
    """Smooth the centroid along a line and remove its slow part, in bins."""
    # It is NaN if too few columns have power. Shapes: square, moment (B, J); basis (J, P).
    swing, columns = np.full(square.shape, np.nan), np.arange(square.shape[-1])
    for power, product, smoothed in zip(square, moment, swing, strict=True):
        seen = np.flatnonzero(power > 0.0)
        if seen.size >= SEEN_SHARE * columns.size:
            native.smooth(np.interp(columns, seen, product[seen] / power[seen]), sd, False, smoothed)
    slow = basis @ (basis.T @ swing[..., np.newaxis])
    return np.asarray(swing - slow[..., 0])


def fit_waves(values: FloatArray, turns_rad: FloatArray, orders: npt.NDArray[np.int64], counted: Any = 1) -> FloatArray:
    """Fit the amplitudes of multiples of a frequency by least squares."""
    # the frequencies are in radians per column, the orders rise; the cosines and sines need not be
    # orthogonal. Shapes: values (B, J); turns_rad (B,); result (B, orders)
    phase = turns_rad[:, np.newaxis] * np.arange(values.shape[-1])
    turns = np.empty((len(values), orders[-1], phase.shape[-1]), dtype=np.complex128)
    turns.real, turns.imag = np.cos(phase)[:, np.newaxis], np.sin(phase)[:, np.newaxis]
    powers = np.multiply.accumulate(turns, axis=1)[:, orders - 1]
    waves, values = np.concatenate([powers.real, powers.imag], axis=1) * counted, values * counted
    parts = np.linalg.solve(waves @ waves.swapaxes(-1, -2), waves @ values[..., np.newaxis])
    return np.asarray(np.hypot(*parts.reshape(len(values), 2, -1).swapaxes(0, 1)))


def _average_rows(values: npt.NDArray[Any]) -> FloatArray:
    found = np.empty(values.shape[1])
    native.row_means(values, found)
    return found


def compute_autocorrelation_at(rows: FloatArray, lag: float) -> float | None:
    """Compute the square-difference autocorrelation at a lag (E-33), None beyond the rows."""
    whole = int(np.floor(lag))
    if whole < 1 or whole + 1 >= rows.shape[0]:
        return None
    values = np.empty(2)
    native.square_difference(rows.reshape(rows.shape[0], -1), whole, values)
    return float(values[0] + (lag - whole) * (values[1] - values[0]))
