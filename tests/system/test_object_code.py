"""Object code that ships with the package: the same bytes as Numba's, and Numba where there is none."""

import json
import platform
import sys

import pytest

import processes
from checkout import ROOT

ROOMS = ROOT / "examples" / "rooms-plan.toml"
PROGRAM = """
import hashlib, json, sys
{before}
from doppelgait.core.kernels import compiled
if {level!r}:
    compiled.LEVELS = {{{level!r}: compiled.LEVELS[{level!r}]}}
from doppelgait.dataset import load_plan, plan_dataset
from doppelgait.dataset.shard import BuildContext, build_planned
digest = hashlib.sha256()
for name in ("home-alarm", {rooms!r}):
    config, folder = load_plan(name, overrides=["dataset.examples_per_class=12"])
    plan = plan_dataset(config, folder=folder)
    for entry in plan.examples[::6]:
        for row, arrays in build_planned(entry, BuildContext(plan.config, str(plan.folder), ".")):
            digest.update(repr(sorted(row.items())).encode())
            for values in arrays.values():
                digest.update(values.tobytes())
import doppelgait as dg
from doppelgait.processing import Analysis
scene = dg.Scene([dg.Target({{"kind": "boulic"}}, label="human")], duration_s=5.0)
recording = dg.simulate(scene, dg.Radar.preset("x4"), rng=dg.rng(1))
for found in dg.analyze(recording, gate="truth", analysis=Analysis(hop=1)):  # thinned for features
    digest.update(repr(sorted(found.to_row().items())).encode())
print(json.dumps([digest.hexdigest(), "numba" in sys.modules]))
"""

NUMBA_FOR_SOME = """
import importlib.util, os
import llvmlite.binding
from doppelgait.core.kernels import compiled
spec = importlib.util.spec_from_file_location("compile_kernels", {tool!r})
tool = importlib.util.module_from_spec(spec)
spec.loader.exec_module(tool)
compiled._object_code()  # read before the variables of Numba forbid it
level = compiled.level_of(llvmlite.binding.get_host_cpu_features())
os.environ |= {{"NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": tool.FEATURES[level]}}
entries_of = compiled._entries_of
compiled._entries_of = lambda member: [] if member.name.partition(".")[0] in {modules!r} else entries_of(member)
"""
"""Numba compiles some modules for the level of processors that the object code of this processor is for."""
MODULES = ("synthesis", "noise", "periodicity")
"""Of the simulation, its random numbers and the features; Numba takes 40 s for all modules, 9 s for these."""

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() != "x86_64", reason="no object code for this system"
)


def run(before: str = "", level: str = "", **environment: str) -> list[object]:
    program = PROGRAM.format(before=before, level=level, rooms=str(ROOMS))
    found: list[object] = json.loads(processes.python(program, **environment).stdout.splitlines()[-1])
    return found


@pytest.fixture(scope="module")
def plain() -> list[object]:
    return run()


def test_examples_of_datasets_need_no_numba(plain):
    assert plain[1] is False


@pytest.mark.release
def test_numba_for_the_same_level_gives_the_same_bytes(plain, tmp_path):
    """Numba for one processor contracts other products and sums: last bits of a feature may differ."""
    before = NUMBA_FOR_SOME.format(tool=str(ROOT / "tools" / "compile_kernels.py"), modules=MODULES)
    assert run(before, NUMBA_CACHE_DIR=str(tmp_path)) == [plain[0], True]
    compiled = {path.name.partition(".")[0] for path in tmp_path.rglob("*.nbi")}
    assert compiled == set(MODULES)


def test_processors_without_the_widest_vectors_give_the_same_bytes(plain):
    assert run(level="x86-64-v3") == plain


def test_what_a_user_compiles_before_changes_nothing(plain, tmp_path):
    before = "import numba; numba.njit(lambda x: x + 1)(1)"
    assert run(before, NUMBA_CACHE_DIR=str(tmp_path)) == [plain[0], True]
    assert not list(tmp_path.rglob("*.nbi")), "kernels were compiled again"


SIMULATE = """
scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=0.5)
dg.simulate(scene, dg.Radar.preset("x4"), rng=dg.rng(1))
"""
FAR_APART = {
    "4 GiB of untouched pages": "import numpy as np, doppelgait as dg\npages = np.zeros(2**29)",
    "a hole of 160 kB below 2.5 GB": (
        "import numpy as np, doppelgait as dg\nwave = np.random.default_rng(0).normal(size=20_000)\n"
        "table = np.zeros((2_500, 125_000))\nwave = wave * 2.0"
    ),
    "torch first": "import torch\nimport doppelgait as dg",
}


@pytest.mark.parametrize("memory", FAR_APART)
def test_code_and_data_stay_within_reach_of_each_other(memory):
    """Sections of object code that lie more than 2 GB apart end the process (SIGABRT)."""
    if memory == "torch first":
        pytest.importorskip("torch")
    processes.python(FAR_APART[memory] + SIMULATE)
