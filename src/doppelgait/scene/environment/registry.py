"""Registration of environment effects by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from doppelgait.core.labels import AnyTable
from doppelgait.core.plugins import Group


@dataclass(frozen=True)
class Setting:
    """Wavelength, position and azimuth of the radar.

    Parameters
    ----------
    wavelength_m : float
        Wavelength of the carrier, above 0.
    radar_position_m : tuple of float
        Position (x, y, z) of the antenna; z is its height above the floor.
    radar_azimuth_rad : float
        Azimuth of the boresight, from +x towards +y.
    """

    wavelength_m: float
    radar_position_m: tuple[float, float, float]
    radar_azimuth_rad: float = 0.0


class Apply(Protocol):
    """Environment effect: returns a new scatterer table, leaving its input unchanged.

    The original rows come first, then the added rows, of ``target`` -1, or -2 of a background body. A plug-in has the
    facts ``needs_angles`` (bool, or a function of the parameters) if the table must have azimuth and elevation, and
    ``makes_images=True`` if it adds echoes by reflected paths. Such effects compute positions from ranges and are
    therefore listed before those that lengthen or attenuate paths. With ``is_smooth=True``, gains, phases and delays
    change no faster than directions, and every added row is an image in a
    :class:`~doppelgait.scene.environment.reflections.Mirror`: the effect is then evaluated only 80 times a second.

    A function whose first parameter is annotated as ``ScattererTable`` gets plain arrays. Others,
    such as those written for version 0.2, get and return a Dataset.
    """

    def __call__(self, scatterers: Any, parameters: Any, setting: Setting, /) -> AnyTable:
        """Return the scatterer table (slow_time, scatterer) after the effect."""


ENVIRONMENT: Group[Apply] = Group(
    "environment",
    built_in=("doppelgait.scene.environment.losses", "doppelgait.scene.environment.reflections"),
)
"""Environment effects by the ``kind`` of a scene file's ``[[environment]]``."""
