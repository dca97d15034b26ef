"""Shards: simulate, analyse and write their examples, all or nothing."""

from __future__ import annotations

import json
import math
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from doppelgait.core import files
from doppelgait.core.config import convert_to_json, format_canonical_json
from doppelgait.core.draws import replace_by_middle
from doppelgait.core.errors import DatasetError, DoppelgaitError, DoppelgaitWarning
from doppelgait.core.interrupt import raise_if_stopped
from doppelgait.core.samples import Samples
from doppelgait.core.worker import limit_blas_threads
from doppelgait.dataset.config import DatasetSection, FieldSpec, PlanConfig, Progress
from doppelgait.dataset.motions import THING
from doppelgait.dataset.plan import PlannedExample, Shard
from doppelgait.dataset.resolve import Compiled, ExampleSpec, resolve_example
from doppelgait.dataset.shard_files import Arrays, encode_arrays, hash_contents, write_shard
from doppelgait.dataset.windows import Links, analyze_window, cut_windows
from doppelgait.features import FEATURE_UNITS
from doppelgait.pipeline import Result, analyze
from doppelgait.pipeline.analyze import analyze_together, compute_signatures
from doppelgait.pipeline.result import read_signal
from doppelgait.pipeline.run import simulate_placed
from doppelgait.pipeline.target import Gated
from doppelgait.processing.config import plan_transform
from doppelgait.radar.recording import Recording, TargetTruth
from doppelgait.scene import PlacedScene
from doppelgait.scene.placement import place, place_all

MAX_BATCH = 16  # maximum number of examples that are made together
BATCH_S = 60.0
"""Maximum duration, s, of the scenes that are made together, so that memory does not grow with their number."""
BATCH_BYTES = 48_000_000
"""Maximum size of basebands and signatures that are kept of examples that are made together."""
MOST_APART_M = 1.0  # maximum mean distance, m, between a track and its body
LEAST_SHARE = 0.3  # minimum fraction of the observation that a track must cover


def match_tracks(
    results: Sequence[Result], truths: Sequence[TargetTruth], slow_time_s: npt.NDArray[np.float64]
) -> list[Result | None]:
    """Match every target to the nearest track of its body."""
    # Each track is used once, nearest pairs first. Shapes: slow_time_s (I,).
    pairs = []
    for number, truth in enumerate(truths):
        for order, result in enumerate(results):
            times_s = result.gate.time_s
            if times_s.size < 2 or times_s[-1] - times_s[0] < LEAST_SHARE * np.ptp(slow_time_s):
                continue
            middle_m = (result.gate.low_m + result.gate.high_m) / 2.0
            apart_m = np.abs(middle_m - np.interp(times_s, slow_time_s, truth.centre_range_m))
            there = np.isfinite(apart_m)
            distance_m = float(apart_m[there].mean()) if there.mean() > 0.5 else math.inf
            if distance_m <= MOST_APART_M:
                pairs.append((distance_m, number, order))
    tracks: dict[int, int] = {}
    for _, number, order in sorted(pairs):
        if number not in tracks and order not in tracks.values():
            tracks[number] = order
    return [results[tracks[number]] if number in tracks else None for number in range(len(truths))]


MIXED = "a batch has warnings that may be those of any example"
NOTHING = {
    **{f"feature_{name}": None for name in FEATURE_UNITS},
    **dict.fromkeys(("gait_frequency_hz", "torso_doppler_hz", "n_periods")),
}
"""Columns of a row without a target; they exist even if no row has a target."""


def _describe_setting(example: ExampleSpec, recording: Recording) -> dict[str, Any]:
    # the columns that all rows of an example share
    run, radar, is_empty = example.run, recording.radar, all(row.source == "none" for row in example.rows)
    return {
        "carrier_hz": run.radar.carrier_hz,
        "prf_hz": radar.prf_hz,
        "observation_s": recording.n_pulses / radar.prf_hz if radar.burst_pulses is None else recording.observation_s,
        "environment": format_canonical_json([s.model_dump(mode="json") for s in run.environment]),
        "impairments": format_canonical_json([s.model_dump(mode="json") for s in run.impairments]),
        "radar_height_m": run.scene.radar_position_m[2],
        "snr_frame_db": None if is_empty else recording.snr_frame_db,
        "gate_error_m": None if example.is_episode else example.gate_error_m,
    }


def describe_scene(example: ExampleSpec, recording: Recording) -> list[dict[str, Any]]:
    """Return the columns of an example that need no analysis, by row."""
    run, scene, rows = example.run, _describe_setting(example, recording), []
    for number, row in enumerate(example.rows):
        truth, motion = recording.truth[number], run.scene.observed_targets[number].motion
        rcs_m2 = np.asarray(truth.table["rcs"])
        there = np.isfinite(truth.centre_range_m)
        total_m2 = rcs_m2[: None if rcs_m2.strides[0] else 1].sum(axis=1)  # often the same at every pulse
        rows.append(
            {
                "id": row.id,
                "scene_id": example.id,
                "label": row.label,
                "split": example.split,
                "subject": row.subject,
                "others": json.dumps(row.others, ensure_ascii=False) if row.others else "",
                "group": example.group,
                "source": row.source,
                "recording": row.recording,
                "licence": row.licence,
                "motion_kind": "none" if row.source == "none" else motion["kind"],
                "motion": "" if row.source == "none" else format_canonical_json(motion),
                **scene,
                "rcs_total_m2": float(np.broadcast_to(total_m2, rcs_m2.shape[:1])[there].mean()),
                **(make_truth_columns(truth) if row.source != "none" else dict.fromkeys(TRUTH_COLUMNS)),
            }
        )
    return rows


def _mean_aspect_deg(truth: TargetTruth) -> float:
    aspect_rad = truth.centre_aspect_rad[np.isfinite(truth.centre_aspect_rad)]  # undefined for a body without motion
    return float(np.degrees(aspect_rad.mean())) if aspect_rad.size else math.nan


TRUTH_COLUMNS: dict[str, Callable[[TargetTruth], Any]] = {
    "truth_gait": lambda truth: truth.gait,
    "truth_height_m": lambda truth: truth.height_m,
    "truth_ground_speed_mps": lambda truth: truth.ground_speed_mps,
    "truth_radial_velocity_mps": lambda truth: float(np.nanmean(truth.centre_velocity_mps)),
    "truth_range_m": lambda truth: float(np.nanmean(truth.centre_range_m)),
    "truth_aspect_deg": _mean_aspect_deg,
    "truth_gait_frequency_hz": lambda truth: truth.gait_frequency_hz,
    "truth_step_frequency_hz": lambda truth: truth.step_frequency_hz,
    "truth_stride_frequency_hz": lambda truth: truth.stride_frequency_hz,
}


def make_truth_columns(truth: TargetTruth) -> dict[str, Any]:
    """Return the columns ``truth_*``, of simulations only."""
    return {name: measure(truth) for name, measure in TRUTH_COLUMNS.items()}


@dataclass
class ExampleData:
    """Rows, arrays and failures of one example."""

    rows: list[dict[str, Any]] = field(default_factory=list)
    arrays: list[Arrays] = field(default_factory=list)
    failures: list[dict[str, str]] = field(default_factory=list)

    def __iter__(self) -> Iterator[tuple[dict[str, Any], Arrays]]:
        return zip(self.rows, self.arrays, strict=True)


class ExampleMaker(Protocol):
    """Maker of examples, from a plan or recordings."""

    directory: str
    identity: str

    @property
    def batch_size(self) -> int:
        """Number of examples that are made together."""

    def make(self, entries: Sequence[Any]) -> list[ExampleData]:
        """Make examples together; the faults of one become its failures."""


@dataclass
class BuildContext:
    """Maker of the examples of a plan."""

    config: PlanConfig
    folder: str
    directory: str = ""
    identity: str = ""
    compiled: Compiled = field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def batch_size(self) -> int:
        """Number of examples that are made together: fewer of long scenes and of large arrays."""
        settings = self.config.dataset
        try:  # radar and settings of one example stand for all
            duration_s = replace_by_middle(self.config.scene).get("duration_s")
            run = resolve_example(self.config, 0, Path(self.folder)).run
            n_pulses = int(duration_s * run.radar.prf_hz)
            columns = plan_transform(run.analysis.resolved(settings.gate), n_pulses=n_pulses, prf_hz=run.radar.prf_hz)
        except (DoppelgaitError, TypeError):  # the second where no duration is stated
            return 1
        n_bytes = 4 * columns.n_columns * columns.n_doppler_bins
        if run.analysis.parts or any(spec.name == "baseband" for spec in settings.fields):
            n_bytes += 8 * n_pulses * run.radar.range_axis_m().size
        return max(1, min(MAX_BATCH, int(BATCH_S / duration_s), BATCH_BYTES // n_bytes))

    def make(self, entries: Sequence[PlannedExample]) -> list[ExampleData]:
        """Simulate and analyse planned examples."""
        examples = []
        for entry, made in zip(entries, build_planned(entries, self), strict=True):
            if isinstance(made, Exception):
                spec = json.dumps({"number": entry.number})
                with suppress(DoppelgaitError):
                    spec = format_canonical_json(resolve_example(self.config, entry.number, Path(self.folder)))
                made = ExampleData(failures=[{"id": entry.id, "reason": describe_failure(made), "spec": spec}])
            examples.append(made)
        return examples


def build_shard(shard: Shard, maker: ExampleMaker, on_progress: Progress | None = None) -> dict[str, Any]:
    """Build one shard file and its record, all or nothing."""
    rows: list[dict[str, Any]] = []
    failures: list[dict[str, str]] = []
    arrays: list[Arrays] = []
    size = maker.batch_size
    for first in range(0, len(shard.examples), size):
        raise_if_stopped()
        for made in maker.make(shard.examples[first : first + size]):
            failures += made.failures
            for row, stored in made:
                rows.append({**row, "shard": shard.name, "row": len(arrays)})
                arrays.append(stored)
        if on_progress:
            on_progress(min(first + size, len(shard.examples)), len(shard.examples))
    path = Path(maker.directory) / "shards" / f"{shard.name}.h5"
    with files.open_atomically(path, os_errors=True) as partial:
        write_shard(partial, shard.split, [row["id"] for row in rows], arrays, identity=maker.identity)
        record = {
            "dataset": maker.identity,
            "shard": shard.name,
            "contents_sha256": hash_contents(rows, arrays),
            "sha256": files.hash_file(partial),
            "bytes": partial.stat().st_size,
            "rows": rows,
            "failures": failures,
        }
    files.write_atomically(path.with_suffix(".json"), json.dumps(record, allow_nan=False).encode())
    return record


def describe_failure(error: Exception) -> str:
    """Return an error's text for a shard's record."""
    if isinstance(error, DoppelgaitError):
        return str(error)
    return "internal error: " + "".join(traceback.format_exception_only(error)).strip()


def build_planned(entries: Sequence[PlannedExample], context: BuildContext) -> list[ExampleData | Exception]:
    """Build planned examples together; the fault or warning of one does not reach the others."""
    folder, settings = Path(context.folder), context.config.dataset
    try:
        specs = [
            resolve_example(context.config, e.number, folder, split=e.split, group=e.group, compiled=context.compiled)
            for e in entries
        ]
        if context.config.episodes:
            return [build_episode(spec, settings, folder) for spec in specs]
        return [*build_examples(specs, settings.fields, folder, gate=settings.gate)]
    except Exception as error:
        if len(entries) == 1:
            return [error]
        return [made for entry in entries for made in build_planned([entry], context)]


def build_episode(example: ExampleSpec, settings: DatasetSection, folder: Path) -> ExampleData:
    """Build the rows of an episode: every track of every window."""
    made, links, run, missed = ExampleData(), Links(), example.run, set(range(len(example.rows)))
    with limit_blas_threads(), collect_messages() as messages:
        recording = simulate_placed(run, place(run.scene, run.streams, folder=folder), angles=False)
        recording = replace(recording, samples=Samples(recording.samples.matrix))  # noise is added once for all windows
        bodies = describe_scene(example, recording)
        nothing = {  # the columns of a track that follows no body
            "id": example.id,
            "scene_id": example.id,
            "label": THING,
            "split": example.split,
            "subject": f"model/{example.id}",
            "group": example.group,
            "source": "none",
            "motion_kind": "none",
            **dict.fromkeys(("others", "recording", "licence", "motion"), ""),
            **_describe_setting(example, recording),
            **dict.fromkeys(("rcs_total_m2", *TRUTH_COLUMNS)),
        }
        for number, window in enumerate(cut_windows(recording, settings.window_s, settings.hop_s)):
            raise_if_stopped()
            results = analyze_window(window, run.analysis)
            times = {"window_start_s": window.start_s, "window_stop_s": window.stop_s}
            for track, result in zip(links.add(window, results), results, strict=True):
                body = find_body(result, window.recording)
                missed -= {body}
                columns = nothing if body is None else bodies[body] | make_truth_columns(window.recording.truth[body])
                name = {"id": f"{example.id}-w{number:04d}-t{track}", **times, "track": track}
                signals: dict[str, Any] = {spec.name: read_signal(result, spec.name) for spec in settings.fields}
                signals |= {"baseband": window.recording.baseband} if "baseband" in signals else {}
                made.rows.append(columns | result.to_row() | name)
                made.arrays.append(encode_arrays(settings.fields, signals))
        # bodies that no track followed, and a recording without a body and a track, are a row each
        for columns in [bodies[body] for body in sorted(missed)] or ([] if made.rows else [nothing]):
            made.rows.append({**columns, **NOTHING, "gate": "track", "flags": "not_tracked"})
            made.arrays.append(encode_arrays(settings.fields, {spec.name: None for spec in settings.fields}))
    warned = ";".join(dict.fromkeys(messages))
    made.rows = [convert_to_json({**row, "warnings": warned}) for row in made.rows]
    return made


def find_body(result: Result, recording: Recording) -> int | None:
    """Return the body that a track follows, or None."""
    # it is the nearest one within MOST_APART_M, for most of the time
    gate, found = result.gate, []
    for number, truth in enumerate(recording.truth):
        apart_m = np.abs(gate.centre_m - np.interp(gate.time_s, recording.slow_time_s, truth.centre_range_m))
        there = np.isfinite(apart_m)
        if there.mean() > 0.5 and (distance_m := float(np.median(apart_m[there]))) <= MOST_APART_M:
            found.append((distance_m, number))
    return min(found)[1] if found else None


@dataclass(frozen=True)
class SimulatedExample:
    """Example that is simulated as far as the signatures of its targets."""

    columns: list[dict[str, Any]]
    signals: list[dict[str, Any]]  # of the recording, by row, as far as they are stored
    signatures: list[Gated]
    tracked: Sequence[Result | None]  # with gates from tracks, which leave no signatures
    messages: list[str]


def build_examples(
    examples: Sequence[ExampleSpec],
    fields: Sequence[FieldSpec],
    folder: Path,
    *,
    gate: Literal["truth", "track"] = "truth",
) -> list[ExampleData]:
    """Build examples; their motions are made, and their signatures analysed, together."""
    runs = [example.run for example in examples]
    scenes = place_all([run.scene for run in runs], [run.streams for run in runs], folder=folder)
    with limit_blas_threads():
        with collect_messages() as early:  # the first step makes the motions of all scenes
            first = next(scenes)
        if early and len(examples) > 1:
            raise DatasetError(MIXED)
        scenes = chain([first], scenes)
        simulated = [simulate_example(example, scenes, fields, gate) for example in examples]
        with collect_messages() as late:
            analysed = analyze_together([one.signatures for one in simulated])
    if late and len(examples) > 1:
        raise DatasetError(MIXED)
    made = []
    for one, results in zip(simulated, analysed, strict=True):
        messages = ";".join(dict.fromkeys([*early, *one.messages, *late]))
        made.append(data := ExampleData())
        for columns, signals, result in zip(one.columns, one.signals, one.tracked or results, strict=True):
            measured = result.to_row() if result is not None else {"gate": "track", **NOTHING, "flags": "not_tracked"}
            whole = {spec.name: read_signal(result, spec.name) for spec in fields if spec.name not in signals}
            data.rows.append(convert_to_json({**columns, **measured, "warnings": messages}))
            data.arrays.append(encode_arrays(fields, whole | signals))
    return made


def simulate_example(
    example: ExampleSpec, scenes: Iterator[PlacedScene], fields: Sequence[FieldSpec], gate: Literal["truth", "track"]
) -> SimulatedExample:
    """Simulate an example, whose scene is the next one."""
    raise_if_stopped()
    signatures: list[Gated] = []
    tracked: Sequence[Result | None] = ()
    with collect_messages() as messages:
        recording = simulate_placed(example.run, next(scenes), angles=False)
        if gate == "truth":
            settings = example.run.analysis.resolved(gate)
            signatures = compute_signatures(recording, gate, settings, example.gate_error_m)
        else:
            found = analyze(recording, gate=gate, analysis=example.run.analysis)
            if example.rows[0].source == "none" and len(example.rows) == 1:  # the most confident track
                known = [result for result in found if "track_confidence" in result.quality]
                tracked = [max(known, key=lambda result: float(result.quality["track_confidence"]), default=None)]
            else:
                tracked = match_tracks(found, recording.truth, recording.slow_time_s)
    signals: list[dict[str, Any]] = [{} for _ in example.rows]
    for name in (spec.name for spec in fields):
        for number, kept in enumerate(signals):
            if name.startswith("truth_"):
                variable = name.removeprefix("truth_").rpartition("_")[0]
                kept[name] = recording.truth[number].scatterers[variable]
            elif name == "baseband":
                kept[name] = recording.baseband
    return SimulatedExample(describe_scene(example, recording), signals, signatures, tracked, messages)


@contextmanager
def collect_messages(convert: Callable[[str], str] = lambda text: text.partition(":")[0]) -> Iterator[list[str]]:
    """Collect the warnings in this block: their keys, or what ``convert`` makes of their texts."""
    messages: list[str] = []
    with warnings.catch_warnings(record=True, action="always", category=DoppelgaitWarning) as caught:
        yield messages
    messages += [convert(str(w.message)) for w in caught if issubclass(w.category, DoppelgaitWarning)]
