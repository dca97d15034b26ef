"""Compiled for the widest vectors where there are any; what comes out does not depend on it."""

from __future__ import annotations

import json
import os
import pickle
import sys

import pytest

import doppelgait as dg
import processes

PROGRAM = """
import hashlib, json, pickle, sys
{before}
from numba import config
from doppelgait.pipeline.target import analyze_signature
from doppelgait.processing import Analysis
with open({path!r}, "rb") as file:
    signature, gate = pickle.load(file)
result = analyze_signature(signature, gate, Analysis(), label=None)
numbers = [repr(result.features), repr(sorted(result.extended.items())), repr(sorted(result.quality.items()))]
digest = hashlib.sha256("".join(numbers).encode() + result.cadence_map.values.tobytes())
print(json.dumps([digest.hexdigest(), config.CPU_FEATURES]))
"""
"""Features and map of one signature, and what Numba was told to compile for."""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Run the program in a process of its own, after a line of code and with environment variables."""
    walk = dg.motion.human_gait(speed_mps=1.2, duration_s=2.5)
    scene = dg.Scene([dg.Target(walk, label="human")], duration_s=2.5)
    recording = dg.simulate(scene, dg.Radar.preset("x4"), rng=dg.rng(1), snr_db=15)
    result = dg.analyze(recording, gate="truth")[0]
    path = tmp_path_factory.mktemp("signature") / "signature.pickle"
    path.write_bytes(pickle.dumps((result.signature, result.gate)))

    def child(before="", **environment):
        done = processes.run(
            [sys.executable, "-c", PROGRAM.format(before=before, path=str(path))],
            env={**os.environ, **environment}, capture_output=True, text=True, check=True,
        )  # fmt: skip
        return json.loads(done.stdout.splitlines()[-1])

    return child


@pytest.fixture(scope="module")
def plain(run):
    """As it is without any wish of the user."""
    return run()


def test_bytes_do_not_depend_on_what_was_compiled_before(run, plain):
    assert run("import numba; numba.njit(lambda x: x + 1)(1)")[0] == plain[0]


def test_whoever_chose_a_processor_is_left_alone(run, plain):
    from llvmlite.binding import get_host_cpu_features, get_host_cpu_name

    if not get_host_cpu_features().get("avx512f"):
        assert plain[1] is None
        pytest.skip("this processor has no vectors of 512 bits")
    assert plain[1].endswith(",-prefer-256-bit")
    features = get_host_cpu_features().flatten()
    chosen = run(NUMBA_CPU_NAME=get_host_cpu_name(), NUMBA_CPU_FEATURES=features)
    assert chosen == [plain[0], features]


def test_vectors_that_were_switched_off_stay_off():
    from llvmlite.binding import get_host_cpu_features

    if not get_host_cpu_features().get("avx512f"):
        pytest.skip("this processor has no vectors of 512 bits")
    program = "import doppelgait.core.kernels; from numba import config; print(config.CPU_FEATURES)"
    done = processes.run(
        [sys.executable, "-c", program],
        env={**os.environ, "NUMBA_ENABLE_AVX": "0"}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.strip() == "None"
