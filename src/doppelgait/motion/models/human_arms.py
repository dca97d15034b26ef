"""What the arms do beside the gait's own swing: more or less of it, hands in pockets, or a load before the body."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Limbs = dict[str, FloatArray]
Curves = Callable[[FloatArray], Limbs]
"""Leg phases of left and right, (2, n), to flexions in degrees by joint, each (2, n)."""
Hands = Literal["free", "pockets", "carrying"]

HELD = {"pockets": (-12.0, 45.0, 0.15), "carrying": (5.0, 90.0, 0.1)}
"""Mean shoulder and elbow flexion in degrees, and the share of the swing that is left (assumed)."""

_CYCLE = np.arange(200) / 200


def swing_arms(curves: Curves, *, factor: float, hands: tuple[Hands, Hands]) -> Curves:
    """Joint curves with another arm swing.

    Parameters
    ----------
    curves : callable
        The gait's own.
    factor : float
        Swing of shoulder and elbow about their means relative to the gait's own; exactly its own at 1.
    hands : (str, str)
        Left and right: ``"free"``; ``"pockets"`` or ``"carrying"``: see :data:`HELD`.
    """
    if factor == 1 and hands == ("free", "free"):
        return curves
    means = {joint: curves(np.stack([_CYCLE, _CYCLE]))[joint].mean() for joint in ("shoulder", "elbow")}

    def changed(phase: FloatArray) -> Limbs:
        limbs = dict(curves(phase))
        for number, joint in enumerate(("shoulder", "elbow")):
            rows = []
            for hand, own in zip(hands, limbs[joint], strict=True):
                held = HELD.get(hand)
                mean, share = (held[number], held[2]) if held else (means[joint], 1.0)
                rows.append(mean + factor * share * (own - means[joint]))
            limbs[joint] = np.stack(rows)
        return limbs

    return changed
