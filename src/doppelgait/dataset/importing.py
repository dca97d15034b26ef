"""Datasets from the user's recordings: labels, windows, index rows and stored arrays."""

from __future__ import annotations

import hashlib
import json
import re
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import xarray as xr

from doppelgait.core.config import convert_to_json, format_canonical_json
from doppelgait.core.errors import AnalysisError, ConfigError, DatasetError, warn_caller
from doppelgait.core.files import hash_file
from doppelgait.core.plugins import identify_plugins
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.core.worker import limit_blas_threads
from doppelgait.dataset.build import Job, build_job
from doppelgait.dataset.card import import_card
from doppelgait.dataset.config import ImportConfig, Progress
from doppelgait.dataset.finish import DATA_VERSION, Header, find_dataset, read_records, tally
from doppelgait.dataset.labels import LabelEntry, hash_recording, read_labels
from doppelgait.dataset.lock import write_new_folder
from doppelgait.dataset.plan import PlannedExample, plan_entries, split_into_shards
from doppelgait.dataset.shard import NOTHING, ExampleData, collect_messages, describe_failure
from doppelgait.dataset.shard_files import encode_arrays
from doppelgait.dataset.windows import cut
from doppelgait.pipeline import Result, analyze
from doppelgait.pipeline.pictures import is_picture, read_picture
from doppelgait.pipeline.result import read_signal
from doppelgait.pipeline.spectrogram import make_level_gate
from doppelgait.pipeline.target import analyze_signature
from doppelgait.radar import read_recording
from doppelgait.radar.recording import Recording

__all__ = ["ImportConfig", "ImportReport", "LabelEntry", "import_dataset", "import_id", "read_labels"]


@dataclass(frozen=True)
class ImportReport:
    """Report of an import."""

    directory: Path
    dataset_id: str
    n_recordings: int  # recordings, or parts of them, that the labels name
    n_rows: int  # of the index: one per recording or window
    n_not_tracked: int  # rows without features, because an expected target was not found
    n_failed: int  # recordings or windows that could not be read or analysed; they are not in the dataset
    failures: list[dict[str, Any]]  # the first 100 of them: ``id``, ``reason``, ``spec`` (line, file)
    counts: dict[str, int]  # rows of every class
    bytes: int  # size of the shards
    seconds: float
    was_there: bool  # the folder already contained the same import, which is then unchanged


def import_dataset(
    folder: str | Path,
    labels: str | Path | Sequence[LabelEntry],
    directory: str | Path,
    *,
    config: ImportConfig | None = None,
    on_progress: Progress | None = None,
) -> ImportReport:
    """Make a dataset from recordings and a label file."""
    # Each recording, part of a recording or window is a row. The detected target gets the label. If
    # there are several, it is the track with the longest duration weighted by confidence;
    # ``n_tracks`` and a flag record this. If there is none, the row has no features and the flag
    # ``not_tracked``, so that scores count it. A recording that cannot be read or analysed is a
    # failure with its reason; the others are imported. The folder appears when it is complete, and
    # repeating the same import changes nothing.
    began = time.monotonic()
    settings = config or ImportConfig()
    source, target = Path(folder), Path(directory).absolute()
    if not source.is_dir():
        raise ConfigError(f"{source}: no such folder of recordings")
    named = Path(labels).name if isinstance(labels, str | Path) else "names of files"
    entries = read_labels(labels, source, gate=settings.gate) if isinstance(labels, str | Path) else list(labels)
    planned = plan_entries(entries, settings, named)
    if len({one.split for one in planned if not one.entry.subject}) > 1:
        warn_caller(f"{named}: subjects are missing; one body may be in several splits")
    recordings = dict.fromkeys(one.entry.recording for one in planned)
    hashes = {recording: hash_recording(source, recording) for recording in recordings}
    plugins = identify_plugins(settings.model_dump(mode="json"), {"radar_reader": [source / name for name in hashes]})
    described: dict[str, str] = {}
    for entry in entries:
        if isinstance(config_name := entry.options.get("config"), str):  # settings files that a reader uses
            beside = (source / entry.recording).parent / config_name
            used = next((path for path in (Path(config_name), beside) if path.is_file()), None)
            described[f"option.config={config_name}"] = "" if used is None else hash_file(used)
    identity = import_id(labels, hashes | described, settings, plugins)
    title = re.sub(r"[^A-Za-z0-9._-]+", "-", target.name).strip("-.") or "imported"
    header = Header(
        id=identity,
        name=title,
        origin="imported",
        labels=tuple(dict.fromkeys(one.entry.label for one in planned)),
        fields=settings.fields,
        n_examples=len(planned),
        config=settings.model_dump(mode="json"),
        card=lambda index, n_failed: import_card(
            index, name=title, identity=identity, config=settings, labels=named, n_failed=n_failed
        ),
        plugins=plugins,
    )
    shards = list(split_into_shards(planned, settings.shard_size))
    was_there = find_dataset(target, header) is not None
    if not was_there:
        with write_new_folder(target, "dataset") as partial:
            maker = RecordedExamples(settings, source, str(partial), hashes, identity, len(planned), on_progress)
            build_job(Job(partial, header, maker, shards, shards))
    try:
        totals = tally(read_records(target, (shard.name for shard in shards)))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DatasetError(f"{target}: is damaged: {error}; delete the folder and import again") from None
    return ImportReport(
        directory=target,
        dataset_id=identity,
        n_recordings=len(planned),
        n_rows=totals.rows,
        n_not_tracked=totals.n_not_tracked,
        n_failed=totals.n_failed,
        failures=totals.failures,
        counts=dict(totals.counts),
        bytes=totals.bytes,
        seconds=time.monotonic() - began,
        was_there=was_there,
    )


def import_id(
    labels: str | Path | Sequence[LabelEntry],
    hashes: dict[str, str],
    config: ImportConfig,
    plugins: Sequence[Mapping[str, Any]] = (),
) -> str:
    """Compute an import's identity: labels, recordings, configuration and data version."""
    settings = format_canonical_json(config)
    digest = hashlib.sha256(f"import {DATA_VERSION}\n{settings}\n{format_canonical_json(hashes)}\n".encode())
    if isinstance(labels, str | Path):
        digest.update(Path(labels).read_bytes())
    else:
        digest.update(format_canonical_json({"labels": [asdict(entry) for entry in labels]}).encode())
    for item in plugins:
        digest.update(format_canonical_json(item).encode())
    return digest.hexdigest()[:16]


@dataclass
class RecordedExamples:
    """Maker of the examples of labelled recordings."""

    config: ImportConfig
    folder: Path
    directory: str
    hashes: Mapping[str, str]
    identity: str
    n_entries: int
    on_progress: Progress | None
    batch_size: int = 1  # entries can be long
    done: int = 0

    def make(self, entries: Sequence[PlannedExample]) -> list[ExampleData]:
        """Analyse the windows of entries; faults become failures."""
        made = []
        for entry in entries:
            made.append(self._make_windows(entry))
            self.done += 1
            if self.on_progress is not None:
                self.on_progress(self.done, self.n_entries)
        return made

    def _make_windows(self, entry: PlannedExample) -> ExampleData:
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
                with limit_blas_threads(), collect_messages(lambda text: _remove_folder(text, self.folder)) as messages:
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
            if isinstance(analysed, Recording):
                prf_hz, carrier_hz, snr_db = analysed.radar.prf_hz, analysed.radar.carrier_hz, analysed.snr_frame_db
                facts = _join(_remove_folder(note, self.folder) for note in analysed.notes)
            else:
                prf_hz, snr_db, facts = analysed.attrs["prf_hz"], None, f"a picture: {analysed.attrs['picture']}"
                carrier_hz = SPEED_OF_LIGHT_MPS / float(analysed.attrs["wavelength_m"])
            missing = {"gate": "track", **NOTHING, "flags": "nobody:nothing_found" if line.nobody else "not_tracked"}
            outcome = missing if result is None else result.to_row()
            outcome["n_tracks"] = len(results) if line.gate == "track" else None
            if line.gate == "track" and sum(one.is_body for one in results) > 1:
                several = "several_tracks:the_label_went_to_the_surest"
                outcome["flags"] = ";".join(filter(None, (outcome["flags"], several)))
            source = "none" if line.nobody else "measured"
            columns = {
                "id": name,
                "scene_id": entry.id,
                "label": line.label,
                "split": entry.split,
                "subject": entry.subjects[0],
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
                "prf_hz": prf_hz,
                "carrier_hz": carrier_hz,
                "snr_frame_db": snr_db,
                "notes": facts,
                **line.further,
                **outcome,
                "warnings": _join((*notes, *messages)),
            }
            made.rows.append(convert_to_json(columns))
            made.arrays.append(stored)
        return made


@lru_cache(maxsize=1)  # lines of one recording are consecutive
def _read(
    folder: Path, recording: str, sha256: str, options: tuple[tuple[str, Any], ...]
) -> tuple[Recording | xr.DataArray, tuple[str, ...]]:
    loaded: Recording | xr.DataArray
    with collect_messages(lambda text: _remove_folder(text, folder)) as messages:
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


def _remove_folder(text: str, folder: Path) -> str:
    return text.replace(f"{folder}/", "").replace(f"{folder}\\", "")


def _join(texts: Iterable[str]) -> str:
    return ";".join(dict.fromkeys(text.replace(";", ",") for text in texts))
