"""Native code in a process: the same bytes at levels with fused operations, and the lowest level."""

import os
import shutil
import sys
from pathlib import Path

import pytest
from numpy._core._multiarray_umath import __cpu_dispatch__

import doppelgait
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


@pytest.mark.skipif(LEVEL < 3, reason="needs a processor of level 3, whose AVX-512 NumPy can leave unused")
def test_processors_without_the_widest_vectors_give_the_same_bytes():
    wide = " ".join(name for name in __cpu_dispatch__ if "512" in name or name == "X86_V4")
    narrow = processes.python(PROGRAM, DOPPELGAIT_LEVEL="2", NPY_DISABLE_CPU_FEATURES=wide)
    assert narrow.stdout == processes.python(PROGRAM).stdout


def test_the_lowest_level_simulates():
    scene = 'dg.Scene([dg.Target({"kind": "boulic"}, label="human")], duration_s=0.5)'
    processes.python(f"import doppelgait as dg\ndg.simulate({scene}, 'x4', rng=dg.rng(1))", DOPPELGAIT_LEVEL="1")


@pytest.mark.release
@pytest.mark.skipif(
    sys.platform != "linux" or not (shutil.which("g++") and shutil.which("cmake")), reason="needs Linux, g++ and cmake"
)
def test_native_code_stays_inside_its_memory(tmp_path):
    package, core = Path(doppelgait.__file__).parent, tmp_path / "doppelgait" / "_core"
    core.mkdir(parents=True)
    for path in package.iterdir():
        if path.name != "_core":
            (tmp_path / "doppelgait" / path.name).symlink_to(path)
    shutil.copy(package / "_core" / "__init__.py", core)
    watched = "-DDOPPELGAIT_OPTIONS=-fsanitize=address,undefined;-fno-sanitize-recover=undefined;-g1;-O1"
    options = [f"-DPython_EXECUTABLE={sys.executable}", f"-DDOPPELGAIT_OUTPUT={core}", "-DCMAKE_CXX_COMPILER=g++"]
    names = ("libasan.so", "libstdc++.so.6")
    found = [processes.run(["g++", f"-print-file-name={name}"], capture_output=True, text=True) for name in names]
    variables = {"LD_PRELOAD": " ".join(one.stdout.strip() for one in found), "ASAN_OPTIONS": "detect_leaks=0"}
    for line, further in (
        (["cmake", "-S", ROOT / "native", "-B", tmp_path / "build", *options, watched], {}),
        (["cmake", "--build", tmp_path / "build", "--parallel"], {}),
        ([sys.executable, "-m", "pytest", "-qsx", "-p", "no:cacheprovider", ROOT / "tests" / "native"], variables),
    ):
        environment = {**os.environ, **further, "PYTHONPATH": str(tmp_path)}
        done = processes.run([*map(str, line)], timeout=600, capture_output=True, text=True, env=environment)
        assert done.returncode == 0, (done.stdout + done.stderr)[-4000:]
