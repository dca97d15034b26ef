"""A fitted value with its uncertainty, and how uncertainties of powers become those of levels and roots."""

from __future__ import annotations

import math
from dataclasses import dataclass

DB_PER_NEPER = 10.0 / math.log(10.0)
"""Decibels of a power ratio per unit of its natural logarithm."""


@dataclass(frozen=True)
class Estimate:
    """A fitted value.

    Parameters
    ----------
    value : float
        In the unit that the name of the field or row holding it says.
    sd : float
        Standard uncertainty (one standard deviation), same unit; inf where the recording does not tell.
    """

    value: float
    sd: float

    def scaled(self, factor: float) -> Estimate:
        """The same in another unit."""
        return Estimate(self.value * factor, self.sd * abs(factor))


def level_db(power: Estimate) -> Estimate:
    """Level 10 log10 of a power; its uncertainty to first order."""
    if not power.value > 0:
        return Estimate(-math.inf, math.inf)
    return Estimate(10.0 * math.log10(power.value), DB_PER_NEPER * power.sd / power.value)


def root(power: float, sd: float) -> Estimate:
    """Square root of a variance that may have come out negative.

    The uncertainty is sqrt(r^2 + sd) - r with r the root: sd / (2 r) where the variance is well measured, sqrt(sd)
    where it is not distinguished from 0.
    """
    value = math.sqrt(max(power, 0.0))
    return Estimate(value, math.sqrt(value * value + sd) - value)
