"""Exported C compiles without a warning and gives the probabilities that Python gives."""

import re
import shutil

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.classify.export.device import CSettings, list_parts, plan_device, select_networks
from doppelgait.classify.export.write import (
    collect_levels,
    convert_samples,
    export_model,
    predict_network_probability,
    walk_samples,
)
from doppelgait.classify.learned import Network
from doppelgait.core.errors import ConfigError
from doppelgait.processing import patches
from doppelgait.processing.patches import Patch
from export_models import export_model_of
from processes import run

FLAGS = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2"]
SMALL = Patch(n_velocity=16, n_time=16)


@pytest.fixture
def build(tmp_path):
    """Compile an export with a program; returns the path of it."""
    from export_models import require

    compiler = shutil.which("gcc") or shutil.which("cc")
    require(compiler, "a C compiler, gcc or cc")

    def build(folder, program=None, more=()):
        place = tmp_path / "program"
        sources = [str(program or folder / "selftest.c"), str(folder / "doppelgait_model.c")]
        done = run([compiler, *FLAGS, *more, "-I", str(folder), *sources, "-lm", "-o", str(place)],
                   capture_output=True, text=True)  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert done.stderr == ""
        return place

    return build


def rows_of(program, samples):
    """Numbers that a program prints, a row a line, of what it reads."""
    done = run([str(program)], input=samples.tobytes(), capture_output=True)
    return np.array([line.split() for line in done.stdout.decode().splitlines()], dtype=float)


def check(build, model, target, folder):
    """Export, compile and run the test of golden vectors; return its text and the export."""
    made = export_model(model, "c", folder, target)
    done = run([str(build(folder)), str(folder / "golden.bin")], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout, made


@pytest.mark.parametrize(
    ("n_classes", "integers", "n_examples"),
    [
        (2, True, 100),
        (3, False, 100),
        pytest.param(2, False, 1000, marks=pytest.mark.release),
        pytest.param(3, True, 1000, marks=pytest.mark.release),
    ],
)
def test_examples_of_every_kind_agree(build, tmp_path, n_classes, integers, n_examples):
    model = export_model_of("ensemble", n_classes, patch=SMALL)
    text, _ = check(build, model, CSettings(n_examples=n_examples, window_s=0.8, integers=integers), tmp_path / "out")
    found = re.findall(rf"(\w+): {n_examples} examples, probabilities differ by at most (\S+),", text)
    assert [name for name, _ in found] == ["samples", "levels"]
    assert max(float(value) for name, value in found if name != "samples" or not integers) < 1e-4


@pytest.mark.parametrize(
    ("prf_hz", "analysis", "bins", "n_doppler"),
    [
        (90.0, {}, 1, 10), (211.0, {}, 3, 24), (500.0, {"hop": 3}, 2, 64), (1300.0, {}, 1, 160),
        (30.0, {"cpi_s": 0.3}, 1, 10), (200.0, {"doppler_bins": 77, "window_steepness": 0.6}, 1, 77),
    ],
)  # fmt: skip
def test_radars_transforms_and_gates_agree(build, tmp_path, prf_hz, analysis, bins, n_doppler):
    conditions = {"carrier_hz": (24e9, 24e9), "prf_hz": (prf_hz, prf_hz), "observation_s": (1.7, 2.0)}
    model = export_model_of("network", patch=SMALL, conditions=conditions, analysis=analysis)
    assert plan(model, bins=bins).n_doppler == n_doppler
    check(build, model, CSettings(n_examples=20, bins=bins, still_time_s=0.5), tmp_path / "out")


def plan(model, *, bins=1, window_s=None, still_time_s=2.0):
    patch = next(part[0].patch for part in list_parts(model) if isinstance(part[0], Network))
    return plan_device(model, patch, CSettings(window_s=window_s, bins=bins, still_time_s=still_time_s))


def test_the_usual_size_agrees_and_needs_the_memory_that_is_stated(build, tmp_path):
    model = export_model_of("network", patch=Patch(), channels=(8, 16, 32, 64))
    for integers in (False, True):
        text, made = check(build, model, CSettings(n_examples=3, integers=integers), tmp_path / f"out-{integers}")
        window, buffers = re.search(r"RAM: (\d+) bytes of window, (\d+) bytes of buffers", text).groups()
        assert (int(window), int(buffers)) == (made.facts["window_bytes"], made.facts["buffer_bytes"])
    assert made.facts["flash_table_bytes"] < 30_000
    assert made.facts["int8_examples"] == 100


STREAM = """
#include "doppelgait_model.h"
#include <stdio.h>
static dg_window window;
static dg_decision decision;
int main(void)
{
    float pulse[2 * DG_BINS];
    long n = 0;
    dg_start(&window);
    while (fread(pulse, sizeof pulse, 1, stdin) == 1) {
        if (n == 0)
            window.weight[0] = 0.25f;
        n++;
        if (dg_push(&window, pulse)) {
            dg_decide(&window, &decision);
            printf("%ld %.7f %d %d %.3f\\n", n, (double)decision.probability[1], decision.label, decision.decided,
                   (double)decision.peak_over_floor_db);
        }
    }
    return 0;
}
"""


def test_a_stream_gives_one_decision_per_window_with_weights_of_bins(build, tmp_path):
    model = export_model_of("network", patch=SMALL, seed=4)
    target = CSettings(window_s=0.6, bins=2, still_time_s=None, n_examples=1)
    export_model(model, "c", tmp_path / "out", target)
    (tmp_path / "stream.c").write_text(STREAM)
    program = build(tmp_path / "out", tmp_path / "stream.c")
    device, rng = plan(model, bins=2, window_s=0.6, still_time_s=None), np.random.default_rng(2)
    windows = device.n_stft * device.hop * np.arange(3)
    samples = np.concatenate([walk_samples(rng, device) for _ in range(4)])[: windows[-1] + device.window_pulses]
    rows = rows_of(program, samples)
    assert rows[:, 0].tolist() == (device.window_pulses + windows).tolist()
    weighted = samples * np.array([0.5, 1.0])  # a weight of power
    levels = [convert_samples(weighted[start : start + device.window_pulses], device) for start in windows]
    expected = predict_network_probability(model, levels)
    assert np.ptp(expected[:, 1]) > 0.01
    assert np.allclose(rows[:, 1], expected[:, 1], atol=1e-4)
    assert rows[:, 2].tolist() == expected.argmax(axis=1).tolist()
    assert rows[:, 3].tolist() == (expected.max(axis=1) >= 0.8).tolist()
    assert (rows[:, 4] > 3).all()


def test_a_sample_that_is_no_number_costs_no_later_window(build, tmp_path):
    model = export_model_of("network", patch=SMALL, seed=4)
    export_model(model, "c", tmp_path / "out", CSettings(window_s=0.6, n_examples=1))
    (tmp_path / "stream.c").write_text(STREAM)
    program, device = build(tmp_path / "out", tmp_path / "stream.c"), plan(model, window_s=0.6)
    rng = np.random.default_rng(2)
    samples = np.concatenate([walk_samples(rng, device) for _ in range(3)])
    damaged = samples.copy()
    damaged[device.window_pulses // 2] = complex(np.nan, np.inf)
    rows = [rows_of(program, sent) for sent in (samples, damaged)]
    assert np.isfinite(rows[1]).all()
    assert rows[1][0, 1] != rows[0][0, 1]
    np.testing.assert_allclose(rows[1][1:, 1], rows[0][1:, 1], atol=0.02)  # the mean taken off has seen one sample less


MOVING = STREAM.replace("float pulse[2 * DG_BINS];", "static float pulse[3 * DG_BINS];\n    int b;").replace(
    "if (n == 0)\n            window.weight[0] = 0.25f;",
    "for (b = 0; b < DG_BINS; b++)\n            window.weight[b] = pulse[2 * DG_BINS + b];",
)
"""Weights of all bins come with every pulse."""


def test_a_gate_that_follows_a_simulated_person_gives_what_analyze_gives(build, tmp_path):
    model = export_model_of("network", patch=SMALL, seed=3)
    walk = dg.motion.boulic_walk(speed_mps=1.0, height_m=1.75, duration_s=2.5)
    scene = dg.Scene(targets=[dg.Target(walk, label="human", range_m=4)], radar_position_m=(0, 0, 1))
    recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=500.0), rng=dg.rng(2), snr_db=10)
    times_s, range_m = (recording.baseband[name].values for name in ("slow_time", "range"))
    settings = CSettings(window_s=1.5, bins=range_m.size, still_time_s=None, n_examples=1)
    made = export_model(model, "c", tmp_path / "out", settings)
    device = plan(model, bins=range_m.size, window_s=1.5, still_time_s=None)
    seen = dg.analyze(recording, gate="truth")[0].signature
    expected = predict_network_probability(model, [patches.levels(seen[: device.n_stft], SMALL)])[0]
    # the window in the middle of whose interval the gate was where it is now
    centre_m = np.interp(times_s - device.taper.size // 2 / 500.0, seen["time"], seen["centre_range"])[:, None]
    bin_m = range_m[1] - range_m[0]
    inside = np.minimum(centre_m + 0.8, range_m + bin_m / 2) - np.maximum(centre_m - 0.8, range_m - bin_m / 2)
    samples = np.ascontiguousarray(recording.baseband.values).view(np.float32)
    rows = np.hstack([samples, np.clip(inside / bin_m, 0.0, 1.0)]).astype(np.float32)
    (tmp_path / "moving.c").write_text(MOVING)
    ((n, probability, *_),) = rows_of(build(made.folder, tmp_path / "moving.c"), rows)
    assert n == device.window_pulses
    assert abs(probability - expected[1]) < 1e-3
    assert 0.02 < expected[1] < 0.98


def test_silence_is_not_decided(build, tmp_path):
    model = export_model_of("network", patch=SMALL, abstain_below=0.0)
    made = export_model(model, "c", tmp_path / "out", CSettings(n_examples=1))
    (tmp_path / "stream.c").write_text(STREAM)
    silence = np.zeros(plan(model).window_pulses, np.complex64)
    assert rows_of(build(made.folder, tmp_path / "stream.c"), silence)[0, 3] == 0


def test_more_bins_can_be_chosen_by_the_compiler(build, tmp_path):
    made = export_model(export_model_of("network", patch=SMALL), "c", tmp_path / "out", CSettings(n_examples=1))
    (tmp_path / "stream.c").write_text(STREAM)
    build(made.folder, tmp_path / "stream.c", ["-DDG_BINS=31"])


def test_a_wrong_expectation_fails(build, tmp_path):
    made = export_model(export_model_of("network", patch=SMALL), "c", tmp_path / "out", CSettings(n_examples=1))
    golden = bytearray((made.folder / "golden.bin").read_bytes())
    golden[-4:] = np.float32(0.123).tobytes()
    (tmp_path / "wrong.bin").write_bytes(golden)
    done = run([str(build(made.folder)), str(tmp_path / "wrong.bin")], capture_output=True, text=True)
    assert done.returncode == 1


def test_networks_alone_keep_their_own_calibration():
    model = export_model_of("ensemble", patch=SMALL)
    net, _, slope, shift = list_parts(model)[-1]
    levels = np.empty(1, dtype=object)
    levels[0] = np.zeros((16, 16), np.float32)
    scores = slope * net.log_probability(levels) + shift
    expected = np.exp(scores) / np.exp(scores).sum()
    assert np.allclose(predict_network_probability(model, list(levels)), expected)
    assert select_networks(export_model_of("linear")) is None


def test_scales_come_from_held_rows_of_a_dataset(folder, tmp_path):
    found = collect_levels(folder, Patch(), 64, 5)
    assert 1 <= len(found) <= 5
    assert {each.shape for each in found} == {(64, 64)}
    assert max(each.max() for each in found) > 0.5
    made = export_model(
        export_model_of("network", patch=Patch()), "c", tmp_path / "out", CSettings(integers=True, data=folder)
    )
    assert made.facts["int8_examples"] == len(collect_levels(folder, Patch(), 64, 100))


@pytest.mark.parametrize(
    ("facts", "target", "words"),
    [
        ({"conditions": {}}, {}, "prf_hz; set --prf-hz"),
        ({"conditions": {"prf_hz": (300, 900), "carrier_hz": (7e9, 7e9)}}, {}, "300 to 900; set that of your radar"),
        ({}, {"prf_hz": 1000.0}, "--prf-hz 1000: the model was trained on 500 to 500"),
        ({"analysis": {"gate_doppler_hz": (-100, 100)}}, {}, "gate_doppler_hz"),
    ],
)
def test_a_radar_that_does_not_fit_is_refused(tmp_path, facts, target, words):
    with pytest.raises(ConfigError, match=words):
        export_model(export_model_of("network", patch=SMALL, **facts), "c", tmp_path / "out", CSettings(**target))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("integers", [False, True])
def test_a_model_without_a_network_is_refused(tmp_path, integers):
    with pytest.raises(ConfigError, match="--form c: the model trees has no network of signatures"):
        export_model(export_model_of("trees"), "c", tmp_path / "out", CSettings(integers=integers))
