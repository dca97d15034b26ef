"""What the study of classification counts, on rows whose answer is known; its variants of the plan."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pandas as pd
import pytest

from doppelgait.classify.training import BUILT_IN
from doppelgait.core.config import validate
from doppelgait.dataset import load_plan
from doppelgait.dataset.config import PlanConfig


@pytest.fixture(scope="module")
def study() -> ModuleType:
    return import_module("classification")


def motions(study: ModuleType, variant: str) -> list[dict[str, Any]]:
    """Entries of both classes in a variant of the plan, which must be a plan."""
    table = load_plan(study.PLAN)[0].model_dump(mode="python")
    study.vary(table, variant)
    validate(PlanConfig, table, where=variant)
    return [motion for section in table["classes"] for motion in section["motion"]["choice"]]


def test_variants_lack_one_thing(study: ModuleType) -> None:
    whole = motions(study, "as planned")
    assert {motion["kind"] for motion in whole} == {"human", "boulic", "quadruped"}
    boulic = motions(study, "walkers of Boulic alone")
    assert [m.get("gait") for m in boulic if m["kind"] == "human"] == ["run"]
    assert {m["kind"] for m in motions(study, "no walker of Boulic")} == {"human", "quadruped"}
    alike = motions(study, "all steps alike")
    assert [(m["kind"], "trunk_ripple" in m) for m in alike] == [(m["kind"], "trunk_ripple" in m) for m in whole]
    assert not any(name.endswith(study.VARIATION) for motion in alike for name in motion)
    assert any(name.endswith(study.VARIATION) for motion in whole for name in motion)
    assert {m["trunk_ripple"] for m in motions(study, "trunk without ripple") if "trunk_ripple" in m} == {0.0}
    mean = motions(study, "mean bodies")
    assert not any("swing_peak" in motion or "trunk_ripple" in motion for motion in mean)
    assert "step_time_sd" in mean[0]
    assert not any("gallop" in motion.get("gait", "") for motion in motions(study, "no gallop"))


def test_a_recording_is_right_if_most_of_its_rows_are(study: ModuleType) -> None:
    rows = pd.DataFrame({
        "truth_gait": ["run"] * 7, "recording": ["a/x.bvh"] * 3 + ["a/y.bvh"] * 2 + ["a/z.bvh"] * 2,
        "right:one": [True, True, False, True, False, True, True],
    })  # fmt: skip
    table = study.by_recording(rows, ["truth_gait"], ["one"])
    # exact interval of 2 of 3 by the quantiles of the beta distribution
    assert table[-1] == "| run | 2 of 3 (9.4-99.2) | y |"


def test_halves_are_those_of_the_models(study: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "clinic").mkdir()
    for subject in ("A1", "A2"):
        (tmp_path / "clinic" / f"Subject{subject}_Cycle1.bvh").touch()
    rows = pd.DataFrame({
        "label": ["dog", "dog", "human", "human", "human", "human"],
        "recording": [
            "dog/mann-bvh/a.bvh", "dog/tencent-bvh/a.bvh", "human/cmu-expmap/walking_1.txt", "human/c3d/cmu_16_07.c3d",
            "clinic/SubjectA1_Cycle1.bvh", "clinic/SubjectA2_Cycle1.bvh",
        ],
    })  # fmt: skip
    expected = ["tuning", "held", "tuning", "held", "tuning", "held"]
    assert study.with_half(rows, tmp_path)["half"].tolist() == expected


def test_models_of_the_study_are_known(study: ModuleType) -> None:
    assert {*study.FEATURE_MODELS} == {*BUILT_IN} - {"signature-network", "ensemble"}
    assert {*study.ABLATION_MODELS} < {*study.MODELS_ON_AXES} < {*BUILT_IN, "speed"}
