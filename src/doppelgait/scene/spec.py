"""Scenes as configuration: targets by motion model or file, their place and radar cross section."""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from pathlib import Path
from threading import Lock
from typing import Any, Self

import numpy as np
from pydantic import field_validator, model_validator

from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError, MotionError
from doppelgait.motion.motion import Motion
from doppelgait.scene.target import Scene, SceneParameters, Target, TargetParameters

KEPT_BYTES = 128 * 2**20
"""Of motions read before; some three hundred stretches of motion capture."""

_read_before: OrderedDict[tuple[Path, tuple[int, int], str], Motion] = OrderedDict()
_reading = Lock()


class TargetSpec(TargetParameters):
    """One ``[[targets]]`` entry of a scene file; see :class:`doppelgait.scene.Target`.

    Parameters
    ----------
    motion : table
        ``kind`` names a motion model, whose parameters are the other keys; ``kind = "file"`` takes ``path`` (relative
        to the scene file) and the options of its reader, such as ``start_s`` and ``stop_s``.
    """

    motion: dict[str, Any]

    @field_validator("motion")
    @classmethod
    def _has_kind(cls, motion: dict[str, Any]) -> dict[str, Any]:
        if not isinstance(motion.get("kind"), str):
            raise ValueError('needs kind = "NAME" (a motion model, or "file" with path = "...")')
        return motion


class SceneSpec(SceneParameters):
    """The scene part of a scene file; see :class:`doppelgait.scene.Scene`.

    Parameters
    ----------
    targets : list of TargetSpec
        None for an empty room, which needs ``duration_s``.
    radar_position_m : (float, float, float)
    duration_s : float, optional
        By default the shortest file motion, or 5 s where all motions are models.
    radar_azimuth_deg, radar_tilt_deg : float
    receiver_position_m : (float, float, float), optional
    """

    targets: tuple[TargetSpec, ...] = ()

    @model_validator(mode="after")
    def _has_duration(self) -> Self:
        if not self.targets and self.duration_s is None:
            raise ValueError("targets: must have at least 1 item ([[targets]]), or give duration_s for an empty room")
        return self


DEFAULT_DURATION_S = 5.0


def build_scene(spec: SceneSpec, *, folder: Path | None = None, rng: np.random.Generator | None = None) -> Scene:
    """Scene of a specification: motions generated or read, targets made.

    Parameters
    ----------
    spec : SceneSpec
    folder : Path, optional
        Folder that relative motion paths start from; the working folder by default.
    rng : numpy.random.Generator, optional
        For motion models that vary; never touched by those that do not.

    Raises
    ------
    ConfigError
        If a motion's kind or parameters are not allowed; the message names the target.
    MotionError
        If a motion file cannot be used.
    """
    # files first: how long they are says how long the models' motions must be
    of_files = [number for number, target in enumerate(spec.targets) if target.motion["kind"] == "file"]
    motions = {number: _target_motion(spec, number, DEFAULT_DURATION_S, folder, None) for number in of_files}
    seconds = _model_duration_s(spec, list(motions.values()))
    targets = []
    for number, target in enumerate(spec.targets):
        if number not in motions:
            motions[number] = _target_motion(spec, number, seconds, folder, rng)
        options = target.model_dump(exclude={"motion", "rcs", "path"})
        targets.append(Target(motion=motions[number], rcs=target.rcs, path=target.path, **options))
    return Scene(targets, **{name: getattr(spec, name) for name in SceneParameters.model_fields})


def _target_motion(
    spec: SceneSpec, number: int, duration_s: float, folder: Path | None, rng: np.random.Generator | None
) -> Motion:
    try:
        return build_motion(spec.targets[number].motion, duration_s=duration_s, folder=folder, rng=rng)
    except ConfigError as error:
        raise ConfigError(f"targets.{number}.motion: {error}") from None


def _model_duration_s(spec: SceneSpec, file_motions: Sequence[Motion]) -> float:
    if spec.duration_s is not None:
        # a model scaled dynamically to a smaller height runs faster, and a path may be faster than its motion (twice
        # 30 %: in its speed, and beside a curve), so its motion must be longer
        froude = 2.0 if any(t.scaling == "froude" for t in spec.targets) else 1.0
        return spec.duration_s * froude * (1.7 if any(t.path is not None for t in spec.targets) else 1.0)
    return min((m.duration_s for m in file_motions), default=DEFAULT_DURATION_S)


def build_motion(
    table: Mapping[str, Any], *, duration_s: float, folder: Path | None = None, rng: np.random.Generator | None = None
) -> Motion:
    """Motion of a ``motion = { kind = ... }`` table: a model of ``duration_s`` or a file read and cleaned."""
    options = {key: value for key, value in table.items() if key != "kind"}
    kind = str(table["kind"])
    if kind == "file":
        return _read_file(options, folder)
    from doppelgait.motion.models import MOTION_MODELS, generate, parameters_of

    if kind not in MOTION_MODELS:
        raise ConfigError(f"unknown kind {kind!r}; known are: file, {', '.join(MOTION_MODELS)}")
    return generate(validate(parameters_of(kind), options, where=f"kind {kind!r}"), duration_s=duration_s, rng=rng)


def _read_file(options: dict[str, Any], folder: Path | None) -> Motion:
    from doppelgait.motion.readers import read

    path = options.pop("path", None)
    if not isinstance(path, str) or not path:
        raise ConfigError('kind "file" needs path = "..."')
    file = (folder or Path()) / path
    try:
        stamp = file.stat().st_mtime_ns, file.stat().st_size
    except OSError:
        return read(file, **options)  # which says what is wrong with it
    try:
        return _read_once(file, stamp, json.dumps(options, sort_keys=True))
    except TypeError as error:
        raise MotionError(f"{path}: {error}") from None


def _read_once(file: Path, stamp: tuple[int, int], options: str) -> Motion:
    """Motion of a file as it is now; examples of a dataset take the same stretches of the same files in turn."""
    from doppelgait.motion.readers import read

    key = (file, stamp, options)
    with _reading:
        if key not in _read_before:
            _read_before[key] = read(file, **json.loads(options))
            while (
                len(_read_before) > 1 and sum(motion.positions.nbytes for motion in _read_before.values()) > KEPT_BYTES
            ):
                _read_before.popitem(last=False)
        _read_before.move_to_end(key)
        return _read_before[key]
