"""One SigMF recording per scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from doppelgait.core.errors import DatasetError
from doppelgait.dataset.example import Example, radar_of
from doppelgait.dataset.export.rows import file_name, splits_of
from doppelgait.dataset.open import Dataset
from doppelgait.radar.readers.sigmf_write import write_sigmf
from doppelgait.radar.recording import Recording, TargetTruth


def write_sigmf_folder(dataset: Dataset, folder: Path, fields: tuple[str, ...], done: Callable[[int], None]) -> None:
    """``SPLIT/SCENE.sigmf-meta`` and ``.sigmf-data``: the baseband of every scene, its targets as annotations.

    Raises
    ------
    DatasetError
        If the dataset does not tell the radar of a scene.
    """
    for split, rows in splits_of(dataset):
        (folder / split).mkdir()
        scenes = dataset.index["scene_id"].iloc[rows]
        for scene_id, members in scenes.groupby(scenes, sort=False).groups.items():
            examples = [dataset.example(int(number)) for number in members]
            recording = _recording(dataset.description, examples)
            write_sigmf(recording, folder / split / file_name(str(scene_id)))
            done(len(examples))


def _recording(description: dict[str, Any], examples: Sequence[Example]) -> Recording:
    first = examples[0]
    baseband = first.baseband
    if not {"slow_time", "range"} <= set(baseband.coords):
        raise DatasetError(f"{first.id}: its baseband has no axes; build the dataset again with this version")
    return Recording(
        baseband=baseband,
        radar=radar_of(description, first.row),
        truth=[_annotated(example.row) for example in examples],
        snr_frame_db=float(np.nan if first.row.get("snr_frame_db") is None else first.row["snr_frame_db"]),
        seed=description["config"]["dataset"]["seed"],
        source=f"dataset {description['name']} {description['id']}, {first.row['scene_id']}",
    )


def _annotated(row: dict[str, Any]) -> TargetTruth:
    """What SigMF keeps of a target: label, gait, subject and kind of motion."""
    nothing = np.empty(0)
    return TargetTruth(
        label=str(row["label"]), scatterers=xr.Dataset(), centre_range_m=nothing, centre_velocity_mps=nothing,
        centre_aspect_rad=nothing, gait=row.get("truth_gait") or "", subject=row.get("subject") or "",
        motion=row.get("motion_kind") or "",
    )  # fmt: skip
