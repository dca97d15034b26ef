"""Content that a verification checks, and its findings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from doppelgait.core.config import validate
from doppelgait.core.errors import DatasetError, DoppelgaitError
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.finish import DATA_VERSION, SCHEMA_VERSION
from doppelgait.dataset.open import Dataset
from doppelgait.dataset.plan import Plan, plan_dataset
from doppelgait.dataset.resolve import ExampleSpec
from doppelgait.dataset.shard_files import ShardFiles
from doppelgait.dataset.status import read_description

Status = Literal["passed", "warning", "failed", "skipped", "not applicable"]


@dataclass(frozen=True)
class Check:
    """Check with its status and summary.

    Parameters
    ----------
    status : {"passed", "warning", "failed", "skipped", "not applicable"}
        ``warning``: the dataset stays valid, but a person should look at it. ``skipped``: the check
        was not possible for the reason in the summary; the dataset is not proven. ``not
        applicable``: nothing to check in this dataset, or not requested.
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
    """Findings of a verification.

    Parameters
    ----------
    complete : bool
        Whether the dataset is marked as complete.
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
        """True if no check failed or was skipped."""
        return not any(check.status in ("failed", "skipped") for check in self.checks)

    @property
    def verdict(self) -> Literal["passed", "failed", "not proven"]:
        """``not proven`` if no check failed but some were skipped."""
        if any(check.status == "failed" for check in self.checks):
            return "failed"
        return "passed" if self.passed else "not proven"

    def check(self, name: str) -> Check:
        """Return the check of a name."""
        return next(check for check in self.checks if check.name == name)

    def as_dict(self) -> dict[str, Any]:
        """Return the verification for JSON."""
        figures = [str(path) for path in self.figures]
        outcome = {"figures": figures, "passed": self.passed, "verdict": self.verdict}
        return {**asdict(self), "directory": str(self.directory), **outcome}


MAX_EXAMPLES = 2000
"""Largest number of examples that are resolved again."""


@dataclass(frozen=True)
class Contents:
    """Files, index and plan of a dataset."""

    directory: Path
    description: Mapping[str, Any]
    index: pd.DataFrame
    failed: Mapping[str, str]
    plan: Plan | None
    no_plan: str

    @cached_property
    def dataset(self) -> Dataset:
        """The dataset opened, with the rows that are here."""
        files = ShardFiles(self.directory / "shards", self.description["id"])
        return Dataset(self.directory, dict(self.description), self.index, files)

    @property
    def no_plan_status(self) -> Status:
        """Status of a check that lacks the plan."""
        return "not applicable" if self.measured else "skipped"

    @property
    def measured(self) -> bool:
        """True if it was imported from recordings of a radar."""
        return self.description.get("origin") == "imported"

    @property
    def unlike(self) -> str:
        """Reason why this version cannot reproduce the bytes, or an empty text."""
        version = self.description.get("data_version")
        if version == DATA_VERSION:
            return ""
        return f"made with data version {version}, this doppelgait makes {DATA_VERSION}"

    def resolve_sample(self, rng: np.random.Generator, *, most: int = MAX_EXAMPLES) -> list[ExampleSpec]:
        """Resolve random examples again, as many of every class."""
        if self.plan is None:
            return []
        present = set(self.index["scene_id"])
        chosen: list[int] = []
        entries = [entry for entry in self.plan.examples if entry.id in present]
        numbers = {entry.class_number for entry in entries}
        for number in sorted(numbers):
            members = [entry.number for entry in entries if entry.class_number == number]
            count = min(most // len(numbers), len(members))
            chosen += sorted(int(n) for n in rng.choice(members, count, replace=False))
        return [self.plan.example(number) for number in chosen]


def read_known_description(directory: Path) -> dict[str, Any]:
    """Read ``dataset.json`` if this version can read the dataset."""
    description = read_description(directory)
    version = description.get("schema_version")
    if version != SCHEMA_VERSION:
        raise DatasetError(
            f"{directory}: has schema version {version}, verify needs {SCHEMA_VERSION}; "
            "use the doppelgait that made it, or build it again"
        )
    missing = [key for key in ("id", "shards", "classes", "fields", "config") if key not in description]
    if missing:
        raise DatasetError(f"{directory / 'dataset.json'}: is damaged: {', '.join(missing)} missing")
    return description


def read_plan(description: Mapping[str, Any], folder: Path) -> tuple[Plan | None, str]:
    """Return a dataset's plan, or why it has none."""
    if description.get("origin") == "imported":
        return None, "imported recordings have no plan"
    try:
        return plan_dataset(validate(PlanConfig, description["config"], where="dataset.json"), folder=folder), ""
    except DoppelgaitError as error:
        return None, f"no plan: {error}; if the plan's files are elsewhere, state their folder with --motion-folder"


def convert_to_plain(values: pd.Series | None) -> list[Any]:
    """Convert a column to plain Python values, None for unknown."""
    if values is None:
        return []
    return [None if value is None or value != value else value for value in values.tolist()]
