"""Columns of a dataset's index, and requested filters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.core.errors import ConfigError
from doppelgait.dataset.config import suggest_names
from doppelgait.dataset.example import parse_unit
from doppelgait.viewer.settings import Pairs, parse_number

NOT_OFFERED = (
    "motion",
    "environment",
    "impairments",
    "warnings",
    "notes",
    "citation",
    "shard",
    "row",
    "shard_sha256",
    "recording_sha256",
    "others",
)
"""Columns that are not offered: long texts, and locations of arrays."""
MOST_VALUES = 40  # largest number of values of a category; all of them must fit into an address
NAMES = ("id", "scene_id", "group", "subject", "recording")
"""Columns of identifiers; they are no categories, even with few values."""
RESERVED = ("sort", "descending", "offset", "limit", "x", "y", "text", "flag", "no_flag")
"""Parameters of requests; columns of these names would be ambiguous and are not offered."""
UNKNOWN = "(none)"  # value of a category in rows where it is unknown
GROUPS = {
    "truth_": "truth",
    "feature_": "six features",
    "extended_": "extended features",
    "quality_": "quality",
    "sd_": "standard deviation",
}
"""Groups of columns by the prefix of their names."""

OWN_WORDS = {"label": ("class", ""), "snr_frame_db": ("SNR of the frame", "dB"), "rcs_total_m2": ("total RCS", "m²")}
"""Description and unit of columns with names that do not describe them."""


class Columns:
    """Index columns that can be shown, filtered and plotted."""

    def __init__(self, index: pd.DataFrame) -> None:
        self.index = index
        self._numbers: dict[str, npt.NDArray[np.float64]] = {}
        self._codes: dict[str, tuple[npt.NDArray[np.int64], list[str]]] = {}

    def __len__(self) -> int:
        return len(self.index)

    @cached_property
    def kinds(self) -> dict[str, str]:
        """Kind of every offered column: ``number``, ``category`` or ``text``."""
        kinds = {}
        reserved = (*NOT_OFFERED, *RESERVED)
        for name in self.index.columns:
            if not isinstance(name, str) or name in reserved or name.endswith((".min", ".max")):
                continue
            if pd.api.types.is_numeric_dtype(self.index[name]):
                if np.isfinite(self.numbers(name)).any():
                    kinds[name] = "number"
            elif name == "quality_flags" or not self.index[name].isna().all():
                kinds[name] = "category" if self._is_category(name) else "text"
        return kinds

    def _is_category(self, name: str) -> bool:
        """Return True if a text column is a category."""
        if name in ("label", "split"):
            return True
        if (
            name in (*NAMES, "quality_flags")
            or _convert_to_texts(self.index[name].iloc[: 10 * MOST_VALUES]).nunique() > MOST_VALUES
        ):
            return False
        return len(self.read_codes(name)[1]) <= MOST_VALUES

    def facts(self, name: str) -> dict[str, Any]:
        """Describe a column: name, words, unit, limits or values."""
        facts: dict[str, Any] = {"name": name, **describe_column(name), "kind": self.kinds[name]}
        if facts["kind"] == "number":
            values = self.numbers(name)
            known = values[np.isfinite(values)]
            facts |= {"low": float(known.min()), "high": float(known.max())}
        elif facts["kind"] == "category":
            facts["values"] = self.values(name)
        return facts

    def numbers(self, name: str) -> npt.NDArray[np.float64]:
        """Return a number column's values, NaN if unknown."""
        if name not in self._numbers:
            self._numbers[name] = self.index[name].to_numpy(dtype=np.float64, na_value=np.nan)
        return self._numbers[name]

    def read_codes(self, name: str) -> tuple[npt.NDArray[np.int64], list[str]]:
        """Return every row's text code, and the distinct texts."""
        if name not in self._codes:
            codes, values = pd.factorize(_convert_to_texts(self.index[name]), sort=True)
            self._codes[name] = codes.astype(np.int64), [str(value) for value in values]
        return self._codes[name]

    def values(self, name: str) -> list[str]:
        """Return a column's distinct texts as shown."""
        return [value or UNKNOWN for value in self.read_codes(name)[1]]

    def check_kind(self, name: str, *kinds: str, key: str) -> str:
        """Return ``name`` if its column has one of these kinds."""
        if self.kinds.get(name) not in kinds:
            known = (column for column, kind in self.kinds.items() if kind in kinds)
            raise ConfigError(f"{key}: {name!r} is no {' or '.join(kinds)} column here{suggest_names(name, known)}")
        return name

    def flag_counts(self) -> dict[str, int]:
        """Count the rows with each flag, the most frequent first."""
        codes, texts = self._flag_texts
        counts: dict[str, int] = {}
        for text, count in zip(texts, np.bincount(codes, minlength=len(texts)).tolist(), strict=True):
            for flag in filter(None, text.split(";")):
                counts[flag] = counts.get(flag, 0) + count
        return dict(sorted(counts.items(), key=lambda entry: (-entry[1], entry[0])))

    def select_flagged(self, pattern: str) -> npt.NDArray[np.bool_]:
        """Select rows with a flag that matches a pattern."""
        codes, texts = self._flag_texts
        fits = [any(fnmatchcase(flag, pattern) for flag in filter(None, text.split(";"))) for text in texts]
        return np.asarray(np.array(fits, dtype=bool)[codes])

    @property
    def _flag_texts(self) -> tuple[npt.NDArray[np.int64], list[str]]:
        if "quality_flags" in self.index:
            return self.read_codes("quality_flags")
        return np.zeros(len(self), dtype=np.int64), [""]

    def order(self, name: str) -> npt.NDArray[np.float64]:
        """Return the sort key of every row; shape (rows,)."""
        if self.kinds[name] == "number":
            return self.numbers(name)
        codes, values = self.read_codes(name)
        places = codes.astype(np.float64)
        if values and not values[0]:
            places[codes == 0] = np.nan
        return places


def _convert_to_texts(column: pd.Series[Any]) -> pd.Series[str]:
    """Convert values to texts, empty if unknown."""
    if isinstance(column.dtype, pd.StringDtype):
        return column.fillna("")
    return column.astype(object).where(column.notna(), "").map(str)


def describe_column(name: str) -> dict[str, str]:
    """Return description, unit and group of a column by name."""
    from doppelgait.viz.style import describe_quantity

    if name in OWN_WORDS:
        words, unit = OWN_WORDS[name]
        return {"words": words, "unit": unit, "group": "example"}
    beginning = next((prefix for prefix in GROUPS if name.startswith(prefix)), "")
    bare = name.removeprefix(beginning)
    words, unit = describe_quantity(bare)
    known = unit if parse_unit(bare) != "1" else ""
    return {"words": words, "unit": known, "group": GROUPS.get(beginning, "example")}


LIMITS = (".min", ".max")


@dataclass
class Filters:
    """Conditions that a row must meet, combined by AND."""

    values: dict[str, list[str]] = field(default_factory=dict)
    limits: dict[str, dict[str, float]] = field(default_factory=dict)
    flags: list[str] = field(default_factory=list)
    no_flags: list[str] = field(default_factory=list)
    text: str = ""

    def rows(self, columns: Columns) -> npt.NDArray[np.int64]:
        """Return the matching rows' numbers in index order."""
        kept = np.ones(len(columns), dtype=bool)
        for name, wanted in self.values.items():
            kept &= np.isin(columns.values(name), wanted)[columns.read_codes(name)[0]]
        for name, limits in self.limits.items():
            values = columns.numbers(name)
            kept &= (values >= limits.get(".min", -math.inf)) & (values <= limits.get(".max", math.inf))
        for pattern in self.flags:
            kept &= columns.select_flagged(pattern)
        for pattern in self.no_flags:
            kept &= ~columns.select_flagged(pattern)
        if self.text:
            found = columns.index["id"].astype("str").str.contains(self.text, case=False, regex=False)
            kept &= found.to_numpy(dtype=bool)
        return np.flatnonzero(kept)


def parse_query(query: Pairs, columns: Columns, further: Sequence[str] = ()) -> tuple[Filters, dict[str, str]]:
    """Parse filters and further parameters of a request."""
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
            name, side = columns.check_kind(key[:-4], "number", key=key), key[-4:]
            limits = filters.limits.setdefault(name, {})
            if side in limits:
                raise ConfigError(f"{key}: comes twice; give it once")
            limits[side] = parse_number(key, value)
            if limits.get(".min", -math.inf) > limits.get(".max", math.inf):
                raise ConfigError(
                    f"{name}.min: {limits['.min']:g} is above {name}.max, {limits['.max']:g}; no row can match"
                )
        elif columns.kinds.get(key) != "category":
            categories = (name for name, kind in columns.kinds.items() if kind == "category")
            hint = suggest_names(key, [*further, "text", "flag", "no_flag", *categories])
            raise ConfigError(f"{key!r} is not known here{hint}; numbers are limited with COLUMN.min and COLUMN.max")
        else:
            known_values = columns.values(key)
            if value not in known_values:
                raise ConfigError(f"{key}: no row has {value!r}{suggest_names(value, known_values)}")
            filters.values.setdefault(key, []).append(value)
    return filters, parameters
