"""Motions: labelled positions of named points, with facts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import MotionError
from doppelgait.core.labels import (
    MOTION,
    SPACE,
    Signal,
    check_signal,
    describe_points,
    labels_on_demand,
    read_axis,
    sampling_rate_hz,
)
from doppelgait.core.lazy import xr
from doppelgait.core.notebook import show_text
from doppelgait.core.units import FloatArray

NAN = float("nan")
GRAVITY_MPS2 = 9.81
FREQUENCIES = ("stride_frequency_hz", "step_frequency_hz", "gait_frequency_hz")


@dataclass(frozen=True)
class PathFacts:
    """Facts of the path that a motion follows."""

    kind: str
    length_m: float
    mean_speed_mps: float
    pause_s: float
    stops_m: tuple[float, ...] = ()


@dataclass(frozen=True)
class MotionFacts:
    """Facts about a motion and its body, some unknown.

    Parameters
    ----------
    source, kind : str
        File name or name of the model, and ``"recording"`` or the name of the model.
    subject : str
        Person or animal; leakage-free splits group rows by it.
    species, gait : str
        ``"human"``, ``"dog"``, ...; ``"walk"``, ``"run"``, ``"trot"``, ``"gallop"``, ...
    height_m : float
        Stature of a person, withers height of a dog or cat.
    stride_frequency_hz, step_frequency_hz, gait_frequency_hz : float
        Strides and steps per second, and f_mu, the fundamental of the signature (E-07).
    footfalls : mapping of str to sequence of float
        Touchdown times in s by foot, if they are exactly known.
    stride_from : str
        ``"footfalls"`` or ``"autocorrelation"`` if the stride frequency was measured.
    path : PathFacts, optional
        Facts of the path, if the motion follows one.
    file_time_s : float
        Time of the recording, from its first frame, at time 0 of the motion.
    """

    source: str = ""
    kind: str = ""
    subject: str = ""
    licence: str = ""
    species: str = ""
    gait: str = ""
    height_m: float = NAN
    mass_kg: float = NAN
    stride_frequency_hz: float = NAN
    step_frequency_hz: float = NAN
    gait_frequency_hz: float = NAN
    footfalls: Mapping[str, Sequence[float]] = field(default_factory=dict)
    stride_from: str = ""
    path: PathFacts | None = None
    file_time_s: float = 0.0

    def with_frequencies(self, change: Callable[[float], float]) -> MotionFacts:
        """Return the facts with a function applied to stride, step and gait frequency."""
        changed: dict[str, Any] = {name: change(getattr(self, name)) for name in FREQUENCIES}
        return replace(self, **changed)


@labels_on_demand("positions")
@dataclass(frozen=True, eq=False)
class Motion:
    """Positions of named points over time, with facts.

    Parameters
    ----------
    positions : DataArray (time, marker, space)
        Positions in m, z up, floor at z = 0; NaN where a point was not seen (before cleaning). The
        coordinate ``part`` along ``marker`` is the body part of each point, ``""`` if unknown.
        Other dimensions, coordinates or units raise AnalysisError.
    facts : MotionFacts
        Facts that doppelgait uses: frequencies, footfalls, height, subject.
    report : mapping
        Notes of reading and cleaning for the user. They have no effect on later steps.
    """

    positions: xr.DataArray
    facts: MotionFacts = field(default_factory=MotionFacts)
    report: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self._kept, Signal) or self._kept.values.dtype.kind != MOTION.kind:
            check_signal(self.positions, MOTION)

    @property
    def _kept(self) -> Any:
        # plain positions, or labelled ones after somebody has read the labels
        return self.__dict__["positions"]

    @property
    def position_m(self) -> npt.NDArray[Any]:
        """Positions as a plain array, (T, P, 3), m."""
        return np.asarray(self._kept.values)

    @property
    def time_s(self) -> FloatArray:
        """Times of the frames, shape (T,)."""
        return read_axis(self._kept, "time")

    def __repr__(self) -> str:
        facts = self.facts
        shown = {
            "source": self.label,
            "species": facts.species,
            "gait": facts.gait,
            "points": str(self.positions.sizes["marker"]),
            "time": f"{self.duration_s:.4g} s at {self.rate_hz:g} Hz",
            "stride frequency": "" if not facts.stride_frequency_hz > 0 else f"{facts.stride_frequency_hz:.3g} Hz",
        }
        return show_text("Motion", shown)

    @property
    def rate_hz(self) -> float:
        """Frames per second."""
        stated = self._kept.attrs.get("rate_hz")
        return float(stated) if stated is not None else sampling_rate_hz(self.time_s)

    @property
    def duration_s(self) -> float:
        """Time from the first to the last frame."""
        times = self.time_s
        return float(times[-1] - times[0])

    @property
    def n_frames(self) -> int:
        """Number of frames T."""
        return int(self._kept.shape[0])

    @property
    def markers(self) -> list[str]:
        """Names of the points."""
        return [*map(str, read_axis(self._kept, "marker").tolist())]

    @property
    def parts(self) -> list[str]:
        """Body part of each point, ``""`` if unknown."""
        return [*map(str, read_axis(self._kept, "part").tolist())]

    @property
    def label(self) -> str:
        """Source of the motion for messages."""
        return self.facts.source or "motion"

    def with_positions(self, position_m: npt.NDArray[Any]) -> Motion:
        """Return the motion with other point positions."""
        return replace(self, positions=Signal.of(self._kept, MOTION).replace(position_m))  # type: ignore[arg-type]

    def with_facts(self, **facts: Any) -> Motion:
        """Return the motion with some facts replaced."""
        return replace(self, positions=self._kept, facts=replace(self.facts, **facts))

    def with_report(self, **entries: Any) -> Motion:
        """Return the motion with entries added to its report."""
        return replace(self, positions=self._kept, report={**self.report, **entries})

    def with_points(self, position_m: npt.NDArray[Any], markers: Sequence[str], parts: Sequence[str]) -> Motion:
        """Return a motion of other points (T, P, 3) with the same times and facts."""
        signal = describe_points(position_m, self.time_s, markers, parts, rate_hz=self.rate_hz)
        return replace(self, positions=signal)  # type: ignore[arg-type]

    def remake(self, position_m: npt.NDArray[Any], facts: MotionFacts, **changes: Any) -> Motion:
        """Return a motion of the same points in other frames, from time 0."""
        same: dict[str, Any] = {
            "rate_hz": self.rate_hz,
            "markers": self.markers,
            "parts": self.parts,
            "report": self.report,
        }
        return make_motion(position_m, facts=facts, **same | changes)

    def frames(self, first: int, stop: int) -> Motion:
        """Return frames ``first`` to ``stop`` - 1 with their times."""
        return replace(self, positions=Signal.of(self._kept, MOTION).take_columns(slice(first, stop)))  # type: ignore[arg-type]

    def cut(self, first: int, stop: int) -> Motion:
        """Return frames ``first`` to ``stop`` - 1 from time 0, with footfalls."""
        part = Signal.of(self._kept, MOTION).take_columns(slice(first, stop))
        dims, times, attrs = part.coords["time"]
        coords = {**part.coords, "time": (dims, np.arange(times.size) / self.rate_hz, attrs)}
        positions = Signal(MOTION, part.values, coords, part.attrs)
        start, end = times[0], times[-1]
        footfalls = {
            foot: [t - start for t in touchdowns if start <= t <= end]
            for foot, touchdowns in self.facts.footfalls.items()
        }
        before_s = self.facts.file_time_s + float(start)
        return replace(self, positions=positions, facts=replace(self.facts, footfalls=footfalls, file_time_s=before_s))  # type: ignore[arg-type]


def require_motion(motion: object) -> Motion:
    """Return a motion unchanged, or raise :class:`MotionError`."""
    if not isinstance(motion, Motion):
        raise MotionError(
            f"a motion must be a doppelgait.motion.Motion, not {type(motion).__name__}: use a model, read() or "
            "make_motion()"
        )
    return motion


def make_motion(
    position_m: npt.ArrayLike,
    *,
    rate_hz: float,
    markers: Sequence[str],
    parts: Sequence[str],
    start_s: float = 0.0,
    facts: MotionFacts | Mapping[str, Any] | None = None,
    report: Mapping[str, Any] | None = None,
) -> Motion:
    """Build a motion from plain arrays.

    Parameters
    ----------
    position_m : array_like, shape (T, P, 3)
        Positions in m, z up, floor at z = 0; NaN where a point was not seen (before cleaning).
    rate_hz : float
        Frames per second, positive.
    markers, parts : sequence of str, length P
        Unique names of the points, and their body parts, ``""`` if unknown.
    start_s : float
        Time of the first frame.
    facts : MotionFacts or mapping, optional
        Facts, or some of their values by name; an unknown name raises MotionError.
    report : mapping, optional
        Notes for the user.

    Examples
    --------
    >>> import numpy as np
    >>> import doppelgait as dg
    >>> still = dg.motion.make_motion(np.zeros((5, 1, 3)), rate_hz=100.0, markers=["head"], parts=["head"])
    >>> still.duration_s
    0.04
    """
    if not isinstance(facts, MotionFacts):
        allowed = [one.name for one in fields(MotionFacts)]
        if unknown := sorted(set(facts or {}) - set(allowed)):
            raise MotionError(f"motion facts {', '.join(unknown)} are not known; allowed are {', '.join(allowed)}")
        facts = MotionFacts(**(facts or {}))
    values = np.asarray(position_m, dtype=np.float64)
    labels = _make_labels(tuple(markers), tuple(parts), values.shape[0], float(rate_hz), float(start_s))
    return Motion(labels.replace(values), facts, dict(report or {}))  # type: ignore[arg-type]


@lru_cache(maxsize=16)
def _make_labels(
    markers: tuple[str, ...], parts: tuple[str, ...], frames: int, rate_hz: float, start_s: float
) -> Signal:
    """Make and cache the coordinates of a motion without values."""
    # a model uses the same points and times repeatedly
    values = np.broadcast_to(0.0, (frames, len(markers), len(SPACE)))
    return describe_points(values, start_s + np.arange(frames) / rate_hz, markers, parts, rate_hz=rate_hz)
