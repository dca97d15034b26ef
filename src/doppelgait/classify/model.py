"""A trained model with all that its use needs: classes, calibration, thresholds and the conditions it was made for."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import Field

from doppelgait.classify.calibrate import Calibration
from doppelgait.classify.learned import FloatArray, Inputs, Learned
from doppelgait.core.config import FrozenModel

ABSTAIN_BELOW = 0.8
BLOCKING = (
    "no_signal", "not_tracked", "keeps_still:*", "no_steady_piece:*", "aspect_beyond_75_deg:*", "gates_overlap",
    "clutter_removal_took_*", "doppler_band_full:*", "*:columns_do_not_overlap",
)  # fmt: skip
"""Flags with which no decision is given, * for anything: nothing seen, no gait in it, another body's echo in it,
or the columns are too few to show one."""
OUTSIDE = 0.25
"""A feature may lie outside what was learnt by this share of its span there."""
RARELY = 0.01
"""A feature that was unknown more rarely must be known."""


class Facts(FrozenModel):
    """What a model is and what it expects.

    Parameters
    ----------
    name : str
        ``six-logistic`` and so on.
    features : str
        What it looks at: ``six``, ``extended``, ``speed`` or ``signature``.
    names : tuple of str
        Features in their order; none for signatures.
    classes : tuple of str
    dataset_id, dataset_name, version : str
        What it was learnt from, and the doppelgait that did.
    n_train, n_held : int
        Rows learnt from, and held back for calibration.
    seed : int
    analysis : dict
        Parameters of the analysis that made the features.
    conditions : dict
        Lowest and highest value of conditions it was learnt under: carrier, pulse rate, observation time.
    abstain_below : float
        No decision where the most likely class is less likely than this.
    alarm : str or None
        The class that must be detected, where there is one.
    alarm_threshold : float or None
        Probability of that class from which on 95 % of the held rows of it are detected.
    alarm_people : int or None
        Movers of that class among the held rows, which the threshold rests on; None if not known.
    blocking : tuple of str
        Flags with which no decision is given.
    """

    name: str
    features: str
    names: tuple[str, ...]
    classes: tuple[str, ...] = Field(min_length=2)
    dataset_id: str
    dataset_name: str
    version: str
    n_train: int = Field(ge=0)
    n_held: int = Field(ge=0)
    seed: int
    analysis: dict[str, Any]
    conditions: dict[str, tuple[float, float]]
    abstain_below: float = Field(default=ABSTAIN_BELOW, ge=0, le=1)
    alarm: str | None = None
    alarm_threshold: float | None = Field(default=None, ge=0, le=1)
    alarm_people: int | None = Field(default=None, ge=0)
    blocking: tuple[str, ...] = BLOCKING


@dataclass(frozen=True, eq=False)
class Model:
    """A trained model.

    Parameters
    ----------
    facts : Facts
    learned : Learned
    calibration : Calibration
    lowest, highest : ndarray, shape (d,)
        Of every feature in the rows learnt from; NaN where it was always unknown. Empty for signatures.
    unknown : ndarray, shape (d,)
        Share of the rows learnt from in which a feature is unknown.
    """

    facts: Facts
    learned: Learned
    calibration: Calibration
    lowest: FloatArray
    highest: FloatArray
    unknown: FloatArray

    def probability(self, values: Inputs) -> FloatArray:
        """Calibrated probabilities of the classes, were they equally frequent.

        Parameters
        ----------
        values : ndarray, shape (n, d) or (n,)
            Features in the order of ``facts.names``, NaN for unknown; or levels of signatures, None for none.

        Returns
        -------
        ndarray, shape (n, n_classes)
        """
        return self.calibration(self.learned.log_probability(values))

    def beyond(self, values: Inputs) -> npt.NDArray[np.bool_]:
        """Features outside what was learnt: beyond the span there by a quarter of it, or unknown where none ever was.

        Returns
        -------
        ndarray of bool, shape (n, d)
            No columns for signatures.
        """
        if not self.facts.names:
            return np.zeros((len(values), 0), dtype=bool)
        spare = OUTSIDE * (self.highest - self.lowest)
        far = (values < self.lowest - spare) | (values > self.highest + spare)
        return np.asarray(far | (np.isnan(values) & (self.unknown < RARELY)))

    def outside(self, values: FloatArray) -> list[str]:
        """What of one row, shape (d,), lies outside what was learnt, in words."""
        found = []
        for n in np.flatnonzero(self.beyond(values[None])[0]):
            name = self.facts.names[n]
            learnt = f"{self.lowest[n]:.3g} to {self.highest[n]:.3g}"
            if np.isnan(values[n]):
                found.append(f"{name} is unknown, which was not learnt")
            else:
                found.append(f"{name} {values[n]:.3g} is outside what was learnt, {learnt}")
        return found


def rests_on(facts: Facts) -> str:
    """What an alarm threshold rests on, in words; empty where there is no threshold or it is not known."""
    if facts.alarm_threshold is None or facts.alarm_people is None:
        return ""
    return f"the alarm threshold rests on {facts.alarm_people} movers of class {facts.alarm} that were held back"


def blocking_flag(flags: Iterable[str], patterns: Sequence[str]) -> str | None:
    """The first flag that fits one of the patterns, None without one."""
    return next((flag for flag in flags if any(fnmatchcase(flag, pattern) for pattern in patterns)), None)
