"""Command line, tables and figures of both sim-to-real studies."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import sim_to_real_models as models
from sim_to_real_inputs import Inputs
from xband_measures import FloatArray

from doppelgait import viz
from doppelgait.classify.patches import Levels, Patch
from doppelgait.classify.training import Kind
from doppelgait.core.files import atomic_path
from doppelgait.viz.style import name_axes, new_figure

Questions = Mapping[str, Sequence[str]]
"""Classes of real recordings that are scored together, by what the score is called."""
FEW = 0.5


def make_parser(doc: str | None, data: str, count: int, things: str) -> argparse.ArgumentParser:
    """Make the command-line parser of a study of synthetic ``things``.

    ``data`` is the file or folder of the real ones.
    """
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help=f"folder with {data}")
    parser.add_argument("out", type=Path, help="folder for tables, figures and what is kept for the next run")
    parser.add_argument("--mocap", type=Path, help="folder with human and dog motion capture")
    parser.add_argument("--count", type=int, default=count, help=f"synthetic {things} of the main set")
    parser.add_argument("--quick", action="store_true", help=f"a few {things}, no networks: only to see that it runs")
    return parser


class Writer:
    """Writer of the tables of a study so far.

    A long study that is stopped keeps its first tables.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.begun_s = path, time.perf_counter()

    def __call__(self, parts: Sequence[str]) -> None:
        """Write the parts and the time since the beginning."""
        text = "\n\n".join([*parts, f"{time.perf_counter() - self.begun_s:.0f} s"]) + "\n"
        self.path.write_text(text, encoding="utf-8")


def markdown(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Format a Markdown table, floats with two decimals."""

    def cell(value: object) -> str:
        return f"{value:.2f}" if isinstance(value, float) else str(value)

    lines = [f"| {' | '.join(head)} |", f"| --- |{' ---: |' * (len(head) - 1)}"]
    return "\n".join([*lines, *(f"| {' | '.join(map(cell, row))} |" for row in rows)])


def score_row(name: str, fitted: models.Fitted, real: Inputs, questions: Questions) -> list[object]:
    """Return held-out accuracy, loss and scores of a model."""
    probability = fitted.of_person(real)
    shares = [models.right_of(probability, real.labels, wanted) for wanted in questions.values()]
    return [name, 100.0 * fitted.held_accuracy, fitted.held_loss, *shares]


def score_table(fitted: Mapping[str, models.Fitted], real: Inputs, questions: Questions) -> str:
    """Tabulate one line per model."""
    head = ("model", "held synthetic, balanced %", "log loss", *questions)
    return markdown(head, [score_row(name, one, real, questions) for name, one in fitted.items()])


def recording_table(names: Sequence[str], fitted: Mapping[str, models.Fitted], real: Inputs, chosen: str) -> str:
    """Tabulate decision and probabilities per recording.

    Decision of the chosen model, and the probability of a person of every model.
    """
    told = {name: one.of_person(real) for name, one in fitted.items()}
    rows: list[list[object]] = []
    for number, name in enumerate(names):
        person, is_person = bool(told[chosen][number] > FEW), real.labels[number] == models.PERSON
        decision = ("human" if person else "not human") + ("" if person == is_person else " **wrong**")
        numbers = [float(values[number]) for values in told.values()]
        rows.append([name, real.labels[number], decision, *numbers])
    return markdown(("recording", "truth", f"decision ({chosen})", *told), rows)


def variant_head(first: str, kinds: Mapping[str, Kind], questions: Questions) -> list[str]:
    """Return the head of a table of :func:`variant_cells`."""
    return [first, *(f"{name}: {what}" for name in kinds for what in ("held synthetic %", *questions))]


def variant_cells(fitted: Mapping[str, models.Fitted], real: Inputs, questions: Questions) -> list[object]:
    """Return held-out accuracy and scores of every model, without intervals."""
    cells: list[object] = []
    for one in fitted.values():
        probability = one.of_person(real)
        shares = [models.right_of(probability, real.labels, wanted) for wanted in questions.values()]
        cells += [round(100 * one.held_accuracy), *(f"{share.hits}/{share.count}" for share in shares)]
    return cells


def kept_cells(path: Path, make: Callable[[], list[object]]) -> list[object]:
    """Load the cells of a line, or make and write them."""
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as partial:
            partial.write_text(json.dumps(make()), encoding="utf-8")
    return list(json.loads(path.read_text(encoding="utf-8")))


def trained_cells(
    path: Path, kinds: Mapping[str, Kind], make: Callable[[], Inputs], patch: Patch, real: Inputs,
    questions: Questions, *, far: str | None = None,
) -> list[object]:  # fmt: skip
    """Return cached cells of models trained on the result of ``make``.

    ``far``: features of a domain classifier.
    """

    def cells() -> list[object]:
        made = make()
        found = variant_cells(models.train_all(kinds, made, patch), real, questions)
        return found if far is None else [*found, models.domain_auc(made, real, features=far)]

    return kept_cells(path, cells)


def gap_table(synthetic: Inputs, real: Inputs, features: str) -> str:
    """Tabulate the distance of synthetic and real features by class."""
    names = models.names_of(synthetic, features)
    classes = [label for label in np.unique(synthetic.labels).tolist() if (real.labels == label).any()]
    rows: list[tuple[float, list[object]]] = []
    for column, name in enumerate(names):
        cells: list[object] = [name]
        farthest = 0.0
        for label in classes:
            one, other = (part.take(part.labels == label).matrix(names)[:, column] for part in (synthetic, real))
            distance, shift = models.apart(one, other)
            cells += [distance, shift, int(np.isfinite(other).sum())]
            farthest = max(farthest, distance if np.isfinite(distance) else 0.0)
        rows.append((farthest, cells))
    head = [f"{label}: {what}" for label in classes for what in ("KS", "shift / spread", "n real")]
    return markdown(("feature", *head), [cells for _, cells in sorted(rows, key=lambda row: -row[0])])


def nearest(real: Inputs, number: int, synthetic: Inputs, label: str, features: str) -> int:
    """Return the nearest synthetic example of a class to a real recording.

    By features, each over its spread.
    """
    names = models.names_of(synthetic, features)
    whole = synthetic.matrix(names)
    middle = np.nanmedian(whole, axis=0)
    spread = np.nan_to_num(np.nanpercentile(whole, 84, axis=0) - np.nanpercentile(whole, 16, axis=0)) + 1e-9
    apart = np.nan_to_num((whole - middle) / spread) - np.nan_to_num((real.matrix(names)[number] - middle) / spread)
    rows = np.flatnonzero(synthetic.labels == label)
    return int(rows[(np.clip(apart[rows], -3, 3) ** 2).sum(axis=1).argmin()])


def draw_beside(
    path: Path, panels: Mapping[str, FloatArray | Levels], *, extent: tuple[float, float, float, float],
    limits: tuple[float, float],
) -> None:  # fmt: skip
    """Plot images next to each other on equal axes."""
    figure = new_figure(width_in=5.0 * len(panels), height_in=4.6)
    for panel, (title, picture) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels.items(), strict=True):
        panel.imshow(picture, aspect="auto", extent=extent, cmap="jet", vmin=limits[0], vmax=limits[1])
        name_axes(panel, title=title, x="time (s)", y="velocity (m/s)")
    viz.save_figure(figure, path)


def wrong_of(fitted: models.Fitted, real: Inputs) -> npt.NDArray[np.int64]:
    """Return the recordings that a model decides wrongly."""
    return np.flatnonzero((fitted.of_person(real) > FEW) != (real.labels == models.PERSON))
