"""Plan of a dataset: examples with their splits, and shards.

Nothing is simulated; only motion folders and radar files are read.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from doppelgait.core.errors import ConfigError
from doppelgait.dataset.config import MAX_SHARDS, SPLITS, EpisodeSection, PlanConfig, Progress
from doppelgait.dataset.motions import (
    expand_folders,
    list_motion_files,
    list_motions,
    refuse_copies,
    refuse_two_spellings,
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
from doppelgait.dataset.splits import assign_splits, group_subjects


class PlannedExample(NamedTuple):
    """Planned example with its subjects and split, not yet sampled."""

    number: int
    class_number: int
    id: str
    split: str
    group: str
    subjects: tuple[str, ...]


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
            section = self.config.sections[entry.class_number]
            return find_class(self.config, entry.number)[1] / self.config.count_class_examples(
                section
            ), entry.class_number

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
    refuse_two_spellings(files, source)
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
    splits = assign_splits(expanded.dataset, {label: list(names) for label, names in members.items()})
    return Plan(expanded, source, tuple(draft._replace(split=splits[draft.group]) for draft in drafts))


def check_examples(plan: Plan, *, most: int | None = None, on_progress: Progress | None = None) -> int:
    """Resolve examples over the plan to find forbidden values early."""
    total = spread_count(plan, most)
    for done, _ in enumerate(sample_examples(plan, most), start=1):
        if on_progress is not None:
            on_progress(done, total)
    return total


def spread_count(plan: Plan, most: int | None = None) -> int:
    """Return how many examples :func:`sample_examples` yields."""
    total = len(plan.examples)
    return total if most is None else min(most, total)


def sample_examples(plan: Plan, most: int | None = None) -> Iterator[ExampleSpec]:
    """Yield up to ``most`` evenly spread resolved examples."""
    total, count = len(plan.examples), spread_count(plan, most)
    for place in range(count):
        yield plan.example(place * total // count)


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
