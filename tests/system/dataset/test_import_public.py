"""Published sets of recordings, made here in their formats, become datasets and test sets."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from beat import beat, walker, write_glasgow
from doppelgait.cli.app import app
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.dataset.importing import ImportConfig, import_dataset, import_id
from doppelgait.dataset.names import label_entries, relabel
from tiny_dataset import built, tiny_plan


@pytest.fixture(scope="module")
def glasgow(tmp_path_factory):
    """Two people who walk, and a file of another activity."""
    folder = tmp_path_factory.mktemp("glasgow")
    sweep = {"carrier_hz": 5.8e9, "bandwidth_hz": 400e6, "sweep_s": 1e-3, "n_samples": 64}
    for person, speed in ((3, 1.0), (4, 1.4)):
        samples = beat(*walker(3000, 1000, start_m=7.0, speed_mps=speed), **sweep)
        write_glasgow(folder / f"1P0{person}A01R01.dat", samples, step=20.0)
    (folder / "2P03A02R01.dat").write_text("5800000000\n")
    return folder


def test_a_glasgow_folder_becomes_a_dataset(glasgow, tmp_path):
    folder = glasgow
    entries = label_entries(folder, None, "glasgow", ["walking=human", "*="], gate="track")
    report = import_dataset(folder, entries, tmp_path / "set")
    assert (report.n_rows, report.n_failed, report.n_not_tracked) == (2, 0, 0)
    index = pd.read_parquet(tmp_path / "set" / "index.parquet")
    assert index["subject"].tolist() == ["person/03", "person/04"]
    assert index["label"].unique().tolist() == ["human"]
    assert index["feature_torso_velocity_mps"].to_numpy() == pytest.approx([1.0, 1.4], abs=0.12)
    assert index["carrier_hz"].unique().tolist() == [5.8e9]
    assert "10.5525" in (tmp_path / "set" / "README.md").read_text()
    assert import_dataset(folder, entries, tmp_path / "set").was_there
    other = relabel(entries, ["human=person"])
    assert import_id(other, {"a": "1"}, ImportConfig()) != import_id(entries, {"a": "1"}, ImportConfig())
    assert np.isfinite(index["feature_doppler_bandwidth_hz"]).all()


def test_one_command_scores_simulations_on_a_glasgow_folder(glasgow, tmp_path, tmp_path_factory):
    dataset = built(tmp_path_factory, tiny_plan())
    command = ["evaluate", dataset, "--test", glasgow, "--names", "glasgow", "--label", "walking=human", "--label"]
    done = CliRunner().invoke(app, [str(x) for x in [*command, "*=", "-o", tmp_path / "r", "--models", "six-logistic"]])
    assert done.exit_code == 0, done.output
    document = json.loads((tmp_path / "r" / "scores.json").read_text())
    assert document["tested"] == {"human": 2, "dog": 0}
    assert document["test_dataset"]["directory"] == str(tmp_path / "r-test")
    assert document["test_dataset"]["config"]["window_s"] is None
    assert "2 rows of 2 recordings" in done.stderr
    command = ["dataset", "import", glasgow, "--names", "glasgow", "-o", tmp_path / "all", "--json"]
    done = CliRunner().invoke(app, [str(x) for x in command])
    assert done.exit_code == 1
    report = json.loads(done.stdout)
    assert report["counts"] == {"walking": 2}
    assert "no recording format" in report["failures"][0]["reason"]
    for wrong in (["--names", "glasgow"], ["--test", str(glasgow), "--label", "walking=human"]):
        with pytest.raises(ConfigError, match="need --test FOLDER and --names"):
            CliRunner().invoke(
                app, ["evaluate", str(dataset), "-o", str(tmp_path / "q"), *wrong], catch_exceptions=False
            )


def test_settings_of_all_recordings_are_part_of_the_identity(tmp_path):
    folder, config = tmp_path / "ti", tmp_path / "chirps.json"
    table = {
        "device": "xwr18xx", "receivers": [0], "n_samples": 64, "sample_rate_hz": 4e6, "start_hz": 60e9,
        "slope_hz_per_s": 30e12, "idle_s": 4.5e-4, "ramp_s": 5e-5, "loops": 8, "frame_period_s": 0.004,
    }  # fmt: skip
    folder.mkdir()
    config.write_text(json.dumps(table))
    for name in ("walk-anna", "walk-ben"):
        np.random.default_rng(len(name)).integers(-99, 99, 2 * 64 * 8 * 300).astype("<i2").tofile(
            folder / f"{name}.bin"
        )
    command = ["dataset", "import", folder, "--names", "{label}-{subject}.bin", "--gate", "1:2", "--option"]
    command = [
        str(x) for x in [*command, "format=dca1000", "--option", f"config={config}", "--json", "-o", tmp_path / "set"]
    ]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout)
    assert report["counts"] == {"walk": 2}
    assert pd.read_parquet(tmp_path / "set" / "index.parquet")["subject"].tolist() == ["person/anna", "person/ben"]
    assert json.loads(CliRunner().invoke(app, command).stdout)["was_there"]
    config.write_text(json.dumps(table | {"start_hz": 61e9}))
    with pytest.raises(DatasetError, match="of other recordings, labels or settings"):
        CliRunner().invoke(app, command, catch_exceptions=False)
