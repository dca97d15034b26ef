"""The quick form of the sim-to-real studies on the real recordings: what the protocols promise."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

pytestmark = pytest.mark.shared
COUNT = 20


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("sim-to-real")


@pytest.fixture(scope="module")
def radar_data(shared: Path) -> Path:
    return shared / "data" / "radar"


@pytest.fixture(scope="module")
def teachers() -> Iterator[list[str]]:
    """Groups of all rows that any model learnt from."""
    models = import_module("sim_to_real_models")
    seen: list[str] = []
    original = models.train

    def watched(kind: Any, inputs: Any, patch: Any, **options: Any) -> Any:
        seen.extend(inputs.groups.tolist())
        return original(kind, inputs, patch, **options)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(models, "train", watched)
        yield seen


def quick_size(study: ModuleType, **more: Any) -> Any:
    return study.Size(COUNT, COUNT, network=False, **more)


@pytest.fixture(scope="module")
def xband(radar_data: Path, out: Path, teachers: list[str]) -> tuple[ModuleType, Any, str]:
    study = import_module("sim_to_real_xband")
    fitted = study.main(radar_data, out, None, quick_size(study, ablations=("all of it", "no noise")))
    return study, fitted, (out / "sim-to-real-xband.md").read_text(encoding="utf-8")


def test_every_image_is_decided_once(xband: tuple[ModuleType, Any, str]) -> None:
    study, _, text = xband
    found = [line for line in text.splitlines() if "__" in line]
    assert len(found) == 21
    assert sum(line.split("|")[2].strip() in study.QUESTIONS["human against dog"] for line in found) == 11
    assert "/21 (" in text
    assert "/11 (" in text


def test_the_reported_half_of_people_is_measured_and_compared(radar_data: Path, out: Path) -> None:
    study = import_module("sim_to_real_cw")
    plans = {"models": study.VARIANTS["models"]}
    text = study.main(radar_data, out, None, count=4, seeds=1, real=4, plans=plans)
    real = [float(cell) for cell in text.split("| real, reported half |")[1].split("|")[:4]]
    assert all(-42 < after < before < -8 for before, after in pairwise(real))
    made = text.split("| models |")[1].split("|")[:8]
    assert all(float(cell.split()[0]) < -5 for cell in made[:4])
    assert all(0.3 < float(cell.split()[0]) <= 1.0 for cell in made[5:])
    halves = [study.real_people(radar_data, persons) for persons in (study.DEVELOPMENT, study.REPORTED)]
    assert [len(half) for half in halves] == [42, 74]
    assert not {one.person for one in halves[0]} & {one.person for one in halves[1]}


def test_nothing_real_was_learnt_from(xband: tuple[ModuleType, Any, str], teachers: list[str]) -> None:
    assert len(teachers) > COUNT
    assert {group.split("-")[0] for group in teachers} == {"model"}


def test_other_real_images_change_no_model(xband: tuple[ModuleType, Any, str], out: Path, tmp_path: Path) -> None:
    """The same study with images upside down in time and other classes: every model is what it was."""
    study, fitted, _ = xband
    rng = np.random.default_rng(0)
    folder = tmp_path / study.DATA_FILE.parent
    folder.mkdir()
    np.savez(
        tmp_path / study.DATA_FILE,
        dog__a=rng.integers(0, 256, (256, 624), dtype=np.uint8), human__b=np.tile(np.uint8(9), (256, 624)),
    )  # fmt: skip
    again = study.main(tmp_path, out, None, quick_size(study, ablations=()))
    made = study.images.dataset(study.Plan(), COUNT, out)
    for name, model in fitted.items():
        assert np.array_equal(model.of_person(made), again[name].of_person(made)), name


def test_real_and_synthetic_are_of_one_form(xband: tuple[ModuleType, Any, str], radar_data: Path, out: Path) -> None:
    study, _, _ = xband
    found = study.real_images(radar_data)
    real = study.real_inputs({key: found[key] for key in list(found)[:2]})
    made = study.images.dataset(study.Plan(), COUNT, out)
    assert list(real.columns) == list(made.columns)
    assert real.levels[0].shape == made.levels[0].shape
    assert all(group.startswith("real/") for group in real.groups)


def test_missing_data_are_named(tmp_path: Path) -> None:
    study = import_module("sim_to_real_xband")
    with pytest.raises(SystemExit, match=r"decoded_levels\.npz: not there"):
        study.main(tmp_path, tmp_path / "out", None, quick_size(study))
    with pytest.raises(SystemExit, match="has no recordings of persons"):
        import_module("sim_to_real_cw").main(tmp_path, tmp_path / "out", None, count=1, seeds=1)
