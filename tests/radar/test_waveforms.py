"""Every waveform against literal float64 loops, brute-force matched filters and each other."""

import json
from typing import Literal

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.core.config import format_canonical_json, validate
from doppelgait.core.errors import AnalysisError, ConfigError, DoppelgaitWarning
from doppelgait.core.rng import Streams
from doppelgait.pipeline import Conditions, Run, simulate
from doppelgait.radar import synthesise
from doppelgait.radar.simulate import warn_of_limits
from doppelgait.scene import Scene, Target
from doppelgait_conformance.radars import change_radar, make_table

C = 299_792_458.0

COMMON = {"carrier_hz": 24e9, "prf_hz": 500.0, "range_stop_m": 9.0, "transmit_phase_rad": 0.4}
RADARS = {
    "impulse": dg.radar.Radar(waveform="impulse", sample_rate_hz=3e9, bandwidth_hz=1e9, **COMMON),
    "rectangular": dg.radar.Radar(waveform="rectangular", sample_rate_hz=3e9, sweep_s=2e-9, **COMMON),
    "lfm": dg.radar.Radar(waveform="lfm", sample_rate_hz=3e9, sweep_s=1e-6, bandwidth_hz=1e9, **COMMON),
    "fmcw": dg.radar.Radar(waveform="fmcw", sample_rate_hz=256e3, sweep_s=1e-3, bandwidth_hz=1e9, **COMMON),
    "stepped": dg.radar.Radar(waveform="stepped", sample_rate_hz=256e3, sweep_s=1e-3, bandwidth_hz=1e9, **COMMON),
    "cw": dg.radar.Radar(waveform="cw", sample_rate_hz=500.0, **COMMON),
}
SWEPT = ("fmcw", "stepped")


def table_of(range_m, *, velocity_mps=0.0, target=None, **values):
    time_s = np.arange(len(range_m)) / 500.0
    table = make_table(range_m, slow_time_s=time_s, radial_velocity=velocity_mps, **values)
    return table if target is None else table.assign_coords(target=("scatterer", target))


def crowd(seed=3, pulses=19, scatterers=4, speed_mps=5.0):
    """Random scatterers with velocities and extra phases; not a multiple of any block length."""
    rng = np.random.default_rng(seed)
    shape = (pulses, scatterers)
    return table_of(
        rng.uniform(1.0, 8.0, shape),
        velocity_mps=rng.uniform(-speed_mps, speed_mps, shape),
        rcs=rng.uniform(0.1, 1.0, shape),
        path_phase=rng.uniform(-4.0, 4.0, shape),
    )


WINDOWS = {
    "none": lambda x: np.ones_like(x),
    "hann": lambda x: np.sin(np.pi * x) ** 2,
    "hamming": lambda x: 0.08 + 0.92 * np.sin(np.pi * x) ** 2,
    "blackman": lambda x: 0.42 - 0.5 * np.cos(2 * np.pi * x) + 0.08 * np.cos(4 * np.pi * x),
}


def literal_transform(samples, radar, at_m, *, chirped):
    """Response at any range: every sample times the conjugate of what a scatterer there would give, window and all."""
    n = samples.shape[1]
    u = (np.arange(n) - (n - 1) / 2) / radar.sample_rate_hz
    slope = radar.bandwidth_hz * radar.sample_rate_hz / n
    w = WINDOWS[radar.range_window]((np.arange(n) + 0.5) / n)
    delay = 2 * np.atleast_1d(at_m)[:, None] / C
    match = np.exp(2j * np.pi * slope * delay * (u - (delay / 2 if chirped else 0.0)))
    return (samples * w) @ match.T / w.sum()


@pytest.mark.parametrize("window", WINDOWS)
@pytest.mark.parametrize("name", SWEPT)
def test_compression_is_the_literal_windowed_transform(name, window):
    radar = change_radar(RADARS[name], range_window=window, range_start_m=1.1)
    samples = dg.radar.synthesise_samples(crowd(), radar)
    found = dg.radar.compress(samples, radar)
    axis_m = radar.range_axis_m()
    spacing_m = C / (2 * 1e9)
    np.testing.assert_allclose(axis_m, spacing_m * np.arange(8, 61), rtol=1e-12)  # 1.199 m to 8.994 m
    wanted = literal_transform(samples, radar, axis_m, chirped=name == "fmcw")
    assert np.abs(found - wanted).max() < 3e-7 * np.abs(wanted).max()


@pytest.mark.parametrize(
    ("window", "cells"), [("none", 0.886), ("hann", 1.441), ("hamming", 1.303), ("blackman", 1.644)]
)
def test_resolution_of_the_windows(window, cells):
    # 0.886 and Harris 1978, table 1: 3 dB widths 1.44, 1.30, 1.68 (Blackman rounded as 0.42, 0.50, 0.08: 1.64)
    radar = change_radar(RADARS["fmcw"], range_window=window)
    assert radar.range_resolution_m / (C / 2e9) == pytest.approx(cells, abs=2e-3)


def literal_pulses(table, radar):
    """Range bins behind a matched filter, scatterer by scatterer by the module's equation."""
    wanted = np.zeros((table.sizes["slow_time"], radar.n_range_bins), dtype=complex)
    slope = (radar.bandwidth_hz or 0.0) / radar.sweep_s
    for n in range(table.sizes["scatterer"]):
        r, v, rcs = (table[name].values[:, [n]] for name in ("range", "radial_velocity", "rcs"))
        x = 2 * (radar.range_axis_m() - r) / C
        left = np.maximum(radar.sweep_s - np.abs(x), 0.0)
        doppler_hz = 2 * v * 24e9 / C
        extra = table["path_phase"].values[:, [n]] if "path_phase" in table else 0.0
        phase = 0.4 + extra - 4 * np.pi * r * 24e9 / C + np.pi * doppler_hz * x
        level = dg.radar.echo_amplitude_v(radar, range_m=r, rcs_m2=rcs) * left / radar.sweep_s
        wanted += level * np.sinc((doppler_hz + slope * x) * left) * np.exp(1j * phase)
    return wanted


@pytest.mark.parametrize("speed_mps", [0.0, 3.12, -3.12, 3.13, 12.0, 300.0])  # tabulated to f_d / B = 5e-7, 3.123 m/s
@pytest.mark.parametrize("decimation", [1, 8])
@pytest.mark.parametrize("sweep_s", [2e-8, 0.7e-7, 1e-6, 2e-5])
def test_response_of_a_chirp_from_its_table_is_that_of_the_equation_everywhere(speed_mps, decimation, sweep_s):
    radar = change_radar(RADARS["lfm"], sweep_s=sweep_s, decimation=decimation)
    edges_m = np.repeat(radar.range_axis_m(), 3) + np.tile([-1e-9, 0.0, 1e-9], radar.n_range_bins)
    places_m = np.concatenate([np.linspace(0.3, 12.0, 1001), edges_m[edges_m > 0.3]])
    table = table_of(places_m[:, None], velocity_mps=speed_mps)
    wanted = literal_pulses(table, radar)
    peak = dg.radar.echo_amplitude_v(radar, range_m=places_m, rcs_m2=1.0)[:, None]
    assert (np.abs(synthesise(table, radar).values - wanted) / peak).max() < 1e-6


def test_widths_of_matched_filter_responses():
    rectangular = RADARS["rectangular"]
    assert rectangular.range_resolution_m == pytest.approx((2 - np.sqrt(2)) * C * 2e-9 / 2, rel=1e-12)
    assert dg.radar.list_derived_quantities(rectangular)["pulse_bandwidth_3db_hz"] == pytest.approx(
        0.886 / 2e-9, rel=1e-3
    )
    assert RADARS["lfm"].range_resolution_m == pytest.approx(0.8859 * C / 2e9, rel=2e-3)


def test_cw_sums_echoes_from_whatever_range():
    radar = RADARS["cw"]
    assert radar.range_axis_m() == pytest.approx([4.5])
    assert radar.bin_spacing_m == 9.0
    far = synthesise(table_of([[500.0]]), radar).values
    assert np.abs(far[0, 0]) == pytest.approx(
        float(dg.radar.echo_amplitude_v(radar, range_m=500.0, rcs_m2=1.0)), rel=1e-6
    )


@pytest.mark.parametrize(
    ("name", "changes", "says"),
    [
        ("impulse", {"waveform": "chirp"}, "waveform: 'chirp' .*known are cw, fmcw, impulse, lfm, rectangular"),
        ("impulse", {"sweep_s": 1e-6}, "sweep_s is not used by waveform 'impulse'"),
        ("cw", {"bandwidth_hz": 1e6, "decimation": 2}, "bandwidth_hz and decimation are not used by waveform 'cw'"),
        ("rectangular", {"sweep_s": None}, "waveform 'rectangular' needs sweep_s"),
        ("lfm", {"sweep_s": 1e-9}, "below 2: that is not a chirp"),
        ("lfm", {"sweep_s": 2e-3}, r"sweep_s 0.002 is too long for a pulse; at most 0.001"),
        ("lfm", {"carrier_hz": 4e8}, r"carrier_hz 4e\+08 is below half of the signal's bandwidth, 1e\+09 Hz"),
        ("fmcw", {"bandwidth_hz": None, "sweep_s": None}, "waveform 'fmcw' needs bandwidth_hz and sweep_s"),
        ("fmcw", {"noise_bandwidth_hz": 1e6}, "noise_bandwidth_hz is not used by waveform 'fmcw'"),
        ("fmcw", {"prf_hz": 1001.0}, r"sweep_s 0.001 is longer than a frame at prf_hz 1001"),
        ("fmcw", {"range_stop_m": 39.0}, r"range_stop_m 39 lies beyond the unambiguous range of 256 samples.*38.37"),
        ("fmcw", {"sweep_s": 5e-6}, r"makes 1 samples; 2 to 65,536 are allowed"),
        ("stepped", {"range_start_m": 9.5}, r"range_stop_m 9.0 must be larger than range_start_m 9.5"),
        ("stepped", {"range_start_m": 4.35, "range_stop_m": 4.4}, "makes 0 range bins"),
    ],
)
def test_what_a_waveform_needs_and_refuses(name, changes, says):
    with pytest.raises(ConfigError, match=says):
        validate(dg.radar.Radar, {**RADARS[name].model_dump(), **changes})


def test_radars_of_older_files_and_of_every_waveform_load_again():
    old = {k: v for k, v in dg.radar.Radar.preset("x4").model_dump(mode="json").items()
           if k not in ("waveform", "sweep_s", "range_window", "volts_per_unit", "antenna")}  # fmt: skip
    assert dg.radar.Radar.model_validate(old) == dg.radar.Radar.preset("x4", volts_per_unit=None)
    for radar in RADARS.values():
        assert dg.radar.Radar.model_validate(json.loads(json.dumps(radar.model_dump(mode="json")))) == radar
    assert set(dg.radar.WAVEFORMS) == set(RADARS)


def test_only_an_impulse_radar_has_a_gaussian_pulse():
    with pytest.raises(ConfigError, match="waveform 'fmcw' has no Gaussian pulse"):
        RADARS["fmcw"].sigma_s  # noqa: B018


@pytest.mark.parametrize("name", RADARS)
def test_samples_of_another_length_are_refused(name):
    with pytest.raises(AnalysisError, match=rf"shape \(3, 7\).*waveform '{name}'.* has \d+ samples per frame"):
        dg.radar.compress(np.zeros((3, 7), dtype=np.complex64), RADARS[name])


def test_sweeps_and_integration_need_velocities():
    for radar in (RADARS["fmcw"], dg.radar.Radar.preset("x4")):
        with pytest.raises(ConfigError, match=r"no radial_velocity, which .* integration_share need"):
            synthesise(table_of([[4.0]]).drop_vars("radial_velocity"), radar)
    synthesise(table_of([[4.0]]).drop_vars("radial_velocity"), RADARS["impulse"])


def test_limits_are_warned_of():
    fmcw = RADARS["fmcw"]
    with pytest.warns(DoppelgaitWarning, match=r"folding: a scatterer is 39.00 m away, beyond.*38.37 m"):
        warn_of_limits(table_of([[39.0]]), fmcw)
    with pytest.warns(DoppelgaitWarning, match=r"outside the frame: 100 %.*0 to 9 m"):
        warn_of_limits(table_of([[20.0]]), fmcw)
    with pytest.warns(DoppelgaitWarning, match=r"aliasing: .*2\.00 m/s.*prf_hz = 500 .*1\.56 m/s"):
        warn_of_limits(table_of([[4.0]], velocity_mps=-2.0), fmcw)
    for name, radar in RADARS.items():
        warn_of_limits(table_of([[4.0]], velocity_mps=1.0), radar)
        if name != "cw":
            warn_of_limits(table_of([[4.0, 400.0]], target=[0, -1]), radar)  # a ghost may lie anywhere
    warn_of_limits(table_of([[400.0]]), RADARS["cw"])
    warn_of_limits(table_of(np.empty((7, 0))), fmcw)


@pytest.mark.parametrize("name", ["fmcw", "stepped"])
@pytest.mark.parametrize("window", ["hann", "none", "blackman"])
@pytest.mark.parametrize("speed_mps", [0.0, 1.7, 4.7, -4.7, 60.0])
@pytest.mark.parametrize("n_samples", [0, 1])
def test_bins_without_samples_are_those_of_window_and_transform(name, window, speed_mps, n_samples):
    radar = change_radar(RADARS[name], range_window=window)
    if n_samples:  # an odd number: the middle of the sweep is a sample
        radar = change_radar(
            radar, sweep_s=radar.sweep_s * (radar.waveform.n_samples(radar) + 1) / radar.waveform.n_samples(radar)
        )
    rng = np.random.default_rng(3)
    edges_m = radar.range_start_m + radar.bin_spacing_m * np.array([0.0, 0.5, 1.0, 7.25])
    ranges_m = np.concatenate([rng.uniform(0.05, 30.0, (40, 6)), np.tile(edges_m, (40, 1))], axis=1)
    table = table_of(ranges_m, velocity_mps=speed_mps, path_phase=rng.uniform(-9, 9, ranges_m.shape))
    found = radar.waveform.synthesise_bins(table, radar)
    wanted = radar.waveform.compress(radar.waveform.synthesise(table, radar), radar)
    largest = np.abs(dg.radar.echo_amplitude_v(radar, range_m=ranges_m, rcs_m2=1.0)).sum(axis=1).max()
    assert np.abs(found - wanted).max() < 1e-6 * largest
    assert (speed_mps < 5.0) == bool((found != wanted).any())  # faster ones go the way of the samples


@pytest.mark.filterwarnings("ignore:.*aliasing")
def test_a_recording_of_a_swept_radar_is_that_of_its_samples():
    walk = {"kind": "boulic", "speed_mps": 1.2}
    scene, radar = Scene([Target(walk, label="human", range_m=5.0)], duration_s=0.3), RADARS["fmcw"]
    found = simulate(scene, radar, rng=Streams(4), snr_db=20.0)
    # an impairment that changes nothing
    kept = Conditions(impairments=[{"kind": "iq_imbalance", "gain_db": 0.0, "phase_deg": 0.0}])
    wanted = simulate(scene, radar, rng=Streams(4), snr_db=20.0, conditions=kept)
    largest = np.abs(wanted.baseband.values).max()
    assert np.abs(found.baseband.values - wanted.baseband.values).max() < 2e-6 * largest
    assert found.noise_power_v2 == pytest.approx(wanted.noise_power_v2, rel=1e-5)


@pytest.mark.timeout(60)  # the sum over all samples of every sweep would take many minutes
def test_a_long_recording_of_a_swept_radar_does_not_need_every_sample():
    radar = change_radar(RADARS["fmcw"], sweep_s=1e-3)
    table = table_of(np.random.default_rng(0).uniform(2, 8, (5000, 41)), velocity_mps=1.0)
    assert len(synthesise(table, radar)) == 5000


@pytest.fixture
def barker(register):
    """A waveform of another package, for one test."""

    @register("waveform")
    class Barker(dg.radar.Waveform):
        needs = ("sweep_s",)
        kind: Literal["barker"] = "barker"
        chips: Literal[7, 11, 13] = 13

        def synthesise(self, scatterers, radar):
            return np.zeros((scatterers.sizes["slow_time"], self.n_samples(radar)), np.complex64)

        def resolution_m(self, radar):
            return C * radar.sweep_s / (2 * self.chips)

    return Barker


BARKER = {**COMMON, "sample_rate_hz": 3e9, "sweep_s": 13e-9}


def test_a_waveform_has_parameters_of_its_own(barker):
    radar = dg.radar.Radar(waveform={"kind": "barker", "chips": 11}, **BARKER)
    assert radar.waveform.chips == 11
    assert radar == dg.radar.Radar(waveform=barker(chips=11), **BARKER)
    assert dg.radar.Radar(waveform="barker", **BARKER).waveform.chips == 13
    assert radar != dg.radar.Radar(waveform="barker", **BARKER)
    assert radar.model_dump(mode="json")["waveform"] == {"kind": "barker", "chips": 11}
    assert dg.radar.Radar.model_validate_json(format_canonical_json(radar)) == radar
    assert RADARS["lfm"].model_dump()["waveform"] == "lfm"
    assert dg.radar.Radar.preset("x4", waveform={"kind": "impulse"}) == dg.radar.Radar.preset("x4")


def test_parameters_of_a_waveform_in_a_scene_file_and_on_the_command_line(barker, tmp_path):
    keys = "carrier_hz = 24e9\nprf_hz = 500\nrange_stop_m = 9\nsample_rate_hz = 3e9\nsweep_s = 13e-9\n"
    scene, own = tmp_path / "scene.toml", tmp_path / "own.toml"
    for waveform, chips in (('"barker"', 13), ('{ kind = "barker", chips = 7 }', 7)):
        scene.write_text(f"duration_s = 1.0\ntargets = []\n[radar]\nwaveform = {waveform}\n{keys}")
        assert Run.from_toml(scene).radar.waveform.chips == chips
        assert Run.from_toml(scene, overrides=["radar.waveform.chips=11"]).radar.waveform == barker(chips=11)
    with pytest.raises(ConfigError, match=r"radar\.waveform\.chips \(line 4\): 12 is not allowed"):
        Run.from_toml(scene, overrides=["radar.waveform.chips=12"])
    own.write_text(keys + 'waveform = { kind = "barker", chips = 7 }\n')
    assert dg.radar.Radar.preset(own, waveform={"chips": 11}).waveform == barker(chips=11)
