"""Which ellipsoids a body is made of, and between which of its points each one lies.

Joints are means of points, so that the walking model, two usual marker sets and the quadruped model share one
description each of a person and of a four-legged animal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from doppelgait.core.errors import ConfigError
from doppelgait.motion.skeleton import BOULIC_PARTS, bare_name

CHEN_HEIGHT_M = 1.80
"""Stature for which Chen gives the transverse semi-axes; ours scale with the person."""


@dataclass(frozen=True)
class Segment:
    """One ellipsoid: its place between two joints and its semi-axes.

    Parameters
    ----------
    name, part : str
        Name of the scatterer, and the body part that it counts to.
    start, end : str
        Joints; the ellipsoid's centre is half way, its long axis the line between them.
    across, upright : float
        Transverse semi-axes over the body's height (stature or withers height): from side to side, and at right angles
        to that.
    along : float, optional
        Semi-axis along the segment over the body's height; by default half the distance between the joints.
    sideways : (str, str), optional
        Joints whose line is the direction of ``across``; needed only where the two transverse semi-axes differ.
    """

    name: str
    part: str
    start: str
    end: str
    across: float
    upright: float
    along: float | None = None
    sideways: tuple[str, str] | None = None


@dataclass(frozen=True)
class Body:
    """Segments of a body, and every joint as the points whose mean it is."""

    segments: tuple[Segment, ...]
    joints: Mapping[str, tuple[str, ...]]


def _round(name: str, part: str, start: str, end: str, radius: float) -> Segment:
    return Segment(name, part, start, end, across=radius, upright=radius)


def _person() -> tuple[Segment, ...]:
    radius = {name: metres / CHEN_HEIGHT_M for name, metres in CHEN_RADII_M.items()}
    found = [
        _round("head", "head", "neck", "head", radius["head"]),
        _round("torso", "torso", "base", "neck", radius["torso"]),
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


def _animal() -> tuple[Segment, ...]:
    hips = ("left_hip", "right_hip")  # the shoulders would not do: they swing with the scapulae
    found = [
        Segment("thorax", "trunk", "breast", "midriff", 0.14, 0.23, 0.30, hips),
        Segment("abdomen", "trunk", "midriff", "pelvis", 0.12, 0.17, 0.28, hips),
        _round("neck", "neck", "neck_base", "head", 0.09),
        _round("head", "head", "head", "nose", 0.09),
        _round("tail", "tail", "tail_base", "tail_tip", 0.02),
    ]
    for side in ("left", "right"):
        for name, start, end, radius in (
            ("fore_upper", "shoulder", "elbow", 0.06), ("fore_lower", "elbow", "carpus", 0.035),
            ("fore_paw", "carpus", "fore_paw", 0.03), ("hind_upper", "hip", "knee", 0.08),
            ("hind_lower", "knee", "hock", 0.04), ("hind_paw", "hock", "hind_paw", 0.03),
        ):  # fmt: skip
            found.append(_round(f"{side}_{name}", f"{side}_{name}", f"{side}_{start}", f"{side}_{end}", radius))
    return tuple(found)


CHEN_RADII_M = {
    "head": 0.10, "torso": 0.15, "shoulder": 0.06, "upper_arm": 0.06, "forearm": 0.05, "hip": 0.07, "thigh": 0.07,
    "shank": 0.06, "foot": 0.05,
}  # fmt: skip
"""Transverse semi-axes of a person's segments, m (Chen 2011, from the program of his book)."""

PERSON = _person()
"""16 ellipsoids of a person (Chen 2011), each at the middle of its segment."""
ANIMAL = _animal()
"""17 ellipsoids of a four-legged animal: semi-axes over the withers height, assumed from the proportions of dogs."""


def _themselves(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    return {name: (name,) for name in names}


def _marker_joints(waist_front: str, waist_back: str) -> dict[str, tuple[str, ...]]:
    """Joints from the markers of a person: those of the skin over them, so outside the true centre of rotation.

    Waist markers sit above the hips: a hip is taken a fifth of the way from them to the knee (assumed; hip at 0.53,
    waist at 0.58, knee at 0.285 of the stature).
    """
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


def _animal_joints() -> dict[str, tuple[str, ...]]:
    limb = ("shoulder", "elbow", "carpus", "fore_paw", "hip", "knee", "hock", "hind_paw")
    own = [f"{side}_{joint}" for side in ("left", "right") for joint in limb]
    return _themselves([*own, "neck_base", "head", "nose", "tail_base", "tail_tip"]) | {
        "breast": ("neck_base", "chest"),
        "midriff": ("back", "belly"),
        "pelvis": ("rump", "left_hip", "right_hip"),
    }


BODIES: Mapping[str, Body] = {
    "boulic": Body(PERSON, _themselves(list(BOULIC_PARTS))),
    "CMU 41": Body(PERSON, _marker_joints("FWT", "BWT")),
    "Plug-in Gait": Body(PERSON, _marker_joints("ASI", "PSI")),
    "quadruped": Body(ANIMAL, _animal_joints()),
}
"""Bodies by the set of points that they are known from."""


def body_of(markers: Sequence[str], source: str) -> tuple[Body, dict[str, list[int]]]:
    """Body of a motion and, for every joint, the numbers of the points whose mean it is.

    Parameters
    ----------
    markers : sequence of str
        Point names, with or without subject prefix, in any case.
    source : str
        Name of the motion, for messages.

    Raises
    ------
    ConfigError
        If the points give no body; the message names the nearest set and what it lacks.
    """
    number = {bare_name(marker).upper(): n for n, marker in enumerate(markers)}
    lacking: dict[str, list[str]] = {}
    for name, body in BODIES.items():
        lacking[name] = sorted({p for points in body.joints.values() for p in points if p.upper() not in number})
        if not lacking[name]:
            return body, {joint: [number[p.upper()] for p in points] for joint, points in body.joints.items()}
    nearest = min(lacking, key=lambda name: len(lacking[name]))
    shown = ", ".join(lacking[nearest][:6]) + (", ..." if len(lacking[nearest]) > 6 else "")
    raise ConfigError(
        f"{source}: rcs kind 'ellipsoids' and occlusion need a body whose joints are known ({', '.join(BODIES)}); of "
        f"these points the nearest set is {nearest}, which lacks {shown}; use rcs kind 'auto' without occlusion"
    )
