"""Targets and scenes, described in TOML or Python."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import BeforeValidator, ConfigDict, Field, SerializeAsAny, field_validator, model_validator

from doppelgait.core.config import FrozenModel, InnerError, as_table, read_toml, validate, write_toml
from doppelgait.core.errors import ConfigError
from doppelgait.core.notebook import plot, show_text
from doppelgait.motion.motion import Motion
from doppelgait.motion.paths import Path, make_path
from doppelgait.motion.retime import ScalingMode, Variation
from doppelgait.scene.rcs import RCS, RcsSpec

LEAST_STAY_S = 0.6
"""Least time of a body in a scene: it appears for half of it and fades for the other half."""
DEFAULT_DURATION_S = 5.0  # observation time of a scene in which all motions are models


def _parse_motion(value: Any) -> Any:
    """Parse a motion: an object, a table, or model parameters."""
    # an object is a motion in memory; a table has a kind
    if isinstance(value, Motion):
        return value
    if isinstance(value, str | FilePath):
        file = isinstance(value, FilePath) or "." in value
        value = {"kind": "file", "path": str(value)} if file else {"kind": value}
    if isinstance(value, FrozenModel):
        value = as_table(value)
    if not isinstance(value, Mapping):
        raise ValueError(f'must be a Motion or a table {{ kind = "NAME", ... }}, not {type(value).__name__}')
    if not isinstance(value.get("kind"), str):
        raise ValueError('needs kind = "NAME" (a motion model, or "file" with path = "...")')
    kind = value["kind"]
    if kind == "file":
        if not isinstance(value.get("path"), str) or not value["path"]:
            raise ValueError('kind "file" needs path = "..."')
        return dict(value)
    from doppelgait.motion.models.registry import check_table

    try:
        return check_table(value, where=f"kind {kind!r}")
    except ConfigError as error:
        raise InnerError(error) from None


def _parse_rcs(value: Any) -> Any:
    """Parse an RCS name or table."""
    table = {"kind": value} if isinstance(value, str) else value
    if not isinstance(table, Mapping) or (kind := table.get("kind")) is None or kind not in RCS:
        return table
    model = RCS[kind].parameters or RcsSpec
    if model is RcsSpec:
        return table
    try:
        return validate(model, table, where=f"kind {kind!r}")
    except ConfigError as error:
        raise InnerError(error) from None


def _convert_array(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


class Target(FrozenModel):
    """Body of a scene: motion, place, radar cross section.

    Parameters
    ----------
    motion : Motion, table, str or Path
        A cleaned recording or a model's motion, or the table of a scene file: ``kind`` names a
        motion model, whose parameters are the other keys; ``kind = "file"`` takes ``path``
        (relative to the scene file) and the options of its reader, such as ``start_s`` and
        ``stop_s``. A string is the name of a model or the path of a file.
    label : str
        Class of the target, for example ``"human"`` or ``"dog"``.
    rcs : RcsSpec or str
        Radar cross section; a string is its ``kind``.
    height_m : float, optional
        Scale the body to this stature (people) or withers height (dogs); as recorded by default.
    scaling : {"uniform", "froude", "z_only"}
        How ``height_m`` changes lengths and times (E-01).
    range_m : float, optional
        Ground range of the body centre from the radar at the middle of its time in the scene; by
        default 5 m, or the minimum range at which the body stays at least 2 m from the radar.
    bearing_deg : float
        Direction of that point as seen from the radar, from +x towards +y.
    aspect_deg : float
        Aspect angle psi between the walking direction and the direction to the radar at that point:
        0 approaching, 180 receding, positive counter-clockwise.
    start_position_m : (float, float), optional
        Ground position of the body centre at the start, used with ``heading_deg`` instead of range, bearing and aspect.
    heading_deg : float, optional
        Direction of travel at ``start_position_m``, from +x towards +y.
    path : Path or table, optional
        Path over the ground (:mod:`doppelgait.motion.paths`) in the frame of ``start_position_m``
        and ``heading_deg``, which must be set; a straight path by default.
    vary : Variation or table, optional
        Differences of the motion from its model or recording (:mod:`doppelgait.motion.retime`).
    enter_s : float
        Time at which the body comes into the scene and its motion starts. It appears within 0.3 s.
    leave_s : float, optional
        Time at which it goes out of the scene, fading within 0.3 s; by default it stays.
    background : bool
        True for a body that scatters but is not a target, such as a fan or a curtain. It has no
        truth and no result, and its scatterers have the target number -2.

    Raises
    ------
    ConfigError
        If a parameter is not allowed, only one of ``start_position_m`` and ``heading_deg`` is set,
        both forms of position are used, or a path has no start.

    Examples
    --------
    >>> import doppelgait as dg
    >>> target = dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human", range_m=4.0)
    >>> table = dg.scene.assemble(dg.Scene([target], duration_s=2.0), [0.0, 1.0])
    >>> table["range"].mean("scatterer").values.round(1)  # after 0 s, and 4 m in the middle
    array([5.2, 4. ])
    """

    model_config = ConfigDict(arbitrary_types_allowed=True)
    POSITIONAL: ClassVar[tuple[str, ...]] = ("motion", "label", "rcs")

    motion: Annotated[Any, BeforeValidator(_parse_motion)]
    label: str = ""
    rcs: Annotated[SerializeAsAny[RcsSpec], BeforeValidator(_parse_rcs)] = RcsSpec()
    height_m: float | None = Field(default=None, gt=0, le=5)
    scaling: ScalingMode = "uniform"
    range_m: float | None = Field(default=None, gt=0, le=1e5)
    bearing_deg: float = Field(default=0.0, ge=-360, le=360)
    aspect_deg: float = Field(default=0.0, ge=-360, le=360)
    start_position_m: tuple[float, float] | None = None
    heading_deg: float | None = Field(default=None, ge=-360, le=360)
    path: SerializeAsAny[Path] | None = None
    vary: Variation | None = None
    enter_s: float = Field(default=0.0, ge=0, le=3600)
    leave_s: float | None = Field(default=None, gt=0, le=3600)
    background: bool = False

    if TYPE_CHECKING:

        def __init__(self, motion: Any, label: str = "", rcs: Any = ..., **parameters: Any) -> None: ...

    def __repr__(self) -> str:
        return f"Target({self.describe()})"

    def describe(self) -> str:
        """Return class, motion and place in a few words."""
        motion = self.motion.label if isinstance(self.motion, Motion) else self.motion.get("path", self.motion["kind"])
        words = [self.label or "no label", f"({motion})"]
        if self.start_position_m is not None:
            words.append("from " + ", ".join(f"{value:g}" for value in self.start_position_m) + " m")
        elif self.range_m is not None:
            words.append(f"at {self.range_m:g} m")
        if self.path is None and self.start_position_m is None and self.aspect_deg:
            words.append(f"aspect {self.aspect_deg:g} deg")
        return " ".join(words)

    @field_validator("path", mode="before")
    @classmethod
    def _parse_path(cls, path: Any) -> Any:
        try:
            return path if path is None else make_path(path)
        except ConfigError as error:
            raise InnerError(error) from None

    _take_arrays = field_validator("start_position_m", mode="before")(_convert_array)

    @model_validator(mode="after")
    def _has_one_place(self) -> Self:
        if (self.start_position_m is None) != (self.heading_deg is None):
            raise ValueError("start_position_m and heading_deg belong together: set both or neither")
        relative = self.range_m is not None or self.bearing_deg != 0 or self.aspect_deg != 0
        if self.start_position_m is not None and relative:
            raise ValueError("set either start_position_m and heading_deg, or range_m, bearing_deg and aspect_deg")
        if self.path is not None and self.start_position_m is None:
            raise ValueError(
                "a path needs start_position_m and heading_deg: its origin and the direction of its x axis"
            )
        return self

    def find_stay_s(self, observation_s: float) -> tuple[float, float]:
        """Return the times at which the body comes and goes."""
        return self.enter_s, observation_s if self.leave_s is None else min(self.leave_s, observation_s)


class Scene(FrozenModel):
    """Targets and one radar position.

    Parameters
    ----------
    targets : sequence of Target
        Bodies in the scene. Empty for an empty room; ``duration_s`` is then required.
    radar_position_m : (float, float, float)
        Position of the radar (of the transmitter of a bistatic radar); z is the height above the floor.
    duration_s : float, optional
        Observation time T_o; by default the duration of the shortest motion, or 5 s if all motions are models.
    radar_azimuth_deg : float
        Azimuth of the antenna's boresight, from +x towards +y, -360 to 360 degrees. It has no
        effect for an isotropic antenna.
    radar_tilt_deg : float
        Tilt of the boresight up from the horizontal, -90 to 90 degrees. It has no effect for an isotropic antenna.
    receiver_position_m : (float, float, float), optional
        Position of the receiver of a bistatic radar; at ``radar_position_m`` by default.

    Raises
    ------
    ConfigError
        If a parameter is not allowed, or neither a target nor ``duration_s`` is set.

    See Also
    --------
    place : Make, scale and place every motion of a scene.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=2.0)
    >>> print(scene.to_toml())
    targets = [
        { motion = { kind = "boulic", speed_mps = 1.2 }, label = "human" },
    ]
    duration_s = 2.0
    <BLANKLINE>
    """

    POSITIONAL: ClassVar[tuple[str, ...]] = ("targets", "radar_position_m", "duration_s")

    targets: tuple[Target, ...] = ()
    radar_position_m: tuple[float, float, float] = (0.0, 0.0, 1.0)
    duration_s: float | None = Field(default=None, gt=0, le=3600)
    radar_azimuth_deg: float = Field(default=0.0, ge=-360, le=360)
    radar_tilt_deg: float = Field(default=0.0, ge=-90, le=90)
    receiver_position_m: tuple[float, float, float] | None = None

    if TYPE_CHECKING:

        def __init__(
            self, targets: Any = (), radar_position_m: Any = ..., duration_s: Any = ..., **parameters: Any
        ) -> None: ...

    @field_validator("targets", mode="before")
    @classmethod
    def _refuse_one_target(cls, value: Any) -> Any:
        if isinstance(value, Target | Motion):
            raise ValueError("must be a list of Target")
        return value

    _take_arrays = field_validator("radar_position_m", "receiver_position_m", mode="before")(_convert_array)

    @model_validator(mode="after")
    def _has_duration(self) -> Self:
        if not self.targets and self.duration_s is None:
            raise ValueError("targets: must have at least 1 item ([[targets]]), or give duration_s for an empty room")
        for number, target in enumerate(self.targets):
            if target.enter_s == 0 and target.leave_s is None:
                continue
            if self.duration_s is None:
                raise ValueError(f"targets.{number}: enter_s and leave_s need the duration_s of the scene")
            enter_s, leave_s = target.find_stay_s(self.duration_s)
            if leave_s - enter_s < LEAST_STAY_S:
                raise ValueError(
                    f"targets.{number}: is in the scene from {enter_s:g} to {leave_s:g} s; a body stays for "
                    f"{LEAST_STAY_S:g} s or more, within duration_s"
                )
        return self

    @classmethod
    def from_toml(cls, path: str | FilePath) -> Scene:
        """Read the scene of a TOML file.

        Relative paths of motion files are resolved against its folder.

        Parameters
        ----------
        path : path
            TOML file. The sections of a run (``radar``, ``noise``, ...) are ignored; read them with
            :meth:`doppelgait.pipeline.Run.from_toml`.

        Raises
        ------
        ConfigError
            If a value is not allowed; the message names the dotted key, its line, the value and the allowed values.
        """
        table, text = read_toml(path)
        own = {key: value for key, value in table.items() if key in cls.model_fields}
        return resolve_file_paths(validate(cls, own, where=str(path), text=text), FilePath(path).resolve().parent)

    def to_toml(self) -> str:
        """Write the scene as TOML text that :meth:`from_toml` reads back.

        Raises
        ------
        ConfigError
            If a motion is an object in memory.
        """
        for number, target in enumerate(self.targets):
            if isinstance(target.motion, Motion):
                raise ConfigError(
                    f"targets.{number}.motion: {target.motion.label} is in memory and has no TOML form; use a "
                    'model, { kind = "...", ... }, or a file, { kind = "file", path = "..." }'
                )
        return write_toml(as_table(self))

    def plot(self, *, ax: Any = None) -> Any:
        """Plot the scene from above, on axes or a new figure: radar, starts and headings."""
        return plot("scene", self, ax=ax)

    def __repr__(self) -> str:
        return show_text("Scene", self.tabulate_facts())

    def tabulate_facts(self) -> dict[str, str]:
        """Return targets, duration and radar position in words."""
        return {
            "targets": "; ".join(target.describe() for target in self.targets) or "none",
            "duration": self._describe_duration(),
            "radar at": ", ".join(f"{value:g}" for value in self.radar_position_m) + " m",
        }

    def _describe_duration(self) -> str:
        """Return the observation time in words. No motion is made or read for it."""
        if self.duration_s is not None:
            return f"{self.duration_s:g} s"
        if any(
            target.path is not None
            or target.vary is not None
            or target.scaling == "froude"
            or (not isinstance(target.motion, Motion) and target.motion["kind"] == "file")
            for target in self.targets
        ):
            return "that of the shortest motion"
        lasts_s = (target.motion.duration_s for target in self.targets if isinstance(target.motion, Motion))
        return f"{min(lasts_s, default=DEFAULT_DURATION_S):g} s"

    @property
    def observed_targets(self) -> tuple[Target, ...]:
        """Targets that are not background, in the order of the scatterer table."""
        return tuple(target for target in self.targets if not target.background)


def resolve_file_paths(scene: Scene, folder: FilePath) -> Scene:
    """Resolve relative paths of motion files against a folder."""

    def resolve(target: Target) -> Target:
        motion = target.motion
        if isinstance(motion, Motion) or motion["kind"] != "file":
            return target
        return target.model_copy(update={"motion": within(motion)})

    def within(motion: Mapping[str, Any]) -> dict[str, Any]:
        table = {**motion, "path": str(folder / motion["path"])}
        hybrid = table.get("hybrid")
        if isinstance(hybrid, Mapping) and isinstance(hybrid.get("other"), Mapping):
            table["hybrid"] = {**hybrid, "other": within(hybrid["other"])}
        return table

    return scene.model_copy(update={"targets": tuple(resolve(target) for target in scene.targets)})
