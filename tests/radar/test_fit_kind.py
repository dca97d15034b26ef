"""Kinds of sensors from several recordings: every pooled value against the population it was drawn from."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from doppelgait.cli.app import app
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.pipeline import parse_run
from doppelgait.radar import Radar, Recording, write_recording
from doppelgait.radar.fit import (
    Estimate,
    calibrate_radar,
    fit_kind,
    fit_sensor,
    format_kind_preset,
    measure_recording,
    pool,
)
from doppelgait.radar.fit.measure import convert_ratio, find_converter
from doppelgait.radar.fit.model import find_noise_figure
from doppelgait.radar.fit.pool import find_mains_harmonic
from doppelgait.radar.link import list_derived_quantities, noise_power_v2

PRF_HZ = 400.0
CW = Radar(waveform="cw", carrier_hz=24e9, prf_hz=PRF_HZ, range_stop_m=10.0, noise_figure_db=10.0)
X4 = Radar.preset("x4", prf_hz=PRF_HZ, range_start_m=0.5, range_stop_m=2.0)


def normal(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / math.sqrt(2)


def recording(samples: np.ndarray, radar: Radar = CW, source: str = "one.h5", **facts: int) -> Recording:
    coords = {"slow_time": np.arange(len(samples)) / radar.prf_hz, "range": radar.range_axis_m()}
    return Recording.from_baseband(
        make_array(BASEBAND, samples.astype(np.complex64), coords, facts), radar, source=source
    )


def echo_of(rng: np.random.Generator, n: int, level_db: float, doppler_hz: float) -> np.ndarray:
    """Echo that approaches at a speed that wanders, by its phase written out."""
    speed = doppler_hz * (1 + 0.1 * np.cumsum(rng.normal(size=n)) / math.sqrt(n))
    return 10 ** (level_db / 20) * np.exp(2j * np.pi * np.cumsum(speed) / PRF_HZ + 1j * rng.uniform(0, 6))


def channels(y: np.ndarray, gain_db: float, phase_deg: float) -> np.ndarray:
    return y.real + 1j * 10 ** (gain_db / 20) * (y * np.exp(1j * np.radians(phase_deg))).imag


def test_means_and_spreads_are_within_their_uncertainty() -> None:
    """A mean of 3 and a spread of 0.5 below unequal errors, 300 times."""
    rng = np.random.default_rng(0)
    scores, ratios, covered, empty = [], [], 0, 0
    for _ in range(300):
        sd = rng.uniform(0.2, 1.0, size=12)
        found = pool(
            Estimate(x, s) for x, s in zip(3 + 0.5 * rng.normal(size=12) + sd * rng.normal(size=12), sd, strict=True)
        )
        scores.append((found.mean.value - 3) / found.mean.sd)
        ratios.append(found.spread / 0.5)
        covered += found.low <= 0.5 <= found.high
        same = pool(Estimate(3 + s * rng.normal(), s) for s in sd)
        empty += same.spread_is_known
    assert abs(np.mean(scores)) < 0.2
    assert 0.9 < np.sqrt(np.mean(np.square(scores))) < 1.25
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.2)
    assert 0.92 < covered / 300 < 0.98  # of an interval of 95 %
    assert empty / 300 < 0.05  # errors alone are no spread


def test_two_recordings_have_no_spread_and_none_is_refused() -> None:
    found = pool([Estimate(1.0, 0.1), Estimate(2.0, 0.1)])
    assert math.isnan(found.spread)
    assert not found.spread_is_known
    assert found.mean.value == 1.5
    assert found.mean.sd > 0.3  # they disagree by more than they should
    with pytest.raises(AnalysisError, match="nothing to pool"):
        pool([Estimate(math.nan, 1.0)])


def test_noise_of_one_bin_under_a_target_and_its_image() -> None:
    scores = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        clean = echo_of(rng, 6400, -40.0, 40.0)[:, None] + 10 ** (-70 / 20) * normal(rng, 6400, 1)
        found = measure_recording(recording(channels(clean, 1.5, 8.0))).estimates
        level_db = -70 + 10 * math.log10((1 + 10**0.15) / 2)
        truths = {"noise_level_db": level_db, "iq_gain_db": 1.5, "iq_phase_deg": 8.0, "noise_iq_gain_db": 1.5}
        scores.append([(found[name].value - truth) / found[name].sd for name, truth in truths.items()])
        assert found["iq_gain_db"].sd < 0.3
    z = np.array(scores)
    assert np.abs(z).max() < 5
    assert (np.abs(z.mean(axis=0)) < 1.3).all()
    assert (np.sqrt((z**2).mean(axis=0)) < 2.0).all()


def test_a_trembling_wall_has_no_image() -> None:
    """Side lines of a small phase modulation are alike on both sides, which an image would be, too."""
    rng = np.random.default_rng(1)
    wall = 0.1 * np.exp(0.3j * np.sin(2 * np.pi * 40 * np.arange(6400) / PRF_HZ))
    found = measure_recording(recording(wall[:, None] + 1e-4 * normal(rng, 6400, 1)))
    assert "iq_gain_db" not in found.estimates
    assert "one direction" in found.refused["I/Q image"]


def test_a_line_is_found_in_all_bins_and_a_target_is_none() -> None:
    rng = np.random.default_rng(2)
    n, bins = 6400, X4.n_range_bins
    samples = 1e-5 * normal(rng, n, bins)
    samples += 1e-5 * np.exp(2j * np.pi * 100.0 * np.arange(n) / PRF_HZ)[:, None]
    samples[:, 8:14] += echo_of(rng, n, -60.0, 55.0)[:, None]
    (line,) = measure_recording(recording(samples, X4)).lines
    assert line.frequency_hz == pytest.approx(100.0, abs=line.half_width_hz)
    assert line.level_db.value == pytest.approx(-100.0, abs=1.0)
    assert find_mains_harmonic(line.frequency_hz, PRF_HZ, 1.0) == "2 x 50 Hz"
    assert find_mains_harmonic(-100.0, 1000.0, 1.0) == "2 x 50 Hz"  # a real line has both signs
    assert find_mains_harmonic(37.0, 1000.0, 1.0) == ""


@pytest.mark.release
def test_noise_over_doppler_range_and_between_bins() -> None:
    from doppelgait.radar.impairments import apply_impairments, make_impairment

    rng = np.random.default_rng(3)
    wide = Radar.preset("x4", prf_hz=PRF_HZ)
    taps = normal(rng, 3200, wide.n_range_bins + 1)
    white = 1e-5 * (taps[:, 1:] + 0.5 * taps[:, :-1]) / math.sqrt(1.25)  # rho_1 = 0.4
    floor = make_impairment({"kind": "coloured_noise", "levels": [[0, -80], [50, -90], [100, -120]]})
    slope = make_impairment({"kind": "coloured_noise", "levels": [[0, -100]], "range_db": [[0, -20], [9.6, 6]]})
    shaped = [apply_impairments(white, [one], radar=wide, rng=rng).matrix for one in (floor, slope)]
    flat, coloured, sloping = (fit_kind([recording(x, wide)]) for x in (white, *shaped))
    assert flat.correlation == pytest.approx([0.4], abs=0.02)
    assert not flat.range_db
    assert max(abs(e.value) for _, e in flat.doppler) < 1.0
    by_doppler = {round(f): e.value for f, e in coloured.doppler}
    assert by_doppler[50] == pytest.approx(10.0, abs=1.0)
    assert by_doppler[25] == pytest.approx(15.0, abs=1.0)
    assert abs(by_doppler[150]) < 0.5
    first, *_, last = (level for _, level in sloping.range_db)
    assert last - first == pytest.approx(10 * math.log10((1 + 10**0.52) / 1.011), abs=0.7)
    assert 'kind = "coloured_noise"' in format_kind_preset(coloured)
    assert "noise over Doppler" not in coloured.refused
    bodies = np.stack([echo_of(rng, 3200, -60.0, 25.0) for _ in range(wide.n_range_bins)], axis=1)
    kind = fit_kind([recording(shaped[0] + bodies, wide)])
    entries = {entry["kind"]: entry for entry in tomllib.loads(format_kind_preset(kind))["impairments"]}
    levels = entries["coloured_noise"]["levels"]
    knots_hz, levels_db = np.array(levels).T
    white_db = kind.pooled["noise_level_db"].mean.value
    assert "no more than the white floor is assumed there" in kind.refused["noise over Doppler"]
    assert np.interp([0.0, 25.0], knots_hz, levels_db) == pytest.approx(white_db - 20.0, abs=0.1)


def test_converters_show_their_steps_and_their_ends() -> None:
    rng = np.random.default_rng(4)
    step, y = 1 / 2048, 0.5 * normal(rng, 20000, 1)
    codes = np.clip(np.round(y.real / step), -1024, 1023) + 1j * np.clip(np.round(y.imag / step), -1024, 1023)
    found, full, clipped = find_converter(codes * step)
    assert found == pytest.approx(step)
    assert full == pytest.approx(0.5)
    assert clipped.mean() == pytest.approx(float(np.mean((abs(y.real) > 0.4995) | (abs(y.imag) > 0.4995))), abs=0.01)
    assert math.isnan(find_converter(y)[0])
    inside = find_converter(np.round(0.05 * y / step) * step)
    assert inside[0] == pytest.approx(step)
    assert math.isnan(inside[1])


def test_channels_of_their_own_moments() -> None:
    rng = np.random.default_rng(5)
    y = channels(normal(rng, 400_000), -2.0, 12.0)
    gain_db, phase_deg = convert_ratio(complex(np.sum(y**2) / np.sum(np.abs(y) ** 2)))
    assert gain_db == pytest.approx(-2.0, abs=0.05)
    assert phase_deg == pytest.approx(12.0, abs=0.3)


@pytest.mark.parametrize("radar", [X4, X4.model_copy(update={"threshold_step_v": 1e-6}), CW])
def test_the_noise_figure_gives_the_level_back(radar: Radar) -> None:
    found = find_noise_figure(radar, Estimate(10 * math.log10(noise_power_v2(radar)), 0.5))
    assert found.value == pytest.approx(radar.noise_figure_db, abs=1e-6)
    assert found.sd == pytest.approx(1.0 if radar.threshold_step_v else 0.5, rel=0.01)  # a counter's goes with the root


def several(count: int, *, noise_apart: bool = False) -> list[Recording]:
    found = []
    for seed in range(count):
        rng = np.random.default_rng(100 + seed)
        noise = 10 ** (rng.normal(-70, 1.0) / 20) * normal(rng, 3200, 1)
        gain_db = rng.normal(2.0, 0.5)
        echo = echo_of(rng, 3200, -40.0, 40.0)[:, None]
        mixed = channels(echo, gain_db, 10.0) + noise if noise_apart else channels(echo + noise, gain_db, 10.0)
        found.append(recording(mixed + 0.01 - 0.02j, source=f"{seed}.h5"))
    return found


def test_the_preset_has_the_spreads_and_loads(tmp_path: Path) -> None:
    path = tmp_path / "my.toml"
    path.write_text(format_kind_preset(fit_kind(several(10))), encoding="utf-8")
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    kinds = {entry["kind"]: entry for entry in table["impairments"]}
    assert list(kinds) == ["iq_imbalance", "dc_leak"]
    mean, sd = kinds["iq_imbalance"]["gain_db"]["normal"]
    assert abs(mean - 2.0) < 0.6
    assert 0.2 < sd < 1.0
    assert kinds["iq_imbalance"]["phase_deg"] == pytest.approx(10.0, abs=1.5)  # does not differ: a number
    assert kinds["dc_leak"]["level_db"] == pytest.approx(20 * math.log10(math.hypot(0.01, 0.02)), abs=0.3)
    assert kinds["dc_leak"]["phase_deg"] == pytest.approx(-63.4, abs=2)
    assert "normal" in table["noise_figure_db"] or "uniform" in table["noise_figure_db"]
    runs = [parse_run({"duration_s": 1.0, "radar": str(path), "example": n}) for n in range(20)]
    assert len({run.impairments[0].gain_db for run in runs}) == 20
    text = path.read_text(encoding="utf-8")
    assert "do not add thermal_noise" in text
    assert "# Refused: clutter and phase noise: 1 range bins; 8 are needed (in 10 of 10 recordings)." in text


def test_noise_that_arises_behind_the_mixer_comes_after_it(tmp_path: Path) -> None:
    """Fitted again to what the model makes, echoes and noise have the channels that they had."""
    from doppelgait.radar.impairments import apply_impairments

    path = tmp_path / "my.toml"
    path.write_text(format_kind_preset(fit_kind(several(8, noise_apart=True))), encoding="utf-8")
    run = parse_run({"duration_s": 1.0, "radar": str(path)})
    text = path.read_text(encoding="utf-8")
    assert "the thermal_noise below replaces the noise of the radar" in text
    assert "do not add thermal_noise" not in text
    assert "not used: thermal_noise below" in text
    assert [spec.kind for spec in run.impairments][:3] == ["iq_imbalance", "thermal_noise", "iq_imbalance"]
    rng = np.random.default_rng(7)
    again = apply_impairments(
        echo_of(rng, 6400, -40.0, 40.0)[:, None], run.impairments, radar=run.radar, rng=rng
    ).matrix
    found = measure_recording(recording(again)).estimates
    assert found["iq_phase_deg"].value == pytest.approx(10.0, abs=4 * found["iq_phase_deg"].sd + 1)
    assert abs(found["noise_iq_gain_db"].value) < 4 * found["noise_iq_gain_db"].sd + 0.2


def test_the_range_of_people_sets_the_gain() -> None:
    from doppelgait.radar.link import echo_amplitude_v

    kind = fit_kind(several(4), people_at_m=3.0)
    level_db = 20 * math.log10(float(echo_amplitude_v(kind.radar, range_m=3.0, rcs_m2=0.8)))
    assert level_db == pytest.approx(-40.0, abs=1.0)


@pytest.mark.parametrize("step_v", [None, 1.236e-4])
@pytest.mark.parametrize("scale", [1000.0, 0.001])
def test_the_scale_of_the_values_changes_no_snr(step_v: float | None, scale: float) -> None:
    """Echo over noise of a room written out, in a radar that averages and in one that counts."""
    radar = X4.model_copy(update={"threshold_step_v": step_v})
    level_v, rooms = math.sqrt(noise_power_v2(radar)), []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        bins = radar.n_range_bins
        rooms.append(100 * level_v * normal(rng, bins) + level_v * normal(rng, 800, bins))
    several = [recording(scale * x, radar, source=f"{n}.h5") for n, x in enumerate(rooms)]
    snr_db = list_derived_quantities(radar)["snr_1m2_5m_db"]
    for found in (calibrate_radar(fit_sensor(several[0])), fit_kind(several).radar):
        derived = list_derived_quantities(found)
        assert derived["snr_1m2_5m_db"] == pytest.approx(snr_db, abs=0.3)
        assert derived["noise_level_dbv"] == pytest.approx(20 * math.log10(scale * level_v), abs=0.3)
    for fitted in (fit_kind, lambda several: calibrate_radar(fit_sensor(several[0]))):
        with pytest.raises(ConfigError, match=r"receiver_gain_db: .* is not allowed"):
            fitted([recording(1e8 * x, radar) for x in rooms])


@pytest.mark.parametrize("own", ["gain", "figure"])
def test_a_spread_of_gain_is_none_of_the_noise_figure(own: str) -> None:
    """Units whose gain differs move echoes and noise together, units whose noise figure differs the noise alone."""
    wide = Radar.preset("x4", prf_hz=PRF_HZ, range_start_m=0.0, range_stop_m=3.0, threshold_step_v=None)
    level_v, found = math.sqrt(noise_power_v2(wide)), []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        changes = 10 ** (3.0 * rng.normal() / 20)
        static = 100 * level_v * normal(np.random.default_rng(9), wide.n_range_bins)
        static += 2e4 * level_v * np.exp(-((wide.range_axis_m() / 0.1) ** 2))
        noise = level_v * normal(rng, 800, wide.n_range_bins)
        samples = changes * (static + noise) if own == "gain" else static + changes * noise
        found.append(recording(samples, wide, source=f"{seed}.h5"))
    pooled = fit_kind(found).pooled
    figure = pooled["noise_figure_db"]
    if own == "gain":
        assert pooled["gain_db"].spread > 1.5
        assert figure.spread < 0.3
    else:
        assert "gain_db" not in pooled
        assert figure.spread > 1.5


def test_recordings_that_do_not_fit_the_others_are_left_out_with_a_line() -> None:
    """Frames of another rate average another number of pulses, so that their noise has another level."""
    rng = np.random.default_rng(8)
    other, slow = CW.model_copy(update={"carrier_hz": 77e9}), CW.model_copy(update={"prf_hz": CW.prf_hz / 10})
    short = recording(normal(rng, 16, 1), source="short.h5")
    odd = [recording(normal(rng, 900, 1), radar) for radar in (other, slow)]
    kind = fit_kind([*several(2), short, *odd])
    assert len(kind.recordings) == 2
    for why in (
        "short.h5: 16 pulses",
        "carrier 77 GHz instead of the 24 GHz of",
        "40 frames a second instead of the 400",
    ):
        assert any(why in line for line in kind.left_out)
    with pytest.raises(AnalysisError, match="no recording can be used"):
        fit_kind([short])


def test_a_folder_on_the_command_line(tmp_path: Path) -> None:
    (tmp_path / "week" / "monday").mkdir(parents=True)
    for number, one in enumerate(several(4)):
        write_recording(one, tmp_path / "week" / ("monday" if number % 2 else ".") / f"{number}.h5")
    (tmp_path / "week" / "notes.txt").write_text("none of them", encoding="utf-8")
    out = tmp_path / "my.toml"
    result = CliRunner().invoke(app, ["radar", "fit", str(tmp_path / "week"), "-o", str(out)])
    assert result.exit_code == 0, result.output
    assert "iq_gain_db" in result.output
    assert Radar.preset(out).waveform.kind == "cw"
    refused = CliRunner().invoke(app, ["radar", "fit", str(tmp_path / "week"), "-o", str(out), "--start", "1"])
    assert refused.exit_code != 0
