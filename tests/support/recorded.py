"""Recorded motions of the shared test data and their manifests, each read once a process."""

import csv
import warnings
from functools import cache
from pathlib import Path
from typing import Any

from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.motion import Motion
from doppelgait.motion.readers import read


@cache
def read_quietly(path: Path, **options: Any) -> Motion:
    """The motion without its warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)
        return read(path, **options)


@cache
def read_manifests(shared: Path, *folders: str, formats: tuple[str, ...] = ("",)) -> dict[str, dict[str, str]]:
    """Rows of the files of some formats, by the name of the file."""
    rows = {}
    for folder in folders:
        with (shared / "data" / "mocap" / folder / "manifest.csv").open(newline="", encoding="utf-8") as file:
            rows |= {Path(row["file"]).name: row for row in csv.DictReader(file) if row["format"].startswith(formats)}
    return rows
