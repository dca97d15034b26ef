"""What one figure or table of the report is here: its number, what the report states, how it is made, what is read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from doppelgait.reproduce.material import Material


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
    """

    name: str
    ours: float
    unit: str
    stated: float | None = None
    tolerance: float | None = None
    note: str = ""

    @property
    def agrees(self) -> bool | None:
        """Whether the number lies within the tolerance; None where the report states none."""
        if self.stated is None:
            return None
        return bool(abs(self.ours - self.stated) <= (self.tolerance or 0.0))


def judged(readings: Sequence[Reading], text: str) -> str:
    """A judgement that begins with whether all readings agree, for entries whose motion may be anybody's."""
    differing = [reading.name for reading in readings if reading.agrees is False]
    return f"{'Differs in: ' + ', '.join(differing) + '. ' if differing else 'Agrees: '}{text}"


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
