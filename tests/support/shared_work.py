"""Work that is done once per run of the tests, whatever the number of pytest's own workers."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

import processes


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """Folder that ``make(folder)`` has filled, by whichever worker came first; nobody changes it afterwards.

    The folder of the run that all workers share is the parent of a worker's own.
    """
    base = factory.getbasetemp()
    root = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "once"
    root.mkdir(exist_ok=True)
    folder, mark = root / name, root / f"{name}.mark"
    try:
        (root / f"{name}.claim").mkdir()
    except FileExistsError:
        processes.wait_until(mark.exists)
        assert mark.read_text() == "made", f"another worker could not make {name}; see its failure"
        return folder
    outcome = "failed"
    try:
        make(folder)
        outcome = "made"
    finally:
        part = mark.with_suffix(".part")
        part.write_text(outcome)
        part.replace(mark)
    return folder
