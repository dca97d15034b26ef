"""What must be true of a dataset's description and index before anything is made of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from doppelgait.dataset.config import SPLITS

TEXT_COLUMNS = ("id", "label", "split", "shard")


def check_description(description: Any) -> None:
    """Check what ``dataset.json`` holds.

    Raises
    ------
    ValueError
        Naming the key that is missing or of another kind than it must be.
    """
    if not isinstance(description, Mapping):
        raise ValueError("dataset.json: must be a table")
    for key, kind, words in (
        ("name", str, "a text"), ("id", str, "a text"), ("schema_version", int, "a whole number"),
        ("classes", Mapping, "a table of class numbers"), ("fields", Mapping, "a table of arrays"),
    ):  # fmt: skip
        if not isinstance(description.get(key), kind) or isinstance(description[key], bool):
            raise ValueError(f"dataset.json: {key} must be {words}")
    if description.get("origin", "simulated") == "simulated":
        _check_plan(description.get("config") or {})
    for label, number in description["classes"].items():
        if not isinstance(number, int) or isinstance(number, bool):
            raise ValueError(f"dataset.json: classes.{label} must be a whole number")
    for name, facts in description["fields"].items():
        _check_field(name, facts)


def _check_plan(config: Any) -> None:
    """What finds an example in its plan; the rest of it counts only when one is simulated again."""
    if not isinstance(config, Mapping):
        raise ValueError("dataset.json: config must be a table")
    sections = config.get("classes", [])
    if not isinstance(sections, list) or not all(isinstance(one, Mapping) and "label" in one for one in sections):
        raise ValueError("dataset.json: config.classes must be a list of tables with label")
    numbers = config.get("dataset", {} if not sections else None)
    if not isinstance(numbers, Mapping):
        raise ValueError("dataset.json: config.dataset must be a table")
    counts = [one.get("examples") for one in sections] + [numbers.get(key) for key in ("examples_per_class", "seed")]
    if not all(count is None or (isinstance(count, int) and count >= 0) for count in counts):
        raise ValueError("dataset.json: seed and numbers of examples in config must be whole numbers")


def _check_field(name: str, facts: Any) -> None:
    if not isinstance(facts, Mapping):
        raise ValueError(f"dataset.json: fields.{name} must be a table with dims, units and dtype")
    dims = facts.get("dims")
    if not isinstance(dims, list) or not all(isinstance(dim, str) for dim in dims):
        raise ValueError(f"dataset.json: fields.{name}.dims must be a list of texts")
    for key in ("units", "dtype"):
        if not isinstance(facts.get(key), str):
            raise ValueError(f"dataset.json: fields.{name}.{key} must be a text")


def check_index(index: pd.DataFrame, classes: Mapping[str, int]) -> None:
    """Check the columns of an index that tell which example is what, and where its arrays lie.

    Parameters
    ----------
    index : DataFrame
    classes : mapping
        Of ``dataset.json``.

    Raises
    ------
    ValueError
        Naming the column.
    """
    missing = [name for name in (*TEXT_COLUMNS, "row") if name not in index]
    if missing and len(index):
        raise ValueError(f"index.parquet: has no column {missing[0]!r}")
    if not index.columns.is_unique:
        raise ValueError("index.parquet: two columns have the same name")
    if not len(index):
        return
    for name in TEXT_COLUMNS:
        if index[name].isna().any() or pd.api.types.infer_dtype(index[name]) not in ("string", "categorical"):
            raise ValueError(f"index.parquet: column {name!r} must hold a text in every row")
    if not pd.api.types.is_integer_dtype(index["row"]) or index["row"].isna().any() or (index["row"] < 0).any():
        raise ValueError("index.parquet: column 'row' must hold a whole number from 0 in every row")
    for name, known in (("split", SPLITS), ("label", classes)):
        strange = sorted(set(index[name].unique()) - set(known))
        if strange:
            raise ValueError(f"index.parquet: {name} {strange[0]!r} is not one of {', '.join(known)}")
