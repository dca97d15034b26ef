"""What the viewer sends, taken apart again and compared with the arrays that it was made of."""

import numpy as np
import pytest
import xarray as xr

from doppelgait.pipeline import analyze, parse_run, run_simulation
from doppelgait.processing import Analysis, gaussian_window
from doppelgait.viewer import panels
from doppelgait.viewer.payload import describe_axis, encode_image, pack
from doppelgait.viewer.run import Run
from doppelgait.viewer.settings import Settings
from viewer_client import unpack, walking_scene

SCENE = walking_scene(1.6)


def levels_of(image, arrays):
    """Levels in dB of a picture."""
    low, high = image["db"]
    return low + arrays[image["array"]] * (high - low) / 65535


@pytest.fixture(scope="module")
def recording():
    return run_simulation(parse_run(SCENE, where="scene"))


@pytest.fixture(scope="module")
def run(recording):
    asked = Settings(gate="truth", analysis=Analysis(clutter="none"))
    return Run("walk", "recording", asked, load=lambda: recording)


def test_arrays_come_back_as_they_were():
    sent = {
        "bytes": np.arange(5, dtype=np.uint8),
        "numbers": np.arange(6, dtype=">f4").reshape(2, 3),
        "turned": np.arange(6, dtype=np.int32).reshape(2, 3).T,
        "none": np.empty((0, 2), dtype=np.int32),
    }
    facts, arrays = unpack(pack({"name": "Åse"}, sent))
    assert facts["name"] == "Åse"
    for name, array in sent.items():
        np.testing.assert_array_equal(arrays[name], array)
    with pytest.raises(ValueError, match="complex64"):
        pack({}, {"signal": np.zeros(2, dtype=np.complex64)})


def test_picture_keeps_levels_and_peaks():
    rng = np.random.default_rng(1)
    levels = rng.normal(-60.0, 5.0, (1000, 40))
    levels[777, 13], levels[3, 3] = -10.0, -np.inf
    x, y = describe_axis("time", "s", 2.0 + 0.01 * np.arange(1000)), describe_axis("range", "m", 0.5 * np.arange(40))
    whole, codes = encode_image("a", 10 ** (levels / 10), x, y, unit="dB re 1")
    finite = np.isfinite(levels)
    np.testing.assert_allclose(levels_of(whole, {"a": codes})[finite], levels[finite], atol=0.005)
    assert codes[3, 3] == 0
    assert (whole["x"], whole["y"], whole["db"][1]) == (x, y, -10.0)

    small, codes = encode_image("a", 10 ** (levels / 10), x, y, unit="dB re 1", most=(300, 7))
    assert codes.shape == (small["x"]["n"], small["y"]["n"]) == (250, 7)
    column, row = np.unravel_index(codes.argmax(), codes.shape)
    axes = [(small["x"], column, 2.0 + 7.77), (small["y"], row, 6.5)]
    for axis, place, true in axes:
        assert abs(axis["first"] + place * axis["step"] - true) <= axis["step"] / 2
    assert small["x"]["first"] == pytest.approx(2.0 + 0.015)
    assert (small["x"]["block"], small["y"]["block"]) == (4, 6)


def test_empty_and_flat_pictures_have_a_range():
    x, y = describe_axis("time", "s", [0.0]), describe_axis("range", "m", [1.0, 2.0])
    for levels in (np.full((1, 2), -np.inf), np.full((1, 2), -30.0)):
        facts, _ = encode_image("a", 10 ** (levels / 10), x, y, unit="dB re 1")
        assert facts["db"][0] < facts["db"][1]
        assert x["step"] == 0.0


def test_recording_has_the_files_own_levels_bodies_and_true_doppler(run, recording):
    facts, arrays = unpack(panels.make_recording_payload(run, None, changes=(("clutter", "none"),)))
    expected = 20 * np.log10(np.abs(recording.baseband.values))
    shown = expected > facts["range_time"]["db"][0]
    np.testing.assert_allclose(levels_of(facts["range_time"], arrays)[shown], expected[shown], atol=0.01)
    assert facts["duration_s"] == pytest.approx(1.6)
    assert facts["scene"]["radar_position_m"] == [0.0, 0.0, 1.0]
    truth = facts["truth"][0]
    np.testing.assert_allclose(arrays[truth["range"]], recording.truth[0].centre_range_m, atol=1e-5)
    body, doppler = facts["bodies"][0], facts["truth"][0]["doppler"]
    np.testing.assert_allclose(arrays[body["points"]], recording.truth[0].body.values, atol=1e-4)
    assert len(body["parts"]) == arrays[body["points"]].shape[1] > arrays[body["bones"]].max()
    scatterers = recording.truth[0].scatterers
    torso = np.isin(scatterers["part"].values, ["torso"])
    mean_hz = scatterers["radial_velocity"].values[:, torso].mean(axis=1) * 2 / recording.radar.wavelength_m
    line = arrays[doppler["values"]][doppler["parts"].index("torso")]
    np.testing.assert_allclose(line, mean_hz, atol=0.01)


def test_targets_show_what_the_analysis_found(run, recording):
    facts, arrays = unpack(panels.make_targets_payload(run, None))
    (expected,) = analyze(recording, gate="truth")
    target = facts["targets"][0]
    assert target["features"]["torso_velocity_mps"] == expected.features.torso_velocity_mps
    assert target["truth"]["torso_velocity_mps"] == pytest.approx(recording.truth[0].centre_velocity_mps.mean())
    assert facts["reason"] is None
    level = 10 * np.log10(expected.signature.values)
    shown = level > target["signature"]["db"][0]
    np.testing.assert_allclose(levels_of(target["signature"], arrays)[shown], level[shown], atol=0.01)
    second = target["signature"]["y"]["second"]["scale"]
    assert second == pytest.approx(recording.radar.wavelength_m / 2)
    np.testing.assert_allclose(arrays[target["main_lines"][0]["values"]], expected.main_line_hz, atol=1e-3)
    spectrum = target["cadence_spectrum"]
    np.testing.assert_allclose(arrays[spectrum["db"]], 10 * np.log10(expected.cadence_spectrum.values), atol=1e-3)
    assert spectrum["peaks"][0] == {"hz": expected.gait_frequency_hz, "name": "f_mu"}
    gate = target["gate_limits"]
    at_s = expected.gate.time_s
    plotted = np.interp(at_s, arrays[gate["time"]], arrays[gate["low"]])
    np.testing.assert_allclose(plotted, expected.gate.low_m, atol=0.01)


def test_frames_are_transforms_of_the_samples(run, recording):
    facts, arrays = unpack(panels.make_range_doppler_payload(run, None, start=40, count=3))
    time, doppler = facts["time"], facts["doppler"]
    window = gaussian_window(101, Analysis().window_steepness)
    low, high = facts["db"]
    for n in range(3):
        centre = round((time["first"] + (40 + n) * time["step"]) * recording.radar.prf_hz)
        pulses = np.arange(centre - 50, centre + 51)
        for row in (30, 64, 80):
            f = doppler["first"] + row * doppler["step"]
            turn = np.exp(-2j * np.pi * f * np.arange(101) / recording.radar.prf_hz)
            power = np.abs((window * turn) @ recording.baseband.values[pulses]) ** 2
            shown = low + arrays["frames"][n, :, row] * (high - low) / 65535
            np.testing.assert_allclose(shown, 10 * np.log10(power), atol=0.02)


def test_tiles_of_a_long_recording_give_the_bytes_of_the_whole(recording, monkeypatch):
    def payloads():
        asked = Settings(gate="truth", analysis=Analysis(clutter="none"))
        run = Run("walk", "recording", asked, load=lambda: recording)
        return panels.make_recording_payload(run, None), panels.make_range_doppler_payload(
            run, None, start=0, count=256
        )

    monkeypatch.setattr("doppelgait.viewer.payload.MEDIAN_OF", 3000)
    monkeypatch.setattr("doppelgait.viewer.panels.MOST_LINE_POINTS", 200)
    whole = payloads()
    monkeypatch.setattr("doppelgait.core.lazy.LONG_PULSES", 300)
    assert recording.n_pulses > 1000
    assert payloads() == whole


def test_blocks_of_a_picture_do_not_end_at_tiles(monkeypatch):
    power = np.float32(6) ** np.random.default_rng(3).normal(size=(1000, 7)).astype(np.float32)
    axes = [describe_axis("time", "s", np.arange(1000) / 10), describe_axis("range", "m", np.arange(7) / 10)]
    monkeypatch.setattr("doppelgait.viewer.payload.MEDIAN_OF", 300)
    monkeypatch.setattr("doppelgait.core.lazy.LONG_PULSES", 100)
    facts, codes = encode_image("a", power, *axes, unit="dB", most=(64, 4))
    pulses = xr.DataArray(power, dims=("slow_time", "range"))
    tiled_facts, tiled_codes = encode_image("a", pulses, *axes, unit="dB", most=(64, 4))
    assert tiled_facts == facts
    np.testing.assert_array_equal(tiled_codes, codes)
