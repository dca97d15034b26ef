"""All features beyond the six, of one target (E-39 keeps its own set)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from doppelgait.features import bands, envelope, ripple  # noqa: F401  they register themselves
from doppelgait.features.observed import Observed
from doppelgait.features.registry import FEATURES
from doppelgait.features.uncertainty import uncertainties_of, uncertainty_flags

if TYPE_CHECKING:
    from doppelgait.features.gait import Evidence, Extraction

UNDETERMINED = "undetermined"


@dataclass(frozen=True)
class ExtendedFeatures:
    """Values of all registered features and why some are missing.

    Parameters
    ----------
    values : dict
        By name, in alphabetical order; None where undetermined.
    reasons : dict
        For every None, what it lacks.
    """

    values: dict[str, float | None]
    reasons: dict[str, str]

    def flags(self) -> tuple[str, ...]:
        """One flag per reason: the features that lack it, then the reason, as in the flags of the six."""
        names: dict[str, list[str]] = {}
        for name, reason in self.reasons.items():
            names.setdefault(reason, []).append(name)
        return tuple(f"{','.join(found)}:{reason}" for reason, found in names.items())


def measure_extended(observed: Observed) -> ExtendedFeatures:
    """Every registered feature of one target.

    Parameters
    ----------
    observed : Observed

    Returns
    -------
    ExtendedFeatures
    """
    values: dict[str, float | None] = {}
    reasons: dict[str, str] = {}
    for name in FEATURES:
        feature = FEATURES[name]
        reason = observed.lacks(feature.needs)
        value = None if reason else feature.function(observed)
        values[name] = float(value) if value is not None and math.isfinite(value) else None
        if values[name] is None:
            reasons[name] = reason or UNDETERMINED
    return ExtendedFeatures(values, reasons)


def extended_features(evidence: Evidence, extraction: Extraction) -> dict[str, float | None]:
    """Values of :func:`measure_extended`, of one target's evidence and extraction."""
    return measure_extended(Observed(evidence, extraction)).values


@dataclass(frozen=True)
class Assessment:
    """What stands beside the six features of a target.

    Parameters
    ----------
    extended : dict
        Further features by name, None where undetermined.
    standard_deviations : dict
        Of the six and of the gait frequency, by name, None where unknown.
    reasons : dict
        Why an extended feature is None, by name.
    flags : tuple of str
        Which of the six are known only roughly.
    """

    extended: dict[str, float | None]
    standard_deviations: dict[str, float | None]
    reasons: dict[str, str]
    flags: tuple[str, ...]


def assess(evidence: Evidence, extraction: Extraction) -> Assessment:
    """Extended features and uncertainties in one go, which share what they need."""
    observed = Observed(evidence, extraction)
    found, spread = measure_extended(observed), uncertainties_of(observed)
    return Assessment(found.values, spread, found.reasons, uncertainty_flags(extraction, spread))


def feature_table() -> list[tuple[str, str, str]]:
    """Name, unit and source of every registered feature, in alphabetical order."""
    return [(name, FEATURES[name].unit, FEATURES[name].source) for name in FEATURES]
