"""Splits of a dataset.

Subjects, and all who share a scene or a recording with them, stay together.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, NamedTuple

from doppelgait.core.documents import parse_json
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.dataset.config import SPLITS, DatasetSection, ImportConfig, list_some
from doppelgait.dataset.labels import LabelEntry
from doppelgait.dataset.motions import BOTH, list_recording_paths

if TYPE_CHECKING:
    import pandas as pd

SHOWN_NAMES = 4


def group_subjects(scenes: Iterable[Sequence[str]]) -> dict[str, str]:
    """Return every subject's group, named after its first subject."""
    parent: dict[str, str] = {}

    def root(name: str) -> str:
        while parent[name] != name:
            parent[name] = parent[parent[name]]
            name = parent[name]
        return name

    for subjects in scenes:
        for subject in subjects:
            parent.setdefault(subject, subject)
        roots = sorted({root(subject) for subject in subjects})
        for other in roots[1:]:
            parent[other] = roots[0]
    return {name: root(name) for name in parent}


def parse_source(subject: str) -> str:
    """Return ``model`` or ``recording``, from a subject's name."""
    return "model" if subject.startswith("model/") else "recording"


def list_names(index: pd.DataFrame, column: str) -> list[tuple[str, ...]]:
    """List what every row of an index is made of."""
    further = {"subject": "others", "recording": "motion"}.get(column, "")
    names, texts = (
        index[name].fillna("").astype(str).tolist() if name in index else [""] * len(index)
        for name in (column, further)
    )
    found: list[tuple[str, ...]] = []
    for name, text in zip(names, texts, strict=True):
        every: tuple[str, ...] = (name,)
        try:
            if column == "subject" and text:
                every = (name, *map(str, parse_json(text)))
            elif column == "recording" and BOTH in name and text:
                every = list_recording_paths(parse_json(text)) or every
        except (ValueError, KeyError, TypeError, AttributeError):
            raise DatasetError(
                f"index: {further} {text!r} of {name!r} cannot be read; build the dataset again"
            ) from None
        found.append(tuple(filter(None, every)))
    return found


def assign_splits(dataset: DatasetSection, members: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """Assign a split to every group."""
    names = list(dict.fromkeys(name for groups in members.values() for name in groups))
    splits = {name: s for name in names if (s := dataset.split.sources.get(parse_source(name))) is not None}  # type: ignore[call-overload]
    named: dict[str, str] = {}
    for split, patterns in dataset.split.subjects.items():
        for pattern in patterns:
            found = [n for n in names if fnmatchcase(n.partition("/")[2], pattern) or fnmatchcase(n, pattern)]
            if not found:
                raise DatasetError(
                    f"dataset.split.subjects.{split}: {pattern!r} fits no subject; there are "
                    f"{list_some(names, SHOWN_NAMES)}"
                )
            torn = [name for name in found if named.get(name, split) != split]
            if torn:
                raise DatasetError(
                    f"dataset.split.subjects: in two splits {list_some(torn, SHOWN_NAMES)}: {named[torn[0]]} and "
                    f"{split}; a subject can be in one only"
                )
            named |= dict.fromkeys(found, split)
    splits |= named
    for groups in members.values():
        splits |= _split_by_share(dataset, [name for name in groups if name not in splits])
    asked = {split for split, fraction in dataset.fractions.items() if fraction}
    for label, groups in members.items():  # every class needs every requested split and every split of another class
        wanted = (asked | set(splits.values())) - {splits[name] for name in groups}
        if missing := [split for split in SPLITS if split in wanted]:
            raise DatasetError(
                f"class {label!r} has {len(groups)} subjects, too few or of the wrong source: none is in "
                f"{', '.join(missing)}; plan more examples, name more recordings, or change dataset.fractions or "
                "dataset.split"
            )
    return splits


def _split_by_share(dataset: DatasetSection, names: Sequence[str]) -> dict[str, str]:
    share_of = {
        name: int.from_bytes(hashlib.sha256(f"{dataset.seed}/{name}".encode()).digest()[:8], "big") / 2**64
        for name in names
    }
    splits: dict[str, str] = {}
    if dataset.split.strategy == "stable":
        wanted = [split for split in SPLITS if dataset.fractions.get(split)]
        for name in names:
            limit = 0.0
            for split in wanted:
                limit += dataset.fractions[split]
                if share_of[name] < limit or split == wanted[-1]:
                    splits[name] = split
                    break
        return splits
    ranked = sorted(names, key=share_of.__getitem__)
    done, share = 0, 0.0
    for split in SPLITS:
        share += dataset.fractions.get(split, 0.0)
        end = round(share * len(ranked))
        splits.update(dict.fromkeys(ranked[done:end], split))
        done = end
    return splits


class PlannedEntry(NamedTuple):
    """Entry with its place in the dataset."""

    id: str
    split: str
    subject: str
    group: str
    entry: LabelEntry


def plan_entries(entries: Sequence[LabelEntry], config: ImportConfig, labels: str) -> list[PlannedEntry]:
    """Plan ids and splits of all entries, in their order."""
    subjects = [f"person/{entry.subject}" if entry.subject else f"file/{entry.recording}" for entry in entries]
    together: dict[str, list[str]] = {}
    for entry, subject in zip(entries, subjects, strict=True):
        together.setdefault(entry.recording, []).append(subject)
    group_of = group_subjects(together.values())
    groups = [group_of[subject] for subject in subjects]
    wanted = config.split
    if any(entry.split for entry in entries):
        if wanted is not None:
            raise ConfigError(f"split = {wanted!r}: is not allowed, because {labels} has a column split; leave one out")
        first: dict[str, LabelEntry] = {}
        for entry, group in zip(entries, groups, strict=True):
            other = first.setdefault(group, entry)
            if entry.split != other.split:
                who = f"subject {entry.subject!r}" if entry.subject else f"recording {entry.recording!r}"
                raise ConfigError(
                    f"{labels}: line {entry.line}, split: {entry.split!r} is not allowed: {who} is in {other.split} "
                    f"already (line {other.line}, itself or by a shared recording); all of a subject must be in one "
                    "split"
                )
        splits = [entry.split for entry in entries]
    elif not isinstance(wanted, dict):
        splits = [wanted or "test"] * len(entries)
    else:
        members: dict[str, dict[str, None]] = {}
        for entry, group in zip(entries, groups, strict=True):
            members.setdefault(entry.label, {})[group] = None
        shares = {str(name): share for name, share in wanted.items()}
        section = DatasetSection(name="imported", examples_per_class=1, seed=config.seed, fractions=shares)
        try:
            of_group = assign_splits(section, {label: list(found) for label, found in members.items()})
        except DatasetError as error:
            raise DatasetError(
                f"{labels}: {str(error).partition(';')[0]}; record more subjects, change split, or say it line by line "
                "in a column split (recordings without a subject count as one each)"
            ) from None
        splits = [of_group[group] for group in groups]
    counts: dict[str, int] = {}
    planned = []
    for entry, subject, group, split in zip(entries, subjects, groups, splits, strict=True):
        number = counts.get(entry.label, 0)
        counts[entry.label] = number + 1
        name = f"{entry.label.replace(' ', '_')}-{number:06d}"
        planned.append(PlannedEntry(name, split, subject, group, entry))
    return planned
