"""Schemas of arrays in SI units: a time-like dimension first, range or Doppler last."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial, wraps
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, Protocol, TypeVar, Union

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import AnalysisError
from doppelgait.core.lazy import LateRows, lazy_rows, xr

if TYPE_CHECKING:
    from xarray.core.indexing import LazilyIndexedArray

Kind = TypeVar("Kind", bound=type)
P = ParamSpec("P")
R = TypeVar("R")
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

The angles are optional. ``path_phase`` exists only if a limb, a wall or a reflection shifts the
phase of an echo. It is added to -4 pi R / lambda.
"""

STEP_LENGTHS = {"ground_step_length_m": "step length on the ground", "step_length_m": "step length, radial"}
"""Names of both step lengths in display order. The report uses the radial one."""
OTHER_SIDES = "other_sides"  # of a column: another body in receding Doppler rows (1), in approaching (2), in both (3)
Coord = tuple[tuple[str, ...], npt.NDArray[Any], Mapping[Any, Any]]  # dimensions, values and attributes


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
        return cls(schema, np.ascontiguousarray(array.values, array.dtype.newbyteorder("=")), coords, dict(array.attrs))

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

    @property
    def counted(self) -> npt.NDArray[np.bool_]:
        """Columns that are not entirely of other bodies, (J,)."""
        return np.asarray(self.axis(OTHER_SIDES) < 3) if OTHER_SIDES in self.coords else np.ones(len(self.values), bool)

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


def describe_points(
    position_m: npt.NDArray[Any],
    time_s: npt.NDArray[np.float64],
    markers: Sequence[str],
    parts: Sequence[str],
    **attrs: Any,
) -> Signal:
    """Describe positions (time, marker, space) by their axes, without labels."""
    if position_m.shape != (*time_s.shape, len(markers), 3) or time_s.ndim != 1 or len(parts) != len(markers):
        raise ValueError(
            f"positions of shape {position_m.shape} do not fit times of shape {time_s.shape}, {len(markers)} markers "
            f"and {len(parts)} parts"
        )
    axes = {"time": time_s, "marker": np.array(markers, dtype=str), "space": np.array(SPACE)}
    coords: dict[str, Coord] = {name: ((name,), axis, {}) for name, axis in axes.items()}
    coords["part"] = (("marker",), np.array(parts, dtype=str), {})
    return Signal(MOTION, position_m, coords, {"units": MOTION.units, **attrs})


@dataclass(frozen=True, eq=False)
class ScattererTable:
    """Scatterers at every pulse: ``values`` (slow_time, scatterer), broadcast or on demand, and ``columns``."""

    slow_time_s: npt.NDArray[np.float64]
    values: Mapping[str, Any]
    columns: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)
    attrs: Mapping[Any, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, table: AnyTable) -> ScattererTable:
        """Remove the labels of a table."""
        if isinstance(table, ScattererTable):
            return table
        values = {str(name): read_axis(table, str(name)) for name in table.data_vars.variables}
        coords = table.coords.variables.items()
        columns = {str(name): read_axis(table, str(name)) for name, v in coords if v.dims == ("scatterer",)}
        return cls(table["slow_time"].values, values, columns, table.attrs)

    def label(self) -> xr.Dataset:
        """Make the labelled table."""
        dims = ("slow_time", "scatterer")
        units = {name: {"units": unit} for name, unit in SCATTERER_VARIABLES.items()}
        variables = {name: label_values(dims, array, units.get(name)) for name, array in self.values.items()}
        coords = {name: label_values("scatterer", column) for name, column in self.columns.items()}
        coords = {"slow_time": label_axis("slow_time", self.slow_time_s), **coords}
        sizes = dict(zip(dims, self.shape, strict=True))
        return xr.Dataset._construct_direct(
            {**variables, **coords}, set(coords), sizes, dict(self.attrs), _list_indexes(coords)
        )

    def __getitem__(self, name: str) -> Any:
        return self.values[name] if name in self.values else self.columns[name]

    def __contains__(self, name: object) -> bool:
        return name in self.values or name in self.columns

    @property
    def shape(self) -> tuple[int, int]:
        """Number of pulses and of scatterers."""
        return self.slow_time_s.size, next(iter(self.values.values())).shape[1]

    def replace(self, **values: Any) -> ScattererTable:
        """Return the table with some values replaced or added."""
        return replace(self, values={**self.values, **values})

    def take(self, columns: npt.NDArray[Any]) -> ScattererTable:
        """Return the scatterers of a mask or of numbers, as a view if possible."""
        numbers = np.flatnonzero(columns) if columns.dtype == bool else columns
        first, stop = (int(numbers[0]), int(numbers[-1]) + 1) if numbers.size else (0, 0)
        chosen = slice(first, stop) if (np.diff(numbers) == 1).all() else numbers
        values = {name: take_columns(array, chosen) for name, array in self.values.items()}
        return replace(self, values=values, columns={name: column[chosen] for name, column in self.columns.items()})

    def take_pulses(self, pulses: slice) -> ScattererTable:
        """Return some pulses, with their values in memory."""
        values = {name: array[pulses] for name, array in self.values.items()}
        return replace(self, slow_time_s=self.slow_time_s[pulses], values=values)


AnyTable = Union["xr.Dataset", ScattererTable]


def take_columns(values: Any, columns: slice | npt.NDArray[np.intp]) -> Any:
    """Select columns of a table's values; a broadcast row stays a single row."""
    if isinstance(values, np.ndarray) and values.strides[0] == 0:
        row = values[:1, columns]
        return np.broadcast_to(row, (values.shape[0], row.shape[1]))
    if isinstance(values, LateRows) or isinstance(columns, slice):
        return values[:, columns]
    return np.take(values, columns, axis=1)  # in C order, which an index of an array does not keep


def takes_arrays(function: Callable[..., Any]) -> bool:
    """Return True if the first annotated parameter is a plain table, no Dataset as in 0.2."""
    annotations = getattr(function, "__annotations__", {})
    first = next((value for name, value in annotations.items() if name != "return"), None)
    name = first.rpartition(".")[2] if isinstance(first, str) else first
    return name in (ScattererTable, AnyTable, "ScattererTable", "AnyTable")


def labels_on_demand(*names: str) -> Callable[[Kind], Kind]:
    """Keep fields of a dataclass plain until somebody reads them."""

    def make_field(name: str) -> property:
        def read(owner: Any) -> Any:
            kept = vars(owner)[name]
            if isinstance(kept, Signal | ScattererTable):
                kept = vars(owner)[name] = kept.label()
            return kept

        return property(read, lambda owner, value: vars(owner).update({name: value}))

    def change(kind: Kind) -> Kind:
        for name in names:
            setattr(kind, name, make_field(name))
        return kind

    return change


AnySignal = TypeVar("AnySignal", "xr.DataArray", Signal)
Labelled = TypeVar("Labelled", "xr.DataArray", Signal, "xr.Dataset", ScattererTable)


class Step(Protocol[P]):
    """Function from an array or table to another one, labelled as its argument is."""

    def __call__(self, values: Labelled, *args: P.args, **kwargs: P.kwargs) -> Labelled:
        """Return the new array or table."""


def maps_table(function: Callable[Concatenate[ScattererTable, P], ScattererTable]) -> Step[P]:
    """Let a function from table to table take labelled tables; it then returns a labelled table."""
    return _take_labels(ScattererTable.of, function)  # type: ignore[no-any-return]


def maps_signal(*schemas: Schema) -> Callable[[Callable[Concatenate[Signal, P], Signal]], Step[P]]:
    """Let a function from signal to signal take labelled arrays, and then return one."""
    return partial(_take_labels, lambda array: Signal.of(array, *schemas))


def measures_signal(
    *schemas: Schema,
) -> Callable[[Callable[Concatenate[Signal, P], R]], Callable[Concatenate[xr.DataArray | Signal, P], R]]:
    """Let a function that measures a signal take labelled arrays."""
    return partial(_take_labels, lambda array: Signal.of(array, *schemas))


def _take_labels(unlabel: Callable[[Any], Any], function: Callable[..., Any]) -> Any:
    first_name = function.__code__.co_varnames[0]

    @wraps(function)
    def run(*args: Any, **kwargs: Any) -> Any:
        if not args and first_name not in kwargs:
            return function(**kwargs)  # Python says what is missing
        array, *others = args or [kwargs.pop(first_name)]
        given = unlabel(array)
        found = function(given, *others, **kwargs)
        if not isinstance(found, Signal | ScattererTable) or given is array:
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


def replace_array_values(array: xr.DataArray, values: Any) -> xr.DataArray:
    """Return an array with new values and copied coordinates."""
    if values.shape != array.shape:
        raise ValueError(f"values of shape {values.shape} do not fit coordinates of shape {array.shape}")
    variable = label_values(array.dims, values, array.attrs)
    # an index never changes, so that only other coordinates are copied
    coords = {name: v.copy(deep=not isinstance(v, xr.IndexVariable)) for name, v in array.coords.variables.items()}
    return xr.DataArray(variable, coords, name=array.name, indexes=array.xindexes, fastpath=True)


def label_values(
    dims: Any, values: npt.ArrayLike | LazilyIndexedArray | LateRows, attrs: Mapping[str, Any] | None = None
) -> xr.Variable:
    """Make a variable of numbers or text without xarray's test for Dask, an import of 0.3 s."""
    values = lazy_rows(values) if isinstance(values, LateRows) else values
    from xarray.core.indexing import LazilyIndexedArray

    known = values if isinstance(values, LazilyIndexedArray) else np.asarray(values)
    return xr.Variable(dims, known, attrs, fastpath=True)


def _list_indexes(coords: Mapping[Any, xr.Variable]) -> dict[Any, Any]:
    from xarray.indexes import PandasIndex

    return {name: PandasIndex(v._data.array, name) for name, v in coords.items() if isinstance(v, xr.IndexVariable)}


def label_axis(name: str, coordinate: Any) -> xr.Variable:
    """Make a coordinate with its unit. It has an index if its name is that of its dimension."""
    if isinstance(coordinate, xr.DataArray | xr.Variable):
        coordinate = (coordinate.dims, coordinate.values, coordinate.attrs)
    dims, values, attrs = (*coordinate, {})[:3] if isinstance(coordinate, tuple) else (name, coordinate, {})
    facts = {**attrs, **({"units": COORDINATE_UNITS[name]} if name in COORDINATE_UNITS else {})}
    if dims not in (name, (name,)):
        return label_values(dims, values, facts)
    import pandas as pd

    index = pd.Index(np.asarray(values), name=name)
    return xr.IndexVariable(name, index, facts, fastpath=True)  # type: ignore[no-untyped-call]


def read_axis(array: xr.DataArray | xr.Dataset | Signal, name: str) -> npt.NDArray[Any]:
    """Return a coordinate or variable in native byte order."""
    if isinstance(array, Signal):
        return array.axis(name)
    variables = array._coords if isinstance(array, xr.DataArray) else array._variables
    data: Any = variables[name]._data
    if not isinstance(data, np.ndarray):
        from xarray.core.indexing import PandasIndexingAdapter

        is_number = isinstance(data, PandasIndexingAdapter) and data.array.dtype.kind == "f"
        data = np.asarray(data.array if is_number else variables[name].values)
    return np.asarray(data, data.dtype.newbyteorder("="))


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
    coordinates = array.coords.variables  # plain: an indexed coordinate costs 14 times as much
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
