"""All checks of a dataset in order, with figures."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from doppelgait.core.errors import ConfigError, OutputError
from doppelgait.dataset.config import Progress
from doppelgait.dataset.finish import list_shard_names, make_index, read_records
from doppelgait.dataset.open import check_index as check_index_columns
from doppelgait.dataset.open import read_index
from doppelgait.dataset.verify.contents import Check, Contents, Verification, read_known_description, read_plan
from doppelgait.dataset.verify.duplicates import check_duplicates, check_groups
from doppelgait.dataset.verify.integrity import (
    check_balance,
    check_files,
    check_identity,
    check_index,
    check_leftovers,
    check_rows,
    check_shards,
    check_split_lists,
    look_at_shards,
)
from doppelgait.dataset.verify.leakage import check_nuisance
from doppelgait.dataset.verify.resimulate import check_measured_snr, check_resimulation, choose
from doppelgait.dataset.verify.truth import (
    check_aspect,
    check_feasibility,
    check_gait_frequency,
    check_snr,
    check_velocity,
    check_visible_targets,
)
from doppelgait.features import FEATURE_UNITS

SHEET_SIZE, SHEET_COLUMNS = 24, 6
MOST_TIMES = 400
"""Maximum number of plotted columns of a signature, limited by the pixels of a small picture; longer signatures are
decimated to 400 to 800."""


def plot_sheets(contents: Contents, folder: Path, rng: np.random.Generator, form: str = "png") -> list[Path]:
    """Plot signatures per class on pages, and features."""
    from doppelgait.viz import feature_matrix, save_figure

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error}") from None
    files = []
    if "signature" in contents.description["fields"]:
        for label in sorted(contents.index["label"].unique()):
            figure = _plot_sheet(contents, label, rng)
            if figure is not None:
                files.append(save_figure(figure, folder / f"signatures-{label.replace(' ', '_')}.{form}"))
    if len(contents.index):
        table = contents.index.rename(columns={f"feature_{name}": name for name in FEATURE_UNITS})
        title = f"{contents.description.get('name')}: features of {len(table)} rows"
        files.append(save_figure(feature_matrix(table, title=title), folder / f"features.{form}"))
    return files


def _plot_sheet(contents: Contents, label: str, rng: np.random.Generator) -> Any:
    """Plot the page of one class, None without a signature."""
    from doppelgait.viz import contact_sheet

    members = np.flatnonzero((contents.index["label"] == label).to_numpy(dtype=bool))
    arrays: list[xr.DataArray] = []
    titles: list[str] = []
    places: list[int] = []
    for number in rng.permutation(members).tolist():
        example = contents.dataset.example(number)
        if "signature" in example.arrays:
            arrays.append(divide_by_floor(example.signature, example.row.get("quality_noise_floor_v2")))
            row = contents.index.iloc[number]
            parts = [str(row["id"]).removeprefix(f"{label.replace(' ', '_')}-").lstrip("0") or "0"]
            # use true values, or measured values if absent
            speeds = ("truth_radial_velocity_mps", "feature_torso_velocity_mps")
            levels = ("snr_frame_db", "quality_snr_mu_db")
            for names, unit in ((speeds, "{:+.1f} m/s"), (levels, "{:.0f} dB")):
                known = [row[name] for name in names if name in row.index and pd.notna(row[name])]
                parts += [unit.format(known[0])] if known else []
            titles.append(f"{parts[0]}: {', '.join(parts[1:])}" if parts[1:] else parts[0])
            places.append(number)
        if len(arrays) == SHEET_SIZE:
            break
    if not arrays:
        return None
    order = np.argsort(places)
    figure = contact_sheet([arrays[n] for n in order], titles=[titles[n] for n in order], columns=SHEET_COLUMNS)
    name = contents.description.get("name")
    words = (
        f"{name}: {label}, {len(arrays)} of {len(members)} rows (row: radial velocity, SNR), each over its noise floor"
    )
    figure.suptitle(words, fontsize=11.5, x=0.01, ha="left")
    return figure


def divide_by_floor(signature: xr.DataArray, floor_v2: float | None) -> xr.DataArray:
    """Divide a signature by its noise floor, or else its median."""
    known = floor_v2 is not None and floor_v2 > 0
    level = float(floor_v2) if known and floor_v2 is not None else float(signature.median())
    shown = signature[:: max(1, signature.sizes["time"] // MOST_TIMES)]
    over = shown / (level if level > 0 else 1.0)
    over.attrs = {**signature.attrs, "units": "1"}
    return over


class _Steps:
    """Progress of a verification: shards read twice, examples made again."""

    def __init__(self, total: int, on_progress: Progress | None) -> None:
        self.done, self.total, self.on_progress = 0, total, on_progress

    def __call__(self) -> None:
        self.done += 1
        self.total = max(self.total, self.done)
        if self.on_progress is not None:
            self.on_progress(self.done, self.total)


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
    description = read_known_description(target)
    steps = _Steps(2 * len(list_shard_names(description["shards"])), on_progress)
    contents, checks, n_missing = _open(target, description, folder or Path.cwd(), steps)
    try:
        for check in _run_checks(contents, n_missing, share, rng, steps):
            checks.append(check)
    except Exception as error:
        if checks[0].status == "passed":
            raise
        checks.append(Check("rest", "failed", f"files are damaged, and a check stopped at it: {error}"))
    pages = plot_sheets(contents, figures, rng, figure_format) if figures is not None else []
    return Verification(
        directory=target,
        dataset_id=str(description["id"]),
        complete=bool(description.get("complete")),
        checks=tuple(checks),
        figures=tuple(pages),
        seconds=time.monotonic() - began,
    )


def _open(
    target: Path, description: dict[str, Any], folder: Path, tick: Callable[[], None]
) -> tuple[Contents, list[Check], int]:
    """Return intact shards' contents, file checks and the number of others."""
    index, reason = None, ""
    if (target / "index.parquet").exists():
        try:
            index = read_index(target / "index.parquet", str(description["id"]))
            check_index_columns(index, description["classes"])
        except Exception as error:  # Arrow raises various errors for damaged files
            index = None
            reason = f"index.parquet cannot be read: {' '.join(str(error).split())}"
    names = list_shard_names(description["shards"])
    findings = look_at_shards(target, str(description["id"]), names, index, tick)
    complete = bool(description.get("complete"))
    if index is None and complete and not reason:
        reason = "index.parquet is missing, though the dataset is marked as complete"
    digest = hashlib.sha256("".join(findings.contents).encode()).hexdigest()
    if findings.missing or findings.damaged or not complete:
        stated = Check("contents", "failed" if complete else "skipped", "not every shard is there, or not complete")
    elif digest != description.get("contents_sha256"):
        stated = Check("contents", "failed", "not what the dataset was finished with: build it again")
    else:
        words = f"{digest[:16]}: specification, whole numbers and arrays as when the dataset was finished"
        stated = Check("contents", "passed", words)
    checks = [
        check_files(target, names, findings.hashes, complete=complete),
        check_shards(findings, complete=complete),
        stated,
        check_index(findings, index, reason),
        check_split_lists(target, index),
        check_leftovers(target),
    ]
    plan, no_plan = read_plan(description, folder)
    if index is None:
        rows = make_index(read_records(target, findings.whole))
    else:
        rows = index[index["shard"].isin(findings.whole)].reset_index(drop=True)
    contents = Contents(target, description, rows, findings.failed, plan, no_plan)
    return contents, checks, len(findings.missing) + len(findings.damaged)


def _run_checks(
    contents: Contents, n_missing: int, share: float, rng: np.random.Generator, steps: _Steps
) -> Iterator[Check]:
    yield check_identity(contents)
    if not len(contents.index):
        yield Check("rows", "skipped", "no row is there: nothing else can be checked")
        return
    for_sample, for_draws, for_pairs, for_guess = rng.spawn(4)
    chosen = choose(contents, share, for_sample)
    steps.total += len(chosen)
    examples = contents.resolve_sample(for_draws)
    yield check_rows(contents)
    yield check_balance(contents, missing_shards=n_missing)
    yield check_resimulation(contents, chosen, steps)
    yield check_measured_snr(contents, chosen, steps)
    yield check_velocity(contents.index)
    yield check_gait_frequency(contents.index)
    yield check_snr(contents.index, examples)
    yield check_aspect(contents.index, examples)
    yield check_visible_targets(contents)
    yield check_feasibility(contents)
    yield check_groups(contents)
    yield check_duplicates(contents, for_pairs, steps)
    yield check_nuisance(contents, examples, for_guess)
