"""Checks of what lies between radar and target: a wall, and a floor."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import xarray as xr

from doppelgait.radar.parameters import Radar
from doppelgait.testing.conformance import theory
from doppelgait.testing.conformance.bench import Bench
from doppelgait.testing.conformance.tables import table

WALLS = (
    {"permittivity": 2.73, "conductivity_s_per_m": 0.055, "thickness_m": 0.0125},
    {"permittivity": 3.91, "conductivity_s_per_m": 0.033, "thickness_m": 0.115},
    {"permittivity": 5.24, "conductivity_s_per_m": 0.22, "thickness_m": 0.2},
)
"""Plasterboard, brick and concrete as at 7.29 GHz (ITU-R P.2040)."""
AZIMUTHS_RAD = (0.0, 0.5, -0.9)
RANGE_M = 5.0

FLOOR = {"permittivity": 5.24, "conductivity_s_per_m": 0.22}
RADAR_HEIGHT_M = 1.0
LOWEST_FIELD = 10.0 ** (-30.0 / 20.0)
"""Fields below this part of the largest are left out of a comparison in dB."""


def wall_loss(bench: Bench, radar: Radar) -> float:
    """Deviation of a wall's two-way loss from |T|^4 of the slab, dB: three walls, three angles."""
    return max(abs(10.0 * math.log10(gain / abs(t) ** 4)) for gain, _, t, _ in _walls(bench, radar))


def wall_delay(bench: Bench, radar: Radar) -> float:
    """Deviation of the lengthened range from (sqrt(eps' - sin^2) - cos) d, mm."""
    return max(1e3 * abs(later_m - wanted_m) for _, (later_m, _), _, wanted_m in _walls(bench, radar))


def wall_phase(bench: Bench, radar: Radar) -> float:
    """Deviation of the echo's turn by range and ``path_phase`` together from that of T^2, rad."""
    per_metre = 4.0 * np.pi / theory.wavelength_m(radar)
    turns = [(extra_rad - per_metre * later_m, t) for _, (later_m, extra_rad), t, _ in _walls(bench, radar)]
    return max(abs(float(np.angle(np.exp(1j * turn) / t**2))) for turn, t in turns)


def _walls(bench: Bench, radar: Radar) -> list[tuple[float, tuple[float, float], complex, float]]:
    """Of every wall and angle: power gain, (further range, extra phase), and what T and that range should be."""
    assert bench.wall is not None
    results = []
    for wall, azimuth_rad in product(WALLS, AZIMUTHS_RAD):
        before = table(np.full(2, RANGE_M), azimuth=azimuth_rad, elevation=0.0)
        after = bench.wall(before, carrier_hz=radar.carrier_hz, **wall)
        gain = float(after["path_gain"].values[0, 0])
        later_m = float(after["range"].values[0, 0]) - RANGE_M
        eps = theory.permittivity_of(
            permittivity=wall["permittivity"], conductivity_s_per_m=wall["conductivity_s_per_m"],
            carrier_hz=radar.carrier_hz,
        )  # fmt: skip
        cosine, thickness_m = math.cos(azimuth_rad), wall["thickness_m"]
        t = theory.slab_insertion(
            cosine, permittivity=eps, thickness_m=thickness_m, wavelength_m=theory.wavelength_m(radar)
        )
        wanted_m = (math.sqrt(eps.real - 1.0 + cosine**2) - cosine) * thickness_m
        results.append((gain, (later_m, float(_phase_rad(after)[0, 0])), t, wanted_m))
    return results


def _phase_rad(scatterers: xr.Dataset) -> np.ndarray:
    if "path_phase" in scatterers:
        return np.asarray(scatterers["path_phase"].values, dtype=float)
    return np.zeros(scatterers["range"].shape)


def two_ray_pattern(bench: Bench, radar: Radar) -> float:
    """Deviation of the field over a floor from (exp(-jkR) / R + Gamma exp(-jkg) / g)^2, dB, heights 0.05 to 1.8 m.

    All echoes of a scatterer are summed at one frequency, as a cw radar does.
    """
    assert bench.two_ray is not None
    height_m, ground_m = (side.ravel() for side in np.meshgrid(np.linspace(0.05, 1.8, 36), np.linspace(2.0, 8.0, 25)))
    direct_m = np.hypot(ground_m, height_m - RADAR_HEIGHT_M)
    image_m = np.hypot(ground_m, height_m + RADAR_HEIGHT_M)
    before = table(direct_m, azimuth=0.0, elevation=np.arcsin((height_m - RADAR_HEIGHT_M) / direct_m))
    after = bench.two_ray(before, radar_height_m=RADAR_HEIGHT_M, carrier_hz=radar.carrier_hz, **FLOOR)
    wave = 2.0 * np.pi / theory.wavelength_m(radar)
    level = np.sqrt(after["rcs"].values * after["path_gain"].values) / after["range"].values ** 2
    found = (level * np.exp(1j * (_phase_rad(after) - 2.0 * wave * after["range"].values))).sum(axis=1)
    eps = theory.permittivity_of(carrier_hz=radar.carrier_hz, **FLOOR)
    gamma = theory.floor_reflection((height_m + RADAR_HEIGHT_M) / image_m, permittivity=eps)
    wanted = (np.exp(-1j * wave * direct_m) / direct_m + gamma * np.exp(-1j * wave * image_m) / image_m) ** 2
    seen = np.abs(wanted) * direct_m**2 > LOWEST_FIELD * (np.abs(wanted) * direct_m**2).max()
    return float(np.abs(20.0 * np.log10(np.abs(found) / np.abs(wanted)))[seen].max())
