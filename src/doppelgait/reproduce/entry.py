"""What one figure or table of the report is here: its number, what the report states, how it is made, what is read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from doppelgait.reproduce.material import Material

KINDS = ("agrees", "set", "differs", "not stated")
"""What a number may be beside the report's: within its tolerance; set here as the report has it; outside; or nothing
to compare it with."""


@dataclass(frozen=True)
class Reading:
    """One number read off what was made.

    Attributes
    ----------
    name : str
        The quantity, in words.
    ours : float
        What is measured here; NaN if it could not be measured.
    unit : str
        "Hz", "m/s", ...; "1" for pure numbers.
    stated : float, optional
        What the report states; None where it states no number.
    tolerance : float, optional
        How far ``ours`` may lie from ``stated`` and still agree, absolute, in ``unit``. It comes from how exactly the
        report states the number (a value printed, a value read off an axis), not from what is measured here. Exact
        agreement is asked for by None.
    note : str
        Why they differ, or where the number comes from.
    given : bool
        Set as the report has it, or a fact of the model that stands in: that it is as stated shows nothing, so it never
        counts as agreeing. It still differs where it is not as stated.
    """

    name: str
    ours: float
    unit: str
    stated: float | None = None
    tolerance: float | None = None
    note: str = ""
    given: bool = False

    @property
    def kind(self) -> str:
        """One of `KINDS`."""
        if self.stated is None:
            return "not stated"
        if not abs(self.ours - self.stated) <= (self.tolerance or 0.0):
            return "differs"
        return "set" if self.given else "agrees"

    @property
    def agrees(self) -> bool | None:
        """Whether the number lies within the tolerance; None where the report states none or the number was set."""
        return {"agrees": True, "differs": False}.get(self.kind)


def verdict(readings: Sequence[Reading]) -> str:
    """What the readings say of an entry as a whole, in words that begin a judgement.

    Returns
    -------
    str
        "Agrees" if every number compared with the report does, "Differs in part" or "Differs" if some or all do not;
        "Set as stated" if all that the report states was set here, "Not compared" if it states no number.
    """
    kinds = {reading.kind for reading in readings}
    if "differs" in kinds:
        return "Differs in part" if "agrees" in kinds else "Differs"
    if "agrees" in kinds:
        return "Agrees"
    return "Set as stated" if "set" in kinds else "Not compared"


def judged(readings: Sequence[Reading], text: str) -> str:
    """A judgement that begins with the verdict on the readings and names those that differ."""
    differing = [reading.name for reading in readings if reading.kind == "differs"]
    return f"{'Differs in: ' + '; '.join(differing) + '. ' if differing else verdict(readings) + ': '}{text}"


@dataclass(frozen=True)
class Made:
    """What making an entry gives.

    Attributes
    ----------
    figure : Figure, optional
        Drawing of the entry; None for a table.
    readings : sequence of Reading
    judgement : str
        One to three sentences: it agrees, or why it does not.
    table : DataFrame, optional
        Table shown on the page beside or instead of the figure.
    """

    figure: Figure | None
    readings: Sequence[Reading]
    judgement: str
    table: pd.DataFrame | None = None


@dataclass(frozen=True)
class Entry:
    """A figure or table of the report.

    Attributes
    ----------
    number : str
        As in the report: "fig-4.13", "table-3.2".
    title : str
        What it shows, in our words.
    stated : str
        What the report says about it, in our words.
    make : callable
        Makes it from the material of the run.
    """

    number: str
    title: str
    stated: str
    make: Callable[[Material], Made]
