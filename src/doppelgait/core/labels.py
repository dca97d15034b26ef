"""Names of dimensions and variables, and array schemas.

The time-like dimension is first, range or Doppler last. Values have SI units, named in ``attrs["units"]``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from xarray.core.indexing import LazilyIndexedArray
from xarray.indexes import PandasIndex

from doppelgait.core.errors import AnalysisError

SPACE = ("x", "y", "z")

COORDINATE_UNITS = {
    "part": "1",
    "time": "s",
    "slow_time": "s",
    "range": "m",
    "doppler": "Hz",
    "velocity": "m/s",
    "cadence": "Hz",
}
"""Unit of every numeric coordinate."""


@dataclass(frozen=True)
class Schema:
    """Dimensions, units and coordinates of a labelled array."""

    name: str
    dims: tuple[str, ...]
    units: str
    kind: str = "f"
    extra: Mapping[str, str] = field(default_factory=dict)


MOTION = Schema("motion", ("time", "marker", "space"), "m", extra={"part": "marker"})
BASEBAND = Schema("baseband", ("slow_time", "range"), "V", kind="c")
RANGE_DOPPLER = Schema("range_doppler", ("time", "doppler", "range"), "V^2", extra={"velocity": "doppler"})
SIGNATURE = Schema("signature", ("time", "doppler"), "V^2", extra={"velocity": "doppler"})
NORMALISED_SIGNATURE = Schema("normalised_signature", ("time", "doppler"), "1", extra={"velocity": "doppler"})
PART_POWER = Schema("part_power", ("part", "time", "doppler"), "V^2", extra={"velocity": "doppler"})
CADENCE_MAP = Schema("cadence_map", ("cadence", "doppler"), "1", extra={"velocity": "doppler"})
CADENCE_SPECTRUM = Schema("cadence_spectrum", ("cadence",), "1")
SHARE_REMOVED = Schema("share_removed", ("time",), "1")

SCATTERER_VARIABLES = {
    "range": "m",
    "radial_velocity": "m/s",
    "aspect": "rad",
    "azimuth": "rad",
    "elevation": "rad",
    "rcs": "m^2",
    "path_gain": "1",
    "path_phase": "rad",
}
"""Variables of the scatterer table, all (slow_time, scatterer), and their units.

The angles are optional. ``path_phase`` exists only if a wall or a reflection shifts the phase of an echo. It is added
to -4 pi R / lambda.
"""


@dataclass(slots=True)
class Plain:
    """Array of a schema that makes its labels on demand.
    Making labels takes longer than most computations with the values, and intermediate results need no labels.
    """

    schema: Schema
    values: npt.NDArray[Any]
    axes: Mapping[str, npt.NDArray[Any]]
    attrs: dict[Any, Any]
    like: xr.DataArray
    columns: slice | None = None

    @classmethod
    def of(cls, array: xr.DataArray, schema: Schema) -> Plain:
        """Remove the labels of a valid labelled array."""
        check_signal(array, schema)
        axes = {str(name): read_axis(array, str(name)) for name in array.coords.variables}
        return cls(schema, np.ascontiguousarray(array.values), axes, dict(array.attrs), array)

    @property
    def shape(self) -> tuple[int, ...]:
        """Length of every dimension."""
        return self.values.shape

    @property
    def sizes(self) -> dict[str, int]:
        """Length of every dimension by name."""
        return dict(zip(self.schema.dims, self.values.shape, strict=True))

    def add_labels(self) -> xr.DataArray:
        """Make the labelled array."""
        like = self.like if self.columns is None else self.like.isel({self.like.dims[0]: self.columns})
        own = {name: self.axes[name] for name in self.schema.dims if name not in like.coords.variables}
        if own or self.schema.dims != like.dims:
            return make_array(self.schema, self.values, own, self.attrs, like=like)
        return replace_array_values(like, self.values, schema=self.schema, attrs=self.attrs)


Signal = TypeVar("Signal", xr.DataArray, Plain)
"""Array with labels, or with labels that are made on demand."""


def make_like(like: Signal, schema: Schema, values: npt.NDArray[Any], coords: Mapping[str, Any]) -> Signal:
    """Make an array of another schema from one with like coordinates."""
    if isinstance(like, Plain):
        return Plain(schema, values, {**like.axes, **coords}, {"units": schema.units}, like.like, like.columns)
    return make_array(schema, values, coords, like=like)


def make_array(
    schema: Schema,
    values: npt.ArrayLike,
    coords: Mapping[str, Any],
    attrs: Mapping[str, Any] | None = None,
    *,
    like: xr.DataArray | None = None,
) -> xr.DataArray:
    """Make a labelled array that conforms to ``schema``.
    Units are set from the schema.
    """
    variables: dict[Any, xr.Variable] = {}
    indexes: dict[Any, Any] = {}
    for name, coordinate in coords.items():
        variables[name], index = _label_coordinate(name, coordinate)
        indexes |= {name: index} if index is not None else {}
    if like is not None:
        wanted = [name for name in (*schema.dims, *schema.extra) if name not in coords]
        variables |= {name: _copy_coordinate(like.coords.variables[name]) for name in wanted}
        indexes |= {name: like.xindexes[name] for name in wanted if name in like.xindexes}
    array = label_values(schema.dims, values, {"units": schema.units, **(attrs or {})})
    for name, variable in variables.items():
        if any(array.sizes.get(dim) != size for dim, size in variable.sizes.items()):
            raise ValueError(
                f"coordinate {name!r} has the sizes {dict(variable.sizes)}, but {schema.name} has {dict(array.sizes)}"
            )
    return check_signal(_assemble_array(array, variables, indexes, schema.name), schema)


def take_columns(array: Signal, columns: slice) -> Signal:
    """Slice an array along its first dimension."""
    if not isinstance(array, Plain):
        return array.isel({array.dims[0]: columns})
    if array.columns is not None:
        return take_columns(Plain.of(array.add_labels(), array.schema), columns)
    along, named = array.schema.dims[:1], array.like.coords.variables
    axes = {name: values[columns] if named[name].dims == along else values for name, values in array.axes.items()}
    return Plain(array.schema, array.values[columns], axes, dict(array.attrs), array.like, columns)


def replace_array_values(
    array: Signal,
    values: npt.NDArray[Any] | LazilyIndexedArray,
    *,
    schema: Schema | None = None,
    attrs: Mapping[str, Any] | None = None,
) -> Signal:
    """Return an array with new values and copied coordinates."""
    facts = {**array.attrs, **({"units": schema.units} if schema is not None else {}), **(attrs or {})}
    if values.shape != array.shape:
        raise ValueError(f"values of shape {values.shape} do not fit coordinates of shape {array.shape}")
    if isinstance(array, Plain):
        return Plain(schema or array.schema, np.asarray(values), array.axes, facts, array.like, array.columns)
    variable = label_values(array.dims, values, facts)
    name = array.name if schema is None else schema.name
    coords = {name: _copy_coordinate(coordinate) for name, coordinate in array.coords.variables.items()}
    return _assemble_array(variable, coords, array.xindexes, name)


def label_values(
    dims: Any, values: npt.ArrayLike | LazilyIndexedArray, attrs: Mapping[str, Any] | None = None
) -> xr.Variable:
    """Make a variable of numbers or text.
    This skips xarray's test for Dask arrays, which imports Dask where it is installed (0.3 s).
    """
    known = values if isinstance(values, LazilyIndexedArray) else np.asarray(values)
    return xr.Variable(dims, known, attrs, fastpath=True)


def label_table(
    values: Mapping[str, npt.NDArray[Any]], coords: Mapping[Any, Any], attrs: Mapping[Any, Any] | None = None
) -> xr.Dataset:
    """Make a table of scatterers, with units."""
    return xr.Dataset(_make_scatterer_variables(values), coords=coords, attrs=attrs)


def replace_values(table: xr.Dataset, **values: npt.NDArray[Any]) -> xr.Dataset:
    """Return a scatterer table with some variables replaced or added."""
    variables: dict[Any, xr.Variable] = dict(table.data_vars.variables)
    return xr.Dataset(variables | _make_scatterer_variables(values), coords=table.coords.variables, attrs=table.attrs)


def select_scatterers(table: xr.Dataset, columns: npt.NDArray[Any], *, copy: bool = False) -> xr.Dataset:
    """Return a table of some scatterers, as a view if possible.
    This is ``table.isel(scatterer=columns)`` without the import of Dask, where that is installed.
    """
    numbers = np.flatnonzero(columns) if columns.dtype == bool else columns
    first, stop = (int(numbers[0]), int(numbers[-1]) + 1) if numbers.size else (0, 0)
    chosen: Any = slice(first, stop) if (np.diff(numbers) == 1).all() else numbers

    def take(variable: xr.Variable) -> xr.Variable:
        if variable.dims[-1:] != ("scatterer",):
            return variable
        if isinstance(variable._data, LazilyIndexedArray):
            return variable[..., chosen]
        values = variable.values[..., chosen]
        return label_values(variable.dims, values.copy() if copy else values, variable.attrs)

    variables, coords = (
        {name: take(v) for name, v in part.items()} for part in (table.data_vars.variables, table.coords.variables)
    )
    return xr.Dataset(variables, coords=coords, attrs=table.attrs)


def _make_scatterer_variables(values: Mapping[str, npt.NDArray[Any]]) -> dict[Any, xr.Variable]:
    dims = ("slow_time", "scatterer")
    units = ({"units": SCATTERER_VARIABLES[name]} if name in SCATTERER_VARIABLES else None for name in values)
    return {name: label_values(dims, array, unit) for (name, array), unit in zip(values.items(), units, strict=True)}


def label_axis(name: str, values: npt.ArrayLike) -> xr.Variable:
    """Make the coordinate of a dimension, with unit and index."""
    return _label_coordinate(name, np.asarray(values))[0]


def _copy_coordinate(coordinate: xr.Variable) -> xr.Variable:
    """Copy a coordinate, so that the original stays unchanged.
    An index is immutable, so its values are not copied.
    """
    return coordinate.copy(deep=not isinstance(coordinate, xr.IndexVariable))


def _assemble_array(
    variable: xr.Variable, coords: dict[Any, Any], indexes: Mapping[Any, Any], name: Any
) -> xr.DataArray:
    """Build a labelled array from components that are known to match.
    This uses xarray's internal constructor without checks, which is ten times as fast.
    """
    return xr.DataArray(variable, coords, name=name, indexes=indexes, fastpath=True)


def _label_coordinate(name: str, coordinate: Any) -> tuple[xr.Variable, PandasIndex | None]:
    """Make a coordinate with its unit.
    It has an index if its name is that of its dimension.
    """
    if isinstance(coordinate, xr.DataArray | xr.Variable):
        coordinate = (coordinate.dims, coordinate.values, coordinate.attrs)
    dims, values, attrs = (*coordinate, {})[:3] if isinstance(coordinate, tuple) else (name, coordinate, {})
    facts = {**attrs, **({"units": COORDINATE_UNITS[name]} if name in COORDINATE_UNITS else {})}
    if dims not in (name, (name,)):
        return label_values(dims, values, facts), None
    index = PandasIndex(pd.Index(np.asarray(values), name=name), name)
    variable = index.create_variables()[name]
    variable.attrs = facts
    return variable, index


def read_axis(array: xr.DataArray | xr.Dataset | Plain, name: str) -> npt.NDArray[Any]:
    """Return the values of a coordinate.
    ``array.coords[name]`` takes 30 times as long, since it makes a labelled array first.
    """
    if isinstance(array, Plain):
        return array.axes[name]
    variable = array.coords.variables[name]
    if isinstance(variable, xr.IndexVariable):
        values = array.get_index(name).values  # the variable's own `values` takes five more calls
        if values.dtype.kind == "f":
            return np.asarray(values)
    return np.asarray(variable.values)


AnySignal = TypeVar("AnySignal", bound=xr.DataArray | Plain)


def check_signal(array: AnySignal, schema: Schema) -> AnySignal:
    """Return the array if it conforms to ``schema``, or raise."""
    if isinstance(array, Plain):
        if array.schema is not schema:
            raise AnalysisError(f"{schema.name}: this is a {array.schema.name}")
        return array
    faults = []
    if not isinstance(array, xr.DataArray):
        raise AnalysisError(f"{schema.name} must be an xarray.DataArray, not {type(array).__name__}")
    if array.dims != schema.dims:
        faults.append(f"dimensions are {array.dims}, must be {schema.dims}")
    if array.attrs.get("units") != schema.units:
        faults.append(f"units are {array.attrs.get('units')!r}, must be {schema.units!r}")
    if array.dtype.kind != schema.kind:
        faults.append(f"values are {array.dtype}, must be {'complex' if schema.kind == 'c' else 'real'} floats")
    coordinates = array.coords.variables  # plain variables: an indexed coordinate costs 14 times as much
    for name, dim in {**{d: d for d in schema.dims}, **schema.extra}.items():
        if name not in coordinates or coordinates[name].dims != (dim,):
            faults.append(f"coordinate {name!r} along {dim!r} is missing")
    if faults:
        raise AnalysisError(f"{schema.name}: " + "; ".join(faults))
    return array


def sampling_rate_hz(axis: npt.ArrayLike) -> float:
    """Compute the rate of a uniform time axis.
    An axis of fewer than two samples raises :class:`AnalysisError`.
    """
    times = np.asarray(axis, dtype=float)
    if times.size < 2 or not times[-1] > times[0]:
        raise AnalysisError(f"a time axis needs two or more rising samples; this one has {times.size}")
    return float((times.size - 1) / (times[-1] - times[0]))


STEP_LENGTHS = {"ground_step_length_m": "step length on the ground", "step_length_m": "step length, radial"}
"""Names of both step lengths in display order. The report uses the radial one."""
