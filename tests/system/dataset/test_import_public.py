"""Published sets of recordings, made here in their formats, become datasets and test sets."""

import json

import numpy as np
import pandas as pd
import pytest
from matplotlib import colormaps
from matplotlib.image import imsave

from beat import beat, walker, write_glasgow
from command import run
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.dataset import open_dataset
from doppelgait.dataset.importing import ImportConfig, import_dataset, import_id
from doppelgait.dataset.labels import label_entries, relabel


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


def test_one_command_scores_simulations_on_a_glasgow_folder(glasgow, tmp_path, folder):
    command = ["evaluate", folder, "--test", glasgow, "--names", "glasgow", "--label", "walking=human", "--label"]
    done = run(*command, "*=", "-o", tmp_path / "r", "--models", "six-logistic")
    document = json.loads((tmp_path / "r" / "scores.json").read_text())
    assert document["tested"] == {"human": 2, "dog": 0}
    assert document["test_dataset"]["directory"] == str(tmp_path / "r-test")
    assert document["test_dataset"]["config"]["window_s"] is None
    assert "2 rows of 2 recordings" in done.stderr
    command = ["dataset", "import", glasgow, "--names", "glasgow", "-o", tmp_path / "all", "--json"]
    report = json.loads(run(*command, code=1).stdout)
    assert report["counts"] == {"walking": 2}
    assert "holds samples without a header" in report["failures"][0]["reason"]
    for wrong in (["--names", "glasgow"], ["--test", str(glasgow), "--label", "walking=human"]):
        with pytest.raises(ConfigError, match="need --test FOLDER and --names"):
            run("evaluate", str(folder), "-o", str(tmp_path / "q"), *wrong)


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
    command = [*command, "format=dca1000", "--option", f"config={config}", "--json", "-o", tmp_path / "set"]
    done = run(*command)
    report = json.loads(done.stdout)
    assert report["counts"] == {"walk": 2}
    assert pd.read_parquet(tmp_path / "set" / "index.parquet")["subject"].tolist() == ["person/anna", "person/ben"]
    assert json.loads(run(*command).stdout)["was_there"]
    config.write_text(json.dumps(table | {"start_hz": 61e9}))
    with pytest.raises(DatasetError, match="of other recordings, labels or settings"):
        run(*command)


def test_pictures_in_folders_of_classes_become_a_dataset(tmp_path):
    """Two people a class, 4 s each: the line of the torso at 1.0 or 2.0 m/s, limbs that swing around it."""
    folder = tmp_path / "pictures"
    times_s, velocity_mps = 0.02 * (np.arange(200) + 0.5), np.linspace(-4, 4, 161)[None]
    for label, speed in (("walking", 1.0), ("running", 2.0)):
        (folder / label).mkdir(parents=True)
        for number, person in enumerate(("anna", "ben")):
            limb_mps = speed * (1 + 0.9 * np.sin(2 * np.pi * 1.8 * times_s + number)[:, None])
            level_db = -40 + 40 * np.exp(-(((velocity_mps - speed) / 0.15) ** 2))
            level_db = np.maximum(level_db, -40 + 25 * np.exp(-(((velocity_mps - limb_mps) / 0.2) ** 2)))
            image = colormaps["jet"](1 + level_db.T[::-1] / 40, bytes=True)
            imsave(folder / label / f"{person}_01.png", image)
    about = """velocity_mps = [-4.025, 4.025]\nduration_s = 4.0\ncarrier_hz = 10e9\ncpi_s = 0.1\nprf_hz = 1000
level_db = [-40, 0]\ncolormap = "jet"\n"""
    (folder / "picture.toml").write_text(about)
    names = "{label}/{subject}_*.png"
    command = ["dataset", "import", str(folder), "--names", names, "-o"]
    run(*command, str(tmp_path / "set"), "--json")
    index = pd.read_parquet(tmp_path / "set" / "index.parquet")
    assert index["subject"].tolist() == ["person/anna", "person/ben"] * 2
    assert index["label"].tolist() == ["running"] * 2 + ["walking"] * 2
    assert index["feature_torso_velocity_mps"].to_numpy() == pytest.approx([2.0, 2.0, 1.0, 1.0], rel=0.1)
    assert index["carrier_hz"].to_numpy() == pytest.approx(10e9)
    assert index["notes"].str.startswith("a picture").all()
    assert index["observation_s"].to_numpy() == pytest.approx(4.0)
    assert open_dataset(tmp_path / "set")["running-000000"].signature.shape == (200, 161)
    done = run(*command, str(tmp_path / "cut"), "--window-s", "2", "--json")
    assert json.loads(done.stdout)["n_rows"] == 8
    (folder / "picture.toml").unlink()
    with pytest.raises(DatasetError, match="a picture needs a file"):
        run(*command, tmp_path / "none")
