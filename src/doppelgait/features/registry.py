"""How a feature beyond the six is declared, and the names under which they are found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from doppelgait.core.registry import Registry
from doppelgait.features.observed import Observed


@dataclass(frozen=True)
class Feature:
    """One feature of a target's signature.

    Parameters
    ----------
    unit : str
        ``"1"`` for a plain number.
    source : str
        Where the definition comes from: literature or our equations.
    function : callable
        ``function(observed) -> float | None``; ``observed.evidence`` is what the processing hands over. It is called
        only where everything in ``needs`` holds; None, or a value that is not finite, means undetermined.
    needs : tuple of str
        What must be known, in the order it is asked for: ``"gait_frequency"``, ``"direction"`` (the target moves
        towards or away from the radar), ``"envelope"`` (half of the columns or more stand above the noise), ``"line"``
        (the main line can be followed).
    """

    unit: str
    source: str
    function: Callable[[Observed], float | None]
    needs: tuple[str, ...] = ()


FEATURES: Registry[Feature] = Registry("doppelgait.features", "feature")
"""Features beyond the six by name; packages add theirs through the entry-point group ``doppelgait.features``."""
