"""``motion = { kind = "folder", ... }``: the straight stretches of all motion files of a folder, taken in turn."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pydantic import Field

from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.errors import ConfigError, DatasetError, DoppelgaitError, DoppelgaitWarning
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.describe import shorten

SPARE_S = 0.1
"""A looped motion goes on for this much longer than the scene."""
SHOWN_REASONS = 3

Progress = Callable[[int, int], None]


class FolderMotion(FrozenModel):
    """A folder of motion files as the motion of a class.

    Parameters
    ----------
    path : str
        The folder, from the folder of the plan.
    pattern : str
        Which files of it and of its folders, for example ``"*.bvh"``.
    loop : bool
        Stretches shorter than the scene are repeated over whole strides; else they are left out.
    min_duration_s : float
        Shorter stretches are left out.
    options : table
        Options of the reader, such as ``units``.
    """

    path: str = Field(min_length=1)
    pattern: str = "*"
    loop: bool = True
    min_duration_s: float = Field(default=0.0, ge=0)
    options: dict[str, Any] = Field(default_factory=dict)


def has_folders(plan: PlanConfig) -> bool:
    """Whether a class takes its motion from a folder."""
    return any(_folders_in(section.motion) for section in plan.classes)


def _folders_in(value: Any) -> bool:
    if isinstance(value, Mapping):
        return value.get("kind") == "folder" or any(map(_folders_in, value.values()))
    return isinstance(value, list) and any(map(_folders_in, value))


def expand_folders(plan: PlanConfig, folder: Path, *, on_progress: Progress | None = None) -> PlanConfig:
    """The plan with every folder replaced by the list of its stretches; the only step of planning that reads files.

    Parameters
    ----------
    plan : PlanConfig
    folder : Path
        Folder that relative paths start from.
    on_progress : callable, optional
        Called with (files read, files in total).

    Raises
    ------
    ConfigError
        If a folder is missing or a key is not allowed, or ``scene.duration_s`` is not a number, which a list of
        stretches needs.
    DatasetError
        If a folder has no usable stretch.
    """
    if not has_folders(plan):
        return plan
    seconds = plan.scene.get("duration_s")
    if not isinstance(seconds, int | float):
        raise ConfigError(
            f"scene.duration_s: {shorten(seconds)} is not allowed with a folder of motion files; give a number of s"
        )

    def expand(value: Any, key: str) -> Any:
        if isinstance(value, Mapping):
            if value.get("kind") == "folder":
                spec = validate(FolderMotion, {k: v for k, v in value.items() if k != "kind"}, section=(key,))
                return {"cycle": _stretches(spec, folder, float(seconds), key, on_progress)}
            return {k: expand(v, f"{key}.{k}") for k, v in value.items()}
        return [expand(v, f"{key}.{n}") for n, v in enumerate(value)] if isinstance(value, list) else value

    classes = tuple(
        section.model_copy(update={"motion": expand(section.motion, f"classes.{number}.motion")})
        for number, section in enumerate(plan.classes)
    )
    return plan.model_copy(update={"classes": classes})


def _stretches(
    spec: FolderMotion, folder: Path, seconds: float, key: str, on_progress: Progress | None
) -> list[dict[str, Any]]:
    """Motion tables of all usable stretches of a folder: the first of every file, then the second, and so on."""
    root = folder / spec.path
    if not root.is_dir():
        raise ConfigError(f"{key}.path: {spec.path!r} is not allowed: there is no such folder in {folder.resolve()}")
    files = sorted(path for path in root.rglob(spec.pattern) if path.is_file())
    found: list[dict[str, Any]] = []
    refused: dict[str, str] = {}
    for number, file in enumerate(files, start=1):
        name = (Path(spec.path) / file.relative_to(root)).as_posix()
        try:
            found += _of_file(spec, file, name, seconds)
        except DoppelgaitError as error:
            refused[name] = str(error).replace(f"{file}: ", "").partition(";")[0]
        if on_progress is not None:
            on_progress(number, len(files))
    if not found:
        reasons = "; ".join(list(refused.values())[:SHOWN_REASONS])
        raise DatasetError(
            f"{key}: {root} has no straight stretch of gait that can be used in {len(files)} files"
            + (f": {reasons}" if reasons else "")
        )
    if refused:
        shown = "; ".join(f"{name}: {reason}" for name, reason in list(refused.items())[:SHOWN_REASONS])
        warnings.warn(
            f"{spec.path}: {len(refused)} of {len(files)} files are left out: {shown}", DoppelgaitWarning, stacklevel=3
        )
    return sorted(found, key=lambda table: (table["segment"], table["path"]))


def _of_file(spec: FolderMotion, file: Path, name: str, seconds: float) -> list[dict[str, Any]]:
    from doppelgait.motion.loop import loop
    from doppelgait.motion.readers import read
    from doppelgait.motion.segments import crop, find_segments

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)  # of cleaning; the build says them again, row by row
        motion = read(file, **spec.options)
        tables = []
        for number, segment in enumerate(find_segments(motion), start=1):
            table = {"kind": "file", "path": name, "segment": number, **spec.options}
            if segment.duration_s < spec.min_duration_s:
                continue
            if segment.duration_s < seconds:
                if not spec.loop:
                    continue
                try:
                    loop(crop(motion, segment), duration_s=seconds + SPARE_S)
                except DoppelgaitError:
                    continue  # shorter than a stride: nothing to repeat
                table["loop_to_s"] = seconds + SPARE_S
            tables.append(table)
    return tables
