"""Command line and process pool of the studies that collect rows.

These are acceptance, feature errors and gait frequency.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd

Job = TypeVar("Job")


def make_parser(doc: str | None, option: str, default: int, words: str) -> argparse.ArgumentParser:
    """Make a parser of motion folder, number of examples, processes and output.

    Parameters
    ----------
    doc : str or None
        Docstring of the study; its first line describes the command.
    option, default, words
        Name, default and help of the option that sets the number of examples.
    """
    parser = argparse.ArgumentParser(description=(doc or "").split("\n", 1)[0])
    parser.add_argument("--mocap", type=Path, help="folder with human/ and dog/ recordings")
    parser.add_argument(option, dest="count", type=int, default=default, help=words)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, help="all rows, as CSV")
    return parser


def collect_rows(
    run: Callable[[Job], list[dict[str, Any]]], jobs: Sequence[Job], *, processes: int, chunksize: int = 4
) -> pd.DataFrame:
    """Run all jobs in processes and collect their rows."""
    if processes == 1:
        return pd.DataFrame([row for job in jobs for row in run(job)])
    with ProcessPoolExecutor(processes) as pool:
        return pd.DataFrame([row for rows in pool.map(run, jobs, chunksize=chunksize) for row in rows])
