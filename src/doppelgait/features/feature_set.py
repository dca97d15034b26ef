"""Registry of features, the set F, and the extraction."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from doppelgait.core.errors import ConfigError
from doppelgait.core.plugins import Group, Plugin
from doppelgait.core.units import FloatArray

NEEDS = ("gait_frequency", "direction", "envelope", "line")
"""Requirements that a feature can have of an :class:`doppelgait.features.observed.Observation`."""


def check_feature(feature: Plugin[Any]) -> None:
    """Raise :class:`ConfigError` for a feature with invalid facts."""
    where, needs = f"feature {feature.name!r} of {feature.module or 'here'}", feature.facts.get("needs", ())
    if not isinstance(needs, tuple | list) or not set(needs) <= set(NEEDS):
        raise ConfigError(f"{where}: needs {needs!r} is not allowed; it is a tuple of {', '.join(NEEDS)}")
    for name in ("unit", "source"):
        if not isinstance(text := feature.facts.get(name), str) or not text:
            raise ConfigError(f"{where}: {name} {text!r} is not allowed; it must be a text")


FEATURES: Group[Callable[[Any], float | None]] = Group(
    "feature", built_in=("doppelgait.features.gait", "doppelgait.features.extended"), check=check_feature
)
"""All features by name: functions of an :class:`doppelgait.features.observed.Observation`.

A function is called only if everything that it needs is known. A result of None, or one that is not
finite, means undetermined. Facts of a plug-in:

unit : str
    ``"1"`` for a plain number.
source : str
    Source of the definition: literature or an equation of the documentation.
needs : tuple of str
    Requirements, in this order: ``"gait_frequency"``, ``"direction"`` (the target moves towards or away from the
    radar), ``"envelope"`` (half of the columns or more are above the noise), ``"line"`` (the main line is known).
set_f : int, optional
    Position in the report's feature set F (E-39), from 0; all others are extended features.
"""

FEATURE_UNITS = {
    "torso_velocity_mps": "m/s",
    "doppler_bandwidth_hz": "Hz",
    "step_length_m": "m",
    "harmonic_ratio_2": "1",
    "harmonic_ratio_3": "1",
    "limb_torso_ratio": "1",
}
"""The feature set F in its order (E-39)."""


@dataclass(frozen=True)
class GaitFeatures:
    """Six gait features; None where a feature cannot be determined.

    Parameters
    ----------
    torso_velocity_mps : float or None
        v_m, positive when approaching.
    doppler_bandwidth_hz : float or None
        B_mu.
    step_length_m : float or None
        L_m = |v_m| / f_mu, along the line of sight; the stride length for asymmetric gaits.
    harmonic_ratio_2, harmonic_ratio_3 : float or None
        beta_1, beta_2.
    limb_torso_ratio : float or None
        rho.
    """

    torso_velocity_mps: float | None = None
    doppler_bandwidth_hz: float | None = None
    step_length_m: float | None = None
    harmonic_ratio_2: float | None = None
    harmonic_ratio_3: float | None = None
    limb_torso_ratio: float | None = None

    def vector(self) -> FloatArray:
        """Return the features in order, NaN for None."""
        return np.array([np.nan if v is None else v for v in self.as_dict().values()], dtype=np.float64)

    def as_dict(self) -> dict[str, float | None]:
        """Return the features by name."""
        return {name: getattr(self, name) for name in FEATURE_UNITS}


@dataclass(frozen=True)
class Extraction:
    """Features, quality and flags of one target's signature.

    Parameters
    ----------
    gait_frequency_hz, torso_doppler_hz, n_periods : float or None
        f_mu, the mean Doppler of the main line, and the number of observed periods.
    quality : mapping
        Diagnostics by name.
    flags : tuple of str
        Reasons for None values and for caution.
    """

    features: GaitFeatures
    gait_frequency_hz: float | None
    torso_doppler_hz: float | None
    n_periods: float | None
    quality: Mapping[str, Any] = field(default_factory=dict)
    flags: tuple[str, ...] = ()
