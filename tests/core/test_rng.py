"""One seed, one recording: from a scene file, the command line and Python."""

import tomllib
import zlib

import numpy as np
import pytest

import doppelgait as dg
from command import run
from doppelgait.core.errors import ConfigError
from doppelgait.core.rng import PURPOSES, Streams
from doppelgait.pipeline import Run, run_simulation
from doppelgait.radar import read_recording

SCENE = """
seed = 2018
duration_s = 0.4
[radar]
preset = "x4"
prf_hz = 600
[[targets]]
label = "human"
motion = { kind = "boulic", speed_mps = 1.2, stride_variation = 0.02 }
rcs = { fluctuation = "swerling1", total_spread_db = 2.0 }
[[impairments]]
kind = "frame_jitter"
sd_s = 1e-5
[[impairments]]
kind = "phase_noise"
[[environment]]
kind = "visibility"
gain_db = [[1.0, 0.0], [20.0, -6.0]]
"""


def in_python(seed):
    streams, table = dg.rng(seed), tomllib.loads(SCENE)
    motion = dg.motion.boulic_walk(speed_mps=1.2, stride_variation=0.02, duration_s=0.4, rng=streams)
    scene = dg.Scene([dg.Target(motion, label="human", rcs=table["targets"][0]["rcs"])], duration_s=0.4)
    conditions = dg.Conditions(environment=table["environment"], impairments=table["impairments"])
    return dg.simulate(scene, dg.Radar.preset("x4", prf_hz=600), rng=streams, conditions=conditions)


def test_the_same_seed_gives_the_same_bytes_from_toml_command_line_and_python(tmp_path):
    scene_file, out = tmp_path / "scene.toml", tmp_path / "recording.h5"
    scene_file.write_text(SCENE)
    from_toml = run_simulation(Run.from_toml(scene_file)).baseband.values
    assert in_python(2018).baseband.values.tobytes() == from_toml.tobytes()
    assert in_python(2019).baseband.values.tobytes() != from_toml.tobytes()
    for seed in (2018, 2019):
        run("simulate", scene_file, "--seed", seed, "-o", out)
        assert (read_recording(out).baseband.values.tobytes() == from_toml.tobytes()) == (seed == 2018)


@pytest.mark.parametrize(
    "wrong", [{"seed": -1}, {"seed": 1.5}, {"seed": 1, "example": -1}, {"seed": "1"}, {"seed": None}]
)
def test_seed_and_example_are_checked(wrong):
    with pytest.raises(ConfigError, match=r"(seed|example): .* not allowed; it must be an integer, 0 or larger"):
        dg.Streams(**wrong)


def test_a_generator_is_refused_where_streams_are_needed():
    scene = dg.Scene([dg.Target(dg.motion.boulic_walk(speed_mps=1.2, duration_s=0.5))])
    with pytest.raises(ConfigError, match=r"pass rng=doppelgait\.rng\(SEED\)"):
        dg.simulate(scene, dg.Radar.preset("x4"), rng=np.random.default_rng(1))


@pytest.mark.parametrize("seed", [0, 2018, 2**32, 2**130 + 7])
@pytest.mark.parametrize("example", [0, 7, 2**33])
def test_streams_are_those_of_numpys_seed_sequence(seed, example):
    for number, purpose in enumerate(PURPOSES):
        for key, name in (("", ()), ("target.range_m", (zlib.crc32(b"target.range_m"),))):
            words = np.random.SeedSequence(seed, spawn_key=(number, example, *name))
            made, wanted = Streams(seed, example).generator(purpose, key), np.random.default_rng(words)
            assert made.spawn(2)[1].bit_generator.state == wanted.spawn(2)[1].bit_generator.state
            assert made.bit_generator.state == wanted.bit_generator.state
    assert dg.rng(seed) == Streams(seed) == Streams(seed, example=0)
    assert dg.rng(np.int64(3)) == dg.rng(3)
    with pytest.raises(ValueError, match="tuple"):
        Streams(0).generator("colour")
