"""Scenes as configuration: targets by motion model or file, their place and radar cross section."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from pydantic import Field, field_validator

from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.errors import ConfigError, MotionError
from doppelgait.motion.retime import ScalingMode
from doppelgait.scene.rcs import RcsSpec
from doppelgait.scene.target import Scene, Target


class TargetSpec(FrozenModel):
    """One ``[[targets]]`` entry of a scene file; see :class:`doppelgait.scene.Target`.

    Parameters
    ----------
    motion : table
        ``kind`` names a motion model, whose parameters are the other keys; ``kind = "file"`` takes ``path`` (relative
        to the scene file) and the options of its reader, such as ``start_s`` and ``stop_s``.
    """

    motion: dict[str, Any]
    label: str = ""
    rcs: RcsSpec = RcsSpec()
    height_m: float | None = Field(default=None, gt=0, le=5)
    scaling: ScalingMode = "uniform"
    range_m: float | None = Field(default=None, gt=0, le=1e5)
    bearing_deg: float = Field(default=0.0, ge=-360, le=360)
    aspect_deg: float = Field(default=0.0, ge=-360, le=360)
    start_position_m: tuple[float, float] | None = None
    heading_deg: float | None = Field(default=None, ge=-360, le=360)

    @field_validator("motion")
    @classmethod
    def _has_kind(cls, motion: dict[str, Any]) -> dict[str, Any]:
        if not isinstance(motion.get("kind"), str):
            raise ValueError('needs kind = "NAME" (a motion model, or "file" with path = "...")')
        return motion


class SceneSpec(FrozenModel):
    """The scene part of a scene file; see :class:`doppelgait.scene.Scene`.

    Parameters
    ----------
    targets : list of TargetSpec
    radar_position_m : (float, float, float)
    duration_s : float, optional
        By default the shortest file motion, or 5 s where all motions are models.
    """

    targets: tuple[TargetSpec, ...] = Field(min_length=1)
    radar_position_m: tuple[float, float, float] = (0.0, 0.0, 1.0)
    duration_s: float | None = Field(default=None, gt=0, le=3600)


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
    seconds = _model_duration_s(spec, folder)
    targets = []
    for number, target in enumerate(spec.targets):
        try:
            motion = build_motion(target.motion, duration_s=seconds, folder=folder, rng=rng)
        except ConfigError as error:
            raise ConfigError(f"targets.{number}.motion: {error}") from None
        options = target.model_dump(exclude={"motion", "rcs"})
        targets.append(Target(motion=motion, rcs=target.rcs, **options))
    return Scene(targets, radar_position_m=spec.radar_position_m, duration_s=spec.duration_s)


def _model_duration_s(spec: SceneSpec, folder: Path | None) -> float:
    if spec.duration_s is not None:
        # a model scaled dynamically to a smaller height runs faster, so its motion must be longer
        return spec.duration_s * (2.0 if any(t.scaling == "froude" for t in spec.targets) else 1.0)
    files = [t.motion for t in spec.targets if t.motion["kind"] == "file"]
    if not files:
        return DEFAULT_DURATION_S
    motions = [build_motion(motion, duration_s=DEFAULT_DURATION_S, folder=folder) for motion in files]
    return min(float(np.ptp(m.coords["time"].values)) for m in motions)


def build_motion(
    table: Mapping[str, Any], *, duration_s: float, folder: Path | None = None, rng: np.random.Generator | None = None
) -> xr.DataArray:
    """Motion of a ``motion = { kind = ... }`` table: a model of ``duration_s`` or a file read and cleaned."""
    options = {key: value for key, value in table.items() if key != "kind"}
    kind = str(table["kind"])
    if kind == "file":
        return _read_file(options, folder)
    from doppelgait.motion.models import MOTION_MODELS

    if kind not in MOTION_MODELS:
        raise ConfigError(f"unknown kind {kind!r}; known are: file, {', '.join(MOTION_MODELS)}")
    model = MOTION_MODELS[kind]
    return model.generate(validate(model.config, options, where=f"kind {kind!r}"), duration_s, rng)


def _read_file(options: dict[str, Any], folder: Path | None) -> xr.DataArray:
    from doppelgait.motion.readers import read

    path = options.pop("path", None)
    if not isinstance(path, str) or not path:
        raise ConfigError('kind "file" needs path = "..."')
    try:
        return read((folder or Path()) / path, **options)
    except TypeError as error:
        raise MotionError(f"{path}: {error}") from None
