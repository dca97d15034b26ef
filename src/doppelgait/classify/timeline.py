"""Decisions over time: windows, linked targets, fused evidence.

A window of the recording (:func:`cut_windows`) or of a stream (:mod:`doppelgait.classify.live`) is
analysed and classified like a separate recording. No data outside the window are used, so that a
stream and its file give the same result, and an overlap of two bodies affects only its own windows.
:class:`Tracks` then performs the steps that depend on the past:

1. *Linking.* A target continues the track with the same path where the windows overlap, or with a path that leads to it
   across a gap. One pass of the tracker over the whole recording would give tracks too, but it
   smooths backwards, so that a stream could not have them.
2. *Fusion.* The class of a track is a hidden Markov state that changes at :data:`CHANGE_PER_S` (mistaken links, another
   person through the same door). Calibrated probabilities of a window are its likelihoods, up to a
   factor, because they hold for equally frequent classes. A window that overlaps the one before is
   new only in part, and its log likelihood counts by that part: hop / window in a steady stream. A
   window that may not be decided (a flag, conditions or features that were not in the training
   data) is no evidence.
3. *Decision.* A class is decided when its fused probability reaches the model's limit, and stays until another class
   reaches it, so that the decision does not flicker.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np

from doppelgait.classify.decide import Decision, TargetInputs, choose_model, decide, read_training_analysis
from doppelgait.classify.model import Model
from doppelgait.core.errors import ConfigError
from doppelgait.core.units import FloatArray
from doppelgait.dataset.recorded import TOLERANCE, cut
from doppelgait.pipeline import Result, Tracking, analyze
from doppelgait.processing import Analysis
from doppelgait.radar import Recording, read_recording

CHANGE_PER_S = 0.02
"""Rate at which the class of a track changes. For two classes, evidence has a tenth of its weight after one minute."""
LINK_M, LINK_GROWS_MPS = 0.6, 0.4
"""Maximum distance at which a target continues a path, and its growth with the time without a detection."""
LINK_MPS = 1.5  # largest jump of the radial speed across a gap
COAST_S, LOST_S = 2.0, 6.0
"""Time for which a path is extrapolated (as long as two bodies share a detection), and time after which it is lost."""
LEAST_COMMON_S, STEP_S = 0.3, 0.1
WINDOW_OBSERVATIONS = 1.5
"""Default window length as a multiple of the shortest training observation, because a track does not fill its
window."""
UNCALIBRATED = 10  # assumed number of calibration rows of uncalibrated probabilities
TIMES = (
    "start_s",
    "stop_s",
    "track_start_s",
    "track_stop_s",
    "track_confirmed_at_s",
    "still_start_s",
    "still_stop_s",
)
"""Times among the diagnostics of a result."""


class Window(NamedTuple):
    """Part of a recording, with times that start at 0."""

    start_s: float
    stop_s: float
    recording: Recording


@dataclass(frozen=True)
class TrackDecision:
    """Decision about a track at the end of a window.

    Parameters
    ----------
    track : int
        Number of the track, from 0 in order of appearance.
    start_s, stop_s : float
        Start and end of the window; the decision uses no later data.
    label : str or None
        Class that is decided; None before the first decision.
    probability : float
        Fused, of the decided class, or of the likeliest where none is decided.
    probabilities : mapping
        Fused, of every class, were all classes equally frequent.
    alarm : bool or None
        True where the fused probability of the alarm's class reaches the model's threshold; as in
        the last window that was evidence. Before the first one it is the alarm of the window alone,
        which a flag does not keep from triggering. None where the model has no alarm, or no
        threshold for such a radar.
    reason : str
        Reason why nothing is decided, or why this window is no evidence; empty otherwise.
    range_m, approach_mps : float
        Last range and radial speed of the target in the window; the speed is positive when
        approaching.
    window : Decision
        About the window alone, with times of the recording.
    """

    track: int
    start_s: float
    stop_s: float
    label: str | None
    probability: float
    probabilities: Mapping[str, float]
    alarm: bool | None
    reason: str
    range_m: float
    approach_mps: float
    window: Decision

    def as_dict(self) -> dict[str, Any]:
        """Return the decision as plain values for JSON."""
        return {**vars(self), "probabilities": dict(self.probabilities), "window": self.window.as_dict()}


class Span(NamedTuple):
    """Time with an unchanged decision about a track."""

    track: int
    start_s: float
    stop_s: float
    label: str | None
    probability: float
    reason: str


def check_window(window_s: float | None, hop_s: float | None, model: Model | None = None) -> tuple[float, float]:
    """Return window and hop, with defaults for what is None."""
    if window_s is None:
        conditions = {} if model is None else model.facts.conditions
        window_s = (
            round(WINDOW_OBSERVATIONS * conditions["observation_s"][0], 3) if "observation_s" in conditions else 4.0
        )
    hop_s = window_s / 4.0 if hop_s is None else hop_s
    if not 0 < hop_s <= window_s < math.inf:
        raise ConfigError(f"window {window_s:g} s, hop {hop_s:g} s: must fulfil 0 < hop <= window, for example 4 and 1")
    return window_s, hop_s


def cut_windows(recording: Recording, window_s: float, hop_s: float) -> Iterator[Window]:
    """Split a recording into windows that start every hop."""
    first_s = float(recording.slow_time_s[0])
    for part in cut(recording, window_s=window_s, step_s=hop_s):
        assert isinstance(part.recording, Recording)
        start_s, content = first_s + part.start_s, part.recording
        if recording.truth:
            margin_s = TOLERANCE / recording.radar.prf_hz
            first = int(np.searchsorted(recording.slow_time_s, start_s - margin_s))
            pulses = slice(first, first + content.n_pulses)
            truth = [one.during(pulses, start_s, start_s + window_s) for one in recording.truth]
            content = replace(content, truth=truth)
        yield Window(start_s, start_s + window_s, content)


def analyze_window(
    window: Window, analysis: Analysis, tracking: Tracking | None = None, gate: Any = "track"
) -> list[Result]:
    """Analyse a window; times refer to the recording."""
    results = analyze(window.recording, gate=gate, analysis=analysis, tracking=tracking)
    return [_delay_result(result, window.start_s) for result in results]


def _delay_result(result: Result, by_s: float) -> Result:
    quality = {name: v + by_s if name in TIMES and v is not None else v for name, v in result.quality.items()}
    return replace(result, quality=quality, segments=tuple(_delay_result(one, by_s) for one in result.segments))


# Linking -------------------------------------------------------------------------------------------------------------


class Path(NamedTuple):
    """Ranges of a target in one window, every tenth of a second."""

    time_s: FloatArray
    range_m: FloatArray

    @classmethod
    def of(cls, result: Result, window: Window) -> Path:
        """Return a target's path from its gate."""
        gate = result.gate
        n_steps = max(math.ceil((gate.stop_s - gate.start_s) / STEP_S), 1)
        own_s = np.linspace(gate.start_s, gate.stop_s, n_steps + 1)
        return cls(own_s + window.start_s, gate.centre_at(own_s))

    def approach_mps(self, *, at_end: bool) -> float:
        """Return the radial speed at one end."""
        part = slice(-6, None) if at_end else slice(None, 6)
        times_s, range_m = self.time_s[part], self.range_m[part]
        return -float((range_m[-1] - range_m[0]) / max(times_s[-1] - times_s[0], STEP_S))

    def measure_distance_m(self, later: Path) -> float:
        """Return the distance to a later path, m."""
        common = later.time_s[(later.time_s >= self.time_s[0]) & (later.time_s <= self.time_s[-1])]
        if common.size * STEP_S >= LEAST_COMMON_S:
            apart = np.interp(common, self.time_s, self.range_m) - np.interp(common, later.time_s, later.range_m)
            distance_m = float(np.abs(apart).mean())
            return distance_m if distance_m <= LINK_M else math.inf
        gap_s = max(float(later.time_s[0] - self.time_s[-1]), 0.0)
        before_mps, after_mps = self.approach_mps(at_end=True), later.approach_mps(at_end=False)
        distance_m = abs(float(later.range_m[0] - self.range_m[-1]) + before_mps * min(gap_s, COAST_S))
        linked = distance_m <= LINK_M + LINK_GROWS_MPS * gap_s and abs(after_mps - before_mps) <= LINK_MPS
        return distance_m if linked and gap_s <= LOST_S else math.inf


class Links:
    """Numbers of tracks for the targets of successive windows."""

    def __init__(self) -> None:
        self._paths: dict[int, Path] = {}
        self._numbers = count()

    def add(self, window: Window, results: Sequence[Result]) -> list[int]:
        """Return the track of every target: the nearest pairs first."""
        new = [Path.of(result, window) for result in results]
        pairs = sorted(
            (distance_m, number, n)
            for number, path in self._paths.items()
            for n, later in enumerate(new)
            if (distance_m := path.measure_distance_m(later)) < math.inf
        )
        found: dict[int, int] = {}
        for _, number, n in pairs:
            if n not in found and number not in found.values():
                found[n] = number
        numbers = [found[n] if n in found else next(self._numbers) for n in range(len(new))]
        self._paths.update(zip(numbers, new, strict=True))
        self._paths = {n: path for n, path in self._paths.items() if window.stop_s - path.time_s[-1] <= LOST_S}
        return numbers

    @property
    def kept(self) -> set[int]:
        """Tracks that can be continued."""
        return set(self._paths)


# Fusion --------------------------------------------------------------------------------------------------------------


@dataclass
class _ClassEvidence:
    """Probabilities of the class of one track, and its decision."""

    probability: FloatArray
    at_s: float
    covered_s: float = -math.inf
    decided: int | None = None
    alarm: bool | None = None

    def hand_over(self, time_s: float) -> None:
        """Predict the belief after a time, p -> 1/K + (p - 1/K) exp(-r K/(K-1) dt)."""
        n = self.probability.size
        kept = math.exp(-CHANGE_PER_S * n / (n - 1) * max(time_s - self.at_s, 0.0))
        self.probability, self.at_s = 1.0 / n + (self.probability - 1.0 / n) * kept, time_s

    def add_evidence(self, probability: FloatArray, start_s: float, stop_s: float) -> None:
        """Add evidence, weighted by its share of new time."""
        new_s = stop_s - max(start_s, self.covered_s)
        weight = min(max(new_s / max(stop_s - start_s, 1e-9), 0.0), 1.0)
        self.covered_s = max(self.covered_s, stop_s)
        found = self.probability * probability**weight
        self.probability = found / found.sum()


class Tracks:
    """Decisions on the tracks of a recording or stream."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.links = Links()
        self._beliefs: dict[int, _ClassEvidence] = {}
        rows = model.calibration.n_rows or UNCALIBRATED
        self._least = 1.0 / (rows + len(model.facts.classes))

    def add(self, window: Window, results: Sequence[Result]) -> list[TrackDecision]:
        """Decide about every target of the next window."""
        numbers = self.links.add(window, results)
        decisions = [
            self._decide(number, window, result, decide(TargetInputs(result.to_row(), result.signature), self.model, n))
            for n, (number, result) in enumerate(zip(numbers, results, strict=True))
        ]
        self._beliefs = {number: self._beliefs[number] for number in self._beliefs.keys() & self.links.kept}
        return decisions

    def _decide(self, number: int, window: Window, result: Result, alone: Decision) -> TrackDecision:
        facts = self.model.facts
        belief = self._beliefs.get(number)
        if belief is None:
            n_classes = len(facts.classes)
            belief = self._beliefs[number] = _ClassEvidence(np.full(n_classes, 1.0 / n_classes), window.stop_s)
        belief.hand_over(window.stop_s)
        if not alone.blocked:
            # limit the evidence of a window by the number of its calibration rows
            found = np.maximum(np.array([alone.probabilities[name] for name in facts.classes]), self._least)
            start_s, stop_s = (
                float(result.quality.get(name) or edge)
                for name, edge in (("start_s", window.start_s), ("stop_s", window.stop_s))
            )
            belief.add_evidence(found / found.sum(), start_s, stop_s)
            if facts.alarm is not None and facts.alarm_threshold is not None:
                belief.alarm = bool(belief.probability[facts.classes.index(facts.alarm)] >= facts.alarm_threshold)
        best = int(belief.probability.argmax())
        if belief.probability[best] >= facts.abstain_below:
            belief.decided = best
        reason = alone.reason if alone.blocked else ""
        if belief.decided is None and not reason:
            reason = f"probability {belief.probability[best]:.2f} is below {facts.abstain_below:g}"
        shown = best if belief.decided is None else belief.decided
        path = Path.of(result, window)
        return TrackDecision(
            track=number,
            start_s=window.start_s,
            stop_s=window.stop_s,
            label=None if belief.decided is None else facts.classes[belief.decided],
            probability=float(belief.probability[shown]),
            probabilities={name: float(p) for name, p in zip(facts.classes, belief.probability, strict=True)},
            alarm=alone.alarm if belief.alarm is None else belief.alarm,
            reason=reason,
            range_m=float(path.range_m[-1]),
            approach_mps=path.approach_mps(at_end=True),
            window=alone,
        )


def classify_over_time(
    recording: Recording | str | FilePath,
    model: Model | None = None,
    *,
    window_s: float | None = None,
    hop_s: float | None = None,
    gate: Any = "track",
    analysis: Analysis | None = None,
    tracking: Tracking | None = None,
) -> list[TrackDecision]:
    """Classify a recording's targets in windows, fused per track.

    Parameters
    ----------
    recording : Recording, str or Path
        A path is read as by :func:`doppelgait.radar.read_recording`.
    model : Model, optional
        By default the one that comes with doppelgait and fits the radar.
    window_s : float, optional
        Length of a window; 1.5 times the shortest observation of the model's training data by
        default.
    hop_s : float, optional
        From the start of a window to that of the next; a quarter of the window by default.
    gate, analysis, tracking
        As for :func:`doppelgait.classify.classify`.

    Returns
    -------
    list of TrackDecision
        In the order of time: one per window and target.

    Raises
    ------
    AnalysisError
        If the recording is shorter than a window, or as :func:`doppelgait.analyze`.
    ConfigError
        If window or hop are not allowed, or no shipped model fits.

    See Also
    --------
    join_decisions : join the decisions of a track to spans of one class.
    doppelgait.live : classify while the frames arrive.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic"}, label="human")], duration_s=3.0)
    >>> recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=640.0))
    >>> model = dg.classify.open_model("x4")
    >>> decisions = dg.classify.classify_over_time(recording, model, window_s=3.0)
    >>> [(decision.stop_s, decision.label) for decision in decisions]
    [(3.0, 'human')]
    >>> [(span.start_s, span.stop_s, span.label) for span in dg.classify.join_decisions(decisions)]
    [(0.0, 3.0, 'human')]
    """
    if isinstance(recording, str | FilePath):
        recording = read_recording(recording)
    model = model or choose_model(recording)
    window_s, hop_s = check_window(window_s, hop_s, model)
    settings, tracks = analysis or read_training_analysis(model), Tracks(model)
    return [
        decision
        for window in cut_windows(recording, window_s, hop_s)
        for decision in tracks.add(window, analyze_window(window, settings, tracking, gate))
    ]


# Summaries -----------------------------------------------------------------------------------------------------------


def join_decisions(decisions: Iterable[TrackDecision]) -> list[Span]:
    """Join decisions about a track while they stay the same.

    A decision holds from the end of the window before, a track's first one from the start of its
    window.

    Returns
    -------
    list of Span
        By track, then time.

    See Also
    --------
    classify_over_time : make the decisions; its example joins them.
    """
    open_spans: dict[int, _OpenSpan] = {}
    done: list[_OpenSpan] = []
    for one in decisions:
        before = open_spans.get(one.track)
        if before is None or before.last.label != one.label:
            start_s = one.start_s if before is None else before.last.stop_s
            before = open_spans[one.track] = _OpenSpan(start_s, one)
            done.append(before)
        before.last = one
        before.reasons[one.reason] += 1
    spans = [Span(s.last.track, s.start_s, s.last.stop_s, s.last.label, s.last.probability, s.reason) for s in done]
    return sorted(spans, key=lambda span: (span.track, span.start_s))


@dataclass
class _OpenSpan:
    start_s: float
    last: TrackDecision
    reasons: Counter[str] = field(default_factory=Counter)

    @property
    def reason(self) -> str:
        """Return the commonest reason; empty if most windows had none."""
        return self.reasons.most_common(1)[0][0]
