"""What an environment effect must know of the radar: its wavelength, its place and its boresight."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Setting:
    """Radar as the surroundings see it.

    Parameters
    ----------
    wavelength_m : float
        Wavelength of the carrier, above 0.
    radar_position_m : tuple of float
        Place (x, y, z) of the antenna; z is its height above the floor.
    radar_azimuth_rad : float
        Azimuth of the boresight, from +x towards +y.
    """

    wavelength_m: float
    radar_position_m: tuple[float, float, float]
    radar_azimuth_rad: float = 0.0
