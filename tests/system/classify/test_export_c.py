"""Exported C compiles without a warning, answers as Python does, and rings for a person from the samples on."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.classify import classify_over_time, export_model, load_shipped_model
from doppelgait.classify.c_code import CSettings, drop_features, plan_device
from doppelgait.core.errors import ConfigError
from export_models import export_model_of, model_of_tracks, random_track_network, require
from processes import run

FLAGS = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2"]
X4 = dg.Radar.preset("x4", prf_hz=500.0)
PAGE = Path(__file__).parents[3] / "docs" / "howto" / "export.md"
EXAMPLE = next(part for part in re.findall(r"```c\n(.*?)```", PAGE.read_text(), re.DOTALL) if "int main" in part)
LINE = re.compile(r"([\d.]+) s, ([-\d.]+) m: (\S+) ([\d.]+)(, alarm)?")


@pytest.fixture
def build(tmp_path):
    """Compile a program of an export; returns its path."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    require(compiler, "a C compiler, gcc or cc")

    def build(folder, program, *more):
        place, text = tmp_path / program, tmp_path / "example.c"
        text.write_text(EXAMPLE)
        sources = [str(text if program == "example" else folder / f"{program}.c"), str(folder / "doppelgait_model.c")]
        done = run([compiler, *FLAGS, *more, "-I", str(folder), *sources, "-lm", "-o", str(place)],
                   capture_output=True, text=True)  # fmt: skip
        assert (done.returncode, done.stderr) == (0, "")
        return str(place)

    return build


def random_model(n_classes=3, **facts):
    network = random_track_network(np.random.default_rng(n_classes), n_classes)
    model = model_of_tracks(3, network)[0]
    stated = {"classes": tuple("abcd"[:n_classes]), "alarm": "b", "alarm_threshold": 0.6, **facts}
    calibration = replace(model.calibration, shift=np.linspace(0.0, 0.4, n_classes))
    return replace(model, facts=model.facts.model_copy(update=stated), calibration=calibration)


def listen(program, samples):
    """Rows of time, range, class, probability and alarm that the example prints."""
    done = run([program], input=np.ascontiguousarray(samples, np.complex64).tobytes(), capture_output=True)
    rows = [LINE.fullmatch(line).groups() for line in done.stdout.decode().splitlines()]
    return [(float(at_s), float(range_m), label, float(p), bool(alarm)) for at_s, range_m, label, p, alarm in rows]


@pytest.mark.parametrize("integers", [False, True])
@pytest.mark.parametrize("n_classes", [2, 3])
def test_pictures_are_answered_as_in_python_in_the_memory_that_is_stated(build, tmp_path, n_classes, integers):
    made = export_model(random_model(n_classes), "c", tmp_path / "out", CSettings(X4, integers=integers, n_examples=60))
    program = build(made.folder, "selftest")
    done = run([program, str(made.folder / "golden.bin")], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    count, apart, radar = re.search(r"(\d+) pictures.*at most (\S+); (\d+) bytes of a radar", done.stdout).groups()
    assert (int(count), int(radar) < 250_000) == (60, True)
    assert float(apart) < 1e-5
    golden = bytearray((made.folder / "golden.bin").read_bytes())
    found = np.frombuffer(bytes(golden), np.float32)[2:].reshape(60, -1)[:, -n_classes:]
    assert np.allclose(found.sum(axis=1), 1.0, atol=1e-5)
    assert found.std(axis=0).min() > 0.01
    golden[-4:] = np.float32(found[-1, -1] + 0.1).tobytes()
    (tmp_path / "wrong.bin").write_bytes(golden)
    assert run([program, str(tmp_path / "wrong.bin")], capture_output=True).returncode == 1


def test_integers_take_a_quarter_of_the_memory_of_kernels_and_change_little(tmp_path):
    model = load_shipped_model("x4")
    found = [export_model(model, "c", tmp_path / f"{n}", CSettings(X4, integers=n)) for n in (False, True)]
    whole, small = (one.facts["flash_table_bytes"] for one in found)
    n_weights = sum(own.size for name, own in model.of_tracks.learned.arrays.items() if "kernel" in name)
    assert whole - small == 3 * n_weights
    golden = [np.fromfile(one.folder / "golden.bin", np.float32)[2:].reshape(16, -1)[:, -3:] for one in found]
    assert 0.0 < np.abs(golden[0] - golden[1]).max() < 0.05
    assert "the model of windows" in found[0].facts["left_out"]


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("exported") / "x4"
    return export_model(load_shipped_model("x4"), "c", folder, CSettings(X4)).folder


def walk(motion, **place):
    scene = dg.Scene([dg.Target(motion, label="x", **place)], duration_s=6.0)
    return dg.simulate(scene, X4, rng=dg.rng(4))


def test_from_samples_to_an_alarm_as_in_python(build, exported):
    model = load_shipped_model("x4").of_tracks
    bare = replace(model, learned=drop_features(model.learned))
    program = build(exported, "example")
    person, dog = {"kind": "human", "speed_mps": 1.0}, {"kind": "quadruped", "gait": "walk", "speed_mps": 0.8}
    for motion, wanted in ((person, "human"), (dog, "animal")):
        recording = walk(motion)
        rows, expected = listen(program, recording.samples.matrix), classify_over_time(recording, bare)[-1]
        at_s, range_m, label, probability, alarm = rows[-1]
        assert label == expected.label == wanted
        assert alarm == expected.alarm == (wanted == "human")
        assert abs(probability - expected.probabilities["human"]) < 0.05
        assert abs(range_m - expected.range_m) < 0.15
        assert 5.5 < at_s <= 6.0
        assert not rows[0][-1]  # two windows confirm an alarm


@pytest.mark.parametrize("range_stop_m", [0.6, 1.6, 3.1, 9.6])
def test_noise_is_no_target_for_any_number_of_bins(build, tmp_path, range_stop_m):
    radar = X4.model_copy(update={"range_stop_m": range_stop_m})
    made = export_model(load_shipped_model("x4"), "c", tmp_path / "out", CSettings(radar))
    empty = dg.simulate(dg.Scene([], duration_s=20.0), radar, rng=dg.rng(5))
    white = np.random.default_rng(1).normal(size=(10_000, radar.n_range_bins, 2)) @ [1, 1j]
    program = build(made.folder, "example")
    for samples in (empty.samples.matrix, white):
        assert [row for row in listen(program, samples) if row[2] != "-" or row[-1]] == []


def test_noise_spikes_and_silence_are_no_target_as_in_python_and_a_person_after_them_is(build, exported):
    program, rng = build(exported, "example"), np.random.default_rng(3)
    model, shape = load_shipped_model("x4").of_tracks, (2000, X4.n_range_bins)
    person = np.asarray(walk({"kind": "human", "speed_mps": 1.0}).samples.matrix)
    level = np.abs(person[0]).max()
    for number in range(42):
        samples = 1e-3 * level * rng.normal(size=(*shape, 2)) @ [1, 1j] * (number < 40)
        if number % 2:
            samples[rng.integers(0, shape[0], 6)] += level * rng.normal(size=shape[1]) * (number < 40)
        rows = listen(program, samples)
        assert [row for row in rows if row[2] != "-" or row[-1]] == [], number
        if number in (0, 1):
            coords = {"slow_time": np.arange(shape[0]) / X4.prf_hz, "range": X4.range_axis_m()}
            baseband = dg.core.labels.make_array(dg.core.labels.BASEBAND, samples, coords, {})
            recording = dg.radar.Recording.from_baseband(baseband, X4, source="noise")
            assert [one for one in classify_over_time(recording, model) if one.label or one.alarm] == []
        if number > 37:
            after = listen(program, np.concatenate([samples, person]))
            assert (after[-1][2], after[-1][-1]) == ("human", True), number


def test_the_end_of_a_target_is_a_decision_without_alarm(build, exported):
    person = np.asarray(walk({"kind": "human", "speed_mps": 1.0}).samples.matrix)
    empty = np.asarray(dg.simulate(dg.Scene([], duration_s=5.0), X4, rng=dg.rng(5)).samples.matrix)
    rows = listen(build(exported, "example"), np.concatenate([person, empty]))
    alarms = [row[-1] for row in rows]
    assert alarms.index(True) < len(alarms) - 1
    assert rows[-1][2:] == ("-", pytest.approx(1 / 3, abs=1e-3), False)


def test_samples_that_are_no_numbers_cost_no_later_decision(build, exported):
    program, samples = build(exported, "example"), np.array(walk({"kind": "human", "speed_mps": 1.0}).samples.matrix)
    whole = listen(program, samples)
    samples[700, ::3] = complex(np.nan, np.inf)
    damaged = listen(program, samples)
    assert damaged[-1][2] == whole[-1][2] == "human"
    assert abs(damaged[-1][1] - whole[-1][1]) < 0.1


def test_a_range_transform_makes_the_bins_of_sweeps(build, exported):
    matrix = np.asarray(walk({"kind": "human", "speed_mps": 1.0}).samples.matrix)
    beat = np.zeros((len(matrix), 256), np.complex128)
    beat[:, : matrix.shape[1]] = matrix
    expected, found = (
        listen(build(exported, "example", *flags), samples)
        for flags, samples in (((), matrix), (("-DSAMPLES=256",), np.fft.ifft(beat, axis=1)))
    )
    assert [row[:3] for row in found] == [row[:3] for row in expected]


@pytest.mark.parametrize(
    ("model", "radar", "words"),
    [
        (random_model(), dg.Radar.preset("ancortek-24"), "--radar: carrier_hz .* is outside the accepted range"),
        (random_model(), X4.model_copy(update={"prf_hz": 90.0}), "--radar: prf_hz 90 is outside"),
        (random_model(alarm=None), X4, "is no network of tracks with pictures and an alarm"),
        (export_model_of("trees"), X4, "--form c: trees is no network of tracks"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, model, radar, words):
    with pytest.raises(ConfigError, match=words):
        export_model(model, "c", tmp_path / "out", CSettings(radar))
    assert not (tmp_path / "out").exists()
    with pytest.raises(ConfigError, match="which needs --radar"):
        export_model(model, "c", tmp_path / "out")


def test_a_window_of_the_device_is_that_of_the_model():
    device = plan_device(load_shipped_model("x4").of_tracks, CSettings(X4))
    assert device.n_columns == 24
    assert device.taper.size + 4 * device.hop * device.n_columns == pytest.approx(2.5 * 500.0, abs=50)
