"""Plans and tables of the recipe's study."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from doppelgait.dataset import load_plan
from doppelgait.motion.retime import Variation


@pytest.mark.parametrize(
    ("variant", "motion", "sensor"),
    [("plain", False, False), ("varied motion", True, False), ("varied sensors", False, True),
     ("both varied", True, True)],
)  # fmt: skip
def test_a_variant_adds_what_it_says_to_both_classes_alike(study, variant, motion, sensor):
    plan, _ = study.plan_of(variant, 3, 20)
    evidence, _ = load_plan(study.PLAN)
    assert plan.dataset.seed == 2021
    assert ("vary" in plan.target) == motion
    assert (plan.radar != evidence.radar) == sensor
    assert (plan.impairments is not None) == (plan.environment is not None) == sensor
    assert plan.classes[1] == evidence.classes[1]  # dogs are the same, people run more often
    assert len(plan.classes[0].motion["choice"]) == len(evidence.classes[0].motion["choice"]) + motion
    if motion:
        assert set(plan.target["vary"]) == set(Variation.model_fields)


def test_half_of_the_rows_wrong_is_a_wrong_recording(study):
    rows = pd.DataFrame({
        "label": "human", "half": "held", "truth_gait": ["run"] * 4 + ["walk"] * 2, "recording": list("aabbcd"),
        "right:m": [True, False, True, True, False, True], "truth_gait_frequency_hz": 3.0, "observation_s": 4.0,
        "truth_aspect_deg": 0.0, "quality_snr_mu_db": 20.0, "truth_ground_speed_mps": 3.0,
    })  # fmt: skip
    better = rows.assign(**{"right:m": True})
    table = study.recordings_wrong([rows, better], "m").split("\n")[2:]
    assert table == ["| human run | 2 | 1, 0 | a |", "| human walk | 2 | 1, 0 | c |"]


def test_a_shifted_answer_is_adapted_in_the_table(study):
    rng = np.random.default_rng(0)
    human = np.arange(240) % 2 == 0
    rows = pd.DataFrame({
        "label": np.where(human, "human", "dog"), "subject": np.arange(240) // 2 % 20 * 2 + ~human,
        "recording": [f"r{k // 2}" for k in range(240)], "truth_gait_frequency_hz": 3.0, "observation_s": 4.0,
        "truth_aspect_deg": 0.0, "quality_snr_mu_db": 20.0, "truth_ground_speed_mps": 3.0,
        "p:m": 1.0 / (1.0 + np.exp(-(np.where(human, 2.0, -2.0) + 3.0 + rng.normal(size=240)))),
    })  # fmt: skip
    lines = study.adaptation_table([rows, rows], "m").split("\n")[2:]
    numbers = [[float(cell.split()[0]) for cell in line.strip("| ").split("|")] for line in lines]
    assert [line[0] for line in numbers] == [0, 1, 2, 5, 10, 20]
    assert numbers[0][1] == numbers[0][2] == numbers[0][3] < 70
    assert numbers[-1][2] > 95
    assert numbers[-1][3] > 95
    assert numbers[-1][4] < numbers[0][4] / 3


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
