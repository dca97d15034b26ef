"""Labelled recordings: windows, index rows and stored arrays."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import xarray as xr

from doppelgait.core.config import convert_to_json
from doppelgait.core.errors import AnalysisError
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.core.worker import limit_blas_threads
from doppelgait.dataset.config import ImportConfig
from doppelgait.dataset.shard import NOTHING, ExampleData, collect_messages, describe_failure
from doppelgait.dataset.shard_files import encode_arrays
from doppelgait.dataset.splits import PlannedEntry
from doppelgait.dataset.windows import cut
from doppelgait.pipeline import Result, analyze
from doppelgait.pipeline.pictures import is_picture, read_picture
from doppelgait.pipeline.result import read_signal
from doppelgait.pipeline.spectrogram import make_level_gate
from doppelgait.pipeline.target import analyze_signature
from doppelgait.radar import read_recording
from doppelgait.radar.recording import Recording

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
            limits = {"start_s": line.start_s, "stop_s": line.stop_s}
            parts = [*cut(recording, window_s=config.window_s, step_s=config.step_s, **limits)]
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
