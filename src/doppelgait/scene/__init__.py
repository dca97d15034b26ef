"""Scenes: targets with motion, place and radar cross section, seen from one radar position."""

from doppelgait.scene.assemble import LineOfSight, assemble, body_track, line_of_sight, observe
from doppelgait.scene.rcs import RcsSpec, part_weights, scatterer_rcs_m2
from doppelgait.scene.target import Scene, Target, placed_motion

__all__ = [
    "LineOfSight", "RcsSpec", "Scene", "Target", "assemble", "body_track", "line_of_sight", "observe", "part_weights",
    "placed_motion", "scatterer_rcs_m2",
]  # fmt: skip
