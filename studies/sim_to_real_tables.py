"""Command line and tables of both sim-to-real studies."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import sim_to_real_models as models
from sim_to_real_inputs import Inputs


def make_parser(doc: str | None, data: str, count: int, things: str) -> argparse.ArgumentParser:
    """Make the command-line parser of a study of synthetic ``things``.

    ``data`` is the file or folder of the real ones.
    """
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help=f"folder with {data}")
    parser.add_argument("out", type=Path, help="folder for tables, figures and what is kept for the next run")
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
