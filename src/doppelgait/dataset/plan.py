"""Plan of a dataset: examples or recordings with their splits, and shards.

Subjects, and all who share a scene or a recording with them, stay together.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from doppelgait.core.documents import parse_json
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.dataset.config import (
    MAX_SHARDS,
    SPLITS,
    DatasetSection,
    EpisodeSection,
    ImportConfig,
    PlanConfig,
    Progress,
    list_some,
)
from doppelgait.dataset.labels import LabelEntry
from doppelgait.dataset.motions import (
    BOTH,
    expand_folders,
    list_motion_files,
    list_motions,
    list_recording_paths,
    refuse_copies,
)
from doppelgait.dataset.resolve import (
    Compiled,
    ExampleSpec,
    find_class,
    make_example_id,
    make_sampler,
    resolve_example,
    resolve_rows,
    store_radar_files,
)

if TYPE_CHECKING:
    import pandas as pd

SHOWN_NAMES = 4


def group_subjects(scenes: Iterable[Sequence[str]]) -> dict[str, str]:
    """Return every subject's group, named after its first subject."""
    from scipy.cluster.hierarchy import DisjointSet

    groups = DisjointSet()
    for subjects in scenes:
        for name in subjects:
            groups.add(name)
            groups.merge(subjects[0], name)
    return {name: members[0] for members in map(sorted, groups.subsets()) for name in members}


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


def assign_splits(dataset: DatasetSection, members: Mapping[str, Collection[str]]) -> dict[str, str]:
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
                    f"dataset.split.subjects: in two splits {list_some(torn, SHOWN_NAMES)}: "
                    f"{named[torn[0]]} and {split}; a subject can be in one only"
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
                f"class {label!r} has {len(groups)} subjects, too few or of the wrong source: none "
                f"is in {', '.join(missing)}; plan more examples, name more recordings, or change "
                "dataset.fractions or dataset.split"
            )
    return splits


def _split_by_share(dataset: DatasetSection, names: Sequence[str]) -> dict[str, str]:
    share_of = {
        name: int.from_bytes(hashlib.sha256(f"{dataset.seed}/{name}".encode()).digest()[:8], "big") / 2**64
        for name in names
    }
    ranked = sorted(names, key=share_of.__getitem__)
    wanted = [split for split in SPLITS if dataset.fractions.get(split)]
    splits: dict[str, str] = {}
    done, share = 0, 0.0
    for split in wanted:
        share += dataset.fractions[split]
        end = round(share * len(ranked))
        if dataset.split.strategy == "stable":
            end = len(ranked) if split == wanted[-1] else sum(share_of[name] < share for name in ranked)
        splits |= dict.fromkeys(ranked[done:end], split)
        done = end
    return splits


class PlannedExample(NamedTuple):
    """Planned example with its subjects and split, not yet sampled."""

    number: int
    class_number: int
    id: str
    split: str
    group: str
    subjects: tuple[str, ...]
    entry: Any = None  # LabelEntry of a recording


def plan_entries(entries: Sequence[LabelEntry], config: ImportConfig, labels: str) -> list[PlannedExample]:
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
                    f"already (line {other.line}, itself or by a shared recording); all of a "
                    "subject must be in one split"
                )
        splits = [entry.split for entry in entries]
    elif not isinstance(wanted, dict):
        splits = [wanted or "test"] * len(entries)
    else:
        members: dict[str, dict[str, None]] = {}
        for entry, group in zip(entries, groups, strict=True):
            members.setdefault(entry.label, {})[group] = None
        section = DatasetSection(name="imported", examples_per_class=1, seed=config.seed, fractions=wanted)
        try:
            of_group = assign_splits(section, members)
        except DatasetError as error:
            raise DatasetError(
                f"{labels}: {str(error).partition(';')[0]}; record more subjects, change split, or say it line by line "
                "in a column split (recordings without a subject count as one each)"
            ) from None
        splits = [of_group[group] for group in groups]
    numbers: dict[str, Iterator[int]] = {}
    planned: list[PlannedExample] = []
    for entry, subject, group, split in zip(entries, subjects, groups, splits, strict=True):
        within = next(numbers.setdefault(entry.label, count()))
        place, name = list(numbers).index(entry.label), make_example_id(entry.label, within)
        planned.append(PlannedExample(len(planned), place, name, split, group, (subject,), entry))
    return planned


@dataclass(frozen=True)
class Shard:
    """Planned examples or labelled recordings of one shard file."""

    name: str
    split: str
    examples: tuple[Any, ...]


def split_into_shards(entries: Sequence[Any], size: int) -> Iterator[Shard]:
    """Yield shards of up to ``size`` examples per split, in order."""
    for split in SPLITS:
        chosen = [entry for entry in entries if entry.split == split]
        count = -(-len(chosen) // size)
        if count > MAX_SHARDS:
            raise ConfigError(
                f"shard_size = {size}: gives {count} shards, allowed are {MAX_SHARDS}; set a larger shard_size"
            )
        for number in range(count):
            part = chosen[number * size : (number + 1) * size]
            yield Shard(f"{split}-{number:05d}-of-{count:05d}", split, tuple(part))


@dataclass(frozen=True)
class Plan:
    """Plan with its examples."""

    config: PlanConfig
    folder: Path
    examples: tuple[PlannedExample, ...]

    def example(self, number: int) -> ExampleSpec:
        """Resolve an example: every distribution is sampled."""
        entry = self.examples[number]
        return resolve_example(self.config, number, self.folder, split=entry.split, group=entry.group)

    def shards(self) -> Iterator[Shard]:
        """Yield shards of one split each, with interleaved classes."""

        def place(entry: PlannedExample) -> tuple[float, int]:
            count = self.config.count_class_examples(self.config.sections[entry.class_number])
            return find_class(self.config, entry.number)[1] / count, entry.class_number

        return split_into_shards(sorted(self.examples, key=place), self.config.dataset.shard_size)


def plan_dataset(config: PlanConfig, *, folder: Path | None = None, on_progress: Progress | None = None) -> Plan:
    """Plan a dataset: subjects, groups and split of every example.

    Parameters
    ----------
    folder : Path, optional
        Folder that relative paths start from; the working folder by default.
    on_progress : callable, optional
        Called with (motion files read, files in total) where the plan names folders.

    Raises
    ------
    ConfigError
        If a motion is not allowed or its file is missing; the message names the class, the example
        and the key. If a radar file cannot be read.
    DatasetError
        If a class cannot have a subject in every requested split, or a folder has no usable file.

    See Also
    --------
    build_dataset : build the dataset.

    Examples
    --------
    >>> import doppelgait as dg
    >>> plan, folder = dg.dataset.load_plan("home-alarm", overrides=["dataset.examples_per_class=8"])
    >>> len(dg.dataset.plan_dataset(plan).examples)
    16
    """
    source = folder or Path()
    expanded = expand_folders(store_radar_files(config, source), source, on_progress=on_progress)
    files = list_motion_files(list_motions(expanded))
    refuse_copies(files, source, expanded.sources)
    drafts: list[PlannedExample] = []
    compiled: Compiled = {}
    for place, section in enumerate(expanded.sections):
        motions = section.targets if isinstance(section, EpisodeSection) else section.motion
        from_files = bool(expanded.companions) or bool(list_motion_files([motions]))
        for within in range(expanded.count_class_examples(section)):
            number, name = len(drafts), make_example_id(section.label, within)
            subjects = [f"model/{name}"]
            if from_files:  # the subject of a model needs no sampling
                try:
                    rows, _ = resolve_rows(expanded, number, source, make_sampler(expanded, number, compiled))
                except ConfigError as error:
                    raise ConfigError(f"class {section.label!r}: example {name}: {error}") from None
                subjects = [row.subject for row in rows] or subjects
                subjects += [other for row in rows for other in row.others]
            drafts.append(PlannedExample(number, place, name, "", "", tuple(subjects)))
    groups = group_subjects(draft.subjects for draft in drafts)
    drafts = [draft._replace(group=groups[draft.subjects[0]]) for draft in drafts]
    members: dict[str, dict[str, None]] = {section.label: {} for section in expanded.sections}
    for draft in drafts:
        members[expanded.sections[draft.class_number].label][draft.group] = None
    splits = assign_splits(expanded.dataset, members)
    return Plan(expanded, source, tuple(draft._replace(split=splits[draft.group]) for draft in drafts))


def sample_examples(
    plan: Plan, most: int | None = None, *, on_progress: Progress | None = None
) -> Iterator[ExampleSpec]:
    """Yield up to ``most`` evenly spread resolved examples."""
    total = len(plan.examples)
    count = total if most is None else min(most, total)
    for place in range(count):
        yield plan.example(place * total // count)
        if on_progress is not None:
            on_progress(place + 1, count)


def collect_nuisance(example: ExampleSpec, row: int = 0) -> dict[str, Any]:
    """Return all sampled values of a row except its motion, flat."""
    run = example.run.model_dump(mode="json", exclude={"seed", "example"})
    targets = run["scene"].pop("targets")
    # the targets and the length of an episode are what it is about
    stated = [target for target in targets if not target["background"]][row]
    own = {} if example.is_episode else {name: stated[name] for name in stated if name not in ("motion", "label")}
    background = [target for target in targets if target["background"] and not example.is_episode]
    if example.is_episode:
        del run["scene"]["duration_s"]
    flat: dict[str, Any] = {"gate_error_m": example.gate_error_m}

    def walk(value: Any, key: str) -> None:
        if isinstance(value, dict):
            for name, inner in value.items():
                walk(inner, f"{key}.{name}")
        elif isinstance(value, list):
            for number, inner in enumerate(value):
                walk(inner, f"{key}.{number}")
        elif value is not None:
            flat[key] = value

    for key, value in {"target": own, "background": background, **run}.items():
        walk(value, key)
    return flat
