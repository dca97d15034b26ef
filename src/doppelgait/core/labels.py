"""Names of dimensions and variables, and array schemas.

The time-like dimension is first, range or Doppler last. Values have SI units, named in ``attrs["units"]``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial, wraps
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from xarray.core.indexing import LazilyIndexedArray, PandasIndexingAdapter
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


Coord = tuple[tuple[str, ...], npt.NDArray[Any], Mapping[Any, Any]]
"""Dimensions, values and attributes of a coordinate."""


@dataclass(slots=True, eq=False)
class Signal:
    """Array of a schema with its coordinates, without the cost of labels."""

    schema: Schema
    values: npt.NDArray[Any]
    coords: Mapping[str, Coord]
    attrs: dict[Any, Any]

    @classmethod
    def of(cls, array: xr.DataArray | Signal, *schemas: Schema) -> Signal:
        """Remove the labels of an array that has one of the schemas."""
        if isinstance(array, Signal):
            if array.schema not in schemas:
                raise AnalysisError(f"{schemas[0].name}: this is a {array.schema.name}")
            return array
        units = getattr(array, "attrs", {}).get("units")
        schema = next((schema for schema in schemas if schema.units == units), schemas[0])
        check_signal(array, schema)
        coords = {
            str(name): (variable.dims, read_axis(array, str(name)), variable.attrs)
            for name, variable in array.coords.variables.items()
        }
        return cls(schema, np.ascontiguousarray(array.values), coords, dict(array.attrs))

    @property
    def shape(self) -> tuple[int, ...]:
        """Length of every dimension."""
        return self.values.shape

    @property
    def sizes(self) -> dict[str, int]:
        """Length of every dimension by name."""
        return dict(zip(self.schema.dims, self.values.shape, strict=True))

    def axis(self, name: str) -> npt.NDArray[Any]:
        """Return the values of a coordinate."""
        return self.coords[name][1]

    def label(self) -> xr.DataArray:
        """Make the labelled array."""
        own = {
            name: (dims, values if dims == (name,) else values.copy(), attrs)  # the index of a dimension never changes
            for name, (dims, values, attrs) in self.coords.items()
        }
        return make_array(self.schema, self.values, own, self.attrs)

    def replace(
        self, values: npt.NDArray[Any], *, schema: Schema | None = None, attrs: Mapping[str, Any] | None = None
    ) -> Signal:
        """Return the signal with other values of the same shape."""
        if values.shape != self.values.shape:
            raise ValueError(f"values of shape {values.shape} do not fit coordinates of shape {self.values.shape}")
        schema = schema or self.schema
        return Signal(schema, values, self.coords, {**self.attrs, "units": schema.units, **(attrs or {})})

    def with_axes(self, schema: Schema, values: npt.NDArray[Any], **axes: npt.NDArray[Any]) -> Signal:
        """Return a signal of another schema, with new axes and those in common."""
        new: dict[str, Coord] = {name: ((name,), axis, {}) for name, axis in axes.items()}
        coords = {name: new.get(name) or self.coords[name] for name in (*schema.dims, *schema.extra)}
        return Signal(schema, values, coords, {"units": schema.units})

    def take_columns(self, columns: slice) -> Signal:
        """Slice the signal along its first dimension."""
        along = self.schema.dims[0]
        coords = {
            name: (dims, values[tuple(columns if dim == along else slice(None) for dim in dims)], attrs)
            for name, (dims, values, attrs) in self.coords.items()
        }
        return Signal(self.schema, self.values[columns], coords, dict(self.attrs))


P = ParamSpec("P")
R = TypeVar("R")
R_co = TypeVar("R_co", covariant=True)
AnySignal = TypeVar("AnySignal", xr.DataArray, Signal)


class Step(Protocol[P]):
    """Function from an array to an array, labelled as its argument is."""

    def __call__(self, array: AnySignal, *args: P.args, **kwargs: P.kwargs) -> AnySignal:
        """Return the new array."""


class Measure(Protocol[P, R_co]):
    """Function from an array, labelled or not, to a measured value."""

    def __call__(self, array: xr.DataArray | Signal, *args: P.args, **kwargs: P.kwargs) -> R_co:
        """Return the measured value."""


def maps_signal(*schemas: Schema) -> Callable[[Callable[Concatenate[Signal, P], Signal]], Step[P]]:
    """Let a function from signal to signal take labelled arrays; it then returns a labelled array."""
    return partial(_take_labels, schemas)


def measures_signal(*schemas: Schema) -> Callable[[Callable[Concatenate[Signal, P], R]], Measure[P, R]]:
    """Let a function that measures a signal take labelled arrays."""
    return partial(_take_labels, schemas)


def _take_labels(schemas: tuple[Schema, ...], function: Callable[..., Any]) -> Any:
    first_name = function.__code__.co_varnames[0]

    @wraps(function)
    def run(*args: Any, **kwargs: Any) -> Any:
        if not args and first_name not in kwargs:
            return function(**kwargs)  # Python says what is missing
        array, *others = args or [kwargs.pop(first_name)]
        given = Signal.of(array, *schemas)
        found = function(given, *others, **kwargs)
        if not isinstance(found, Signal) or isinstance(array, Signal):
            return found
        return array if found is given else found.label()

    return run


def make_array(
    schema: Schema, values: npt.ArrayLike, coords: Mapping[str, Any], attrs: Mapping[str, Any] | None = None
) -> xr.DataArray:
    """Make a labelled array that conforms to ``schema``. Units are set from the schema."""
    variables: dict[Any, xr.Variable] = {name: label_axis(name, axis) for name, axis in coords.items()}
    array = label_values(schema.dims, values, {"units": schema.units, **(attrs or {})})
    for name, variable in variables.items():
        if any(array.sizes.get(dim) != size for dim, size in variable.sizes.items()):
            raise ValueError(
                f"coordinate {name!r} has the sizes {dict(variable.sizes)}, but {schema.name} has {dict(array.sizes)}"
            )
    made = xr.DataArray(array, variables, name=schema.name, indexes=_list_indexes(variables), fastpath=True)
    return check_signal(made, schema)


def replace_array_values(array: xr.DataArray, values: npt.NDArray[Any] | LazilyIndexedArray) -> xr.DataArray:
    """Return an array with new values and copied coordinates."""
    if values.shape != array.shape:
        raise ValueError(f"values of shape {values.shape} do not fit coordinates of shape {array.shape}")
    variable = label_values(array.dims, values, array.attrs)
    coords = {name: _copy_coordinate(coordinate) for name, coordinate in array.coords.variables.items()}
    return xr.DataArray(variable, coords, name=array.name, indexes=array.xindexes, fastpath=True)


def label_values(
    dims: Any, values: npt.ArrayLike | LazilyIndexedArray, attrs: Mapping[str, Any] | None = None
) -> xr.Variable:
    """Make a variable of numbers or text without xarray's test for Dask, an import of 0.3 s."""
    known = values if isinstance(values, LazilyIndexedArray) else np.asarray(values)
    return xr.Variable(dims, known, attrs, fastpath=True)


def label_table(
    values: Mapping[str, npt.NDArray[Any]], coords: Mapping[Any, Any], attrs: Mapping[Any, Any] | None = None
) -> xr.Dataset:
    """Make a table of scatterers, with units."""
    return _assemble_table(_make_scatterer_variables(values), coords, attrs)


def _assemble_table(
    variables: dict[Any, xr.Variable], coords: Mapping[Any, xr.Variable], attrs: Mapping[Any, Any] | None
) -> xr.Dataset:
    """Build a table from matching variables, with a twentieth of the usual calls."""
    everything = {**variables, **coords}
    sizes: dict[Any, int] = {}
    for variable in everything.values():
        sizes.update(zip(variable.dims, variable.shape, strict=True))
    return xr.Dataset._construct_direct(everything, set(coords), sizes, dict(attrs or {}), _list_indexes(coords))


def _list_indexes(coords: Mapping[Any, xr.Variable]) -> dict[Any, Any]:
    return {name: PandasIndex(v._data.array, name) for name, v in coords.items() if isinstance(v, xr.IndexVariable)}


def replace_values(table: xr.Dataset, **values: npt.NDArray[Any]) -> xr.Dataset:
    """Return a scatterer table with some variables replaced or added."""
    variables = dict(table.data_vars.variables) | _make_scatterer_variables(values)
    return _assemble_table(variables, table.coords.variables, table.attrs)


def select_scatterers(table: xr.Dataset, columns: npt.NDArray[Any], *, copy: bool = False) -> xr.Dataset:
    """Return a table of some scatterers, as a view if possible; ``isel`` would import Dask."""
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
    return _assemble_table(variables, coords, table.attrs)


def _make_scatterer_variables(values: Mapping[str, npt.NDArray[Any]]) -> dict[Any, xr.Variable]:
    dims = ("slow_time", "scatterer")
    units = ({"units": SCATTERER_VARIABLES[name]} if name in SCATTERER_VARIABLES else None for name in values)
    return {name: label_values(dims, array, unit) for (name, array), unit in zip(values.items(), units, strict=True)}


def _copy_coordinate(coordinate: xr.Variable) -> xr.Variable:
    """Copy a coordinate, so that the original stays unchanged; an index is immutable."""
    if isinstance(coordinate, xr.IndexVariable):
        dims, attrs = coordinate.dims, dict(coordinate.attrs)
        return xr.IndexVariable(dims, coordinate._data, attrs, fastpath=True)  # type: ignore[no-untyped-call]
    return label_values(coordinate.dims, np.array(coordinate.values), dict(coordinate.attrs))


def label_axis(name: str, coordinate: Any) -> xr.Variable:
    """Make a coordinate with its unit. It has an index if its name is that of its dimension."""
    if isinstance(coordinate, xr.DataArray | xr.Variable):
        coordinate = (coordinate.dims, coordinate.values, coordinate.attrs)
    dims, values, attrs = (*coordinate, {})[:3] if isinstance(coordinate, tuple) else (name, coordinate, {})
    facts = {**attrs, **({"units": COORDINATE_UNITS[name]} if name in COORDINATE_UNITS else {})}
    if dims not in (name, (name,)):
        return label_values(dims, values, facts)
    index = pd.Index(np.asarray(values), name=name)
    return xr.IndexVariable(name, index, facts, fastpath=True)  # type: ignore[no-untyped-call]


def read_axis(array: xr.DataArray | xr.Dataset | Signal, name: str) -> npt.NDArray[Any]:
    """Return the values of a coordinate or variable, in a thirtieth of the time of xarray."""
    if isinstance(array, Signal):
        return array.axis(name)
    variables = array._coords if isinstance(array, xr.DataArray) else array._variables
    data: Any = variables[name]._data
    if isinstance(data, np.ndarray):
        return data
    is_number = isinstance(data, PandasIndexingAdapter) and data.array.dtype.kind == "f"
    return np.asarray(data.array if is_number else variables[name].values)


def check_signal(array: xr.DataArray, schema: Schema) -> xr.DataArray:
    """Return the array if it conforms to ``schema``, or raise."""
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
    """Compute the rate of a uniform time axis."""
    times = np.asarray(axis, dtype=float)
    if times.size < 2 or not times[-1] > times[0]:
        raise AnalysisError(f"a time axis needs two or more rising samples; this one has {times.size}")
    return float((times.size - 1) / (times[-1] - times[0]))


STEP_LENGTHS = {"ground_step_length_m": "step length on the ground", "step_length_m": "step length, radial"}
"""Names of both step lengths in display order. The report uses the radial one."""
