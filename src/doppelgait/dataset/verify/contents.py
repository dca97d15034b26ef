"""Content that a verification checks, and its findings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd

from doppelgait.core.config import validate
from doppelgait.core.errors import DatasetError, DoppelgaitError
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.finish import SCHEMA_VERSION, list_shard_names, read_description
from doppelgait.dataset.open import Dataset
from doppelgait.dataset.plan import Plan, PlannedExample, plan_dataset
from doppelgait.dataset.resolve import ExampleSpec
from doppelgait.dataset.shard_files import ShardFiles

Status = Literal["passed", "warning", "failed", "skipped", "not applicable"]


class Finding(NamedTuple):
    """Result of a check, which the table of checks names."""

    status: Status
    summary: str
    numbers: dict[str, Any] = {}  # noqa: RUF012


def judge(fault: str, summary: str, numbers: dict[str, Any] | None = None) -> Finding:
    """Return a failure for a fault, or else ``summary`` as passed."""
    return Finding("failed" if fault else "passed", fault or summary, numbers or {})


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
        return self.verdict == "passed"

    @property
    def verdict(self) -> Literal["passed", "failed", "not proven"]:
        """``not proven`` if no check failed but some were skipped."""
        found = {check.status for check in self.checks}
        return "failed" if "failed" in found else "not proven" if "skipped" in found else "passed"

    def check(self, name: str) -> Check:
        """Return the check of a name."""
        return next(check for check in self.checks if check.name == name)

    def as_dict(self) -> dict[str, Any]:
        """Return the verification for JSON."""
        figures = [str(path) for path in self.figures]
        outcome = {"figures": figures, "passed": self.passed, "verdict": self.verdict}
        return {**asdict(self), "directory": str(self.directory), **outcome}


MAX_EXAMPLES = 2000  # largest number of examples that are resolved again
MIN_PER_CLASS = 3  # smallest number of examples of a class that are made again


@dataclass(frozen=True)
class Contents:
    """Files, index and plan of a dataset."""

    directory: Path
    description: Mapping[str, Any]
    index: pd.DataFrame
    failed: Mapping[str, str]
    plan: Plan | None
    no_plan: str
    missing_shards: int = 0
    share: float = 0.0  # of the examples to make again
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    tick: Callable[[], None] = lambda: None

    @cached_property
    def dataset(self) -> Dataset:
        """The dataset opened, with the rows that are here."""
        files = ShardFiles(self.directory / "shards", self.description["id"])
        return Dataset(self.directory, dict(self.description), self.index, files)

    def require_plan(self) -> Plan:
        """Return the plan, which the table of checks asks for first."""
        if self.plan is None:
            raise DatasetError(self.no_plan)
        return self.plan

    @property
    def no_plan_status(self) -> Status:
        """Status of a check that lacks the plan."""
        return "not applicable" if self.measured else "skipped"

    @property
    def measured(self) -> bool:
        """True if it was imported from recordings of a radar."""
        return self.description.get("origin") == "imported"

    @cached_property
    def random(self) -> dict[str, np.random.Generator]:
        """Independent random numbers by their use."""
        return dict(zip(("sample", "draws", "pairs", "guess"), self.rng.spawn(4), strict=True))

    @cached_property
    def chosen(self) -> list[PlannedExample]:
        """Examples to make again: a share, at least three per class."""
        if not self.share > 0:
            return []
        return self._sample(self.random["sample"], lambda n: max(MIN_PER_CLASS, math.ceil(self.share * n)))

    @cached_property
    def examples(self) -> list[ExampleSpec]:
        """Random examples, resolved again."""
        return self.resolve_sample(self.random["draws"])

    def resolve_sample(self, rng: np.random.Generator, *, most: int = MAX_EXAMPLES) -> list[ExampleSpec]:
        """Resolve random examples again, as many of every class."""
        if self.plan is None:
            return []
        n_classes = len({entry.class_number for entry in self._present})
        sampled = self._sample(rng, lambda _: most // n_classes)
        return [self.plan.example(entry.number) for entry in sampled]

    def _sample(self, rng: np.random.Generator, count: Callable[[int], int]) -> list[PlannedExample]:
        """Sample examples that are here, by class ``count(members)`` of them."""
        chosen: list[PlannedExample] = []
        for number in sorted({entry.class_number for entry in self._present}):
            members = [entry for entry in self._present if entry.class_number == number]
            size = min(count(len(members)), len(members))
            chosen += [members[n] for n in sorted(rng.choice(len(members), size, replace=False))]
        return chosen

    @cached_property
    def _present(self) -> list[PlannedExample]:
        ids = set(self.index["scene_id"])
        return [] if self.plan is None else [entry for entry in self.plan.examples if entry.id in ids]


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
        config = validate(PlanConfig, description["config"], where="dataset.json")
        planned = sum(map(config.count_class_examples, config.sections))
        if planned > (most := len(list_shard_names(description["shards"])) * config.dataset.shard_size):
            raise DatasetError(f"the plan has {planned:,} examples, the shards hold {most:,}")
        return plan_dataset(config, folder=folder), ""
    except DoppelgaitError as error:
        return None, f"no plan: {error}; if the plan's files are elsewhere, state their folder with --motion-folder"
