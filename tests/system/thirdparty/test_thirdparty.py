"""A package of another laboratory, installed by pip: commands, files, plans and Python find it by its entry point."""

import json
import os
import sys
from pathlib import Path

import pandas as pd
import pytest

import processes
from checkout import ROOT

PACKAGE = Path(__file__).parent / "package"
LIMIT_S = 300
pytestmark = pytest.mark.release

SCENE = """
seed = 4
duration_s = 1.5

[radar]
preset = "x4"

[[impairments]]
kind = "hum"
level_v = 1e-6

[[targets]]
label = "human"
motion = { kind = "boulic", speed_mps = 1.2 }
rcs = { kind = "gaitlab_backpack", total_m2 = 0.5, reflector_gain = 4 }
range_m = 4
"""

PLAN = """
[dataset]
name = "gaitlab"
examples_per_class = 2
fractions = { train = 1.0 }

[scene]
duration_s = 1.0

[target]
range_m = { uniform = [4, 5] }
rcs = { kind = "gaitlab_backpack", total_m2 = 0.5, reflector_gain = { uniform = [6, 8] } }

[noise]
kind = "snr"
snr_db = 15

[[impairments]]
kind = "hum"
level_v = { uniform = [0, 1e-6] }

[[classes]]
label = "human"
motion = { kind = "boulic", speed_mps = 1.2 }

[[classes]]
label = "dog"
motion = { kind = "quadruped", gait = "trot" }
"""

PYTHON = """
import json, sys
import numpy as np
import doppelgait as dg
import gaitlab_plugins

dg.testing.check_impairment(gaitlab_plugins.Hum(level_v=2e-6), dg.Radar.preset("x4"))
dg.testing.check_rcs({"kind": "gaitlab_backpack", "reflector_gain": 3.0})
recordings = [dg.radar.read_recording(name) for name in ("scene.h5", "loud.h5")]
print(json.dumps({
    "peak_v": [float(np.abs(one.baseband.values).max()) for one in recordings],
    "rcs_m2": [float(one.truth[0].scatterers["rcs"].sum("scatterer").mean()) for one in recordings],
}))
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Folder with the package as pip installs it, without a network."""
    target = tmp_path_factory.mktemp("installed")
    processes.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index",
         "--disable-pip-version-check", "--target", str(target), str(PACKAGE)],
        check=True, timeout=LIMIT_S,
    )  # fmt: skip
    assert list(target.glob("gaitlab_plugins-0.3.dist-info/entry_points.txt"))
    return target


@pytest.fixture
def run(installed, tmp_path):
    """Run Python in a process of its own that sees the installed package."""

    def start(*arguments, path=None):
        places = [str(ROOT / "src"), *([str(installed)] if path is None else path)]
        done = processes.run(
            [sys.executable, *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=LIMIT_S,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(places)}, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    return start


def command(*arguments):
    return ["-c", "from doppelgait.cli.app import main; main()", *map(str, arguments)]


def test_the_command_lists_what_the_package_brings(run):
    rows = json.loads(run(*command("plugins", "--json")))
    found = {(row["group"], row["name"]): row for row in rows if row["package"] == "gaitlab_plugins"}
    assert set(found) >= {
        ("impairment", "hum"), ("feature", "gaitlab_peak_share"), ("rcs", "gaitlab_backpack"),
    }  # fmt: skip
    assert found["impairment", "hum"]["parameters"] == ["level_v", "frequency_hz"]
    assert found["impairment", "hum"]["version"] == "2"
    assert {"total_m2", "reflector_gain"} < set(found["rcs", "gaitlab_backpack"]["parameters"])
    without = json.loads(run(*command("plugins", "--json"), path=[]))
    assert [row for row in without if row["package"] != "doppelgait"] == []


def test_a_scene_file_and_the_command_line_set_its_parameters(run, tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    run(*command("simulate", "scene.toml", "-o", "scene.h5"))
    run(*command("simulate", "scene.toml", "-o", "loud.h5", "--set", "impairments.0.level_v=10",
                 "--set", "targets.0.rcs.reflector_gain=14"))  # fmt: skip
    found = json.loads(run("-c", PYTHON))
    assert 0 < found["peak_v"][0] < 1 < 5 < found["peak_v"][1] < 50
    assert found["rcs_m2"] == pytest.approx([2.5, 7.5], rel=1e-5)
    (target,) = json.loads(run(*command("analyze", "scene.h5", "--gate", "truth", "--json")))["targets"]
    assert 0 < target["extended"]["gaitlab_peak_share"] < 1


def test_a_plan_takes_distributions_and_the_identity_names_the_package(run, tmp_path):
    (tmp_path / "plan.toml").write_text(PLAN)
    run(*command("dataset", "build", "plan.toml", "-o", "gaitlab", "--executor", "serial"))
    description = json.loads((tmp_path / "gaitlab" / "dataset.json").read_text())
    used = {(item["group"], item["name"]): item for item in description["plugins"]}
    assert used["feature", "gaitlab_peak_share"]["release"] == "0.3"
    hum = used["impairment", "hum"]
    assert "level_v" in hum.pop("parameters")
    assert hum == {"group": "impairment", "name": "hum", "version": "2", "package": "gaitlab_plugins", "release": "0.3"}
    backpack = used["rcs", "gaitlab_backpack"]
    assert (backpack["version"], backpack["release"]) == ("3", "0.3")
    assert {"total_m2", "reflector_gain"} < set(backpack["parameters"])
    totals_m2 = pd.read_parquet(tmp_path / "gaitlab" / "index.parquet")["rcs_total_m2"].tolist()
    assert len(set(totals_m2)) == len(totals_m2) == 4
    assert all(3.5 <= value <= 4.5 for value in totals_m2)
