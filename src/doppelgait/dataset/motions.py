"""Motions of a plan: checks, subjects, source files and folders."""

from __future__ import annotations

import hashlib
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.errors import (
    ConfigError,
    DatasetError,
    DoppelgaitError,
    DoppelgaitWarning,
    MotionError,
    warn_caller,
)
from doppelgait.core.files import list_files
from doppelgait.dataset.config import PlanConfig, Progress, SourceSection, shorten
from doppelgait.motion.motion import Motion

BOTH = " + "
"""Separator of the paths of a blended motion in the column ``recording``."""
EMPTY_SCENE = "none"
"""Motion kind of an example without a target."""
THING = "thing"  # label of tracks of no body: of confusers, echoes and noise
PHANTOM_SPEED_MPS = {"uniform": [0.4, 2.0]}
"""Default speed of the gate of an example without a target."""


def get_recording_path(motion: Mapping[str, Any]) -> str:
    """Return the path of a motion's recording as written, or ""."""
    return str(motion["path"]) if motion["kind"] == "file" else ""


def list_recording_paths(motion: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the paths of a resolved motion's recordings, as written."""
    other = (motion.get("hybrid") or {}).get("other") if motion["kind"] == "file" else None
    return tuple(filter(None, (get_recording_path(motion), get_recording_path(other) if other else "")))


def find_source_entry(recording: str, sources: Sequence[SourceSection]) -> SourceSection | None:
    """Return the first entry of ``[[sources]]`` that matches a recording."""
    return next((entry for entry in sources if fnmatchcase(recording, entry.files)), None)


def find_subject(motion: Mapping[str, Any], row_id: str, sources: Sequence[SourceSection] = ()) -> str:
    """Return the subject of a motion."""
    recording = get_recording_path(motion)
    if not recording:
        return f"model/{row_id}"
    entry = find_source_entry(recording, sources)
    if entry is None or entry.subject is None:
        return f"file/{recording}"
    match = re.search(entry.subject, recording)
    if match is None or not match[1]:
        raise ConfigError(
            f"sources.{list(sources).index(entry)}.subject: {entry.subject!r} finds no subject in {recording!r}"
        )
    return f"person/{match[1]}"


class EmptySceneOptions(FrozenModel):
    """Options of motion ``none``.

    speed_mps: Speed of the gate over ground.
    """

    speed_mps: float = Field(ge=0, le=10)


def check_motion(motion: Any, folder: Path, *, key: str) -> dict[str, Any]:
    """Check a resolved motion table without generating or reading anything."""
    from doppelgait.motion.models.registry import MOTION_MODELS, check_table

    if not isinstance(motion, Mapping) or not isinstance(motion.get("kind"), str):
        needs = 'needs kind = "NAME" (a motion model, or "file" with path = "...")'
        raise ConfigError(f"{key}: {shorten(motion)} is not allowed: {needs}")
    kind = motion["kind"]
    options = {name: value for name, value in motion.items() if name != "kind"}
    if kind == "folder":
        raise ConfigError(f"{key}.kind: a folder is allowed in [[classes]] only; name a file")
    if kind == "file":
        if "hybrid" in options:
            from doppelgait.motion.hybrid import Hybrid

            hybrid = validate(Hybrid, options.pop("hybrid"), section=(*key.split("."), "hybrid"))
            if hybrid.other is not None:
                check_motion(hybrid.other, folder, key=f"{key}.hybrid.other")
        path = options.pop("path", None)
        if not isinstance(path, str) or not path:
            raise ConfigError(f'{key}.path: {shorten(path)} is not allowed: kind "file" needs path = "..."')
        if not (folder / path).is_file():
            raise ConfigError(f"{key}.path: {path!r} is not allowed: there is no such file in {folder.resolve()}")
        from doppelgait.core.readers import list_options
        from doppelgait.motion.readers import MOTION_READERS, read

        # Allow the options of all readers, because the reader depends on the content of the file.
        functions = [read, *(reader.run for reader in MOTION_READERS.values())]
        allowed = list(dict.fromkeys(name for function in functions for name in list_options(function)))
        for name in sorted(set(options) - set(allowed)):
            raise ConfigError(
                f"{key}.{name}: {shorten(options[name])} is not allowed: unknown key; allowed are path, "
                f"hybrid, {', '.join(allowed)}"
            )
    elif kind == EMPTY_SCENE:
        validate(EmptySceneOptions, options, section=tuple(key.split(".")))
    elif kind not in MOTION_MODELS:
        known = ", ".join(["file", EMPTY_SCENE, *MOTION_MODELS])
        raise ConfigError(f"{key}.kind: {kind!r} is not allowed: known are {known}")
    else:
        try:
            return check_table(motion, section=tuple(key.split(".")))
        except ConfigError as error:
            raise ConfigError(f"{error} (motion is {shorten(motion)})") from None
    return dict(motion)


def list_motion_files(motions: Iterable[Any]) -> list[str]:
    """List the paths of motion files in tables, as written, sorted."""
    tables = (table for table in _iterate_tables(list(motions)) if "file" in _list_strings(table.get("kind")))
    return sorted({path for table in tables for path in _list_strings(table.get("path"))})


def _iterate_tables(value: Any) -> Iterator[Mapping[str, Any]]:
    if isinstance(value, Mapping):
        yield value
        value = list(value.values())
    for inner in value if isinstance(value, list) else ():
        yield from _iterate_tables(inner)


def _list_strings(value: Any) -> list[str]:
    if isinstance(value, str):
        return [value]
    if isinstance(value, Mapping):
        lists = [value.get(name) for name in ("choice", "cycle")]
        return [text for entries in lists if isinstance(entries, list) for e in entries for text in _list_strings(e)]
    return []


def refuse_two_spellings(paths: Iterable[str], folder: Path) -> None:
    """Raise a :class:`ConfigError` if two paths lead to one file."""
    # the file would be two subjects, perhaps in two splits
    seen: dict[Path, str] = {}
    for path in paths:
        first = seen.setdefault((folder / path).resolve(), path)
        if first != path:
            raise ConfigError(f"motion files {first!r} and {path!r} are the same file; write its path in one form")


def refuse_copies(paths: Iterable[str], folder: Path, sources: Sequence[SourceSection]) -> None:
    """Raise a :class:`ConfigError` if equal files would be different subjects."""
    by_size: dict[int, list[str]] = {}
    for path in paths:
        if (folder / path).is_file():
            by_size.setdefault((folder / path).stat().st_size, []).append(path)
    seen: dict[str, str] = {}
    for path in (path for group in by_size.values() if len(group) > 1 for path in group):
        first = seen.setdefault(hashlib.sha256((folder / path).read_bytes()).hexdigest(), path)
        if find_subject({"kind": "file", "path": first}, "", sources) != find_subject(
            {"kind": "file", "path": path}, "", sources
        ):
            raise ConfigError(
                f"motion files {first!r} and {path!r} have the same content; leave one out, or assign both to one "
                "subject in [[sources]]"
            )


SPARE_S = 0.1
"""Time, s, by which a looped motion exceeds the scene."""
SHOWN_REASONS = 3

HybridMode = Literal["none", "retarget", "blend"]


class FolderMotion(FrozenModel):
    """Folder of motion files as a class's motion.

    path: The folder, relative to the folder of the plan.
    pattern: Pattern of the file names, for example ``"*.bvh"``; subfolders are included.
    loop: Segments shorter than the scene are repeated over whole strides; else they are left out. A
        scene without ``duration_s`` is as long as its segment.
    min_duration_s: Shorter segments are left out.
    hybrid: Whether every example changes speed, size and stride of its segment, and also blends it
        with another one (:mod:`doppelgait.motion.hybrid`).
    options: Options of the reader, such as ``units``.
    """

    path: str = Field(min_length=1)
    pattern: str = "*"
    loop: bool = True
    min_duration_s: float = Field(default=0.0, ge=0)
    hybrid: HybridMode = "none"
    options: dict[str, Any] = Field(default_factory=dict)


def list_motions(plan: PlanConfig) -> list[Any]:
    """List the tables of a plan that may name motion files."""
    return [*(one.motion for one in plan.classes), *(one.targets for one in plan.episodes), plan.companions]


def list_labels(plan: PlanConfig) -> list[str]:
    """List the labels of a plan's rows: of classes, or of the bodies of episodes and of what is no body."""
    if plan.classes:
        return [section.label for section in plan.classes]
    tables = _iterate_tables([section.targets for section in plan.episodes])
    labels = {label for table in tables for label in _list_strings(table.get("label"))}
    return [*sorted(labels - {THING}), THING]


def expand_folders(plan: PlanConfig, folder: Path, *, on_progress: Progress | None = None) -> PlanConfig:
    """Replace a plan's folders by lists of their segments."""
    if not any(table.get("kind") == "folder" for table in _iterate_tables(list_motions(plan))):
        return plan
    seconds = plan.scene.get("duration_s")
    as_recorded = seconds is None and "scene.duration_s" in plan.dataset.leaks
    if plan.classes and not as_recorded and not isinstance(seconds, int | float):
        raise ConfigError(
            f"scene.duration_s: {shorten(seconds)} is not allowed with a folder of motion files; set a number of s"
        )

    def expand(value: Any, key: str, seconds: Any = seconds) -> Any:
        if isinstance(value, Mapping):
            if value.get("kind") == "folder":
                spec = validate(FolderMotion, {k: v for k, v in value.items() if k != "kind"}, section=(key,))
                if as_recorded and spec.hybrid != "none":
                    raise ConfigError(f"{key}.hybrid: {spec.hybrid!r} is not allowed without scene.duration_s")
                length_s = 0.0 if seconds is None else float(seconds)  # a duration of 0 s disables looping
                return {"cycle": _list_segments(spec, folder, length_s, key, plan.sources, on_progress)}
            return {k: expand(v, f"{key}.{k}", seconds) for k, v in value.items()}
        if isinstance(value, list):
            return [expand(v, f"{key}.{n}", seconds) for n, v in enumerate(value)]
        return value

    classes = tuple(
        section.model_copy(update={"motion": expand(section.motion, f"classes.{number}.motion")})
        for number, section in enumerate(plan.classes)
    )
    episodes = []
    for number, episode in enumerate(plan.episodes):
        targets = expand(episode.targets, f"episodes.{number}.targets", episode.duration_s)
        episodes.append(episode.model_copy(update={"targets": targets}))
    return plan.model_copy(update={"classes": classes, "episodes": tuple(episodes)})


def _list_segments(
    spec: FolderMotion,
    folder: Path,
    seconds: float,
    key: str,
    sources: Sequence[SourceSection],
    on_progress: Progress | None,
) -> list[dict[str, Any]]:
    # the first segment of every file, then the second, and so on
    root = folder / spec.path
    if not root.is_dir():
        raise ConfigError(
            f"{key}.path: {spec.path!r} is not allowed: there is no such folder in {folder.resolve()}; name the folder "
            "that contains it with --motion-folder"
        )
    files = list_files(root, spec.pattern)
    found: list[tuple[dict[str, Any], Motion]] = []
    refused: dict[str, str] = {}
    for number, file in enumerate(files, start=1):
        name = (Path(spec.path) / file.relative_to(root)).as_posix()
        try:
            found += _read_file_segments(spec, file, name, seconds)
        except DoppelgaitError as error:
            refused[name] = str(error).replace(f"{file}: ", "").partition(";")[0]
        if on_progress is not None:
            on_progress(number, len(files))
    if not found:
        reasons = "; ".join(list(refused.values())[:SHOWN_REASONS])
        raise DatasetError(
            f"{key}: {root} has no straight segment of gait that can be used in {len(files)} files"
            + (f": {reasons}" if reasons else "")
        )
    if refused:
        shown = "; ".join(f"{name}: {reason}" for name, reason in list(refused.items())[:SHOWN_REASONS])
        warn_caller(f"{spec.path}: {len(refused)} of {len(files)} files are left out: {shown}")
    found.sort(key=lambda entry: (entry[0]["segment"], entry[0]["path"]))
    tables = [table for table, _ in found]
    if spec.hybrid == "none":
        return tables
    from doppelgait.dataset.hybrids import add_hybrids

    subjects = [find_subject(table, "", sources) for table in tables]
    return add_hybrids(tables, [clip for _, clip in found], subjects, spec.hybrid)


def _read_file_segments(
    spec: FolderMotion, file: Path, name: str, seconds: float
) -> list[tuple[dict[str, Any], Motion]]:
    from doppelgait.motion.gait import add_gait_facts
    from doppelgait.motion.loop import loop
    from doppelgait.motion.readers import read
    from doppelgait.motion.segments import crop, find_segments

    with warnings.catch_warnings():
        # ignore the warnings of cleaning; the build repeats them for every row
        warnings.simplefilter("ignore", DoppelgaitWarning)
        motion = read(file, **spec.options)
        for fault in motion.report["implausible"]:
            raise MotionError(fault)
        tables = []
        for number, segment in enumerate(find_segments(motion), start=1):
            table = {"kind": "file", "path": name, "segment": number, **spec.options}
            if segment.duration_s < spec.min_duration_s:
                continue
            clip = crop(motion, segment)
            if segment.duration_s < seconds and not spec.loop:
                continue
            # a hybrid may be faster than its recording
            if segment.duration_s < seconds or spec.hybrid != "none":
                try:
                    loop(clip, duration_s=seconds + SPARE_S)
                except DoppelgaitError:
                    continue  # shorter than a stride: it cannot be repeated
                table["loop_to_s"] = seconds + SPARE_S
            if spec.hybrid != "none":
                clip = add_gait_facts(clip)
                clip.position_m.setflags(write=False)  # fit its cycle once
            tables.append((table, clip))
    return tables
