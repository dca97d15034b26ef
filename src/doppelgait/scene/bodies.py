"""Bodies as a radar sees them: joints, ellipsoids, limbs, occlusion (E-08c, E-08e to E-08h).

Joints are means of points: gait models, skeletons and marker sets share a person and an animal.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.config import read_toml
from doppelgait.core.errors import ConfigError
from doppelgait.core.units import FloatArray, arctangent, cosine, db_to_power, exponential, sine
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import resample
from doppelgait.motion.skeleton import reduce_word, strip_subject

TABLES = read_toml(Path(__file__).with_name("bodies.toml"))[0]
"""Segments of a person and an animal, and shares of body parts (``bodies.toml``)."""


@dataclass(frozen=True)
class Segment:
    """Ellipsoid between two joints, with its semi-axes; or limb, with its radii at both ends."""

    name: str
    part: str
    start: str
    end: str
    across: float
    upright: float
    along: float | None = None
    sideways: tuple[str, str] | None = None
    at: float = 0.5
    limb: tuple[float, float] | None = None
    joint: bool = False


def name_sides(text: str, also: str = "") -> list[str]:
    """Return a text for both sides if it, or another one, has them."""
    sides = ("left", "right") if "{side}" in text + also else ("",)
    return [text.replace("{side}", side).replace("{s}", side[:1]) for side in sides]


def _read_segments(table: Mapping[str, Any]) -> tuple[Segment, ...]:

    def read(one: Mapping[str, Any], side: str) -> Segment:
        name, part, start, end = (s.replace("{side}", side) for s in (one["name"], one["part"], *one["joints"]))
        round_m = one.get("radius", np.mean(one.get("limb", [0.0])))
        size = [metres / table["unit_m"] for metres in one.get("size", 2 * [round_m])]
        found = dict(zip(("across", "upright", "along"), size, strict=False))
        found |= {key: one[key] for key in ("at", "joint") if key in one}
        found |= {"sideways": tuple(one["sideways"])} if "sideways" in one else {}
        found |= {"limb": tuple(metres / table["unit_m"] for metres in one["limb"])} if "limb" in one else {}
        return Segment(name, part, start, end, **found)

    middle = [read(one, "") for one in table["segments"] if "{side}" not in one["name"]]
    sided = [one for one in table["segments"] if "{side}" in one["name"]]
    return (*middle, *(read(one, side) for side in ("left", "right") for one in sided))


PERSON, ANIMAL = (_read_segments(TABLES[who]) for who in ("person", "animal"))
"""Segments of a person (Chen 2011, except the torso) and of an animal (assumed from dogs)."""


def _read_rig(rig: Mapping[str, str]) -> dict[str, list[list[str]]]:
    return {
        joint: [one.split() for one in words.split("|")]
        for key, text in rig.items()
        for joint, words in zip(name_sides(key), name_sides(text, also=key), strict=True)
    }


RIGS = [(body, _read_rig(rig)) for body, who in ((PERSON, "person"), (ANIMAL, "animal")) for rig in TABLES[who]["rigs"]]
"""Bodies and their point sets: a person's joints, bones and markers, and an animal's joints."""


def find_joints(motion: Motion) -> tuple[tuple[Segment, ...], dict[str, list[int]], list[str]]:
    """Find a body, every joint's points, whose mean it is, and the joints without points."""
    number = {reduce_word(strip_subject(marker)): n for n, marker in enumerate(motion.markers)}
    tried = []
    for segments, rig in RIGS:
        if (segments is ANIMAL) != ("trunk" in motion.parts):
            continue
        joints: dict[str, list[int]] = {}
        for joint, ways in rig.items():
            known = ([number[word] for word in words if word in number] for words in ways)
            usable = (points for points, words in zip(known, ways, strict=True) if 2 * len(points) >= len(words))
            joints[joint] = next(usable, [])
        joined = {s.end for s in segments if joints[s.start] == joints[s.end]}  # a segment needs two points
        tried.append((segments, joints, [joint for joint in joints if joint in joined or not joints[joint]]))
    return min(tried, key=lambda each: len(each[2]))


@dataclass(frozen=True)
class Ellipsoids:
    """S ellipsoids at I times: centre_m, along, across (I, S, 3); semi_axes_m (S, 3)."""

    centre_m: FloatArray
    along: FloatArray
    across: FloatArray
    semi_axes_m: FloatArray


@dataclass(frozen=True)
class Skeleton:
    """Joints, segments and semi-axes (S, 3) of one body, m: across, upright, along."""

    joints: Motion
    segments: tuple[Segment, ...]
    semi_axes_m: FloatArray

    def numbers(self, end: str) -> list[int]:
        """Return joint numbers of the segments' ``"start"`` or ``"end"``."""
        number = {name: n for n, name in enumerate(self.joints.markers)}
        return [number[getattr(segment, end)] for segment in self.segments]


def ellipsoid_rcs_m2(semi_axes_m: npt.ArrayLike, direction: npt.ArrayLike) -> FloatArray:
    r"""Compute the optical backscatter of a perfectly conducting ellipsoid (E-08c).

    The sources are Mahafza 2003 and Chen 2011.

    .. math:: \sigma = \pi (a b c)^2 / (a^2 u_1^2 + b^2 u_2^2 + c^2 u_3^2)^2

    with :math:`u = (\sin\theta\cos\phi, \sin\theta\sin\phi, \cos\theta)`; :math:`\pi r^2` for a
    sphere, frequency independent.

    Parameters
    ----------
    semi_axes_m : array_like, shape (..., 3)
        a, b, c, positive.
    direction : array_like, shape (..., 3)
        Unit vector to the radar, in the axes of the ellipsoid.

    Returns
    -------
    ndarray, shape (...)
        m^2, positive.

    Examples
    --------
    >>> from doppelgait.scene import ellipsoid_rcs_m2
    >>> round(float(ellipsoid_rcs_m2([0.1, 0.1, 0.1], [1.0, 0.0, 0.0])), 4)
    0.0314
    """
    squares = np.asarray(semi_axes_m, dtype=float) ** 2
    form = _multiply_dot(squares, np.asarray(direction, dtype=float) ** 2)
    return np.asarray(np.pi * squares.prod(axis=-1) / (form * form))


def mean_rcs_m2(body: Ellipsoids) -> FloatArray:
    """Average every ellipsoid's RCS (S,), m^2, over times and all horizontal directions."""
    across, upright, along = body.semi_axes_m.T
    wide, long = across**2 - upright**2, along**2 - upright**2
    x, y = body.along[..., 0], body.along[..., 1]
    side_x, side_y = body.across[..., 0], body.across[..., 1]
    xx = upright**2 + wide * side_x**2 + long * x**2
    yy = upright**2 + wide * side_y**2 + long * y**2
    xy = wide * side_x * side_y + long * x * y
    square = xx * yy - xy**2
    each_m2 = np.pi * (across * upright * along) ** 2 * (xx + yy) / (2.0 * square * np.sqrt(square))
    return np.asarray(each_m2.mean(axis=0))


def build_skeleton(motion: Motion) -> Skeleton:
    """Build joints and segments of a motion."""
    source, height_m = motion.facts.source, motion.facts.height_m
    segments, points, lacking = find_joints(motion)
    if lacking:
        shown = ", ".join(lacking[:6]) + (", ..." if len(lacking) > 6 else "")
        raise ConfigError(
            f"{source}: rcs kind 'surfaces' and occlusion need a body with known joints; no own point of the motion is "
            f"{shown}; name the points (docs/howto/own-motion.md), or use rcs kind 'auto' without occlusion"
        )
    if not height_m > 0:
        raise ConfigError(
            f"{source}: the height is unknown, so the body has no size; use rcs kind 'body_parts' or 'equal'"
        )
    # a joint is the mean of its points: a spline through means is the mean of the splines
    joint_m = np.empty((motion.n_frames, len(points), 3))
    for n, group in enumerate(points.values()):
        own_m = motion.position_m[:, group]
        joint_m[:, n] = own_m[:, 0] if len(group) == 1 else own_m.mean(axis=1)
    joints = motion.with_points(joint_m, list(points), [""] * len(points))
    skeleton = Skeleton(joints, segments, np.empty(0))
    start, end = (joints.position_m[:, skeleton.numbers(which)] for which in ("start", "end"))
    half_m = np.median(np.sqrt(((end - start) ** 2).sum(axis=-1)), axis=0) / 2.0
    if not half_m.min() > 0:
        raise ConfigError(
            f"{source}: segment {segments[int(half_m.argmin())].name} has no length; use rcs kind 'body_parts'"
        )
    sizes = [
        (s.across * height_m, s.upright * height_m, float(half) if s.along is None else s.along * height_m)
        for s, half in zip(segments, half_m, strict=True)
    ]
    return Skeleton(joints, segments, np.array(sizes))


def find_nearest_points(skeleton: Skeleton, body: Ellipsoids, radar_position_m: npt.ArrayLike) -> Motion:
    r"""Compute the motion of the reflecting points. Shapes: radar_position_m (3,) (E-08f)."""
    names, parts = ([getattr(s, key) for s in skeleton.segments] for key in ("name", "part"))
    return skeleton.joints.with_points(see_ellipsoids(body, radar_position_m)[0], names, parts)


def see_ellipsoids(body: Ellipsoids, radar_position_m: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Find every ellipsoid's nearest point, (I, S, 3), and its RCS there, (I, S) (E-08f, E-08g)."""
    # the RCS is not scaled to a total
    (n_times, n_bodies), radar = body.centre_m.shape[:2], np.asarray(radar_position_m, dtype=np.float64)
    points, rcs_m2 = np.empty((n_times, 3, n_bodies)), np.empty((n_times, n_bodies))
    native.see_ellipsoids(body.centre_m, body.along, body.across, body.semi_axes_m, radar, points, rcs_m2)
    return points.transpose(0, 2, 1), rcs_m2


def compute_ellipsoids(skeleton: Skeleton, time_s: FloatArray | None = None) -> Ellipsoids:
    """Compute the ellipsoids at times after the first frame (spline of E-02), or at the frames."""
    joint_m = skeleton.joints.position_m if time_s is None else resample(skeleton.joints, time_s)[0]
    number = {name: n for n, name in enumerate(skeleton.joints.markers)}
    start, end = (np.take(joint_m, skeleton.numbers(which), axis=1) for which in ("start", "end"))
    span = end - start
    along = _scale_to_unit(span)
    across = np.zeros_like(along)
    sides = {n: segment.sideways for n, segment in enumerate(skeleton.segments) if segment.sideways is not None}
    left, right = (joint_m[:, [number[pair[side]] for pair in sides.values()]] for side in (0, 1))
    line, own = left - right, along[:, list(sides)]
    across[:, list(sides)] = _scale_to_unit(line - _multiply_dot(line, own)[..., None] * own)
    place = np.array([segment.at for segment in skeleton.segments])[:, None]
    return Ellipsoids(start + place * span, along, across, skeleton.semi_axes_m)


def _scale_to_unit(vector: FloatArray) -> FloatArray:
    length = np.sqrt(_multiply_dot(vector, vector))
    return np.asarray(vector / np.maximum(length, 1e-12)[..., None])


def _multiply_dot(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("...k,...k->...", first, second))  # three times as fast as a product and a sum


EDGE_M = 0.05
"""Half width of the shadow boundary, m: the Fresnel scale sqrt(lambda d / 2) at d = 0.12 m behind the edge at 7.29 GHz.

The boundary is smooth: the echo of a limb that passes behind the trunk fades over 0.1 m of its path and does not jump.
"""

OWN_REACH = 1.1
"""Relative size up to which an ellipsoid contains points; it never hides them, as they represent its surface."""


def compute_visible_power(
    point_m: FloatArray,
    body: Ellipsoids,
    own: npt.NDArray[np.bool_],
    radar_position_m: npt.ArrayLike,
    *,
    edge_m: float = EDGE_M,
) -> FloatArray:
    r"""Compute the two-way gain past the body's ellipsoids (E-08e)."""
    # the gain is 1 for a visible point and 0 for a hidden point
    points = np.ascontiguousarray(point_m, dtype=np.float64)
    radar = np.asarray(radar_position_m, dtype=np.float64)
    shape = body.centre_m, body.along, body.across, body.semi_axes_m
    amplitude = np.empty(points.shape[:2])
    native.sight_amplitudes(points, *shape, own, radar, edge_m, amplitude)
    return amplitude * amplitude


def find_own_points(point_m: FloatArray, body: Ellipsoids) -> npt.NDArray[np.bool_]:
    """Determine which ellipsoids contain which points."""
    # they are inside it (up to a tenth beyond its surface) at least half of the time
    step = -(-point_m.shape[0] // 100)
    offset = point_m[::step, :, None] - body.centre_m[::step, None]
    across, upright, along = 1.0 / body.semi_axes_m.T**2
    wide = (offset * body.across[::step, None]).sum(axis=-1) ** 2 * (across - upright)
    long = (offset * body.along[::step, None]).sum(axis=-1) ** 2 * (along - upright)
    form = (offset**2).sum(axis=-1) * upright + wide + long
    return np.asarray(np.median(form, axis=0) <= OWN_REACH**2)


ROUND_SHARE = 0.15  # of a limb at either end, over which its field fades in
SPARE_SAMPLES = 64  # beyond one a turn of the phase: errors of the field are below -80 dB, at least a limb away
N_WAVES = 128
"""Waves of a rough surface, the longest 1.25 limbs long: a body is the same for every radar."""
WAVES_PER_LIMB = 0.8
ROUGHNESS_M, CORRELATION_M, BULGE = (0.0, 0.003), (0.005, 0.15), (0.0, 0.04)
"""Laws of a body's surface: height (rms), correlation length and bulge in limb lengths, uniform."""
LIMBS_DB, FEET_DB, TRUNK_DB, JOINTS = (-6.0, 0.0), (-15.0, 0.0), (-10.0, 0.0), (0.0, 1.0)
"""Laws of the levels of limbs, feet with hands, trunk with neck and head, and joints, uniform."""
N_MEAN_FRAMES, N_MEAN_DIRECTIONS, CELLS_PER_TURN = 128, 256, 3
"""Of mean cross sections: totals within 0.05 dB, also of runners, whose limbs flash seldom, at 60 GHz."""
LEAST_COSINE = 0.05
"""Smallest share of the line of sight across a limb, and cosine of half a bistatic angle."""
EXTREMITIES = ("foot", "paw", "hand")


@dataclass(frozen=True)
class Surface:
    """A draw: levels of segments (S,), bulge, and the limbs' waves (limbs, 2, waves)."""

    power: FloatArray
    bulge: float
    waves_m: FloatArray


def draw_surface(skeleton: Skeleton, rng: np.random.Generator | None) -> Surface:
    """Draw levels and roughness of a body; without rng, the middle of the law without waves."""
    laws = LIMBS_DB, FEET_DB, TRUNK_DB, JOINTS, BULGE, ROUGHNESS_M, CORRELATION_M
    drawn = (float(np.mean(law) if rng is None else rng.uniform(*law)) for law in laws)
    limbs_db, feet_db, trunk_db, joints, bulge, roughness_m, correlation_m = drawn

    def level(segment: Segment) -> float:
        if segment.limb is not None:
            return float(db_to_power(limbs_db))
        if segment.name.endswith(EXTREMITIES):
            return float(db_to_power(feet_db))
        return joints if segment.joint else float(db_to_power(trunk_db))

    lengths_m = 2.0 * skeleton.semi_axes_m[[s.limb is not None for s in skeleton.segments], 2]
    per_m = WAVES_PER_LIMB * np.arange(1, N_WAVES + 1) / lengths_m[:, np.newaxis]
    spread = exponential(-0.5 * np.square(np.pi * per_m * correlation_m))  # root of the spectrum of exp(-x^2 / l^2)
    shape = lengths_m.size, 2, N_WAVES
    heights = (np.zeros(shape) if rng is None else rng.standard_normal(shape)) * spread[:, np.newaxis]
    rms = np.sqrt(np.square(spread).sum(axis=1))[:, np.newaxis, np.newaxis]
    power = np.array([level(s) for s in skeleton.segments])
    return Surface(power, bulge, roughness_m * heights / np.maximum(rms, 1e-9))


@dataclass(frozen=True)
class Limb:
    """A tapered cylinder with bulge; its heights' cosine and sine waves (2, waves)."""

    length_m: float
    radii_m: tuple[float, float]
    bulge: float
    waves_m: FloatArray

    def compute_field(
        self, along: FloatArray, range_m: FloatArray, wavelength_m: float
    ) -> tuple[FloatArray, FloatArray]:
        """Compute the root of the RCS, m, and the phase, rad, both (I,) (E-08h)."""
        # along is the cosine between axis and line of sight; the phase is that against the middle
        # E = sqrt(k c) L T(X), X = L mu + (a2 - a1) c, T the mean of w sqrt(a) exp(2 j k (X t + h + bulge)) along t
        number, (first_m, last_m) = 2.0 * np.pi / wavelength_m, self.radii_m
        across = np.sqrt(np.maximum(1.0 - along * along, 0.0))
        turns = 2.0 / wavelength_m * (self.length_m * along + (last_m - first_m) * across)
        bends = -np.square(self.length_m * across) / (wavelength_m * range_m)  # the wave front's curvature
        n = math.ceil(2.0 / wavelength_m * math.hypot(self.length_m, last_m - first_m)) + SPARE_SAMPLES
        s = (np.arange(n) + 0.5) / n
        phase = 2.0 * np.pi * WAVES_PER_LIMB * np.outer(s, np.arange(1, N_WAVES + 1))
        height_m = cosine(phase) @ self.waves_m[0] + sine(phase) @ self.waves_m[1]
        height_m += self.bulge * self.length_m * (1.0 - np.square(2.0 * s - 1.0))
        fade = np.square(sine(0.5 * np.pi * np.minimum(1.0, np.minimum(s, 1.0 - s) / ROUND_SHARE)))
        weight = fade * np.sqrt(first_m + (last_m - first_m) * s)
        real, imaginary = np.empty((2, along.size))
        line = weight * cosine(2.0 * number * height_m), weight * sine(2.0 * number * height_m)
        native.line_fields(turns, bends, *line, real, imaginary)
        nearer = 1.0 / (1.0 + 0.5 * (first_m + last_m) / range_m)  # a curved wave front around the limb
        size_m = self.length_m * np.sqrt(number * across * nearer * (real * real + imaginary * imaginary))
        return size_m, arctangent(imaginary, real)

    def compute_mean_rcs_m2(self, axis: FloatArray, wavelength_m: float) -> float:
        """Average the cross section far away over axes (T, 3) and horizontal directions."""
        levels = np.sort(np.sqrt(np.square(axis[:, :2]).sum(axis=1)))
        some = levels[((np.arange(N_MEAN_FRAMES) + 0.5) / N_MEAN_FRAMES * levels.size).astype(int)]
        turn = np.pi * (np.arange(N_MEAN_DIRECTIONS) + 0.5) / N_MEAN_DIRECTIONS  # from the axis, on one side
        along = np.outer(some, cosine(turn)).ravel()
        # the field is computed once in every cell of the cosine: many axes and directions share one
        most = max(float(levels[-1]), 1e-9)
        n = CELLS_PER_TURN * math.ceil(1.0 + 4.0 / wavelength_m * self.length_m * most)
        counts = np.bincount(((along / most + 1.0) * (0.5 * n)).astype(int), minlength=n)
        cells = most * ((2.0 * np.arange(n) + 1.0) / n - 1.0)
        size_m, _ = self.compute_field(cells, np.full(n, np.inf), wavelength_m)
        return float((counts * (size_m * size_m)).sum()) / along.size


def make_limbs(skeleton: Skeleton, surface: Surface, height_m: float) -> dict[int, Limb]:
    """Make the limbs of a body, by their number among its segments."""
    numbers = [n for n, segment in enumerate(skeleton.segments) if segment.limb is not None]
    found = {}
    for n, waves_m in zip(numbers, surface.waves_m, strict=True):
        first, last = skeleton.segments[n].limb or (0.0, 0.0)
        length_m = 2.0 * float(skeleton.semi_axes_m[n, 2])
        found[n] = Limb(length_m, (first * height_m, last * height_m), surface.bulge, waves_m)
    return found


def place_specular_points(body: Ellipsoids, number: int, limb: Limb, radar_position_m: FloatArray) -> FloatArray:
    """Place the points (T, 3) of a limb's middle that face the radar."""
    centre, axis = body.centre_m[:, number], body.along[:, number]
    sight = _scale_to_unit(radar_position_m - centre)
    side = sight - _multiply_dot(sight, axis)[:, np.newaxis] * axis
    across = np.maximum(np.sqrt(_multiply_dot(side, side)), LEAST_COSINE)[:, np.newaxis]
    return np.asarray(centre + sum(limb.radii_m) / 2.0 * side / across)
