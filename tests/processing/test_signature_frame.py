"""A gate that reaches beyond the frame: what is kept, how it is scaled, what is said."""

import numpy as np
import pytest

from doppelgait.core.errors import AnalysisError, DoppelgaitWarning
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.core.rng import rng
from doppelgait.motion import boulic_walk
from doppelgait.pipeline import analyze, simulate
from doppelgait.processing import Analysis, Gate, crop_to_frame, noise_floor_v2, signature
from doppelgait.radar import Radar, add_noise
from doppelgait.scene import Scene, Target

WAVELENGTH_M = 0.0411
POWER_V2 = 2e-9


def noise_signature(centre_m):
    """Signature of noise alone in a gate that moves as given, in a frame of 0 to 9.6 m."""
    slow_time_s, range_m = np.arange(4000) / 1000, 0.0514 * np.arange(188)
    silent = make_array(BASEBAND, np.zeros((4000, 188), np.complex64), {"slow_time": slow_time_s, "range": range_m})
    noisy = add_noise(silent, noise_power_v2=POWER_V2, rng=np.random.default_rng(3))
    track = np.broadcast_to(centre_m, slow_time_s.shape).astype(float)
    gate = Gate.around(slow_time_s, track, span_m=1.6, source="given")
    return signature(noisy, gate, Analysis(), wavelength_m=WAVELENGTH_M)


@pytest.mark.parametrize(("centre_m", "share"), [(5.0, 1.0), (9.6, 0.52), (0.3, 0.7)])
def test_share_of_the_gate_inside_the_frame_is_known(centre_m, share):
    assert noise_signature(centre_m).coords["gate_share"].values == pytest.approx(share, abs=0.02)


@pytest.mark.parametrize("centre_m", [5.0, 9.6, 0.3])
def test_the_noise_floor_of_a_cut_gate_is_that_of_a_whole_one(centre_m):
    mu = noise_signature(centre_m)
    expected = POWER_V2 * mu.attrs["window_energy"] * mu.attrs["n_gate_bins"]
    assert noise_floor_v2(crop_to_frame(mu)[0]) == pytest.approx(expected, rel=0.03)


def test_the_time_outside_is_left_out_and_a_gate_inside_is_left_as_it_is():
    inside = noise_signature(5.0)
    kept, share = crop_to_frame(inside)
    assert kept is inside
    assert share == 1.0
    mu = noise_signature(np.linspace(7.0, 12.0, 4000))
    kept, share = crop_to_frame(mu)
    assert kept.coords["gate_share"].values.min() >= 0.5
    assert kept.sizes["time"] == (mu.coords["gate_share"].values >= 0.5).sum()
    assert share == pytest.approx(mu.coords["gate_share"].values.mean())


def test_a_gate_that_is_hardly_ever_inside_is_refused():
    with pytest.raises(AnalysisError, match="outside the recorded frame for all but"):
        crop_to_frame(noise_signature(np.linspace(9.62, 14.0, 4000)))


def test_a_walker_who_leaves_the_frame_keeps_his_bandwidth_and_is_flagged():
    walk = boulic_walk(speed_mps=1.8, height_m=1.75, duration_s=4.0)
    scene = Scene([Target(walk, range_m=7.5, aspect_deg=180.0)])
    with pytest.warns(DoppelgaitWarning, match="outside the frame"):
        cut = analyze(simulate(scene, Radar.preset("x4", fold_echoes=False), rng=rng(0)), gate="truth")[0]
    whole = analyze(simulate(scene, Radar.preset("x4-long"), rng=rng(0)), gate="truth")[0]
    assert "gate_leaves_frame" in cut.flags
    assert "gate_leaves_frame" not in whole.flags
    assert cut.quality["gate_inside_frame"] < 1.0
    assert cut.features.doppler_bandwidth_hz == pytest.approx(whole.features.doppler_bandwidth_hz, rel=0.15)
