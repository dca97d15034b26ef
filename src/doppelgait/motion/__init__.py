"""Motions: recordings, models, cleaning, segments, loops and paths."""

from doppelgait.motion.follow import follow
from doppelgait.motion.hybrid import blend, retarget
from doppelgait.motion.loop import loop
from doppelgait.motion.models import (
    boulic_walk,
    breathing_person,
    crawling_person,
    curtain,
    fan,
    generate,
    human_gait,
    moving_point,
    pendulum,
    quadruped_gait,
    robot_vacuum,
    rotor,
    sample_dog,
    sample_person,
)
from doppelgait.motion.motion import Motion, MotionFacts, make_motion
from doppelgait.motion.paths import make_path
from doppelgait.motion.readers import read
from doppelgait.motion.retime import scale_to_height
from doppelgait.motion.segments import find_segments

__all__ = [
    "Motion",
    "MotionFacts",
    "blend",
    "boulic_walk",
    "breathing_person",
    "crawling_person",
    "curtain",
    "fan",
    "find_segments",
    "follow",
    "generate",
    "human_gait",
    "loop",
    "make_motion",
    "make_path",
    "moving_point",
    "pendulum",
    "quadruped_gait",
    "read",
    "retarget",
    "robot_vacuum",
    "rotor",
    "sample_dog",
    "sample_person",
    "scale_to_height",
]
