"""What the plan of somebody's dataset may make the viewer do: no huge simulations, no files but those of one folder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from doppelgait.core.errors import DatasetError
from doppelgait.dataset import PlanConfig
from doppelgait.dataset.resolve import class_of, resolve
from doppelgait.pipeline.run import RunSpec
from doppelgait.radar.waveforms import waveform_of
from doppelgait.scene.spec import DEFAULT_DURATION_S

MOST_SAMPLES = 24_000_000
"""Pulses times samples per pulse, and pulses times scatterers: 60 s at 1 kHz with 400 range bins."""
MOST_SECONDS = 300.0
BODY_SCATTERERS = 40
"""Scatterers of one body, about the most that a motion has."""
PATHS_PER_EFFECT = 3
"""Further echoes of every scatterer that an entry of the environment may bring."""
PATH_KEYS = ("path", "skeleton")
"""Options of a motion file that name a file."""


def check_size(run: RunSpec) -> None:
    """Refuse what would take minutes and gigabytes to simulate.

    Raises
    ------
    DatasetError
        If an example has more samples than :data:`MOST_SAMPLES`, or is too long.
    """
    scene, radar = run.scene, run.radar
    seconds = scene.duration_s if scene.duration_s is not None else DEFAULT_DURATION_S
    pulses = seconds * radar.prf_hz
    samples = max(radar.n_range_bins, waveform_of(radar).n_samples(radar))
    scatterers = len(scene.targets) * BODY_SCATTERERS * (1 + PATHS_PER_EFFECT * len(run.environment))
    if seconds > MOST_SECONDS or pulses * max(samples, scatterers) > MOST_SAMPLES:
        raise DatasetError(
            f"too large to simulate here ({seconds:g} s, {pulses:,.0f} pulses of {samples:,} samples, about "
            f"{scatterers:,} scatterers); up to {MOST_SECONDS:g} s and {MOST_SAMPLES:,} samples are simulated"
        )


def check_files(plan: PlanConfig, number: int, folder: Path | None) -> None:
    """Refuse an example that takes files from anywhere but the folder that the user named.

    Parameters
    ----------
    plan : PlanConfig
        As the dataset tells it.
    number : int
        Of the example.
    folder : Path or None
        None where the user named no folder: then no file is used.

    Raises
    ------
    DatasetError
        Naming the file.
    """
    motion = resolve(
        plan.classes[class_of(plan, number)[0]].motion,
        seed=plan.dataset.seed, example=number, key="motion", turn=class_of(plan, number)[1],
    )  # fmt: skip
    named = [*_motion_files([motion, plan.companions, plan.background]), *_preset_files(plan.radar)]
    for name, start in named:
        if folder is None:
            raise DatasetError(
                f"its simulation needs {_last(name)!r}, which is no part of the dataset: start the viewer with "
                "--motion-folder FOLDER to see its recording"
            )
        if _leads_out(name) or not (_place(name, start, folder)).resolve().is_relative_to(folder.resolve()):
            raise DatasetError(f"{_last(name)!r} of its plan lies outside of --motion-folder and is not opened")


def _motion_files(value: Any) -> Iterator[tuple[str, str]]:
    """Files that a motion, or one of the choices of a motion, names, each with its key."""
    if isinstance(value, Mapping):
        if "file" in _texts(value.get("kind")):
            for key in PATH_KEYS:
                yield from ((text, key) for text in _texts(value.get(key)))
        value = list(value.values())
    if isinstance(value, list | tuple):
        for inner in value:
            yield from _motion_files(inner)


def _preset_files(radar: Mapping[str, Any]) -> list[tuple[str, str]]:
    return [(text, "preset") for text in _texts(radar.get("preset")) if text.endswith(".toml")]


def _texts(value: Any) -> list[str]:
    """All texts in a value: the value, or the choices of a distribution."""
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple):
        return [text for inner in value for text in _texts(inner)]
    return [value] if isinstance(value, str) else []


def _leads_out(name: str) -> bool:
    """Whether a path is no relative one on some system: looking whether //HOST/... exists already asks that host."""
    windows = PureWindowsPath(name)
    return bool(windows.drive or windows.root) or PurePosixPath(name).is_absolute() or ".." in windows.parts


def _place(name: str, key: str, folder: Path) -> Path:
    return Path(name) if key == "skeleton" else folder / name  # readers take a skeleton as it is


def _last(name: str) -> str:
    return PureWindowsPath(name).name or name
