"""What became of one entry: what was made, from what, in which time, or why it could not be made."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from doppelgait.reproduce.entry import Entry, Made, Reading


@dataclass(frozen=True)
class Outcome:
    """An entry after its making.

    Attributes
    ----------
    entry : Entry
    made : Made, optional
        None if it could not be made; ``error`` says why.
    used : sequence of str
        Movers it was made from: "model: ..." or "recording: ...".
    remarks : sequence of str
        Warnings while it was made.
    seconds : float
        Time it took, drawing among it; what is shared counts for the first that needs it.
    error : str
    """

    entry: Entry
    made: Made | None
    used: Sequence[str] = ()
    remarks: Sequence[str] = ()
    seconds: float = 0.0
    error: str = ""

    @property
    def readings(self) -> Sequence[Reading]:
        """Numbers read, none if it could not be made."""
        return self.made.readings if self.made else ()

    def count_kind(self, kind: str) -> int:
        """Readings of one of `KINDS`."""
        return sum(reading.kind == kind for reading in self.readings)

    @property
    def figure_path(self) -> str | None:
        """Path of the figure in the output folder."""
        return f"figures/{self.entry.number}.png" if self.made and self.made.figure is not None else None

    @property
    def table_path(self) -> str | None:
        """Path of the table in the output folder."""
        return f"tables/{self.entry.number}.csv" if self.made and self.made.table is not None else None

    def as_dict(self) -> dict[str, Any]:
        """Everything but the figure and the table, for JSON; NaN is None."""
        return {
            "number": self.entry.number,
            "title": self.entry.title,
            "stated": self.entry.stated,
            "made": self.made is not None,
            "error": self.error or None,
            "made_from": list(self.used),
            "readings": [_reading_as_dict(reading) for reading in self.readings],
            "judgement": self.made.judgement if self.made else None,
            "remarks": list(self.remarks),
            "seconds": round(self.seconds, 3),
            "figure": self.figure_path,
            "table": self.table_path,
        }


def _reading_as_dict(reading: Reading) -> dict[str, Any]:
    plain = {name: _finite(value) for name, value in vars(reading).items()}
    return {**plain, "agrees": reading.agrees, "kind": reading.kind}


def _finite(value: str | float | None) -> str | float | None:
    """Texts and truths as they are, numbers as plain floats, what is no finite number as None."""
    if value is None or isinstance(value, (str, bool)):
        return value
    return float(value) if math.isfinite(value) else None
