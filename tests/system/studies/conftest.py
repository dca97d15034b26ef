"""The scripts in studies/ are no package: their folder is on the path while a file of this folder is tested."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import pytest

from checkout import ROOT


@pytest.fixture(scope="module", autouse=True)
def studies_on_path() -> Iterator[None]:
    """Make the studies importable by their names, as they import each other."""
    folder = str(ROOT / "studies")
    sys.path.insert(0, folder)
    yield
    sys.path.remove(folder)
