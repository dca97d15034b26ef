"""Scenes: targets with motion, place and radar cross section, seen from one radar position."""

from doppelgait.scene.assemble import LineOfSight, assemble, body_at, body_track, line_of_sight, observe
from doppelgait.scene.companions import leashed_dog, side_by_side
from doppelgait.scene.ellipsoids import ellipsoid_rcs_m2
from doppelgait.scene.merge import merge_close
from doppelgait.scene.rcs import TYPICAL_RCS_M2, RcsSpec, part_weights, scatterer_rcs_m2
from doppelgait.scene.scatterers import Scatterers, scatterers_of
from doppelgait.scene.target import Scene, Target, placed_motion

__all__ = [
    "TYPICAL_RCS_M2", "LineOfSight", "RcsSpec", "Scatterers", "Scene", "Target", "assemble", "body_at", "body_track",
    "ellipsoid_rcs_m2", "leashed_dog", "line_of_sight", "merge_close", "observe", "part_weights", "placed_motion",
    "scatterer_rcs_m2", "scatterers_of", "side_by_side",
]  # fmt: skip
