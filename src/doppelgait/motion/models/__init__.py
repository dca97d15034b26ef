"""Motion from equations: a walking person, a dog in its gaits, and primitives with known answers."""

from doppelgait.motion.models.boulic import BoulicConfig, boulic_points, boulic_walk
from doppelgait.motion.models.primitives import (
    BreathingConfig,
    PendulumConfig,
    PointConfig,
    RotorConfig,
    breathing_person,
    moving_point,
    pendulum,
    rotor,
)
from doppelgait.motion.models.quadruped import QuadrupedConfig, quadruped_gait
from doppelgait.motion.models.registry import MOTION_MODELS, MotionModel

__all__ = [
    "MOTION_MODELS",
    "BoulicConfig",
    "BreathingConfig",
    "MotionModel",
    "PendulumConfig",
    "PointConfig",
    "QuadrupedConfig",
    "RotorConfig",
    "boulic_points",
    "boulic_walk",
    "breathing_person",
    "moving_point",
    "pendulum",
    "quadruped_gait",
    "rotor",
]
