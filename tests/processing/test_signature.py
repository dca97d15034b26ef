"""Window, transform plan, gate, signature (E-20 to E-27); a gate that reaches beyond the frame."""

import numpy as np
import pytest

from doppelgait.core.errors import AnalysisError, DoppelgaitWarning
from doppelgait.core.frames import SlowTime
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.core.rng import rng
from doppelgait.core.samples import Samples
from doppelgait.motion import boulic_walk
from doppelgait.pipeline import analyze, simulate
from doppelgait.processing import (
    Analysis,
    Gate,
    crop_to_frame,
    gaussian_window,
    noise_floor_v2,
    range_doppler,
    signature,
)
from doppelgait.processing.config import find_fast_length, plan_transform
from doppelgait.processing.signature import make_gated_transform
from doppelgait.radar import Radar, add_noise
from doppelgait.scene import Scene, Target

WAVELENGTH_M = 0.0411238
LONG = 1 << 18


def first_crossing(power, axis, level):
    k = int(np.argmax(power < level))
    return float(np.interp(level, [power[k], power[k - 1]], [axis[k], axis[k - 1]]))


def test_window_numbers_e23():
    w = gaussian_window(101, 0.4)
    power = np.abs(np.fft.rfft(w, LONG)) ** 2
    power /= power[0]
    bins = np.arange(power.size) * w.size / LONG  # of f_p / M
    assert w.sum() / 101 == pytest.approx(0.4906, abs=5e-5)
    assert 101 * (w**2).sum() / w.sum() ** 2 == pytest.approx(1.4576, abs=5e-5)
    three_db = 2 * first_crossing(power, bins, 0.5)
    assert three_db == pytest.approx(1.384, abs=1e-3)
    assert three_db * 1000 / 101 == pytest.approx(13.70, abs=0.01)
    assert three_db * 1000 / 101 * WAVELENGTH_M / 2 == pytest.approx(0.282, abs=5e-4)
    assert 2 * first_crossing(power, bins, 0.25) == pytest.approx(1.937, abs=1e-3)
    first_null = int(np.argmax(np.diff(power) > 0))
    assert 10 * np.log10(power[first_null:].max()) == pytest.approx(-43.8, abs=0.05)
    assert w[0] == w[-1] == pytest.approx(0.0439, abs=5e-5)


@pytest.mark.parametrize(("m", "k"), [(101, 128), (129, 160), (161, 192), (131, 160), (31, 32), (3, 3), (1, 1)])
def test_default_transform_length_is_the_next_fast_one(m, k):
    assert find_fast_length(m) == k


def test_plan_of_the_defaults_e21_e22():
    plan = plan_transform(Analysis(), n_pulses=5000, prf_hz=1000.0)
    assert plan.window.size == 101
    assert plan.n_doppler_bins == 128
    assert plan.hop == 8
    centres = plan.compute_centre_pulses()
    assert centres[0] == 50
    assert centres[-1] <= 4949 < centres[-1] + 8  # valid region only
    assert plan_transform(Analysis(), n_pulses=1000, prf_hz=1300.0).hop == 10  # floor(130 / 12)


def test_plan_refuses_a_short_record_a_short_interval_and_a_short_transform():
    with pytest.raises(AnalysisError, match=r"100 pulses.*101"):
        plan_transform(Analysis(), n_pulses=100, prf_hz=1000.0)
    assert plan_transform(Analysis(), n_pulses=101, prf_hz=1000.0).n_columns == 1
    with pytest.raises(AnalysisError, match=r"cpi_s = 0.1 at prf_hz = 10 .*1 pulse, at least 5 .*cpi_s to 0.4 or more"):
        plan_transform(Analysis(), n_pulses=100, prf_hz=10.0)
    assert plan_transform(Analysis(cpi_s=0.4), n_pulses=100, prf_hz=10.0).window.size == 5
    with pytest.raises(AnalysisError, match=r"doppler_bins is 100.*101"):
        plan_transform(Analysis(doppler_bins=100), n_pulses=500, prf_hz=1000.0)


def test_gate_keeps_its_source_and_refuses_holes():
    gate = Gate.around([0, 1], [3, 3], span_m=1.0, doppler_hz=(-100, 200), source="truth")
    assert gate.source == "truth"
    assert gate.high_m[0] - gate.low_m[0] == pytest.approx(1.0)
    assert gate.doppler_hz == (-100.0, 200.0)
    assert set(gate.limits["doppler_low"].values) == {-100}
    with pytest.raises(AnalysisError, match="finite"):
        Gate.around([0, 1], [3, np.nan], span_m=1.0, source="given")
    with pytest.raises(AnalysisError, match="shapes"):
        Gate.around([0, 1, 2], [3, 3], span_m=1.0, source="given")


def tone(doppler_hz, n_pulses=400, n_bins=40, level=2.0, start_s=0.0):
    t = np.arange(n_pulses) / 1000
    y = np.zeros((n_pulses, n_bins), np.complex64)
    y[:, 20] = level * np.exp(2j * np.pi * doppler_hz * t)
    coords = {"slow_time": start_s + t, "range": 1.0 + 0.05 * np.arange(n_bins)}
    return make_array(BASEBAND, y, coords)


def fixed_gate(y, centre_m=2.0, span_m=0.5, **options):
    t = y.coords["slow_time"].values
    return Gate.around(t, np.full(t.size, centre_m), span_m=span_m, source="given", **options)


def test_a_gate_beside_the_target_sees_nothing_and_one_outside_the_frame_is_refused():
    y = tone(70.0)
    beside = signature(y, fixed_gate(y, centre_m=2.6), Analysis(), wavelength_m=WAVELENGTH_M)
    assert not beside.values.any()
    with pytest.raises(AnalysisError, match=r"6.75 to 7.25 m.*frame, 0.9\d to 2.9\d m"):
        signature(y, fixed_gate(y, centre_m=7.0), Analysis(), wavelength_m=WAVELENGTH_M)


def test_baseband_that_is_not_one_is_refused():
    y = tone(0.0)
    with pytest.raises(AnalysisError, match="units"):
        signature(y.assign_attrs(units="A"), fixed_gate(y), Analysis(), wavelength_m=WAVELENGTH_M)
    with pytest.raises(AnalysisError, match="dimensions"):
        signature(y.transpose(), fixed_gate(y), Analysis(), wavelength_m=WAVELENGTH_M)


@pytest.mark.parametrize("hop", [1, 5, 8])
@pytest.mark.parametrize("noisy", [False, True])
def test_tiles_of_time_give_the_bytes_of_the_whole(hop, noisy, monkeypatch):
    rng = np.random.default_rng(4)
    n_pulses, range_m = 5000, np.arange(40) * 0.05
    matrix = (rng.standard_normal((n_pulses, 40)) + 1j * rng.standard_normal((n_pulses, 40))).astype(np.complex64)
    slow_time_s = np.arange(n_pulses) / 1000.0
    analysis = Analysis(hop=hop, doppler_bins=128).resolved("truth")
    # a body that walks in and out again: for some tiles the gate is outside the frame
    gate = Gate.around(slow_time_s, 1.0 + 2.5 * np.sin(slow_time_s), span_m=0.8)
    cut = make_gated_transform(gate, SlowTime(slow_time_s), range_m, analysis)
    planes = np.ascontiguousarray(np.stack([matrix.real.T, matrix.imag.T]))
    for samples in (Samples(matrix), Samples.from_planes(planes, n_pulses)):
        given = samples.with_noise(np.uint64(7), 0.3) if noisy else samples
        wanted = cut.sum_power(given)
        with monkeypatch.context() as small:
            small.setattr("doppelgait.core.lazy.LONG_PULSES", 100)
            np.testing.assert_array_equal(cut.sum_power(given), wanted)


@pytest.mark.parametrize("method", ["standard", "liland2018"])
def test_range_doppler_maps_of_a_long_recording_are_those_of_the_whole(method, monkeypatch):
    rng = np.random.default_rng(2)
    values = rng.normal(size=(700, 5, 2)).astype(np.float32).view(np.complex64)[..., 0]
    baseband = make_array(BASEBAND, values, {"slow_time": np.arange(700) / 500.0, "range": 0.1 * np.arange(5)})
    analysis = Analysis(method=method)

    def maps(**options):
        blocks = range_doppler(baseband, analysis, wavelength_m=0.04, **options)
        return np.concatenate([block.values for block in blocks])

    whole, gate = maps(), Gate.fixed(-0.05, 0.45, time_s=[0.0, 1.4])
    mu = signature(baseband, gate, analysis, wavelength_m=0.04)  # zero-padded at both ends by the report's method
    np.testing.assert_allclose(whole.sum(axis=2), mu.values, rtol=1e-4)
    for block in (1, 7):
        np.testing.assert_allclose(maps(block=block), whole, rtol=0, atol=1e-6 * whole.max())
    monkeypatch.setattr("doppelgait.core.lazy.LONG_PULSES", 100)
    np.testing.assert_array_equal(maps(), whole)


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
def test_a_cut_gate_has_its_share_and_the_noise_floor_of_a_whole_one(centre_m, share):
    mu = noise_signature(centre_m)
    assert mu.coords["gate_share"].values == pytest.approx(share, abs=0.02)
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
