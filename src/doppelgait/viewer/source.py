"""What is opened: a recording, a result file or a dataset, told apart by what it holds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from doppelgait.core.errors import ConfigError, RecordingError
from doppelgait.core.labels import axis
from doppelgait.processing import burst_pulses_of
from doppelgait.radar.recording import Recording
from doppelgait.viewer.run import Run, view_of_stored, with_warnings
from doppelgait.viewer.settings import Settings

if TYPE_CHECKING:
    from doppelgait.viewer.browse import Browser

DATASET_FILES = ("dataset.json", "index.parquet")


@dataclass(frozen=True)
class Opened:
    """What the viewer was started with.

    Parameters
    ----------
    kind : {"recording", "result", "dataset"}
    name : str
    path_name : str
        Last part of the path, for the page; it never learns where that is.
    run : Run, optional
        Recording or result.
    browser : Browser, optional
        Dataset.
    """

    kind: Literal["recording", "result", "dataset"]
    name: str
    path_name: str
    run: Run | None = None
    browser: Browser | None = None


def open_path(path: str | Path, settings: Settings) -> Opened:
    """Open a recording, a result or a dataset.

    Parameters
    ----------
    path : str or Path
        Anything that :func:`doppelgait.radar.read_recording` reads, an .h5 file of ``doppelgait analyze -o``, or the
        folder of a dataset.
    settings : Settings
        For recordings; a result and a dataset show what they store.

    Raises
    ------
    DoppelgaitError
        If it is none of these, or damaged.
    """
    place = Path(path)
    if not place.exists():
        raise RecordingError(f"{place}: no such file or folder")
    name = place.resolve().name
    if place.is_dir() and any((place / file).exists() for file in DATASET_FILES):
        return _open_dataset(place, name, settings)
    from doppelgait.pipeline.results import sniff_results

    if sniff_results(place):
        return Opened("result", name, name, run=_result_run(place, name, settings))
    return Opened("recording", name, name, run=_recording_run(place, name, settings))


def _open_dataset(place: Path, name: str, settings: Settings) -> Opened:
    from doppelgait.dataset import open_dataset
    from doppelgait.viewer.browse import Browser

    dataset = open_dataset(place)
    if not len(dataset):
        raise ConfigError(f"{place}: the dataset has no rows, so there is nothing to look at")
    return Opened("dataset", str(dataset.description["name"]), name, browser=Browser(dataset, settings.motion_folder))


def _result_run(place: Path, name: str, settings: Settings) -> Run:
    from doppelgait.pipeline.results import read_results

    read = read_results(place)
    views = [view_of_stored(target) for target in read.targets]
    reason = f"a result holds no recording; open {read.source or 'the recording'} to see range, bodies and sound"
    shown = Settings(gate=settings.gate, analysis=read.analysis, tracking=settings.tracking)
    return Run(name, "result", shown, reason=reason, stored=lambda: views)


def _recording_run(place: Path, name: str, settings: Settings) -> Run:
    from doppelgait.radar import read_recording

    recording, said = with_warnings(lambda: read_recording(place, **settings.options))
    if settings.gate == "truth" and not recording.truth:
        raise ConfigError(f"--gate truth: {name} has no truth; take --gate track, or give the range, --gate 1.2:2.8")
    if isinstance(settings.gate, tuple):
        _check_inside(settings.gate, recording)
    if not settings.gate_asked and not can_track(recording):
        settings = replace(settings, gate=all_ranges_m(recording))
    notes = tuple(text.replace(f"{place}", name) for text in said)  # the page does not learn where the file is
    return Run(name, "recording", settings, load=lambda: recording, notes=notes)


def can_track(recording: Recording) -> bool:
    """Whether bodies can be followed: there are ranges, and no pauses between the pulses."""
    return recording.baseband.sizes["range"] > 1 and burst_pulses_of(recording.baseband) is None


def _check_inside(gate_m: tuple[float, float], recording: Recording) -> None:
    """A gate of which nothing lies in the frame would show a page without targets."""
    first_m, last_m = all_ranges_m(recording)
    if recording.baseband.sizes["range"] > 1 and (gate_m[1] <= first_m or gate_m[0] >= last_m):
        raise ConfigError(
            f"--gate {gate_m[0]:g}:{gate_m[1]:g}: lies outside the recorded frame, {first_m:.2f} to {last_m:.2f} m; "
            "take ranges inside, or --gate track"
        )


def all_ranges_m(recording: Recording) -> tuple[float, float]:
    """A gate around all range cells, m."""
    range_m = axis(recording.baseband, "range")
    if range_m.size == 1:
        return recording.radar.range_start_m, recording.radar.range_stop_m
    half_m = float(range_m[1] - range_m[0]) / 2
    return float(range_m[0]) - half_m, float(range_m[-1]) + half_m
