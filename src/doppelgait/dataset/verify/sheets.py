"""Pages to look at: signatures of every class, and the features of all classes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from doppelgait.core.errors import OutputError
from doppelgait.dataset.verify.contents import Contents
from doppelgait.features import FEATURE_UNITS

SHEET_SIZE, SHEET_COLUMNS = 24, 6
MOST_TIMES = 400
"""Columns of a signature that are drawn, 400 to 800 of longer ones: a small picture has no more pixels."""


def draw_sheets(contents: Contents, folder: Path, rng: np.random.Generator) -> list[Path]:
    """One page of up to 24 signatures for every class, where they are kept, and one of the six features by class.

    Signatures of a class share axes and scale, in dB above the noise floor of each.

    Raises
    ------
    OutputError
        If the folder cannot be written.
    """
    from doppelgait.viz import feature_matrix, save_figure

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error}") from None
    files = []
    if "signature" in contents.description["fields"]:
        for label in sorted(contents.index["label"].unique()):
            figure = _sheet(contents, label, rng)
            if figure is not None:
                files.append(save_figure(figure, folder / f"signatures-{label.replace(' ', '_')}.png"))
    if len(contents.index):
        table = contents.index.rename(columns={f"feature_{name}": name for name in FEATURE_UNITS})
        title = f"{contents.description.get('name')}: features of {len(table)} rows"
        files.append(save_figure(feature_matrix(table, title=title), folder / "features.png"))
    return files


def _sheet(contents: Contents, label: str, rng: np.random.Generator) -> Any:
    """Page of one class; None where no row of it has a signature."""
    from doppelgait.viz import contact_sheet

    members = np.flatnonzero((contents.index["label"] == label).to_numpy(dtype=bool))
    arrays: list[xr.DataArray] = []
    titles: list[str] = []
    places: list[int] = []
    for number in rng.permutation(members).tolist():
        example = contents.dataset.example(number)
        if "signature" in example.arrays:
            arrays.append(above_floor(example.signature, example.row.get("quality_noise_floor_v2")))
            titles.append(_title(contents.index.iloc[number], label))
            places.append(number)
        if len(arrays) == SHEET_SIZE:
            break
    if not arrays:
        return None
    order = np.argsort(places)
    figure = contact_sheet([arrays[n] for n in order], titles=[titles[n] for n in order], columns=SHEET_COLUMNS)
    name = contents.description.get("name")
    words = f"{name}: {label}, {len(arrays)} of {len(members)} rows, each over its noise floor"
    figure.suptitle(words, fontsize=11.5, x=0.01, ha="left")
    return figure


def above_floor(signature: xr.DataArray, floor_v2: float | None) -> xr.DataArray:
    """Signature over its noise floor, or over its median where no floor is known; as many columns as a page shows."""
    known = floor_v2 is not None and floor_v2 > 0
    level = float(floor_v2) if known and floor_v2 is not None else float(signature.median())
    shown = signature[:: max(1, signature.sizes["time"] // MOST_TIMES)]
    over = shown / (level if level > 0 else 1.0)
    over.attrs = {**signature.attrs, "units": "1"}
    return over


def _title(row: pd.Series, label: str) -> str:
    """Number, speed and SNR of a row: the true ones, else the measured ones, as far as they are known."""
    parts = [str(row["id"]).removeprefix(f"{label.replace(' ', '_')}-").lstrip("0") or "0"]
    speeds = ("truth_radial_velocity_mps", "feature_torso_velocity_mps")
    levels = ("snr_frame_db", "quality_snr_mu_db")
    for names, words in ((speeds, "{:+.1f} m/s"), (levels, "{:.0f} dB")):
        known = [row[name] for name in names if name in row.index and pd.notna(row[name])]
        parts += [words.format(known[0])] if known else []
    return "  ".join(parts)
