"""Targets and scenes: who moves where, seen from which radar position."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from pydantic import Field, SerializeAsAny, field_validator

from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.errors import ConfigError, MotionError
from doppelgait.motion.follow import follow
from doppelgait.motion.motion import Motion, require_motion
from doppelgait.motion.paths import Path, make_path
from doppelgait.motion.retime import ScalingMode, place, scale_to_height, travel_speed_mps
from doppelgait.scene.rcs import RcsSpec


class TargetParameters(FrozenModel):
    """What is allowed for a :class:`Target` apart from its motion."""

    label: str = ""
    rcs: RcsSpec = RcsSpec()
    height_m: float | None = Field(default=None, gt=0, le=5)
    scaling: ScalingMode = "uniform"
    range_m: float | None = Field(default=None, gt=0, le=1e5)
    bearing_deg: float = Field(default=0.0, ge=-360, le=360)
    aspect_deg: float = Field(default=0.0, ge=-360, le=360)
    start_position_m: tuple[float, float] | None = None
    heading_deg: float | None = Field(default=None, ge=-360, le=360)
    path: SerializeAsAny[Path] | None = None
    background: bool = False

    @field_validator("path", mode="before")
    @classmethod
    def _of_its_kind(cls, path: Any) -> Any:
        try:
            return make_path(path) if isinstance(path, Mapping) else path
        except ConfigError as error:
            raise ValueError(str(error)) from None


class SceneParameters(FrozenModel):
    """What is allowed for a :class:`Scene` apart from its targets."""

    radar_position_m: tuple[float, float, float] = (0.0, 0.0, 1.0)
    duration_s: float | None = Field(default=None, gt=0, le=3600)
    radar_azimuth_deg: float = Field(default=0.0, ge=-360, le=360)
    radar_tilt_deg: float = Field(default=0.0, ge=-90, le=90)
    receiver_position_m: tuple[float, float, float] | None = None


def _check_parameters(owner: Any, model: type[FrozenModel]) -> None:
    """Check the parameters of a target or scene and keep them as the model has them."""
    given = {name: getattr(owner, name) for name in model.model_fields}
    plain = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in given.items()}
    checked = validate(model, plain, where=type(owner).__name__.lower())
    for name in given:
        object.__setattr__(owner, name, getattr(checked, name))


@dataclass(frozen=True)
class Target:
    """One mover of a scene.

    Parameters
    ----------
    motion : Motion
        A cleaned recording or a model's motion.
    label : str
        Class of the target, for example ``"human"`` or ``"dog"``.
    rcs : RcsSpec or str
        Radar cross section; a string is its ``kind``.
    height_m : float, optional
        Scale the mover to this stature (people) or withers height (dogs); as recorded by default.
    scaling : {"uniform", "froude", "z_only"}
        How to scale (E-01).
    range_m : float, optional
        Ground range of the body centre from the radar at the middle of the observation; by default 5 m, or as much
        more as keeps the closest approach at 2 m.
    bearing_deg : float
        Direction of that point as seen from the radar, from +x towards +y.
    aspect_deg : float
        Aspect angle psi between the walking direction and the direction to the radar there: 0 approaching,
        180 receding, positive counter-clockwise.
    start_position_m : (float, float), optional
        Instead of range, bearing and aspect: ground position of the body centre at the start ...
    heading_deg : float, optional
        ... and direction of travel there, from +x towards +y.
    path : Path or table, optional
        Way over the ground (:mod:`doppelgait.motion.paths`) in the frame of ``start_position_m`` and ``heading_deg``,
        which it needs; straight on by default.
    background : bool
        A mover that scatters but is no target: a fan, a curtain. It has no truth and no result, and its scatterers
        have target number -1.

    Raises
    ------
    ConfigError
        If a parameter is not allowed, only one of ``start_position_m`` and ``heading_deg`` is given, both forms are
        mixed, or a path has no start.
    """

    motion: Motion
    label: str = ""
    rcs: RcsSpec | str = field(default_factory=RcsSpec)
    height_m: float | None = None
    scaling: ScalingMode = "uniform"
    range_m: float | None = None
    bearing_deg: float = 0.0
    aspect_deg: float = 0.0
    start_position_m: tuple[float, float] | None = None
    heading_deg: float | None = None
    path: Path | Mapping[str, Any] | None = None
    background: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        require_motion(self.motion)
        if isinstance(self.rcs, str):
            object.__setattr__(self, "rcs", {"kind": self.rcs})
        if isinstance(self.range_m, float | int) and not self.range_m > 0:
            raise ConfigError(f"range_m is {self.range_m}; it must be positive")
        _check_parameters(self, TargetParameters)
        if (self.start_position_m is None) != (self.heading_deg is None):
            raise ConfigError("start_position_m and heading_deg belong together: give both or neither")
        relative = self.range_m is not None or self.bearing_deg != 0 or self.aspect_deg != 0
        if self.start_position_m is not None and relative:
            raise ConfigError("give either start_position_m and heading_deg, or range_m, bearing_deg and aspect_deg")
        if self.path is not None and self.start_position_m is None:
            raise ConfigError(
                "a path needs start_position_m and heading_deg: its origin and the direction of its x axis"
            )

    @property
    def rcs_spec(self) -> RcsSpec:
        """The radar cross section as a model, whichever way it was given."""
        return cast(RcsSpec, self.rcs)

    @property
    def path_spec(self) -> Path | None:
        """The path as a model, whichever way it was given."""
        return cast("Path | None", self.path)


@dataclass(frozen=True)
class Scene:
    """Targets and one radar position.

    Parameters
    ----------
    targets : sequence of Target
        None for an empty room, which needs ``duration_s``.
    radar_position_m : (float, float, float)
        Position of the radar (of its transmitter, where the receiver is elsewhere), z up from the floor.
    duration_s : float, optional
        Observation time T_o; the shortest motion by default.
    radar_azimuth_deg, radar_tilt_deg : float
        Where the antenna looks (its boresight): azimuth from +x towards +y, -360 to 360 degrees, and tilt up from the
        horizontal, -90 to 90 degrees. Of no effect for an isotropic antenna.
    receiver_position_m : (float, float, float), optional
        Position of the receiver of a bistatic radar; at ``radar_position_m`` by default.

    Raises
    ------
    ConfigError
        If a parameter is not allowed, there is neither a target nor ``duration_s``, or a motion is shorter than
        ``duration_s``.
    """

    targets: Sequence[Target]
    radar_position_m: tuple[float, float, float] = (0.0, 0.0, 1.0)
    duration_s: float | None = None
    radar_azimuth_deg: float = 0.0
    radar_tilt_deg: float = 0.0
    receiver_position_m: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        _check_parameters(self, SceneParameters)
        if not isinstance(self.targets, Sequence) or not all(isinstance(target, Target) for target in self.targets):
            raise ConfigError("targets: must be a list of Target")
        if not self.targets and self.duration_s is None:
            raise ConfigError("targets: a scene needs at least one target, or duration_s for an empty room")
        object.__setattr__(self, "targets", tuple(self.targets))
        for number, target in enumerate(self.targets):
            lasts = self._lasts_s(number, target)
            if self.duration_s is not None and lasts < self.duration_s - 1e-6:
                raise ConfigError(
                    f"targets.{number}: its motion ({target.motion.facts.source}) lasts {lasts:.3f} s, the scene "
                    f"{self.duration_s} s; lower duration_s to {math.floor(lasts * 100) / 100} or less"
                )

    def _lasts_s(self, number: int, target: Target) -> float:
        """Duration of a target's motion; a path that it cannot follow for so long is a fault of the target."""
        try:
            return _laid(target, wanted_s=self.duration_s).duration_s
        except (ConfigError, MotionError) as error:
            raise type(error)(f"targets.{number}: {error}") from None

    @property
    def observation_s(self) -> float:
        """Observation time: ``duration_s``, or the shortest motion."""
        if self.duration_s is not None:
            return self.duration_s
        return min(scaled_motion(target).duration_s for target in self.targets)

    @property
    def observed_targets(self) -> tuple[Target, ...]:
        """Targets that are no background, in the order of their numbers in the scatterer table."""
        return tuple(target for target in self.targets if not target.background)

    @property
    def receiver_m(self) -> tuple[float, float, float]:
        """Position of the receiver; the radar's, unless it is bistatic."""
        return self.receiver_position_m if self.receiver_position_m is not None else self.radar_position_m


def scaled_motion(target: Target) -> Motion:
    """The target's motion at its wanted height, on its path if it has one; not yet at its place."""
    return _laid(target)


def _laid(target: Target, *, wanted_s: float | None = None, placed: bool = False) -> Motion:
    motion = target.motion
    if target.height_m is not None:
        motion = scale_to_height(motion, height_m=target.height_m, mode=target.scaling)
    if target.path_spec is None:
        return motion
    if not placed or target.start_position_m is None or target.heading_deg is None:
        return follow(motion, target.path_spec, duration_s=wanted_s)
    position_m, heading_deg = target.start_position_m, target.heading_deg
    return follow(motion, target.path_spec, start_position_m=position_m, heading_deg=heading_deg, duration_s=wanted_s)


def placed_motion(target: Target, scene: Scene) -> Motion:
    """The target's motion, scaled, turned and moved to its place in the scene's world frame."""
    if target.path is not None:
        return _laid(target, wanted_s=scene.duration_s, placed=True)
    motion = scaled_motion(target)
    if target.start_position_m is not None and target.heading_deg is not None:
        return place(motion, position_m=target.start_position_m, heading_deg=target.heading_deg, at_s=0.0)
    middle_s = scene.observation_s / 2.0
    range_m = target.range_m if target.range_m is not None else default_range_m(motion, scene.observation_s)
    bearing = math.radians(target.bearing_deg)
    x, y, _ = scene.radar_position_m
    middle = (x + range_m * math.cos(bearing), y + range_m * math.sin(bearing))
    return place(motion, position_m=middle, heading_deg=target.bearing_deg + 180.0 + target.aspect_deg, at_s=middle_s)


def default_range_m(motion: Motion, observation_s: float) -> float:
    """Ground range at mid-observation when none is asked for: 5 m, more if needed to stay 2 m away."""
    return max(5.0, travel_speed_mps(motion) * observation_s / 2.0 + 2.0)
