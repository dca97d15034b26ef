"""Runs and target views, with analysed targets' truth."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from threading import RLock
from typing import Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt

from doppelgait import processing
from doppelgait.core.config import validate
from doppelgait.core.errors import AnalysisError, DoppelgaitError, DoppelgaitWarning
from doppelgait.core.frames import Frames
from doppelgait.core.units import velocity_to_doppler_hz
from doppelgait.pipeline import Result, analyze
from doppelgait.processing import Analysis
from doppelgait.processing.clutter import clean_frames
from doppelgait.processing.gate import Gate, GateChoice
from doppelgait.processing.signature import compute_signature, plan_for
from doppelgait.radar.recording import Recording, TargetTruth
from doppelgait.viewer.payload import signature_picture
from doppelgait.viewer.settings import CHANGEABLE, Changes, Settings

Span = tuple[float, float]
"""Start and stop in s."""

NEAR_M = 0.8  # largest median distance of a gate from its body
STILL = ("", "stand")  # gaits without steps
DIGITS = 6  # decimals of a true speed; rounding errors of a motionless model become 0


def find_span(result: Result) -> Span:
    """Return start and stop of a segment or gate."""
    quality, gate = result.quality, result.gate
    return float(quality.get("start_s", gate.start_s)), float(quality.get("stop_s", gate.stop_s))


def match_truths(recording: Recording, results: Sequence[Result]) -> list[TargetTruth | None]:
    """Match every result to a body of the simulation."""
    times_s = recording.slow_time_s
    # Number of the body for every result.
    found: list[int | None] = [None] * len(results)
    pairs = []
    for number, body in product(range(len(results)), range(len(recording.truth))):
        result = results[number]
        if result.gate.source == "truth":
            found[number] = number if number < len(recording.truth) else None
        elif result.gate.source == "given":
            # The body that is inside a fixed gate for most of the time; None for several or none.
            low_m, high_m = float(result.gate.low_m[0]), float(result.gate.high_m[0])
            ranges_m = [one.centre_range_m for one in recording.truth]
            inside = [n for n, each_m in enumerate(ranges_m) if low_m < np.nanmedian(each_m) < high_m]
            touched = [n for n, each_m in enumerate(ranges_m) if ((each_m > low_m) & (each_m < high_m)).any()]
            found[number] = inside[0] if len(inside) == 1 and touched == inside else None
        else:
            pairs.append((_distance_m(recording.truth[body], times_s, result, find_span(result)), number, body))
    for distance_m, number, body in sorted(pairs):
        if distance_m >= NEAR_M or found[number] is not None:
            continue
        start_s, stop_s = find_span(results[number])
        spans = [find_span(results[n]) for n, known in enumerate(found) if known == body]
        if not any(start_s < other_stop_s and other_start_s < stop_s for other_start_s, other_stop_s in spans):
            found[number] = body
    return [None if body is None else recording.truth[body] for body in found]


def _distance_m(truth: TargetTruth, times_s: npt.NDArray[np.float64], result: Result, span: Span) -> float:
    """Return a gate's median distance from a body."""
    chosen = _select_pulses(times_s, span)
    middle_m = result.gate.centre_at(times_s[chosen])
    return float(np.median(np.nan_to_num(np.abs(middle_m - truth.centre_range_m[chosen]), nan=np.inf)))


def _select_pulses(times_s: npt.NDArray[np.float64], span: Span) -> npt.NDArray[np.bool_]:
    """Select the pulses between two times, or all."""
    inside = (times_s >= span[0] - 1e-9) & (times_s <= span[1] + 1e-9)
    return inside if inside.any() else np.ones(times_s.shape, dtype=bool)


def find_true_values(
    recording: Recording, truth: TargetTruth | None, result: Result, span: Span
) -> dict[str, Any] | None:
    """Return the true values of a result's body during a time."""
    times_s = recording.slow_time_s
    if truth is None or (result.gate.source == "track" and _distance_m(truth, times_s, result, span) >= NEAR_M):
        return None
    return compute_true_values(truth, recording.radar.wavelength_m, _select_pulses(times_s, span))


def compute_true_values(truth: TargetTruth, wavelength_m: float, during: npt.NDArray[np.bool_]) -> dict[str, Any]:
    """Return the true features and frequencies by their names."""
    seen_mps = truth.centre_velocity_mps[during]
    radial_mps = round(float(np.nan_to_num(seen_mps).sum() / max(np.isfinite(seen_mps).sum(), 1)), DIGITS) + 0.0
    steps = truth.gait not in STILL and truth.gait_frequency_hz > 0
    ground = steps and truth.ground_speed_mps is not None
    return {
        "torso_velocity_mps": radial_mps,
        "torso_doppler_hz": float(velocity_to_doppler_hz(radial_mps, wavelength_m)),
        "step_length_m": abs(radial_mps) / truth.gait_frequency_hz if steps else None,
        "ground_step_length_m": truth.ground_speed_mps / truth.gait_frequency_hz if ground else None,
        "breathing_rate_hz": truth.gait_frequency_hz or None if truth.gait == "stand" else None,
        "harmonic_ratio_2": 2.0 if steps else None,
        "harmonic_ratio_3": 3.0 if steps else None,
        "gait_frequency_hz": truth.gait_frequency_hz if steps else None,
        "step_frequency_hz": truth.step_frequency_hz,
        "stride_frequency_hz": truth.stride_frequency_hz,
        "ground_speed_mps": truth.ground_speed_mps,
        "height_m": truth.height_m,
        "label": truth.label,
        "gait": truth.gait,
    }


T = TypeVar("T")
Picture = tuple[dict[str, Any], npt.NDArray[np.uint16]]
Kind = Literal["recording", "result", "example", "try"]
TRACK_FACTS = (
    "track_start_s",
    "track_stop_s",
    "track_confirmed_at_s",
    "track_confidence",
    "track_range_m",
    "n_pieces",
)
"""Quality of the whole track, repeated for each of its segments."""
MOST_ANALYSES = 2
"""Largest number of stored analyses of a run, by gate and settings; that of a minute at 1 kHz
needs 150 MB."""
MOST_KEPT = 8  # largest number of other stored values of a run, such as its first pictures


@dataclass(frozen=True)
class TargetView:
    """Result of a target, with its truth and the shown segment."""

    result: Result
    truth: Mapping[str, Any] | None = None
    spans: tuple[Span, ...] = ()
    segment: int | None = None
    segment_views: tuple[TargetView, ...] = ()
    track_picture: Picture | None = None


Analysed = tuple[list[TargetView], list[str]]
"""Targets, and the warnings of their analysis."""


@dataclass(eq=False)
class Run:
    """Recording with its analyses, computed on first use; only targets need one thread."""

    name: str
    kind: Kind
    settings: Settings = field(default_factory=Settings)
    load: Callable[[], Recording] | None = None
    reason: str = ""
    stored: Callable[[], Sequence[TargetView]] | None = None
    notes: tuple[str, ...] = ()
    _analyses: dict[tuple[GateChoice, str], Analysed] = field(default_factory=dict, repr=False)
    _kept: dict[str, Any] = field(default_factory=dict, repr=False)
    _clean: tuple[str, Frames] | None = field(default=None, repr=False)
    _lock: RLock = field(default_factory=RLock, repr=False)  # pictures are made during tracking

    @cached_property
    def recording(self) -> Recording | None:
        """The recording, or None with ``reason``."""
        if self.load is None:
            return None
        try:
            return self.load()
        except DoppelgaitError as error:
            self.reason = str(error)
            return None

    def require_recording(self) -> Recording:
        """Return the recording, or raise AnalysisError with the reason."""
        if self.recording is None:
            raise AnalysisError(f"{self.name}: there is no recording for this: {self.reason}")
        return self.recording

    def analysis(self, gate: GateChoice | None, changes: Changes = ()) -> Analysis:
        """Return the analysis parameters of targets in a gate.
        Static clutter of a recording is removed by the median unless the user chooses a method.
        """
        known = self.settings.analysis
        if changes:
            known = validate(Analysis, {**known.model_dump(exclude_unset=True), **dict(changes)})
        if self.kind == "try":
            return known.resolved(None)  # tracking also keeps the clutter
        return known.resolved("track" if self.kind == "recording" else gate or self.settings.gate)

    def analysis_facts(self, gate: GateChoice | None, changes: Changes = ()) -> dict[str, Any]:
        """Return the analysis parameters that a request may change.
        If there is a recording, the hop is the one in use, in pulses.
        """
        analysis = self.analysis(gate, changes)
        facts = {name: getattr(analysis, name) for name in CHANGEABLE}
        slow_time = None if self.recording is None else self.recording.frames.slow_time.find_bursts()
        if facts["hop"] is None and slow_time is not None and slow_time.burst_pulses is None:
            with suppress(AnalysisError):
                facts["hop"] = plan_for(slow_time, analysis).hop
        return facts

    def clean_frames(self, gate: GateChoice | None, changes: Changes = ()) -> Frames:
        """Return the frames without clutter, as they are analysed."""
        analysis = self.analysis(gate, changes)
        key = clutter_key(analysis)
        # only one is stored: it may be as large as the recording
        with self._lock:
            if self._clean is None or self._clean[0] != key:
                self._clean = None
                frames = self.require_recording().frames.find_bursts()
                self._clean = key, clean_frames(frames, analysis)
            return self._clean[1]

    def keep(self, name: str, make: Callable[[], T]) -> T:
        """Return a cached value, computing it on first use."""
        with self._lock:
            if name not in self._kept:
                while len(self._kept) >= MOST_KEPT:
                    self._kept.pop(next(iter(self._kept)))
                self._kept[name] = make()
            kept: T = self._kept[name]
        return kept

    def targets(self, gate: GateChoice | None, changes: Changes = ()) -> list[TargetView]:
        """Return the targets in a gate."""
        return self.analyse(gate, changes)[0]

    def analyse(self, gate: GateChoice | None, changes: Changes = ()) -> Analysed:
        """Return the targets in a gate, and the warnings of their analysis.
        Without a gate these are the stored targets, or those in the gate that is shown first.
        """
        if (stored := self.stored) is not None and gate is None:
            return self.keep("stored", lambda: (list(stored()), []))
        done, chosen = self.analysis(gate, changes), gate or self.settings.gate
        key = (chosen, done.model_dump_json())

        def views() -> list[TargetView]:
            recording, found = self.require_recording(), list[TargetView]()
            results = analyze(recording, gate=chosen, analysis=done, tracking=self.settings.tracking)
            clean, wavelength_m = self.clean_frames(gate, changes), recording.radar.wavelength_m
            for result, truth in zip(results, match_truths(recording, results), strict=True):
                picture = None
                if result.segments:
                    picture = make_gate_picture(clean, result.gate, result.analysis, wavelength_m)
                found.append(replace(make_view(result, recording, truth), track_picture=picture))
            return found

        if key not in self._analyses:
            while len(self._analyses) >= MOST_ANALYSES:
                self._analyses.pop(next(iter(self._analyses)))
            self._analyses[key] = collect_warnings(views)
        return self._analyses[key]


def make_gate_picture(clean: Frames, gate: Gate, analysis: Analysis, wavelength_m: float) -> Picture:
    """Encode the signature of a gate: a whole track, all ranges, or a part of either."""
    signature = compute_signature(gate.crop(clean), gate, analysis, wavelength_m=wavelength_m)
    return signature_picture(processing.crop_to_frame(signature)[0].label(), "signature")


def clutter_key(analysis: Analysis) -> str:
    """Return a key for the removal of static clutter."""
    return f"{analysis.clutter} {analysis.clutter_time_s}"


def collect_warnings(make: Callable[[], T]) -> tuple[T, list[str]]:
    """Call a function and return its result and doppelgait's warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DoppelgaitWarning)
        made = make()
    texts = [str(one.message) for one in caught if issubclass(one.category, DoppelgaitWarning)]
    return made, list(dict.fromkeys(texts))


def make_view(result: Result, recording: Recording | None = None, truth: TargetTruth | None = None) -> TargetView:
    """Build the view of a target."""

    def find_truth(span: Span) -> dict[str, Any] | None:
        return None if recording is None else find_true_values(recording, truth, result, span)

    spans = tuple(find_span(segment) for segment in result.segments)
    facts = {key: value for key, value in result.quality.items() if key in TRACK_FACTS}
    views = []
    for number, (segment, span) in enumerate(zip(result.segments, spans, strict=True)):
        shown = replace(segment, gate_limits=result.gate, quality={**segment.quality, **facts})
        views.append(TargetView(shown, find_truth(span), spans, number))
    own = find_span(result)
    return TargetView(result, find_truth(own), spans, spans.index(own) if spans else None, tuple(views))
