"""Motion of people and animals: recordings, models, cleaning and retiming."""

from doppelgait.motion.models import boulic_walk, breathing_person, moving_point, pendulum, quadruped_gait, rotor
from doppelgait.motion.readers import read
from doppelgait.motion.retime import scale_to_height
from doppelgait.motion.schema import make_motion

__all__ = [
    "boulic_walk", "breathing_person", "make_motion", "moving_point", "pendulum", "quadruped_gait", "read", "rotor",
    "scale_to_height",
]  # fmt: skip
