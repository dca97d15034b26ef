"""Opened data, and the run that a request refers to."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from doppelgait.core.errors import AnalysisError, ConfigError, RecordingError
from doppelgait.features import FEATURE_UNITS
from doppelgait.processing import Analysis
from doppelgait.processing.gate import Gate, GateChoice, frame_limits_m
from doppelgait.radar.recording import Recording
from doppelgait.viewer.browse import Browser
from doppelgait.viewer.run import Run, collect_warnings, make_view
from doppelgait.viewer.settings import CHANGEABLE, Changes, Pairs, Settings, parse_changes, parse_parameters

DATASET_FILES = ("dataset.json", "index.parquet")


@dataclass(frozen=True)
class OpenedSource:
    """Recording, result or dataset that was opened at the start."""

    kind: Literal["recording", "result", "dataset"]
    name: str
    path_name: str
    run: Run | None = None
    browser: Browser | None = None
    other: Run | None = None


def open_path(path: str | Path, settings: Settings) -> OpenedSource:
    """Open a recording, a result or a dataset."""
    place = Path(path)
    if not place.exists():
        raise RecordingError(f"{place}: no such file or folder")
    name = place.resolve().name
    if place.is_dir() and any((place / file).exists() for file in DATASET_FILES):
        from doppelgait.dataset import open_dataset

        dataset = open_dataset(place)
        if not len(dataset):
            raise ConfigError(f"{place}: the dataset has no rows, so there is nothing to show")
        return OpenedSource(
            "dataset", str(dataset.description["name"]), name, browser=Browser(dataset, settings.motion_folder)
        )
    from doppelgait.pipeline.result_files import is_result_file

    if is_result_file(place):
        from doppelgait.pipeline.result_files import read_results

        read = read_results(place)
        views = [make_view(target) for target in read.targets]
        reason = f"a result has no recording; open {read.source or 'the recording'} to see range, bodies and sound"
        analysis = read.targets[0].analysis if read.targets else Analysis()
        shown = Settings(gate=settings.gate, analysis=analysis, tracking=settings.tracking)
        return OpenedSource("result", name, name, run=Run(name, "result", shown, reason=reason, stored=lambda: views))
    from doppelgait.radar import read_recording

    recording, said = collect_warnings(lambda: read_recording(place, **settings.options))
    notes = tuple(text.replace(f"{place}", name) for text in said)  # the page does not show the folder
    return open_recording(recording, name, settings, notes)


def open_recording(recording: Recording, name: str, settings: Settings, notes: tuple[str, ...] = ()) -> OpenedSource:
    """Open a recording that is in memory."""
    if settings.gate == "truth" and not recording.truth:
        raise ConfigError(f"--gate truth: {name} has no truth; use --gate track, or give the range, --gate 1.2:2.8")
    if isinstance(settings.gate, tuple):  # a gate outside the frame would show a page without targets
        try:
            Gate.fixed(*settings.gate, time_s=recording.slow_time_s, range_m=recording.range_m)
        except AnalysisError as error:
            raise ConfigError(f"--gate: {error}, or --gate track") from None
    if not settings.gate_asked and not can_track(recording):
        settings = replace(settings, gate=all_ranges_m(recording))
    return OpenedSource(
        "recording", name, name, run=Run(name, "recording", settings, load=lambda: recording, notes=notes)
    )


def add_other(opened: OpenedSource, path: str | Path, settings: Settings) -> OpenedSource:
    """Open a second recording for comparison."""
    second = open_path(path, settings)
    for one in (opened, second):
        if one.kind != "recording":
            raise ConfigError(f"{one.name}: is a {one.kind}; two recordings can be compared, open this one by itself")
    return replace(opened, other=second.run)


def can_track(recording: Recording) -> bool:
    """Return True if targets can be tracked."""
    return recording.n_range_bins > 1 and recording.frames.slow_time.find_bursts().burst_pulses is None


def all_ranges_m(recording: Recording) -> tuple[float, float]:
    """Return gate limits around all range cells, m."""
    range_m = recording.range_m
    if range_m.size == 1:
        return recording.radar.range_start_m, recording.radar.range_stop_m
    return frame_limits_m(range_m)


MOST_RUNS = 4


@dataclass(frozen=True)
class Reference:
    """Reference to a run, with gate and further parameters."""

    key: tuple[str | tuple[str, str], ...]
    gate: GateChoice | None
    further: dict[str, str]
    changes: Changes = ()
    segment: tuple[int, int] | None = None


def parse_reference(query: Pairs, names: Sequence[str] = ()) -> Reference:
    """Parse a run: ``run=2`` (second recording), ``example=ID``, or ``try=1`` (the controls)."""
    trying = any(key == "try" for key, _ in query)
    own: list[str] = []
    if trying:
        from doppelgait.viewer.try_it import describe_controls

        own = [str(control["name"]) for control in describe_controls()]
    found = parse_parameters(query, ["example", "try", "run", "gate", *names, *own])
    if "run" in found and (found["run"] != "2" or trying or "example" in found):
        raise ConfigError("run: must be 2, and cannot be combined with try or example")
    if trying and (found["try"] != "1" or "example" in found):
        raise ConfigError("try: must be 1, and cannot be combined with example")
    gate = Gate.parse(found["gate"], where="gate") if "gate" in found else None
    further = {key: value for key, value in found.items() if key in names and key not in own}
    key: tuple[str | tuple[str, str], ...] = ("example", found["example"]) if "example" in found else ()
    if "run" in found:
        key = ("other",)
    if trying:
        key = ("try", *sorted((name, value) for name, value in found.items() if name in own))
    changes = parse_changes({key: further.pop(key) for key in CHANGEABLE if key in further})
    segment: tuple[int, int] | None = None
    if (text := further.pop("segment", None)) is not None:
        target, colon, number = text.partition(":")
        if not colon or not all(part.isascii() and part.isdigit() and len(part) <= 6 for part in (target, number)):
            raise ConfigError(f"segment: {text!r} is not allowed; it must be TARGET:SEGMENT, for example 0:2")
        segment = int(target), int(number)
    return Reference(key, gate, further, changes=changes, segment=segment)


class RunCache:
    """Opened run and the most recent other runs."""

    def __init__(self, opened: OpenedSource | None) -> None:
        self.opened = opened
        self._runs: OrderedDict[tuple[str | tuple[str, str], ...], Run] = OrderedDict()

    def run(self, reference: Reference) -> Run:
        """Return the run of a reference."""
        if not reference.key:
            if self.opened is None or self.opened.run is None:
                raise ConfigError("no recording is open; name a run with example=ID (of an open dataset) or try=1")
            return self.opened.run
        if reference.key == ("other",):
            if self.opened is None or self.opened.other is None:
                raise ConfigError("run: there is no second recording; name two after 'doppelgait view'")
            return self.opened.other
        if reference.key not in self._runs:
            kind, *rest = reference.key
            if kind == "try":
                from doppelgait.viewer.try_it import run_of

                made = run_of(dict(item for item in rest if isinstance(item, tuple)))
            elif self.opened is None or self.opened.browser is None:
                raise ConfigError("example: no dataset is open; start the viewer with the folder of one")
            else:
                made = self.opened.browser.run(str(rest[0]))
            self._runs[reference.key] = made
            while len(self._runs) > MOST_RUNS:
                self._runs.popitem(last=False)
        self._runs.move_to_end(reference.key)
        return self._runs[reference.key]


COLOUR_MAPS = ("magma", "viridis", "inferno", "cividis", "gray", "turbo")
KNOWN_CLASSES = ("human", "dog", "cat")


def describe_session(opened: OpenedSource | None, settings: Settings) -> dict[str, Any]:
    """Return the content of ``api/session``."""
    from doppelgait.viewer.try_it import describe_controls

    browser = None if opened is None else opened.browser
    run = None if opened is None else opened.run
    summary = None if browser is None else browser.summary()
    gate = settings.gate if run is None else run.settings.gate
    classes = sorted({*KNOWN_CLASSES, *(summary["classes"] if summary else ())})
    from doppelgait.viz.style import describe_quantity

    further = {"gait_frequency_hz": "Hz", "torso_doppler_hz": "Hz"}
    return {
        "kind": "none" if opened is None else opened.kind,
        "name": "" if opened is None else opened.name,
        "path_name": "" if opened is None else opened.path_name,
        "other": None if opened is None or opened.other is None else opened.other.name,
        **_list_colours(tuple(classes)),
        "default_gate": gate if isinstance(gate, str) else f"{gate[0]:g}:{gate[1]:g}",
        "feature_names": [
            (name, describe_quantity(name)[0], unit) for name, unit in {**FEATURE_UNITS, **further}.items()
        ],
        "dataset": summary,
        "try_controls": describe_controls(),
    }


@cache
def _list_colours(classes: tuple[str, ...]) -> dict[str, Any]:
    """Return the colours of maps, body parts and classes."""
    from matplotlib import colormaps

    from doppelgait.viz.motion import PART_COLOURS
    from doppelgait.viz.style import MAP_COLOURS, choose_class_colours

    # 256 colours as one text of hexadecimal digits.
    colour_maps = {name: colormaps[name](np.arange(256), bytes=True)[:, :3].tobytes().hex() for name in COLOUR_MAPS}
    return {
        "colour_maps": colour_maps,
        "default_map": MAP_COLOURS,
        "part_colours": dict(PART_COLOURS),
        "class_colours": choose_class_colours(classes),
    }
