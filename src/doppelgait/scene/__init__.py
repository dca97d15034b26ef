"""Scenes: targets with motion, place and RCS, one radar."""

from doppelgait.scene.bodies import ellipsoid_rcs_m2
from doppelgait.scene.observe import LineOfSight, assemble, compute_body_track, line_of_sight, place_body_at
from doppelgait.scene.placement import PlacedScene, PlacedTarget, leashed_dog, place, side_by_side
from doppelgait.scene.rcs import (
    TYPICAL_RCS_M2,
    RcsSpec,
    Scatterers,
    compute_part_weights,
    compute_scatterers,
    scatterer_rcs_m2,
)
from doppelgait.scene.scene import Scene, Target

__all__ = [
    "TYPICAL_RCS_M2",
    "LineOfSight",
    "PlacedScene",
    "PlacedTarget",
    "RcsSpec",
    "Scatterers",
    "Scene",
    "Target",
    "assemble",
    "compute_body_track",
    "compute_part_weights",
    "compute_scatterers",
    "ellipsoid_rcs_m2",
    "leashed_dog",
    "line_of_sight",
    "place",
    "place_body_at",
    "scatterer_rcs_m2",
    "side_by_side",
]
