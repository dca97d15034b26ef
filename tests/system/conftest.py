"""What the tests of this folder share: two small built datasets and two files, which nobody changes."""

import shutil
from pathlib import Path

import pytest

from doppelgait.dataset import open_dataset
from doppelgait.dataset.open import Dataset
from doppelgait.pipeline import analyze, parse_run, run_simulation, write_results
from doppelgait.radar import write_recording
from tiny_dataset import built, mixed_plan, tiny_plan


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the built tiny plan."""
    return built(tmp_path_factory, tiny_plan())


@pytest.fixture(scope="session")
def dataset(folder: Path) -> Dataset:
    return open_dataset(folder)


@pytest.fixture(scope="session")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Two targets in a scene, two pulse rates."""
    return open_dataset(built(tmp_path_factory, mixed_plan()))


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a recording, ``walk.h5``, and its results, ``result.h5``."""
    from viewer_client import walking_scene  # needs the viewer

    folder = tmp_path_factory.mktemp("files")
    recording = run_simulation(parse_run(walking_scene(1.2), where="scene"))
    write_recording(recording, folder / "walk.h5")
    write_results(folder / "result.h5", recording, analyze(recording, gate="truth"))
    return folder


@pytest.fixture
def copy(folder: Path, tmp_path: Path) -> Path:
    """Folder of the tiny dataset that may be changed."""
    return shutil.copytree(folder, tmp_path / "copy")
