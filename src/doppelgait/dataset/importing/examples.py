"""One labelled recording: its windows, its rows of the index and their arrays."""

from __future__ import annotations

import json
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.config import json_value
from doppelgait.core.errors import AnalysisError, DoppelgaitError, DoppelgaitWarning
from doppelgait.core.labels import BASEBAND, axis, make_array
from doppelgait.core.worker import one_blas_thread
from doppelgait.dataset.config import FieldSpec
from doppelgait.dataset.example import axis_name
from doppelgait.dataset.importing.config import ImportConfig
from doppelgait.dataset.importing.splits import PlannedEntry
from doppelgait.dataset.shard import NOTHING, result_columns
from doppelgait.dataset.shard_files import FIELDS, encode
from doppelgait.pipeline import TargetResult, analyze
from doppelgait.processing import burst_pulses_of
from doppelgait.radar import read_recording
from doppelgait.radar.recording import Recording

TOLERANCE = 0.01
"""Part of a pulse's (or burst's) period by which limits may be missed."""


@dataclass(frozen=True)
class Part:
    """A part of a recording, its times from 0.

    Parameters
    ----------
    start_s, stop_s : float
        In the time of the whole recording, from its first pulse.
    recording : Recording
        Without truth: an imported recording is analysed as a measured one.
    """

    start_s: float
    stop_s: float
    recording: Recording


@dataclass(frozen=True)
class _Blocks:
    """Pulses, or bursts of pulses, which are never cut.

    Parameters
    ----------
    starts_s : ndarray
        From the first.
    pulses : int
        In each.
    period_s : float
        From one to the next, in the mean.
    """

    starts_s: npt.NDArray[np.float64]
    pulses: int
    period_s: float

    @property
    def duration_s(self) -> float:
        return self.starts_s.size * self.period_s

    def between(self, start_s: float, stop_s: float) -> slice:
        """Pulses of the blocks that begin in [start_s, stop_s)."""
        margin_s = TOLERANCE * self.period_s
        first, last = np.searchsorted(self.starts_s, [start_s - margin_s, stop_s - margin_s])
        return slice(int(first) * self.pulses, int(last) * self.pulses)


def cut(
    recording: Recording, *, start_s: float | None = None, stop_s: float | None = None,
    window_s: float | None = None, step_s: float | None = None,
) -> list[Part]:  # fmt: skip
    """Parts of a recording.

    Parameters
    ----------
    recording : Recording
    start_s, stop_s : float, optional
        What is meant of it, from its first pulse; all by default.
    window_s, step_s : float, optional
        Length of a window, and from the start of one to that of the next. A rest shorter than a window is left out.

    Returns
    -------
    list of Part
        One without ``window_s``.

    Raises
    ------
    AnalysisError
        If the recording ends before ``stop_s``, or what is meant is shorter than a window.
    """
    blocks = _blocks(recording)
    duration_s = blocks.duration_s
    margin_s = TOLERANCE * blocks.period_s
    begin, end = start_s or 0.0, duration_s if stop_s is None else stop_s
    for name, value in (("start_s", begin + blocks.period_s), ("stop_s", end)):
        if value > duration_s + margin_s:
            given = begin if name == "start_s" else end
            raise AnalysisError(f"{name} = {given:g}: the recording lasts {duration_s:.6g} s")
    if window_s is None or step_s is None:
        return [_part(recording, blocks, begin, end)]
    count = int(np.floor((end - begin - window_s + margin_s) / step_s)) + 1
    if count < 1:
        raise AnalysisError(f"lasts {end - begin:.6g} s, less than a window of {window_s:g} s")
    starts_s = (begin + n * step_s for n in range(count))
    return [_part(recording, blocks, at, min(at + window_s, end)) for at in starts_s]


def _blocks(recording: Recording) -> _Blocks:
    times_s = recording.slow_time_s.astype(np.float64)
    pulses = burst_pulses_of(recording.baseband) or 1
    starts_s = times_s[: times_s.size // pulses * pulses : pulses] - times_s[0]
    if starts_s.size < 2:
        raise AnalysisError(f"has {starts_s.size} {'pulses' if pulses == 1 else 'bursts'}, at least 2 are needed")
    return _Blocks(starts_s, pulses, float(starts_s[-1] / (starts_s.size - 1)))


def _part(recording: Recording, blocks: _Blocks, start_s: float, stop_s: float) -> Part:
    """A recording of its own from a part of another."""
    whole = recording.baseband
    chosen = blocks.between(start_s, stop_s)
    times_s = axis(whole, "slow_time")[chosen]
    if times_s.size < 2:
        raise AnalysisError(f"{start_s:g} to {stop_s:g} s: holds {times_s.size} pulses, at least 2 are needed")
    coords = {"slow_time": times_s - times_s[0], "range": axis(whole, "range")}
    baseband = make_array(BASEBAND, whole.values[chosen], coords, whole.attrs)
    return Part(start_s, stop_s, recording.with_baseband(baseband, truth=()))


Arrays = dict[str, npt.NDArray[Any]]
Reader = Callable[[str, tuple[tuple[str, Any], ...]], tuple[Recording, tuple[str, ...]]]

SEVERAL = "several_tracks:the_label_went_to_the_surest"


@dataclass
class Imported:
    """What became of one entry.

    Parameters
    ----------
    rows : list of dict
        Of the index, without shard and row.
    arrays : list of dict
        Of each row, as stored.
    failures : list of dict
        ``id``, ``reason``, ``spec``.
    """

    rows: list[dict[str, Any]] = field(default_factory=list)
    arrays: list[Arrays] = field(default_factory=list)
    failures: list[dict[str, str]] = field(default_factory=list)

    def fail(self, name: str, planned: PlannedEntry, reason: str) -> None:
        """Add a failure."""
        entry = planned.entry
        spec = {"line": entry.line, "file": entry.recording, "start_s": entry.start_s, "stop_s": entry.stop_s}
        self.failures.append({"id": name, "reason": reason, "spec": json.dumps({**spec, "split": planned.split})})


def make_reader(folder: Path) -> Reader:
    """Reader of a folder's recordings that keeps the last one: lines about one recording follow each other."""

    @lru_cache(maxsize=1)
    def read(recording: str, options: tuple[tuple[str, Any], ...]) -> tuple[Recording, tuple[str, ...]]:
        with _messages(folder) as messages:
            loaded = read_recording(folder / recording, **dict(options))
        return loaded, tuple(messages)

    return read


def import_entry(planned: PlannedEntry, read: Reader, folder: Path, config: ImportConfig, sha256: str) -> Imported:
    """Rows and arrays of an entry; whatever is wrong with its recording is a failure, not an error.

    Parameters
    ----------
    planned : PlannedEntry
    read : callable
        From :func:`make_reader`.
    folder : Path
    config : ImportConfig
    sha256 : str
        Of the recording's files.
    """
    made, entry = Imported(), planned.entry
    try:
        recording, told = read(entry.recording, tuple(sorted(entry.options.items())))
        parts = cut(
            recording, start_s=entry.start_s, stop_s=entry.stop_s, window_s=config.window_s, step_s=config.step_s
        )
    except Exception as error:
        made.fail(planned.id, planned, _reason(error, folder))
        return made
    for number, part in enumerate(parts):
        name = planned.id if config.window_s is None else f"{planned.id}-w{number:04d}"
        try:
            with one_blas_thread(), _messages(folder) as messages:
                results = analyze(part.recording, gate=entry.gate, analysis=config.analysis, tracking=config.tracking)
            result = labelled_result(results)
            stored = _stored(result, part.recording, config.fields)
        except Exception as error:
            made.fail(name, planned, _reason(error, folder))
            continue
        columns = {
            **_identity_columns(name, planned, sha256),
            **_recording_columns(part, folder),
            **entry.further,
            **_outcome_columns(planned, results, result),
            "warnings": _joined((*told, *messages)),
        }
        made.rows.append(json_value(columns))
        made.arrays.append(stored)
    return made


def labelled_result(results: Sequence[TargetResult]) -> TargetResult | None:
    """The target that a recording's one label belongs to: the track with the most seconds, each by its confidence.

    Bodies that move come before those found by their breath only.
    """

    def weight(result: TargetResult) -> tuple[bool, float]:
        quality = result.quality
        if "track_confidence" not in quality:
            return False, float(quality.get("breathing_confidence") or 0.0)
        return True, float(quality["track_confidence"]) * float(quality["track_stop_s"] - quality["track_start_s"])

    return max(results, key=weight, default=None)


def _identity_columns(name: str, planned: PlannedEntry, sha256: str) -> dict[str, Any]:
    entry = planned.entry
    source = "none" if entry.nobody else "measured"
    return {
        "id": name,
        "scene_id": planned.id,
        "label": entry.label,
        "split": planned.split,
        "subject": planned.subject,
        "group": planned.group,
        "source": source,
        "recording": entry.recording,
        "recording_sha256": sha256,
        "licence": entry.licence,
        "citation": entry.citation,
        "session": entry.session,
        "motion_kind": source,
        "motion": "",
    }


def _recording_columns(part: Part, folder: Path) -> dict[str, Any]:
    """What the recording tells; what only a simulation knows is unknown."""
    recording = part.recording
    return {
        "prf_hz": recording.radar.prf_hz,
        "carrier_hz": recording.radar.carrier_hz,
        "observation_s": part.stop_s - part.start_s,
        "window_start_s": part.start_s,
        "window_stop_s": part.stop_s,
        "environment": "",
        "impairments": "",
        "radar_height_m": None,
        "rcs_total_m2": None,
        "snr_frame_db": recording.snr_frame_db,
        "gate_error_m": None,
        "notes": _joined(_portable(note, folder) for note in recording.notes),
    }


def _outcome_columns(
    planned: PlannedEntry, results: Sequence[TargetResult], result: TargetResult | None
) -> dict[str, Any]:
    tracked = planned.entry.gate == "track"
    n_tracks = len(results) if tracked else None
    if result is None:
        missing = "nobody:nothing_found" if planned.entry.nobody else "not_tracked"
        return {"gate": "track", **NOTHING, "flags": missing, "n_tracks": n_tracks}
    columns = {**result_columns(result), "n_tracks": n_tracks}
    if tracked and len(results) > 1:
        columns["flags"] = ";".join(filter(None, (columns["flags"], SEVERAL)))
    return columns


def _stored(result: TargetResult | None, recording: Recording, fields: Sequence[FieldSpec]) -> Arrays:
    """Arrays of a row; those of a target that was not found are empty."""
    stored: Arrays = {}
    for spec in fields:
        signal = recording.baseband if spec.name == "baseband" else getattr(result, spec.name, None)
        if signal is None:
            stored[spec.name] = encode(np.empty((0, 0)), spec)
            continue
        stored[spec.name] = encode(signal.values, spec)
        for place, dim in enumerate(FIELDS[spec.name]["dims"]):
            name = axis_name(spec.name, dim)
            if name is not None:
                stored[name] = axis(signal, dim)[:: spec.hop] if place == 0 else axis(signal, dim)
    return stored


@contextmanager
def _messages(folder: Path) -> Iterator[list[str]]:
    """Warnings of the block, without where the folder is; a list that is filled when the block ends."""
    messages: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DoppelgaitWarning)
        yield messages
    found = (_portable(str(one.message), folder) for one in caught if issubclass(one.category, DoppelgaitWarning))
    messages += dict.fromkeys(found)


def _reason(error: Exception, folder: Path) -> str:
    if isinstance(error, DoppelgaitError):
        return _portable(str(error), folder)
    return "internal error: " + _portable("".join(traceback.format_exception_only(error)).strip(), folder)


def _portable(text: str, folder: Path) -> str:
    """Text without the folder's place on this machine."""
    return text.replace(f"{folder}/", "").replace(f"{folder}\\", "")


def _joined(texts: Iterable[str]) -> str:
    """Texts in one column, each once."""
    return ";".join(dict.fromkeys(text.replace(";", ",") for text in texts))
