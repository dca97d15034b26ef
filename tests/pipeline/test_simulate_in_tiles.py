"""A long recording that is computed while it is written has the bytes of the one made at once."""

import importlib

import h5py
import numpy as np
import pytest

import doppelgait as dg
from doppelgait.pipeline import Conditions, parse_run, run_simulation
from doppelgait.radar.recordings import write_recording

TILE = 300


@pytest.fixture
def small_tiles(monkeypatch):
    for module in ("core.lazy", "pipeline.simulate"):
        monkeypatch.setattr(importlib.import_module(f"doppelgait.{module}"), "LONG_PULSES", TILE)


def scene(**changes):
    targets = [
        {"label": "human", "motion": {"kind": "human"}, "range_m": 4.0, **changes},
        {"label": "dog", "motion": {"kind": "quadruped"}, "range_m": 3.0},
        {"background": True, "motion": {"kind": "fan"}, "range_m": 5.0},
    ]
    return {"duration_s": 2.03, "seed": 5, "targets": targets}


CASES = {
    "impulse": {**scene(), "radar": {"preset": "x4", "prf_hz": 500.0}},
    "fmcw": {**scene(), "radar": {"preset": "ti-77", "prf_hz": 600.0}},
    "cw": {**scene(), "radar": {"preset": "xband-cw", "prf_hz": 500.0}},
    "no noise": {**scene(), "radar": {"preset": "x4", "prf_hz": 500.0}, "noise": {"kind": "none"}},
    "a wanted SNR": {**scene(), "radar": {"preset": "x4", "prf_hz": 500.0}, "noise": {"kind": "snr", "snr_db": 3.0}},
    "an environment": {
        **scene(), "radar": {"preset": "x4", "prf_hz": 500.0}, "environment": [{"kind": "ground_bounce"}],
    },
    "an antenna": {
        **scene(), "radar": {
            "preset": "x4", "prf_hz": 500.0, "antenna": {"kind": "cosine", "hpbw_azimuth_deg": 60.0,
            "hpbw_elevation_deg": 60.0},
        },
    },
    "gains of every pulse": {
        **scene(rcs={"kind": "ellipsoids", "occlusion": True}), "radar": {"preset": "x4", "prf_hz": 500.0},
    },
    "one target": {
        "duration_s": 2.03, "targets": scene()["targets"][:1], "radar": {"preset": "x4", "prf_hz": 500.0},
    },
}  # fmt: skip


def make(table, **options):
    return run_simulation(parse_run(table, where="test", text="", folder=None), **options)


@pytest.mark.filterwarnings("ignore::doppelgait.core.errors.DoppelgaitWarning")
@pytest.mark.parametrize("case", CASES)
def test_tiles_give_the_bytes_of_the_whole(case, tmp_path, small_tiles):
    whole, tiled = make(CASES[case]), make(CASES[case], in_tiles=True)
    assert whole.samples.in_memory
    assert not tiled.samples.in_memory
    write_recording(whole, tmp_path / "whole.h5")
    write_recording(tiled, tmp_path / "tiled.h5")
    assert (tmp_path / "tiled.h5").read_bytes() == (tmp_path / "whole.h5").read_bytes()
    np.testing.assert_array_equal(tiled.samples.rows(7, 9), whole.samples.matrix[7:9])
    with h5py.File(tmp_path / "tiled.h5") as file:
        np.testing.assert_array_equal(file["baseband"][:], whole.samples.matrix)
        np.testing.assert_array_equal(file["truth/0/aspect_rad"][:], whole.truth[0].scatterers["aspect"].values)


def test_short_recordings_and_impairments_are_made_at_once(small_tiles):
    table = CASES["one target"]
    assert make({**table, "duration_s": 0.5}, in_tiles=True).samples.in_memory
    assert make({**table, "impairments": [{"kind": "dc_leak"}]}, in_tiles=True).samples.in_memory


def test_only_one_tile_of_a_long_recording_is_computed_at_a_time(tmp_path, small_tiles, monkeypatch):
    module, sizes = importlib.import_module("doppelgait.pipeline.simulate"), []
    pulses = module._read_pulses

    def counted(scatterers, first, stop):
        part = pulses(scatterers, first, stop)
        sizes.append(part.sizes["slow_time"])
        return part

    monkeypatch.setattr(module, "_read_pulses", counted)
    recording = dg.simulate(
        dg.Scene([dg.Target({"kind": "human"})], duration_s=2.03), dg.Radar.preset("x4", prf_hz=500.0),
        rng=dg.rng(1), conditions=Conditions(), in_tiles=True,
    )  # fmt: skip
    write_recording(recording, tmp_path / "a.h5")
    assert sum(sizes) == 2 * recording.n_pulses  # once for the level, once for the file
    assert max(sizes) == TILE
