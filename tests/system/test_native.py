"""Native code in a process: the same bytes at levels with fused operations, and surroundings that ended it before."""

import pytest

import processes
from checkout import ROOT
from doppelgait._core import LEVEL

ROOMS = ROOT / "examples" / "rooms-plan.toml"
PROGRAM = f"""
import hashlib
import doppelgait as dg
from doppelgait.dataset import load_plan, plan_dataset
from doppelgait.dataset.shard import BuildContext, build_planned
from doppelgait.processing import Analysis
digest = hashlib.sha256()
for name in ("home-alarm", {str(ROOMS)!r}):
    config, folder = load_plan(name, overrides=["dataset.examples_per_class=12"])
    plan = plan_dataset(config, folder=folder)
    for made in build_planned(plan.examples[::6], BuildContext(plan.config, str(plan.folder), ".")):
        for row, arrays in made:
            digest.update(repr(sorted(row.items())).encode())
            for values in arrays.values():
                digest.update(values.tobytes())
scene = dg.Scene([dg.Target({{"kind": "boulic"}}, label="human")], duration_s=5.0)
recording = dg.simulate(scene, dg.Radar.preset("x4"), rng=dg.rng(1))
for found in dg.analyze(recording, gate="truth", analysis=Analysis(hop=1)):  # thinned for features
    digest.update(repr(sorted(found.to_row().items())).encode())
print(digest.hexdigest())
"""


@pytest.mark.skipif(LEVEL < 3, reason="needs a processor of level 3")
def test_processors_without_the_widest_vectors_give_the_same_bytes():
    assert processes.python(PROGRAM, DOPPELGAIT_LEVEL="2").stdout == processes.python(PROGRAM).stdout


SIMULATE = """
scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=0.5)
dg.simulate(scene, dg.Radar.preset("x4"), rng=dg.rng(1))
"""
SURROUNDINGS = {
    "4 GiB of untouched pages": "import numpy as np, doppelgait as dg\npages = np.zeros(2**29)",
    "a hole of 160 kB below 2.5 GB": (
        "import numpy as np, doppelgait as dg\nwave = np.random.default_rng(0).normal(size=20_000)\n"
        "table = np.zeros((2_500, 125_000))\nwave = wave * 2.0"
    ),
    "torch first": "import torch\nimport doppelgait as dg",
    "no memory becomes executable": (
        "import ctypes, doppelgait as dg\nctypes.CDLL(None).prctl(65, 1, 0, 0, 0)  # PR_SET_MDWE, where Linux has it"
    ),
    "the lowest level": "import os; os.environ['DOPPELGAIT_LEVEL'] = '1'\nimport doppelgait as dg",
}


@pytest.mark.parametrize("surroundings", SURROUNDINGS)
def test_the_process_lives(surroundings):
    if surroundings == "torch first":
        pytest.importorskip("torch")
    processes.python(SURROUNDINGS[surroundings] + SIMULATE)
