"""Receiver noise (E-18), its level after the transform (section 6, test 6) and random streams."""

import numpy as np
import pytest

from doppelgait.core.rng import rng
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.pipeline import parse_run, run_simulation, simulate
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target


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
