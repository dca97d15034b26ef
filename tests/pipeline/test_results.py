"""Results written and read again."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import xarray as xr

from doppelgait.core.errors import AnalysisError
from doppelgait.pipeline import (
    analysis_as_dict,
    analyze,
    parse_run,
    read_results,
    result_as_dict,
    run_simulation,
    write_results,
)
from doppelgait.pipeline.results import sniff_results
from doppelgait.processing import Analysis

WALK = {"kind": "boulic", "speed_mps": 1.3, "height_m": 1.75}
SCENE = {
    "duration_s": 3.0,
    "radar": {"preset": "x4"},
    "targets": [{"label": "human", "motion": WALK, "start_position_m": [6.0, 0.3], "heading_deg": 180.0}],
}
ANALYSES = {"truth": Analysis(hop=4), "track": Analysis(clutter="median"), "report": Analysis(method="liland2018")}


@pytest.fixture(scope="module")
def recording():
    return run_simulation(parse_run(SCENE, where="scene"))


@pytest.fixture(scope="module")
def written(recording, tmp_path_factory):
    """Results by name, each with its file."""
    folder, made = tmp_path_factory.mktemp("results"), {}
    for name, analysis in ANALYSES.items():
        results = analyze(recording, gate="track" if name == "track" else "truth", analysis=analysis)
        write_results(folder / f"{name}.h5", recording, results, analysis)
        made[name] = (folder / f"{name}.h5", results)
    return made


@pytest.mark.parametrize("name", ANALYSES)
def test_results_come_back_as_they_were(written, recording, name):
    path, results = written[name]
    read = read_results(path)
    assert (read.source, read.radar, read.analysis) == (recording.source, recording.radar, ANALYSES[name])
    assert len(read.targets) == len(results) == 1
    for target, result in zip(read.targets, results, strict=True):
        assert target.facts == result_as_dict(result)
        for array in ("signature", "cadence_map", "cadence_spectrum"):
            found, expected = getattr(target, array), getattr(result, array)
            beside = [name for name in expected.coords if name not in (*expected.dims, "velocity")]
            xr.testing.assert_allclose(found, expected.drop_vars(beside), rtol=1e-12)
            np.testing.assert_array_equal(found.values, expected.values)
            assert found.attrs["units"] == expected.attrs["units"]
        np.testing.assert_array_equal(target.main_line_hz, result.main_line_hz)
        assert target.gate == result.gate


def test_files_of_older_versions_have_no_main_line(written, tmp_path):
    older = tmp_path / "older.h5"
    older.write_bytes(written["truth"][0].read_bytes())
    with h5py.File(older, "r+") as file:
        del file["targets/0/main_line_hz"]
    (target,) = read_results(older).targets
    assert target.main_line_hz is None


def test_no_target_is_a_result_too(recording, tmp_path):
    write_results(tmp_path / "none.h5", recording, [], Analysis())
    assert read_results(tmp_path / "none.h5").targets == ()


DAMAGE = {
    "format": lambda file: file.attrs.modify("format", "something-else"),
    "format_version": lambda file: file.attrs.modify("format_version", 99),
    "radar": lambda file: file.attrs.modify("radar", "{"),
    "analysis": lambda file: file.attrs.modify("analysis", '{"cpi_s": -1}'),
    "signature": lambda file: file["targets/0"].pop("signature"),
    "dims": lambda file: file["targets/0/signature"].attrs.modify("dims", '["doppler", "time"]'),
    "time_s": lambda file: (file["targets/0"].pop("time_s"), file.__setitem__("targets/0/time_s", np.arange(3.0))),
    "main_line_hz": lambda file: (
        file["targets/0"].pop("main_line_hz"), file.__setitem__("targets/0/main_line_hz", np.zeros(3))
    ),
    "flags": lambda file: file["targets/0"].attrs.modify("flags", "["),
    "gate": lambda file: file["targets/0"].pop("gate"),
    "a": lambda file: file["targets"].move("0", "a"),
}  # fmt: skip


@pytest.mark.parametrize("part", DAMAGE)
def test_damage_is_told(written, tmp_path, part):
    path = tmp_path / "damaged.h5"
    path.write_bytes(written["truth"][0].read_bytes())
    with h5py.File(path, "r+") as file:
        DAMAGE[part](file)
    with pytest.raises(AnalysisError, match=r"damaged\.h5: is damaged or no result"):
        read_results(path)


def test_what_is_no_result_file(written, tmp_path):
    assert sniff_results(written["truth"][0])
    torn = tmp_path / "torn.h5"
    torn.write_bytes(written["truth"][0].read_bytes()[:-2000])
    text = tmp_path / "text.h5"
    text.write_text("no")
    for path in (torn, text, tmp_path, tmp_path / "nothing.h5"):
        assert not sniff_results(path)
        with pytest.raises(AnalysisError, match=path.name):
            read_results(path)


def test_pauses_between_bursts_count_as_observed():
    recording = run_simulation(parse_run({"duration_s": 0.1, "targets": [{"motion": {"kind": "boulic"}}]}))
    assert analysis_as_dict(recording, [])["recording"]["observation_s"] == pytest.approx(0.1, rel=1e-9)
    n = recording.n_pulses
    paused = recording.baseband.coords["slow_time"].values + 0.4 * (np.arange(n) >= n // 2)
    bursts = recording.with_baseband(recording.baseband.assign_coords(slow_time=("slow_time", paused, {"units": "s"})))
    assert analysis_as_dict(bursts, [])["recording"]["observation_s"] == pytest.approx(0.5, rel=1e-9)
