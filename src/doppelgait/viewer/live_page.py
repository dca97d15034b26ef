"""Content of the live page, in fixed memory.

The page shows the last half minute of a stream.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.classify.model import Model
from doppelgait.classify.timeline import TrackDecision
from doppelgait.core.labels import read_axis
from doppelgait.dataset.windows import Window
from doppelgait.pipeline import Result
from doppelgait.viewer.payload import (
    describe_axis,
    describe_doppler,
    encode_image,
    find_band_hz,
    find_block_maxima,
    find_block_size,
    pack,
)

SPAN_S, STEP_S = 30.0, 0.05  # time span of the page, and width of a column
MOST_ROWS = 300
"""Largest number of range bins or Doppler cells of a column; more are combined by their maximum."""
MARKED = ("track", "label", "reason", "probability", "alarm", "range_m", "approach_mps")
MOST_MARKS = 2000  # largest number of decisions that are kept


def describe_model(model: Model) -> dict[str, Any]:
    """Describe a model for a page, which shows the probability of ``shown_class``."""
    facts = model.facts
    shown = facts.alarm or ("human" if "human" in facts.classes else None)
    keys = {"classes", "alarm_threshold", "abstain_below"}
    return {"alarm_class": facts.alarm, "shown_class": shown, **facts.model_dump(include=keys)}


def describe_decision(one: TrackDecision, shown_class: str | None) -> dict[str, Any]:
    """Describe a decision for a page."""
    facts = {name: getattr(one, name) for name in MARKED}
    evidence = None if shown_class is None else one.probabilities[shown_class]
    return {**facts, "time_s": one.stop_s, "evidence": evidence}


class Rolling:
    """Last half minute of pictures, tracks and decisions."""

    def __init__(self, source: str) -> None:
        self._facts: dict[str, Any] = {"source": source, "radar": "no sensor so far"}
        self._lock = threading.Lock()
        self._columns: dict[str, deque[tuple[int, npt.NDArray[np.float32]]]] = {
            name: deque(maxlen=round(SPAN_S / STEP_S)) for name in ("range_time", "signature")
        }
        self._rows: dict[str, npt.NDArray[np.float64]] = {}
        self._wavelength_m = math.nan
        self._marks: deque[dict[str, Any]] = deque(maxlen=MOST_MARKS)
        self._state: dict[str, Any] = {"state": "waiting", "reason": "", "counts": {}}
        self._begin_s = math.inf
        self._stop_s: float | None = None

    def begin(self, radar: str, model: Model) -> None:
        """Store the radar and the model of a run."""
        with self._lock:
            self._facts |= {"radar": radar, **describe_model(model)}

    def add(
        self,
        window: Window,
        decisions: Sequence[TrackDecision],
        results: Sequence[Result],
        counts: Mapping[str, Any],
        processor_share: float,
    ) -> None:
        """Add the new part of a window."""
        recording = window.recording
        moving = recording.samples.matrix - recording.samples.matrix.mean(axis=0)
        with self._lock:
            if self._state["state"] == "ended" or window.stop_s < (self._stop_s or 0.0) - SPAN_S / 6:
                self._marks.clear()
                for columns in self._columns.values():
                    columns.clear()
                self._begin_s = window.start_s
            self._begin_s = min(self._begin_s, window.start_s)
            self._wavelength_m = recording.radar.wavelength_m
            self._put("range_time", window.start_s + recording.slow_time_s, np.abs(moving) ** 2, recording.range_m)
            for result in results:
                signature = result.signature
                times_s = window.start_s + read_axis(signature, "time")
                self._put("signature", times_s, signature.values, read_axis(signature, "doppler"))
            self._marks += [describe_decision(one, self._facts["shown_class"]) for one in decisions]
            first_s = window.stop_s - SPAN_S
            while self._marks and self._marks[0]["time_s"] < first_s:
                self._marks.popleft()
            for columns in self._columns.values():
                while columns and columns[0][0] * STEP_S < first_s:
                    columns.popleft()
            self._stop_s = window.stop_s
            self._state |= {"state": "running", "counts": dict(counts), "processor_share": processor_share}

    def end(self, reason: str, counts: Mapping[str, Any]) -> None:
        """Store that the stream has ended, and the reason."""
        with self._lock:
            self._state |= {"state": "ended", "reason": reason, "counts": dict(counts)}

    def payload(self) -> bytes:
        """Return the payload of ``api/live``."""
        with self._lock:
            pictures = {name: list(columns) for name, columns in self._columns.items() if columns}
            marks, state, stop_s = list(self._marks), dict(self._state), self._stop_s
        facts: dict[str, Any] = {**self._facts, **state, "stop_s": stop_s, "start_s": None, "marks": marks}
        facts |= {"range_time": None, "signature": None}
        arrays: dict[str, npt.NDArray[Any]] = {}
        if stop_s is not None:
            facts["start_s"] = max(stop_s - SPAN_S, self._begin_s)
        for name, columns in pictures.items():
            first, last = columns[0][0], columns[-1][0]
            power = np.zeros((last - first + 1, columns[0][1].size), dtype=np.float32)
            for number, values in columns:
                power[number - first] = values
            time = describe_axis("time", "s", (np.arange(first, last + 1) + 0.5) * STEP_S)
            rows = self._rows[name]
            axis = describe_axis("range", "m", rows)
            if name == "signature":
                axis = describe_doppler(rows, self._wavelength_m)
            facts[name], arrays[name] = encode_image(name, power, time, axis, unit="dB re 1 V²")
            facts[name]["band_hz"] = find_band_hz(power, rows) if name == "signature" else None
        return pack(facts, arrays)

    def _put(
        self, name: str, times_s: npt.NDArray[np.float64], power: npt.NDArray[Any], rows: npt.NDArray[np.float64]
    ) -> None:
        # Powers (time, row) are combined with their columns. If a body stands still in one window, clutter removal
        # leaves its mean at the times when it is elsewhere; other windows are better there. The signatures of two
        # targets are superimposed.
        join = np.minimum if name == "range_time" else np.maximum
        block = find_block_size(rows.size, MOST_ROWS)
        centres = np.array([part.mean() for part in np.array_split(rows, range(block, rows.size, block))])
        if name in self._rows and self._rows[name].size != centres.size:
            self._columns[name].clear()
        self._rows[name] = centres
        numbers = np.floor(times_s / STEP_S).astype(np.int64)
        starts = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 1))
        strongest = np.maximum.reduceat(
            find_block_maxima(np.asarray(power, dtype=np.float32), 1, block), starts, axis=0
        )
        columns = self._columns[name]
        known = dict(columns)
        for number, values in zip(numbers[starts].tolist(), strongest, strict=True):
            known[number] = join(known[number], values) if number in known else values
        columns.clear()
        columns.extend(sorted(known.items()))  # the oldest are dropped
