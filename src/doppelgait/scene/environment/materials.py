"""Permittivity of materials, interfaces and slabs.

The time dependence is exp(j omega t), so a lossy medium has eps = eps' - j eps''. In the mode
``te`` the electric field is perpendicular to the plane of incidence, in ``tm`` it is parallel to
it. Constants and equations are from Recommendation ITU-R P.2040.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from pydantic import BeforeValidator, Field

from doppelgait._core import native
from doppelgait.core.config import FrozenModel, InnerError, read_toml, validate
from doppelgait.core.errors import ConfigError, warn_caller
from doppelgait.core.units import SPEED_OF_LIGHT_MPS, FloatArray

ComplexArray = npt.NDArray[np.complex128]


class Constants(NamedTuple):
    """Constants of a material, with the frequency band of the fit."""

    a: float
    b: float
    c: float
    d: float
    lowest_ghz: float
    highest_ghz: float


MATERIALS: Mapping[str, Constants] = {
    name: Constants(*values) for name, values in read_toml(Path(__file__).with_name("materials.toml"))[0].items()
}
"""Constants of Recommendation ITU-R P.2040, table 3 (editions 2 and 3)."""

if TYPE_CHECKING:
    MaterialName = str
else:
    MaterialName = Literal[*MATERIALS]

CONDUCTION_OHM_GHZ_M = 17.98
"""Constant 1 / (2 pi eps_0) for a frequency in GHz, rounded as in the recommendation."""


class Dielectric(FrozenModel):
    """Material with stated permittivity and conductivity.

    permittivity: Real part of the relative permittivity.
    conductivity_s_per_m: Conductivity, 0 (no loss) to 1e8 S/m.
    """

    permittivity: float = Field(ge=1, le=1000)
    conductivity_s_per_m: float = Field(default=0.0, ge=0, le=1e8)


def _check_material(material: Any) -> Any:
    """Reject an invalid material with a single message."""
    # the union type would give one message per alternative
    if isinstance(material, Dielectric) or material in [*MATERIALS]:  # a list, since a table has no hash
        return material
    if not isinstance(material, Mapping):
        raise ValueError(f"must be {', '.join(MATERIALS)} or {{ permittivity = ..., conductivity_s_per_m = ... }}")
    try:
        return validate(Dielectric, material)
    except ConfigError as error:
        raise InnerError(error) from None


Material = Annotated[MaterialName | Dielectric, BeforeValidator(_check_material)]
"""Field type of a model: a material, by name or as a table."""


def relative_permittivity(material: Material, *, wavelength_m: float) -> complex:
    """Compute complex relative permittivity at a radar's wavelength.

    Parameters
    ----------
    material : str or Dielectric
        Name in :data:`MATERIALS`, or permittivity and conductivity.
    wavelength_m : float
        Wavelength in air.

    Returns
    -------
    complex
        eps = eps' - j 17.98 sigma / f, f in GHz; the sign follows from the time dependence exp(j
        omega t) (ITU-R P.2040).

    Raises
    ------
    ConfigError
        If the material is unknown, or the carrier lies outside the band of a ground material, where
        its constants are not valid.

    Warns
    -----
    DoppelgaitWarning
        If the carrier lies outside the band in which another material was measured.
    """
    frequency_ghz = SPEED_OF_LIGHT_MPS / wavelength_m / 1e9
    if isinstance(material, Dielectric):
        real, conductivity = material.permittivity, material.conductivity_s_per_m
    else:
        if material not in MATERIALS:
            raise ConfigError(f"material {material!r} is not known; known are {', '.join(MATERIALS)}")
        constants = MATERIALS[material]
        if not constants.lowest_ghz <= frequency_ghz <= constants.highest_ghz:
            outside = (
                f"{material}: its constants are valid from {constants.lowest_ghz:g} to {constants.highest_ghz:g} GHz, "
                f"but the carrier is {frequency_ghz:.4g} GHz"
            )
            if material.endswith("ground"):
                raise ConfigError(
                    f"{outside}; use another material, or state it as "
                    "{ permittivity = ..., conductivity_s_per_m = ... }"
                )
            warn_caller(f"{outside}; the constants are extrapolated")
        real = constants.a * frequency_ghz**constants.b
        conductivity = constants.c * frequency_ghz**constants.d
    return complex(real, -CONDUCTION_OHM_GHZ_M * conductivity / frequency_ghz)


Mode = Literal["te", "tm"]
Polarisation = Literal["vertical", "horizontal"]

GRAZING_COSINE = 1e-6
"""Minimum cosine of the angle of incidence; at 0 the slab's equations become 0 / 0."""


def interface_reflection(cos_incidence: npt.ArrayLike, *, permittivity: complex, mode: Mode) -> ComplexArray:
    """Compute Fresnel's reflection coefficient of a half space in air (ITU-R P.2040)."""
    # te: (c - s) / (c + s); tm, of the vertical field over a floor: (eps c - s) / (eps c + s); c
    # the cosine, s = sqrt(eps - 1 + c^2).
    cosine = np.maximum(np.asarray(cos_incidence, dtype=float), GRAZING_COSINE)
    inside = _refract(cosine, permittivity)
    outside = cosine if mode == "te" else permittivity * cosine
    return np.asarray((outside - inside) / (outside + inside), dtype=np.complex128)


def slab_reflection(
    cos_incidence: npt.ArrayLike, *, permittivity: complex, thickness_m: float, wavelength_m: float, mode: Mode
) -> ComplexArray:
    """Compute the reflection coefficient of a slab in air (ITU-R P.2040)."""
    # r (1 - exp(-2jq)) / (1 - r^2 exp(-2jq)), with r of interface_reflection and q = 2 pi d
    # sqrt(eps - sin^2) / lambda; all internal reflections are included
    cosine = np.maximum(np.asarray(cos_incidence, dtype=float), GRAZING_COSINE)
    r = interface_reflection(cosine, permittivity=permittivity, mode=mode)
    back = np.exp(-2j * _compute_slab_phase(cosine, permittivity, thickness_m, wavelength_m))
    return np.asarray(r * (1.0 - back) / (1.0 - r * r * back))


def slab_transmission(
    cos_incidence: npt.ArrayLike, *, permittivity: complex, thickness_m: float, wavelength_m: float, mode: Mode
) -> ComplexArray:
    """Compute the transmission of a slab in air with internal reflections (ITU-R P.2040)."""
    # (1 - r^2) exp(-jq) / (1 - r^2 exp(-2jq)): field at the back face to that opposite in front
    cosine = np.maximum(np.asarray(cos_incidence, dtype=float), GRAZING_COSINE)
    r2 = interface_reflection(cosine, permittivity=permittivity, mode=mode) ** 2
    once = np.exp(-1j * _compute_slab_phase(cosine, permittivity, thickness_m, wavelength_m))
    return np.asarray((1.0 - r2) * once / (1.0 - r2 * once * once))


def insertion_coefficient(
    cos_incidence: npt.ArrayLike, *, permittivity: complex, thickness_m: float, wavelength_m: float, mode: Mode
) -> ComplexArray:
    """Compute the insertion coefficient of a slab for a plane wave."""
    # the slab multiplies the field behind it by t exp(j 2 pi d cos / lambda)
    cosine = np.maximum(np.asarray(cos_incidence, dtype=float), GRAZING_COSINE)
    t = slab_transmission(
        cosine, permittivity=permittivity, thickness_m=thickness_m, wavelength_m=wavelength_m, mode=mode
    )
    return np.asarray(t * np.exp(2j * np.pi * thickness_m / wavelength_m * cosine))


def slab_delay_m(cos_incidence: npt.ArrayLike, *, permittivity: complex, thickness_m: float) -> FloatArray:
    """Compute how much a slab lengthens a path."""
    # the one-way excess length is (sqrt(eps' - sin^2) - cos) d; at normal incidence it is
    # (sqrt(eps') - 1) d
    cosine = np.asarray(cos_incidence, dtype=float)
    return np.asarray((np.sqrt(permittivity.real - 1.0 + cosine**2) - cosine) * thickness_m)


def compute_slab_spreading(
    cos_incidence: npt.ArrayLike, range_m: npt.ArrayLike, *, permittivity: complex, thickness_m: float
) -> FloatArray:
    r"""Compute the two-way power gain inside a slab."""
    cosine = np.maximum(np.asarray(cos_incidence, dtype=float), GRAZING_COSINE)
    distance_m = np.maximum(np.asarray(range_m, dtype=float), 1e-12)
    inside = np.sqrt(np.maximum(permittivity.real - 1.0, 0.0) + cosine**2)
    share = np.minimum(thickness_m / (cosine * distance_m), 1.0)
    bent = cosine / inside
    squared = bent * bent  # ten times as fast as a general power in NumPy
    tangential = 1.0 - share * (1.0 - max(permittivity.real, 1.0) * bent * squared)
    product = (1.0 - share * (1.0 - bent)) * tangential
    return np.asarray(1.0 / np.maximum(product * product, 1e-24))  # no power passes at grazing incidence


def interpolate_coefficient(
    coefficient: Callable[[FloatArray], ComplexArray],
    cos_incidence: FloatArray,
    *,
    thickness_m: float = 0.0,
    wavelength_m: float = 1.0,
) -> ComplexArray:
    """Interpolate a coefficient for many rays from fewer values. The interpolation is linear."""
    step = min(1e-3, 1e-2 * wavelength_m / (2.0 * np.pi * thickness_m)) if thickness_m else 1e-3
    if not cos_incidence.size:
        return coefficient(cos_incidence)
    lowest, highest = float(cos_incidence.min()), float(cos_incidence.max())
    count = int((highest - lowest) / step) + 2
    if count >= cos_incidence.size or lowest == highest:
        return coefficient(cos_incidence)
    grid, out = np.linspace(lowest, highest, count), np.empty(cos_incidence.shape, dtype=np.complex128)
    native.interpolate_values(cos_incidence.ravel(), grid, coefficient(grid), out.reshape(-1))
    return out


def interpolate_modes(
    coefficient: Callable[..., ComplexArray], cos_incidence: FloatArray, *, permittivity: complex, **slab: float
) -> tuple[ComplexArray, ComplexArray]:
    """Interpolate a coefficient of a slab in the modes TE and TM."""

    def interpolate(mode: Mode) -> ComplexArray:
        one_mode = partial(coefficient, permittivity=permittivity, mode=mode, **slab)
        return interpolate_coefficient(one_mode, cos_incidence, **slab)

    return interpolate("te"), interpolate("tm")


def compute_te_share(along: FloatArray, aside: FloatArray, up: FloatArray) -> FloatArray:
    """Compute the TE share at an upright wall."""
    # it is the share of the power of a vertically polarised wave that is in TE mode
    level, across = along**2 + aside**2, aside**2 + up**2
    product = level * across
    share = np.ones(np.shape(product))
    np.divide(aside**2 * (level + up**2), product, out=share, where=product > 1e-12 * (level + up**2) ** 2)
    return share


def _refract(cosine: FloatArray, permittivity: complex) -> ComplexArray:
    """Compute sqrt(eps - sin^2)."""
    # it is the ratio of the normal component of the wave vector in the medium to that in air at
    # normal incidence
    square = permittivity.real - 1.0 + cosine**2
    out = np.empty(square.shape, dtype=np.complex128)
    # from real and imaginary part: ten times as fast as a complex root
    np.sqrt(0.5 * (np.sqrt(square**2 + permittivity.imag**2) + square), out=out.real)
    np.divide(permittivity.imag, 2.0 * out.real, out=out.imag)
    return out


def _compute_slab_phase(
    cosine: FloatArray, permittivity: complex, thickness_m: float, wavelength_m: float
) -> ComplexArray:
    return np.asarray(2.0 * np.pi * thickness_m / wavelength_m * _refract(cosine, permittivity))
