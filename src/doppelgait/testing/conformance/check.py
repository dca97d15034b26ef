"""One measured figure of a simulator against theory, and the table of many."""

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
        What is compared.
    figure : float
        Largest deviation from theory that was found; NaN where none could be measured.
    limit : float
        Largest figure that passes.
    unit : str
        Of figure and limit.
    passed : bool or None
        Whether ``figure <= limit``; None where the simulator does not have what is checked.
    source : str
        Where the theory is from.
    note : str
        Why there is no figure.
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
    """Table of checks in Markdown, and a line that counts them.

    Parameters
    ----------
    checks : sequence of Check

    Returns
    -------
    str
        Notes stand in the row's last column.
    """
    head = ["check", "compared", "figure", "limit", "unit", "result", "theory"]
    rows = [head, ["---", "---", "---:", "---:", "---", "---", "---"], *(_row(check) for check in checks)]
    failed = sum(check.passed is False for check in checks)
    missing = sum(check.passed is None for check in checks)
    count = (
        f"{len(checks)} checks: {len(checks) - failed - missing} passed, {failed} failed, {missing} {NOT_APPLICABLE}"
    )
    return "\n".join([*("| " + " | ".join(row) + " |" for row in rows), "", count])


def _row(check: Check) -> list[str]:
    result = {True: "passed", False: "FAILED", None: NOT_APPLICABLE}[check.passed]
    figure = "" if check.figure != check.figure else f"{check.figure:.2g}"
    source = f"{check.source} ({check.note})" if check.note else check.source
    cells = [check.name, check.what, figure, f"{check.limit:g}", check.unit, result, source]
    return [cell.replace("|", "\\|").replace("\n", " ") for cell in cells]
