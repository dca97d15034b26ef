"""Sensor model from an empty room: every estimate against recordings made here with known values."""

import math
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from scipy.optimize import minimize
from scipy.stats import multivariate_normal
from typer.testing import CliRunner

from doppelgait.cli.radar import fit as fit_command
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.radar import Radar, Recording, write_recording
from doppelgait.radar.fit import (
    Estimate,
    SensorFit,
    calibrate_radar,
    estimate_rows,
    fit_sensor,
    format_calibrated_preset,
    sensor_as_dict,
)
from doppelgait.radar.fit.room import (
    compute_factor_variance,
    compute_leverage,
    estimate_leakage,
    find_frame_faults,
    fit_clutter_profile,
    fit_series,
    fit_static_part,
    multiply_correlation,
    take_root,
)
from doppelgait.radar.impairments import apply_impairments, make_impairment
from doppelgait.radar.link import noise_power_v2

PRF_HZ = 25.0
COUNTER = Radar.preset("x4", prf_hz=PRF_HZ, range_start_m=0.7, range_stop_m=6.85)
RADAR = Radar.model_validate(
    {**COUNTER.model_dump(), "threshold_step_v": None, "noise_bandwidth_hz": None, "noise_correlation": ()}
)
"""It averages: its noise is in proportion to noise figure and gain."""
RANGE_M = RADAR.range_axis_m()
LEVELS = ((0.7, -45.0), (2.0, -62.0), (7.0, -75.0))
NOISE_DB = -105.0
WHITE_RAD, DRIFT, WALK = 0.004, -0.1, 0.02
GAIN_DRIFT, GAIN_WHITE_DB = 0.3, 0.007


def normal(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Complex circular Gaussian of unit mean square."""
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / math.sqrt(2)


def mean_level_db(range_m: np.ndarray) -> np.ndarray:
    return np.interp(range_m, *zip(*LEVELS, strict=True))


def room(
    seed: int, *, frames: int = 600, correlated: bool = False, clutter_db: float = 0.0, still: bool = False,
    slope_db_per_m: float = 0.0, noise_db: float = NOISE_DB,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Samples of an empty room, and its static echo, by the model written out."""
    rng = np.random.default_rng(seed)
    n = RANGE_M.size
    echo = 10 ** ((mean_level_db(RANGE_M) + clutter_db) / 20) * normal(rng, n)
    time_min = np.arange(frames) / PRF_HZ / 60
    walk = np.cumsum(rng.normal(size=frames)) * WALK * math.sqrt(1 / PRF_HZ / 60)
    phase = DRIFT * time_min + walk + WHITE_RAD * rng.normal(size=frames)
    gain_db = GAIN_DRIFT * time_min + GAIN_WHITE_DB * rng.normal(size=frames)
    factor = np.ones(frames) if still else 10 ** (gain_db / 20) * np.exp(1j * phase)
    noise = normal(rng, frames, n + 2)
    if correlated:  # taps 1, 2, 1: rho_1 = 2/3, rho_2 = 1/6
        noise = (noise[:, :-2] + 2 * noise[:, 1:-1] + noise[:, 2:]) / math.sqrt(6)
    level_db_ = noise_db + slope_db_per_m * (RANGE_M - RANGE_M.mean())
    return factor[:, None] * echo + noise[:, :n] * 10 ** (level_db_ / 20), echo


def recording(samples: np.ndarray, radar: Radar = RADAR, range_m: np.ndarray = RANGE_M) -> Recording:
    coords = {"slow_time": np.arange(len(samples)) / radar.prf_hz, "range": range_m}
    return Recording.from_baseband(make_array(BASEBAND, samples.astype(np.complex64), coords), radar, source="room.h5")


def compared(fit: SensorFit) -> dict[str, tuple[Estimate, float]]:
    assert fit.phase is not None
    assert fit.gain is not None
    minute = 60.0
    return {
        "noise": (fit.noise_level_db, NOISE_DB),
        "slope": (fit.noise.slope_db_per_m, 0.0),
        "drift": (fit.phase.drift_per_s.scale(minute), DRIFT),
        "walk": (fit.phase.walk_per_root_s.scale(math.sqrt(minute)), WALK),
        "white": (fit.phase.white, WHITE_RAD),
        "gain_drift": (fit.gain.drift_per_s.scale(minute), GAIN_DRIFT),
        "gain_white": (fit.gain.white, GAIN_WHITE_DB),
    }


LARGEST_SD = {
    "noise": 0.08, "slope": 0.05, "drift": 0.1, "walk": 0.008, "white": 0.0004, "gain_drift": 0.02, "gain_white": 0.0006
}  # fmt: skip


@pytest.mark.parametrize("correlated", [False, True])
def test_every_estimate_lies_within_its_uncertainty(correlated: bool) -> None:
    scores = []
    for seed in range(6):
        values = compared(fit_sensor(recording(room(seed, correlated=correlated)[0])))
        scores.append({name: (e.value - truth) / e.sd for name, (e, truth) in values.items()})
        assert all(e.sd < LARGEST_SD[name] for name, (e, _) in values.items())
    for name in scores[0]:
        z = np.array([score[name] for score in scores])
        assert np.abs(z).max() < 4.5, name
        assert abs(z.mean()) < 1.3, name  # a mean of 6 has an sd of 0.41
        assert 0.3 < np.sqrt(np.mean(z**2)) < 2.0, name  # uncertainties are neither boasting nor shy


def test_correlated_noise_counts_as_fewer_independent_bins() -> None:
    plain = fit_sensor(recording(room(1)[0])).noise
    smooth = fit_sensor(recording(room(1, correlated=True)[0])).noise
    assert plain.independent_bins == pytest.approx(RANGE_M.size, rel=0.02)
    assert np.abs(smooth.correlation[1:4]) == pytest.approx([2 / 3, 1 / 6, 0], abs=0.02)
    assert not smooth.correlation[4:].any()  # lags within chance of 0 count for nothing
    assert smooth.independent_bins == pytest.approx(RANGE_M.size / (1 + 2 * (4 / 9 + 1 / 36)), rel=0.03)


def test_noise_does_not_see_static_echoes_however_strong() -> None:
    """Strong static echoes with phase jitter put 40 dB over the noise into the differences of their own bins."""
    strong = fit_sensor(recording(room(3, clutter_db=20.0)[0]))
    assert strong.noise_level_db.value == pytest.approx(NOISE_DB, abs=0.2)


def test_flat_and_sloping_noise_are_told_apart() -> None:
    flat, sloping = (fit_sensor(recording(room(4, slope_db_per_m=slope)[0])) for slope in (0.0, 1.0))
    assert flat.noise.flat
    assert not sloping.noise.flat
    slope = sloping.noise.slope_db_per_m
    assert abs(slope.value - 1.0) < 4 * slope.sd
    assert any("not flat" in flag for flag in sloping.flags)


def test_noise_figure_and_gain_reproduce_the_noise() -> None:
    """kT0 B F G 2 Z0 / N at F = 9 dB, written out; B of a Gaussian pulse is 1.4 GHz at -10 dB."""
    averages = math.floor(0.95 * 15.1875e6 / (PRF_HZ * 152))
    power = 2 * 50 * 4.004e-21 * 10**0.9 * 1.4e9 * 10**1.0 / averages
    fit = fit_sensor(recording(room(5, noise_db=10 * math.log10(power))[0]))
    assert fit.noise_figure_db.value == pytest.approx(9.0, abs=4 * fit.noise_figure_db.sd)
    assert fit.receiver_gain_db.value == pytest.approx(13.0, abs=4 * fit.receiver_gain_db.sd)
    assert fit.noise_figure_db.sd < 0.1
    assert calibrate_radar(fit).noise_figure_db == pytest.approx(fit.noise_figure_db.value)


def test_noise_of_a_counter_changes_with_the_root_of_the_noise_figure() -> None:
    """3 dB more noise than at 6 dB are 6 dB more input noise: noise figure 12 dB, or gain 16 dB."""
    level_db = 10 * math.log10(noise_power_v2(COUNTER)) + 3.0
    fit = fit_sensor(recording(room(5, noise_db=level_db)[0], COUNTER))
    assert fit.noise_figure_db.value == pytest.approx(12.0, abs=4 * fit.noise_figure_db.sd)
    assert fit.receiver_gain_db.value == pytest.approx(16.0, abs=4 * fit.receiver_gain_db.sd)
    assert fit.noise_figure_db.sd == pytest.approx(2.0 * fit.noise_level_db.sd)
    own = calibrate_radar(fit)
    assert own.noise_figure_db == pytest.approx(fit.noise_figure_db.value)
    assert 10 * math.log10(noise_power_v2(own)) == pytest.approx(fit.noise_level_db.value, abs=1e-3)


def test_fitted_correlation_goes_into_the_radar() -> None:
    own = calibrate_radar(fit_sensor(recording(room(5, correlated=True)[0])))
    np.testing.assert_allclose(own.noise_correlation, [2 / 3, 1 / 6], atol=0.01)
    assert calibrate_radar(fit_sensor(recording(room(5)[0]))).noise_correlation == ()


def test_implausible_noise_figure_changes_the_gain_instead() -> None:
    fit = fit_sensor(recording(room(5, noise_db=-70.0, clutter_db=35.0)[0]))
    preset = calibrate_radar(fit)
    assert preset.noise_figure_db == RADAR.noise_figure_db
    assert preset.receiver_gain_db == pytest.approx(fit.receiver_gain_db.value)
    assert any("noise figure" in flag for flag in fit.flags)


def test_static_echo_is_recovered_bin_by_bin_despite_drift() -> None:
    """Two radians of drift would take 16 % off a time mean."""
    samples, echo = room(6, still=True)
    turned = samples * np.exp(2j * np.linspace(-1, 1, len(samples)))[:, None]
    found = fit_sensor(recording(turned)).echo_v
    error = found * np.exp(-1j * np.angle(np.vdot(echo, found))) - echo
    assert np.abs(error).max() < 5 * 10 ** (NOISE_DB / 20) / math.sqrt(len(samples))


def test_clutter_profile_is_the_mean_level_of_many_rooms() -> None:
    deviations = []
    for seed in range(12):
        profile = fit_sensor(recording(room(seed, frames=64)[0])).clutter
        assert profile.range_m.size <= 20
        deviations.append((profile.level_db - mean_level_db(profile.range_m)) / profile.sd_db)
    z = np.array(deviations)
    assert abs(z.mean()) < 0.35  # a mean of dB values would lie 2.5 dB = one sd low
    assert np.abs(z).max() < 4.0


def test_clutter_profile_maximises_the_exponential_likelihood() -> None:
    rng = np.random.default_rng(6)
    echo = 10 ** (mean_level_db(RANGE_M) / 20) * normal(rng, RANGE_M.size)
    found = fit_clutter_profile(echo, range_m=RANGE_M, noise_power_v2=0.0, resolution_m=RADAR.range_resolution_m)
    power = np.abs(echo) ** 2

    def cost(level_db: np.ndarray) -> float:
        mean = 10 ** (np.interp(RANGE_M, found.range_m, level_db) / 10)
        return float(np.sum(np.log(mean) + power / mean))

    for knot in range(found.range_m.size):
        for step in (-0.05, 0.05):
            other = found.level_db.copy()
            other[knot] += step
            assert cost(other) > cost(found.level_db)


def test_noise_left_in_the_static_echo_is_taken_off() -> None:
    """Noise alone, -60 dB: the profile must lie far below it."""
    echo = 1e-3 * normal(np.random.default_rng(2), RANGE_M.size)
    found = fit_clutter_profile(echo, range_m=RANGE_M, noise_power_v2=1e-6, resolution_m=RADAR.range_resolution_m)
    assert np.median(found.level_db) < -62.0


def test_level_of_the_direct_path_scatters_as_its_uncertainty_says() -> None:
    rng = np.random.default_rng(4)
    levels = []
    for _ in range(400):
        echo = 1e-5 * normal(rng, RANGE_M.size)
        echo[3] += 1e-3
        found = estimate_leakage(echo, range_m=RANGE_M, noise_power_v2=1e-10)
        levels.append(found.level_db)
    assert np.mean([e.value for e in levels]) == pytest.approx(-60.0, abs=0.01)
    assert np.std([e.value for e in levels]) == pytest.approx(levels[0].sd, rel=0.12)


def test_series_maximises_the_dense_gaussian_likelihood() -> None:
    rng = np.random.default_rng(7)
    time_s = np.arange(60) / 10.0
    x = 0.05 * time_s + np.cumsum(rng.normal(size=60)) * 0.02 + 0.03 * rng.normal(size=60)
    d, step = np.diff(x), np.diff(time_s)
    second = 2 * np.eye(59) - np.eye(59, k=1) - np.eye(59, k=-1)

    def dense(p: np.ndarray) -> float:
        cov = np.exp(p[0]) * 0.1 * np.eye(59) + np.exp(p[1]) * second
        inverse = np.linalg.inv(cov)
        slope = step @ inverse @ d / (step @ inverse @ step)
        likelihood = multivariate_normal(mean=slope * step, cov=cov).logpdf(d)
        return float(-likelihood + 0.5 * math.log(step @ inverse @ step))

    best = minimize(dense, np.log([1e-3, 1e-3]), method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-9})
    found = fit_series(x, time_s=time_s)
    assert found.walk_per_root_s.value == pytest.approx(math.exp(best.x[0] / 2), rel=2e-3)
    assert found.white.value == pytest.approx(math.exp(best.x[1] / 2), rel=2e-3)
    cov = math.exp(best.x[0]) * 0.1 * np.eye(59) + math.exp(best.x[1]) * second
    inverse = np.linalg.inv(cov)
    assert found.drift_per_s.value == pytest.approx(step @ inverse @ d / (step @ inverse @ step), rel=2e-3)
    assert found.drift_per_s.sd == pytest.approx((step @ inverse @ step) ** -0.5, rel=2e-3)


def test_series_takes_off_what_the_measurement_adds_and_knows_a_pure_ramp() -> None:
    rng = np.random.default_rng(8)
    time_s = np.arange(4000) / 25.0
    found = fit_series(0.05 * rng.normal(size=4000), time_s=time_s, measurement_variance=0.03**2)
    assert abs(found.white.value - 0.04) < 4 * found.white.sd
    ramp = fit_series(0.5 * time_s, time_s=time_s)
    assert ramp.drift_per_s.value == pytest.approx(0.5)
    assert ramp.white.value == pytest.approx(0.0, abs=1e-9)


def test_leverage_and_phase_variance_equal_those_of_the_dense_covariance() -> None:
    rng = np.random.default_rng(9)
    n, power = 30, 0.3
    rho = np.zeros(4, dtype=complex)
    rho[:3] = 1.0, 0.5 * np.exp(0.4j), 0.1j
    dense = np.zeros((n, n), dtype=complex)
    for a in range(n):
        for b in range(n):
            if abs(a - b) < 4:
                dense[a, b] = rho[a - b] if a >= b else rho[b - a].conj()
    echo = normal(rng, n) * np.linspace(3, 0.5, n)
    static = fit_static_part(np.exp(1j * rng.normal(size=40))[:, None] * echo)
    c = static.echo_v
    energy = np.vdot(c, c).real
    remove = np.eye(n) - np.outer(c, c.conj()) / energy
    left = np.real(np.diag(remove @ dense @ remove.conj().T))
    assert compute_leverage(static, rho) == pytest.approx(1 - left, abs=1e-9)
    assert multiply_correlation(c, rho) == pytest.approx(dense @ c)
    wanted = np.real(np.vdot(c, dense @ c)) * power / (2 * energy**2)
    assert compute_factor_variance(static, rho, noise_power_v2=power) == pytest.approx(wanted)


def test_a_target_is_named_and_does_not_spoil_the_rest() -> None:
    samples, _ = room(10)
    time_s = np.arange(len(samples)) / PRF_HZ
    breath = np.exp(1j * 1.5 * np.sin(2 * np.pi * 0.25 * time_s))
    shape = np.exp(-((RANGE_M - 3.0) ** 2) / (2 * 0.052**2)) * 10 ** (-65 / 20)
    fit = fit_sensor(recording(samples + breath[:, None] * shape))
    (target,) = fit.moving
    assert target.start_m == pytest.approx(2.85, abs=0.12)
    assert target.stop_m == pytest.approx(3.15, abs=0.12)
    assert target.excess_db == pytest.approx(39.0, abs=3.0)  # -65 + 105, less what a time mean keeps
    assert any("not empty" in flag for flag in fit.flags)
    for name, (estimate, truth) in compared(fit).items():
        assert abs(estimate.value - truth) < 4.5 * estimate.sd, name


def test_an_empty_room_raises_no_flag() -> None:
    fit = fit_sensor(recording(room(11)[0]))
    assert fit.flags == ()
    assert fit.moving == ()
    assert fit.n_used == fit.n_frames == 600


def test_interference_is_found_and_left_out() -> None:
    samples, _ = room(12)
    rng = np.random.default_rng(0)
    struck = [50, 51, 200, 333]
    for frame in struck:
        samples[frame, 40:46] += normal(rng, 6) * 10 ** (-80 / 20)
    fit = fit_sensor(recording(samples))
    assert np.flatnonzero(fit.bursts.frames).tolist() == struck
    assert fit.bursts.mean_length == pytest.approx(4 / 3)
    assert fit.bursts.level_db == pytest.approx(-80.0, abs=2.5)
    assert fit.bursts.share == pytest.approx(6 / RANGE_M.size, rel=0.35)
    assert fit.n_used == 596
    assert abs(fit.noise_level_db.value - NOISE_DB) < 4 * fit.noise_level_db.sd


def test_dropped_frames_are_counted_and_left_out() -> None:
    samples, _ = room(13)
    for frame in (100, 101, 102, 300):
        samples[frame] = samples[frame - 1]
    samples[400:402] = 0
    fit = fit_sensor(recording(samples))
    assert np.flatnonzero(fit.faults.dropped).tolist() == [100, 101, 102, 300, 400, 401]
    assert fit.faults.blank == 2
    assert fit.faults.probability.value == pytest.approx(6 / 600)
    assert fit.faults.mean_length == pytest.approx(2.0)
    for name, (estimate, truth) in compared(fit).items():
        assert abs(estimate.value - truth) < 4.5 * estimate.sd, name


def test_missing_times_count_as_lost() -> None:
    time_s = np.delete(np.arange(200) / 10.0, [20, 21, 90])
    faults = find_frame_faults(normal(np.random.default_rng(1), 197, 8), slow_time_s=time_s)
    assert faults.lost == 3
    assert not faults.dropped.any()
    assert faults.probability.value == pytest.approx(3 / 200)


def test_the_share_of_dropped_frames_lies_within_its_uncertainty() -> None:
    scores = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        samples = normal(rng, 400, 4)
        for frame in np.flatnonzero(rng.random(400) < 0.05):
            samples[max(frame, 1)] = samples[max(frame, 1) - 1]
        found = find_frame_faults(samples, slow_time_s=np.arange(400.0)).probability
        scores.append((found.value - 0.05) / found.sd)
    assert abs(np.mean(scores)) < 0.5
    assert 0.7 < np.std(scores) < 1.4


def test_direct_path_and_constant() -> None:
    samples, _ = room(14)
    peak = 10 ** (-38 / 20)
    samples += peak * np.exp(-((RANGE_M - RANGE_M[2]) ** 2) / (2 * 0.052**2)) + 4e-3 * np.exp(1j)
    fit = fit_sensor(recording(samples))
    assert fit.leakage.range_m == pytest.approx(RANGE_M[2], abs=0.06)
    assert fit.leakage.level_db.value == pytest.approx(-38.0, abs=4.0)  # clutter of -45 and the constant ride on it
    assert abs(fit.leakage.constant_v.value - 4e-3) < 4 * fit.leakage.constant_v.sd
    assert fit.leakage.constant_v.sd < 4e-4
    assert "dc_leak" in [entry["kind"] for entry in tomllib.loads(format_calibrated_preset(fit))["impairments"]]


def test_without_static_echoes_phase_is_not_claimed() -> None:
    """Aligned to a phase that is noise, the time mean of the noise would not shrink with the number of frames."""
    fit = fit_sensor(recording(room(15, clutter_db=-120.0)[0]))
    assert np.sum(np.abs(fit.echo_v) ** 2) == pytest.approx(RANGE_M.size * 10 ** (NOISE_DB / 10) / 600, rel=0.4)
    assert fit.phase is None
    assert fit.gain is None
    assert any("too weak" in flag for flag in fit.flags)
    assert abs(fit.noise_level_db.value - NOISE_DB) < 4 * fit.noise_level_db.sd
    kinds = [entry["kind"] for entry in tomllib.loads(format_calibrated_preset(fit))["impairments"]]
    assert kinds == ["static_clutter"]


def test_only_a_part_of_the_recording() -> None:
    samples, _ = room(16)
    samples[300:] *= 3.0
    fit = fit_sensor(recording(samples), stop_s=299 / PRF_HZ)
    assert fit.n_frames == 300
    assert abs(fit.noise_level_db.value - NOISE_DB) < 4 * fit.noise_level_db.sd


def test_recordings_that_cannot_be_fitted_are_refused() -> None:
    good, _ = room(17, frames=64)
    with pytest.raises(AnalysisError, match=r"room\.h5: 8 frames .* at least 32 frames"):
        fit_sensor(recording(good[:8]))
    with pytest.raises(AnalysisError, match="4 range bins"):
        fit_sensor(recording(good[:, :4], range_m=RANGE_M[:4]))
    with pytest.raises(AnalysisError, match="every sample is zero"):
        fit_sensor(recording(0 * good))
    with pytest.raises(AnalysisError, match="not finite"):
        fit_sensor(recording(np.where(np.arange(64)[:, None] == 5, np.nan, good)))
    with pytest.raises(AnalysisError, match="only 1 of 64 frames"):
        fit_sensor(recording(np.repeat(good[:1], 64, axis=0)))


def test_preset_file_makes_recordings_that_fit_to_the_same_numbers(tmp_path: Path) -> None:
    samples, _ = room(18)
    samples[100] = samples[99]
    first = fit_sensor(recording(samples))
    path = tmp_path / "my-x4.toml"
    path.write_text(format_calibrated_preset(first), encoding="utf-8")
    preset = Radar.preset(str(path))
    assert preset.n_range_bins == RANGE_M.size
    assert preset.prf_hz == PRF_HZ
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    specs = [make_impairment(entry) for entry in table["impairments"]]
    assert [entry["kind"] for entry in table["impairments"]] == ["static_clutter", "phase_noise", "dropped_frames"]
    assert first.phase is not None
    phase = table["impairments"][1]
    assert phase["white_rad"] == pytest.approx(first.phase.white.value, rel=1e-3)
    assert phase["walk_rad_per_sqrt_min"] == pytest.approx(WALK, rel=0.4)
    assert phase["drift_rad_per_min"] == pytest.approx(DRIFT, rel=0.6)
    noise = make_impairment({"kind": "thermal_noise"})
    rng = np.random.default_rng(3)
    made = apply_impairments(np.zeros((600, RANGE_M.size), np.complex64), [*specs[:2], noise], radar=preset, rng=rng)
    again = fit_sensor(recording(made.matrix, preset, preset.range_axis_m()))
    assert again.noise_level_db.value == pytest.approx(first.noise_level_db.value, abs=0.25)
    assert again.phase is not None
    assert again.phase.white.value == pytest.approx(first.phase.white.value, rel=0.2)
    difference = (again.clutter.level_db - first.clutter.level_db) / np.hypot(again.clutter.sd_db, first.clutter.sd_db)
    assert np.abs(difference).max() < 4.0
    assert abs(difference.mean()) < 1.0


def test_source_names_cannot_break_the_file() -> None:
    fit = replace(fit_sensor(recording(room(20, frames=64)[0])), source='a"b\x07\n[radar]\nprf_hz = 1')
    assert "radar" not in tomllib.loads(format_calibrated_preset(fit))


def test_rows_and_json_hold_the_estimates() -> None:
    fit = fit_sensor(recording(room(21)[0], RADAR.model_copy(update={"volts_per_unit": 0.1})))
    rows = {name: estimate for name, estimate, _ in estimate_rows(fit)}
    assert rows["noise level, sensor's unit"].value == pytest.approx(rows["noise level"].value + 20.0)
    assert rows["as clock jitter"].value == pytest.approx(WHITE_RAD / (2 * math.pi * 7.29e9) * 1e12, rel=0.2)
    found = sensor_as_dict(fit)
    assert found["clutter"][0]["level_re_unit_db"] == pytest.approx(found["clutter"][0]["level_db"] + 20.0)
    assert found["flags"] == []


def test_estimates_convert_with_their_uncertainty() -> None:
    assert Estimate(100.0, 1.0).to_db(10.0).value == pytest.approx(20.0)
    assert Estimate(100.0, 1.0).to_db(10.0).sd == pytest.approx(10 * math.log10(1.01), rel=0.01)
    assert Estimate(0.0, 1.0).to_db(10.0).value == -math.inf
    assert take_root(4.0, 0.1).value == pytest.approx(2.0)
    assert take_root(4.0, 0.1).sd == pytest.approx(0.1 / 4, rel=0.02)
    assert take_root(-1.0, 0.04).value == 0.0
    assert take_root(-1.0, 0.04).sd == pytest.approx(0.2)


@pytest.fixture
def command() -> typer.Typer:
    app = typer.Typer()
    app.command()(fit_command)
    return app


def test_command_writes_a_preset_and_a_figure(tmp_path: Path, command: typer.Typer) -> None:
    source, preset = tmp_path / "empty.h5", tmp_path / "preset.toml"
    write_recording(recording(room(22)[0]), source)
    result = CliRunner().invoke(command, [str(source), "-o", str(preset), "--figures", str(tmp_path / "figures")])
    assert result.exit_code == 0, result.output
    assert "phase jitter, white" in result.output
    assert "clutter at" in result.output
    assert (tmp_path / "figures" / "twin-fit.png").stat().st_size > 10_000
    assert Radar.preset(str(preset)).prf_hz == PRF_HZ


def test_command_refuses_what_it_cannot_use(tmp_path: Path, command: typer.Typer) -> None:
    source = tmp_path / "empty.h5"
    write_recording(recording(room(23, frames=64)[0]), source)
    runner = CliRunner()
    wrong = runner.invoke(command, [str(source), "-o", str(tmp_path / "preset.txt")])
    assert isinstance(wrong.exception, ConfigError)
    option = runner.invoke(command, [str(source), "-o", str(tmp_path / "preset.toml"), "--option", "matrix"])
    assert isinstance(option.exception, ConfigError)
    assert "KEY=VALUE" in str(option.exception)
