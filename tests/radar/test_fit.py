"""Models of sensors and of their kinds: every estimate against recordings made here with known values."""

import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from command import run
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.pipeline import parse_run
from doppelgait.radar import Radar, Recording, write_recording
from doppelgait.radar import fit as radar_fit
from doppelgait.radar.fit import room as room_fit
from doppelgait.radar.fit.measure import find_converter
from doppelgait.radar.fit.pool import find_mains_harmonic
from doppelgait.radar.impairments import apply_impairments, make_impairment
from doppelgait.radar.link import echo_amplitude_v, list_derived_quantities, noise_power_v2
from doppelgait.radar.simulate import label_baseband

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


X4_8 = RADAR.model_copy(update={"range_stop_m": 0.7 + 7.5 * RADAR.bin_spacing_m})


def recording(samples: np.ndarray, radar: Radar = RADAR, source: str = "room.h5") -> Recording:
    times_s = np.arange(len(samples)) / radar.prf_hz
    return Recording.from_baseband(label_baseband(samples.astype(np.complex64), times_s, radar), radar, source=source)


TRUTHS = {
    "noise_level_db": NOISE_DB, "drift_rad_per_min": DRIFT, "walk_rad_per_sqrt_min": WALK,
    "white_rad": WHITE_RAD, "gain_drift_db_per_min": GAIN_DRIFT, "gain_white_db": GAIN_WHITE_DB,
}  # fmt: skip


def measure(samples: np.ndarray, radar: Radar = RADAR) -> tuple[radar_fit.SensorMeasurement, room_fit.Room]:
    measured = radar_fit.measure_recording(recording(samples, radar))
    assert measured.room is not None
    return measured, measured.room


def read_kinds(kind: radar_fit.SensorKind) -> dict[str, dict]:
    return {entry["kind"]: entry for entry in tomllib.loads(radar_fit.format_preset(kind)).get("impairments", [])}


LARGEST_SD = {
    "noise_level_db": 0.08, "drift_rad_per_min": 0.1, "walk_rad_per_sqrt_min": 0.008,
    "white_rad": 0.0004, "gain_drift_db_per_min": 0.02, "gain_white_db": 0.0006,
}  # fmt: skip


def walk(samples: np.ndarray) -> np.ndarray:
    """Add a body that moves from 3 to 4 m; faster than the pulse rate shows, so that it is at any Doppler."""
    range_m = np.linspace(3.0, 4.0, len(samples))[:, None]
    shape = np.exp(-((RANGE_M - range_m) ** 2) / (2 * 0.052**2)) * 10 ** (-65 / 20)
    samples = samples + shape * np.exp(-2j * np.pi * 2 * range_m / RADAR.wavelength_m)
    ahead = np.abs(RANGE_M - 4.4).argmin()  # a hand at rare moments
    samples[100::150, ahead : ahead + 2] += 10 ** (-85 / 20)
    return samples


@pytest.mark.parametrize("scene", ["plain", "correlated", "walker"])
def test_every_estimate_lies_within_its_uncertainty(scene: str) -> None:
    scores = []
    for seed in range(6):
        samples = room(seed, correlated=scene == "correlated")[0]
        values = measure(walk(samples) if scene == "walker" else samples)[0].estimates
        scores.append({name: (values[name].value - truth) / values[name].sd for name, truth in TRUTHS.items()})
        assert "burst_level_db" not in values  # parts of a walker are no interference
        assert all(values[name].sd < largest for name, largest in LARGEST_SD.items())
    for name in scores[0]:
        z = np.array([score[name] for score in scores])
        assert np.abs(z).max() < 4.5, name
        assert abs(z.mean()) < 1.3, name  # a mean of 6 has an sd of 0.41
        assert 0.25 < np.sqrt(np.mean(z**2)) < 2.0, name  # neither boasting nor shy


def test_correlated_noise_counts_as_fewer_independent_bins_and_goes_into_the_radar() -> None:
    plain, smooth = (measure(room(1, correlated=correlated)[0])[1].noise for correlated in (False, True))
    assert plain.independent_bins == pytest.approx(RANGE_M.size, rel=0.02)
    assert np.abs(smooth.correlation[1:4]) == pytest.approx([2 / 3, 1 / 6, 0], abs=0.02)
    assert not smooth.correlation[4:].any()  # lags within chance of 0 count for nothing
    assert smooth.independent_bins == pytest.approx(RANGE_M.size / (1 + 2 * (4 / 9 + 1 / 36)), rel=0.03)
    counter = COUNTER.model_copy(update={"threshold_step_v": None})  # its own correlation is that of its filter
    for correlated, rho in ((True, [2 / 3, 1 / 6]), (False, [])):
        kind = radar_fit.fit_sensor(recording(room(1, correlated=correlated)[0], counter))
        table = tomllib.loads(radar_fit.format_preset(kind))
        assert table["noise_correlation"] == pytest.approx(rho, abs=0.02)


def test_flat_and_sloping_noise_are_told_apart() -> None:
    flat, sloping = (radar_fit.fit_sensor(recording(room(4, slope_db_per_m=slope)[0])) for slope in (0.0, 1.0))
    assert flat.range_db == ()
    range_m, change_db = np.array(sloping.range_db).T
    assert np.polyfit(range_m, change_db, 1)[0] == pytest.approx(1.0, abs=0.1)
    assert "range_db" in read_kinds(sloping)["coloured_noise"]


@pytest.mark.parametrize(("radar", "figure_db"), [(RADAR, 9.0), (COUNTER, 12.0)])
def test_the_noise_figure_reproduces_the_noise(radar: Radar, figure_db: float) -> None:
    """3 dB more noise: kT0 B F G 2 Z0 / N of averaging, written out, and a counter's that goes with the root of F."""
    averages = math.floor(0.95 * 15.1875e6 / (PRF_HZ * 152))
    averaged_v2 = 2 * 50 * 4.004e-21 * 10**0.9 * 1.4e9 * 10**1.0 / averages  # B of a Gaussian pulse at -10 dB
    level = 10 * math.log10(averaged_v2 if radar is RADAR else noise_power_v2(COUNTER) * 10**0.3)
    kind = radar_fit.fit_sensor(recording(room(5, noise_db=level)[0], radar))
    figure, noise = (kind.pooled[name].mean for name in ("noise_figure_db", "noise_level_db"))
    assert figure.value == pytest.approx(figure_db, abs=4 * figure.sd)
    assert figure.sd == pytest.approx((1.0 if radar is RADAR else 2.0) * noise.sd)
    assert figure.sd < 0.1
    assert kind.radar.noise_figure_db == pytest.approx(figure.value)
    assert 10 * math.log10(noise_power_v2(kind.radar)) == pytest.approx(noise.value, abs=1e-3)


def test_implausible_noise_figure_changes_the_gain_instead() -> None:
    kind = radar_fit.fit_sensor(recording(room(5, noise_db=-70.0, clutter_db=35.0)[0]))
    assert kind.radar.noise_figure_db == pytest.approx(RADAR.noise_figure_db)
    excess_db = -70.0 - 10 * math.log10(noise_power_v2(RADAR))
    assert kind.radar.receiver_gain_db == pytest.approx(RADAR.receiver_gain_db + excess_db, abs=0.3)
    assert "receiver gain instead" in kind.notes["noise figure"]


def test_static_echo_is_recovered_bin_by_bin_despite_drift() -> None:
    """Two radians of drift would take 16 % off a time mean."""
    samples, echo = room(6, still=True)
    turned = samples * np.exp(2j * np.linspace(-1, 1, len(samples)))[:, None]
    found = measure(turned)[1].echo_v
    error = found * np.exp(-1j * np.angle(np.vdot(echo, found))) - echo
    assert np.abs(error).max() < 5 * 10 ** (NOISE_DB / 20) / math.sqrt(len(samples))


def test_clutter_profile_maximises_the_exponential_likelihood() -> None:
    rng = np.random.default_rng(6)
    echo = 10 ** (mean_level_db(RANGE_M) / 20) * normal(rng, RANGE_M.size)
    found = room_fit.fit_clutter_profile(
        echo, range_m=RANGE_M, noise_power_v2=0.0, resolution_m=RADAR.range_resolution_m
    )
    power = np.abs(echo) ** 2

    def cost(level_db: np.ndarray) -> float:
        mean = 10 ** (np.interp(RANGE_M, found.axis, level_db) / 10)
        return float(np.sum(np.log(mean) + power / mean))

    for knot in range(found.axis.size):
        for step in (-0.05, 0.05):
            other = found.level_db.copy()
            other[knot] += step
            assert cost(other) > cost(found.level_db)


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
    found = room_fit.fit_series(x, time_s=time_s)
    assert found.walk_per_root_s.value == pytest.approx(math.exp(best.x[0] / 2), rel=2e-3)
    assert found.white.value == pytest.approx(math.exp(best.x[1] / 2), rel=2e-3)
    cov = math.exp(best.x[0]) * 0.1 * np.eye(59) + math.exp(best.x[1]) * second
    inverse = np.linalg.inv(cov)
    assert found.drift_per_s.value == pytest.approx(step @ inverse @ d / (step @ inverse @ step), rel=2e-3)
    assert found.drift_per_s.sd == pytest.approx((step @ inverse @ step) ** -0.5, rel=2e-3)


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
    static = room_fit.fit_static_part(np.exp(1j * rng.normal(size=40))[:, None] * echo)
    c = static.echo_v
    energy = np.vdot(c, c).real
    remove = np.eye(n) - np.outer(c, c.conj()) / energy
    left = np.real(np.diag(remove @ dense @ remove.conj().T))
    assert room_fit.compute_leverage(static, rho) == pytest.approx(1 - left, abs=1e-9)
    assert room_fit.multiply_correlation(c, rho) == pytest.approx(dense @ c)
    wanted = np.real(np.vdot(c, dense @ c)) * power / (2 * energy**2)
    assert room_fit.compute_factor_variance(static, rho, noise_power_v2=power) == pytest.approx(wanted)


def breathe(samples: np.ndarray) -> None:
    breath = np.exp(1.5j * np.sin(2 * np.pi * 0.25 * np.arange(len(samples)) / PRF_HZ))
    samples += breath[:, None] * np.exp(-((RANGE_M - 3.0) ** 2) / (2 * 0.052**2)) * 10 ** (-65 / 20)


def strike(samples: np.ndarray) -> None:
    rng = np.random.default_rng(0)
    for frame in (50, 51, 200, 333):
        samples[frame, 40:46] += normal(rng, 6) * 10 ** (-80 / 20)


def drop(samples: np.ndarray) -> None:
    for frame in (100, 101, 102, 300):
        samples[frame] = samples[frame - 1]
    samples[400:402] = 0


FAULTS = {
    "none": (11, lambda samples: None, ([], [], []), {}),
    # -65 + 105 dB, less what a time mean keeps
    "target": (10, breathe, ([(2.85, 3.15, 39.0)], [], []), {}),
    # a burst across two frames hits both
    "interference": (12, strike, ([], [50, 51, 200, 333], []), {
        "rate_hz": 3 / (599 / PRF_HZ), "duration_s": (4 / 3 - 1) / PRF_HZ, "level_db": -80.0,
        "hit_share": 6 / RANGE_M.size,
    }),
    "dropped_frames": (13, drop, ([], [], [100, 101, 102, 300, 400, 401]), {"probability": 0.01, "mean_length": 2.0}),
}  # fmt: skip
"""Seed and change of a room; what moved, what is hit and what is dropped; keys of the preset."""


@pytest.mark.parametrize("name", FAULTS)
def test_faults_are_named_and_spoil_no_estimate(name: str) -> None:
    seed, change, (moving, hit, dropped), keys = FAULTS[name]
    samples, _ = room(seed)
    change(samples)
    kind = radar_fit.fit_sensor(recording(samples, RADAR.model_copy(update={"volts_per_unit": 0.1})))
    (measured,) = kind.recordings
    for quantity, truth in TRUTHS.items():
        estimate = measured.estimates[quantity]
        assert abs(estimate.value - truth) < 4.5 * estimate.sd, quantity
    fit = measured.room
    assert fit is not None
    assert list(measured.notes) == ["motion"] * len(moving)
    assert [(m.start_m, m.stop_m, m.excess_db / 25) for m in fit.moving] == [
        pytest.approx((start_m, stop_m, excess_db / 25), abs=0.12) for start_m, stop_m, excess_db in moving
    ]
    assert np.flatnonzero(fit.bursts.frames).tolist() == hit
    assert np.flatnonzero(fit.faults.dropped).tolist() == dropped
    assert fit.time_s.size == 600 - len(hit) - len(dropped)
    tables = read_kinds(kind)
    assert sorted(tables) == sorted({"static_clutter", "phase_noise", *([name] if keys else [])})
    for key, value in keys.items():
        tolerance = {"level_db": {"abs": 2.5}, "hit_share": {"rel": 0.35}}.get(key, {"rel": 1e-3})
        assert tables[name][key] == pytest.approx(value, **tolerance)


@pytest.mark.parametrize(("struck", "is_shared"), [(1, False), (2, True), (3, True)])
def test_a_kind_has_the_interference_of_half_its_recordings(struck: int, is_shared: bool) -> None:
    several = [room(seed)[0] for seed in range(3)]
    for samples in several[:struck]:
        strike(samples)
    kind = radar_fit.fit_sensor([recording(samples) for samples in several])
    assert ("interference" in read_kinds(kind)) == is_shared
    assert kind.pooled["burst_rate_hz"].count == 3


@pytest.mark.parametrize("length", [1.0, 4.0])
def test_the_share_of_dropped_frames_lies_within_its_uncertainty(length: float) -> None:
    scores = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        samples = 1e-5 * normal(rng, 600, 8)
        spec = make_impairment({"kind": "dropped_frames", "probability": 0.05, "mean_length": length})
        samples = apply_impairments(samples, [spec], radar=X4_8, rng=rng).matrix
        kind = radar_fit.fit_sensor(recording(samples, X4_8))
        share = kind.pooled["drop_probability"].mean
        scores.append((share.value - 0.05) / share.sd)
    assert abs(np.mean(scores)) < 0.5
    assert 0.7 < np.std(scores) < 1.5


def test_direct_path_and_constant() -> None:
    samples, _ = room(14)
    peak = 10 ** (-38 / 20)
    samples += peak * np.exp(-((RANGE_M - RANGE_M[2]) ** 2) / (2 * 0.052**2)) + 4e-3 * np.exp(1j)
    measured, fit = measure(samples)
    # clutter of -45 and the constant ride on it
    assert measured.estimates["near_echo_db"].value == pytest.approx(-38.0, abs=4.0)
    assert abs(fit.leakage.constant_v.value - 4e-3) < 4 * fit.leakage.constant_v.sd
    assert fit.leakage.constant_v.sd < 4e-4
    constant = measured.estimates["dc_level_db"].value
    assert read_kinds(radar_fit.fit_sensor(recording(samples)))["dc_leak"]["level_db"] == pytest.approx(
        constant, abs=0.01
    )


def test_without_static_echoes_phase_is_not_claimed() -> None:
    """Aligned to a phase that is noise, the time mean of the noise would not shrink with the number of frames."""
    samples = room(15, clutter_db=-120.0)[0]
    measured, fit = measure(samples)
    assert np.sum(np.abs(fit.echo_v) ** 2) == pytest.approx(RANGE_M.size * 10 ** (NOISE_DB / 10) / 600, rel=0.4)
    assert fit.phase is None
    assert fit.gain is None
    assert "too weak" in measured.refused["phase noise"]
    noise = measured.estimates["noise_level_db"]
    assert abs(noise.value - NOISE_DB) < 4 * noise.sd
    assert list(read_kinds(radar_fit.fit_sensor(recording(samples)))) == ["static_clutter"]


def refuse(samples: np.ndarray, message: str) -> None:
    with pytest.raises(AnalysisError, match=message):
        radar_fit.fit_sensor(recording(samples))


def test_recordings_that_cannot_be_fitted_are_refused() -> None:
    good, _ = room(17, frames=64)
    refuse(good[:8], r"room\.h5: 8 pulses are too few .* 4 windows of 8 pulses")
    refuse(0 * good, "all are zero")
    refuse(np.where(np.arange(64)[:, None] == 5, np.nan, good), "not finite")
    refuse(np.repeat(good[:1], 64, axis=0), "only 1 of 64 frames")
    in_bursts = recording(good).with_baseband(recording(good).baseband.assign_attrs(burst_pulses=16))
    assert "comes in bursts" in radar_fit.fit_sensor(in_bursts).refused["frame drops"]  # pauses are no lost frames


def test_preset_file_makes_recordings_that_fit_to_the_same_numbers(tmp_path: Path) -> None:
    samples, _ = room(18)
    samples[100] = samples[99]
    first, fit = measure(samples)
    path = tmp_path / "my-x4.toml"
    path.write_text(radar_fit.format_preset(radar_fit.fit_sensor(recording(samples))), encoding="utf-8")
    preset = Radar.preset(str(path))
    assert preset.n_range_bins == RANGE_M.size
    assert preset.prf_hz == PRF_HZ
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    specs = [make_impairment(entry) for entry in table["impairments"]]
    assert [entry["kind"] for entry in table["impairments"]] == ["static_clutter", "phase_noise", "dropped_frames"]
    noise = make_impairment({"kind": "thermal_noise"})
    rng = np.random.default_rng(3)
    made = apply_impairments(np.zeros((600, RANGE_M.size), np.complex64), [*specs[:2], noise], radar=preset, rng=rng)
    again, other = measure(made.matrix, preset)
    for name, tolerance in (("noise_level_db", {"abs": 0.25}), ("white_rad", {"rel": 0.2})):
        assert again.estimates[name].value == pytest.approx(first.estimates[name].value, **tolerance)
    difference = (other.clutter.level_db - fit.clutter.level_db) / np.hypot(other.clutter.sd_db, fit.clutter.sd_db)
    assert np.abs(difference).max() < 4.0
    assert abs(difference.mean()) < 1.0


def test_source_names_cannot_break_the_file() -> None:
    named = recording(room(20, frames=64)[0])
    named = Recording(
        named.samples, named.radar, named.slow_time_s, named.range_m, source='a"b\x07\n[radar]\nprf_hz = 1'
    )
    assert "radar" not in tomllib.loads(radar_fit.format_preset(radar_fit.fit_sensor(named)))


def test_every_fact_is_a_row_of_json_and_sets_its_key() -> None:
    """Facts of one recording have no spread; levels are also re one unit of the file."""
    kind = radar_fit.fit_sensor(recording(room(21)[0], RADAR.model_copy(update={"volts_per_unit": 0.1})))
    values = radar_fit.describe_sensor(kind)
    rows = {row["name"]: row for row in json.loads(json.dumps(values))["quantities"]}
    assert set(kind.pooled) | {f"clutter_at_{r:.2f}_m" for r, _ in kind.clutter} == set(rows)
    assert all(row["spread"] is None and row["recordings"] == 1 for row in rows.values())
    for name in ("noise_level_db", f"clutter_at_{kind.clutter[0][0]:.2f}_m"):
        assert rows[name]["value_re_unit_db"] == pytest.approx(rows[name]["value"] + 20.0)
    assert rows["clock_jitter_ps"]["value"] == pytest.approx(WHITE_RAD / (2 * math.pi * 7.29e9) * 1e12, rel=0.2)
    tables = read_kinds(kind)
    for name, fact in room_fit.FACTS.items():
        sets, _, key = fact.sets.partition(".")
        if name in kind.pooled and sets in tables:
            value = rows[name]["value"]
            written = tables[sets][key]
            assert written == pytest.approx(value if abs(value) > 3 * rows[name]["sd"] else 0.0, rel=1e-3), name
    assert values["notes"] == {}
    assert values["recordings"][0]["frames_used"] == 600


def test_estimates_convert_with_their_uncertainty() -> None:
    assert radar_fit.Estimate(100.0, 1.0).to_db(10.0).value == pytest.approx(20.0)
    assert radar_fit.Estimate(100.0, 1.0).to_db(10.0).sd == pytest.approx(10 * math.log10(1.01), rel=0.01)
    assert radar_fit.Estimate(0.0, 1.0).to_db(10.0).value == -math.inf
    assert room_fit.take_root(4.0, 0.1).value == pytest.approx(2.0)
    assert room_fit.take_root(4.0, 0.1).sd == pytest.approx(0.1 / 4, rel=0.02)
    assert room_fit.take_root(-1.0, 0.04).value == 0.0
    assert room_fit.take_root(-1.0, 0.04).sd == pytest.approx(0.2)


def test_command_writes_a_preset_and_a_figure(tmp_path: Path) -> None:
    source, preset = tmp_path / "empty.h5", tmp_path / "preset.toml"
    write_recording(recording(room(22)[0]), source)
    done = run("radar", "fit", source, "-o", preset, "--figures", tmp_path / "figures")
    assert "phase jitter, white" in done.output
    assert "clutter at" in done.output
    assert (tmp_path / "figures" / "twin-fit.png").stat().st_size > 10_000
    assert Radar.preset(str(preset)).prf_hz == PRF_HZ


@pytest.mark.parametrize(
    ("options", "message"), [(["-o", "a.txt"], r"\.toml"), (["-o", "a.toml", "--option", "matrix"], "KEY=VALUE")]
)
def test_command_refuses_what_it_cannot_use(tmp_path: Path, options: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        run("radar", "fit", tmp_path / "empty.h5", *options)


RATE_HZ = 400.0
CW = Radar(waveform="cw", carrier_hz=24e9, prf_hz=RATE_HZ, range_stop_m=10.0, noise_figure_db=10.0)
X4 = Radar.preset("x4", prf_hz=RATE_HZ, range_start_m=0.5, range_stop_m=2.0)


def echo_of(rng: np.random.Generator, n: int, level_db: float, doppler_hz: float) -> np.ndarray:
    """Echo that approaches at a speed that wanders, by its phase written out."""
    speed = doppler_hz * (1 + 0.1 * np.cumsum(rng.normal(size=n)) / math.sqrt(n))
    return 10 ** (level_db / 20) * np.exp(2j * np.pi * np.cumsum(speed) / RATE_HZ + 1j * rng.uniform(0, 6))


def channels(y: np.ndarray, gain_db: float, phase_deg: float) -> np.ndarray:
    return y.real + 1j * 10 ** (gain_db / 20) * (y * np.exp(1j * np.radians(phase_deg))).imag


def test_means_and_spreads_are_within_their_uncertainty() -> None:
    """A mean of 3 and a spread of 0.5 below unequal errors, 300 times."""
    rng = np.random.default_rng(0)
    scores, ratios, covered, empty = [], [], 0, 0
    for _ in range(300):
        sd = rng.uniform(0.2, 1.0, size=12)
        found = radar_fit.pool(
            radar_fit.Estimate(x, s)
            for x, s in zip(3 + 0.5 * rng.normal(size=12) + sd * rng.normal(size=12), sd, strict=True)
        )
        scores.append((found.mean.value - 3) / found.mean.sd)
        ratios.append(found.spread / 0.5)
        covered += found.low <= 0.5 <= found.high
        same = radar_fit.pool(radar_fit.Estimate(3 + s * rng.normal(), s) for s in sd)
        empty += same.spread_is_known
    assert abs(np.mean(scores)) < 0.2
    assert 0.9 < np.sqrt(np.mean(np.square(scores))) < 1.25
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.2)
    assert 0.92 < covered / 300 < 0.98  # of an interval of 95 %
    assert empty / 300 < 0.05  # errors alone are no spread


def test_two_recordings_have_no_spread_and_none_is_refused() -> None:
    found = radar_fit.pool([radar_fit.Estimate(1.0, 0.1), radar_fit.Estimate(2.0, 0.1)])
    assert math.isnan(found.spread)
    assert not found.spread_is_known
    assert found.mean.value == 1.5
    assert found.mean.sd > 0.3  # they disagree by more than they should
    with pytest.raises(AnalysisError, match="nothing to pool"):
        radar_fit.pool([radar_fit.Estimate(math.nan, 1.0)])


def test_noise_of_one_bin_under_a_target_and_its_image() -> None:
    scores = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        clean = echo_of(rng, 6400, -40.0, 40.0)[:, None] + 10 ** (-70 / 20) * normal(rng, 6400, 1)
        found = radar_fit.measure_recording(recording(channels(clean, 1.5, 8.0), CW)).estimates
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
    wall = 0.1 * np.exp(0.3j * np.sin(2 * np.pi * 40 * np.arange(6400) / RATE_HZ))
    found = radar_fit.measure_recording(recording(wall[:, None] + 1e-4 * normal(rng, 6400, 1), CW))
    assert "iq_gain_db" not in found.estimates
    assert "one direction" in found.refused["I/Q image"]


def hum(seed: int, level_db: float = -100.0) -> Recording:
    """Noise of -100 dB with a line at 100 Hz, and a target."""
    rng = np.random.default_rng(seed)
    n, bins = 6400, X4.n_range_bins
    samples = 1e-5 * normal(rng, n, bins)
    samples += 10 ** (level_db / 20) * np.exp(2j * np.pi * 100.0 * np.arange(n) / RATE_HZ)[:, None]
    samples[:, 8:14] += echo_of(rng, n, -60.0, 55.0)[:, None]
    return recording(samples, X4)


def test_a_line_is_found_in_all_bins_and_a_target_is_none() -> None:
    (line,) = radar_fit.measure_recording(hum(2)).lines
    assert line.frequency_hz == pytest.approx(100.0, abs=line.half_width_hz)
    assert line.level_db.value == pytest.approx(-100.0, abs=1.0)
    assert find_mains_harmonic(line.frequency_hz, RATE_HZ, 1.0) == "2 x 50 Hz"
    assert find_mains_harmonic(-100.0, 1000.0, 1.0) == "2 x 50 Hz"  # a real line has both signs
    assert find_mains_harmonic(37.0, 1000.0, 1.0) == ""


def test_lines_of_half_the_recordings_are_spurs() -> None:
    """A line of one recording may be a body at a steady speed."""
    quiet, first, second = hum(3, -200.0), hum(4), hum(5, -97.0)
    spur = read_kinds(radar_fit.fit_sensor([quiet, first, second]))["spur"]
    assert spur["frequency_hz"] == pytest.approx(100.0, abs=0.5)
    assert -100.0 < spur["level_db"] < -97.0
    for others in ([quiet], [], [quiet, hum(6, -200.0)]):
        assert "spur" not in read_kinds(radar_fit.fit_sensor([*others, first]))


@pytest.mark.release
def test_noise_over_doppler_range_and_between_bins() -> None:
    rng = np.random.default_rng(3)
    wide = Radar.preset("x4", prf_hz=RATE_HZ)
    taps = normal(rng, 3200, wide.n_range_bins + 1)
    white = 1e-5 * (taps[:, 1:] + 0.5 * taps[:, :-1]) / math.sqrt(1.25)  # rho_1 = 0.4
    floor = make_impairment({"kind": "coloured_noise", "levels": [[0, -80], [50, -90], [100, -120]]})
    slope = make_impairment({"kind": "coloured_noise", "levels": [[0, -100]], "range_db": [[0, -20], [9.6, 6]]})
    shaped = [apply_impairments(white, [one], radar=wide, rng=rng).matrix for one in (floor, slope)]
    flat, coloured, sloping = (radar_fit.fit_sensor([recording(x, wide)]) for x in (white, *shaped))
    assert flat.correlation == pytest.approx([0.4], abs=0.02)
    assert not flat.range_db
    assert max(abs(e.value) for _, e in flat.doppler) < 1.0
    by_doppler = {round(f): e.value for f, e in coloured.doppler}
    assert by_doppler[50] == pytest.approx(10.0, abs=1.0)
    assert by_doppler[25] == pytest.approx(15.0, abs=1.0)
    assert abs(by_doppler[150]) < 0.5
    first, *_, last = (level for _, level in sloping.range_db)
    assert last - first == pytest.approx(10 * math.log10((1 + 10**0.52) / 1.011), abs=0.7)
    assert 'kind = "coloured_noise"' in radar_fit.format_preset(coloured)
    assert "noise over Doppler" not in coloured.refused
    bodies = np.stack([echo_of(rng, 3200, -60.0, 25.0) for _ in range(wide.n_range_bins)], axis=1)
    kind = radar_fit.fit_sensor([recording(shaped[0] + bodies, wide)])
    entries = {entry["kind"]: entry for entry in tomllib.loads(radar_fit.format_preset(kind))["impairments"]}
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


def several(count: int, *, noise_apart: bool = False) -> list[Recording]:
    found = []
    for seed in range(count):
        rng = np.random.default_rng(100 + seed)
        noise = 10 ** (rng.normal(-70, 1.0) / 20) * normal(rng, 3200, 1)
        gain_db = rng.normal(2.0, 0.5)
        echo = echo_of(rng, 3200, -40.0, 40.0)[:, None]
        mixed = channels(echo, gain_db, 10.0) + noise if noise_apart else channels(echo + noise, gain_db, 10.0)
        found.append(recording(mixed + 0.01 - 0.02j, CW, source=f"{seed}.h5"))
    return found


def test_the_preset_has_the_spreads_and_loads(tmp_path: Path) -> None:
    path = tmp_path / "my.toml"
    path.write_text(radar_fit.format_preset(radar_fit.fit_sensor(several(10))), encoding="utf-8")
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
    path = tmp_path / "my.toml"
    path.write_text(radar_fit.format_preset(radar_fit.fit_sensor(several(8, noise_apart=True))), encoding="utf-8")
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
    found = radar_fit.measure_recording(recording(again, CW)).estimates
    assert found["iq_phase_deg"].value == pytest.approx(10.0, abs=4 * found["iq_phase_deg"].sd + 1)
    assert abs(found["noise_iq_gain_db"].value) < 4 * found["noise_iq_gain_db"].sd + 0.2


def test_the_range_of_people_sets_the_gain() -> None:
    kind = radar_fit.fit_sensor(several(4), people_at_m=3.0)
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
    for found in (radar_fit.fit_sensor(several[0]).radar, radar_fit.fit_sensor(several).radar):
        derived = list_derived_quantities(found)
        assert derived["snr_1m2_5m_db"] == pytest.approx(snr_db, abs=0.3)
        assert derived["noise_level_dbv"] == pytest.approx(20 * math.log10(scale * level_v), abs=0.3)
    with pytest.raises(ConfigError, match=r"receiver_gain_db: .* is not allowed"):
        radar_fit.fit_sensor([recording(1e8 * x, radar) for x in rooms])


@pytest.mark.parametrize("own", ["gain", "figure"])
def test_a_spread_of_gain_is_none_of_the_noise_figure(own: str) -> None:
    """Units whose gain differs move echoes and noise together, units whose noise figure differs the noise alone."""
    wide = Radar.preset("x4", prf_hz=RATE_HZ, range_start_m=0.0, range_stop_m=3.0, threshold_step_v=None)
    level_v, found = math.sqrt(noise_power_v2(wide)), []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        changes = 10 ** (3.0 * rng.normal() / 20)
        static = 100 * level_v * normal(np.random.default_rng(9), wide.n_range_bins)
        static += 2e4 * level_v * np.exp(-((wide.range_axis_m() / 0.1) ** 2))
        noise = level_v * normal(rng, 800, wide.n_range_bins)
        samples = changes * (static + noise) if own == "gain" else static + changes * noise
        found.append(recording(samples, wide, source=f"{seed}.h5"))
    pooled = radar_fit.fit_sensor(found).pooled
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
    short = recording(normal(rng, 16, 1), CW, source="short.h5")
    odd = [recording(normal(rng, 900, 1), radar) for radar in (other, slow)]
    kind = radar_fit.fit_sensor([*several(2), short, *odd])
    assert len(kind.recordings) == 2
    for why in (
        "short.h5: 16 pulses",
        "carrier 77 GHz instead of the 24 GHz of",
        "40 frames a second instead of the 400",
    ):
        assert any(why in line for line in kind.left_out)
    with pytest.raises(AnalysisError, match="no recording can be used"):
        radar_fit.fit_sensor([short])


def test_a_folder_on_the_command_line(tmp_path: Path) -> None:
    (tmp_path / "week" / "monday").mkdir(parents=True)
    for number, one in enumerate(several(4)):
        write_recording(one, tmp_path / "week" / ("monday" if number % 2 else ".") / f"{number}.h5")
    (tmp_path / "week" / "notes.txt").write_text("none of them", encoding="utf-8")
    out = tmp_path / "my.toml"
    assert "gain of Q" in run("radar", "fit", tmp_path / "week", "-o", out).output
    assert Radar.preset(out).waveform.kind == "cw"
    run("radar", "fit", tmp_path / "week", "-o", out, "--start", 1, code=2)
