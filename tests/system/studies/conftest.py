"""The scripts in studies/ are no package: their folder is on the path while a file of this folder is tested."""

import sys
from collections.abc import Iterator
from importlib import import_module
from types import ModuleType

import pytest

from checkout import ROOT


@pytest.fixture(scope="module", autouse=True)
def studies_on_path() -> Iterator[None]:
    """Make the studies importable by their names, as they import each other."""
    folder = str(ROOT / "studies")
    sys.path.insert(0, folder)
    yield
    sys.path.remove(folder)


@pytest.fixture(scope="module")
def study(request: pytest.FixtureRequest) -> ModuleType:
    """Script that a file tests: ``everyday.py`` of ``test_everyday.py``."""
    return import_module(request.path.stem.removeprefix("test_").removesuffix("_shared"))


@pytest.fixture(scope="module")
def images() -> ModuleType:
    return import_module("sim_to_real_xband_images")
