"""Motion models: people, animals, confusers and primitives."""

from doppelgait.motion.models.boulic import BoulicConfig, boulic_walk
from doppelgait.motion.models.human import HumanConfig, human_gait
from doppelgait.motion.models.human_body import Person, sample_person
from doppelgait.motion.models.primitives import (
    BreathingConfig,
    CrawlConfig,
    CurtainConfig,
    FanConfig,
    PendulumConfig,
    PointConfig,
    RotorConfig,
    VacuumConfig,
    breathing_person,
    crawling_person,
    curtain,
    fan,
    moving_point,
    pendulum,
    robot_vacuum,
    rotor,
)
from doppelgait.motion.models.quadruped import QuadrupedConfig, quadruped_gait
from doppelgait.motion.models.quadruped_gaits import Dog, sample_dog
from doppelgait.motion.models.registry import MOTION_MODELS, generate, get_parameters

__all__ = [
    "MOTION_MODELS",
    "BoulicConfig",
    "BreathingConfig",
    "CrawlConfig",
    "CurtainConfig",
    "Dog",
    "FanConfig",
    "HumanConfig",
    "PendulumConfig",
    "Person",
    "PointConfig",
    "QuadrupedConfig",
    "RotorConfig",
    "VacuumConfig",
    "boulic_walk",
    "breathing_person",
    "crawling_person",
    "curtain",
    "fan",
    "generate",
    "get_parameters",
    "human_gait",
    "moving_point",
    "pendulum",
    "quadruped_gait",
    "robot_vacuum",
    "rotor",
    "sample_dog",
    "sample_person",
]
