"""Receiver noise (E-18), its level after the transform (section 6, test 6) and random streams."""

import numpy as np
import pytest

from doppelgait.core.rng import rng
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.pipeline import parse_run, run_simulation, simulate
from doppelgait.radar import Radar, noise_power_v2
from doppelgait.scene import Scene, Target


@pytest.mark.parametrize("snr_db", [None, 10.0])
def test_noise_of_a_recording_has_the_correlation_of_its_radar_e18c(scene, snr_db):
    """At the radar's own level and at a stated one."""
    radar = Radar.preset("x4")
    noisy, quiet = (simulate(scene, radar, rng=rng(1), snr_db=db) for db in (snr_db, np.inf))
    difference = (noisy.baseband.values - quiet.baseband.values).astype(complex) / np.sqrt(noisy.noise_power_v2)
    found = [np.mean(difference[:, lag:] * difference[:, :-lag].conj()) for lag in (1, 2, 3)]
    assert found == pytest.approx([0.633, 0.141, 0.006], abs=0.01)
    assert np.mean(np.abs(difference) ** 2) == pytest.approx(1.0, rel=0.01)


@pytest.fixture(scope="module")
def scene():
    return Scene([Target(boulic_walk(speed_mps=1.2, height_m=1.8, duration_s=3.0))])


@pytest.mark.parametrize("snr_db", [-5.0, 10.0, 25.0])
def test_requested_snr_is_met_e18(scene, snr_db):
    radar = Radar.preset("x4")
    clean = simulate(scene, radar, rng=rng(2), snr_db=np.inf).baseband.values.astype(np.complex128)
    recording = simulate(scene, radar, rng=rng(2), snr_db=snr_db)
    added = recording.baseband.values - clean
    signal = (np.abs(clean) ** 2).max(axis=1).mean()
    measured_db = 10 * np.log10(signal / np.mean(np.abs(added) ** 2))
    assert measured_db == pytest.approx(snr_db, abs=0.1)
    assert recording.snr_frame_db == pytest.approx(snr_db, abs=1e-6)
    assert recording.noise_power_v2 == pytest.approx(np.mean(np.abs(added) ** 2), rel=0.01)


def test_thermal_noise_is_the_default_and_no_generator_means_no_noise(scene):
    radar = Radar.preset("x4")
    clean = simulate(scene, radar)
    assert clean.noise_power_v2 == 0
    assert clean.snr_frame_db == np.inf
    thermal, endless = simulate(scene, radar, rng=rng(3)), simulate(scene, radar, rng=rng(3), snr_db=np.inf)
    added = thermal.baseband.values.astype(np.complex128) - endless.baseband.values
    assert np.mean(np.abs(added) ** 2) == pytest.approx(noise_power_v2(radar), rel=0.01)
    assert endless.noise_power_v2 == 0


RUN = {
    "duration_s": 0.5,
    "targets": [{"motion": {"kind": "boulic", "speed_mps": 1.2, "stride_variation": 0.02}, "label": "human"}],
    "radar": {"preset": "x4"},
    "noise": {"kind": "snr", "snr_db": 10.0},
}


def test_the_noise_draw_shifts_no_motion():
    quiet = run_simulation(parse_run({**RUN, "seed": 5, "noise": {"kind": "none"}}))
    noisy = run_simulation(parse_run({**RUN, "seed": 5}))
    other = run_simulation(parse_run({**RUN, "seed": 6, "noise": {"kind": "none"}}))
    np.testing.assert_array_equal(quiet.truth[0].scatterers["range"], noisy.truth[0].scatterers["range"])
    assert not np.array_equal(quiet.truth[0].scatterers["range"], other.truth[0].scatterers["range"])
    assert not np.array_equal(quiet.baseband, noisy.baseband)
