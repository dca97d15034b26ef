"""Examples of a dataset, as arrays and features."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from doppelgait.core.draws import resolve
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.core.labels import COORDINATE_UNITS
from doppelgait.core.notebook import show_text
from doppelgait.core.units import carrier_to_wavelength_m, doppler_to_velocity_mps
from doppelgait.dataset.config import suggest_names
from doppelgait.dataset.finish import DATA_VERSION
from doppelgait.dataset.resolve import ExampleSpec
from doppelgait.dataset.shard_files import decode, name_axis
from doppelgait.features import FEATURE_UNITS
from doppelgait.pipeline.radar_table import parse_radar
from doppelgait.pipeline.result import Result
from doppelgait.processing import Analysis
from doppelgait.radar.parameters import Radar

UNIT_OF_SUFFIX = {
    "mps": "m/s",
    "hz": "Hz",
    "m2": "m^2",
    "v2": "V^2",
    "deg": "deg",
    "rad": "rad",
    "db": "dB",
    "m": "m",
    "s": "s",
}
"""Units of columns by the ending of their names; other columns have the unit 1."""


@dataclass(frozen=True, eq=False)
class Features:
    """Features of examples; unpacks as ``X, y, groups``.

    Parameters
    ----------
    X : ndarray of float64, shape (n, n_features)
        Features, NaN if undetermined.
    y : ndarray of str, shape (n,)
        Labels.
    groups : ndarray of str, shape (n,)
        Group of each row. Rows of a group share a subject or a scene: keep each group in one fold.
    names, units : tuple of str
        Name and unit of each column of X.
    ids : ndarray of str, shape (n,)
    """

    X: npt.NDArray[np.float64]
    y: npt.NDArray[np.str_]
    groups: npt.NDArray[np.str_]
    names: tuple[str, ...]
    units: tuple[str, ...]
    ids: npt.NDArray[np.str_]

    def __iter__(self) -> Iterator[npt.NDArray[Any]]:
        """Iterate over X, y and groups, in this order."""
        return iter((self.X, self.y, self.groups))

    def __len__(self) -> int:
        return len(self.y)


def build_feature_matrix(index: pd.DataFrame, names: str | Sequence[str], without_flags: Sequence[str]) -> Features:
    """Build the feature matrix of the rows of an index."""
    columns = find_feature_columns(index, names)
    rows = index
    if without_flags:
        flags = index["quality_flags"].fillna("").to_numpy(dtype=object)
        fits = {
            text: any(fnmatchcase(flag, pattern) for flag in text.split(";") for pattern in without_flags)
            for text in set(flags)
        }
        rows = index[~np.array([fits[text] for text in flags], dtype=bool)]
    for column in columns.values():
        if not pd.api.types.is_numeric_dtype(rows[column]):
            raise DatasetError(
                f"{column}: holds {rows[column].dtype} values, which are not features; name numeric columns"
            )
    matrix = np.ascontiguousarray(rows[[*columns.values()]].to_numpy(dtype=np.float64, na_value=np.nan))
    texts = {name: rows[name].to_numpy(dtype=str) for name in ("label", "group", "id")}
    units = tuple(FEATURE_UNITS.get(name) or parse_unit(name) for name in columns)
    return Features(matrix, texts["label"], texts["group"], tuple(columns), units, texts["id"])


def find_feature_columns(index: pd.DataFrame, names: str | Sequence[str]) -> dict[str, str]:
    """Return the columns of the index by feature name."""
    six = {name: f"feature_{name}" for name in FEATURE_UNITS}
    if names == "six":
        return six
    if names == "extended":
        further = [str(c) for c in index.columns if str(c).startswith("extended_")]
        return {**six, "gait_frequency_hz": "gait_frequency_hz", **{name: name for name in further}}
    if isinstance(names, str) or not names:
        raise DatasetError(f"features: {names!r} is not allowed; it must be 'six', 'extended' or a list of columns")
    for name in names:
        if name not in index:
            hint = suggest_names(name, map(str, index.columns))
            raise DatasetError(f"features: no column {name!r}{hint}; dataset.index.columns lists all")
    return {name: name for name in names}


def parse_unit(column: str) -> str:
    """Return a column's unit from the ending of its name."""
    return UNIT_OF_SUFFIX.get(column.rpartition("_")[2], "1")


Stored = Callable[[str], npt.NDArray[Any] | None]
"""Function that returns a stored array by its name in a shard, or None if it does not exist."""


@dataclass(frozen=True)
class Example:
    """One example.

    Parameters
    ----------
    row : dict
        Row of the index; unknown values are None.
    arrays : dict
        Labelled arrays by field name, in linear units.
    specify : callable, optional
        Function that returns the specification; see :attr:`specification`.
    """

    row: dict[str, Any]
    arrays: dict[str, xr.DataArray]
    specify: Callable[[], ExampleSpec] | None = field(default=None, repr=False, compare=False)

    def __repr__(self) -> str:
        shapes = {name: " x ".join(map(str, array.shape)) for name, array in self.arrays.items()}
        facts = {name: str(self.row[name]) for name in ("label", "split", "subject") if self.row.get(name) is not None}
        return show_text(f"Example {self.row.get('id', '')}", {**facts, **shapes})

    @cached_property
    def specification(self) -> ExampleSpec:
        """Specification of the simulation: scene, radar, conditions, analysis and seed.

        It contains no distributions and is resolved on first use. Relative motion paths start from
        the working folder; :meth:`Dataset.specification` accepts another folder, and raises the same errors.
        """
        if self.specify is None:
            raise DatasetError(f"{self.id}: has no specification; only examples of datasets and streams have one")
        return self.specify()

    @property
    def truth(self) -> dict[str, Any]:
        """True values from the simulation or the labels.

        The names have no prefix ``truth_``; unknown values are None.
        """
        return {name.removeprefix("truth_"): v for name, v in self.row.items() if name.startswith("truth_")}

    def result(self, analysis: Analysis | None = None) -> Result:
        """Return the result of the analysis.

        It contains numbers, flags and the stored arrays in their stored precision.

        Parameters
        ----------
        analysis : Analysis, optional
            Settings of the analysis; those of the specification by default. :meth:`Dataset.result` does not need them.
        """
        analysis = analysis or self.specification.run.analysis
        arrays = {name: array for name, array in self.arrays.items() if name in ("signature", "cadence_map")}
        return Result.from_row(self.row, analysis, label=self.label, arrays=arrays)

    @property
    def id(self) -> str:
        """Identifier in the dataset."""
        return str(self.row["id"])

    @property
    def label(self) -> str:
        """Class."""
        return str(self.row["label"])

    @property
    def features(self) -> dict[str, float]:
        """The six features by name, NaN where undetermined."""
        return {name: _number(self.row.get(f"feature_{name}")) for name in FEATURE_UNITS}

    @property
    def signature(self) -> xr.DataArray:
        """Micro-Doppler signature (time, doppler), V^2."""
        return self._read_array("signature")

    @property
    def cadence_map(self) -> xr.DataArray:
        """Cadence-velocity diagram (cadence, doppler)."""
        return self._read_array("cadence_map")

    @property
    def baseband(self) -> xr.DataArray:
        """Data matrix (slow_time, range), complex64, V."""
        return self._read_array("baseband")

    def _read_array(self, name: str) -> xr.DataArray:
        if name not in self.arrays:
            kept = ", ".join(self.arrays) or "no arrays"
            raise DatasetError(f"{self.id}: the dataset keeps no {name}; it keeps {kept}")
        return self.arrays[name]


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def label_arrays(
    fields: Mapping[str, Mapping[str, Any]], row: Mapping[str, Any], stored: Stored, *, carrier_hz: float
) -> dict[str, xr.DataArray]:
    """Label the arrays of one example."""
    arrays = {}
    for name, facts in fields.items():
        values = stored(name)
        if values is None or values.size == 0:
            continue
        if values.ndim != len({*facts["dims"]}) or values.dtype.kind not in "fciu":
            raise DatasetError(
                f"{row.get('id')}: {name} has {values.ndim} axes of {values.dtype} in its shard, "
                f"not {facts['dims']}; check the folder with dataset verify"
            )
        coords: dict[str, tuple[Any, ...]] = {}
        for dim, size in zip(facts["dims"], values.shape, strict=True):
            axis = name_axis(name, dim)
            along = None if axis is None else stored(axis)
            if along is not None and along.shape == (size,) and along.dtype.kind in "fiu":
                coords[dim] = (dim, along, {"units": COORDINATE_UNITS[dim]})
        attrs: dict[str, Any] = {"units": facts["units"]}
        if "doppler" in coords:
            wavelength_m = carrier_to_wavelength_m(carrier_hz)
            velocity_mps = doppler_to_velocity_mps(coords["doppler"][1], wavelength_m)
            coords["velocity"] = ("doppler", velocity_mps, {"units": COORDINATE_UNITS["velocity"]})
            attrs |= {"prf_hz": float(row["prf_hz"]), "wavelength_m": float(wavelength_m)}
        arrays[name] = xr.DataArray(decode(values, facts), dims=facts["dims"], coords=coords, name=name, attrs=attrs)
    return arrays


def read_carrier_hz(description: Mapping[str, Any], row: Mapping[str, Any]) -> float:
    """Return a row's carrier frequency, Hz, NaN if unknown."""
    if "carrier_hz" in row:
        return _number(row["carrier_hz"])
    try:
        return read_radar(description, row).carrier_hz
    except (ConfigError, DatasetError):
        return math.nan


def read_radar(description: Mapping[str, Any], row: Mapping[str, Any]) -> Radar:
    """Return the radar of a simulated row."""
    number, table = find_plan_place(description, row), resolve_section(description, row, "radar")
    if number is None:
        raise DatasetError(f"{row['id']}: the dataset does not state its radar; only simulated ones do")
    seed = description["config"]["dataset"]["seed"]
    parsed = parse_radar(table, where="dataset.json", folder=Path(), seed=seed, example=number)
    radar: Radar = parsed["radar"]
    return radar.model_copy(update={"prf_hz": float(row["prf_hz"])}) if parsed["auto_prf"] else radar


def resolve_section(description: Mapping[str, Any], row: Mapping[str, Any], key: str) -> Any:
    """Return a section of the plan, as sampled for a row or as stated."""
    number, config = find_plan_place(description, row), description.get("config") or {}
    if number is None:
        return config.get(key, {})
    turn = int(str(row["scene_id"]).rpartition("-")[2])  # cycles advance within the class
    seed = config["dataset"]["seed"]
    return resolve(config.get(key, {}), seed=seed, example=number, key=key, turn=turn)


def find_plan_number(description: Mapping[str, Any], row: Mapping[str, Any]) -> int:
    """Return the number of a row's example in its plan."""
    if description.get("origin", "simulated") != "simulated":
        raise DatasetError("the dataset contains arrays of measured recordings, not the recordings themselves")
    version = description.get("data_version")
    if version != DATA_VERSION:
        raise DatasetError(
            f"the dataset has data version {version}, this doppelgait has {DATA_VERSION}: a new "
            "simulation would differ; build the dataset again to see its recordings"
        )
    number = find_plan_place(description, row)
    if number is None:
        raise DatasetError(f"{row.get('scene_id')}: is not in the plan of dataset.json")
    return number


def find_plan_place(description: Mapping[str, Any], row: Mapping[str, Any]) -> int | None:
    """Return the number of a row's example in its dataset's plan, if it has one."""
    config, first = description.get("config") or {}, 0
    label, _, within = str(row.get("scene_id")).rpartition("-")
    if description.get("origin", "simulated") != "simulated":
        return None
    for section in config.get("classes") or config.get("episodes", ()):
        if section["label"].replace(" ", "_") == label and within.isdigit():
            return first + int(within)
        first += section.get("examples") or config["dataset"]["examples_per_class"]
    return None
