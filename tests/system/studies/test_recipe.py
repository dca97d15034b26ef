"""Plans and tables of the recipe's study."""

from pathlib import Path

import numpy as np
import pandas as pd


def test_kinds_are_counted_by_gait_and_speed(study):
    rows = pd.DataFrame({
        "label": ["human", "human", "dog", "dog"], "half": ["held", "tuning", "held", "held"],
        "recording": list("abcd"),
        "truth_gait": ["run", "walk", "trot", "gallop"], "truth_ground_speed_mps": [3.0, 1.2, 2.0, 3.1],
        "right:m": [True, False, True, False], "truth_gait_frequency_hz": 3.0, "observation_s": 4.0,
        "truth_aspect_deg": 0.0, "quality_snr_mu_db": 20.0,
    })  # fmt: skip
    lines = study.kind_table([rows, rows], "m").split("\n")[2:]
    assert lines[0] == "| people who walk | 0 | 0 | - | 1 | 1 | 0.0 |"
    assert lines[1] == "| people who run | 1 | 1 | 100.0 | 1 | 1 | 100.0 |"
    assert [line.split(" | ")[1:4] for line in lines[2:]] == [["0", "0", "-"], ["1", "1", "100.0"], ["1", "1", "0.0"]]


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
    }).rename_axis("id")  # fmt: skip
    lines = study.adaptation_table([rows, rows], "m").split("\n")[2:]
    numbers = [[float(cell.split()[0]) for cell in line.strip("| ").split("|")] for line in lines]
    assert [line[0] for line in numbers] == [0, 1, 2, 5, 10, 20]
    assert numbers[0][1] == numbers[0][2] < 70
    assert numbers[-1][2] > 95
    assert numbers[-1][3] < numbers[0][3] / 3


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
