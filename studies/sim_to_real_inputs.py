"""Model inputs of the sim-to-real studies, cached in files.

Files are named after the settings that made them. They do not know the code: empty the folder when that has changed.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr
from xband_measures import FloatArray

from doppelgait.classify import levels
from doppelgait.classify.data import convert_features
from doppelgait.core.files import open_atomically
from doppelgait.pipeline import Result
from doppelgait.processing.patches import Levels, Patch

Arrays = dict[str, npt.NDArray[Any]]
SIX = (
    "torso_velocity_mps", "doppler_bandwidth_hz", "step_length_m", "harmonic_ratio_2", "harmonic_ratio_3",
    "limb_torso_ratio",
)  # fmt: skip
CHUNK = 50
"""Examples in one file."""


@dataclass(frozen=True, eq=False)
class Inputs:
    """Model inputs of examples."""

    columns: Mapping[str, FloatArray]
    levels: npt.NDArray[Any]
    labels: npt.NDArray[np.str_]
    groups: npt.NDArray[np.str_]
    wavelength_m: float

    def __len__(self) -> int:
        return self.labels.size

    def take(self, rows: npt.NDArray[Any]) -> Inputs:
        """Select some of the examples."""
        columns = {name: values[rows] for name, values in self.columns.items()}
        return Inputs(columns, self.levels[rows], self.labels[rows], self.groups[rows], self.wavelength_m)

    def matrix(self, names: Sequence[str]) -> FloatArray:
        """Return the features (n, d) as model inputs.

        Velocity without sign, bandwidth in m/s, infinite values as unknown.
        """
        wavelength_m = np.full(len(self), self.wavelength_m)
        values = convert_features({name: self.columns[name] for name in names}, wavelength_m)
        return np.column_stack(list(values.values())) if values else np.zeros((len(self), 0))


def joined(parts: Sequence[Inputs]) -> Inputs:
    """Concatenate inputs."""
    columns = {name: np.concatenate([part.columns[name] for part in parts]) for name in parts[0].columns}
    levels, labels, groups = (
        np.concatenate([getattr(p, key) for p in parts]) for key in ("levels", "labels", "groups")
    )
    return Inputs(columns, levels, labels, groups, parts[0].wavelength_m)


def row_of(result: Result) -> dict[str, float]:
    """Return six and extended features of one analysis, NaN for unknown."""
    values = {**result.features.as_dict(), **result.extended}
    return {name: np.nan if value is None else float(value) for name, value in values.items()}


def inputs_of(
    rows: Sequence[Mapping[str, float]], signatures: Sequence[xr.DataArray], patch: Patch, labels: Sequence[str],
    groups: Sequence[str],
) -> Inputs:  # fmt: skip
    """Make inputs from features and signatures."""
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return Inputs(
        columns,
        _objects([levels(mu, patch) for mu in signatures]),
        np.array(labels),
        np.array(groups),
        float(signatures[0].attrs["wavelength_m"]),
    )


def _objects(pictures: Sequence[Levels]) -> npt.NDArray[Any]:
    found = np.empty(len(pictures), dtype=object)
    for number, picture in enumerate(pictures):
        found[number] = picture
    return found


def kept(path: Path, make: Callable[[], Arrays]) -> Arrays:
    """Load the arrays of a file, or make and write them."""
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        arrays = make()
        with open_atomically(path) as partial, partial.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)
    with np.load(path) as stored:
        return {name: stored[name] for name in stored.files}


def kept_inputs(path: Path, make: Callable[[], Inputs]) -> Inputs:
    """Load inputs as :func:`kept` loads arrays."""
    found = kept(path, lambda: _to_arrays(make()))
    widths = found["widths"]
    pictures = np.split(found["levels"].astype(np.float32), np.cumsum(widths)[:-1], axis=1)
    columns = {name.removeprefix("f_"): values for name, values in found.items() if name.startswith("f_")}
    return Inputs(columns, _objects(pictures), found["labels"], found["groups"], float(found["wavelength_m"]))


def _to_arrays(inputs: Inputs) -> Arrays:
    return {
        **{f"f_{name}": values for name, values in inputs.columns.items()},
        "levels": np.concatenate(list(inputs.levels), axis=1).astype(np.float16),
        "widths": np.array([picture.shape[1] for picture in inputs.levels]),
        "labels": inputs.labels, "groups": inputs.groups, "wavelength_m": np.array(inputs.wavelength_m),
    }  # fmt: skip


def key_of(*settings: object) -> str:
    """Return a short hash of settings, for file names."""
    return f"{zlib.crc32(repr(settings).encode()):08x}"


def chunks(count: int) -> list[range]:
    """Yield numbers of examples, one file at a time. The last file may be smaller."""
    return [range(first, min(first + CHUNK, count)) for first in range(0, count, CHUNK)]
