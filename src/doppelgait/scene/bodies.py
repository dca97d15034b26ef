"""Ellipsoid bodies: joints, cross sections, occlusion (E-08c, E-08e to E-08g).

Joints are means of points, so that the walking model, two usual marker sets and the quadruped model
share one description each of a person and of a four-legged animal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.errors import ConfigError
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import resample
from doppelgait.motion.skeleton import BOULIC_PARTS, strip_subject

FloatArray = npt.NDArray[np.float64]

CHEN_HEIGHT_M = 1.80
"""Stature (m) of Chen's transverse semi-axes; doppelgait scales them with the person."""


@dataclass(frozen=True)
class Segment:
    """One ellipsoid: its place between two joints and its semi-axes."""

    name: str
    part: str
    start: str
    end: str
    across: float
    upright: float
    along: float | None = None
    sideways: tuple[str, str] | None = None
    at: float = 0.5


@dataclass(frozen=True)
class Body:
    """Segments and joints of a body. Every joint is the mean of one or more points."""

    segments: tuple[Segment, ...]
    joints: Mapping[str, tuple[str, ...]]


def _round(name: str, part: str, start: str, end: str, radius: float) -> Segment:
    return Segment(name, part, start, end, across=radius, upright=radius)


def _make_person() -> tuple[Segment, ...]:
    radius = {name: metres / CHEN_HEIGHT_M for name, metres in CHEN_RADII_M.items()}
    found = [
        _round("head", "head", "neck", "head", radius["head"]),
        Segment(
            "torso",
            "torso",
            "base",
            "neck",
            TORSO_M[0] / CHEN_HEIGHT_M,
            TORSO_M[1] / CHEN_HEIGHT_M,
            sideways=("left_shoulder", "right_shoulder"),
        ),
    ]
    for side in ("left", "right"):
        for name, part, start, end in (
            ("shoulder", "torso", "neck", f"{side}_shoulder"),
            ("upper_arm", f"{side}_upper_arm", f"{side}_shoulder", f"{side}_elbow"),
            ("forearm", f"{side}_forearm", f"{side}_elbow", f"{side}_hand"),
            ("hip", "torso", "base", f"{side}_hip"),
            ("thigh", f"{side}_thigh", f"{side}_hip", f"{side}_knee"),
            ("shank", f"{side}_shank", f"{side}_knee", f"{side}_ankle"),
            ("foot", f"{side}_foot", f"{side}_ankle", f"{side}_toe"),
        ):
            found.append(_round(f"{side}_{name}", part, start, end, radius[name]))
    return tuple(found)


def _make_animal() -> tuple[Segment, ...]:
    hips = ("left_hip", "right_hip")  # not the shoulders: they swing with the scapulae
    found = [
        Segment("chest", "trunk", "breast", "midriff", *CHEST, hips, at=0.0),
        Segment("thorax", "trunk", "breast", "midriff", 0.14, 0.23, 0.30, hips),
        Segment("abdomen", "trunk", "midriff", "pelvis", 0.12, 0.17, 0.28, hips),
        Segment("rump", "trunk", "midriff", "pelvis", *RUMP, hips, at=1.0),
        _round("neck", "neck", "neck_base", "head", 0.09),
        _round("head", "head", "head", "nose", 0.09),
        _round("tail", "tail", "tail_base", "tail_tip", 0.02),
    ]
    for side in ("left", "right"):
        for name, start, end, radius in (
            ("fore_upper", "shoulder", "elbow", 0.06),
            ("fore_lower", "elbow", "carpus", 0.035),
            ("fore_paw", "carpus", "fore_paw", 0.03),
            ("hind_upper", "hip", "knee", 0.08),
            ("hind_lower", "knee", "hock", 0.04),
            ("hind_paw", "hock", "hind_paw", 0.03),
        ):
            found.append(_round(f"{side}_{name}", f"{side}_{name}", f"{side}_{start}", f"{side}_{end}", radius))
    return tuple(found)


CHEN_RADII_M = {
    "head": 0.10,
    "shoulder": 0.06,
    "upper_arm": 0.06,
    "forearm": 0.05,
    "hip": 0.07,
    "thigh": 0.07,
    "shank": 0.06,
    "foot": 0.05,
}
"""Transverse semi-axes of a person's segments, m (Chen 2011, from the program of his book)."""

TORSO_M = (0.16, 0.13)
"""Transverse semi-axes of the torso, m: from side to side, and from front to back (Chen uses 0.15 m for both).

They are half the chest breadth and depth of adults: 0.322 and 0.243 m for men of 1.76 m, 0.280 and
0.239 m for women of 1.63 m (Gordon et al. 1989), scaled to 1.80 m and averaged over both sexes. The
front reflects (0.16 / 0.13)^4 = 3.6 dB more than the side; with 0.17 and 0.11 m the difference
would be 7.6 dB.
"""

CHEST, RUMP = (0.16, 0.23, 0.16), (0.13, 0.17, 0.13)
"""Semi-axes (across, upright, along) of the blunt ends of an animal's trunk, divided by the withers height.

A trunk ends in the chest between the shoulders and in the rump, not in the tips of ellipsoids. Both
ellipsoids are as wide as the model's shoulders or hips with their muscles (0.11 + 0.05 and 0.10 +
0.03), as high as thorax and abdomen, and circular from above. The front of the chest is then at the
point of the shoulder, and the back of the rump at the root of the tail. These values are assumed:
no measured curvature of an animal's chest is known.
"""

PERSON = _make_person()
"""16 ellipsoids of a person, each at the middle of its segment (Chen 2011, except the torso)."""
ANIMAL = _make_animal()
"""19 ellipsoids of a four-legged animal; semi-axes relative to the withers height, assumed from dogs' proportions."""


def _name_themselves(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    return {name: (name,) for name in names}


def _describe_marker_joints(waist_front: str, waist_back: str) -> dict[str, tuple[str, ...]]:
    """Describe a person's joints as means of markers."""
    # the markers are on the skin over the joints, that is, outside the true centre of rotation
    waist = (waist_front, waist_back, waist_front, waist_back, "KNE")
    middle = {
        "head": ("LFHD", "RFHD", "LBHD", "RBHD"),
        "neck": ("C7", "CLAV"),
        "base": tuple(side + name for side in "LR" for name in waist),
    }
    sided = {"shoulder": ("SHO",), "elbow": ("ELB",), "hand": ("WRA", "WRB"), "hip": waist, "knee": ("KNE",)}
    sided |= {"ankle": ("ANK",), "toe": ("TOE",)}
    return middle | {
        f"{side}_{joint}": tuple(side[0].upper() + name for name in names)
        for side in ("left", "right")
        for joint, names in sided.items()
    }


ANIMAL_LIMBS = ("shoulder", "elbow", "carpus", "fore_paw", "hip", "knee", "hock", "hind_paw")

BODIES: Mapping[str, Body] = {
    "boulic": Body(PERSON, _name_themselves(list(BOULIC_PARTS))),
    "CMU 41": Body(PERSON, _describe_marker_joints("FWT", "BWT")),
    "Plug-in Gait": Body(PERSON, _describe_marker_joints("ASI", "PSI")),
    "quadruped": Body(
        ANIMAL,
        {
            **_name_themselves([f"{side}_{joint}" for side in ("left", "right") for joint in ANIMAL_LIMBS]),
            **_name_themselves(["neck_base", "head", "nose", "tail_base", "tail_tip"]),
            "breast": ("neck_base", "chest"),
            "midriff": ("back", "belly"),
            "pelvis": ("rump", "left_hip", "right_hip"),
        },
    ),
}
"""Body models by the name of the point set that defines their joints."""


def find_body(markers: Sequence[str], source: str) -> tuple[Body, dict[str, list[int]]]:
    """Find a motion's body and every joint's points. A joint is the mean of its points."""
    number = {strip_subject(marker).upper(): n for n, marker in enumerate(markers)}
    lacking: dict[str, list[str]] = {}
    for name, body in BODIES.items():
        lacking[name] = sorted({p for points in body.joints.values() for p in points if p.upper() not in number})
        if not lacking[name]:
            return body, {joint: [number[p.upper()] for p in points] for joint, points in body.joints.items()}
    nearest = min(lacking, key=lambda name: len(lacking[name]))
    shown = ", ".join(lacking[nearest][:6]) + (", ..." if len(lacking[nearest]) > 6 else "")
    raise ConfigError(
        f"{source}: rcs kind 'ellipsoids' and occlusion need a body with known joints ({', '.join(BODIES)}); the "
        f"nearest point set is {nearest}, but the motion lacks {shown}; use rcs kind 'auto' without occlusion"
    )


def average_points(motion: Motion, groups: Sequence[Sequence[int]]) -> npt.NDArray[np.float64]:
    """Average groups of points."""
    # the result has the shape (T, G, 3), m. A spline through means is the mean of the splines.
    values = motion.position_m
    means = np.empty((values.shape[0], len(groups), 3))
    for n, group in enumerate(groups):
        means[:, n] = values[:, group[0]] if len(group) == 1 else values[:, list(group)].mean(axis=1)
    return means


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


def mean_rcs_m2(body: Ellipsoids) -> float:
    """Average the body's RCS, m^2, over times and all horizontal directions."""
    across, upright, along = body.semi_axes_m.T
    wide, long = across**2 - upright**2, along**2 - upright**2
    x, y = body.along[..., 0], body.along[..., 1]
    side_x, side_y = body.across[..., 0], body.across[..., 1]
    xx = upright**2 + wide * side_x**2 + long * x**2
    yy = upright**2 + wide * side_y**2 + long * y**2
    xy = wide * side_x * side_y + long * x * y
    square = xx * yy - xy**2
    each_m2 = np.pi * (across * upright * along) ** 2 * (xx + yy) / (2.0 * square * np.sqrt(square))
    return float(each_m2.mean(axis=0).sum())


def build_skeleton(motion: Motion) -> Skeleton:
    """Build joints and ellipsoids of a motion."""
    source, height_m = motion.facts.source, motion.facts.height_m
    body, points = find_body(motion.markers, source)
    if not height_m > 0:
        raise ConfigError(f"{source}: the height is unknown, so the ellipsoids have no size; use another rcs kind")
    joints = motion.with_points(average_points(motion, list(points.values())), list(points), [""] * len(points))
    skeleton = Skeleton(joints, body.segments, np.empty(0))
    start, end = (joints.position_m[:, skeleton.numbers(which)] for which in ("start", "end"))
    half_m = np.median(np.sqrt(((end - start) ** 2).sum(axis=-1)), axis=0) / 2.0
    if not half_m.min() > 0:
        raise ConfigError(f"{source}: segment {body.segments[int(half_m.argmin())].name} has no length")
    sizes = [
        (s.across * height_m, s.upright * height_m, float(half) if s.along is None else s.along * height_m)
        for s, half in zip(body.segments, half_m, strict=True)
    ]
    return Skeleton(joints, body.segments, np.array(sizes))


def find_nearest_points(skeleton: Skeleton, body: Ellipsoids, radar_position_m: npt.ArrayLike) -> Motion:
    r"""Compute the motion of the reflecting points. Shapes: radar_position_m (3,) (E-08f)."""
    points = np.empty(body.centre_m.shape)
    radar = np.asarray(radar_position_m, dtype=np.float64)
    native.nearest_points(body.centre_m, body.along, body.across, body.semi_axes_m, radar, points)
    names, parts = ([getattr(s, key) for s in skeleton.segments] for key in ("name", "part"))
    return skeleton.joints.with_points(points, names, parts)


def compute_ellipsoids_at(skeleton: Skeleton, time_s: FloatArray) -> Ellipsoids:
    """Compute the ellipsoids at times after the first frame."""
    # positions are on the spline of E-02
    return _compute_ellipsoids(skeleton, resample(skeleton.joints, time_s)[0])


def compute_frame_ellipsoids(skeleton: Skeleton) -> Ellipsoids:
    """Compute the ellipsoids at the frames of the motion."""
    return _compute_ellipsoids(skeleton, skeleton.joints.position_m)


def _compute_ellipsoids(skeleton: Skeleton, joint_m: FloatArray) -> Ellipsoids:
    number = {name: n for n, name in enumerate(skeleton.joints.markers)}
    start, end = joint_m[:, skeleton.numbers("start")], joint_m[:, skeleton.numbers("end")]
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


def seen_rcs_m2(body: Ellipsoids, radar_position_m: npt.ArrayLike) -> FloatArray:
    """Compute every ellipsoid's RCS at its distance (E-08c, E-08g)."""
    # the result has the shape (I, S), m^2, and is not scaled to a total
    rcs_m2, radar = np.empty(body.centre_m.shape[:2]), np.asarray(radar_position_m, dtype=np.float64)
    native.seen_rcs(body.centre_m, body.along, body.across, body.semi_axes_m, radar, rcs_m2)
    return rcs_m2


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
    amplitude = np.empty(points.shape[:2])
    native.sight_amplitudes(
        points,
        body.centre_m,
        body.along,
        body.across,
        body.semi_axes_m,
        own,
        np.asarray(radar_position_m, dtype=np.float64),
        edge_m,
        amplitude,
    )
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
