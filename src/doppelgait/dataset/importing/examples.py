"""One labelled recording: its rows of the index and their arrays."""

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
from threadpoolctl import threadpool_limits

from doppelgait.core.errors import DoppelgaitError, DoppelgaitWarning
from doppelgait.core.labels import axis
from doppelgait.dataset.config import FieldSpec
from doppelgait.dataset.example import axis_name, plain_row
from doppelgait.dataset.fields import FIELDS, encode
from doppelgait.dataset.importing.config import ImportConfig
from doppelgait.dataset.importing.splits import PlannedEntry
from doppelgait.dataset.importing.windows import Part, cut
from doppelgait.dataset.rows import NOTHING, result_columns
from doppelgait.pipeline import TargetResult, analyze
from doppelgait.radar import read_recording
from doppelgait.radar.recording import Recording

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
            with threadpool_limits(1), _messages(folder) as messages:  # as for built examples: bytes depend on threads
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
        made.rows.append(plain_row(columns))
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
