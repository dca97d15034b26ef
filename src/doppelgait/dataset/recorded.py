"""Labelled recordings: windows, index rows and stored arrays."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.config import convert_to_json
from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import read_axis
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.core.worker import limit_blas_threads
from doppelgait.dataset.config import ImportConfig
from doppelgait.dataset.shard import NOTHING, ExampleData, collect_messages, describe_failure
from doppelgait.dataset.shard_files import encode_arrays
from doppelgait.dataset.splits import PlannedEntry
from doppelgait.pipeline import Result, analyze
from doppelgait.pipeline.pictures import is_picture, read_picture
from doppelgait.pipeline.result import read_signal
from doppelgait.pipeline.spectrogram import make_level_gate
from doppelgait.pipeline.target import analyze_signature
from doppelgait.radar import read_recording
from doppelgait.radar.recording import Recording

TOLERANCE = 0.01
"""Tolerance of limits, as a fraction of the period of pulses (or bursts)."""


@dataclass(frozen=True)
class Part:
    """Part of a recording, with times that start at 0."""

    start_s: float
    stop_s: float
    recording: Recording | xr.DataArray


@dataclass(frozen=True)
class _Blocks:
    """Pulses, or bursts of pulses, which are never split."""

    starts_s: npt.NDArray[np.float64]
    pulses: int
    period_s: float

    @property
    def duration_s(self) -> float:
        return self.starts_s.size * self.period_s

    def between(self, start_s: float, stop_s: float) -> slice:
        """Return pulses of blocks that begin in [start_s, stop_s)."""
        margin_s = TOLERANCE * self.period_s
        first, last = np.searchsorted(self.starts_s, [start_s - margin_s, stop_s - margin_s])
        return slice(int(first) * self.pulses, int(last) * self.pulses)


def cut(
    recording: Recording | xr.DataArray,
    *,
    start_s: float | None = None,
    stop_s: float | None = None,
    window_s: float | None = None,
    step_s: float | None = None,
) -> list[Part]:
    """Split a recording into parts."""
    if isinstance(recording, xr.DataArray):
        times_s, pulses = read_axis(recording, "time"), 1
    else:
        times_s = recording.slow_time_s.astype(np.float64)
        pulses = recording.frames.slow_time.find_bursts().burst_pulses or 1
    block_starts_s = times_s[: times_s.size // pulses * pulses : pulses] - times_s[0]
    if block_starts_s.size < 2:
        raise AnalysisError(f"has {block_starts_s.size} {'pulses' if pulses == 1 else 'bursts'}, at least 2 are needed")
    blocks = _Blocks(block_starts_s, pulses, float(block_starts_s[-1] / (block_starts_s.size - 1)))
    duration_s = blocks.duration_s
    margin_s = TOLERANCE * blocks.period_s
    begin, end = start_s or 0.0, duration_s if stop_s is None else stop_s
    for name, value in (("start_s", begin + blocks.period_s), ("stop_s", end)):
        if value > duration_s + margin_s:
            limit_s = begin if name == "start_s" else end
            raise AnalysisError(f"{name} = {limit_s:g}: the recording lasts {duration_s:.6g} s")
    if window_s is None or step_s is None:
        return [_make_part(recording, blocks, begin, end)]
    count = int(np.floor((end - begin - window_s + margin_s) / step_s)) + 1
    if count < 1:
        raise AnalysisError(f"lasts {end - begin:.6g} s, less than a window of {window_s:g} s")
    starts_s = (begin + n * step_s for n in range(count))
    return [_make_part(recording, blocks, at, min(at + window_s, end)) for at in starts_s]


def _make_part(recording: Recording | xr.DataArray, blocks: _Blocks, start_s: float, stop_s: float) -> Part:
    chosen = blocks.between(start_s, stop_s)
    if isinstance(recording, xr.DataArray):
        cropped = recording.isel(time=chosen)
        times = ("time", read_axis(cropped, "time") - read_axis(cropped, "time")[:1], cropped["time"].attrs)
        return Part(start_s, stop_s, cropped.assign_coords(time=times))
    part = recording.frames.take_pulses(chosen)
    times_s = part.slow_time.time_s
    if times_s.size < 2:
        raise AnalysisError(f"{start_s:g} to {stop_s:g} s: holds {times_s.size} pulses, at least 2 are needed")
    part = replace(part, slow_time=replace(part.slow_time, time_s=times_s - times_s[0]))
    return Part(start_s, stop_s, recording.with_frames(part, truth=()))


SEVERAL = "several_tracks:the_label_went_to_the_surest"


@dataclass
class RecordedExamples:
    """Maker of the examples of labelled recordings."""

    config: ImportConfig
    folder: Path
    directory: str
    hashes: Mapping[str, str]
    identity: str
    batch_size: int = 1  # entries can be long

    def make(self, entries: Sequence[PlannedEntry]) -> list[ExampleData]:
        """Analyse the windows of entries; faults become failures."""
        return [self._make_windows(entry) for entry in entries]

    def _make_windows(self, entry: PlannedEntry) -> ExampleData:
        made, line, config = ExampleData(), entry.entry, self.config

        def fail(name: str, error: Exception) -> None:
            spec = {"line": line.line, "file": line.recording, "start_s": line.start_s, "stop_s": line.stop_s}
            reason = _remove_folder(describe_failure(error), self.folder)
            made.failures.append({"id": name, "reason": reason, "spec": json.dumps({**spec, "split": entry.split})})

        try:
            recording, notes = _read(
                self.folder, line.recording, self.hashes[line.recording], tuple(sorted(line.options.items()))
            )
            parts = cut(
                recording, start_s=line.start_s, stop_s=line.stop_s, window_s=config.window_s, step_s=config.step_s
            )
        except Exception as error:
            fail(entry.id, error)
            return made
        for number, part in enumerate(parts):
            name = entry.id if config.window_s is None else f"{entry.id}-w{number:04d}"
            try:
                analysed = part.recording
                with limit_blas_threads(), collect_messages(partial(_remove_folder, folder=self.folder)) as messages:
                    if isinstance(analysed, Recording):
                        results: Sequence[Result] = analyze(
                            analysed, gate=line.gate, analysis=config.analysis, tracking=config.tracking
                        )
                    else:
                        settings = config.analysis.resolved(None)
                        results = [analyze_signature(analysed, make_level_gate(analysed), settings, label=None)]
                result = find_labelled_result(results)
                signals: dict[str, Any] = {spec.name: read_signal(result, spec.name) for spec in config.fields}
                if "baseband" in signals:
                    signals["baseband"] = getattr(analysed, "baseband", None)
                stored = encode_arrays(config.fields, signals)
            except Exception as error:
                fail(name, error)
                continue
            source = "none" if line.nobody else "measured"
            columns = {
                "id": name,
                "scene_id": entry.id,
                "label": line.label,
                "split": entry.split,
                "subject": entry.subject,
                "group": entry.group,
                "source": source,
                "recording": line.recording,
                "recording_sha256": self.hashes[line.recording],
                "licence": line.licence,
                "citation": line.citation,
                "session": line.session,
                "motion_kind": source,
                "motion": "",
                "observation_s": part.stop_s - part.start_s,
                "window_start_s": part.start_s,
                "window_stop_s": part.stop_s,
                # values from simulations are unknown
                **{"environment": "", "impairments": "", "radar_height_m": None, "rcs_total_m2": None},
                "gate_error_m": None,
                **_make_radar_columns(analysed, self.folder),
                **line.further,
                **_make_outcome_columns(entry, results, result),
                "warnings": _join((*notes, *messages)),
            }
            made.rows.append(convert_to_json(columns))
            made.arrays.append(stored)
        return made


def _make_radar_columns(analysed: Recording | xr.DataArray, folder: Path) -> dict[str, Any]:
    if isinstance(analysed, xr.DataArray):
        carrier_hz = SPEED_OF_LIGHT_MPS / float(analysed.attrs["wavelength_m"])
        note = f"a picture: {analysed.attrs['picture']}"
        return {"prf_hz": analysed.attrs["prf_hz"], "carrier_hz": carrier_hz, "snr_frame_db": None, "notes": note}
    return {
        "prf_hz": analysed.radar.prf_hz,
        "carrier_hz": analysed.radar.carrier_hz,
        "snr_frame_db": analysed.snr_frame_db,
        "notes": _join(_remove_folder(note, folder) for note in analysed.notes),
    }


@lru_cache(maxsize=1)  # lines of one recording are consecutive
def _read(
    folder: Path, recording: str, sha256: str, options: tuple[tuple[str, Any], ...]
) -> tuple[Recording | xr.DataArray, tuple[str, ...]]:
    loaded: Recording | xr.DataArray
    with collect_messages(partial(_remove_folder, folder=folder)) as messages:
        if is_picture(recording):
            if unknown := sorted(set(dict(options)) - {"config"}):
                raise AnalysisError(f"{recording}: a picture has no option {', '.join(unknown)}; it has config")
            loaded = read_picture(folder / recording, **dict(options))
        else:
            loaded = read_recording(folder / recording, **dict(options))
    return loaded, tuple(messages)


def find_labelled_result(results: Sequence[Result]) -> Result | None:
    """Return the track of longest duration weighted by confidence, or None."""

    def weight(result: Result) -> tuple[bool, bool, float]:
        quality = result.quality
        if "track_confidence" not in quality:
            return result.is_body, False, float(quality.get("breathing_confidence") or 0.0)
        seconds = float(quality["track_stop_s"] - quality["track_start_s"])
        return result.is_body, True, float(quality["track_confidence"]) * seconds

    return max(results, key=weight, default=None)


def _make_outcome_columns(planned: PlannedEntry, results: Sequence[Result], result: Result | None) -> dict[str, Any]:
    tracked = planned.entry.gate == "track"
    n_tracks = len(results) if tracked else None
    if result is None:
        missing = "nobody:nothing_found" if planned.entry.nobody else "not_tracked"
        return {"gate": "track", **NOTHING, "flags": missing, "n_tracks": n_tracks}
    columns = {**result.to_row(), "n_tracks": n_tracks}
    if tracked and sum(one.is_body for one in results) > 1:
        columns["flags"] = ";".join(filter(None, (columns["flags"], SEVERAL)))
    return columns


def _remove_folder(text: str, folder: Path) -> str:
    return text.replace(f"{folder}/", "").replace(f"{folder}\\", "")


def _join(texts: Iterable[str]) -> str:
    return ";".join(dict.fromkeys(text.replace(";", ",") for text in texts))
