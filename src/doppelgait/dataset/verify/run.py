"""All checks of a dataset in order, with figures."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
import xarray as xr

from doppelgait.core.errors import ConfigError, DoppelgaitError, OutputError
from doppelgait.dataset.config import Progress
from doppelgait.dataset.finish import (
    DATA_VERSION,
    list_shard_names,
    make_index,
    read_description,
    read_records,
)
from doppelgait.dataset.verify import integrity, truth
from doppelgait.dataset.verify.contents import Check, Contents, Verification, read_plan
from doppelgait.dataset.verify.leakage import check_nuisance
from doppelgait.features import FEATURE_UNITS

Need = Literal["rows", "plan", "version", "simulated"]
CHECKS: tuple[tuple[str, Callable[[Contents], Check], tuple[Need, ...]], ...] = (
    ("files", integrity.check_files, ()),
    ("shards", integrity.check_shards, ()),
    ("contents", integrity.check_contents, ()),
    ("index", integrity.check_index, ()),
    ("splits", integrity.check_split_lists, ()),
    ("leftovers", integrity.check_leftovers, ()),
    ("identity", integrity.check_identity, ("plan", "version")),
    ("rows", integrity.check_rows, ("rows", "plan")),
    ("class balance", integrity.check_balance, ("rows",)),
    ("re-simulation", truth.check_resimulation, ("rows", "plan", "version")),
    ("measured SNR", truth.check_measured_snr, ("rows", "plan", "version")),
    ("torso velocity", truth.check_velocity, ("rows",)),
    ("gait frequency", truth.check_gait_frequency, ("rows",)),
    ("planned SNR", truth.check_snr, ("rows", "plan")),
    ("aspect", truth.check_aspect, ("rows", "plan")),
    ("visible targets", truth.check_visible_targets, ("rows", "simulated")),
    ("feasibility", truth.check_feasibility, ("rows", "simulated")),
    ("groups", integrity.check_groups, ("rows",)),
    ("duplicates", integrity.check_duplicates, ("rows",)),
    ("nuisance", check_nuisance, ("rows",)),
)
"""Name and function of every check, and what it needs."""


def find_obstacles(contents: Contents) -> dict[Need, Check]:
    """Return the findings of checks whose needs are not met."""
    version = contents.description.get("data_version")
    unmet: dict[Need, Check] = {}
    if not len(contents.index):
        unmet["rows"] = Check("skipped", "no row is there")
    if contents.plan is None:
        unmet["plan"] = Check("not applicable" if contents.measured else "skipped", contents.no_plan)
    if version != DATA_VERSION:
        words = f"made with data version {version}, this doppelgait makes {DATA_VERSION}"
        unmet["version"] = Check("skipped", words)
    if contents.measured:
        unmet["simulated"] = Check("not applicable", "imported recordings have no truth")
    return unmet


def verify_dataset(
    directory: str | Path,
    *,
    folder: Path | None = None,
    share: float = 0.01,
    rng: np.random.Generator,
    on_progress: Progress | None = None,
    figures: Path | None = None,
    figure_format: str = "png",
) -> Verification:
    """Verify a dataset: files, plan, repeated simulation, truth, leaks.

    If the dataset is unfinished, its existing part is checked.

    Nothing in the dataset's folder is changed.

    Parameters
    ----------
    folder : Path, optional
        Folder that relative motion paths of the plan start from; the working folder by default.
    share : float
        Share of the examples to make again, from 0 to 1; at least three of every class, none at 0.
    rng : Generator
        Chooses these and all other samples, folds and permutations.
    on_progress : callable, optional
        Called with (steps done, steps in total).
    figures : Path, optional
        Folder for a page of signatures for every class and one of the features.
    figure_format : {"png", "svg", "pdf"}
        Format of these pages.

    Raises
    ------
    DatasetError
        If the folder holds no dataset, its description is damaged or of another schema version.
    ConfigError
        If the share is not from 0 to 1.
    OutputError
        If a figure cannot be written.
    """
    if not 0 <= share <= 1:
        raise ConfigError(f"share = {share}: is not allowed; must be from 0 to 1")
    began, target = time.monotonic(), Path(directory)
    description = read_description(target)
    done, total = 0, 2 * len(list_shard_names(description.get("shards", ())))  # shards are read twice

    def tick() -> None:
        nonlocal done
        done += 1
        if on_progress is not None:
            on_progress(done, max(total, done))

    files = integrity.read_files(target, description, tick)
    if files.index is None:
        index = make_index(read_records(target, files.whole))
    else:
        index = files.index[files.index["shard"].isin(files.whole)].reset_index(drop=True)
    plan, no_plan = read_plan(description, folder or Path.cwd(), len(index))
    contents = Contents(target, description, index, plan, no_plan, files, share, rng, tick)
    unmet, checks = find_obstacles(contents), list[Check]()
    for name, find, needs in CHECKS:
        obstacle = next((unmet[need] for need in needs if need in unmet), None)
        try:
            checks.append(replace(obstacle or find(contents), name=name))
            total += len(contents.chosen) if name == "rows" else 0
        except Exception as error:
            start = "the check stopped"
            if checks and checks[0].status != "passed":
                start = "files are damaged, and the check stopped at it"
            elif not isinstance(error, OSError | DoppelgaitError):
                raise
            checks.append(Check("failed", f"{start}: {error}", name=name))
    pages = plot_sheets(contents, figures, rng, figure_format) if figures is not None else []
    return Verification(
        directory=target,
        dataset_id=str(description["id"]),
        complete=contents.complete,
        checks=tuple(checks),
        figures=tuple(pages),
        seconds=time.monotonic() - began,
    )


SHEET_SIZE, SHEET_COLUMNS = 24, 6
MAX_TIMES = 400
"""Number of plotted columns of a signature, limited by the pixels of a small picture; longer ones
are decimated to 400 to 800."""


def plot_sheets(contents: Contents, folder: Path, rng: np.random.Generator, form: str = "png") -> list[Path]:
    """Plot signatures per class on pages, and features."""
    from doppelgait.viz import contact_sheet, feature_matrix, save_figure

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error}") from None
    files, index, name = [], contents.index, contents.description["name"]
    for label in sorted(index["label"].unique()) if "signature" in contents.description["fields"] else []:
        members = np.flatnonzero((index["label"] == label).to_numpy(dtype=bool))
        shown: dict[int, xr.DataArray] = {}
        for number in rng.permutation(members).tolist():
            example = contents.dataset.example(number)
            if "signature" in example.arrays:
                floor_v2, signature = example.row.get("quality_noise_floor_v2"), example.signature
                level = float(floor_v2 or 0.0)
                level = level if level > 0 else float(signature.median())
                step = max(1, signature.sizes["time"] // MAX_TIMES)
                over = signature[::step] / (level if level > 0 else 1.0)
                shown[number] = over.assign_attrs({**signature.attrs, "units": "1"})
            if len(shown) == SHEET_SIZE:
                break
        if not shown:
            continue
        rows = sorted(shown)
        titles = [_describe_row(index.iloc[number]) for number in rows]
        figure = contact_sheet([shown[number] for number in rows], titles=titles, columns=SHEET_COLUMNS)
        title = f"{name}: {label}, {len(shown)} of {len(members)} rows (row: radial velocity, SNR), "
        figure.suptitle(f"{title}each over its noise floor", fontsize=11.5, x=0.01, ha="left")
        files.append(save_figure(figure, folder / f"signatures-{label.replace(' ', '_')}.{form}"))
    if len(index):
        table = index.rename(columns={f"feature_{name}": name for name in FEATURE_UNITS})
        title = f"{name}: features of {len(table)} rows"
        files.append(save_figure(feature_matrix(table, title=title), folder / f"features.{form}"))
    return files


def _describe_row(row: pd.Series) -> str:
    """Return number, speed and SNR of a row: true values, or measured values if absent."""
    parts = []
    speeds = ("truth_radial_velocity_mps", "feature_torso_velocity_mps")
    for names, unit in ((speeds, "{:+.1f} m/s"), (("snr_frame_db", "quality_snr_mu_db"), "{:.0f} dB")):
        known = [row[name] for name in names if name in row.index and pd.notna(row[name])]
        parts += [unit.format(known[0])] if known else []
    number = str(row["id"]).removeprefix(f"{row['label'].replace(' ', '_')}-").lstrip("0") or "0"
    return f"{number}: {', '.join(parts)}" if parts else number
