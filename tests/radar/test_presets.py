"""Radar presets: their numbers against the public sources, their files, and files of one's own."""

import json
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from command import run
from doppelgait.core.errors import ConfigError
from doppelgait.radar import Radar, list_derived_quantities, list_preset_names, noise_power_v2, read_full_preset
from doppelgait.radar.link import describe_effects
from doppelgait.radar.xethru.downconvert import CHIP_TAPS

C = 299_792_458.0
WITHOUT_SOURCES = {"x4-long", "liland2018"}
"""Files that name the source of their values at the top."""

SPEEDS_MPS = {
    # unambiguous radial speed, wavelength times frame rate / 4
    "x4": 10.28, "x4-high": 8.567, "x4-17fps": 0.1753, "x4-255fps": 2.62, "x4-512fps": 5.26, "ti-77": 3.09,
    "ti-60": 6.61, "infineon-60": 4.03, "infineon-24": 9.33, "acconeer-a121": 3.72, "ancortek-5.8": 12.92,
}  # fmt: skip
BINS_CM = {
    "x4": 5.140, "ti-77": 19.53, "ti-60": 8.42, "infineon-60": 7.49, "acconeer-a121": 3.0, "ancortek-5.8": 37.47,
    "ancortek-24": 19.99, "xband-fmcw": 187.4,
}  # fmt: skip
BURSTS = {"infineon-24-burst": (128, 0.2), "infineon-60-burst": (128, 0.0773), "ti-60-burst": (96, 0.055)}


def test_there_is_a_preset_for_every_sensor():
    wanted = {*SPEEDS_MPS, *BINS_CM, *BURSTS, "x4-long", "liland2018", "xband-cw"}
    assert set(list_preset_names()) == wanted
    assert {Radar.preset(name).waveform.kind for name in list_preset_names()} == {"impulse", "fmcw", "cw"}


@pytest.mark.parametrize("name", SPEEDS_MPS)
def test_unambiguous_speed_is_that_of_the_sources(name):
    assert Radar.preset(name).unambiguous_velocity_mps == pytest.approx(SPEEDS_MPS[name], rel=3e-3)


@pytest.mark.parametrize("name", BURSTS)
def test_presets_in_bursts_differ_in_the_bursts_alone(name):
    burst, whole = (Radar.preset(one).model_dump() for one in (name, name.removesuffix("-burst")))
    assert (burst.pop("burst_pulses"), burst.pop("burst_period_s")) == BURSTS[name]
    assert {**burst, "name": whole["name"]} == whole


@pytest.mark.parametrize("name", BINS_CM)
def test_range_bins_are_those_of_the_sources(name):
    assert 100 * Radar.preset(name).bin_spacing_m == pytest.approx(BINS_CM[name], rel=1e-3)


@pytest.mark.parametrize(
    ("name", "samples", "reach_m"),
    [("ti-77", 256, 50.0), ("ti-60", 96, 8.08), ("infineon-60", 280, 20.99), ("ancortek-5.8", 128, 47.97),
     ("ancortek-24", 128, 25.58), ("xband-fmcw", 1008, 1889.0)],
)  # fmt: skip
def test_samples_per_sweep_and_unambiguous_range(name, samples, reach_m):
    derived = list_derived_quantities(Radar.preset(name))
    assert derived["n_samples"] == samples
    assert derived["unambiguous_range_m"] == pytest.approx(reach_m, rel=1e-3)
    assert derived["sweep_slope_hz_per_s"] == pytest.approx(
        Radar.preset(name).bandwidth_hz * Radar.preset(name).sample_rate_hz / samples
    )


@pytest.mark.parametrize(
    ("name", "bins", "averages"), [("x4-17fps", 91, 64 * 87), ("x4-255fps", 91, 64 * 5), ("x4-512fps", 91, 185)]
)  # worked examples of the user guide: iterations x pulses per step
def test_x4_frames_and_averages(name, bins, averages):
    radar = Radar.preset(name)
    assert radar.n_range_bins == bins
    assert radar.averages_per_frame == pytest.approx(averages, rel=4e-3)
    assert list_derived_quantities(radar)["unambiguous_range_m"] == pytest.approx(9.87, abs=5e-3)


def test_pulse_of_the_a121_has_its_profiles_width():
    # profile 5: 0.32 m full width at half maximum of the amplitude, s = width / (2 sqrt(2 ln 2)) in range
    radar = Radar.preset("acconeer-a121")
    assert radar.sigma_s * C / 2 * 2.35482 == pytest.approx(0.32, rel=1e-3)
    assert radar.averages_per_frame == 16
    assert list_derived_quantities(radar)["unambiguous_range_m"] == pytest.approx(9.6, abs=0.02)


@pytest.mark.parametrize("name", [n for n in ("x4", "x4-long", "x4-high", "x4-17fps", "x4-255fps", "x4-512fps")])
def test_noise_of_the_x4_follows_from_its_taps_and_the_noise_of_rf_samples(name):
    """E-18b and E-18c, from the driver's taps and 1.80e-5 units per RF sample at 4096 pulses a threshold."""
    radar = Radar.preset(name)
    in_phase, quadrature = (np.array(taps) for taps in CHIP_TAPS["high" if name == "x4-high" else "low"])
    taps = in_phase - 1j * quadrature
    turns = radar.carrier_hz / radar.sample_rate_hz * np.arange(32)
    energy, gain = np.sum(np.abs(taps) ** 2), np.abs(np.sum(taps * np.exp(2j * np.pi * turns)))
    assert radar.noise_bandwidth_hz == pytest.approx(radar.sample_rate_hz * energy / gain**2, rel=1e-4)
    mixed = taps * np.exp(2j * np.pi * turns)
    lags = [np.vdot(mixed[:-shift], mixed[shift:]).real / energy for shift in (8, 16, 24)]
    np.testing.assert_allclose(radar.noise_correlation, lags, atol=1e-4)
    input_noise_v = np.sqrt(50 * 4.004e-21 * 10**0.6 * 10 * radar.sample_rate_hz / 2)
    steps = (1.80e-5 * 1024) ** 2 * 4096 * np.sqrt(np.pi)  # codes: the variance is s / (sqrt(pi) n)
    assert steps == pytest.approx(2.47, abs=0.005)
    assert radar.threshold_step_v == pytest.approx(input_noise_v / steps, rel=1e-3)
    one_unit = gain / 2 / np.abs(in_phase).sum()
    assert radar.volts_per_unit == pytest.approx(1024 * radar.threshold_step_v / one_unit, rel=1e-3)
    # back to the file: noise of the chip's baseband, in its unit, is that of the RF samples through the taps
    at_4096_v2 = noise_power_v2(radar) * radar.averages_per_frame / 4096
    through_db = 20 * np.log10(1.80e-5) + 10 * np.log10(energy / np.abs(in_phase).sum() ** 2)
    assert 10 * np.log10(at_4096_v2 / radar.volts_per_unit**2) == pytest.approx(through_db, abs=0.01)


@pytest.mark.parametrize("name", sorted({*SPEEDS_MPS, *BINS_CM, "xband-cw"} - WITHOUT_SOURCES))
def test_every_value_names_its_source(name):
    text = (resources.files("doppelgait.radar.presets") / f"{name}.toml").read_text(encoding="utf-8")
    assert text.startswith("# ")
    for line in text.splitlines()[1:]:
        if not line.startswith("name"):
            key, _, comment = line.partition("#")
            assert len(comment.strip()) > 5, key


def test_derived_quantities_of_the_link_budget():
    # -80.7 dBm by hand for the X4 (E-14); noise -82.5 dBm in 1.4 GHz + 6 dB + 10 dB gain, 94 averages; here 1.139 GHz,
    # and a counter with input noise of 2.47 steps
    less_db = 10 * np.log10(1.4 / 1.1391 * 2.467 * np.sqrt(np.pi))
    derived = list_derived_quantities(Radar.preset("x4"))
    assert derived["received_power_1m2_5m_dbm"] == pytest.approx(-80.7, abs=0.05)
    assert derived["noise_level_dbv"] == pytest.approx(-82.5 + 6 + 10 - 10 * np.log10(94) - 10 - less_db, abs=0.05)
    assert derived["snr_1m2_5m_db"] == pytest.approx(-80.7 + 82.5 - 6 + 10 * np.log10(94) + less_db, abs=0.1)
    assert derived["velocity_resolution_100ms_mps"] == pytest.approx(0.2056, abs=1e-4)
    assert "unambiguous_range_m" not in list_derived_quantities(Radar.preset("infineon-24"))
    json.dumps([list_derived_quantities(Radar.preset(name)) for name in list_preset_names()], allow_nan=False)


PRESET = """
name = "my X4"
carrier_hz = 7.29e9
sample_rate_hz = 23.328e9
decimation = 8
prf_hz = 200
range_stop_m = 5.0
bandwidth_hz = 1.4e9

[[impairments]]
kind = "phase_noise"
drift_rad_per_min = 0.2

[[impairments]]
kind = "static_clutter"

[[environment]]
kind = "wall"
"""


def test_a_file_is_a_preset_and_its_lists_are_beside_the_radar(tmp_path):
    path = tmp_path / "my-x4.toml"
    path.write_text(PRESET)
    for name in (path, str(path)):
        radar = Radar.preset(name, prf_hz=300.0)
        assert (radar.name, radar.prf_hz, radar.n_range_bins) == ("my X4", 300.0, 98)
        assert [entry["kind"] for entry in read_full_preset(name)["impairments"]] == ["phase_noise", "static_clutter"]
        assert read_full_preset(name)["environment"] == [{"kind": "wall"}]
    assert Radar.from_toml(str(path)) == Radar.preset(path)
    assert Radar.preset(path, pulse_sigma_s=1e-9).bandwidth_hz is None  # the two ways to give the pulse
    assert Radar.preset("liland2018", bandwidth_hz=1e9).pulse_sigma_s is None


def test_a_file_starts_from_a_preset_or_a_file_and_changes_values(tmp_path):
    (tmp_path / "mine").mkdir()
    own, later = tmp_path / "mine" / "own.toml", tmp_path / "later.toml"
    own.write_text('preset = "x4"\nprf_hz = 500\npulse_sigma_s = 3e-10\n[[impairments]]\nkind = "adc"\n')
    assert Radar.preset(own) == Radar.preset("x4", prf_hz=500.0, pulse_sigma_s=3e-10)
    later.write_text('preset = "mine/own.toml"\ntx_power_dbm = 3\nrange_stop_m = { uniform = [4.0, 6.0] }\n')
    assert Radar.preset(later) == Radar.preset(own, tx_power_dbm=3.0, range_stop_m=5.0)
    assert read_full_preset(later)["impairments"] == [{"kind": "adc"}]
    assert "preset" not in read_full_preset(later)
    assert Radar.preset("x4").prf_hz == 1000.0, "the built-in preset was changed"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (PRESET.replace("= 200", "= -200"), r"radar \(preset .*mine\.toml\): prf_hz: -200 .*greater than or equal"),
        ("prf_hz = = 3", r"mine\.toml: is not TOML"),
        (None, r"mine\.toml: cannot be read"),
        ('preset = "x44"', r"mine\.toml: preset \(line 1\): unknown radar preset 'x44'; known are"),
        ('prf_hz = 3\npreset = "mine.toml"', r"preset \(line 2\): the file is based on itself"),
        ("preset = 4", r"preset \(line 1\): its value: int is not allowed; name a preset or a file"),
        ('preset = "x4"\nprf = 3', r"mine\.toml\): prf: unknown key; allowed are .*prf_hz"),
    ],
)
def test_faults_of_a_file_name_it(tmp_path, text, message):
    if text is not None:
        (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        Radar.preset(tmp_path / "mine.toml")
    assert str(caught.value).count("(line") <= ("TOML" not in message)


@pytest.mark.parametrize(("name", "meant"), [("X4", "x4"), ("x4-lnog", "x4-long"), ("iwr6843", "ti-60"), ("lidar", "")])
def test_an_unknown_name_is_refused_with_those_that_exist_and_the_one_that_was_meant(name, meant):
    words = rf"; did you mean {meant}\?" * bool(meant)
    with pytest.raises(
        ConfigError, match=rf"preset '{name}'; known are: .*x4-17fps.*xband-fmcw{words}; or give the path"
    ):
        read_full_preset(name)


def test_the_command_prints_a_radar_file_that_reads_back(tmp_path):
    (tmp_path / "my-x4.toml").write_text(PRESET)
    for name in (*list_preset_names(), str(tmp_path / "my-x4.toml")):
        again = tmp_path / "again.toml"
        again.write_text(run("radar", "show", name, "--toml").stdout)
        assert Radar.preset(again) == Radar.preset(name)
        assert parse_lists(again) == parse_lists(name)
    again.write_text(run("radar", "show", "x4", "--toml", "--set", "prf_hz=600").stdout)
    assert Radar.preset(again) == Radar.preset("x4", prf_hz=600.0)


def parse_lists(name):
    return {key: read_full_preset(name).get(key) for key in ("environment", "impairments")}


def test_the_command_shows_presets_and_a_file(tmp_path):
    path = tmp_path / "my-x4.toml"
    path.write_text(PRESET)
    for name in ("x4", "ti-77", "infineon-24-burst", "xband-cw", str(path)):
        plain = run("radar", "show", name)
        assert "unambiguous_velocity_mps" in plain.output
        document = json.loads(run("radar", "show", name, "--json").stdout)
        assert document["parameters"]["waveform"] == Radar.preset(name).waveform.kind
        assert document["effects"]["noise correlation"] in plain.output
        assert document["derived"] == list_derived_quantities(Radar.preset(name))
    assert "impairments, in this order: phase_noise, static_clutter" in plain.output
    assert document["impairments"][0]["drift_rad_per_min"] == 0.2
    assert "77.564 GHz" in run("radar", "list").stdout
    shown = run("radar", "show", "ti-77").stdout.splitlines()
    rows = {line.split()[0]: line.split()[1:] for line in shown if line.strip()}
    assert rows["unambiguous_range_m"] == ["49.998", "m"]
    assert rows["sweep_slope_hz_per_s"][1] == "Hz/s"
    assert rows["snr_1m2_5m_db"][1] == "dB"


def effects_table():
    """The table of docs/radars.md: what every preset simulates, from its file."""
    rows = {}
    for name in list_preset_names():
        impairments = {entry["kind"] for entry in read_full_preset(name).get("impairments", ())}
        rows[name] = describe_effects(Radar.preset(name), impairments)
    head = ["preset", *next(iter(rows.values()))]
    cells = [head, ["---"] * len(head), *([f"`{name}`", *effects.values()] for name, effects in rows.items())]
    return "\n".join("| " + " | ".join(row) + " |" for row in cells)


def test_documented_effects_are_those_of_the_files():
    page = (Path(__file__).parents[2] / "docs" / "radars.md").read_text(encoding="utf-8")
    assert effects_table() in page, f"put this table into docs/radars.md:\n{effects_table()}"


@pytest.mark.parametrize("name", sorted({*SPEEDS_MPS, *BINS_CM, "xband-cw", "liland2018"}))
def test_every_preset_says_which_effects_it_has(name):
    """Each effect is a key with its source, or stated in a comment."""
    text = (resources.files("doppelgait.radar.presets") / f"{name}.toml").read_text(encoding="utf-8")
    comments = "\n".join(line for line in text.splitlines()[1:] if line.startswith("#"))
    for effect, keys in {
        "noise law": ("pulse_rate_hz", "threshold_step_v"), "noise correlation": ("noise_correlation",),
        "frame integration": ("integration_share",), "folding": ("fold_echoes",), "I/Q and clipping": (), "DC": (),
        "phase noise and jitter": (),
    }.items():  # fmt: skip
        assert any(f"\n{key} = " in text for key in keys) or effect in comments, effect
