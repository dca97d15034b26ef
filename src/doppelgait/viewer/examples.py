"""Examples of a dataset, simulated again within limits.

The limits are for datasets of other authors: their plans cannot start a very large simulation, and
can read only files of one folder.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np
import xarray as xr

from doppelgait import processing
from doppelgait.core.config import convert_to_json
from doppelgait.core.draws import resolve
from doppelgait.core.errors import DatasetError, DoppelgaitError
from doppelgait.dataset import Dataset, Example, PlanConfig
from doppelgait.dataset.config import suggest_names
from doppelgait.dataset.example import find_plan_number
from doppelgait.dataset.resolve import find_class, replace_radar_files, resolve_example
from doppelgait.dataset.shard import make_truth_columns
from doppelgait.dataset.windows import cut_windows
from doppelgait.features import FEATURE_UNITS, GaitFeatures
from doppelgait.pipeline import Result, run_simulation
from doppelgait.pipeline import run as pipeline_run
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.gate import GateName
from doppelgait.radar.recording import Recording
from doppelgait.scene.scene import DEFAULT_DURATION_S
from doppelgait.viewer.payload import remove_folders
from doppelgait.viewer.run import Run, TargetView, collect_warnings
from doppelgait.viewer.settings import Settings

MOST_SAMPLES = 24_000_000
"""Largest number of pulses times samples or scatterers: 60 s at 1 kHz with 400 range bins."""
MOST_SECONDS = 300.0
BODY_SCATTERERS = 40  # number of scatterers of one body; few motions have more
PATHS_PER_EFFECT = 3
"""Number of additional echoes per scatterer that an entry of the environment may cause."""
PATH_KEYS = ("path", "skeleton")  # options of a motion file that name a file


def check_size(run: pipeline_run.Run) -> None:
    """Reject an example that is too large to simulate."""
    scene, radar = run.scene, run.radar
    seconds = scene.duration_s if scene.duration_s is not None else DEFAULT_DURATION_S
    pulses = seconds * radar.prf_hz
    samples = max(radar.n_range_bins, radar.waveform.n_samples(radar))
    scatterers = len(scene.targets) * BODY_SCATTERERS * (1 + PATHS_PER_EFFECT * len(run.environment))
    if seconds > MOST_SECONDS or pulses * max(samples, scatterers) > MOST_SAMPLES:
        raise DatasetError(
            f"too large to simulate here ({seconds:g} s, {pulses:,.0f} pulses of {samples:,} samples, about "
            f"{scatterers:,} scatterers); up to {MOST_SECONDS:g} s and {MOST_SAMPLES:,} samples are simulated"
        )


def check_files(plan: PlanConfig, number: int, folder: Path | None) -> None:
    """Reject an example that uses files outside the user's folder."""
    place, turn = find_class(plan, number)
    motions: Any = [episode.targets for episode in plan.episodes]
    if plan.classes:
        seed, motion = plan.dataset.seed, plan.classes[place].motion
        motions = resolve(motion, seed=seed, example=number, key="motion", turn=turn)
    radars: list[Any] = []
    replace_radar_files(plan.radar, radars.append)
    named = [
        *_find_motion_files([motions, plan.companions, plan.background]),
        *[(file, "preset") for file in radars if isinstance(file, str)],
    ]
    for name, start in named:
        if folder is None:
            raise DatasetError(
                f"its simulation needs {_find_last(name)!r}, which is not part of the dataset: start the viewer with "
                "--motion-folder FOLDER to see its recording"
            )
        # Reject paths that are absolute on any system: a test for the existence of //HOST/...
        # contacts the host.
        windows = PureWindowsPath(name)
        if (bool(windows.drive or windows.root) or PurePosixPath(name).is_absolute() or ".." in windows.parts) or not (
            Path(name) if start == "skeleton" else folder / name
        ).resolve().is_relative_to(folder.resolve()):
            raise DatasetError(f"{_find_last(name)!r} of its plan lies outside of --motion-folder and is not opened")


def _find_motion_files(value: Any) -> Iterator[tuple[str, str]]:
    """Yield files and keys of a motion or its choices."""
    if isinstance(value, Mapping):
        if "file" in _collect_texts(value.get("kind")):
            for key in PATH_KEYS:
                yield from ((text, key) for text in _collect_texts(value.get(key)))
        value = list(value.values())
    if isinstance(value, list | tuple):
        for inner in value:
            yield from _find_motion_files(inner)


def _collect_texts(value: Any) -> list[str]:
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple):
        return [text for inner in value for text in _collect_texts(inner)]
    return [value] if isinstance(value, str) else []


def _find_last(name: str) -> str:
    return PureWindowsPath(name).name or name


FACT_TOLERANCE = 1e-2
"""Relative difference of a fact of the truth above which motion files are not the dataset's."""


class ExampleRuns:
    """Opener of the examples of a dataset."""

    def __init__(self, dataset: Dataset, folder: Path | None = None) -> None:
        self.dataset = dataset
        self.folder = folder

    def run(self, example_id: str) -> Run:
        """Open the stored results of an example."""
        index = self.dataset.index
        found = np.flatnonzero((index["id"] == example_id).to_numpy(dtype=bool))
        if not found.size:
            raise DatasetError(f"example: no {example_id!r} in this dataset{suggest_names(example_id, index['id'])}")
        rows = found[:1]
        # All targets of a simulated scene; only this one of a recording, because the others are at
        # later times. Other rows of a scene with tracks are of other times.
        if self.dataset.description.get("origin") != "imported" and {"scene_id", "track"} & {*index} == {"scene_id"}:
            rows = np.flatnonzero((index["scene_id"] == index["scene_id"].iloc[found[0]]).to_numpy(dtype=bool))
        first = convert_to_json(self.dataset.index.iloc[rows[0]].to_dict())
        gate: GateName = "track" if first.get("gate") == "track" else "truth"
        notes = tuple(filter(None, _read_text(first.get("warnings")).split(";")))
        run = Run(example_id, "example", Settings(gate=gate), notes=notes)
        run.stored = lambda: [self._view(int(row), place, run) for place, row in enumerate(rows)]
        try:
            number = find_plan_number(self.dataset.description, first)
            plan = self.dataset.plan_config
            check_files(plan, number, self.folder)
            spec = resolve_example(plan, number, self.folder or Path())
            check_size(spec.run)
        except DoppelgaitError as error:
            run.reason = self.describe_error(error)
            return run
        run.settings = replace(run.settings, analysis=spec.run.analysis)

        def simulate() -> Recording:
            try:  # the notes have the warnings of the build
                recording, _ = collect_warnings(lambda: run_simulation(spec.run, folder=self.folder))
            except DoppelgaitError as error:
                raise DatasetError(self.describe_error(error)) from None
            if spec.is_episode:  # the window of the row
                windows, start_s = cut_windows(recording, plan.dataset.window_s, plan.dataset.hop_s), "window_start_s"
                recording = next((w.recording for w in windows if w.start_s == first.get(start_s)), recording)
            if spec.is_episode or first.get("source") == "none":
                return recording
            # The truth differs from that of the dataset: a motion file has changed.
            truth = make_truth_columns(recording.truth[0])
            for name in ("truth_range_m", "truth_ground_speed_mps", "truth_radial_velocity_mps"):
                made, there = truth[name], first.get(name)
                if there is None or not np.isclose(made, there, rtol=FACT_TOLERANCE, atol=1e-6):
                    raise DatasetError(
                        f"{first['id']}: {name} is {there} in the dataset, simulated again {made:.4g}; the motion file "
                        "is not that of the dataset"
                    )
            return recording

        run.load = simulate
        return run

    def describe_error(self, error: Exception) -> str:
        """Return an error's text without the folders of this computer."""
        return remove_folders(str(error), *self.folders)

    @property
    def folders(self) -> tuple[Path, ...]:
        """Folders that the page must not show."""
        return self.dataset.directory, *(() if self.folder is None else (self.folder,))

    def _view(self, row: int, place: int, run: Run) -> TargetView:
        """Build a target's view from its stored row."""
        example = self.dataset.example(row)
        signature, cadence = example.arrays.get("signature"), _find_cadence(example, run.settings.analysis)
        arrays: dict[str, Any] = {}
        if signature is not None:
            line_hz = processing.main_line_hz(signature, order=1, tapered=True)
            arrays |= {"signature": signature, "main_line_hz": line_hz}
        if cadence is not None:
            arrays |= {"cadence_map": cadence, "cadence_spectrum": processing.cadence_spectrum(cadence)}
        view = build_stored_view(example, run.settings.analysis)
        # The gate of the example, if it was that of the truth and the recording can be simulated.
        recording, gate = run.recording if view.result.gate_source == "truth" else None, None
        if recording is not None and place < len(recording.truth):
            gate = Gate.from_truth(
                recording.truth[place],
                recording.slow_time_s,
                run.settings.analysis,
                wavelength_m=recording.radar.wavelength_m,
                error_m=_number(example.row.get("gate_error_m")) or 0.0,
            )
        return replace(view, result=replace(view.result, arrays=arrays, gate_limits=gate))


def build_stored_view(example: Example, analysis: Analysis) -> TargetView:
    """Build a target's view from a row, which may have wrong values."""
    row = example.row
    result = Result(
        analysis=analysis,
        label=example.label,
        gate_source=_read_text(row.get("gate")),
        features=GaitFeatures(**{name: _number(row.get(f"feature_{name}")) for name in FEATURE_UNITS}),
        gait_frequency_hz=_number(row.get("gait_frequency_hz")),
        torso_doppler_hz=_number(row.get("torso_doppler_hz")),
        quality={name: value for name, value in _select_prefix(row, "quality_").items() if name != "flags"},
        standard_deviation=_read_numbers(row, "sd_"),
        extended=_read_numbers(row, "extended_"),
        flags=tuple(filter(None, _read_text(row.get("quality_flags")).split(";"))),
    )
    return TargetView(result, _read_truth(row))


def _number(value: Any) -> float | None:
    """Return a number of an index, or None for other values."""
    return value if isinstance(value, int | float) else None


def _read_text(value: Any) -> str:
    return value if isinstance(value, str) else ""


def _read_numbers(row: dict[str, Any], prefix: str) -> dict[str, float | None]:
    return {name: _number(value) for name, value in _select_prefix(row, prefix).items()}


def _select_prefix(row: dict[str, Any], prefix: str) -> dict[str, Any]:
    return {name.removeprefix(prefix): value for name, value in row.items() if name.startswith(prefix)}


def _read_truth(row: dict[str, Any]) -> dict[str, Any] | None:
    """Return true values by feature and frequency name."""
    known = _select_prefix(row, "truth_")
    velocity_mps, frequency_hz = (
        _number(known.pop("radial_velocity_mps", None)),
        _number(known.get("gait_frequency_hz")),
    )
    if velocity_mps is None:
        return None
    step_m = abs(velocity_mps) / frequency_hz if frequency_hz else None
    ratios = {"harmonic_ratio_2": 2.0, "harmonic_ratio_3": 3.0} if frequency_hz else {}
    return {"torso_velocity_mps": velocity_mps, "step_length_m": step_m, **ratios, **known}


def _find_cadence(example: Example, analysis: Analysis) -> xr.DataArray | None:
    """Return the stored cadence map, or compute it (E-28 to E-31)."""
    signature, floor_v2 = example.arrays.get("signature"), _number(example.row.get("quality_noise_floor_v2"))
    if "cadence_map" in example.arrays or signature is None or floor_v2 is None:
        return example.arrays.get("cadence_map")
    seconds = processing.observation_s(signature)
    rows = processing.normalise(signature, floor_v2, mode=analysis.normalisation)
    if processing.needs_alignment(signature):
        rows = processing.align(rows, processing.main_line_hz(signature, order=processing.choose_line_order(seconds)))
    return processing.cadence_map(processing.detrend(rows, order=processing.detrend_order(seconds)))
