"""What a verification found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

Progress = Callable[[int, int], None]
Status = Literal["passed", "warning", "failed", "skipped"]

SHOWN_NAMES = 5


@dataclass(frozen=True)
class Check:
    """One check.

    Parameters
    ----------
    name : str
    status : {"passed", "warning", "failed", "skipped"}
        ``warning``: worth a look, the dataset stays valid. ``skipped``: could not be checked; the summary says why.
    summary : str
        What was found, in one line.
    numbers : dict
        The figures behind it, for JSON.
    """

    name: str
    status: Status
    summary: str
    numbers: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Verification:
    """What a verification found.

    Parameters
    ----------
    directory : Path
    dataset_id : str
    complete : bool
        Whether the dataset says that it is.
    checks : tuple of Check
    figures : tuple of Path
    seconds : float
    """

    directory: Path
    dataset_id: str
    complete: bool
    checks: tuple[Check, ...]
    figures: tuple[Path, ...]
    seconds: float

    @property
    def passed(self) -> bool:
        """Whether no check failed."""
        return all(check.status != "failed" for check in self.checks)

    def check(self, name: str) -> Check:
        """The check of a name."""
        return next(check for check in self.checks if check.name == name)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        figures = [str(path) for path in self.figures]
        return {**asdict(self), "directory": str(self.directory), "figures": figures, "passed": self.passed}


def some(names: Sequence[str]) -> str:
    """The first few of many names."""
    more = f" and {len(names) - SHOWN_NAMES} more" if len(names) > SHOWN_NAMES else ""
    return f"{', '.join(map(str, names[:SHOWN_NAMES]))}{more}"
