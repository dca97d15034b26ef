"""Open a dataset: index, features for scikit-learn, labelled examples, batches."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from doppelgait.core.config import convert_to_json, validate
from doppelgait.core.documents import CELL_BYTES, check_cost, stat_regular
from doppelgait.core.errors import DatasetError, explain_memory
from doppelgait.core.interrupt import raise_if_stopped
from doppelgait.core.notebook import show_html, show_text
from doppelgait.core.rng import RandomSource, Streams, as_generator
from doppelgait.dataset.config import SPLITS, PlanConfig, suggest_names
from doppelgait.dataset.example import (
    Example,
    Features,
    build_feature_matrix,
    find_plan_number,
    label_arrays,
    read_carrier_hz,
    resolve_section,
)
from doppelgait.dataset.finish import read_description
from doppelgait.dataset.resolve import ExampleSpec, resolve_example
from doppelgait.dataset.rows import (
    Array,
    As,
    LabelledArrays,
    check_fields,
    epoch_rows,
    make_picture,
    picture_format,
    select_rows,
    shuffled_rows,
)
from doppelgait.dataset.shard_files import ShardFiles, decode
from doppelgait.features import FEATURE_UNITS
from doppelgait.pipeline.result import Result
from doppelgait.processing import Analysis
from doppelgait.processing.patches import Patch

if TYPE_CHECKING:
    from doppelgait.dataset.torch_data import IterableExamples, TorchExamples


PICTURE, PATCH = "picture", Patch()  # of a signature, as an array that is made on reading
TEXT_COLUMNS = ("id", "label", "split", "shard")


@dataclass(frozen=True, eq=False)
class Dataset:
    """A built dataset, or a part of it.

    ``len(dataset)`` counts its rows, ``for example in dataset`` reads them in order.

    Parameters
    ----------
    description : dict
        ``dataset.json``: identity, classes, fields, configuration.
    index : pandas.DataFrame
        One row per example and target.
    files : ShardFiles
        Reader of its arrays, shared by all parts.
    """

    directory: Path
    description: dict[str, Any]
    index: pd.DataFrame
    files: ShardFiles = field(repr=False)

    def __repr__(self) -> str:
        return show_text("Dataset", self._shown())

    def _repr_html_(self) -> str:
        return show_html("Dataset", self._shown(), "dataset" if len(self) else "", self)

    def _shown(self) -> dict[str, str]:
        def count(column: str) -> str:
            return ", ".join(f"{n} {name}" for name, n in self.index[column].value_counts().sort_index().items())

        return {
            "folder": str(self.directory),
            "rows": str(len(self)),
            "classes": count("label"),
            "splits": count("split"),
            "id": str(self.description.get("id", "")),
        }

    def __len__(self) -> int:
        return len(self.index)

    def __iter__(self) -> Iterator[Example]:
        return map(self.example, range(len(self)))

    @overload
    def __getitem__(self, key: Literal["train", "validation", "test"]) -> Dataset: ...  # type: ignore[overload-overlap]
    @overload
    def __getitem__(self, key: str | int) -> Example: ...
    def __getitem__(self, key: str | int) -> Dataset | Example:
        """Return a split's examples, or the example of an id or a number; -1 is the last."""
        if isinstance(key, int | np.integer):
            if not -len(self) <= key < len(self):
                raise DatasetError(f"{self.directory}: no example {key}, only 0 to {len(self) - 1}")
            return self.example(int(key) % len(self))
        if key in SPLITS:
            known = sorted(self.index["split"].unique())
            if key not in known:
                raise DatasetError(f"{self.directory}: no split {key!r}; there are {', '.join(known) or 'none'}")
            return self.select(split=key)
        found = np.flatnonzero((self.index["id"] == key).to_numpy(dtype=bool)) if isinstance(key, str) else np.empty(0)
        if found.size == 0:
            splits = ", ".join(split for split in SPLITS if (self.index["split"] == split).any())
            hint = f"; the splits are {splits or 'none'}{suggest_names(str(key), self.index['id'])}"
            raise DatasetError(f"{self.directory}: {key!r} is neither a split nor the id of an example here{hint}")
        return self.example(int(found[0]))

    def select(self, query: str = "", **columns: str | float | list[Any]) -> Dataset:
        """Select the examples that fulfil a query, and have these values of columns.

        An example is ``"truth_aspect_deg < 30 and label == 'dog'"``: columns of the index, numbers, texts and lists
        with comparisons, ``in``, ``+ - * /``, ``and``, ``or`` and ``not``. A query runs no code.
        ``select(split="test", label=["dog", "cat"])`` needs no query; a list allows all its values.

        Raises
        ------
        DatasetError
            If the query names no column of the index or is no condition, or a label does not exist.
        """
        for name, known in (("label", self.description["classes"]), ("split", SPLITS)):
            if strange := sorted({*map(str, np.atleast_1d(columns.get(name, [])))} - {*known}):
                raise DatasetError(f"select: {name} {strange[0]!r} is not one of {', '.join(known)}")
        terms = [f"{name} {'in' if isinstance(value, list) else '=='} {value!r}" for name, value in columns.items()]
        if terms:
            query = " and ".join([f"({query})", *terms] if query else terms)
        return replace(self, index=self.index[select_rows(self.index, query)].reset_index(drop=True))

    def features(self, names: str | Sequence[str] = "six", *, without_flags: Sequence[str] = ()) -> Features:
        """Return features, labels and groups for scikit-learn.

        ``X, y, groups = dataset.features()`` unpacks them.

        Parameters
        ----------
        names : {"six", "extended"} or list of str
            ``six``: the feature set F in the order of :data:`doppelgait.features.FEATURE_UNITS`.
            ``extended``: these, the gait frequency and all of ``extended_*``. A list names columns
            of the index. Only a list can include true values (``truth_*``) and columns that are not
            features (``snr_frame_db``).
        without_flags : sequence of str
            Leave out rows with one of these flags; ``*`` fits anything, for example ``"*:uncertain_by_*"``.

        Raises
        ------
        DatasetError
            If a column is missing or holds no numbers.
        """
        return build_feature_matrix(self.index, names, without_flags)

    def array(self, field: str, number: int) -> Array:
        """Return an array of an example in linear units, empty for a target without a track."""
        self.check_fields([field])
        values = self.stored(number, field)
        if values is None:
            raise DatasetError(f"{self.directory}: {self.index['id'].iloc[number]} has no {field}")
        return decode(values, self.description["fields"][field])

    def shape(self, number: int, name: str) -> tuple[int, ...] | None:
        """Return the shape of :meth:`stored` without reading it."""
        if name == PICTURE:
            return PATCH.n_velocity, PATCH.n_time
        shards, rows = self._places
        return self.files.shape(shards[number], name, rows[number])

    def example(self, number: int) -> Example:
        """Return the ``number``-th example of this part with labelled arrays."""
        row, fields = convert_to_json(self.index.iloc[number].to_dict()), self.description["fields"]
        carrier_hz = read_carrier_hz(self.description, row) if fields else float("nan")
        arrays = label_arrays(fields, row, partial(self.stored, number), carrier_hz=carrier_hz)
        return Example(row, arrays, partial(self.specification, number))

    def specification(self, number: int, *, folder: str | Path | None = None) -> ExampleSpec:
        """Return the specification of an example's simulation; :meth:`result` is its outcome.

        Parameters
        ----------
        folder : path, optional
            Folder that relative motion paths start from; the working folder by default.

        Raises
        ------
        DatasetError
            If the example was not simulated, or by a version of doppelgait that makes other bytes.
        ConfigError
            If a motion or preset file of the plan is missing.
        """
        row: dict[str, Any] = convert_to_json(self.index.iloc[number].to_dict())
        place = find_plan_number(self.description, row)
        split, group = str(row["split"]), str(row["group"])
        return resolve_example(self.plan_config, place, Path(folder or ""), split=split, group=group)

    @cached_property
    def plan_config(self) -> PlanConfig:
        """Plan that the dataset was built from, its folders expanded."""
        return validate(PlanConfig, self.description.get("config") or {}, where="dataset.json")

    def result(self, number: int) -> Result:
        """Return the result of an example with its settings; its truth is :attr:`Example.truth`."""
        example = self.example(number)
        table = resolve_section(self.description, example.row, "analysis")
        return example.result(validate(Analysis, table, where="dataset.json: analysis"))

    def stored(self, number: int, name: str) -> Array | None:
        """Return a stored array or axis of an example by its name, its picture, or None."""
        if name == PICTURE:
            return make_picture(read_signature(self, number), PATCH)
        shards, rows = self._places
        return self.files.read(shards[number], name, rows[number])

    @cached_property
    def _places(self) -> tuple[list[str], list[int]]:
        """Shard and row of every example."""
        # indexing a list is a hundred times as fast as indexing a table
        return self.index["shard"].tolist(), self.index["row"].tolist()

    def check_fields(self, fields: Sequence[str]) -> None:
        """Raise a :class:`DatasetError` if a field is not kept."""
        check_fields(fields, self.description["fields"], f"{self.directory}:")

    def class_numbers(self) -> npt.NDArray[np.int64]:
        """Return the class number of every row, as in ``dataset.json``."""
        return self.index["label"].map(self.description["classes"]).to_numpy(dtype=np.int64)

    def class_weights(self) -> dict[str, float]:
        """Return a weight of every class that balances them.

        Returns
        -------
        dict
            By label, in the order of the class numbers: n / (number of classes with rows * rows of
            the class), as scikit-learn's ``class_weight="balanced"``; 0 for a class without rows.
            ``torch.tensor([*weights.values()])`` is the ``weight`` of a loss in torch.
        """
        classes: Mapping[str, int] = self.description["classes"]
        counts = self.index["label"].value_counts()
        counts = counts[counts > 0]  # a categorical column counts what is not there
        weights = len(self) / (len(counts) * counts)
        return {label: float(weights.get(label, 0.0)) for label in sorted(classes, key=classes.__getitem__)}

    def arrays(self, field: str, *, as_: As = "array", memory_mb: float = 2000.0) -> LabelledArrays:
        """Return a field of all rows, with labels and groups.

        ``values, y, groups = dataset.arrays("signature")`` unpacks them, as those of :meth:`features`.

        Parameters
        ----------
        as_ : {"array", "picture"} or Patch
            As of :meth:`batches`.
        memory_mb : float
            Maximum memory of the arrays, MB (1 MB is 1,000,000 bytes). It is checked before reading.

        Returns
        -------
        LabelledArrays
            Its values are one array (n, ...) where the shapes of the rows agree, as those of pictures do, else a list.

        Raises
        ------
        DatasetError
            If the field is not kept or has no picture, or the arrays would take more than ``memory_mb``.
        """
        self.check_fields([field])
        patch = picture_format(as_, [field])
        if patch is None:
            shapes = [self.shape(number, field) or () for number in range(len(self))]
            facts = self.description["fields"][field]
            dtype = np.dtype(facts["dtype"] if facts.get("scale", "linear") == "linear" else np.float32)
        else:
            shapes = [(patch.n_velocity, patch.n_time)] * len(self)
            dtype = np.dtype(np.float32)
        need_mb = sum(map(math.prod, shapes)) * dtype.itemsize / 1e6
        if not need_mb <= memory_mb:
            raise DatasetError(
                f"arrays: {field} of {len(self):,} rows would take {need_mb:,.1f} MB, memory_mb is "
                f"{memory_mb:,g}; select fewer rows, use batches() or torch(), or raise memory_mb"
            )
        values: Array | list[Array]
        values = np.empty((len(self), *shapes[0]), dtype) if len({*shapes}) == 1 else [np.empty(0)] * len(self)
        for number in range(len(self)):
            raise_if_stopped()
            values[number] = read_fields(self, [field], patch, number)[field]
        texts = (self.index[name].to_numpy(dtype=str) for name in ("label", "group", "id"))
        return LabelledArrays(values, *texts)

    def batches(
        self,
        fields: Sequence[str] = ("signature",),
        batch_size: int = 32,
        rng: RandomSource | None = None,
        *,
        shuffle: bool = True,
        as_: As = "array",
    ) -> Iterator[dict[str, Array]]:
        """Yield batches of arrays, each example once.

        Parameters
        ----------
        batch_size : int
            The last batch may be smaller.
        rng : Streams or numpy.random.Generator, optional
            Random numbers for the order; required with ``shuffle``.
        shuffle : bool
            In a random order (:func:`doppelgait.dataset.rows.shuffled_rows`), else in that of the index.
        as_ : {"array", "picture"} or Patch
            ``array``: in linear units, on the stored grid. ``picture``: that of :func:`doppelgait.classify.patch`,
            the middle 2 s of a signature in levels from 0 (noise floor) to 1 (40 dB over it), float32, as an array
            (64 velocities from -6.4 to 6.4 m/s, approaching positive; 64 times of 1/32 s). Pulse rate, carrier,
            duration and gain do not change it. :class:`doppelgait.classify.Patch` sets another format.

        Yields
        ------
        dict
            For each field an array (batch, ...), ``label`` (class numbers) and ``number`` (rows of this part).

        Raises
        ------
        DatasetError
            If a field is not kept or has no picture, ``rng`` is missing, or arrays of a batch differ in shape.
        """
        self.check_fields(fields)
        patch = picture_format(as_, fields)
        if batch_size < 1:
            raise DatasetError(f"batch_size: {batch_size} is not allowed; it must be 1 or larger")
        rows, numbers = np.arange(len(self)), self.class_numbers()
        if shuffle:
            if rng is None:
                raise DatasetError("batches: shuffling needs rng, for example doppelgait.rng(1); or shuffle=False")
            rows = shuffled_rows(self.index, as_generator(rng, "batches"))
        return (
            {**{name: stack(self, name, part, patch) for name in fields}, "label": numbers[part], "number": part}
            for part in (rows[first : first + batch_size] for first in range(0, len(rows), batch_size))
        )

    def torch(
        self,
        fields: Sequence[str] = ("signature",),
        *,
        as_: As = "array",
        transform: Callable[[Any], Any] | None = None,
        target: Literal["label", "index"] = "label",
    ) -> TorchExamples:
        """Return the examples as a ``torch.utils.data.Dataset``, for any number of workers.

        Parameters
        ----------
        as_ : {"array", "picture"} or Patch
            As of :meth:`batches`. Pictures have no channel axis; ``batch[:, None]`` adds one.
        transform : callable, optional
            Applied to what is returned for the fields.
        target : {"label", "index"}
            Number of the class, as in ``dataset.json``, or of the row in this part.

        Returns
        -------
        torch.utils.data.Dataset
            Items are ``(tensor, target)`` for one field, ``({field: tensor}, target)`` for several.

        Raises
        ------
        DatasetError
            If torch is not installed, or a field is not kept or has no picture.
        """
        from doppelgait.dataset.torch_data import TorchExamples, check_request

        self.check_fields(fields)
        patch = picture_format(as_, fields)
        check_request(fields, target)
        # send workers only the data that reading the arrays needs
        columns = [name for name in ("id", "shard", "row", *AXIS_COLUMNS) if name in self.index]
        slim = replace(self, index=self.index[columns])
        targets = self.class_numbers() if target == "label" else np.arange(len(self))
        return TorchExamples(partial(read_fields, slim, tuple(fields), patch), targets, transform)

    def torch_iterable(
        self,
        fields: Sequence[str] = ("signature",),
        *,
        seed: int | None,
        as_: As = "array",
        transform: Callable[[Any], Any] | None = None,
        target: Literal["label", "index"] = "label",
    ) -> IterableExamples:
        """Return the examples as a ``torch.utils.data.IterableDataset``.

        Items, other parameters and errors are as those of :meth:`torch`. The workers of a loader
        share the examples: every example is returned once per epoch. Shard files are read one group
        after another, which suits datasets that are larger than memory.

        Parameters
        ----------
        seed : int or None
            Seed of the order, which depends only on seed and epoch; None for the order of the index.
            Call ``set_epoch(n)`` before every epoch for another one, also with persistent workers.

        Raises
        ------
        ConfigError
            If the seed or an epoch is no integer or below 0.
        """
        from doppelgait.dataset.torch_data import IterableExamples

        examples = self.torch(fields, as_=as_, transform=transform, target=target)
        Streams(0 if seed is None else seed)  # check here and not in a worker
        return IterableExamples(examples, partial(epoch_rows, self.index[["shard"]], seed))


AXIS_COLUMNS = ("scene_id", "prf_hz", "carrier_hz")
"""Columns of the index that the axes of a signature need."""


def read_signature(dataset: Dataset, number: int) -> xr.DataArray | None:
    """Read a row's signature alone, None if absent."""
    index = dataset.index
    row = convert_to_json({name: index[name].iloc[number] for name in ("id", *AXIS_COLUMNS) if name in index})
    facts = {"signature": dataset.description["fields"]["signature"]}
    carrier_hz = read_carrier_hz(dataset.description, row)
    return label_arrays(facts, row, partial(dataset.stored, number), carrier_hz=carrier_hz).get("signature")


def stack(dataset: Dataset, field: str, rows: npt.NDArray[np.int64], patch: Patch | None = None) -> Array:
    """Stack the arrays or pictures of rows as one, (row, ...)."""
    values = [read_fields(dataset, [field], patch, int(row))[field] for row in rows]
    for row, value in zip(rows, values, strict=True):
        if value.shape != values[0].shape:
            first, other = dataset.index["id"].iloc[[rows[0], row]]
            raise DatasetError(
                f"{field}: {first} has the shape {values[0].shape}, {other} {value.shape}; select examples of one "
                "shape, read them one by one, or read signatures as pictures (as_='picture')"
            )
    return np.stack(values)


def read_fields(dataset: Dataset, fields: Sequence[str], patch: Patch | None, number: int) -> dict[str, Array]:
    """Read the fields of a row, as arrays or as pictures."""
    if patch is None:
        return {name: dataset.array(name, number) for name in fields}
    return {name: make_picture(read_signature(dataset, number), patch) for name in fields}


@explain_memory
def open_dataset(directory: str | Path, *, classes: Sequence[str] | None = None) -> Dataset:
    """Open a built dataset.

    Parameters
    ----------
    classes : sequence of str, optional
        Labels in the order of their numbers, as of a network that was trained on another dataset.
        By default the order of ``dataset.json``: of the plan, or of the lines of labels imported.

    Raises
    ------
    DatasetError
        If the folder has no dataset, or an unfinished, damaged or other one; or by wrong classes.

    Examples
    --------
    >>> import doppelgait as dg
    >>> plan, folder = dg.dataset.load_plan("home-alarm", overrides=["dataset.examples_per_class=8"])
    >>> report = dg.dataset.build_dataset(plan, "tiny", executor="serial")
    >>> dataset = dg.open_dataset("tiny")
    >>> dataset.index["label"].tolist()[:3]
    ['human', 'dog', 'dog']
    """
    folder = Path(directory)
    for name in ("dataset.json", "index.parquet"):
        if not (folder / name).is_file():
            raise DatasetError(f"{folder}: no finished dataset here ({name} is missing); build it first")
        if (folder / name).resolve().parent != folder.resolve():
            raise DatasetError(f"{folder}: {name} is a link that leads out of the folder; put the file itself there")
    description = read_description(folder)
    try:
        index = read_index(folder / "index.parquet", description["id"], description["classes"])
    except (OSError, ValueError, KeyError, TypeError, OverflowError, NotImplementedError) as error:
        raise DatasetError(f"{folder}: is damaged: {error}") from None
    if classes is not None:
        labels = sorted({*index["label"]})
        if isinstance(classes, str) or len({*classes}) < len(classes) or {*labels} - {*classes}:
            raise DatasetError(f"classes = {classes!r}: must be different labels, {', '.join(labels)} among them")
        description = {**description, "classes": {label: n for n, label in enumerate(classes)}}
    return Dataset(folder, description, index, ShardFiles(folder / "shards", description["id"]))


def read_index(path: Path, identity: str, classes: Collection[str]) -> pd.DataFrame:
    """Read the index of a dataset, and check its columns."""
    import pyarrow.parquet as pq

    stat_regular(path)
    with pq.ParquetFile(path) as file:
        found = (file.schema_arrow.metadata or {}).get(b"dataset", b"").decode(errors="replace")
        if found != identity:
            raise ValueError(f"index.parquet: belongs to dataset {found!r}, dataset.json to {identity!r}")
        check_cost(path, CELL_BYTES // 4 * file.metadata.num_rows * file.metadata.num_columns)
        table = file.read()
    table.validate(full=True)  # texts, too: pandas decodes them on use
    index: pd.DataFrame = table.to_pandas()
    if not index.columns.is_unique:
        raise ValueError("index.parquet: two columns have the same name")
    types, measured = pd.api.types, [f"feature_{name}" for name in FEATURE_UNITS]
    for name in (*TEXT_COLUMNS, "row", *measured) if len(index) else ():
        if name not in index:
            raise ValueError(f"index.parquet: has no column {name!r}")
        values = index[name]
        fits, words = types.is_numeric_dtype(values), "a number"
        if name in TEXT_COLUMNS:
            fits, words = types.infer_dtype(values) in ("string", "categorical") and not values.isna().any(), "a text"
        elif name == "row":
            fits, words = types.is_integer_dtype(values) and bool((values >= 0).all()), "a whole number from 0"
        if not fits:
            raise ValueError(f"index.parquet: column {name!r} must hold {words} in every row")
    for name, known in (("split", SPLITS), ("label", classes)) if len(index) else ():
        if strange := sorted(set(index[name].unique()) - set(known)):
            raise ValueError(f"index.parquet: {name} {strange[0]!r} is not one of {', '.join(known)}")
    return index
