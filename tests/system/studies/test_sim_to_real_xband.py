"""The quick form of the X-band study on the real images: what its protocol promises."""

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

pytestmark = pytest.mark.shared
COUNT = 24
QUICK = {"count": COUNT, "seeds": (1, 2), "n_unknown": 8, "network": False}


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("sim-to-real-xband")


@pytest.fixture(scope="module")
def run(shared: Path, out: Path, study: ModuleType) -> tuple[dict[str, list[Any]], list[str], str]:
    """Answers of the study, the groups of all rows that models were trained on, and the report."""
    teachers: list[str] = []
    original = study.models.train_all

    def watched(inputs: Any, patch: Any, **options: Any) -> Any:
        teachers.extend(inputs.groups.tolist())
        return original(inputs, patch, **options)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(study.models, "train_all", watched)
        scored, sections = study.run_study(shared / "data" / "radar", out, **QUICK)
    return scored, teachers, "\n".join(sections.values())


def test_every_image_is_scored_by_every_seed(study: ModuleType, run: tuple[Any, Any, str]) -> None:
    scored, _, text = run
    rows = [
        line
        for line in text.splitlines()
        if line.split(" ")[1:2] and line.split(" ")[1] in ("human", "dog", "cow", "horse")
    ]
    assert len(rows) == 21
    for protocol, classes in study.PROTOCOLS.items():
        assert [one.parts["real"].shape for one in scored[protocol]] == [(21, len(classes) + 1)] * 2
    assert not np.array_equal(*(one.parts["real"] for one in scored["people and dogs"]))
    assert text.count("| ensemble |") == 2


def test_no_model_is_trained_on_anything_real(run: tuple[Any, list[str], Any]) -> None:
    _, teachers, _ = run
    assert len(teachers) == 2 * (COUNT * 2 // 3 + COUNT)
    assert {"-".join(group.split("-")[:2]) for group in teachers} == {"model-1", "model-2"}


def test_other_real_images_change_no_model(
    study: ModuleType, run: tuple[Any, Any, Any], out: Path, tmp_path: Path
) -> None:
    """With noise for real images, what the study answers to synthetic ones and its thresholds are the same."""
    scored, _, _ = run
    rng = np.random.default_rng(0)
    folder = tmp_path / study.DATA_FILE.parent
    folder.mkdir()
    levels = {
        f"{label}__{n}": rng.integers(0, 256, (256, 624), dtype=np.uint8) for label in ("human", "dog") for n in "ab"
    }
    np.savez(tmp_path / study.DATA_FILE, **levels, cow__a=np.tile(np.uint8(9), (256, 624)))
    again, _ = study.run_study(tmp_path, out, **QUICK)
    for protocol, seeds in scored.items():
        for one, other in zip(seeds, again[protocol], strict=True):
            assert one.held_accuracy == other.held_accuracy
            assert len(other.parts["real"]) == 5
            for name in set(one.parts) - {"real"}:
                assert np.array_equal(one.parts[name], other.parts[name]), name
