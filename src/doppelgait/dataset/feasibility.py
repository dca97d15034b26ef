"""Outlook of a plan: counts, subjects, size and time, and rows beyond the limits of the radar.

For the limits motions are observed as in a simulation, but no echo is synthesised.
"""

from __future__ import annotations

import math
import os
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from doppelgait.core.config import format_canonical_json
from doppelgait.core.errors import DoppelgaitError
from doppelgait.core.files import open_atomically
from doppelgait.core.frames import SlowTime
from doppelgait.core.labels import ScattererTable
from doppelgait.core.units import FloatArray
from doppelgait.dataset.config import SPLITS, Progress
from doppelgait.dataset.motions import find_source_entry, find_subject, list_recording_paths
from doppelgait.dataset.plan import Plan, Shard, parse_source
from doppelgait.dataset.resolve import ExampleSpec
from doppelgait.dataset.shard import BuildContext, build_shard, collect_messages
from doppelgait.pipeline.simulate import choose_lowest_prf, observe_scene, pulse_times_s
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.signature import make_gated_transform
from doppelgait.radar.link import compute_scatterer_arrays, noise_power_v2
from doppelgait.radar.parameters import Radar
from doppelgait.radar.simulate import warn_of_limits
from doppelgait.scene.placement import BACKGROUND, place

LIMIT_KEYS = {
    "aliasing": ("radar.prf_hz",),
    "outside the frame": ("target.range_m", "radar.range_stop_m"),
    "folding": ("target.range_m", "radar.pulse_rate_hz", "radar.sample_rate_hz"),
    "sparse range bins": ("radar.decimation", "radar.sample_rate_hz"),
    "gate cut off": ("target.range_m", "radar.range_stop_m"),
}
"""Keys of a plan to change where a limit affects rows, of any radar."""
LIMITS = tuple(LIMIT_KEYS)
"""Limits of a row: four warnings of the simulation, and the flag ``gate_leaves_frame`` of the analysis."""
GATE_FLAG = "gate_leaves_frame"
RANGE_PARTS = 4  # number of range intervals, with equally many rows each, in the table of the SNR
SNR_PULSES = 200  # number of pulses over which the expected SNR of a row is averaged
BLOCK_PULSES = 4096  # number of pulses that are observed together


@dataclass(frozen=True)
class RowLimits:
    """Limits of one planned row."""

    id: str
    label: str
    limits: Mapping[str, list[str]]  # with the keys to change
    range_m: float
    snr_db: float


def list_limit_keys(name: str, radar: Radar) -> list[str]:
    """List the keys to change for a limit of a radar."""
    # echoes of pulses fold by the pulse rate, those of sweeps by the sampling rate
    unused = {"radar.sample_rate_hz" if name == "folding" and radar.folds_pulses else "radar.pulse_rate_hz"}
    unused |= set() if "decimation" in radar.waveform.takes else {"radar.decimation"}
    keys = [key for key in LIMIT_KEYS[name] if key not in unused]
    return [key.replace("pulse_rate", "prf") if radar.pulse_rate_hz is None else key for key in keys]


def find_limits(example: ExampleSpec, folder: Path, *, gate: str = "truth") -> list[RowLimits]:
    """Find the limits of every row of an example."""
    run, ranges_m, strongest_v2 = example.run, [], []
    with collect_messages() as messages:
        placed = place(run.scene, run.streams, folder=folder)
        radar = choose_lowest_prf(placed, run.radar, cpi_s=run.analysis.cpi_s) if run.auto_prf else run.radar
        slow_time_s = pulse_times_s(placed.observation_s, radar)
        has_jumps = any(t.motion.report.get("has_jumps") for t in placed.targets)
        step = -(-slow_time_s.size // SNR_PULSES)
        for first in range(0, slow_time_s.size, BLOCK_PULSES):  # an episode fills gigabytes
            times_s = slow_time_s[first : first + BLOCK_PULSES]
            table, tracks = observe_scene(placed, radar, times_s, run.conditions, angles=False, streams=run.streams)
            warn_of_limits(table, radar, has_jumps=has_jumps)
            ranges_m.append(np.reshape([track.range_m for track in tracks], (len(tracks), times_s.size)))
            strongest_v2.append(_find_strongest_v2(table.take_pulses(slice(-first % step, None, step)), radar))
            del table
    found = set(messages) - {"outside the frame" if "folding" in messages else ""}  # as of one block
    power_v2 = float(np.concatenate(strongest_v2).mean())
    analysis = run.analysis.resolved("truth")
    rows = []
    for row, range_m in zip(example.rows, np.concatenate(ranges_m, axis=1), strict=True):
        there = np.isfinite(range_m)
        gate_m = range_m[there] + example.gate_error_m
        cut = gate == "truth" and not example.is_episode and _leaves_frame(gate_m, slow_time_s[there], radar, analysis)
        inside = (range_m >= radar.range_start_m) & (range_m <= radar.range_stop_m)
        own = {"outside the frame": radar.waveform.ranged and not inside.any(), "gate cut off": cut}
        limits = {name: list_limit_keys(name, radar) for name in LIMITS if name in found or own.get(name)}
        snr_db = math.nan
        if row.source != "none" and run.noise.kind == "snr":
            snr_db = float(run.noise.snr_db)
        elif row.source != "none" and run.noise.kind == "thermal":
            snr_db = 10.0 * math.log10(power_v2 / noise_power_v2(radar)) if power_v2 > 0 else -math.inf
        rows.append(RowLimits(row.id, row.label, limits, float(range_m[there].mean()), snr_db))
    return rows


def _leaves_frame(range_m: FloatArray, slow_time_s: FloatArray, radar: Radar, analysis: Analysis) -> bool:
    """Return True if the gate is partly outside the frame."""
    bins_m = radar.range_axis_m()
    gate = Gate.around(slow_time_s, range_m, span_m=analysis.gate_span_m)
    if radar.burst_pulses is not None:
        low, high = gate.edges(bins_m, slow_time_s, sharp=analysis.sharp_edges)
    else:
        cut = make_gated_transform(gate, SlowTime(slow_time_s), bins_m, analysis)
        low, high = cut.low, cut.high
    return bool((low < -0.5).any() or (high > bins_m.size - 0.5).any())


def _find_strongest_v2(table: ScattererTable, radar: Radar) -> FloatArray:
    # the echo powers in each range cell are added; the strongest cell of every pulse is used
    range_m, amplitude_v = compute_scatterer_arrays(table, radar)
    seen = (table["target"] != BACKGROUND) & (range_m >= radar.range_start_m) & (range_m <= radar.range_stop_m)
    cell = np.where(seen, (range_m - radar.range_start_m) / radar.range_resolution_m, 0.0).astype(np.int64)
    power_v2 = np.zeros((range_m.shape[0], int(cell.max(initial=0)) + 1))
    np.add.at(power_v2, (np.arange(range_m.shape[0])[:, None], cell), np.where(seen, amplitude_v, 0.0) ** 2)
    return np.asarray(power_v2.max(axis=1))


@dataclass(frozen=True)
class Feasibility:
    """Rows of a plan that reach a limit of its radar."""

    n_examples: int
    n_failed: int
    limits: list[dict[str, Any]]
    snr: list[dict[str, Any]]
    keys: dict[str, list[str]]  # to change, by limit that rows reach

    @property
    def judges_gate(self) -> bool:
        """Return True if gates that the frame cuts off are counted."""
        return all(row[LIMITS[-1]] is not None for row in self.limits)

    def tables(self) -> list[list[dict[str, Any]]]:
        """Return the tables to print: rows by limit, SNR by range."""
        always = ("aliasing", LIMITS[1], LIMITS[-1]) if self.judges_gate else ("aliasing", LIMITS[1])
        shown = [name for name in LIMITS if name in self.keys or name in always]
        limits = [{name: row[name] for name in ("class", "rows", *shown)} for row in self.limits]
        lost = any(part["rows_without_echo"] for part in self.snr)
        snr = [
            {
                "range (m)": "{:.1f} to {:.1f}".format(*part["range_m"]),
                "rows": part["rows"],
                **({"without echo": part["rows_without_echo"]} if lost else {}),
                "SNR_frame (dB)": "{1:.0f} ({0:.0f} to {2:.0f})".format(*part["snr_db"]) if part["snr_db"] else "",
            }
            for part in self.snr
        ]
        return [limits, snr]


def assess(examples: Iterable[ExampleSpec], folder: Path, *, gate: str = "truth") -> Feasibility:
    """Count the rows of examples that reach a radar limit."""
    rows, done, failed = list[RowLimits](), 0, 0
    for example in examples:
        try:
            rows += find_limits(example, folder, gate=gate)
        except DoppelgaitError:  # the build leaves the example out, too, and reports the reason
            failed += 1
        done += 1
    marks = {name: [name in row.limits for row in rows] for name in LIMITS}
    limits = _count_limits([row.label for row in rows], marks)
    if gate == "track":
        limits = [{**row, LIMITS[-1]: None} for row in limits]
    known = sorted((row for row in rows if not math.isnan(row.snr_db)), key=lambda row: row.range_m)
    parts = [[known[int(n)] for n in part] for part in np.array_split(np.arange(len(known)), RANGE_PARTS) if part.size]
    snr = []
    for part in parts:
        levels = [row.snr_db for row in part if math.isfinite(row.snr_db)]
        quantiles = [float(level) for level in np.quantile(levels, [0.05, 0.5, 0.95])] if levels else None
        span, lost = [part[0].range_m, part[-1].range_m], len(part) - len(levels)
        snr.append({"range_m": span, "rows": len(part), "rows_without_echo": lost, "snr_db": quantiles})
    keys = {name: [*dict.fromkeys(key for row in rows for key in row.limits.get(name, ()))] for name in LIMITS}
    return Feasibility(done, failed, limits, snr, {name: own for name, own in keys.items() if own})


def format_limit_keys(keys: Mapping[str, Iterable[str]]) -> str:
    """Format the plan keys to change, by reached limit."""
    return "; ".join(f"{name}: {', '.join(own)}" for name, own in keys.items())


def limits_of_index(index: pd.DataFrame) -> list[dict[str, Any]]:
    """Count the affected rows of a built dataset, by class."""
    if not len(index) or "warnings" not in index:
        return []
    texts, flags = (index[name].fillna("").astype(str) for name in ("warnings", "quality_flags"))
    marks = {name: [name in text.split(";") for text in texts] for name in LIMITS[:-1]}
    marks[LIMITS[-1]] = [GATE_FLAG in text.split(";") for text in flags]
    return _count_limits(index["label"].astype(str).tolist(), marks)


def _count_limits(labels: list[str], marks: dict[str, list[bool]]) -> list[dict[str, Any]]:
    table = pd.DataFrame({"class": labels, "rows": 1, **marks})
    counts = table.groupby("class", sort=False).sum().astype(int).reset_index()
    return [{str(name): value for name, value in row.items()} for row in counts.to_dict("records")]


ROW_BYTES = 5000  # an index row and its copy in the shard's record


def summarise(
    plan: Plan, identity: str, *, n_checked: int, pilot: int, on_progress: Progress | None = None
) -> dict[str, Any]:
    """Summarise a plan: examples, subjects, files and duration."""
    sections = list(enumerate(plan.config.sections))
    examples = Counter((entry.class_number, entry.split) for entry in plan.examples)
    counts = [
        {"class": section.label, **{split: examples[number, split] for split in SPLITS}} for number, section in sections
    ]
    different = {(e.class_number, parse_source(e.subjects[0]), e.split, e.subjects[0]) for e in plan.examples}
    sources = Counter(key[:3] for key in different)
    subjects = [
        {"class": section.label, "source": source, **{split: sources[number, source, split] for split in SPLITS}}
        for number, section in sections
        for source in ("model", "recording")
        if any(sources[number, source, split] for split in SPLITS)
    ]
    files = []
    if any(parse_source(subject) != "model" for entry in plan.examples for subject in entry.subjects):
        used = Counter(
            path
            for example in map(plan.example, range(len(plan.examples)))
            for target in example.run.scene.targets[: len(example.rows)]
            for path in list_recording_paths(target.motion)
        )
        for recording, count in sorted(used.items()):
            subject = find_subject({"kind": "file", "path": recording}, "", plan.config.sources)
            entry = find_source_entry(recording, plan.config.sources)
            licence = entry.licence if entry is not None and entry.licence else "unknown"
            files.append({"file": recording, "subject": subject, "examples": count, "licence": licence})
    return {
        "name": plan.config.dataset.name,
        "dataset_id": identity,
        "n_examples": len(plan.examples),
        "n_shards": sum(1 for _ in plan.shards()),
        "counts": counts,
        "subjects": subjects,
        "files": files,
        "n_checked": n_checked,
        "estimate": _estimate_cost(plan, min(pilot, len(plan.examples)), on_progress) if pilot else {},
    }


def _estimate_cost(plan: Plan, count: int, on_progress: Progress | None) -> dict[str, Any]:
    """Build ``count`` examples for an estimate of time and size."""
    total = len(plan.examples)
    entries = tuple(plan.examples[place * total // count] for place in range(count))
    with tempfile.TemporaryDirectory() as directory:
        (Path(directory) / "shards").mkdir()
        context = BuildContext(plan.config, str(plan.folder), directory)
        context.make(entries[:1])  # the first one loads the libraries
        began = time.process_time()
        record = build_shard(Shard("pilot", entries[0].split, entries), context, on_progress)
        seconds = (time.process_time() - began) / count
    size, processors = record["bytes"] / count, os.cpu_count() or 1
    return {
        "pilot_examples": count,
        "pilot_failures": len(record["failures"]),
        "pilot_failure": next(("{id}: {reason}".format(**failure) for failure in record["failures"]), ""),
        "seconds_per_example": seconds,
        "bytes_per_example": size,
        "total_bytes": (size + ROW_BYTES) * total,
        "processors": processors,
        "total_seconds": seconds * total / processors,
    }


def write_specs(plan: Plan, path: Path) -> None:
    """Write every resolved example, one line of JSON each."""
    with open_atomically(path) as partial, partial.open("w", encoding="utf-8") as handle:
        handle.writelines(format_canonical_json(plan.example(n)) + "\n" for n in range(len(plan.examples)))
