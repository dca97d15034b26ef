"""Real recordings (the shared test data) with their labels, imported as a dataset."""

import csv
import re

import numpy as np
import pytest

from doppelgait.dataset import open_dataset
from doppelgait.dataset.card import list_blocked_recordings
from doppelgait.dataset.importing import ImportConfig, import_dataset

pytestmark = pytest.mark.shared

MOTIONS = {"0": "walk", "1": "run", "2": "stride", "3": "creep"}
TORSO_MPS = {"creep": 0.69, "walk": 0.98, "stride": 1.24, "run": 1.69}
"""Measured before on the same files by other means (strongest line of every burst, Hamming window)."""
COUNTS = {"creep": 24, "walk": 36, "stride": 32, "run": 24, "human": 34, "dog": 2}


@pytest.fixture(scope="module")
def radar_folder(shared):
    return shared / "data" / "radar"


@pytest.fixture(scope="module")
def doppler_module(radar_folder, tmp_path_factory):
    """The 152 recordings of a 24 GHz Doppler module, by class or, in three sessions, by gait; shares of subjects."""
    place = tmp_path_factory.mktemp("cw")
    with (radar_folder / "manifest.csv").open(newline="") as handle:
        files = [row for row in csv.DictReader(handle) if row["file"].endswith("_RE.txt")]
    with (place / "labels.csv").open("w", newline="") as handle:
        writer = csv.writer(handle, delimiter=";")
        writer.writerow(["file", "label", "subject", "session", "activity", "split"])
        for row in files:
            named = re.search(r"/22\d{4}_\d_(\d)_\d+_RE", row["file"])
            label = MOTIONS[named[1]] if named else row["label"]
            split = "train" if row["subject"] in ("person0", "person2") else "test"
            session = row["file"].split("/")[1]
            writer.writerow([row["file"], label, row["subject"], session, row["activity"], split])
    config = ImportConfig(gate=(0.0, 10.0), fields=({"name": "signature", "dtype": "half"},))
    report = import_dataset(radar_folder, place / "labels.csv", place / "cw", config=config)
    return report, open_dataset(place / "cw")


def test_all_recordings_of_the_doppler_module_become_rows(doppler_module):
    report, dataset = doppler_module
    assert (report.n_rows, report.n_failed, report.n_not_tracked) == (152, 0, 0)
    assert report.counts == COUNTS
    assert set(dataset.index["observation_s"].round(6)) == {2.0, 3.0, 4.0, 4.6, 6.0, 6.6, 7.0}
    assert dataset.index["carrier_hz"].unique().tolist() == [24.1e9]
    X, _, groups = dataset.features()
    assert X.shape == (152, 6)
    assert len(set(groups)) == 7
    assert len(list_blocked_recordings(dataset.index)) == 152
    assert "**Not for release**: 152 of 152" in (report.directory / "README.md").read_text()
    train, test = dataset["train"], dataset["test"]
    assert not set(train.index["group"]) & set(test.index["group"])


def test_gaits_are_in_the_order_of_their_speeds(doppler_module):
    _, dataset = doppler_module
    by_gait = dataset.select(f"label in {list(TORSO_MPS)}").index.groupby("label")
    speeds_mps = by_gait["feature_torso_velocity_mps"].median()
    widths_hz = by_gait["feature_doppler_bandwidth_hz"].median()
    assert list(speeds_mps.sort_values().index) == ["creep", "walk", "stride", "run"]
    assert list(widths_hz.sort_values().index) == ["creep", "walk", "stride", "run"]
    for gait, expected in TORSO_MPS.items():
        assert speeds_mps[gait] == pytest.approx(expected, rel=0.2), gait


def test_a_room_with_a_breathing_person_and_an_empty_one(radar_folder, tmp_path):
    (tmp_path / "labels.csv").write_text(
        "file,label,nobody,licence,truth_breathing_rate_hz,option.matrix,option.range_start_m,"
        "option.bin_spacing_m,option.carrier_hz\n"
        "x4_rf_giraffe_yin/rf_breathing*.mat,still,,,0.24,,,,\n"
        "x4_rf_giraffe_yin/rf_empty*.mat,empty,yes,,,Data_Matrix_1,,,\n"
        "x4_rf_giraffe_yin/rf_empty*.mat,empty,yes,,,Data_Matrix_2,,,\n"
        "x4_baseband_iq_novelda/xethru*,still,,MIT,,,,,\n"
        "x4_datafloat_marcusm111/xethru*,unknown,,MIT,,,0.386,0.05144033,7.29e9\n"
        "a121_acconeer/corner-reflector.h5,unknown,,Clear-BSD,,,,,\n"
    )
    report = import_dataset(radar_folder, tmp_path / "labels.csv", tmp_path / "rooms")
    assert (report.n_rows, report.n_failed) == (5, 1)
    assert "holds 4 subsweeps; give subsweep = 0 to 3" in report.failures[0]["reason"]
    dataset = open_dataset(tmp_path / "rooms")
    index = dataset.index.set_index("id")
    breathing = index.loc["still-000000"]
    assert breathing["quality_flags"].startswith("keeps_still:found_by_breathing")
    assert breathing["quality_breathing_rate_hz"] == pytest.approx(breathing["truth_breathing_rate_hz"], abs=0.02)
    assert breathing["quality_track_range_m"] == pytest.approx(1.73, abs=0.1)
    assert set(index.loc[["empty-000000", "empty-000001"], "quality_flags"]) == {"nobody:nothing_found"}
    assert index.loc["empty-000000", "group"] == index.loc["empty-000001", "group"]
    assert index.loc["still-000001", "quality_flags"].startswith("keeps_still:found_by_breathing")  # for its first 12 s
    assert index.loc["unknown-000000", "quality_flags"] == "not_tracked"
    assert report.n_not_tracked == 1
    assert index["prf_hz"].to_numpy() == pytest.approx([25.04, 25.04, 25.04, 17.05, 17.05], abs=0.01)
    still = index.index.str.startswith("still")
    np.testing.assert_array_equal(dataset.features().X[~still], np.nan)
