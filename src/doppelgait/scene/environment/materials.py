"""Permittivity of building materials and of the ground by Recommendation ITU-R P.2040."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Annotated, Any, Literal, NamedTuple, get_args

from pydantic import BeforeValidator, Field

from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.errors import ConfigError, DoppelgaitWarning
from doppelgait.core.units import SPEED_OF_LIGHT_MPS

MaterialName = Literal[
    "concrete", "brick", "plasterboard", "wood", "glass", "ceiling_board", "chipboard", "plywood", "marble",
    "floorboard", "metal", "very_dry_ground", "medium_dry_ground", "wet_ground",
]  # fmt: skip


class Constants(NamedTuple):
    """eps' = a f^b and sigma = c f^d (S/m), f in GHz, and the band in GHz that they were fitted in."""

    a: float
    b: float
    c: float
    d: float
    lowest_ghz: float
    highest_ghz: float


MATERIALS: Mapping[str, Constants] = {
    "concrete": Constants(5.24, 0.0, 0.0462, 0.7822, 1.0, 100.0),
    "brick": Constants(3.91, 0.0, 0.0238, 0.16, 1.0, 40.0),
    "plasterboard": Constants(2.73, 0.0, 0.0085, 0.9395, 1.0, 100.0),
    "wood": Constants(1.99, 0.0, 0.0047, 1.0718, 0.001, 100.0),
    "glass": Constants(6.31, 0.0, 0.0036, 1.3394, 0.1, 100.0),
    "ceiling_board": Constants(1.48, 0.0, 0.0011, 1.0750, 1.0, 100.0),
    "chipboard": Constants(2.58, 0.0, 0.0217, 0.78, 1.0, 100.0),
    "plywood": Constants(2.71, 0.0, 0.33, 0.0, 1.0, 40.0),
    "marble": Constants(7.074, 0.0, 0.0055, 0.9262, 1.0, 60.0),
    "floorboard": Constants(3.66, 0.0, 0.0044, 1.3515, 50.0, 100.0),
    "metal": Constants(1.0, 0.0, 1e7, 0.0, 1.0, 100.0),
    "very_dry_ground": Constants(3.0, 0.0, 0.00015, 2.52, 1.0, 10.0),
    "medium_dry_ground": Constants(15.0, -0.1, 0.035, 1.63, 1.0, 10.0),
    "wet_ground": Constants(30.0, -0.4, 0.15, 1.30, 1.0, 10.0),
}
"""Constants of Recommendation ITU-R P.2040, table 3 (editions 2 and 3)."""

CONDUCTION_OHM_GHZ_M = 17.98
"""1 / (2 pi eps_0) for a frequency in GHz, as the recommendation rounds it."""


class Dielectric(FrozenModel):
    """A material that is not in the table.

    Parameters
    ----------
    permittivity : float
        Real part of the relative permittivity, 1 to 1000.
    conductivity_s_per_m : float
        0 (no loss) to 1e8 S/m.
    """

    permittivity: float = Field(ge=1, le=1000)
    conductivity_s_per_m: float = Field(default=0.0, ge=0, le=1e8)


def _known(material: Any) -> Any:
    """One plain message for a faulty material, where a union would give one per alternative."""
    if isinstance(material, Dielectric) or material in get_args(MaterialName):
        return material
    if not isinstance(material, Mapping):
        raise ValueError(
            f"must be {', '.join(get_args(MaterialName))} or {{ permittivity = ..., conductivity_s_per_m = ... }}"
        )
    try:
        return validate(Dielectric, material)
    except ConfigError as error:
        raise ValueError(str(error)) from None


Material = Annotated[MaterialName | Dielectric, BeforeValidator(_known)]
"""Type of a model's field that takes a material by name or as a table."""


def relative_permittivity(material: Material, *, wavelength_m: float) -> complex:
    """Complex relative permittivity of a material at a radar's wavelength.

    Parameters
    ----------
    material : str or Dielectric
        Name in :data:`MATERIALS`, or its permittivity and conductivity.
    wavelength_m : float
        Wavelength in air.

    Returns
    -------
    complex
        eps = eps' - j 17.98 sigma / f, f in GHz; the sign is that of fields exp(j omega t) (ITU-R P.2040).

    Raises
    ------
    ConfigError
        If there is no such material, or the carrier lies outside the band of a ground, whose constants do not hold
        there.

    Warns
    -----
    DoppelgaitWarning
        If the carrier lies outside the band in which another material was measured.
    """
    frequency_ghz = SPEED_OF_LIGHT_MPS / wavelength_m / 1e9
    if isinstance(material, Dielectric):
        real, conductivity = material.permittivity, material.conductivity_s_per_m
    else:
        constants = _constants_at(material, frequency_ghz)
        real = constants.a * frequency_ghz**constants.b
        conductivity = constants.c * frequency_ghz**constants.d
    return complex(real, -CONDUCTION_OHM_GHZ_M * conductivity / frequency_ghz)


def _constants_at(material: str, frequency_ghz: float) -> Constants:
    if material not in MATERIALS:
        raise ConfigError(f"material {material!r} is not known; known are {', '.join(get_args(MaterialName))}")
    constants = MATERIALS[material]
    if constants.lowest_ghz <= frequency_ghz <= constants.highest_ghz:
        return constants
    outside = (
        f"{material}: its constants hold from {constants.lowest_ghz:g} to {constants.highest_ghz:g} GHz, "
        f"the carrier is {frequency_ghz:.4g} GHz"
    )
    if material.endswith("ground"):
        raise ConfigError(
            f"{outside}; take another material, or give it as {{ permittivity = ..., conductivity_s_per_m = ... }}"
        )
    warnings.warn(f"{outside}; they are extrapolated", DoppelgaitWarning, stacklevel=3)
    return constants
