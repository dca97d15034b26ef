"""Radar parameters, link budget, closed-form echo (E-06, E-11, E-14, E-15, E-18) and recordings on disk."""

from dataclasses import replace

import h5py
import numpy as np
import pytest
import xarray as xr

import doppelgait as dg
from doppelgait.core.errors import ConfigError, DoppelgaitWarning
from doppelgait.core.rng import Streams
from doppelgait.motion import make_motion
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.pipeline import simulate
from doppelgait.scene import Scene, Target
from doppelgait_conformance.radars import make_table

C_MPS = 299_792_458.0


@pytest.mark.parametrize(
    ("change", "sigma_ns", "b3_ghz", "b10_ghz", "resolution_cm"),
    [
        ({}, 0.3450, 0.768, 1.4, 8.61),
        ({"bandwidth_hz": 1.5e9}, 0.3220, 0.823, 1.5, 8.04),
        ({"pulse_sigma_s": 1e-9}, 1.0, 0.26501, 0.48301, 24.96),
        ({"bandwidth_hz": 0.768e9, "bandwidth_level_db": 3}, 0.3450, 0.768, 1.4, 8.61),
    ],
)
def test_pulse_numbers_e11(change, sigma_ns, b3_ghz, b10_ghz, resolution_cm):
    radar = dg.radar.Radar.preset("x4", **change)
    assert radar.sigma_s == pytest.approx(sigma_ns * 1e-9, rel=5e-4)
    assert radar.pulse_bandwidth_hz(3) == pytest.approx(b3_ghz * 1e9, rel=1e-3)
    assert radar.pulse_bandwidth_hz(10) == pytest.approx(b10_ghz * 1e9, rel=1e-3)
    assert radar.range_resolution_m == pytest.approx(resolution_cm / 100, rel=1e-3)
    # time-bandwidth product of a Gaussian at half power
    assert radar.pulse_bandwidth_hz(3) * 2 * radar.range_resolution_m / C_MPS == pytest.approx(0.4413, abs=5e-5)


@pytest.mark.parametrize(
    ("preset", "changes", "message"),
    [
        ("x4", {"range_stop_m": 1e6}, r"range_stop_m 1000000.0 makes 19,453,\d+ range bins.*1 to 100,000 are allowed"),
        ("x4", {"range_stop_m": 12.0}, r"range_stop_m 12 is longer than the 9.87 m .*lower pulse_rate_hz"),
        ("x4", {"bandwidth_hz": 1.4}, r"bandwidth_hz 1.4 makes a pulse of sigma 0.345 s; allowed are 1e-11 to 1e-06 s"),
        ("x4", {"carrier_hz": 7.29e6}, r"carrier_hz 7.29e\+06 is below half of the signal's bandwidth, 1.4e\+09 Hz"),
        ("x4", {"tx_power_dbm": 1e6}, "tx_power_dbm: 1000000.0.*less than or equal to 200"),
        ("x4", {"sweep_levels": 1, "threshold_step_v": 1e-3}, "threshold_step_v 0.001 .* sweep_levels is 1"),
        ("ti-60", {"threshold_step_v": 1e-3}, "threshold_step_v is not used by waveform 'fmcw'"),
        ("x4", {"noise_correlation": [0.7]}, r"noise_correlation \[0.7\] is impossible: .* minimum -0.4, below 0"),
        ("x4", {"burst_pulses": 64}, "burst_pulses and burst_period_s belong together"),
        ("x4", {"burst_pulses": 64, "burst_period_s": 0.05}, "shorter than a burst of 64 frames"),
        ("x4", {"prf_hz": 1e6}, r"prf_hz 1000000.0 leaves no whole pulse.*: at most 15187500.0 \* 0.95 of the frame"),
        ("x4", {"range_start_m": 12.0}, r"range_stop_m 9.664 must be larger than range_start_m 12"),
        ("x4", {"carrier_hz": float("inf")}, r"carrier_hz: inf .*finite"),
    ],
)
def test_radars_that_cannot_be(preset, changes, message):
    with pytest.raises(ConfigError, match=message):
        dg.radar.Radar.preset(preset, **changes)


def test_range_axis_e15():
    raw = dg.radar.Radar.preset("x4", decimation=1)
    assert raw.bin_spacing_m == pytest.approx(6.42559e-3, rel=1e-6)
    x4 = dg.radar.Radar.preset("x4")
    assert x4.bin_spacing_m == pytest.approx(51.4047e-3, rel=1e-6)
    assert x4.range_axis_m()[0] == 0.0
    np.testing.assert_allclose(np.diff(x4.range_axis_m()), x4.bin_spacing_m, rtol=1e-12)
    assert x4.n_range_bins == 188
    # the report's 7.75 m at 23 GS/s: N = ceil(7.75 / 6.517 mm)
    report = dg.radar.Radar.preset("x4", decimation=1, sample_rate_hz=23e9, range_start_m=0.0, range_stop_m=7.75)
    assert report.n_range_bins == 1190


def test_radar_equation_is_guarded_near_the_antenna_e14():
    radar = dg.radar.Radar.preset("x4")
    near = dg.radar.received_power_w(radar, range_m=[0.0, 0.1, 0.2], rcs_m2=1.0)
    assert near[0] == near[1] == near[2]
    assert np.isfinite(near).all()


def test_aliasing_and_lost_targets_are_warned_of_with_their_numbers():
    t = np.arange(0, 1.2, 0.01)
    fast = make_motion(
        np.stack([5.0 * t, 0 * t, 1 + 0 * t], axis=-1)[:, None], rate_hz=100, markers=["a"], parts=["torso"]
    )
    with pytest.warns(DoppelgaitWarning, match=r"aliasing: .*5\.00 m/s.*prf_hz = 300.*3\.08 m/s.*550 or more"):
        simulate(Scene([Target(fast)], duration_s=1.0), dg.radar.Radar.preset("x4", prf_hz=300))
    # a recording that jumps needs a correction, not a higher rate; warnings are errors here
    simulate(Scene([Target(fast.with_report(has_jumps=True))], duration_s=1.0), dg.radar.Radar.preset("x4", prf_hz=300))
    with pytest.warns(DoppelgaitWarning, match=r"folding: .* 22\.50 m away.* 9\.87 m; .* appears at 2\.76 m"):
        simulate(Scene([Target(fast, range_m=20.0)], duration_s=1.0), dg.radar.Radar.preset("x4"))


def test_lowest_frame_rate_without_aliasing_e06():
    table = make_table([[5.0, 6.0]], radial_velocity=[[2.0, -5.0]])
    # 2 (5 m/s * 48.634 + 3 / 0.1 s) = 546.3 Hz
    assert dg.radar.lowest_prf_hz(table, dg.radar.Radar.preset("x4"), 0.1) == 547


@pytest.fixture(scope="module")
def recording():
    walkers = [
        Target(boulic_walk(speed_mps=v, height_m=1.8, duration_s=1.0), label=label, bearing_deg=b)
        for v, label, b in ((1.2, "human", 0.0), (0.8, "", 20.0))
    ]
    made = simulate(Scene(walkers), dg.radar.Radar.preset("x4"), rng=Streams(4), snr_db=20.0)
    return replace(made, seed=4)


@pytest.fixture(scope="module")
def walk_file(recording, tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "walk.h5"
    dg.radar.write_recording(recording, path)
    return path


def test_round_trip_is_exact(recording, walk_file):
    again = dg.radar.read_recording(walk_file)
    xr.testing.assert_identical(again.baseband, recording.baseband)
    assert again.radar == recording.radar
    assert (again.noise_power_v2, again.snr_frame_db) == (recording.noise_power_v2, recording.snr_frame_db)
    assert again.seed == 4
    assert again.source == "walk.h5"
    assert again.radar_position_m == recording.radar_position_m == (0.0, 0.0, 1.0)
    assert len(again.truth) == 2
    for found, wanted in zip(again.truth, recording.truth, strict=True):
        for name in vars(wanted):
            if name == "body":
                xr.testing.assert_identical(found.body, wanted.body)
            elif name != "scatterers":
                np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), err_msg=name)
        for name in ("range", "radial_velocity", "aspect", "rcs"):
            np.testing.assert_array_equal(found.scatterers[name], wanted.scatterers[name])
        for name in ("marker", "part", "target"):
            assert list(found.scatterers.coords[name].values) == list(wanted.scatterers.coords[name].values)


def test_no_time_of_writing_is_stored(walk_file):
    names = []
    with h5py.File(walk_file, "r") as file:
        file.visit(names.append)
        times = {name: h5py.h5g.get_objinfo(file.id, name.encode()).mtime for name in names}
    assert not any(times.values())  # a stored time of writing would differ tomorrow


def test_noise_without_a_generator_is_refused():
    walker = Target(boulic_walk(speed_mps=1.0, duration_s=0.5))
    with pytest.raises(ConfigError, match="snr_db = 20"):
        simulate(Scene([walker]), dg.radar.Radar.preset("x4"), snr_db=20.0)
