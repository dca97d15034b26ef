"""Measured figures of a simulator against theory, and their table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

NOT_APPLICABLE = "not applicable"


@dataclass(frozen=True)
class Check:
    """Result of one check.

    Parameters
    ----------
    name : str
        ``RULE[RADAR]``, or ``RULE`` where no radar's waveform matters.
    what : str
        Quantity that is compared.
    figure : float
        Maximum measured deviation from theory; NaN if it could not be measured.
    limit : float
        Largest figure that passes.
    unit : str
        Of figure and limit.
    passed : bool or None
        ``figure <= limit``; None if the simulator lacks the checked part.
    source : str
        Source of the theory.
    note : str
        Reason for a missing figure.
    """

    name: str
    what: str
    figure: float
    limit: float
    unit: str
    passed: bool | None
    source: str
    note: str = ""


def format_report(checks: Sequence[Check]) -> str:
    """Format checks as a table in Markdown, and count them.

    Parameters
    ----------
    checks : sequence of Check

    Returns
    -------
    str
        Table with notes in the last column.
    """
    head = ["check", "compared", "figure", "limit", "unit", "result", "theory"]
    rows = [head, ["---", "---", "---:", "---:", "---", "---", "---"]]
    for check in checks:
        result = {True: "passed", False: "FAILED", None: NOT_APPLICABLE}[check.passed]
        figure = "" if check.figure != check.figure else f"{check.figure:.2g}"
        source = f"{check.source} ({check.note})" if check.note else check.source
        cells = [check.name, check.what, figure, f"{check.limit:g}", check.unit, result, source]
        rows.append([cell.replace("|", "\\|").replace("\n", " ") for cell in cells])
    failed = sum(check.passed is False for check in checks)
    missing = sum(check.passed is None for check in checks)
    count = (
        f"{len(checks)} checks: {len(checks) - failed - missing} passed, {failed} failed, {missing} {NOT_APPLICABLE}"
    )
    return "\n".join([*("| " + " | ".join(row) + " |" for row in rows), "", count])
