"""What the study of the gait frequency and the features counts, on rows whose answer is known."""

from dataclasses import replace
from types import ModuleType

import numpy as np
import pandas as pd
import pytest

from doppelgait.processing import Analysis, Gate, signature


def make_rows(study: ModuleType, found_hz: list[float | None], **columns: object) -> pd.DataFrame:
    """Rows of a target at 2 Hz and 1 m/s, each with the same stated standard deviations."""
    facts = {"source": "model", "label": "human", "half": "B", "gait": "walk", "aspect_deg": 160.0, "seconds": 3.0}
    facts |= {"truth_hz": 2.0, "drift": 0.0, "true_mps": 1.0, "method": "standard", "snr_mu_db": 10.0}
    facts |= {"confidence": 0.9, "low_confidence": False, "step_length_m": 0.5, "torso_velocity_mps": 1.0}
    facts |= {"harmonic_ratio_2": 2.0, "doppler_bandwidth_hz": 110.0, "limb_torso_ratio": 0.5}
    facts |= {f"sd_{name}": 0.1 for name in study.FEATURES} | columns
    rows = pd.DataFrame([facts] * len(found_hz)).assign(found_hz=found_hz, gait_frequency_hz=found_hz)
    clean = rows.assign(snr_mu_db=np.inf, doppler_bandwidth_hz=100.0, limb_torso_ratio=0.45)
    both = pd.concat([rows, clean], ignore_index=True)
    return both.assign(number=np.arange(len(both)) % len(rows))


def test_octaves_nulls_and_errors_are_told_apart(study: ModuleType) -> None:
    found = study.rated(make_rows(study, [2.0, 2.05, 4.0, 1.0, None]))
    noisy = found[found["snr_mu_db"] == 10.0]
    assert noisy["octave"].tolist() == [False, False, True, True, False]
    assert noisy["null"].tolist() == [False] * 4 + [True]
    assert (noisy["error"] < 0.05).tolist() == [True, True, False, False, False]
    assert noisy["periods"].tolist() == [6.0] * 5
    assert noisy["view"].tolist() == ["0-45"] * 5
    assert noisy["clean_doppler_bandwidth_hz"].tolist() == [100.0] * 5


def test_requirements_count_failures(study: ModuleType) -> None:
    table = study.acceptance(study.rated(make_rows(study, [2.0] * 9 + [None]))).set_index("demand")
    row = table.loc["fails, to 30 deg, >= 10 dB, >= 2 s"]
    assert (row["n"], row["percent"], row["result"]) == (20, 10.0, "not met")
    assert table.loc["fails, to 30 deg, 5 dB, >= 2 s", "result"] == "-"


def test_confidence_is_compared_with_the_share_that_is_right(study: ModuleType) -> None:
    table = study.reliability(study.rated(make_rows(study, [2.0] * 3 + [4.0])))
    assert table[["n", "confidence", "right"]].iloc[0].tolist() == [8, 90.0, 75.0]
    assert table["apart"].iloc[1] == 15.0


def test_coverage_leaves_wrong_octaves_out(study: ModuleType) -> None:
    rows = make_rows(study, [2.15, 2.05, 2.0, 4.0], torso_velocity_mps=1.15, sd_doppler_bandwidth_hz=8.0)
    table = study.coverage(study.rated(rows)).set_index("feature")["model human"]
    assert table["gait_frequency_hz"] == "67 / 100 (6)"
    assert table["torso_velocity_mps"] == "0 / 100 (6)"
    assert table["doppler_bandwidth_hz"] == "0 / 100 (3)", "only with noise"


def test_errors_of_features_have_the_direction_of_the_target(study: ModuleType) -> None:
    rows = make_rows(study, [2.0, 2.0], torso_velocity_mps=-1.1, true_mps=-1.0, step_length_m=-0.6)
    table = study.feature_errors(study.rated(rows)).set_index("SNR_mu dB")
    assert table.loc["10", "v_m bias m/s"] == "+0.100"
    assert table.loc["10", "L_m rms m, f_mu right"] == "0.100"
    assert table.loc["10", "B_mu against no noise %"] == pytest.approx(10.0)


def test_signatures_have_the_stated_snr(study: ModuleType) -> None:
    example = replace(study.model_examples(1)[0], seconds=2.0)
    recording = study.observe(example)
    analysis = Analysis(extended=False)
    (_, clean), (level_db, noisy) = study.signatures(example, recording, analysis, (np.inf, 10.0))
    gate = Gate.from_truth(
        recording.truth[0], recording.slow_time_s, analysis, wavelength_m=recording.radar.wavelength_m
    )
    own = signature(recording.baseband, gate, analysis, wavelength_m=recording.radar.wavelength_m)
    np.testing.assert_array_equal(clean.values, own.values)
    floor_v2 = float(np.median(noisy.values - clean.values)) / np.log(2)
    assert level_db == 10.0
    assert 10 * np.log10(np.median(clean.values.max(axis=1)) / floor_v2) == pytest.approx(10.0, abs=2.0)
