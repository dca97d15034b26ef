"""Length units of motion files."""

from __future__ import annotations

from doppelgait.core.errors import MotionError

_METRES = {"mm": 1e-3, "cm": 1e-2, "dm": 1e-1, "m": 1.0, "in": 0.0254, "ft": 0.3048}
# files write units out, in several languages' spelling, and some cut the word to four letters
_WORDS = {"mill": "mm", "cent": "cm", "mete": "m", "metr": "m", "inch": "in", "foot": "ft", "feet": "ft"}


def metres_per_unit(name: str, *, where: str) -> float:
    """Factor from a named length unit to metres.

    Parameters
    ----------
    name : str
        ``"mm"``, ``"cm"``, ``"dm"``, ``"m"``, ``"in"``, ``"ft"`` or the word, in any case.
    where : str
        File name for the message.

    Raises
    ------
    MotionError
        If the unit is not a length or not known.
    """
    word = name.strip().lower()
    factor = _METRES.get(_WORDS.get(word[:4], word))
    if factor is None:
        raise MotionError(f"{where}: the unit {name!r} is no known length; give it: units= one of {', '.join(_METRES)}")
    return factor
