"""Model inputs, labels and groups from dataset rows.

They contain only quantities that an analysis can measure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.classify.learned import FloatArray, Inputs, IntArray, Seen, join_inputs
from doppelgait.core.config import convert_to_json
from doppelgait.core.errors import DatasetError
from doppelgait.core.interrupt import raise_if_stopped
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.dataset.example import find_feature_columns, read_carrier_hz
from doppelgait.dataset.open import Dataset, read_signature
from doppelgait.dataset.verify.leakage import collect_nuisances
from doppelgait.processing.patches import Patch, levels_of

VELOCITY = "torso_velocity_mps"
SPEED = "torso_speed_mps"  # so that approaching and receding targets are equivalent
BANDWIDTH = "doppler_bandwidth_hz"
WIDTH = "doppler_bandwidth_mps"  # as a radial velocity, independent of the carrier
ENVELOPE = "extended_doppler_bandwidth_envelope_hz"
ENVELOPE_WIDTH = "extended_doppler_bandwidth_envelope_mps"

ALARM_CLASS = "human"  # class of the alarm by default
SUM_TOLERANCE = 0.01  # of probabilities, which a table may have rounded
SHARED = "gates_overlap"  # flag of a gate with another body


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows for training and testing."""

    datasets: tuple[Dataset, ...]
    index: pd.DataFrame
    origin: IntArray
    place: IntArray
    classes: tuple[str, ...]
    labels: IntArray
    groups: npt.NDArray[np.str_]
    alarm: str = ALARM_CLASS

    def __len__(self) -> int:
        return len(self.labels)


AnyRows = TypeVar("AnyRows", bound=Rows)


class Table(NamedTuple):
    """Inputs of a model, one row each."""

    values: Inputs
    names: tuple[str, ...]
    note: str = ""


def collect_rows(*datasets: Dataset) -> Rows:
    """Collect the rows of datasets, of the classes of the first one."""
    dataset, *others = datasets
    known = [label for label in dataset.description["classes"] if (dataset.index["label"] == label).any()]
    if len(known) < 2:
        raise DatasetError(
            f"{dataset.directory}: has the class {known[0]!r} alone" if known else f"{dataset.directory}: has no rows"
        )
    index = pd.concat([part.index for part in datasets], ignore_index=True)
    for other in others:
        if other.description.get("id") == dataset.description.get("id"):
            raise DatasetError(f"{other.directory}: is the training dataset; name another dataset to test on")
        if further := sorted(set(other.index["label"].unique()) - set(known)):
            raise DatasetError(
                f"{other.directory}: has the classes {', '.join(further)}, which {dataset.directory} does not have; "
                f"a model of it has {', '.join(known)}"
            )
    origin = np.repeat(np.arange(len(datasets)), [len(part) for part in datasets])
    labels = index["label"].map({label: number for number, label in enumerate(known)}).to_numpy(dtype=np.int64)
    # Groups by name. A sampled body differs between datasets, a recording does not.
    group = "group" if "group" in index else "subject"
    names = np.concatenate([part.index[group].to_numpy(dtype=str) for part in datasets])
    sampled = (origin > 0) & np.char.startswith(names, "model/")
    return Rows(
        datasets=datasets,
        index=index,
        origin=origin,
        place=np.concatenate([np.arange(len(part)) for part in datasets]),
        classes=tuple(known),
        labels=labels,
        groups=np.where(sampled, np.char.add(np.char.add(origin.astype(str), ":"), names), names),
    )


def mark_shared(index: pd.DataFrame) -> npt.NDArray[np.bool_]:
    """Mark rows with another body in their gate."""
    return np.array([SHARED in text.split(";") for text in index["quality_flags"].fillna("")], dtype=bool)


def all_rows(dataset: Dataset, classes: tuple[str, ...], index: pd.DataFrame | None = None) -> Rows:
    """Collect all rows of a dataset, or some, for a model of some classes, without labels."""
    index = dataset.index if index is None else index
    place, nothing = index.index.to_numpy(dtype=np.int64), np.zeros(len(index), dtype=np.int64)
    groups = index["group" if "group" in index else "subject"].to_numpy(dtype=str)
    return Rows((dataset,), index.reset_index(drop=True), nothing, place, classes, nothing, groups)


def collect_inputs(
    rows: Rows, features: str, *, patch: Patch | None = None, motion_folder: Path | None = None
) -> Table:
    """Collect the inputs of a model."""
    if features == "signature":
        for part in rows.datasets:
            part.check_fields(["signature"])
        pictures = np.empty(len(rows), dtype=object)
        for number, (origin, place) in enumerate(zip(rows.origin.tolist(), rows.place.tolist(), strict=True)):
            raise_if_stopped()
            pictures[number] = levels_of(read_signature(rows.datasets[origin], place), patch or Patch())
        return Table(pictures, ())
    if features == "extended+signature":
        both = [collect_inputs(rows, part, patch=patch) for part in features.split("+")]
        return Table(join_inputs(both[0].values, both[1].values), both[0].names)
    if features == "track":
        for part in rows.datasets:
            part.check_fields(["pictures"])
        table, windows = collect_inputs(rows, "extended"), np.empty(len(rows), dtype=object)
        for number, (one, origin, place) in enumerate(zip(list_windows(rows), rows.origin, rows.place, strict=True)):
            raise_if_stopped()
            pictures = rows.datasets[origin].stored(int(place), "pictures")
            windows[number] = one._replace(pictures=None if pictures is None or not pictures.size else pictures)
        return Table(join_inputs(table.values, windows), table.names)
    if features == "nothing":
        return Table(np.zeros((len(rows), 0)), ())
    if features == "nuisance":
        empty = bool((rows.index["source"] == "none").any())
        kept, note = collect_nuisances(rows.datasets, motion_folder or Path.cwd(), empty=empty)
        return Table(np.column_stack(list(kept.values())) if kept else np.zeros((len(rows), 0)), tuple(kept), note)
    feature_set = "six" if features == "speed" else features
    columns = find_feature_columns(rows.datasets[0].index, feature_set)
    for part in rows.datasets:
        missing = [name for name, column in columns.items() if column not in part.index]
        if missing:
            raise DatasetError(
                f"{part.directory}: has no feature {missing[0]!r}; build it with the same analysis, or choose --models"
            )
    if feature_set == "extended" and not any(column.startswith("extended_") for column in columns):
        raise DatasetError(f"{rows.datasets[0].directory}: has no extended features; it was built without them")
    values = convert_features({name: rows.index[column] for name, column in columns.items()}, wavelengths_m(rows))
    if features == "speed":
        values = {SPEED: values[SPEED]}
    return Table(np.column_stack(list(values.values())), tuple(values))


def collect_answers(given: Any, rows: Rows, tested: IntArray) -> FloatArray:
    """Return a user's probabilities of all rows (n, n_classes), NaN where there are none; check the tested rows."""
    number, name, classes = len(rows.datasets) - 1, "answers", list(rows.classes)
    dataset, own = rows.datasets[number], np.flatnonzero(rows.origin == number)
    if callable(given):
        asked = np.union1d(tested, own[rows.index["split"].iloc[own] == "validation"])
        given = given(replace(dataset, index=dataset.index.iloc[rows.place[asked]].reset_index(drop=True)))
    elif isinstance(given, str | Path):
        name, given = str(given), _read_table(Path(given))
    if not isinstance(given, pd.DataFrame):  # without ids a wrong order would go unnoticed
        raise DatasetError(f"{name}: must be a DataFrame with the column id, not {type(given).__name__}")
    row_ids = rows.index["id"].astype(str)
    named = [str(column) for column in given.columns if column in classes]
    strange = [str(column) for column in given.columns if column not in (*named, *rows.index.columns)]
    strange += given.columns[given.columns.duplicated()].tolist()
    if strange or "id" not in given or len(classes) - len(named) > (len(classes) == 2 and len(named) == 1):
        raise DatasetError(
            f"{name}: has the columns {', '.join(map(str, given.columns))}; it needs id and {', '.join(classes)}, the "
            "probability of each class (of two classes one is enough)"
        )
    ids = given["id"].astype(str)
    faults = {
        "has two lines": ids[ids.duplicated()],
        f"is no row of {dataset.directory}": ids[~ids.isin(row_ids.iloc[own])],
        "is a tested row without a line; rows of train are not scored": row_ids[tested][~row_ids[tested].isin(ids)],
    }
    for words, wrong in faults.items():
        if len(wrong):
            raise DatasetError(f"{name}: {wrong.iloc[0]!r} {words} ({len(wrong)} such; {tested.size} are tested)")
    values = np.column_stack([read_numbers(given[column]) for column in named])
    if len(named) < len(classes):
        values, named = np.column_stack([values, 1.0 - values]), [*named, *({*classes} - {*named})]
    bad = ~((values >= 0.0) & (values <= 1.0)).all(axis=1) | (np.abs(values.sum(axis=1) - 1.0) > SUM_TOLERANCE)
    if bad.any():
        told = dict(zip(named, values[bad.argmax()].tolist(), strict=True))
        raise DatasetError(
            f"{name}: {ids.iloc[bad.argmax()]!r} has {told}; probabilities must be numbers from 0 to 1 with the "
            f"sum 1, as of a softmax ({int(bad.sum())} of {len(values)} lines are wrong)"
        )
    found = np.full((len(rows), len(classes)), np.nan)
    places = pd.Series(own, row_ids.iloc[own])[ids].to_numpy()
    found[places] = (values / values.sum(axis=1, keepdims=True))[:, [named.index(label) for label in classes]]
    return found


def _read_table(path: Path) -> pd.DataFrame:
    try:
        if path.suffix == ".parquet":
            return pd.read_parquet(path)
        separator = ";" if b";" in path.read_bytes().partition(b"\n")[0] else ","
        table = pd.read_csv(path, dtype={"id": str}, sep=separator, encoding="utf-8-sig")
        return table.loc[:, ~table.columns.str.startswith("Unnamed: ")]  # numbers by pandas
    except (OSError, ValueError, ImportError) as error:
        raise DatasetError(f"{path}: is no readable table (CSV or Parquet): {error}") from None


def list_windows(rows: Rows) -> list[Seen]:
    """Return the windows of rows, without their pictures."""
    nothing, names = pd.Series(0.0, index=rows.index.index), ("window_stop_s", "quality_track_range_m")
    stops_s, range_m = (read_numbers(rows.index.get(name, nothing)) for name in names)
    shared, shown = mark_shared(rows.index), np.full(len(rows), -1)
    if shared.any() and ALARM_CLASS in rows.classes:
        human, keys = rows.classes.index(ALARM_CLASS), ["scene_id", "window_start_s"]
        tables = rows.index[shared].assign(origin=rows.origin[shared], number=np.flatnonzero(shared))
        for own in (part["number"].to_numpy() for _, part in tables.groupby(["origin", *keys])):
            apart_m = np.abs(range_m[own, None] - range_m[own]) + np.diag(np.full(own.size, np.inf))
            both = np.column_stack([rows.labels[own], rows.labels[own[np.nan_to_num(apart_m, nan=1e9).argmin(axis=1)]]])
            shown[own[(both == human).any(axis=1)]] = human
    columns = (number_tracks(rows).tolist(), stops_s.tolist(), shared.tolist(), shown.tolist())
    return [Seen(None, *values) for values in zip(*columns, strict=True)]


def number_tracks(rows: Rows) -> IntArray:
    """Return the number of the track of each row; a row of no track is its own."""
    given = read_numbers(rows.index["track"]) if "track" in rows.index else np.full(len(rows), np.nan)
    named = zip(
        rows.origin.tolist(), rows.index["scene_id"], given, np.isnan(given) * np.arange(len(rows)), strict=True
    )
    return np.unique([" ".join(map(str, each)) for each in named], return_inverse=True)[1]


def read_numbers(column: Any) -> FloatArray:
    """Convert a column to numbers, NaN for everything else."""
    numbers = pd.to_numeric(pd.Series(column), errors="coerce")
    return np.asarray(numbers.to_numpy(dtype=np.float64, na_value=np.nan), dtype=np.float64)


def convert_features(columns: Mapping[str, Any], wavelength_m: FloatArray) -> dict[str, FloatArray]:
    """Convert feature values to the inputs of a model."""
    found = {}
    for name, column in columns.items():
        values = read_numbers(column)
        values = np.where(np.isfinite(values), values, np.nan)
        if name == VELOCITY:
            found[SPEED] = np.abs(values)
        elif name.endswith((BANDWIDTH, ENVELOPE.removeprefix("extended_"))):
            found[f"{name.removesuffix('_hz')}_mps"] = values * wavelength_m / 2.0  # E-05
        else:
            found[name] = values
    return found


def wavelengths_m(rows: Rows) -> FloatArray:
    """Return the wavelength of every row; NaN where unknown."""
    carrier_hz = read_numbers(rows.index.get("carrier_hz", pd.Series(np.nan, index=rows.index.index)))
    unknown = np.flatnonzero(np.isnan(carrier_hz))
    table = rows.index.iloc[unknown].drop(columns="carrier_hz", errors="ignore")
    for n, row in zip(unknown, table.to_dict("records"), strict=True):
        carrier_hz[n] = read_carrier_hz(rows.datasets[rows.origin[n]].description, convert_to_json(row))
    return np.asarray(SPEED_OF_LIGHT_MPS / carrier_hz, dtype=np.float64)


def take_rows(rows: AnyRows, part: npt.NDArray[Any]) -> AnyRows:
    """Select rows by number or mask."""
    columns = {name: values[part] for name, values in vars(rows).items() if isinstance(values, np.ndarray)}
    return replace(rows, index=rows.index.iloc[part].reset_index(drop=True), **columns)


def select_split(rows: Rows, name: str) -> IntArray:
    """Return the rows of the first dataset in a split."""
    return np.flatnonzero((rows.index["split"] == name).to_numpy(dtype=bool) & (rows.origin == 0))
