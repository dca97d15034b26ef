"""Decisions over time: fused evidence of linked targets.

Windows are analysed and linked to tracks (:mod:`doppelgait.dataset.windows`). A network of tracks has its own memory.
The answers of a model of windows are fused: the class of a track is a hidden Markov state that changes at
:data:`CHANGE_PER_S`, the calibrated probabilities of a window are its likelihoods, and of a window that overlaps the
one before only the new part counts. What may not be decided (flags, conditions, features) is no evidence for either.
A class is decided when its probability reaches the model's limit, and stays until another class reaches it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np

from doppelgait.classify.data import SHARED, Rows, all_rows, collect_inputs, number_tracks, read_numbers
from doppelgait.classify.decide import Decision, TargetInputs, choose_model, decide, read_training_analysis
from doppelgait.classify.learned import EMPTY, Inputs, embed_windows
from doppelgait.classify.model import Model, blocked_rows
from doppelgait.classify.options import WindowOptions, takes_options
from doppelgait.classify.scorer import Memory, remember
from doppelgait.core.errors import ConfigError
from doppelgait.core.units import FloatArray
from doppelgait.dataset.open import Dataset
from doppelgait.dataset.windows import Links, Path, Window, analyze_window, cut_windows
from doppelgait.pipeline import Result
from doppelgait.radar import Recording, read_recording

CHANGE_PER_S = 0.02
"""Rate at which the class of a track changes. For two classes, evidence has a tenth of its weight after one minute."""
WINDOW_OBSERVATIONS = 1.5
"""Default window length as a multiple of the shortest training observation, because a track does
not fill its window."""
UNCALIBRATED = 10  # assumed number of calibration rows of uncalibrated probabilities


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
    probability, probabilities : float, mapping
        Of the decided class, or of the likeliest where none is decided, and of every class, were
        all equally frequent; of all windows of the track up to this one.
    alarm : bool or None
        True from the second of two windows in succession on, after which the probability of the
        alarm's class reaches the threshold; while another body is in the gate, only for these
        windows. A window that is no evidence raises none. None where the model has no alarm, or
        none for such a radar.
    reason : str
        Reason why nothing is decided, or why this window is no evidence; empty otherwise.
    range_m, approach_mps : float
        Last range and radial speed in the window; the speed is positive when approaching.
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
        return {**vars(self), "window": self.window.as_dict()}


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
    conditions: Mapping[str, tuple[float, float]] = {}
    if model is not None:
        facts = model.of_tracks.facts
        window_s, conditions = facts.window_s if window_s is None else window_s, facts.conditions
    if window_s is None:
        shortest_s, _ = conditions.get("observation_s", (4.0 / WINDOW_OBSERVATIONS, 0.0))
        window_s = round(WINDOW_OBSERVATIONS * shortest_s, 3)
    hop_s = window_s / 5.0 if hop_s is None else hop_s
    if not 0 < hop_s <= window_s < math.inf:
        raise ConfigError(f"window {window_s:g} s, hop {hop_s:g} s: must fulfil 0 < hop <= window, for example 4 and 1")
    return window_s, hop_s


# Fusion --------------------------------------------------------------------------------------------------------------


@dataclass
class _ClassEvidence:
    """Probabilities of the class of one track, and its decision."""

    probability: FloatArray
    at_s: float
    covered_s: float = -math.inf
    decided: int | None = None
    alarm: bool = False
    reached: tuple[bool, bool] = (False, False)  # the last window reached the threshold; and with others in the gate
    memory: tuple[Memory, float] = (EMPTY, 0.0)
    with_others: tuple[Memory, float] = (EMPTY, 0.0)  # also with another body in the gate

    def remember(self, model: Model, values: Inputs, stop_s: float, *, shared: bool) -> FloatArray:
        """Add a window to the memory of a network; return its answer."""
        memory, before_s = self.with_others if shared else self.memory
        since_s = stop_s - before_s if memory[2] else 0.0
        network = model.learned.arrays
        memory, log_probability = remember(network, memory, embed_windows(network, values)[0], since_s)
        self.with_others = (memory, stop_s)
        found: FloatArray = model.calibration(log_probability[None])[0]
        if not shared:
            self.memory, self.probability = self.with_others, found
        return found

    def hand_over(self, time_s: float) -> None:
        """Predict the belief after a time, p -> 1/K + (p - 1/K) exp(-r K/(K-1) dt)."""
        n = self.probability.size
        kept = math.exp(-CHANGE_PER_S * n / (n - 1) * max(time_s - self.at_s, 0.0))
        self.probability, self.at_s = 1.0 / n + (self.probability - 1.0 / n) * kept, time_s

    def add_evidence(self, probability: FloatArray, start_s: float, stop_s: float, n_calibration: int) -> None:
        """Add evidence, limited by the number of its calibration rows and weighted by its share of new time."""
        probability = np.maximum(probability, 1.0 / ((n_calibration or UNCALIBRATED) + probability.size))
        probability = probability / probability.sum()
        new_s = stop_s - max(start_s, self.covered_s)
        weight = min(max(new_s / max(stop_s - start_s, 1e-9), 0.0), 1.0)
        self.covered_s = max(self.covered_s, stop_s)
        found = self.probability * probability**weight
        self.probability = found / found.sum()


class Tracks:
    """Decisions on the tracks of a recording or stream."""

    def __init__(self, model: Model) -> None:
        self.model = model = model.of_tracks
        self.links = Links()
        self._beliefs: dict[int, _ClassEvidence] = {}

    def add(self, window: Window, results: Sequence[Result]) -> list[TrackDecision]:
        """Decide about every target of the next window."""
        numbers, facts, decisions = self.links.add(window, results), self.model.facts, []
        for target, (number, result) in enumerate(zip(numbers, results, strict=True)):
            alone, belief, rings = self.follow(number, TargetInputs.of(result), (window.start_s, window.stop_s), target)
            best, reason = int(belief.probability.argmax()), alone.reason if alone.blocked else ""
            if belief.probability[best] >= facts.abstain_below:
                belief.decided = best
            elif belief.decided is None and not reason:
                reason = f"probability {belief.probability[best]:.2f} is below {facts.abstain_below:g}"
            shown, path = best if belief.decided is None else belief.decided, Path.of(result, window)
            decisions.append(
                TrackDecision(
                    track=number,
                    start_s=window.start_s,
                    stop_s=window.stop_s,
                    label=None if belief.decided is None else facts.classes[belief.decided],
                    probability=float(belief.probability[shown]),
                    probabilities=dict(zip(facts.classes, belief.probability.tolist(), strict=True)),
                    alarm=rings or (None if alone.alarm is None else False),
                    reason=reason,
                    range_m=float(path.range_m[-1]),
                    approach_mps=path.approach_mps(at_end=True),
                    window=alone,
                )
            )
        self._beliefs = {number: self._beliefs[number] for number in self._beliefs.keys() & self.links.paths.keys()}
        return decisions

    def follow(
        self, number: int, seen: TargetInputs, edges_s: tuple[float, float], target: int = 0
    ) -> tuple[Decision, _ClassEvidence, bool]:
        """Add a window to a track; decide about it alone, return the belief and whether the alarm rings."""
        facts, followed = self.model.facts, self.model.learned.kind == "track"
        alone, n_classes = decide(seen, self.model, target), len(facts.classes)
        belief = self._beliefs.setdefault(number, _ClassEvidence(np.full(n_classes, 1.0 / n_classes), edges_s[1]))
        if not followed:
            belief.hand_over(edges_s[1])
        shared = followed and alone.reason == f"flag {SHARED}"
        if alone.blocked and not shared:
            return alone, belief, belief.alarm
        if followed:
            values = seen.collect_inputs(self.model, target)
            probability = belief.remember(self.model, values, edges_s[1], shared=shared)
        else:
            found = np.array([alone.probabilities[name] for name in facts.classes])
            own_s = [seen.columns.get(f"quality_{name}_s") for name in ("start", "stop")]
            start_s, stop_s = (float(own or edge) for own, edge in zip(own_s, edges_s, strict=True))
            belief.add_evidence(found, start_s, stop_s, self.model.calibration.n_rows)
            probability = belief.probability
        rings = False
        if facts.alarm is not None and facts.alarm_threshold is not None:
            reached = bool(probability[facts.classes.index(facts.alarm)] >= facts.alarm_threshold)
            rings = reached and belief.reached[shared]
            belief.reached = (belief.reached[0] if shared else reached, reached)
        belief.alarm |= rings and not shared
        return alone, belief, rings or belief.alarm


def follow_rows(dataset: Dataset, model: Model) -> FloatArray:
    """Return probabilities (n, n_classes) after the window of each row of a dataset, NaN where it is no evidence."""
    model = model.of_tracks
    rows = all_rows(dataset, model.facts.classes)
    values, followed = collect_inputs(rows, model.facts.features).values, model.learned.kind == "track"
    kept = ~blocked_rows(rows, values, model, SHARED if followed else None)
    if followed:
        kept &= [each.pictures is not None for each in values[:, -1]]
    found = np.full((len(rows), len(rows.classes)), np.nan)
    found[kept] = model.probability(values[kept])
    return found if followed else fuse_rows(rows, found, model.calibration.n_rows)


def fuse_rows(rows: Rows, probability: FloatArray, n_calibration: int) -> FloatArray:
    """Fuse the probabilities of windows by track, NaN where a window is no evidence."""
    beliefs: dict[int, _ClassEvidence] = {}
    numbers, n_classes, fused = number_tracks(rows), probability.shape[1], np.full(probability.shape, np.nan)
    edges_s = [read_numbers(rows.index[f"window_{name}_s"]) for name in ("start", "stop")]
    own_s = [read_numbers(rows.index.get(f"quality_{name}_s", edges_s[0] * np.nan)) for name in ("start", "stop")]
    spans_s = [np.where(np.isnan(own), edge, own) for own, edge in zip(own_s, edges_s, strict=True)]
    for number in np.argsort(edges_s[1], kind="stable").tolist():
        belief = beliefs.setdefault(
            numbers[number], _ClassEvidence(np.full(n_classes, 1.0 / n_classes), edges_s[1][number])
        )
        belief.hand_over(edges_s[1][number])
        if np.isfinite(probability[number]).all():
            belief.add_evidence(probability[number], spans_s[0][number], spans_s[1][number], n_calibration)
            fused[number] = belief.probability
    return fused


@takes_options(WindowOptions)
def classify_over_time(
    recording: Recording | str | FilePath, model: Model | None = None, **options: Any
) -> list[TrackDecision]:
    """Classify a recording's targets in windows, fused per track.

    Parameters
    ----------
    recording : Recording, str or Path
        A path is read as by :func:`doppelgait.radar.read_recording`.
    model : Model, optional
        By default the one that comes with doppelgait and fits the radar.
    **options

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

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> model = dg.classify.open_model("x4")
    >>> decisions = dg.classify.classify_over_time(recording, model, window_s=3.0)
    >>> [(decision.stop_s, decision.label) for decision in decisions]
    [(3.0, 'human'), (3.0, 'animal'), (3.6, 'human'), (3.6, 'animal')]
    >>> [(span.start_s, span.stop_s, span.label) for span in dg.classify.join_decisions(decisions)]
    [(0.0, 3.6, 'human'), (0.0, 3.6, 'animal')]
    """
    if isinstance(recording, str | FilePath):
        recording = read_recording(recording)
    windows = decide_windows(recording, model or choose_model(recording), **options)
    return [decision for _, found in windows for decision in found]


def decide_windows(recording: Recording, model: Model, **options: Any) -> Iterator[tuple[Window, list[TrackDecision]]]:
    """Yield every window of a recording with the decisions about its targets."""
    chosen = WindowOptions(**options)
    window_s, hop_s = check_window(chosen.window_s, chosen.hop_s, model)
    model = model.of_tracks if chosen.gate == "track" else replace(model, track=None)  # only tracks have pictures
    how, tracks = (chosen.analysis or read_training_analysis(model), chosen.tracking, chosen.gate), Tracks(model)
    for one in cut_windows(recording, window_s, hop_s):
        yield one, tracks.add(one, analyze_window(one, *how))


# Summaries -----------------------------------------------------------------------------------------------------------


def join_decisions(decisions: Iterable[TrackDecision]) -> list[Span]:
    """Join decisions about a track while they stay the same.

    A decision holds from the end of the window before, a track's first one from the start of its
    window.

    Returns
    -------
    list of Span
        By track, then time.
    """
    spans = list[Span]()
    in_order = sorted(decisions, key=lambda one: one.track)
    for (track, label), group in groupby(in_order, key=lambda one: (one.track, one.label)):
        ones = list(group)
        start_s = spans[-1].stop_s if spans and spans[-1].track == track else ones[0].start_s
        reason = Counter(one.reason for one in ones).most_common(1)[0][0]
        spans.append(Span(track, start_s, ones[-1].stop_s, label, ones[-1].probability, reason))
    return spans
