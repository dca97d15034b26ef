"""Model, calibration of its probabilities, and its valid conditions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from pydantic import Field

from doppelgait.classify.data import SHARED, Rows, read_numbers, wavelengths_m
from doppelgait.classify.learned import NOVEL_BELOW, FloatArray, Inputs, IntArray, Learned, Novelty, select_features
from doppelgait.classify.scorer import log_softmax
from doppelgait.core.config import FrozenModel
from doppelgait.core.notebook import show_html, show_text
from doppelgait.core.units import SPEED_OF_LIGHT_MPS

LEAST_ROWS = 5  # minimum number of rows of every class for a calibration
STEEPEST = 20.0

TOLERANCE = {
    "carrier_hz": (0.9, 1.1),
    "prf_hz": (0.9, 1.1),
    "observation_s": (0.8, 4.0),
    "speed_mps": (0.0, 1.1),
    "snr": (0.5, math.inf),
}
"""Factors of the lowest and of the highest value of the training data. A radar of another band or
pulse rate is a different radar. A longer observation or a stronger echo is better."""
OF_TRACKS = ("speed_mps", "snr")  # conditions of models of tracks alone
FASTER = 1.6  # factor of the pulse rate, up to which pictures in metres and seconds were seen to stay alike

Conditions = Mapping[str, tuple[float, float]]

ABSTAIN_BELOW = 0.8
BLOCKING = (
    "no_signal",
    "no_direction",
    "not_tracked",
    "keeps_still:*",
    "no_steady_piece:*",
    "aspect_beyond_75_deg:*",
    SHARED,
    "reflection_of:*",
    "folded_echo_of:*",
    "not_a_moving_body:*",
    "unknown_target:*",
    "clutter_removal_took_*",
    "doppler_band_full:*",
    "*:columns_do_not_overlap",
)
"""Flags that prevent a decision, * for anything: no target, no gait or direction, an echo, no body, too few columns."""
OF_RADAR = ("no_direction", "*:columns_do_not_overlap")
"""Flags that a radar causes, in bursts or with one output; no reason where nearly all training rows had them."""
USUAL = 0.9  # share of the training rows from which a flag of the radar is usual
ECHOES = ("not_tracked", "no_signal", SHARED, "reflection_of:*", "folded_echo_of:*")
"""Flags that prevent a decision of a model of tracks, which has learned from windows with all the others."""
OUTSIDE = 0.25  # a feature may lie outside the training range by this share of its span
WIDEST = 1e29  # limit of features that may have any value
RARELY = 0.01  # share of unknown training values below which a feature must be known


@dataclass(frozen=True, eq=False)
class Calibration:
    """Calibration p = softmax(slope log q + shift)."""

    slope: float
    shift: FloatArray
    n_rows: int

    def __call__(self, log_probability: FloatArray) -> FloatArray:
        """Return calibrated probabilities, shape (n, n_classes)."""
        return np.asarray(np.exp(log_softmax(self.slope * log_probability + self.shift)))


def row_weights(labels: IntArray, n_classes: int) -> FloatArray:
    """Return row weights that balance the present classes; mean 1."""
    counts = np.bincount(labels, minlength=n_classes)
    return np.asarray(labels.size / (np.count_nonzero(counts) * counts[labels]))


def calibrate(log_probability: FloatArray, labels: IntArray) -> Calibration:
    """Fit a calibration to held-out rows, every class with the same weight."""
    # two classes: Platt's sigmoid; more: temperature and corrected biases (Alexandari et al. 2020)
    n_classes = log_probability.shape[1]
    counts = np.bincount(labels, minlength=n_classes)
    if counts.min() < LEAST_ROWS:
        return Calibration(1.0, np.zeros(n_classes), 0)
    targets = np.eye(n_classes)[labels] * counts[labels, None] + 1.0
    weights = row_weights(labels, n_classes) / (counts[labels] + n_classes) / labels.size
    return fit_calibration(log_probability, weights[:, None] * targets)


def fit_calibration(
    log_probability: FloatArray, targets: FloatArray, log_slope_sd: float = np.inf, shift_sd: float = np.inf
) -> Calibration:
    """Fit slope and shift of maximum posterior probability to weights of classes, shape (n, n_classes)."""
    from scipy.optimize import minimize

    n_classes = log_probability.shape[1]
    sd = np.array([log_slope_sd, *[shift_sd] * (n_classes - 1)])  # of normal priors

    def loss(parameters: FloatArray) -> tuple[float, FloatArray]:
        slope, shift = np.exp(parameters[0]), np.append(0.0, parameters[1:])
        found = log_softmax(slope * log_probability + shift)
        pull = np.exp(found) * targets.sum(axis=1, keepdims=True) - targets
        gradient = np.append(slope * (pull * log_probability).sum(), pull.sum(axis=0)[1:])
        return float(((parameters / sd) ** 2).sum() / 2.0 - (targets * found).sum()), gradient + parameters / sd**2

    bounds = [(math.log(1e-3), math.log(STEEPEST)), *[(None, None)] * (n_classes - 1)]
    log_slope, *shift = minimize(loss, np.zeros(n_classes), jac=True, bounds=bounds, method="L-BFGS-B").x
    return Calibration(float(np.exp(log_slope)), np.append(0.0, shift), len(targets))


def find_detection_threshold(probability: FloatArray, positive: npt.NDArray[np.bool_], share: float) -> float:
    """Return the highest threshold for a share of positive rows."""
    found = np.sort(probability[positive])[::-1]
    if not found.size:
        return float("nan")
    return float(found[int(np.ceil(share * found.size - 1e-9)) - 1])


def read_carrier_and_prf_hz(signature: xr.DataArray) -> tuple[float, float]:
    """Return carrier and pulse rate of a signature, NaN for unknown."""
    doppler_hz, velocity_mps = (
        np.asarray(signature.coords[name].values if name in signature.coords else (), dtype=np.float64)
        for name in ("doppler", "velocity")
    )
    span_hz = float(np.ptp(doppler_hz)) if doppler_hz.size > 1 else math.nan
    prf_hz = span_hz * doppler_hz.size / max(doppler_hz.size - 1, 1)
    # without the attribute the wavelength follows from the axes by v = f wavelength / 2
    wavelength_m = float(signature.attrs.get("wavelength_m", math.nan))
    if math.isnan(wavelength_m) and velocity_mps.size and span_hz > 0:
        wavelength_m = float(2.0 * np.ptp(velocity_mps) / span_hz)
    return SPEED_OF_LIGHT_MPS / wavelength_m, prf_hz


def collect_conditions(columns: Mapping[Any, Any] | pd.DataFrame, carrier_hz: FloatArray) -> dict[str, FloatArray]:
    """Return the observation conditions of rows (n,); NaN for unknown."""
    names = ("prf_hz", "observation_s", "quality_observation_s", "quality_track_velocity_mps", "quality_snr_mu_db")
    unknown = np.full(carrier_hz.shape, np.nan)
    prf_hz, asked_s, observed_s, speed_mps, snr_db = (read_numbers(columns.get(name, unknown)) for name in names)
    return {
        "carrier_hz": carrier_hz,
        "prf_hz": prf_hz,
        "observation_s": np.where(np.isnan(observed_s), asked_s, observed_s),
        "speed_mps": np.abs(speed_mps),
        "snr": 10.0 ** (snr_db / 10.0),
    }


def conditions_of_rows(rows: Rows) -> dict[str, FloatArray]:
    """Return every row's conditions, NaN for unknown."""
    return collect_conditions(rows.index, SPEED_OF_LIGHT_MPS / wavelengths_m(rows))


def find_training_conditions(
    found: Mapping[str, FloatArray], train: IntArray, *, of_tracks: bool = False
) -> dict[str, tuple[float, float]]:
    """Return the training span of every known condition."""
    spans = {}
    for name, values in found.items():
        known = values[train][np.isfinite(values[train])]
        if known.size and (of_tracks or name not in OF_TRACKS):
            spans[name] = (float(known.min()), float(known.max()) * (FASTER if of_tracks and name == "prf_hz" else 1.0))
    return spans


def mark_outside(values: FloatArray, name: str, trained: Conditions) -> npt.NDArray[np.bool_]:
    """Mark values outside the training range and its tolerance."""
    if name not in trained:
        return np.zeros(np.shape(values), dtype=bool)
    low, high = accepted_range(name, *trained[name])
    return np.asarray((values < low) | (values > high))


def accepted_range(name: str, low: float, high: float) -> tuple[float, float]:
    """Return the limits of a condition: the training range with its tolerance."""
    less, more = TOLERANCE[name]
    return low * less, high * more


def describe_outside_conditions(found: Mapping[str, float], trained: Conditions) -> list[str]:
    """Describe conditions outside the training range, or unknown."""
    said = []
    for name in filter(trained.__contains__, TOLERANCE):
        words = format_span(*trained[name])
        if math.isnan(found[name]):
            said.append(f"{name} is unknown; the training range is {words}")
        elif mark_outside(np.array([found[name]]), name, trained)[0]:
            accepted = format_span(*accepted_range(name, *trained[name]))
            said.append(f"{name} {found[name]:.4g} is outside the accepted range, {accepted} (training range {words})")
    return said


def format_span(low: float, high: float) -> str:
    """Format a span, or one number if both ends agree."""
    return f"{low:.4g}" if f"{low:.4g}" == f"{high:.4g}" else f"{low:.4g} to {high:.4g}"


class Facts(FrozenModel):
    """Description of a model and of its valid inputs."""

    name: str
    features: str  # ``six``, ``extended``, ``speed``, ``signature`` or ``extended+signature``
    names: tuple[str, ...]
    classes: tuple[str, ...] = Field(min_length=2)
    dataset_id: str
    dataset_name: str
    version: str
    n_train: int = Field(ge=0)
    n_held: int = Field(ge=0)
    n_own: int = Field(default=0, ge=0)  # own rows that the probabilities were adapted to
    seed: int
    analysis: dict[str, Any]  # parameters of the analysis that made the features
    conditions: dict[str, tuple[float, float]]
    # No decision below this probability, or if a smaller share of the held-out rows is as far from the training data.
    abstain_below: float = Field(default=ABSTAIN_BELOW, ge=0, le=1)
    novel_below: float = Field(default=NOVEL_BELOW, ge=0, le=1)
    window_s: float | None = Field(default=None, gt=0)  # length of the windows of the training data, if they were cut
    alarm: str | None = None
    alarm_threshold: float | None = Field(default=None, ge=0, le=1)
    alarm_people: int | None = Field(default=None, ge=0)
    alarm_missed: float | None = Field(default=None, ge=0, le=1)
    blocking: tuple[str, ...] = BLOCKING
    usual: tuple[str, ...] = ()  # flags of the radar in nearly all training rows


@dataclass(frozen=True, eq=False)
class Model:
    """A trained model.

    Parameters
    ----------
    lowest, highest : ndarray, shape (d,)
        Of every feature in the training rows; NaN where it was always unknown. Empty for
        signatures.
    unknown : ndarray, shape (d,)
        Share of the training rows in which a feature is unknown.
    novelty : Novelty or None
        Distance from the training rows; None for models of signatures alone.
    track : Model or None
        Model that decides over the life of a track; None where the windows of a track are joined.
    """

    facts: Facts
    learned: Learned
    calibration: Calibration
    lowest: FloatArray
    highest: FloatArray
    unknown: FloatArray
    novelty: Novelty | None = None
    track: Model | None = None

    def __repr__(self) -> str:
        return show_text("Model", self._shown())

    def _repr_html_(self) -> str:
        return show_html("Model", self._shown(), "model", self)

    def _shown(self) -> dict[str, str]:
        facts = self.facts
        return {
            "name": facts.name,
            "features": f"{facts.features} ({len(facts.names)})" if facts.names else facts.features,
            "classes": ", ".join(facts.classes),
            "trained on": f"{facts.dataset_name}, {facts.n_train} rows",
            "no decision below": f"{facts.abstain_below:g}",
        }

    def probability(self, values: Inputs) -> FloatArray:
        """Return calibrated probabilities for equally frequent classes.

        Parameters
        ----------
        values : ndarray, shape (n, d), (n,) or (n, d + 1)
            Features in the order of ``facts.names``, NaN for unknown; or levels of signatures, None
            for none; or both.

        Returns
        -------
        ndarray, shape (n, n_classes)
        """
        return self.calibration(self.learned.log_probability(values))

    def rank(self, values: Inputs) -> FloatArray:
        """Return the share of held-out rows at least as far."""
        return np.ones(len(values)) if self.novelty is None else self.novelty.rank(values)

    @property
    def of_tracks(self) -> Model:
        """Return the model that decides about the windows of tracks."""
        return self.track or self

    @property
    def blocking(self) -> tuple[str, ...]:
        """Patterns of the flags that prevent a decision."""
        patterns = self.facts.blocking if self.learned.kind == "track" else (*self.facts.blocking, *BLOCKING)
        return tuple(pattern for pattern in patterns if pattern not in self.facts.usual)

    def mark_outside(self, values: Inputs) -> npt.NDArray[np.bool_]:
        """Mark features outside the training range, shape (n, d)."""
        if not self.facts.names:
            return np.zeros((len(values), 0), dtype=bool)
        values = select_features(values)
        low, high = self._accepted
        far = (values < low) | (values > high)
        return np.asarray(far | (np.isnan(values) & (self.unknown < RARELY)))

    def describe_outside(self, row: Inputs) -> list[str]:
        """Describe features outside the training range, of inputs of one row."""
        found, (low, high) = [], self._accepted
        for n in np.flatnonzero(self.mark_outside(row)[0]):
            name, value = self.facts.names[n], select_features(row)[0, n]
            accepted = f"{low[n]:.3g} to {high[n]:.3g} (training range {self.lowest[n]:.3g} to {self.highest[n]:.3g})"
            if np.isnan(value):
                found.append(f"{name} is unknown, unlike in the training data")
            else:
                found.append(f"{name} {value:.3g} is outside the accepted range, {accepted}")
        return found

    @property
    def _accepted(self) -> tuple[FloatArray, FloatArray]:
        """Limits of every feature: the training range with its tolerance."""
        spare = OUTSIDE * (self.highest - self.lowest)
        return self.lowest - spare, self.highest + spare


def find_blocking_flag(flags: Iterable[str], patterns: Sequence[str]) -> str | None:
    """Return the first flag that matches a pattern, that of a shared gate last, or None."""
    ordered = sorted(flags, key=SHARED.__eq__)
    return next((flag for flag in ordered if any(fnmatchcase(flag, pattern) for pattern in patterns)), None)


def mark_flagged(index: pd.DataFrame, patterns: Sequence[str], but: str | None = None) -> npt.NDArray[np.bool_]:
    """Mark rows with a flag that matches a pattern, for another reason than a flag ``but``, shape (n,)."""
    texts = index["quality_flags"].fillna("").tolist()
    return np.array([find_blocking_flag(text.split(";"), patterns) not in (None, but) for text in texts], dtype=bool)


def blocked_rows(rows: Rows, values: Inputs, model: Model, but: str | None = None) -> npt.NDArray[np.bool_]:
    """Mark rows without a decision whatever the probability, shape (n,)."""
    blocked = mark_flagged(rows.index, model.blocking, but) | model.mark_outside(values).any(axis=1)
    blocked |= model.rank(values) < model.facts.novel_below
    for condition, found in conditions_of_rows(rows).items():
        blocked |= mark_outside(found, condition, model.facts.conditions)
    return np.asarray(blocked)
