"""Dataset browser: counts, rows, scatter plot and contact sheet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.config import convert_to_json
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.core.labels import read_axis
from doppelgait.dataset import Dataset
from doppelgait.dataset.config import SPLITS
from doppelgait.features import FEATURE_UNITS
from doppelgait.viewer.columns import Columns, Filters, parse_query
from doppelgait.viewer.examples import ExampleRuns
from doppelgait.viewer.payload import describe_axis, pack, remove_folders
from doppelgait.viewer.settings import Pairs, parse_parameters, parse_whole

Rows = npt.NDArray[np.int64]

FILTERED = (
    ("label",),
    ("split",),
    ("truth_ground_speed_mps", "quality_ground_speed_mps"),
    ("snr_frame_db", "quality_snr_mu_db"),
    ("truth_aspect_deg", "quality_aspect_deg"),
)
"""Filters that are shown at the start: the first column of each group with known values; measured data have no truth.
"""
SHOWN = (*(f"feature_{name}" for name in FEATURE_UNITS), "gait_frequency_hz", "quality_flags")
"""Columns of the table after the id and the columns of the filters."""
MOST_POINTS = 5000
MOST_ROWS = 500
MOST_THUMBNAILS = 96


class Browser:
    """Answers about an open dataset."""

    def __init__(self, dataset: Dataset, motion_folder: Path | None = None) -> None:
        self.dataset = dataset
        self.columns = Columns(dataset.index)
        self.classes = list(dataset.description["classes"])
        self._runs = ExampleRuns(dataset, motion_folder)
        self.run = self._runs.run

    @property
    def folders(self) -> tuple[Path, ...]:
        """Folders that the page must not show."""
        return self._runs.folders

    def summary(self) -> dict[str, Any]:
        """Describe the dataset and its columns."""
        description = self.dataset.description
        # Classes and splits keep their own order, which is not alphabetical.
        ordered = {"label": self.classes, "split": list(SPLITS)}
        columns = [self.columns.facts(name) for name in self.columns.kinds]
        for facts in columns:
            if facts["name"] in ordered:
                facts["values"] = [value for value in ordered[facts["name"]] if value in facts["values"]]
        return {
            "name": description["name"],
            "id": description["id"],
            "origin": description.get("origin", "simulated"),
            "complete": description.get("complete", True),
            "n_rows": len(self.dataset),
            "classes": self.classes,
            "splits": self.splits,
            "fields": list(description["fields"]),
            "balance": self._count_rows(np.arange(len(self.dataset))),
            "columns": columns,
            "filters": self.filtered,
            "shown": self.shown,
            "flags": self.columns.flag_counts(),
        }

    @property
    def splits(self) -> list[str]:
        """Splits that have rows."""
        there = self.columns.read_codes("split")[1]
        return [split for split in SPLITS if split in there]

    @property
    def filtered(self) -> list[str]:
        """Columns with filters that are shown from the start."""
        kinds = self.columns.kinds
        return [name for choice in FILTERED if (name := next((n for n in choice if n in kinds), "")) != ""]

    @property
    def shown(self) -> list[str]:
        """Columns of the table."""
        return ["id", *self.filtered, *(name for name in SHOWN if name in self.columns.kinds)]

    def rows(self, query: Pairs) -> dict[str, Any]:
        """Return one page of the table."""
        filters, parameters, found, offset, page = self._select_page(query, 50, MOST_ROWS)
        extra = [*filters.values, *filters.limits, *([parameters["sort"]] if "sort" in parameters else [])]
        shown = list(dict.fromkeys([*self.shown, *extra]))
        records = self.dataset.index[shown].iloc[page].to_dict("records")
        rows = [{"number": int(n), **convert_to_json(record)} for n, record in zip(page, records, strict=True)]
        return {"n_matching": found.size, "offset": offset, "columns": shown, "rows": rows}

    def balance(self, query: Pairs) -> dict[str, Any]:
        """Count the matching rows of every class in every split."""
        filters, _ = parse_query(query, self.columns)
        found = filters.rows(self.columns)
        return {"n_matching": found.size, "splits": self.splits, "counts": self._count_rows(found)}

    def scatter(self, query: Pairs) -> bytes:
        """Return two number columns, for rows in which both are known."""
        filters, parameters = parse_query(query, self.columns, ("x", "y"))
        names = {}
        for key in ("x", "y"):
            if key not in parameters:
                raise ConfigError(f"{key}: is missing; name a number column")
            names[key] = self.columns.check_kind(parameters[key], "number", key=key)
        values = {key: self.columns.numbers(name) for key, name in names.items()}
        found, numbers = filters.rows(self.columns), self._class_numbers
        known = found[np.isfinite(values["x"][found]) & np.isfinite(values["y"][found])]
        lots = np.random.default_rng(0).permutation(len(self.dataset))  # always the same
        chosen = choose_evenly(known, numbers[known], lots[known], MOST_POINTS)
        facts: dict[str, Any] = {key: self.columns.facts(name) for key, name in names.items()}
        facts |= {"classes": self.classes, "n_matching": found.size, "n_known": known.size}
        arrays: dict[str, Any] = {key: each[chosen].astype("f4") for key, each in values.items()}
        arrays["class"] = numbers[chosen].astype(np.min_scalar_type(max(len(self.classes) - 1, 0)))
        return pack(facts, {**arrays, "row": chosen.astype(np.int32)})

    def make_sheet(self, query: Pairs) -> bytes:
        """Return small signatures of one page of the matching rows."""
        _, _, found, offset, page = self._select_page(query, 24, MOST_THUMBNAILS)
        facts, arrays = make_thumbnails(self.dataset, page)
        facts["reasons"] = [reason and remove_folders(reason, *self.folders) for reason in facts["reasons"]]
        chosen = self.dataset.index.iloc[page]
        # What distinguishes the examples of a class, for each row of a page.
        shown = [self.columns.facts(name) for name in self.filtered[2:]]
        captions = []
        for number in page:
            values = ((self.columns.numbers(fact["name"])[number], fact["unit"]) for fact in shown)
            captions.append(", ".join(f"{value:.3g} {unit}" for value, unit in values if np.isfinite(value)))
        named = {"ids": chosen["id"].tolist(), "labels": chosen["label"].tolist(), "captions": captions}
        return pack({**named, **facts, "n_matching": int(found.size), "offset": offset}, arrays)

    def get_row_id(self, query: Pairs) -> dict[str, Any]:
        """Return id and class of a row."""
        number = parse_whole(parse_parameters(query, ("row",)), "row", -1, least=0, most=10**9)
        if not 0 <= number < len(self.dataset):
            raise ConfigError(f"row: {number} is not allowed; this dataset has rows 0 to {len(self.dataset) - 1}")
        row = self.dataset.index.iloc[number]
        return {"id": str(row["id"]), "label": str(row["label"])}

    def _select_page(self, query: Pairs, n_rows: int, most: int) -> tuple[Filters, dict[str, str], Rows, int, Rows]:
        """Return the matching rows in the requested order, and one page of them."""
        filters, parameters = parse_query(query, self.columns, ("sort", "descending", "offset", "limit"))
        offset = parse_whole(parameters, "offset", 0, least=0, most=10**9)
        limit = parse_whole(parameters, "limit", n_rows, least=1, most=most)
        descending = parse_whole(parameters, "descending", 0, least=0, most=1)
        found = filters.rows(self.columns)
        if "sort" in parameters:
            name = self.columns.check_kind(parameters["sort"], "number", "category", "text", key="sort")
            keys = self.columns.order(name)[found]
            found = found[np.argsort(-keys if descending else keys, kind="stable")]
        elif descending:
            found = found[::-1]
        return filters, parameters, found, offset, found[offset : offset + limit]

    @property
    def _class_numbers(self) -> npt.NDArray[np.int64]:
        """Class number of every row; shape (rows,)."""
        codes, labels = self.columns.read_codes("label")
        strange = [label for label in labels if label not in self.classes]
        if strange:
            raise DatasetError(f"{self.dataset.directory}: dataset.json has no class {strange[0]!r}; it is damaged")
        return np.array([self.classes.index(label) for label in labels], dtype=np.int64)[codes]

    def _count_rows(self, rows: Rows) -> dict[str, list[int]]:
        """Count the rows of every class, one number per split."""
        codes, known = self.columns.read_codes("split")
        n_splits = len(known)
        both = np.bincount(
            self._class_numbers[rows] * n_splits + codes[rows], minlength=len(self.classes) * n_splits
        ).reshape(len(self.classes), n_splits)
        places = [known.index(split) for split in self.splits]
        return {label: both[number, places].tolist() for number, label in enumerate(self.classes)}


def choose_evenly(rows: Rows, classes: Rows, lots: Rows, most: int) -> Rows:
    """Choose up to ``most`` rows randomly, classes by share."""
    if rows.size <= most:
        return rows
    order = np.lexsort((lots, classes))
    count = np.bincount(classes)
    last = np.cumsum(count)
    first = last - count
    share = last * most // rows.size - first * most // rows.size
    within = np.arange(rows.size) - first[classes[order]]
    return np.sort(rows[order[within < share[classes[order]]]])


THUMBNAIL = (112, 80)  # cells of a thumbnail in time and velocity
LEVELS = 255

FloatArray = npt.NDArray[np.float64]


def make_thumbnails(
    dataset: Dataset, rows: npt.NDArray[np.int64]
) -> tuple[dict[str, Any], dict[str, npt.NDArray[np.uint8]]]:
    """Make small images of the signatures of some rows."""
    found = [_read_signature(dataset, int(row)) for row in rows]
    signatures = [signature for signature, _ in found if signature is not None]
    facts: dict[str, Any] = {"reasons": [reason for _, reason in found], "image": None}
    if not signatures:
        return facts, {}
    from doppelgait.viz.maps import doppler_limits_hz, level_limits_db

    # All thumbnails have the same axes: time from the start of each, and the velocities
    # that any of them occupies.
    seconds = max(float(np.ptp(read_axis(s, "time"))) for s in signatures)
    limits = np.array([doppler_limits_hz(s) for s in signatures])
    moving, unit = "doppler", "Hz"
    if all(np.isfinite(read_axis(signature, "velocity")).all() for signature in signatures):
        limits *= np.array([[s.attrs["wavelength_m"] / 2.0] for s in signatures])
        moving, unit = "velocity", "m/s"
    n_columns, n_rows = THUMBNAIL
    times_s = np.linspace(0.0, seconds, n_columns + 1)
    velocities = np.linspace(limits[:, 0].min(), limits[:, 1].max(), n_rows + 1)
    maps = [None if signature is None else _reduce_signature(signature, times_s, velocities) for signature, _ in found]
    low, high = level_limits_db(np.concatenate([values.ravel() for values in maps if values is not None]), None)
    codes = np.zeros((len(maps), *THUMBNAIL), dtype=np.uint8)
    for number, level_db in enumerate(maps):
        if level_db is not None:
            share = np.nan_to_num((level_db - low) / (high - low), nan=0.0, posinf=1.0, neginf=0.0)
            codes[number] = np.rint(np.clip(share, 0.0, 1.0) * LEVELS).astype(np.uint8)
    facts["image"] = {
        "array": "thumbnails",
        "x": describe_axis("time", "s", (times_s[:-1] + times_s[1:]) / 2.0),
        "y": describe_axis(moving, unit, (velocities[:-1] + velocities[1:]) / 2.0),
        "db": [low, high],
        "shown_db": [low, high],
        "unit": f"dB re {'1 V²' if signatures[0].attrs['units'] == 'V^2' else '1'}",
    }
    return facts, {"thumbnails": codes}


def _read_signature(dataset: Dataset, row: int) -> tuple[xr.DataArray | None, str | None]:
    """Return the signature of a row, or the reason for none."""
    try:
        dataset.check_fields(["signature"])
        signature = dataset.example(row).arrays.get("signature")
    except DatasetError as error:
        return None, str(error)
    if signature is None:
        return None, "no signature: the target was not tracked"
    if not {"time", "doppler"} <= set(signature.coords) or min(signature.shape) < 2:
        return None, "its shard has no axes of the signature"
    return signature, None


def _reduce_signature(signature: xr.DataArray, times_s: FloatArray, velocities: FloatArray) -> FloatArray:
    """Return the strongest level of every cell in dB."""
    from doppelgait.viz.maps import compute_level_db

    own_s = read_axis(signature, "time") - read_axis(signature, "time")[0]
    own_velocities = read_axis(signature, "velocity")
    if not np.isfinite(own_velocities).all():
        own_velocities = read_axis(signature, "doppler")
    power = find_strongest(np.asarray(signature.values, dtype=np.float64), own_s, times_s)
    return compute_level_db(find_strongest(power.T, own_velocities, velocities).T)


def find_strongest(values: FloatArray, samples: FloatArray, edges: FloatArray) -> FloatArray:
    """Return the largest of values (n, m) per cell, NaN without samples."""
    half = float(samples[1] - samples[0]) / 2.0
    first = np.searchsorted(samples + half, edges[:-1], side="right")
    behind = np.searchsorted(samples - half, edges[1:], side="left")
    padded = np.concatenate([values, np.full((1, values.shape[1]), np.nan)])
    found = np.maximum.reduceat(padded, np.column_stack([first, behind]).ravel(), axis=0)[::2]
    return np.asarray(np.where((first < behind)[:, None], found, np.nan))
