"""A long recording that is computed while it is written has the bytes of the one made at once."""

import importlib
import pickle

import h5py
import numpy as np
import pytest

import doppelgait as dg
from doppelgait.core.errors import OutputError
from doppelgait.pipeline import parse_run, run_simulation

TILE = 300


def scene(rcs=None, **further):
    targets = [
        {"label": "human", "motion": {"kind": "human"}, "range_m": 4.0, **({"rcs": rcs} if rcs else {})},
        {"label": "dog", "motion": {"kind": "quadruped"}, "range_m": 3.0},
        {"background": True, "motion": {"kind": "fan"}, "range_m": 5.0},
    ]
    return {"duration_s": 2.03, "seed": 5, "targets": targets, "radar": X4, **further}


X4 = {"preset": "x4", "prf_hz": 500.0}
BEAM = {"kind": "cosine", "hpbw_azimuth_deg": 60.0, "hpbw_elevation_deg": 60.0}
CASES = {
    "impulse": scene(),
    "fmcw": scene(radar={"preset": "ti-77", "prf_hz": 600.0}),
    "cw": scene(radar={"preset": "xband-cw", "prf_hz": 500.0}),
    "no noise": scene(noise={"kind": "none"}),
    "a wanted SNR": scene(noise={"kind": "snr", "snr_db": 3.0}),
    "an environment": scene(environment=[{"kind": "ground_bounce"}]),
    "an antenna": scene(radar={**X4, "antenna": BEAM}),
    "gains of every pulse": scene({"kind": "surfaces", "occlusion": True}),
    "one target": scene(targets=scene()["targets"][:1]),
}


def make(table, **options):
    return run_simulation(parse_run(table, where="test", text="", folder=None), **options)


@pytest.mark.filterwarnings("ignore::doppelgait.core.errors.DoppelgaitWarning")
@pytest.mark.parametrize("case", CASES)
def test_tiles_give_the_bytes_of_the_whole(case, tmp_path, monkeypatch):
    make(CASES[case], path=tmp_path / "whole.h5")
    monkeypatch.setattr("doppelgait.core.lazy.LONG_PULSES", TILE)
    monkeypatch.setattr("doppelgait.radar.recordings.STORED_BYTES", 0)
    stored, tiled = make(CASES[case], path=tmp_path / "tiled.h5"), make(CASES[case])
    assert (tmp_path / "tiled.h5").read_bytes() == (tmp_path / "whole.h5").read_bytes()
    assert not stored.samples.in_memory
    assert tiled.samples.in_memory
    np.testing.assert_array_equal(stored.samples.rows(7, 9), tiled.samples.matrix[7:9])
    with h5py.File(tmp_path / "tiled.h5") as file:
        np.testing.assert_array_equal(file["baseband"][:], tiled.samples.matrix)
        np.testing.assert_array_equal(file["truth/0/aspect_rad"][:], tiled.truth[0].scatterers["aspect"].values)


@pytest.mark.filterwarnings("ignore::doppelgait.core.errors.DoppelgaitWarning")
@pytest.mark.parametrize(("case", "kind"), [("fmcw", "dc_leak"), ("impulse", "phase_noise")])
def test_impairments_of_tiles_are_those_of_the_whole(case, kind, monkeypatch):
    table = {**CASES[case], "impairments": [{"kind": kind}, {"kind": "frame_jitter", "sd_s": 1e-5}]}
    whole = make(table)
    monkeypatch.setattr("doppelgait.core.lazy.LONG_PULSES", TILE)
    tiled = pickle.loads(pickle.dumps(make(table)))
    np.testing.assert_array_equal(tiled.samples.matrix, whole.samples.matrix)
    for seen, there in zip(tiled.truth, whole.truth, strict=True):
        assert seen.scatterers.identical(there.scatterers)
        assert seen.scatterers.slow_time.values.tobytes() == tiled.slow_time_s.tobytes()


def test_a_file_that_cannot_be_made_is_refused_before_the_work(tmp_path, monkeypatch):
    module = importlib.import_module("doppelgait.pipeline.simulate")
    monkeypatch.setattr(module, "observe_scene", lambda *_, **__: pytest.fail("the scene was observed before"))
    for path, message in (("", "names no file"), (tmp_path / "none" / "a.h5", "no such folder")):
        with pytest.raises(OutputError, match=message):
            make(CASES["impulse"], path=path)


def test_only_one_tile_of_a_long_recording_is_computed_at_a_time(tmp_path, monkeypatch):
    monkeypatch.setattr("doppelgait.core.lazy.LONG_PULSES", TILE)
    module, sizes = importlib.import_module("doppelgait.pipeline.simulate"), []
    synthesise = module.synthesise_echoes

    def counted(scatterers, radar, *, compressed):
        sizes.append(scatterers.shape[0])
        return synthesise(scatterers, radar, compressed=compressed)

    monkeypatch.setattr(module, "synthesise_echoes", counted)
    scene = dg.Scene([dg.Target({"kind": "human"})], duration_s=2.03)
    radar = dg.Radar.preset("x4", prf_hz=500.0)
    recording = dg.simulate(scene, radar, rng=dg.rng(1), path=tmp_path / "a.h5")
    assert sum(sizes) == 2 * recording.n_pulses  # once for the level, once for the file
    assert max(sizes) == TILE
    sizes.clear()
    dg.simulate(scene, radar, rng=dg.rng(1))
    assert sum(sizes) == recording.n_pulses
