"""How a motion model is declared: a configuration, a function and a name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from doppelgait.core.config import FrozenModel
from doppelgait.core.registry import Registry
from doppelgait.motion.motion import Motion


@dataclass(frozen=True)
class MotionModel:
    """A parametric mover.

    Parameters
    ----------
    config : type
        Its parameters; every field has a default, so that the name alone gives a motion.
    generate : callable
        ``generate(config, duration_s, rng) -> motion``; ``rng`` may be unused or None.
    """

    config: type[FrozenModel]
    generate: Callable[[Any, float, np.random.Generator | None], Motion]


MOTION_MODELS: Registry[MotionModel] = Registry("doppelgait.motion_models", "motion model")
"""Motion models by the ``kind`` of a scene file."""
