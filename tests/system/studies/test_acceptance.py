"""What the studies of acceptance and of feature errors count and compare, on rows whose answer is known."""

from __future__ import annotations

import math
from dataclasses import replace
from importlib import import_module
from types import ModuleType

import numpy as np
import pandas as pd
import pytest

from doppelgait.processing import Analysis, Gate, signature


@pytest.fixture(scope="module")
def tables() -> ModuleType:
    return import_module("acceptance_tables")


@pytest.fixture(scope="module")
def study() -> ModuleType:
    return import_module("acceptance")


@pytest.fixture(scope="module")
def errors() -> ModuleType:
    return import_module("feature_errors")


def rows(n: int, n_wrong: int, **given: object) -> pd.DataFrame:
    """Rows of our method in front of the radar, of which some have the stride instead of the step."""
    plain = {
        "part": "models", "source": "model", "method": "standard", "gait": "human walk", "psi_deg": 0.0, "seconds": 3.0,
        "snr_mu_db": 10.0, "periods": 6.0, "occluded": False, "truth_hz": 2.0, "true_mps": 1.2, "v_mps": 1.2,
        "rho": 1.0, "flagged": False,
        "speed_mps": 1.2, "ground_mps": 1.2,
    }  # fmt: skip
    count = np.arange(n)
    widths = {"b_hz": 300.0 + count, "span_hz": 370.0 + count}
    frame = pd.DataFrame([plain | given] * n).assign(number=count, **widths)
    return frame.assign(found_hz=np.where(count < n_wrong, 1.0, 2.0))


def demand(table: pd.DataFrame, condition: str, item: str = "f_mu off by > 10 %") -> pd.Series:
    """The only row of an item and condition."""
    (row,) = table[(table["item"] == item) & (table["condition"] == condition)].to_dict("records")
    return row


def test_a_frequency_fails_beyond_ten_per_cent_and_where_there_is_none(tables: ModuleType) -> None:
    found = pd.DataFrame({"found_hz": [2.19, 2.21, 1.81, 1.79, None, 4.0], "truth_hz": 2.0})
    assert tables.failed(found).tolist() == [False, True, False, True, True, True]


def test_the_report_is_compared_cell_by_cell(tables: ModuleType) -> None:
    at = {"snr_mu_db": 20.0, "part": "table"}
    report = pd.concat([
        rows(20, 7, method="liland2018", seconds=1.0, **at), rows(20, 9, method="liland2018", seconds=1.5, **at),
        rows(20, 0, method="liland2018", seconds=5.0, **at),
    ])  # fmt: skip
    ours = pd.concat([rows(20, 1, seconds=1.0, **at), rows(20, 0, seconds=1.5, **at), rows(20, 0, seconds=5.0, **at)])
    table = tables.report_table(pd.concat([report, ours])).set_index("method")
    assert table.loc["liland2018", "1.5 s"] == "45 (21), n 20"
    assert table.loc["standard", "1 s"] == "5 (7), n 20"
    worse, near = tables.report_demands(pd.concat([report, ours])).to_dict("records")
    assert worse["reached"] == "2 cells worse, 1 the same, of 3"
    assert worse["met?"] == "not met"
    # 35 against 35 and 45 against 21; 5 s is not asked for
    assert (near["reached"], near["met?"]) == ("24.0", "not met")
    without = pd.concat([report, ours])[lambda r: r["seconds"] == 1.0]
    assert [row["met?"] for row in tables.report_demands(without).to_dict("records")] == ["met", "met"]


def test_limits_are_doubled_below_three_periods_of_recorded_targets_only(tables: ModuleType) -> None:
    few = {"periods": 2.9, "seconds": 2.0}
    condition = "psi <= 30, SNR_mu >= 10 dB, T_o >= 2 s"
    models = demand(tables.acceptance(rows(100, 2, **few)), condition)
    assert (models["demand"], models["reached"], models["n"], models["met?"]) == ("<= 1 %", "2 %", 100, "not met")
    recorded = tables.acceptance(rows(100, 2, part="mocap", source="recorded", **few))
    doubled = demand(recorded, condition + ", below 3 periods")
    assert (doubled["demand"], doubled["as recorded"], doubled["met?"]) == ("<= 2 %", 100, "met")


def test_every_level_and_aspect_goes_to_its_own_demand(tables: ModuleType) -> None:
    parts = [
        rows(50, 1, snr_mu_db=5.0), rows(50, 0, snr_mu_db=20.0), rows(10, 1, psi_deg=45.0, snr_mu_db=20.0),
        rows(10, 0, psi_deg=45.0, snr_mu_db=20.0, occluded=True), rows(10, 3, psi_deg=60.0, snr_mu_db=20.0),
    ]  # fmt: skip
    table = tables.acceptance(pd.concat(parts))
    reached = {c: demand(table, c)["reached"] for c in table[table["item"] == "f_mu off by > 10 %"]["condition"]}
    assert reached == {
        "psi <= 30, SNR_mu >= 10 dB, T_o >= 2 s": "0 %", "psi <= 30, SNR_mu >= 10 dB, >= 3 periods": "0 %",
        "psi 45, 20 dB, T_o >= 3 s": "10 %", "psi 45, 20 dB, T_o >= 3 s, limbs hide each other": "0 %",
        "psi <= 30, SNR_mu 5 dB, T_o >= 2 s": "2 %", "psi 60-75, people, T_o >= 3 s, 20 dB": "30 %",
    }  # fmt: skip


def test_half_and_double_are_told_from_other_errors(tables: ModuleType) -> None:
    # found 2 Hz, truth 1 Hz: wrong as f_mu, right but for the octave
    side = rows(4, 0, psi_deg=60.0, snr_mu_db=20.0, truth_hz=1.0)
    table = tables.acceptance(side)
    condition = "psi 60-75, people, T_o >= 3 s, 20 dB"
    assert demand(table, condition)["reached"] == "100 %"
    assert demand(table, condition, "neither it nor its double or half")["reached"] == "0 %"


def test_velocity_flags_ratio_and_bandwidth_by_hand(tables: ModuleType) -> None:
    off = pd.concat([rows(1, 0, v_mps=1.23), rows(1, 0, v_mps=1.16)])
    assert demand(tables.acceptance(off), "human walk, 3 s, psi 0, >= 5 dB", "v_m rms")["reached"] == "0.0354 m/s"
    side = pd.concat([rows(19, 0, psi_deg=75.0, flagged=True, snr_mu_db=20.0), rows(1, 0, psi_deg=60.0)])
    flag = demand(tables.acceptance(side), "psi >= 60, T_o >= 3 s, truth gate, 20 dB", "not flagged low_confidence")
    assert (flag["reached"], flag["n"]) == ("5 %", 20)
    ratio = pd.concat([rows(4, 0, snr_mu_db=60.0), rows(4, 0, snr_mu_db=5.0, rho=0.85)])
    changed = tables.acceptance(ratio)
    (row,) = changed[changed["item"] == "rho, change of the mean"].to_dict("records")
    assert (row["reached"], row["met?"], row["n"]) == ("15 %", "not met", 4)
    wide = rows(5, 0, snr_mu_db=20.0).assign(b_hz=[1, 2, 3, 4, 5], span_hz=[2, 1, 4, 3, 5])
    found = demand(
        tables.acceptance(wide), "human walk, 3 s, psi 0, 20 dB, f_p 1000 Hz", "B_mu correlation with true span"
    )
    assert found["reached"] == "0.800"  # 1 - 6 sum(d^2) / (n (n^2 - 1)) of ranks


def test_ground_speed_without_side_views_and_with_them(tables: ModuleType) -> None:
    at = {"part": "tracked", "seconds": 5.0, "snr_mu_db": 15.0, "ground_mps": 1.0}
    crossing = rows(1, 0, psi_deg=90.0, speed_mps=1.3, **at)
    ahead = pd.concat([rows(2, 0, speed_mps=1.01, **at), rows(1, 0, speed_mps=None, **at)])
    table = tables.acceptance(pd.concat([crossing, ahead]))
    found = {row["condition"]: row for row in table[table["item"] == "v_g rms"].to_dict("records")}
    every = found["people, 5 s, psi 0-90, 15 dB, tracked; none for 1 of 4"]
    assert (every["reached"], every["n"], every["met?"]) == ("17.3 %", 3, "not met")  # sqrt((30^2 + 2) / 3)
    front = found["people, 5 s, psi 0-75 only, 15 dB, tracked; none for 1 of 3"]
    assert (front["reached"], front["n"], front["met?"]) == ("1 %", 2, "met")


def trial_of(study: ModuleType, part: str) -> object:
    return study.model_trials(part, 5)[0]


def test_trials_are_the_same_again_and_hold_every_gait(study: ModuleType) -> None:
    trials = study.model_trials("table", 10)
    assert trials == study.model_trials("table", 10)
    assert len(trials) == 10 * 5
    assert len({trial.example.number for trial in trials}) == 50
    gaits = [f"{trial.example.label} {trial.example.body[1]['gait']}" for trial in trials[:10]]
    assert gaits == list(study.GAITS) * 2


def test_noise_of_a_tracked_trial_has_the_wanted_level(study: ModuleType) -> None:
    trial = trial_of(study, "tracked")
    recording = study.observe(trial)
    noise_v2 = study.noise_for(trial, recording)
    shape = recording.baseband.shape
    rng = np.random.default_rng(1)
    noise = math.sqrt(noise_v2 / 2) * (rng.normal(size=shape) + 1j * rng.normal(size=shape))
    wavelength_m = recording.radar.wavelength_m
    truth = recording.truth[0]
    times_s = recording.baseband.coords["slow_time"].values
    gate = Gate.around(times_s, truth.centre_range_m, span_m=1.6, source="given")
    levels = [
        signature(recording.baseband.copy(data=data.astype(np.complex64)), gate, Analysis(), wavelength_m=wavelength_m)
        for data in (recording.baseband.values, noise)
    ]
    ratio = float(np.median(levels[0].values.max(axis=1)) / levels[1].values.mean())
    assert 10 * math.log10(ratio) == pytest.approx(trial.levels_db[0], abs=0.2)


def test_a_class_tag_changes_no_bit_of_ours_and_some_of_the_report(study: ModuleType) -> None:
    trial = trial_of(study, "labels")
    recording = study.observe(trial)
    (ours,) = study.relabelled(trial, recording)
    assert ours["same_bits"]
    (report,) = study.relabelled(trial, recording, Analysis(method="liland2018", hop=20))
    assert not report["same_bits"]  # its gate is 1.0 m wide for people and 1.5 m for dogs


def test_velocity_errors_are_positive_where_it_is_too_fast_either_way(errors: ModuleType) -> None:
    given = pd.DataFrame({
        "method": "standard", "snr_mu_db": 20.0, "who": "model", "gait": "human walk",
        "true_mps": [1.0, -1.0, 1.0], "v_mps": [1.1, -1.3, None],
    })  # fmt: skip
    (row,) = errors.velocity_errors(given).to_dict("records")
    assert (row["n"], row["missing"]) == (2, 1)
    assert row["bias m/s"] == pytest.approx(0.2)
    assert row["rms m/s"] == pytest.approx(math.sqrt((0.01 + 0.09) / 2), abs=5e-4)
    assert row["median m/s"] == pytest.approx(0.2)


def test_step_errors_with_and_without_wrong_frequencies(errors: ModuleType) -> None:
    given = pd.DataFrame({
        "method": "standard", "snr_mu_db": 20.0, "who": "model", "gait": "human walk", "true_step_m": 0.6,
        "truth_hz": 2.0, "found_hz": [2.0, 1.0], "step_m": [0.63, 1.2],
    })  # fmt: skip
    (row,) = errors.step_errors(given).to_dict("records")
    assert (row["n"], row["n, f_mu right"]) == (2, 1)
    assert row["median m"] == pytest.approx(0.315)
    assert row["median m, f_mu right"] == pytest.approx(0.03)


def test_ratio_repeats_by_hand(errors: ModuleType) -> None:
    cells = {("standard", math.inf): (1.0, 2.0), ("K 512", math.inf): (1.01, 2.08), ("standard", 5.0): (0.8, 1.8)}
    given = pd.DataFrame([
        {"method": m, "snr_mu_db": s, "who": "model", "gait": "dog trot", "number": n, "rho": value}
        for (m, s), values in cells.items()
        for n, value in enumerate(values)
    ])  # fmt: skip
    longer, noisier = errors.ratio_repeats(given).to_dict("records")
    assert (longer["of the mean %"], longer["met?"]) == (pytest.approx(3.0), "not met")
    assert longer["single within %"] == 50
    assert noisier["of the mean %"] == pytest.approx(100 * (2.6 / 3.0 - 1), abs=5e-3)
    assert noisier["met?"] == "not met"


def test_every_row_counts_for_its_gait_and_its_class(errors: ModuleType) -> None:
    found = errors.with_classes(pd.DataFrame({"gait": ["dog trot", "dog walk", "human walk"], "rho": [1.0, 2.0, 3.0]}))
    assert found.groupby("gait")["rho"].sum().to_dict() == {
        "dog all": 3.0, "dog trot": 1.0, "dog walk": 2.0, "human all": 3.0, "human walk": 3.0,
    }  # fmt: skip


def test_true_bandwidths_of_an_example(errors: ModuleType) -> None:
    example = replace(import_module("gait_frequency").model_examples(1)[0], seconds=2.0)
    recording = errors.observe(example)
    found = errors.facts(example, recording)
    speeds = recording.truth[0].scatterers["radial_velocity"].values
    fastest, slowest = np.sort(speeds.max(axis=1)), np.sort(speeds.min(axis=1))
    to_hz = 2 * 7.29e9 / 299_792_458
    assert found["span_hz"] == pytest.approx(to_hz * (fastest[-1] - slowest[0]), rel=1e-6)
    n = fastest.size
    by_order = to_hz * (fastest[round(0.95 * (n - 1))] - slowest[round(0.05 * (n - 1))])
    assert found["envelope_hz"] == pytest.approx(by_order, rel=1e-3)
    assert found["true_step_m"] == pytest.approx(abs(found["true_mps"]) / found["truth_hz"])
