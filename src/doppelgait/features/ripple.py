"""How the torso's velocity swings about its mean, and how alike neighbouring periods are (E-33, E-37)."""

from __future__ import annotations

import numpy as np

from doppelgait.features.observed import Observed, likeness_at
from doppelgait.features.registry import FEATURES, Feature

TORSO_LINE = "ours: torso line of E-33 about the main line"
MIN_PERIODS_OF_PAIRS = 3.0
"""Pairs of periods can be told apart only where this many single periods are seen."""
MIN_LIKENESS = 0.1


def ripple_mps(observed: Observed) -> float:
    """Root mean square of the torso's velocity about its slow part."""
    return float(np.sqrt(np.mean(observed.torso_ripple_mps**2)))


def ripple_at_gait_mps(observed: Observed) -> float | None:
    """Root mean square of the part of the torso's swing that repeats with f_mu."""
    return _component_mps(observed, 2)


def ripple_at_half_mps(observed: Observed) -> float | None:
    """Root mean square of the part that repeats with f_mu / 2: sway and limp, which alternate from step to step."""
    if observed.frequency_hz * observed.evidence.observation_s < MIN_PERIODS_OF_PAIRS:
        return None
    return _component_mps(observed, 1)


def _component_mps(observed: Observed, number: int) -> float:
    """One of f/2, f, 3f/2, 2f, all fitted together, so that the leakage of one does not read as another."""
    orders, amplitude = observed.ripple_parts
    return float(np.sqrt(0.5 * np.sum(amplitude[:, orders.index(number)] ** 2)))


def alternate_likeness(observed: Observed) -> float | None:
    """Likeness of neighbouring periods over that of every second one, at most about 1.

    Near 1 where a period is a step whose mirror image looks the same to the radar; less where left and right, or the
    two halves of a stride, differ. Noise lowers both alike; rows without signal are left out (K+ of E-38).
    """
    if observed.frequency_hz * observed.evidence.observation_s < MIN_PERIODS_OF_PAIRS:
        return None
    rows = observed.occupied_columns - observed.mean_row[observed.occupied]
    lag = observed.rate_hz / observed.frequency_hz
    once, twice = likeness_at(rows, lag), likeness_at(rows, 2.0 * lag)
    if once is None or twice is None or twice < MIN_LIKENESS:
        return None
    return once / twice


FEATURES.add("torso_ripple_mps", Feature("m/s", TORSO_LINE, ripple_mps, ("line",)))
FEATURES.add("torso_ripple_gait_mps", Feature("m/s", TORSO_LINE, ripple_at_gait_mps, ("gait_frequency", "line")))
FEATURES.add("torso_ripple_half_mps", Feature("m/s", TORSO_LINE, ripple_at_half_mps, ("gait_frequency", "line")))
FEATURES.add(
    "alternate_likeness", Feature("1", "ours: E-33 at one and at two periods", alternate_likeness, ("gait_frequency",))
)
