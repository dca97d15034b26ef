"""Detections, parameters of the tracker, live tracks and finished tracks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.units import FloatArray
from doppelgait.processing.track.kalman import Gaussian, Model, smooth

Association = Literal["auto", "gnn", "jpda"]


@dataclass(frozen=True)
class Detection:
    """One cluster of range-Doppler cells."""

    range_m: float
    velocity_mps: float
    power_v2: float
    range_sd_m: float
    velocity_sd_mps: float
    range_low_m: float
    range_high_m: float
    velocity_low_mps: float
    velocity_high_mps: float
    n_cells: int


@dataclass(frozen=True)
class Scan:
    """Detections of one coherent processing interval."""

    time_s: float
    detections: tuple[Detection, ...] = ()


class Tracker(FrozenModel):
    """Parameters of the tracker, the same for every class.

    The defaults suit people and pets at about ten scans per second.

    acceleration_noise_m2ps3: Spectral density q of the white acceleration of a walking body; 0.5 to
        1 is usual.
    range_sd_min_m: Lower limit of a detection's standard deviation in range, because limbs move
        between scans.
    velocity_sd_min_mps: Lower limit of a detection's standard deviation in velocity, for the same
        reason.
    start_velocity_sd_mps: Lowest standard deviation of a new track's velocity.
    gate_probability: Share of a track's own detections inside its gate.
    detection_probability: Probability P_D that a moving body is detected in one scan.
    clutter_per_m_mps: False detections per scan, metre and m/s.
    association: ``gnn``: the best joint assignment (global nearest neighbour). ``jpda``: mean over
        all joint events, weighted by their probability. ``auto``: ``jpda`` if the gates of several
        tracks share a detection, otherwise ``gnn``.
    confirm_hits: A track is confirmed by this number of detections in ``confirm_scans`` scans.
    confirm_scans: Number of scans in which ``confirm_hits`` detections confirm a track.
    delete_s: A confirmed track ends after this time without a detection.
    rest_speed_mps: A body that was slower than this when last detected may stand still and have no
        Doppler shift. Its track stays at its range for ``rest_s``, with a growing gate.
    rest_s: Longest time for which a track is kept without detections of a resting body.
    rest_velocity_sd_mps: Standard deviation of the slow motion of a resting body.
    rest_time_constant_s: Time constant with which the velocity of a resting body returns to 0.
    share_s: Longest time of a track inside another body's detection while the two bodies pass each
        other.
    separation_m: No track starts nearer than this to another track: two bodies at this distance
        give one detection.
    twin_s: Two tracks of nearly equal range and velocity that share one detection are one body
        after this time.
    min_duration_s: Shortest time from first to last detection; shorter tracks are dropped.
    still_travel_m: A track is dropped if its travel in range is less than this and its detections
        are narrower in velocity than twice ``still_velocity_mps`` (median). Such a track can be the
        echo that clutter removal leaves at a place where a person stood for half of the recording.
        A person who only breathes is dropped, too. 0 keeps all tracks.
    still_velocity_mps: Half width in velocity below which a detection may be clutter, for
        ``still_travel_m`` and ``still_speed_mps``.
    still_speed_mps: A track is dropped if it is slower than this (median) and, for nine tenths of
        the time, narrower in velocity than twice ``still_velocity_mps``. Such a track is strong
        clutter observed with a drifting clock.
    max_targets: Maximum number of tracks; those with the most detections are kept. All by default.
    fastest_mps: Highest radial velocity that is considered if Doppler is ambiguous.
    """

    acceleration_noise_m2ps3: float = Field(default=0.75, gt=0, le=100)
    range_sd_min_m: float = Field(default=0.05, gt=0, le=5)
    velocity_sd_min_mps: float = Field(default=0.15, gt=0, le=5)
    start_velocity_sd_mps: float = Field(default=0.5, ge=0, le=10)
    gate_probability: float = Field(default=0.99, ge=0.5, lt=1)
    detection_probability: float = Field(default=0.9, gt=0, lt=1)
    clutter_per_m_mps: float = Field(default=0.005, gt=0, le=10)
    association: Association = "auto"
    confirm_hits: int = Field(default=4, ge=1, le=50)
    confirm_scans: int = Field(default=6, ge=1, le=50)
    delete_s: float = Field(default=1.2, gt=0, le=60)
    rest_speed_mps: float = Field(default=0.6, ge=0, le=5)
    rest_s: float = Field(default=6.0, ge=0, le=600)
    rest_velocity_sd_mps: float = Field(default=0.3, gt=0, le=5)
    rest_time_constant_s: float = Field(default=0.3, gt=0, le=10)
    share_s: float = Field(default=3.0, ge=0, le=60)
    separation_m: float = Field(default=0.8, ge=0, le=10)
    twin_s: float = Field(default=1.0, gt=0, le=60)
    min_duration_s: float = Field(default=0.8, ge=0, le=60)
    still_travel_m: float = Field(default=0.3, ge=0, le=10)
    still_velocity_mps: float = Field(default=0.6, ge=0, le=10)
    still_speed_mps: float = Field(default=0.1, ge=0, le=10)
    max_targets: int | None = Field(default=None, ge=1, le=100)
    fastest_mps: float = Field(default=8.0, gt=0, le=50)

    @model_validator(mode="after")
    def _check_hits(self) -> Self:
        if self.confirm_hits > self.confirm_scans:
            raise ValueError(
                f"confirm_hits = {self.confirm_hits} must not be above confirm_scans = {self.confirm_scans}; "
                "set fewer hits or more scans"
            )
        return self


BOX_MEMORY = 0.9  # forgetting factor of the extent per detection
NIS_EXPECTED = 2.0
"""Mean of the normalised innovation squared for a consistent filter with two measured values."""

MEASURED, SHARED, MISSED = "measured", "shared", "missed"


class Step(NamedTuple):
    """One scan of a track; the box has the limits relative to the detection's centre."""

    time_s: float
    model: Model
    predicted: Gaussian
    filtered: Gaussian
    outcome: str
    nis: float = float("nan")
    box: tuple[float, float, float, float] | None = None
    power_v2: float = float("nan")


@dataclass(eq=False)
class LiveTrack:
    """Track in progress; tracks started by the same detection are one family."""

    steps: list[Step]
    family: int
    hits: int = 0
    confirmed_at_s: float | None = None
    duplicate_since_s: float | None = None
    last_sign_s: float = float("-inf")
    last_own: Step = field(init=False)
    last_speed_mps: float = field(init=False)

    def __post_init__(self) -> None:
        self.hits, self.last_own, self.last_sign_s = 1, self.steps[0], self.steps[0].time_s
        self.last_speed_mps = self.state.velocity_mps

    @property
    def state(self) -> Gaussian:
        """State after the last scan."""
        return self.steps[-1].filtered

    def add(self, step: Step, *, share_s: float) -> None:
        """Add a scan to the history."""
        # a shared detection keeps the track alive for share_s after its last own detection
        again = self.steps[-1].outcome == MEASURED
        self.steps.append(step)
        if step.outcome == MEASURED:
            self.hits, self.last_own = self.hits + 1, step
            self.last_speed_mps = step.filtered.velocity_mps if again else self.last_speed_mps
        if step.outcome == MEASURED or (step.outcome == SHARED and step.time_s - self.last_own.time_s <= share_s):
            self.last_sign_s = step.time_s

    def is_slow(self, settings: Tracker) -> bool:
        """Return True if the body may rest. The body was slow enough when last detected."""
        return abs(self.last_speed_mps) < settings.rest_speed_mps


@dataclass(frozen=True, eq=False)
class Track:
    """One body over time, smoothed.

    The track lasts from its first to its last detection.

    Parameters
    ----------
    times_s : ndarray, shape (T,)
        Times of the scans.
    range_m, velocity_mps : ndarray, shape (T,)
        Smoothed values; the velocity is positive when approaching.
    range_sd_m, velocity_sd_mps : ndarray, shape (T,)
        Standard deviations of range and velocity.
    measured : ndarray of bool, shape (T,)
        Scans with an own detection.
    shared : ndarray of bool, shape (T,)
        Scans in which the track was inside another body's detection.
    range_low_m, range_high_m, velocity_low_mps, velocity_high_mps : ndarray, shape (T,)
        Extent around the smoothed centre: the boxes of the detections, averaged with a forgetting factor.
    confirmed_at_s : float
        Time at which a tracker in real time confirms the track.
    mean_nis : float
        Mean normalised innovation squared; about 2 for a consistent filter.
    mean_power_v2 : float
        Mean power of the detections.
    """

    times_s: FloatArray
    range_m: FloatArray
    velocity_mps: FloatArray
    range_sd_m: FloatArray
    velocity_sd_mps: FloatArray
    measured: npt.NDArray[np.bool_]
    shared: npt.NDArray[np.bool_]
    range_low_m: FloatArray
    range_high_m: FloatArray
    velocity_low_mps: FloatArray
    velocity_high_mps: FloatArray
    confirmed_at_s: float
    mean_nis: float
    mean_power_v2: float

    @property
    def first_s(self) -> float:
        """Time of the first detection."""
        return float(self.times_s[0])

    @property
    def last_s(self) -> float:
        """Time of the last detection."""
        return float(self.times_s[-1])

    @property
    def detected_share(self) -> float:
        """Share of scans with an own detection, without those inside another body's detection."""
        return float(self.measured.sum() / np.count_nonzero(~self.shared | self.measured))

    @property
    def confidence(self) -> float:
        """Confidence: ``detected_share``, times 2 / ``mean_nis`` if detections scatter too much."""
        surprise = self.mean_nis / NIS_EXPECTED if np.isfinite(self.mean_nis) else 1.0
        return self.detected_share / max(1.0, surprise)

    def change_arrays(self, change: Callable[[str, npt.NDArray[Any]], npt.NDArray[Any]], **others: Any) -> Track:
        """Apply a function of name and values to every array, and replace other fields."""
        arrays = {name: change(name, values) for name, values in vars(self).items() if isinstance(values, np.ndarray)}
        return replace(self, **(others | arrays))

    def append_track(self, later: Track) -> Track:
        """Append a later track of the same body, keeping the gap between."""
        share = self.times_s.size / (self.times_s.size + later.times_s.size)
        return self.change_arrays(
            lambda name, values: np.concatenate([values, getattr(later, name)]),
            mean_nis=share * self.mean_nis + (1 - share) * later.mean_nis,
            mean_power_v2=share * self.mean_power_v2 + (1 - share) * later.mean_power_v2,
        )


def finish_track(live: LiveTrack) -> Track:
    """Build the smoothed track of a live one, up to its last own detection."""
    stop = max(n for n, step in enumerate(live.steps) if step.outcome == MEASURED) + 1
    steps = live.steps[:stop]
    states = np.array(smooth([s.filtered for s in steps], [s.predicted for s in steps], [s.model for s in steps]))
    # box around the centre: mean of the boxes so far, each with 0.9 times the weight of the next
    boxes = states[:, [0, 0, 1, 1]]
    total, weight = np.zeros(4), 0.0
    for n, step in enumerate(steps):
        if step.box is not None:
            total, weight = BOX_MEMORY * total + np.array(step.box), BOX_MEMORY * weight + 1.0
        boxes[n] += total / weight
    innovations = [s.nis for s in steps if np.isfinite(s.nis)]
    assert live.confirmed_at_s is not None
    return Track(
        times_s=np.array([s.time_s for s in steps]),
        range_m=states[:, 0],
        velocity_mps=states[:, 1],
        range_sd_m=np.sqrt(states[:, 2]),
        velocity_sd_mps=np.sqrt(states[:, 4]),
        measured=np.array([s.outcome == MEASURED for s in steps]),
        shared=np.array([s.outcome == SHARED for s in steps]),
        range_low_m=boxes[:, 0],
        range_high_m=boxes[:, 1],
        velocity_low_mps=boxes[:, 2],
        velocity_high_mps=boxes[:, 3],
        confirmed_at_s=live.confirmed_at_s,
        mean_nis=float(np.mean(innovations)) if innovations else float("nan"),
        mean_power_v2=float(np.mean([s.power_v2 for s in steps if s.outcome == MEASURED])),
    )


def find_box(detection: Detection) -> tuple[float, float, float, float]:
    """Return the limits of a detection relative to its centre."""
    return (
        detection.range_low_m - detection.range_m,
        detection.range_high_m - detection.range_m,
        detection.velocity_low_mps - detection.velocity_mps,
        detection.velocity_high_mps - detection.velocity_mps,
    )
