"""One harness of all studies: arguments, resumable jobs, tables, intervals, matches and evidence pages.

The docstring of a study is the text of its page: the title, the command (indented), paragraphs on question and method,
a sentence "It takes ..." and a last paragraph that begins with "Not shown:". ``python studies/harness.py`` writes the
index of all pages again.
"""

from __future__ import annotations

import argparse
import ast
import datetime
import inspect
import json
import re
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.optimize import linear_sum_assignment

from doppelgait.dataset.finish import DATA_VERSION

STUDIES = Path(__file__).parent
EVIDENCE = STUDIES.parent / "docs" / "evidence"
VERSION = re.compile(r"^Data version (\d+)[.:] ", re.MULTILINE)
"""Stamp of a page, below its title."""

FloatArray = npt.NDArray[np.float64]
Job = TypeVar("Job")


# Arguments and jobs --------------------------------------------------------------------------------------------------


def make_parser(doc: str | None, **folders: str) -> argparse.ArgumentParser:
    """Make the parser of a study: folders by name and help, output, processes and the page."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, words in folders.items():
        parser.add_argument(name, type=Path, help=words)
    parser.add_argument("--rows", type=Path, help="JSON lines of the jobs; a run that was stopped goes on from them")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--page", action="store_true", help="write docs/evidence/<study>.md; else print it")
    return parser


def run_jobs(
    run: Callable[[Job], list[dict[str, Any]]], jobs: Sequence[Job], *, rows: Path | None = None, processes: int = 1
) -> list[dict[str, Any]]:
    """Run jobs in processes and return their rows; jobs whose lines are in the file are not run again."""
    done = {line["job"]: line["rows"] for line in read_lines(rows)} if rows is not None and rows.exists() else {}
    missing = [job for job in jobs if repr(job) not in done]
    with _open_pool(processes) as run_all:
        for job, found in zip(missing, run_all(run, missing), strict=True):
            done[repr(job)] = found
            if rows is not None:
                with rows.open("a", encoding="utf-8") as file:
                    file.write(json.dumps({"job": repr(job), "rows": found}, default=_plain) + "\n")
    return [row for job in jobs for row in done[repr(job)]]


def read_lines(path: Path) -> list[dict[str, Any]]:
    """Read JSON lines; a last line that a stop has cut is left out."""
    lines = path.read_text(encoding="utf-8").split("\n")
    return [json.loads(line) for line in lines[:-1] if line]


def _plain(value: Any) -> Any:
    return value.tolist()


@contextmanager
def _open_pool(processes: int) -> Iterator[Callable[..., Iterator[Any]]]:
    """Yield a map of one process or of several."""
    if processes == 1:
        yield map
        return
    with ProcessPoolExecutor(processes) as pool:
        yield pool.map


# Tables and figures ---------------------------------------------------------------------------------------------------


def markdown(table: pd.DataFrame | Sequence[str], rows: Sequence[Sequence[object]] = (), *, digits: int = 2) -> str:
    """Format a table of a frame, or of a head and rows; floats with these digits, NaN as a dash."""
    if isinstance(table, pd.DataFrame):
        head, rows = [str(name) for name in table.columns], table.to_numpy(dtype=object).tolist()
    else:
        head = list(table)

    def cell(value: object) -> str:
        if isinstance(value, float | np.floating):
            return "-" if np.isnan(value) else f"{value:.{digits}f}"
        text = str(value)
        return "-" if text in ("None", "nan", "nan%") else text

    lines = [f"| {' | '.join(head)} |", f"| --- |{' ---: |' * (len(head) - 1)}"]
    return "\n".join([*lines, *(f"| {' | '.join(map(cell, row))} |" for row in rows)])


def spread(values: Iterable[float], digits: int = 2, *, scale: float = 1.0) -> str:
    """Format the mean of some seeds, the lowest and the highest."""
    found = scale * np.array(list(values), dtype=np.float64)
    low, mean, high = (f"{number:.{digits}f}" for number in (found.min(), found.mean(), found.max()))
    return mean if low == high else f"{mean} ({low} to {high})"


def bootstrap_interval(
    values: npt.ArrayLike, groups: npt.ArrayLike | None = None, *, share: float = 0.95, draws: int = 500, seed: int = 0
) -> tuple[float, float]:
    """Return the interval of a mean, by samples of the groups (of the values without groups)."""
    found = np.asarray(values, dtype=np.float64)
    _, number = np.unique(np.arange(found.size) if groups is None else np.asarray(groups), return_inverse=True)
    sums, counts = np.bincount(number, found), np.bincount(number)
    chosen = np.random.default_rng(seed).integers(counts.size, size=(draws, counts.size))
    means = sums[chosen].sum(axis=1) / counts[chosen].sum(axis=1)
    low, high = np.quantile(means, [0.5 - share / 2, 0.5 + share / 2])
    return float(low), float(high)


def match(distance: FloatArray, limit: float) -> list[tuple[int, int]]:
    """Match results (rows) with truths (columns) nearer than a limit, by the least sum of distances."""
    if not distance.size:
        return []
    near = distance < limit
    pairs = zip(*linear_sum_assignment(np.where(near, distance, 1e6)), strict=True)
    return [(int(row), int(column)) for row, column in pairs if near[row, column]]


# Pages ----------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Text:
    """What the docstring of a study says: title, command, paragraphs, time and limits."""

    title: str
    command: str
    paragraphs: tuple[str, ...]
    time: str
    limits: str


def read_text(doc: str) -> Text:
    """Divide the docstring of a study into the parts of its page."""
    title, *blocks = re.split(r"\n\s*\n", re.sub(r":\w+:`([^`]*)`", r"`\1`", inspect.cleandoc(doc)).replace("``", "`"))
    command = next((block for block in blocks if block.startswith("    ")), "")
    limits = next((block for block in blocks if block.startswith("Not shown:")), "")
    time_taken = re.search(r"It\s+takes\s+(.*?)\.(?=\s|$)", doc, re.DOTALL)
    paragraphs = tuple(block for block in blocks if block not in (command, limits))
    words = " ".join(time_taken[1].split()) if time_taken else ""
    return Text(title.rstrip("."), command, paragraphs, words, limits.removeprefix("Not shown:").strip())


def format_page(doc: str, sections: Mapping[str, str | pd.DataFrame], *, date: str) -> str:
    """Format the evidence page of a study: stamp, method, a section a table, limits."""
    text = read_text(doc)
    parts = [f"# {text.title}", f"Data version {DATA_VERSION}. Measured on {date} by", text.command, *text.paragraphs]
    for title, content in sections.items():
        parts += [f"## {title}", content if isinstance(content, str) else markdown(content)]
    if text.limits:
        parts += ["## What it does not show", text.limits[0].upper() + text.limits[1:]]
    return "\n\n".join(parts) + "\n"


def finish(file: str, doc: str | None, sections: Mapping[str, str | pd.DataFrame], *, page: bool) -> str:
    """Write the page of a study and the index, or print the page."""
    text = format_page(doc or "", sections, date=datetime.date.today().isoformat())
    if page:
        EVIDENCE.mkdir(exist_ok=True)
        (EVIDENCE / f"{Path(file).stem}.md").write_text(text, encoding="utf-8")
        write_index()
    else:
        print(text)
    return text


def list_studies() -> dict[str, Text]:
    """Return the texts of all studies that can be run, by the stem of their file."""
    sources = {path.stem: path.read_text(encoding="utf-8") for path in sorted(STUDIES.glob("*.py"))}
    runs = {stem: source for stem, source in sources.items() if "__main__" in source and stem != Path(__file__).stem}
    return {stem: read_text(ast.get_docstring(ast.parse(source), clean=True) or "") for stem, source in runs.items()}


def format_index() -> str:
    """Format the index: a line a page with its data version, and the studies without a page."""
    pages, rows = sorted(path for path in EVIDENCE.glob("*.md") if path.stem != "index"), []
    for page in pages:
        text = page.read_text(encoding="utf-8")
        version = VERSION.search(text)
        rows.append((f"[{text.split(chr(10), 1)[0].removeprefix('# ')}]({page.name})", version[1] if version else "-"))
    others = {stem: text for stem, text in list_studies().items() if stem not in {page.stem for page in pages}}
    missing = [(f"`studies/{stem}.py`", text.title, text.time) for stem, text in others.items()]
    parts = [
        "# Evidence",
        "Each page belongs to a script in `studies/` (that on reliability to `tests/fuzz`): question, method, the "
        "command that makes it again, and tables. "
        f"The present data version is {DATA_VERSION}.",
        markdown(("page", "data version"), rows),
        "Studies without a page (they make tables of the package, or have not been run):",
        markdown(("script", "question", "time"), missing),
        "```{toctree}\n:hidden:\n:maxdepth: 1\n:glob:\n\n*\n```",
    ]
    return "\n\n".join(parts) + "\n"


def write_index() -> None:
    """Write the index of all pages."""
    (EVIDENCE / "index.md").write_text(format_index(), encoding="utf-8")


def quiet() -> float:
    """Silence the warnings of the package, which studies cause on purpose; return the time."""
    warnings.simplefilter("ignore")
    return time.perf_counter()


if __name__ == "__main__":
    sys.exit(write_index())
