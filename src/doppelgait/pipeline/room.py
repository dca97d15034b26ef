"""Effects of a room and the antenna on scatterers.

Ranges are exact at every pulse, also of mirror images. Gains, phases and delays of walls depend on directions, which
change little in a hundredth of a second: they are computed 80 times per second and interpolated by cubic splines. The
error is below 1e-4 of the strongest echo for a sprinter or a galloping dog half a metre from a wall.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from doppelgait._core import native
from doppelgait.core.config import FrozenModel
from doppelgait.core.labels import ScattererTable, take_columns
from doppelgait.core.samples import borrow_memory
from doppelgait.core.units import FloatArray, cosine, sine
from doppelgait.motion.retime import Spline
from doppelgait.scene import PlacedScene
from doppelgait.scene.environment import ENVIRONMENT
from doppelgait.scene.environment.effects import Mirror
from doppelgait.scene.observe import fit_splines, look, make_table
from doppelgait.scene.scatterers import Scatterers

GAIN_STEP_S = 0.0125  # longest time between two computations of the gains
MIN_LOOKS = 5
MAX_TURN_RAD = 0.018  # largest change of a scatterer's direction between two computations
MAX_CHANGE = 0.25
"""Largest change of an amplitude between two computations, relative to its maximum; a larger change is a jump."""


def apply_room(
    placed: PlacedScene,
    bodies: Sequence[Scatterers],
    times_s: FloatArray,
    wanted: Sequence[str],
    effects: Sequence[FrozenModel],
    through: Callable[[ScattererTable], ScattererTable],
) -> ScattererTable | None:
    """Observe a scene through the effects of a room; None where they are needed at every pulse."""
    smooth = all(ENVIRONMENT.of(spec).facts.get("is_smooth", False) for spec in effects)
    if not smooth or placed.scene.receiver_position_m is not None or not bodies:
        return None
    splines = fit_splines(bodies)
    # scatterers of unit cross section at the computation times
    alike = [replace(b, rcs_m2=np.ones(len(b.motion.markers)), path_gain=np.ones(1), phase_rad=None) for b in bodies]
    n_looks = max(math.ceil(float(np.ptp(times_s)) / GAIN_STEP_S) + 1, MIN_LOOKS)
    while 2 * n_looks <= times_s.size:
        looks_s = np.linspace(times_s.min(), times_s.max(), n_looks)
        seen = look(placed.scene, alike, splines, looks_s, ("azimuth", "elevation"))
        elevation, azimuth = seen["elevation"], seen["azimuth"]
        level = cosine(elevation)
        aside = level[1:] * sine(np.diff(azimuth, axis=0) / 2.0) * 2.0
        turned2 = np.square(np.diff(elevation, axis=0)) + np.square(aside)
        closer = math.sqrt(float(turned2.max(initial=0.0))) / MAX_TURN_RAD
        if closer <= 1.0:
            break
        n_looks = math.ceil(1.2 * closer * n_looks)
    else:
        return None
    before = make_table(placed, alike, looks_s, seen)
    after = through(before)
    amplitude = np.sqrt(after["path_gain"])
    if (np.abs(np.diff(amplitude, axis=0)).max(axis=0) > MAX_CHANGE * amplitude.max(axis=0)).any():
        return None
    mirrors: tuple[Mirror, ...] = after.attrs.get("mirrors", ())
    n_rows, n_own = after.shape[1], before.shape[1]
    values = look(placed.scene, bodies, splines, times_s, wanted, n_rows - n_own)
    range_m, velocity_mps = values["range"], values["radial_velocity"]
    _fill_images(range_m, velocity_mps, splines, placed, times_s, mirrors)
    geometric_m, rates_mps = np.empty((2, *after.shape))
    geometric_m[:, :n_own], rates_mps[:, :n_own] = before["range"], before["radial_velocity"]
    _fill_images(geometric_m, rates_mps, splines, placed, looks_s, mirrors)
    delay_m = after["range"] - geometric_m
    if np.abs(delay_m).max(initial=0.0) > 1e-9:  # delay of a wall, above rounding errors
        range_m += _interpolate_table(delay_m, looks_s, times_s)
        velocity_mps -= _interpolate_table(np.gradient(delay_m, looks_s, axis=0, edge_order=2), looks_s, times_s)
    gain = _interpolate_table(amplitude, looks_s, times_s)
    np.square(gain, out=gain)
    sources = np.arange(n_rows)
    for mirror in mirrors:
        sources[mirror.first : mirror.first + 2 * len(mirror.sources)] = 2 * mirror.sources
    values |= {name: take_columns(values[name], sources) for name in {"rcs", "path_phase"} & values.keys()}
    values["path_gain"] = gain * take_columns(values["path_gain"], sources)
    if "path_phase" in after:
        phase_rad = after["path_phase"]
        if np.abs(np.diff(phase_rad, axis=0)).max(initial=0.0) > np.pi:
            phase_rad = np.unwrap(phase_rad, axis=0)
        values["path_phase"] = values.get("path_phase", 0.0) + _interpolate_table(phase_rad, looks_s, times_s)
    for name in wanted:
        values[name][:, n_own:] = np.nan
    return ScattererTable(times_s, values, after.columns)


def _fill_images(
    range_m: FloatArray,
    velocity_mps: FloatArray,
    splines: Sequence[Spline],
    placed: PlacedScene,
    times_s: FloatArray,
    mirrors: Sequence[Mirror],
) -> None:
    """Compute ranges and velocities of images from those of the scatterers, the first columns."""
    for mirror in mirrors:
        sources, distance_m = np.array(mirror.sources, dtype=np.int64), mirror.radar_distance_m
        size, axes = sources.size, [(axis, n) for axis, n in enumerate(mirror.normal) if n]
        from_plane = distance_m - sum(n * placed.scene.radar_position_m[axis] for axis, n in axes)
        column, out = 0, (range_m, velocity_mps)
        for spline in splines:  # a distance from a plane is a spline as well
            heights, moments = (
                np.add.reduce([n * part[:, axis::3] for axis, n in axes]) for part in (spline.values, spline.moments)
            )
            own = np.flatnonzero((sources >= column) & (sources < column + heights.shape[1]))
            for run in np.split(own, np.flatnonzero(np.diff(sources[own]) != 1) + 1) if own.size else ():
                source, first = int(sources[run[0]]), mirror.first + int(run[0])
                chosen = slice(source - column, sources[run[-1]] - column + 1)
                above = heights[:, chosen] + from_plane, moments[:, chosen], spline.step_s
                native.image_ranges(*above, times_s, source, distance_m, first, first + size, *out)
            column += heights.shape[1]


def _interpolate_table(values: FloatArray, looks_s: FloatArray, times_s: FloatArray) -> FloatArray:
    heights = np.ascontiguousarray(values)
    moments, step_s = np.empty_like(heights), float(looks_s[1] - looks_s[0])
    native.spline_moments(heights, step_s, moments)
    out = borrow_memory((times_s.size, heights.shape[1]), np.float64)
    native.values_between(heights, moments, step_s, times_s - looks_s[0], out)
    return out
