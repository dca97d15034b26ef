"""Plans and tables of the recipe's study."""

from pathlib import Path

import pandas as pd


def test_halves_are_those_of_the_models(study, tmp_path: Path) -> None:
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
