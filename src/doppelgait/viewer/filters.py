"""Filters of the dataset browser: from the parameters of a request to the rows that are meant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import ConfigError
from doppelgait.dataset.example import nearest
from doppelgait.viewer.columns import Columns
from doppelgait.viewer.query import Pairs, number_of

LIMITS = (".min", ".max")


@dataclass
class Filters:
    """Which rows are meant: all conditions at once.

    Parameters
    ----------
    values : dict
        Wanted values by category column, any of them.
    limits : dict
        Lower and upper limit by number column, both included; rows that do not know the number are left out.
    flags, no_flags : list of str
        Patterns: a row has a flag that fits each of the first, and none that fits one of the second.
    text : str
        Part of the id, in small or capital letters.
    """

    values: dict[str, list[str]] = field(default_factory=dict)
    limits: dict[str, dict[str, float]] = field(default_factory=dict)
    flags: list[str] = field(default_factory=list)
    no_flags: list[str] = field(default_factory=list)
    text: str = ""

    def rows(self, columns: Columns) -> npt.NDArray[np.int64]:
        """Numbers of the rows that are meant, in the order of the index."""
        kept = np.ones(len(columns), dtype=bool)
        for name, wanted in self.values.items():
            kept &= np.isin(columns.values(name), wanted)[columns.codes(name)[0]]
        for name, limits in self.limits.items():
            values = columns.numbers(name)
            kept &= (values >= limits.get(".min", -math.inf)) & (values <= limits.get(".max", math.inf))
        for pattern in self.flags:
            kept &= columns.flagged(pattern)
        for pattern in self.no_flags:
            kept &= ~columns.flagged(pattern)
        if self.text:
            found = columns.index["id"].astype("str").str.contains(self.text, case=False, regex=False)
            kept &= found.to_numpy(dtype=bool)
        return np.flatnonzero(kept)


def parse_query(query: Pairs, columns: Columns, further: Sequence[str] = ()) -> tuple[Filters, dict[str, str]]:
    """Filters and further parameters of a request.

    Parameters
    ----------
    query : sequence of (str, str)
        Parameters by name, as sent.
    columns : Columns
    further : sequence of str
        Names that are no filters; each may come once.

    Returns
    -------
    filters : Filters
    parameters : dict

    Raises
    ------
    ConfigError
        If a name is not known, comes again where it may not, or its value is not allowed.
    """
    filters, parameters = Filters(), {}
    for key, value in query:
        if key in further:
            if key in parameters:
                raise ConfigError(f"{key}: comes twice; give it once")
            parameters[key] = value
        elif key == "text":
            if filters.text:
                raise ConfigError("text: comes twice; give it once")
            filters.text = value
        elif key in ("flag", "no_flag"):
            (filters.flags if key == "flag" else filters.no_flags).append(value)
        elif key.endswith(LIMITS):
            _add_limit(filters, columns, key, value)
        else:
            _add_value(filters, columns, key, value, further)
    return filters, parameters


def _add_limit(filters: Filters, columns: Columns, key: str, value: str) -> None:
    name, side = columns.of_kind(key[:-4], "number", key=key), key[-4:]
    limits = filters.limits.setdefault(name, {})
    if side in limits:
        raise ConfigError(f"{key}: comes twice; give it once")
    limits[side] = number_of(key, value)
    if limits.get(".min", -math.inf) > limits.get(".max", math.inf):
        raise ConfigError(
            f"{name}.min: {limits['.min']:g} is above {name}.max, {limits['.max']:g}; no row can be meant"
        )


def _add_value(filters: Filters, columns: Columns, key: str, value: str, further: Sequence[str]) -> None:
    if columns.kinds.get(key) != "category":
        known = [*further, "text", "flag", "no_flag", *(n for n, kind in columns.kinds.items() if kind == "category")]
        raise ConfigError(
            f"{key!r} is not known here{nearest(key, known)}; numbers are limited with COLUMN.min and COLUMN.max"
        )
    known_values = columns.values(key)
    if value not in known_values:
        raise ConfigError(f"{key}: no row has {value!r}{nearest(value, known_values)}")
    filters.values.setdefault(key, []).append(value)
