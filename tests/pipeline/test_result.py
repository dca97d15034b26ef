"""Results written and read again."""

import json
import math
import pickle
from dataclasses import replace
from functools import partial

import h5py
import hypothesis.extra.numpy as stnp
import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from doppelgait import pipeline
from doppelgait.cli.analyze import print_features
from doppelgait.core.errors import AnalysisError, ConfigError, OutputError
from doppelgait.core.labels import CADENCE_MAP, CADENCE_SPECTRUM, NORMALISED_SIGNATURE, SIGNATURE, Signal, make_array
from doppelgait.features import GaitFeatures
from doppelgait.pipeline.result import LABELLED_ARRAYS, LateArrays
from doppelgait.pipeline.result_files import is_result_file
from doppelgait.pipeline.target import Gated, analyze_signature, analyze_targets
from doppelgait.processing import Analysis, Gate

WALK = {"kind": "boulic", "speed_mps": 1.3, "height_m": 1.75}
SCENE = {
    "duration_s": 3.0,
    "radar": {"preset": "x4"},
    "targets": [{"label": "human", "motion": WALK, "start_position_m": [6.0, 0.3], "heading_deg": 180.0}],
}
ANALYSES = {
    "truth": Analysis(hop=4), "track": Analysis(clutter="median"), "report": Analysis(method="liland2018"),
    "parts": Analysis(parts=True),
}  # fmt: skip


@pytest.fixture(scope="module")
def recording():
    return pipeline.run_simulation(pipeline.parse_run(SCENE, where="scene"))


@pytest.fixture(scope="module")
def written(recording, tmp_path_factory):
    """Results by name, each with its file."""
    folder, made = tmp_path_factory.mktemp("results"), {}
    for name, analysis in ANALYSES.items():
        results = pipeline.analyze(recording, gate="track" if name == "track" else "truth", analysis=analysis)
        pipeline.write_results(folder / f"{name}.h5", recording, results)
        made[name] = (folder / f"{name}.h5", results)
    return made


def test_targets_are_analysed_together_as_alone(recording):
    first = pipeline.analyze(recording, gate="truth", analysis=Analysis(hop=10))[0]
    mu, rng = first.signature, np.random.default_rng(4)
    noise = 0.3 * mu.values.max() * rng.exponential(size=mu.shape).astype(np.float32)
    still, silence = np.broadcast_to(mu.values[:1], mu.shape).copy(), np.zeros_like(mu.values)
    several = [mu, mu[:200], mu[:, 1:], mu[40:240], *(mu.copy(data=values) for values in (noise, still, silence))]
    several += [mu.copy(data=mu.values + level * noise) for level in np.linspace(0.0, 1.0, 6, dtype=np.float32)]
    analyses = [Analysis(method="liland2018") if n == 7 else Analysis(normalisation="r4") for n in range(len(several))]
    gates, labels = [first.gate] * len(several), [str(n) for n in range(len(several))]
    signals = [Signal.of(mu, SIGNATURE) for mu in several]
    together = analyze_targets([Gated(*facts) for facts in zip(signals, gates, analyses, labels, strict=True)])
    assert together == [
        analyze_signature(mu, first.gate, analysis, label=label)
        for mu, analysis, label in zip(several, analyses, labels, strict=True)
    ]
    assert len({result.gait_frequency_hz for result in together}) > 5
    assert analyze_targets([]) == []


@pytest.mark.parametrize("name", ANALYSES)
def test_results_come_back_as_they_were(written, recording, name):
    path, results = written[name]
    read = pipeline.read_results(path)
    assert (read.source, read.radar) == (recording.source, recording.radar)
    assert read.targets == tuple(results)
    assert [target.analysis for target in read.targets] == [ANALYSES[name].resolved(name)]
    for target, result in zip(read.targets, results, strict=True):
        assert ("torso_velocity_mps" in result.arrays) == (ANALYSES[name].method == "standard")
        assert (target.parts is None) == (name != "parts")
        if target.parts is not None:
            xr.testing.assert_identical(target.parts, result.parts)


def test_parts_are_there_where_they_were_asked_for(written, recording):
    (plain,), (_, (result,)) = pipeline.analyze(recording, gate="truth"), written["parts"]
    assert plain.parts is None
    assert result.features == plain.features
    assert result.flags == plain.flags
    parts = result.parts
    assert parts["power"].shape == (3, *result.signature.shape)
    assert [result.quality[f"{name}_energy_share"] for name in ("torso", "legs", "limbs")] == pytest.approx(
        parts["share"].values
    )
    assert np.nanmedian(parts["velocity_mps"].values[0]) == pytest.approx(plain.features.torso_velocity_mps, rel=0.06)
    slow = pipeline.analyze(recording, gate="truth", analysis=Analysis(parts=True, cpi_s=0.02))[0]
    assert slow.parts is None
    assert slow.flags[-1] == "parts:torso_slower_than_3_doppler_cells"


def test_segments_share_what_they_have_in_common_on_disk(written):
    path, (result,) = written["track"]
    assert result.segments
    with h5py.File(path) as file:
        longest = next(s for s in file["targets/0/segments"].values() if s["signature"] == file["targets/0/signature"])
        assert longest["cadence_map"] == file["targets/0/cadence_map"]


@pytest.mark.parametrize("plain", [{}, [], {"label": None, "gate": "truth"}])
def test_a_document_that_is_no_whole_result_is_one_error(plain):
    with pytest.raises(AnalysisError, match=r"this document of a result has no .*; make it with Result.to_json\(\)"):
        pipeline.Result.from_json(plain)
    with pytest.raises(AnalysisError, match=r"this row of a result has no .*; make it with Result.to_row\(\)"):
        pipeline.Result.from_row(plain, Analysis())


def test_what_a_row_does_not_hold_is_an_error(written):
    (result,) = written["truth"][1]
    read = pipeline.Result.from_row(result.to_row(), result.analysis, label=result.label)
    assert read.to_json(arrays=False) == result.to_json(arrays=False)
    for name in (*LABELLED_ARRAYS, "main_line_hz", "torso_velocity_mps", "gate"):
        with pytest.raises(AnalysisError, match=f"has no {name}"):
            getattr(read, name)


NUMBERS = st.none() | st.floats()
WORDS = st.text("abcdefghij_ 0123456789:ü", min_size=1, max_size=12)
MAPPINGS = st.dictionaries(WORDS, NUMBERS, max_size=3)


def arrays(draw):
    """Arrays of one result; values may be anything that float32 and float64 hold."""
    n, k = draw(st.integers(1, 3)), draw(st.integers(1, 3))

    def values(dtype, *shape):
        return draw(stnp.arrays(dtype, shape, elements=st.floats(width=32)))

    time, doppler, cadence = values("f8", n), values("f8", k), values("f8", 2)
    rows = {"doppler": doppler, "velocity": ("doppler", values("f8", k))}
    facts = {"prf_hz": draw(st.floats()), "hop": draw(st.integers(1, 9)), "gate": draw(WORDS)}
    share = {"gate_share": ("time", values("f8", n), {"units": "1"})}
    made = {
        "signature": make_array(SIGNATURE, values("f4", n, k), {"time": time, **rows, **share}, facts),
        "normalised_signature": make_array(NORMALISED_SIGNATURE, values("f4", n, k), {"time": time, **rows}),
        "cadence_map": make_array(CADENCE_MAP, values("f8", 2, k), {"cadence": cadence, **rows}, {"aligned": True}),
        "cadence_spectrum": make_array(CADENCE_SPECTRUM, values("f8", 2), {"cadence": cadence}),
        "mean_doppler_spectrum": values("f8", k),
        "main_line_hz": values("f8", n),
    }
    return {name: made[name] for name in made if draw(st.booleans())}


@st.composite
def any_results(draw, *, depth=1):
    """Results with NaN, infinity, None, empty mappings and flags, with and without arrays, gate and segments."""
    band_hz = draw(st.none() | st.tuples(st.floats(allow_nan=False), st.floats(allow_nan=False)))
    gate = Gate.fixed(1.0, draw(st.floats(1.5, 9.0)), time_s=[0.0, draw(st.floats(0.1, 9.0))])
    return pipeline.Result(
        analysis=draw(st.sampled_from([Analysis(), Analysis(clutter="mean", hop=3), Analysis(method="liland2018")])),
        label=draw(st.none() | st.just("") | WORDS),
        gate_source=draw(st.sampled_from(["truth", "track", "given"])),
        features=GaitFeatures(*draw(st.tuples(*[NUMBERS] * 6))),
        gait_frequency_hz=draw(NUMBERS),
        torso_doppler_hz=draw(NUMBERS),
        n_periods=draw(NUMBERS),
        quality=draw(st.dictionaries(WORDS, NUMBERS | WORDS | st.integers(-9, 9) | st.booleans(), max_size=3)),
        flags=tuple(draw(st.lists(WORDS, max_size=3))),
        extended=draw(MAPPINGS),
        standard_deviation=draw(MAPPINGS),
        arrays=arrays(draw),
        gate_limits=draw(st.none() | st.just(replace(gate, doppler_hz=band_hz))),
        segments=tuple(draw(st.lists(any_results(depth=depth - 1), max_size=2))) if depth else (),
    )


@given(result=any_results())
@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
def test_every_result_comes_back_exactly(result, recording, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "any.h5"
    pipeline.write_results(path, recording, [result])
    assert pipeline.read_results(path).targets == (result,)
    assert pipeline.Result.from_json(json.loads(json.dumps(result.to_json()))) == result
    row = pipeline.Result.from_row({"id": "other column", **result.to_row()}, result.analysis, label=result.label)
    assert row == replace(result, arrays={}, gate_limits=None, segments=())
    columns = {"quality_flags" if name == "flags" else name: value for name, value in result.to_row().items()}
    assert pipeline.Result.from_row(columns, result.analysis, label=result.label) == row  # as in the index of a dataset


@given(first=any_results(), second=any_results())
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_results_that_differ_are_not_equal(first, second):
    same = json.dumps(first.to_json(), sort_keys=True) == json.dumps(second.to_json(), sort_keys=True)
    assert (first == second) == same
    assert first != replace(first, flags=(*first.flags, "another"))
    assert first != replace(first, quality={**first.quality, "further": math.nan})


def test_a_result_is_shown_in_a_few_lines(written):
    result = written["truth"][1][0]
    shown = repr(result)
    assert shown.startswith(f"Result of {result.label}, gate {result.gate_source}\n  torso_velocity_mps ")
    assert f"gait_frequency_hz {result.gait_frequency_hz:.4g}" in shown
    assert shown.index("step length on the ground") < shown.index("step length, radial")
    assert repr(pipeline.Result(Analysis(), flags=("a",), segments=(result,))).endswith("segments 1, flags a")


def test_results_for_no_folder_and_one_result_alone_are_refused(recording, tmp_path):
    with pytest.raises(OutputError, match=r"x\.h5: cannot be written: no such folder .*nope$"):
        pipeline.write_results(tmp_path / "nope" / "x.h5", recording, [])
    with pytest.raises(ConfigError, match=r"takes a list of results; write one as .*\[result\]"):
        pipeline.write_results(tmp_path / "x.h5", recording, pipeline.Result(Analysis()))
    assert not list(tmp_path.iterdir())
    pipeline.write_results(tmp_path / "none.h5", recording, [])
    assert pipeline.read_results(tmp_path / "none.h5").targets == ()


DAMAGE = {
    "format": lambda file: file.attrs.modify("format", "something-else"),
    "format_version": lambda file: file.attrs.modify("format_version", 99),
    "radar": lambda file: file.attrs.modify("radar", "{"),
    "analysis": lambda file: file["targets/0"].attrs.modify("analysis", '{"cpi_s": -1}'),
    "signature": lambda file: file["targets/0"].pop("signature"),
    "dims": lambda file: file["targets/0/signature"].attrs.modify("dims", '["doppler", "time"]'),
    "time": lambda file: file["targets/0/axes/signature"].pop("time"),
    "main_line_hz": lambda file: (
        file["targets/0"].pop("main_line_hz"), file.__setitem__("targets/0/main_line_hz", np.zeros(3))
    ),
    "flags": lambda file: file["targets/0"].attrs.modify("flags", "["),
    "gate": lambda file: file["targets/0/gate_limits"].pop("time_s"),
    "a": lambda file: file["targets"].move("0", "a"),
}  # fmt: skip


@pytest.mark.parametrize("part", DAMAGE)
def test_damage_is_told(written, tmp_path, part):
    path = tmp_path / "damaged.h5"
    path.write_bytes(written["truth"][0].read_bytes())
    with h5py.File(path, "r+") as file:
        DAMAGE[part](file)
    with pytest.raises(AnalysisError, match=r"damaged\.h5: is (damaged or not|a result .* version 99)"):
        pipeline.read_results(path)


def test_what_is_no_result_file(written, tmp_path):
    assert is_result_file(written["truth"][0])
    torn = tmp_path / "torn.h5"
    torn.write_bytes(written["truth"][0].read_bytes()[:-2000])
    text = tmp_path / "text.h5"
    text.write_text("no")
    for path in (torn, text, tmp_path, tmp_path / "nothing.h5"):
        assert not is_result_file(path)
        with pytest.raises(AnalysisError, match=path.name):
            pipeline.read_results(path)


def test_pauses_between_bursts_count_as_observed():
    recording = pipeline.run_simulation(
        pipeline.parse_run({"duration_s": 0.1, "targets": [{"motion": {"kind": "boulic"}}]})
    )
    assert pipeline.describe_results(recording, [])["recording"]["observation_s"] == pytest.approx(0.1, rel=1e-9)
    n = recording.n_pulses
    paused = recording.baseband.coords["slow_time"].values + 0.4 * (np.arange(n) >= n // 2)
    bursts = recording.with_baseband(recording.baseband.assign_coords(slow_time=("slow_time", paused, {"units": "s"})))
    assert pipeline.describe_results(bursts, [])["recording"]["observation_s"] == pytest.approx(0.5, rel=1e-9)


def test_late_arrays_are_made_once_and_when_they_are_asked_for():
    made = []
    arrays = LateArrays({"other": 1}, late=lambda: made.append(1) or np.arange(3))
    assert set(LateArrays(arrays, again=2)) == {"other", "late", "again"}
    assert not made
    assert arrays["late"] is arrays["late"]
    assert len(made) == 1
    copied = pickle.loads(pickle.dumps(LateArrays(late=partial(np.arange, 3))))
    np.testing.assert_array_equal(copied["late"], np.arange(3))


def test_people_see_the_step_length_on_the_ground_first_and_doubts_next_to_values(capsys):
    features = GaitFeatures(torso_velocity_mps=-1.5, step_length_m=2.06, harmonic_ratio_2=2.0)
    sure = pipeline.Result(
        Analysis(), features=features, gait_frequency_hz=0.745, quality={"ground_step_length_m": 2.14}
    )
    doubtful = replace(sure, flags=("low_confidence",), quality={})
    assert list(sure.shown_features)[2:4] == ["ground_step_length_m", "step_length_m"]
    assert "ground_step_length_m" not in doubtful.shown_features
    assert "ground_step_length_m" not in sure.to_json()["features"]
    print_features([sure, doubtful])
    rows = {line.split()[0]: line.split() for line in capsys.readouterr().out.splitlines()}
    assert list(rows)[3:5] == ["ground_step_length_m", "step_length_m"]
    assert rows["ground_step_length_m"][-3:] == ["m", "2.140", "-"]
    assert rows["step_length_m"][-3:] == ["2.060", "2.060", "?"]
    assert "2.06 ?" in doubtful._repr_html_()
