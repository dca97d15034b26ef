"""Scenes: targets with motion, place and RCS, one radar."""

from doppelgait.scene.bodies import ellipsoid_rcs_m2
from doppelgait.scene.companions import leashed_dog, side_by_side
from doppelgait.scene.observe import LineOfSight, assemble, body_at, body_track, line_of_sight
from doppelgait.scene.placement import PlacedScene, PlacedTarget, place
from doppelgait.scene.rcs import TYPICAL_RCS_M2, RcsSpec, part_weights, scatterer_rcs_m2
from doppelgait.scene.scatterers import Scatterers, merge_close, scatterers_of
from doppelgait.scene.scene import Scene, Target

__all__ = [
    "TYPICAL_RCS_M2", "LineOfSight", "PlacedScene", "PlacedTarget", "RcsSpec", "Scatterers", "Scene", "Target",
    "assemble", "body_at", "body_track", "ellipsoid_rcs_m2", "leashed_dog", "line_of_sight", "merge_close",
    "part_weights", "place", "scatterer_rcs_m2", "scatterers_of", "side_by_side",
]  # fmt: skip
