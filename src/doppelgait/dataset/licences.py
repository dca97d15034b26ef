"""What the licences of motion files and recordings allow."""

from __future__ import annotations

import re
from collections.abc import Iterable

import pandas as pd

FREE = re.compile(
    r"(cc0|cc[ -]by|cc[ -]by[ -]sa|odc[ -]by|odbl|pddl|mit|isc|unlicense|bsd[ -][0-4][ -]clause|apache([ -]2\.0)?"
    r"|cdla[ -](permissive|sharing)|public domain|own)([ -][0-9.]+)?",
    re.IGNORECASE,
)
"""Licences under which what is made from a file may be handed on, as SPDX writes them, and ``own`` recordings. Every
other text blocks a release: nobody can list all the ways of saying no."""


def blocks_release(licence: str) -> bool:
    """Whether a licence keeps what is made from a file from being released: all that are not known to allow it."""
    return FREE.fullmatch(licence.strip()) is None


def licences_of(index: pd.DataFrame) -> pd.DataFrame:
    """Recordings of an index with their licences: ``recording``, ``licence``, ``rows``, ``blocked``; empty for models.

    Parameters
    ----------
    index : DataFrame
        With columns ``recording`` and, for schema 2, ``licence``.
    """
    columns = ["recording", "licence", "rows", "blocked"]
    if index.empty or "recording" not in index:
        return pd.DataFrame(columns=columns)
    known = index.assign(licence=index.get("licence", ""))
    known = known[known["recording"].fillna("").astype(bool)]
    counts = known.fillna({"licence": ""}).groupby(["recording", "licence"]).size().rename("rows").reset_index()
    return counts.assign(blocked=[blocks_release(text) for text in counts["licence"]])[columns]


def blocked_recordings(index: pd.DataFrame) -> list[str]:
    """Each recording whose licence blocks a release, with that licence, for a message."""
    table = licences_of(index)
    blocked = table[table["blocked"]].to_dict("records")
    return [f"{row['recording']} ({row['licence'] or 'licence unknown'})" for row in blocked]


def citations(entries: Iterable[object]) -> list[str]:
    """What must be cited, each once, in the order of ``[[sources]]``."""
    return list(dict.fromkeys(text for entry in entries if (text := getattr(entry, "citation", ""))))
