"""Motions of a plan: checks, subjects, source files, folders and hybrids."""

from __future__ import annotations

import hashlib
import math
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from doppelgait.core.config import FrozenModel, format_canonical_json, validate
from doppelgait.core.documents import parse_json
from doppelgait.core.errors import (
    ConfigError,
    DatasetError,
    DoppelgaitError,
    DoppelgaitWarning,
    MotionError,
    warn_caller,
)
from doppelgait.core.files import hash_file, list_files
from doppelgait.core.readers import list_options
from doppelgait.dataset.config import PlanConfig, Progress, SourceSection, shorten
from doppelgait.motion.gait import add_gait_facts, is_quadruped
from doppelgait.motion.hybrid import (
    FACTOR,
    Hybrid,
    blend,
    find_speed_law,
    find_speed_limits,
    find_stride_limits,
    make_hybrid,
    retarget,
)
from doppelgait.motion.loop import fit_cycle
from doppelgait.motion.models.registry import MOTION_MODELS, check_table
from doppelgait.motion.motion import Motion
from doppelgait.motion.readers import MOTION_READERS, read
from doppelgait.motion.segments import crop, find_segments

BOTH = " + "  # separator of the paths of a blended motion in the column ``recording``
EMPTY_SCENE = "none"  # motion kind of an example without a target
THING = "thing"  # label of tracks of no body: of confusers, echoes and noise
PHANTOM_SPEED_MPS = {"uniform": [0.4, 2.0]}
"""Default speed of the gate of an example without a target."""


def list_recording_paths(motion: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the paths of a resolved motion's recordings, as written."""
    clips = [motion, (motion.get("hybrid") or {}).get("other")] if motion["kind"] == "file" else []
    return tuple(str(one["path"]) for one in clips if one and one["kind"] == "file" and one["path"])


def find_source_entry(recording: str, sources: Sequence[SourceSection]) -> SourceSection | None:
    """Return the first entry of ``[[sources]]`` that matches a recording."""
    return next((entry for entry in sources if fnmatchcase(recording, entry.files)), None)


def find_subject(motion: Mapping[str, Any], row_id: str, sources: Sequence[SourceSection] = ()) -> str:
    """Return the subject of a motion."""
    recording = next(iter(list_recording_paths(motion)), "")
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
    if not isinstance(motion, Mapping) or not isinstance(motion.get("kind"), str):
        needs = 'needs kind = "NAME" (a motion model, or "file" with path = "...")'
        raise ConfigError(f"{key}: {shorten(motion)} is not allowed: {needs}")
    kind = motion["kind"]
    options = {name: value for name, value in motion.items() if name != "kind"}
    if kind == "folder":
        raise ConfigError(f"{key}.kind: a folder is allowed in [[classes]] only; name a file")
    if kind == "file":
        if "hybrid" in options:
            hybrid = validate(Hybrid, options.pop("hybrid"), section=(*key.split("."), "hybrid"))
            if hybrid.other is not None:
                check_motion(hybrid.other, folder, key=f"{key}.hybrid.other")
        path = options.pop("path", None)
        if not isinstance(path, str) or not path:
            raise ConfigError(f'{key}.path: {shorten(path)} is not allowed: kind "file" needs path = "..."')
        if not (folder / path).is_file():
            raise ConfigError(f"{key}.path: {path!r} is not allowed: there is no such file in {folder.resolve()}")
        # Allow the options of all readers, because the reader depends on the content of the file.
        functions = [read, *(reader.run for reader in MOTION_READERS.values())]
        allowed = list(dict.fromkeys(name for function in functions for name in list_options(function)))
        for name in sorted(set(options) - set(allowed)):
            raise ConfigError(
                f"{key}.{name}: {shorten(options[name])} is not allowed: unknown key; allowed are "
                f"path, hybrid, {', '.join(allowed)}"
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


def refuse_copies(paths: Iterable[str], folder: Path, sources: Sequence[SourceSection]) -> None:
    """Raise a :class:`ConfigError` if one file, or equal files, would be different subjects."""
    seen: dict[Any, str] = {}
    by_size: dict[int, list[str]] = {}
    for path in paths:
        # another spelling of the file would be another subject, perhaps in another split
        first = seen.setdefault((folder / path).resolve(), path)
        if first != path:
            raise ConfigError(f"motion files {first!r} and {path!r} are the same file; write its path in one form")
        if (folder / path).is_file():
            by_size.setdefault((folder / path).stat().st_size, []).append(path)
    for path in (path for group in by_size.values() if len(group) > 1 for path in group):
        first = seen.setdefault(hashlib.sha256((folder / path).read_bytes()).hexdigest(), path)
        subjects = {find_subject({"kind": "file", "path": name}, "", sources) for name in (first, path)}
        if len(subjects) > 1:
            raise ConfigError(
                f"motion files {first!r} and {path!r} have the same content; leave one out, or "
                "assign both to one subject in [[sources]]"
            )


SPARE_S = 0.1  # time, s, by which a looped motion exceeds the scene
SHOWN_REASONS = 3


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
    hybrid: Literal["none", "retarget", "blend"] = "none"
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
        one.model_copy(update={"motion": expand(one.motion, f"classes.{number}.motion")})
        for number, one in enumerate(plan.classes)
    )
    episodes = tuple(
        one.model_copy(update={"targets": expand(one.targets, f"episodes.{number}.targets", one.duration_s)})
        for number, one in enumerate(plan.episodes)
    )
    return plan.model_copy(update={"classes": classes, "episodes": episodes})


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
            f"{key}.path: {spec.path!r} is not allowed: there is no such folder in "
            f"{folder.resolve()}; name the folder that contains it with --motion-folder"
        )
    files = list_files(root, spec.pattern)
    found: list[tuple[dict[str, Any], Motion]] = []
    refused: dict[str, str] = {}
    options = format_canonical_json(spec.options)
    for number, file in enumerate(files, start=1):
        name, loop_to_s = (Path(spec.path) / file.relative_to(root)).as_posix(), seconds + SPARE_S
        try:
            clips = _read_clips(file, hash_file(file), options, spec.hybrid != "none")
        except (DoppelgaitError, OSError) as error:
            refused[name] = str(error).replace(f"{file}: ", "").partition(";")[0]
            clips = []
        for segment, duration_s, can_loop, clip in clips:
            # a hybrid may be faster than its recording
            is_short = duration_s < seconds or spec.hybrid != "none"
            if (
                duration_s < spec.min_duration_s
                or (duration_s < seconds and not spec.loop)
                or (is_short and not can_loop)
            ):
                continue
            table = {"kind": "file", "path": name, "segment": segment, **spec.options}
            found.append((table | ({"loop_to_s": loop_to_s} if is_short else {}), clip))
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
    subjects = [find_subject(table, "", sources) for table in tables]
    return add_hybrids(tables, [clip for _, clip in found], subjects, spec.hybrid)


@lru_cache(maxsize=1024)  # kinds of episodes share folders, and a plan is read again for its build
def _read_clips(file: Path, sha256: str, options: str, with_motion: bool) -> list[tuple[int, float, bool, Any]]:
    """List straight segments: number, duration, whether it can loop, and clip for a hybrid."""
    clips = []
    with warnings.catch_warnings(action="ignore", category=DoppelgaitWarning):
        # ignore the warnings of cleaning; the build repeats them for every row
        motion = read(file, **parse_json(options))
        for fault in motion.report["implausible"]:
            raise MotionError(fault)
        for number, segment in enumerate(find_segments(motion), start=1):
            clip, can_loop = crop(motion, segment), False
            with suppress(DoppelgaitError):  # shorter than a stride: it cannot be repeated
                fit_cycle(clip)
                can_loop = True
            if with_motion and can_loop:
                clip = add_gait_facts(clip)
                clip.position_m.setflags(write=False)  # fit its cycle once
            clips.append((number, segment.duration_s, can_loop, clip if with_motion else None))
    return clips


STATURE_SD = 0.056
"""Stature range of adults relative to the mean: men 1.75 +-0.07 m, women 1.62 +-0.065 m, as in ``sample_person``."""
FAMILY = 2  # number of subjects that are blended with each other; they share a split
PARTNERS = 4  # maximum number of clips that one clip is blended with
MOST_SHARE = 0.5  # minimum weight of the first recording in a blended clip
SHRINK, TRIES = 0.6, 4


def add_hybrids(
    tables: Sequence[Mapping[str, Any]],
    clips: Sequence[Motion],
    subjects: Sequence[str],
    mode: Literal["retarget", "blend"],
) -> list[dict[str, Any]]:
    """Add distributions of speed, size, stride and blending to clips."""
    hybrids = [_make_factor_ranges(clip) for clip in clips]
    families = _group_families(clips, subjects) if mode == "blend" else []
    found = []
    for number, (table, clip, hybrid) in enumerate(zip(tables, clips, hybrids, strict=True)):
        partners: list[dict[str, Any]] = []
        for other in (n for family in families if number in family for n in family if n != number):
            if len(partners) < PARTNERS and hybrid and (narrower := _fit(clip, clips[other], hybrid)):
                hybrid = {**hybrid, "speed_factor": {"log_uniform": narrower}}
                partners.append({k: v for k, v in tables[other].items() if k not in ("loop_to_s", "loop_variation")})
        more = {"other": {"choice": partners}, "share": {"uniform": [0.0, MOST_SHARE]}} if partners else {}
        found.append({**table, **({"hybrid": {**hybrid, **more}} if hybrid else {})})
    return found


def _make_factor_ranges(clip: Motion) -> dict[str, Any]:
    """Return the three factors' distributions, {} if a clip cannot change."""
    law = find_speed_law(clip)
    speed, stride = (tuple(map(math.log, limits)) for limits in (find_speed_limits(clip), find_stride_limits(law)))
    reach: list[float] = []
    for side in (0, 1):
        part = 1.0
        for _ in range(TRIES):
            factors = {"speed_factor": math.exp(part * speed[side]), "stride_factor": math.exp(part * stride[side])}
            with suppress(DoppelgaitError), warnings.catch_warnings(action="ignore", category=DoppelgaitWarning):
                retarget(clip, **factors)
                break
            part *= SHRINK
        else:
            return {}
        reach.append(part)
    sizes = {"log_uniform": list(FACTOR)} if is_quadruped(clip) else {"normal": [1.0, STATURE_SD]}
    speeds, strides = (
        [round(math.exp(part * end), 6) for part, end in zip(reach, ends, strict=True)] for ends in (speed, stride)
    )
    return {"speed_factor": {"log_uniform": speeds}, "size_factor": sizes, "stride_factor": {"log_uniform": strides}}


def _group_families(clips: Sequence[Motion], subjects: Sequence[str]) -> list[list[int]]:
    """Group clips of equal gait and points whose subjects are blended."""
    alike: dict[tuple[Any, ...], dict[str, list[int]]] = {}
    for number, (clip, subject) in enumerate(zip(clips, subjects, strict=True)):
        key = (clip.facts.species, tuple(clip.markers))
        alike.setdefault(key, {}).setdefault(subject, []).append(number)
    found = []
    for members in alike.values():
        names = sorted(members)
        starts = list(range(0, max(1, len(names) - FAMILY + 1), FAMILY))
        for start, stop in zip(starts, [*starts[1:], len(names)], strict=True):
            numbers = sorted(n for name in names[start:stop] for n in members[name])
            by_gait: dict[str, list[int]] = {}
            for number in numbers:
                by_gait.setdefault(clips[number].facts.gait, []).append(number)
            found += [group for gait, group in by_gait.items() if gait and len(group) > 1]
    return found


def _fit(clip: Motion, other: Motion, hybrid: Mapping[str, Any]) -> list[float]:
    """Return a blended clip's range of speed factors, [] if impossible."""
    speeds = hybrid["speed_factor"]["log_uniform"]
    with suppress(DoppelgaitError), warnings.catch_warnings(action="ignore", category=DoppelgaitWarning):
        low, high = find_speed_limits(blend(clip, other, share=MOST_SHARE))
        narrower = [max(speeds[0], low), min(speeds[1], high)]
        for speed, stride in zip(narrower, hybrid["stride_factor"]["log_uniform"], strict=True):
            ends = Hybrid(speed_factor=speed, stride_factor=stride, other={"kind": "file"}, share=MOST_SHARE)
            make_hybrid(clip, ends, lambda _: other)
        return [round(speed, 6) for speed in narrower]
    return []
