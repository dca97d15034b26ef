"""Effects of a room and the antenna on scatterers.

Ranges are exact at every pulse, for the direct path and for every mirror image. Gains, phases and delays of walls
depend on the directions of the scatterers, which change little in a hundredth of a second. They are therefore computed
80 times per second and interpolated to the pulses by cubic splines of amplitude, phase and delay. The error is below
1e-4 of the strongest echo for a sprinter and a galloping dog half a metre from a wall, and 2e-5 for walkers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.config import FrozenModel
from doppelgait.core.labels import ScattererTable, take_columns
from doppelgait.motion.retime import Spline, fit_spline
from doppelgait.scene import PlacedScene
from doppelgait.scene.environment import ENVIRONMENT
from doppelgait.scene.environment.reflections import Mirror
from doppelgait.scene.observe import tabulate
from doppelgait.scene.scatterers import Scatterers

FloatArray = npt.NDArray[np.float64]
Through = Callable[[ScattererTable], ScattererTable]

GAIN_STEP_S = 0.0125
"""Longest time between two computations of the gains."""
MIN_LOOKS = 5
MAX_TURN_RAD = 0.018
"""Largest change of a scatterer's direction between two computations."""
MAX_CHANGE = 0.25
"""Largest change of an amplitude between two computations, relative to its maximum; a larger change is a jump."""


def apply_room(
    table: ScattererTable,
    placed: PlacedScene,
    bodies: Sequence[Scatterers],
    effects: Sequence[FrozenModel],
    through: Through,
) -> ScattererTable | None:
    """Apply the effects of a room to a scatterer table."""
    smooth = all(ENVIRONMENT.of(spec).facts.get("is_smooth", False) for spec in effects)
    if not smooth or placed.scene.receiver_position_m is not None or not bodies:
        return None
    times_s = table.slow_time_s
    looks = _look(placed, bodies, times_s)
    if looks is None:
        return None
    looks_s, before = looks
    after = through(before)
    amplitude = np.sqrt(after["path_gain"])
    if (np.abs(np.diff(amplitude, axis=0)).max(axis=0) > MAX_CHANGE * amplitude.max(axis=0)).any():
        return None
    mirrors: tuple[Mirror, ...] = after.attrs.get("mirrors", ())
    n_rows, n_own = after.shape[1], table.shape[1]
    splines = [fit_spline(body.motion) for body in bodies] if mirrors else []
    range_m, velocity_mps = _compute_images(table, splines, placed, times_s, mirrors, n_rows)
    geometric_m, _ = _compute_images(before, splines, placed, looks_s, mirrors, n_rows)
    delay_m = after["range"] - geometric_m
    if np.abs(delay_m).max(initial=0.0) > 1e-9:  # delay of a wall, above rounding errors
        range_m += _interpolate_table(delay_m, looks_s, times_s)
        velocity_mps -= _interpolate_table(np.gradient(delay_m, looks_s, axis=0, edge_order=2), looks_s, times_s)
    amplitude = _interpolate_table(amplitude, looks_s, times_s)
    sources = np.arange(n_rows)
    for mirror in mirrors:
        sources[mirror.first : mirror.first + 2 * len(mirror.sources)] = 2 * mirror.sources
    values = {
        "range": range_m,
        "radial_velocity": velocity_mps,
        "rcs": take_columns(table["rcs"], sources),
        "path_gain": take_columns(table["path_gain"], sources) * np.square(amplitude),
    }
    if "path_phase" in after:
        phase_rad = after["path_phase"]
        if np.abs(np.diff(phase_rad, axis=0)).max(initial=0.0) > np.pi:
            phase_rad = np.unwrap(phase_rad, axis=0)
        values["path_phase"] = _interpolate_table(phase_rad, looks_s, times_s)
    for name in ("azimuth", "elevation", "aspect"):
        if name in table:
            values[name] = np.full((times_s.size, n_rows), np.nan)
            values[name][:, :n_own] = table[name]
    return ScattererTable(times_s, values, after.columns, table.attrs)


def _look(
    placed: PlacedScene, bodies: Sequence[Scatterers], times_s: FloatArray
) -> tuple[FloatArray, ScattererTable] | None:
    """Observe scatterers of unit cross section at the computation times."""
    alike = [replace(b, rcs_m2=np.ones(len(b.motion.markers)), path_gain=np.ones(1)) for b in bodies]
    n_looks = max(math.ceil(float(np.ptp(times_s)) / GAIN_STEP_S) + 1, MIN_LOOKS)
    while 2 * n_looks <= times_s.size:
        looks_s = np.linspace(times_s.min(), times_s.max(), n_looks)
        seen = tabulate(placed, alike, looks_s, ("azimuth", "elevation"))
        elevation, azimuth = seen["elevation"], seen["azimuth"]
        level = np.cos(elevation)
        turned = np.hypot(np.diff(elevation, axis=0), level[1:] * np.sin(np.diff(azimuth, axis=0) / 2.0) * 2.0)
        closer = float(turned.max(initial=0.0)) / MAX_TURN_RAD
        if closer <= 1.0:
            return looks_s, seen
        n_looks = math.ceil(1.2 * closer * n_looks)
    return None


def _compute_images(
    table: ScattererTable,
    splines: Sequence[Spline],
    placed: PlacedScene,
    times_s: FloatArray,
    mirrors: Sequence[Mirror],
    n_rows: int,
) -> tuple[FloatArray, FloatArray]:
    """Compute ranges and velocities of scatterers and images."""
    direct_m, direct_mps = (table[name] for name in ("range", "radial_velocity"))
    n_own = direct_m.shape[1]
    range_m, velocity_mps = np.empty((2, times_s.size, n_rows))
    range_m[:, :n_own], velocity_mps[:, :n_own] = direct_m, direct_mps
    for mirror in mirrors:
        sources, (nx, ny, nz) = np.array(mirror.sources, dtype=np.int64), mirror.normal
        place = placed.scene.radar_position_m
        from_plane = mirror.radar_distance_m - (nx * place[0] + ny * place[1] + nz * place[2])
        column = 0
        for spline in splines:  # a distance from a plane is a spline as well
            heights, moments = (
                nx * part[:, 0::3] + ny * part[:, 1::3] + nz * part[:, 2::3] for part in (spline.values, spline.moments)
            )
            own = np.flatnonzero((sources >= column) & (sources < column + heights.shape[1]))
            for run in np.split(own, np.flatnonzero(np.diff(sources[own]) != 1) + 1) if own.size else ():
                chosen = slice(sources[run[0]] - column, sources[run[-1]] - column + 1)
                one = mirror.first + int(run[0])
                native.image_ranges(
                    heights[:, chosen] + from_plane,
                    moments[:, chosen],
                    spline.step_s,
                    times_s,
                    direct_m,
                    direct_mps,
                    int(sources[run[0]]),
                    mirror.radar_distance_m,
                    one,
                    one + sources.size,
                    range_m,
                    velocity_mps,
                )
            column += heights.shape[1]
    return range_m, velocity_mps


def _interpolate_table(values: FloatArray, looks_s: FloatArray, times_s: FloatArray) -> FloatArray:
    heights = np.ascontiguousarray(values)
    moments, step_s = np.empty_like(heights), float(looks_s[1] - looks_s[0])
    native.spline_moments(heights, step_s, moments)
    out = np.empty((times_s.size, heights.shape[1]))
    native.values_between(heights, moments, step_s, times_s - looks_s[0], out)
    return out
