"""Which split recordings go into: subjects and recordings stay whole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.dataset.config import DatasetSection
from doppelgait.dataset.importing.config import ImportConfig
from doppelgait.dataset.importing.labels import LabelEntry
from doppelgait.dataset.splits import assign_splits, groups_of


class PlannedEntry(NamedTuple):
    """An entry with its place in the dataset.

    Parameters
    ----------
    id : str
        Class and number within it, by the order of the labels.
    split : str
    subject, group : str
        A subject without a name is its recording; subjects of one recording share a group.
    entry : LabelEntry
    """

    id: str
    split: str
    subject: str
    group: str
    entry: LabelEntry


def plan_entries(entries: Sequence[LabelEntry], config: ImportConfig, labels: str) -> list[PlannedEntry]:
    """Ids and splits of all entries, in their order.

    Parameters
    ----------
    entries : sequence of LabelEntry
    config : ImportConfig
    labels : str
        Name of the file of labels, for messages.

    Raises
    ------
    ConfigError
        If the column ``split`` tears a subject or a recording apart, or is there though the configuration has a split.
    DatasetError
        If a class has too few subjects for the shares asked for.
    """
    subjects = [f"person/{entry.subject}" if entry.subject else f"file/{entry.recording}" for entry in entries]
    together: dict[str, list[str]] = {}
    for entry, subject in zip(entries, subjects, strict=True):
        together.setdefault(entry.recording, []).append(subject)
    group_of = groups_of(together.values())
    groups = [group_of[subject] for subject in subjects]
    splits = _splits(entries, groups, config, labels)
    counts: dict[str, int] = {}
    planned = []
    for entry, subject, group, split in zip(entries, subjects, groups, splits, strict=True):
        number = counts.get(entry.label, 0)
        counts[entry.label] = number + 1
        name = f"{entry.label.replace(' ', '_')}-{number:06d}"
        planned.append(PlannedEntry(name, split, subject, group, entry))
    return planned


def _splits(entries: Sequence[LabelEntry], groups: Sequence[str], config: ImportConfig, labels: str) -> list[str]:
    wanted = config.split
    if any(entry.split for entry in entries):
        if wanted is not None:
            raise ConfigError(f"split = {wanted!r}: is not allowed, because {labels} has a column split; leave one out")
        _refuse_torn(entries, groups, labels)
        return [entry.split for entry in entries]
    if not isinstance(wanted, dict):
        return [wanted or "test"] * len(entries)
    of_group = _by_shares(entries, groups, {str(name): share for name, share in wanted.items()}, config.seed, labels)
    return [of_group[group] for group in groups]


def _refuse_torn(entries: Sequence[LabelEntry], groups: Sequence[str], labels: str) -> None:
    """A subject, a recording, and all who share one, are in one split."""
    first: dict[str, LabelEntry] = {}
    for entry, group in zip(entries, groups, strict=True):
        other = first.setdefault(group, entry)
        if entry.split != other.split:
            who = f"subject {entry.subject!r}" if entry.subject else f"recording {entry.recording!r}"
            raise ConfigError(
                f"{labels}: line {entry.line}, split: {entry.split!r} is not allowed: {who} is in {other.split} "
                f"already (line {other.line}, itself or by a shared recording); all of a subject must be in one split"
            )


def _by_shares(
    entries: Sequence[LabelEntry], groups: Sequence[str], shares: Mapping[str, float], seed: int, labels: str
) -> dict[str, str]:
    members: dict[str, dict[str, None]] = {}
    for entry, group in zip(entries, groups, strict=True):
        members.setdefault(entry.label, {})[group] = None
    section = DatasetSection(name="imported", examples_per_class=1, seed=seed, fractions=dict(shares))
    try:
        return assign_splits(section, {label: list(found) for label, found in members.items()})
    except DatasetError as error:
        raise DatasetError(
            f"{labels}: {str(error).partition(';')[0]}; record more subjects, change split, or say it line by line in "
            "a column split (recordings without a subject count as one each)"
        ) from None
