"""The conformance suite: our simulator passes, and every fault put in fails exactly the checks that it should."""

import doctest
import json
import math

import numpy as np
import pytest

import doppelgait_conformance as conformance
from doppelgait import ConfigError
from doppelgait.radar import Radar
from doppelgait_conformance import Check, __main__, bench, format_report, list_suite_radars, run_conformance, theory
from doppelgait_conformance.radars import change_radar
from doppelgait_conformance.run import RULES

C = 299_792_458.0
OF_PARTS = [rule.name for rule in RULES if rule.needs != "simulator"]
X4 = Radar.preset("x4")


def failed(checks):
    return {check.name for check in checks if check.passed is False}


def each(*names, radar):
    return {f"{name}[{radar}]" for name in names}


def test_our_simulator_passes_all_checks():
    checks = run_conformance()
    assert [check for check in checks if check.passed is not True] == []
    assert {check.name.split("[")[0] for check in checks} == {rule.name for rule in RULES}


def test_example_of_a_foreign_simulator_works():
    result = doctest.testmod(conformance)
    assert result.attempted >= 5
    assert result.failed == 0


def literal(
    scatterers, radar, *, metres_per_turn=2.0, range_power=2, shift_m=0.0, frozen=False, theta=True, wide=1.0,
    path_phase=True, integration=1.0, images=4, folded_phase=False, folded_level=False,
):  # fmt: skip
    """E-18 scatterer by scatterer, with room for mistakes."""
    wavelength_m = C / radar.carrier_hz
    spread_m = wide * C / 2 * math.sqrt(math.log(10)) / (math.pi * radar.bandwidth_hz)
    level_db = radar.tx_power_dbm + radar.tx_gain_dbi + radar.rx_gain_dbi + radar.receiver_gain_db - 30
    one_v = np.sqrt(100 * 10 ** (level_db / 10) * wavelength_m**2 / (4 * np.pi) ** 3)
    step_m = C / 2 / radar.sample_rate_hz
    n_bins = math.ceil((radar.range_stop_m - radar.range_start_m) / step_m)
    axis_m = radar.range_start_m + shift_m + np.arange(n_bins) * step_m
    bins = np.zeros((scatterers.sizes["slow_time"], n_bins), complex)
    for n in range(scatterers.sizes["scatterer"]):
        row = {name: values.values[:, [n]] for name, values in scatterers.items()}
        phase = row.get("path_phase", 0) if path_phase else 0
        phase = phase + (radar.transmit_phase_rad if theta else 0)
        phase = phase - 2 * np.pi * metres_per_turn * row["range"] / wavelength_m
        place_m = row["range"][:1] if frozen else row["range"]
        echo_v = one_v * np.sqrt(row["rcs"] * row["path_gain"]) / row["range"] ** range_power
        turns = 2 * row["radial_velocity"] / wavelength_m * radar.integration_share / radar.prf_hz
        echo_v = echo_v * np.sinc(integration * turns)
        for k in range(images if radar.fold_echoes else 1):
            lag_m = k * C / 2 / (radar.pulse_rate_hz or radar.prf_hz)
            turn = 4 * np.pi * lag_m / wavelength_m if folded_phase else 0.0
            level = (row["range"] / (row["range"] - lag_m)) ** 2 if folded_level else 1.0
            envelope = np.exp(-((axis_m - place_m + lag_m) ** 2) / (2 * spread_m**2))
            bins += level * echo_v * envelope * np.exp(1j * (phase + turn))
    return bins


def test_a_literal_loop_passes_and_has_no_other_parts():
    checks = run_conformance(literal, radars=list_suite_radars("impulse"))
    assert failed(checks) == set()
    missing = {check.name for check in checks if check.passed is None}
    assert missing == {
        "noise_power[impulse]", "counter_noise[impulse]", "noise_correlation[impulse]", "noise_whiteness[impulse]",
        "matched_snr[impulse]", "quantisation_snr",
        "quantisation_bias", "wall_loss", "wall_delay", "wall_phase", "two_ray_pattern",
    }  # fmt: skip
    assert all("the simulator has no" in check.note for check in checks if check.passed is None)


PHASE = ("phase_linearity", "absolute_phase", "doppler_sign", "same_signature", "same_gait")
FAULTS = {
    "wrong sign": (lambda s, r: np.conj(literal(s, r)), (*PHASE, "path_phase")),
    "factor 2 in phase": (lambda s, r: literal(s, r, metres_per_turn=4.0), PHASE),
    "one-way phase": (lambda s, r: literal(s, r, metres_per_turn=1.0), PHASE),
    "power falls as R^-2": (lambda s, r: literal(s, r, range_power=1), ("radar_equation",)),
    "0.1 dB too strong": (lambda s, r: 10 ** (0.1 / 20) * literal(s, r), ("radar_equation",)),
    "bins start later": (lambda s, r: literal(s, r, shift_m=r.bin_spacing_m), ("range_migration", "range_profile")),
    "range frozen": (lambda s, r: literal(s, r, frozen=True), ("range_migration", "range_profile")),
    "3 % too long a pulse": (lambda s, r: literal(s, r, wide=1.03), ("range_profile",)),
    "no transmit phase": (lambda s, r: literal(s, r, theta=False), ("absolute_phase",)),
    "no path phase": (lambda s, r: literal(s, r, path_phase=False), ("path_phase",)),
    "no integration": (lambda s, r: literal(s, r, integration=0.0), ("frame_integration",)),
    "integration of half the time": (lambda s, r: literal(s, r, integration=0.5), ("frame_integration",)),
    "no folding": (lambda s, r: literal(s, r, images=1), ("folding",)),
    "folded once at most": (lambda s, r: literal(s, r, images=2), ("folding",)),
    "folded phase": (lambda s, r: literal(s, r, folded_phase=True), ("folding",)),
    "folded level": (lambda s, r: literal(s, r, folded_level=True), ("folding",)),
    "one echo": (lambda s, r: literal(s.isel(scatterer=[0]), r), ("superposition", "same_signature", "same_gait")),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_fails_exactly_the_checks_of_what_it_breaks(fault):
    simulator, wanted = FAULTS[fault]
    checks = run_conformance(simulator, radars=list_suite_radars("impulse"))
    assert failed(checks) == each(*wanted, radar="impulse")


def turned_round(scatterers, radar):
    bins = bench.simulate_bins(scatterers, radar)
    return bins.conj() if radar.waveform.kind == "fmcw" else bins


def with_velocity(factor):
    def simulator(scatterers, radar):
        return bench.simulate_bins(scatterers.assign(radial_velocity=factor * scatterers["radial_velocity"]), radar)

    return simulator


def with_video_phase(scatterers, radar):
    bins = bench.simulate_bins(scatterers, radar)
    delay_s = 2 * bins["range"] / C
    return bins * np.exp(1j * np.pi * radar.bandwidth_hz / radar.sweep_s * delay_s**2)


SWEPT_FAULTS = {
    "conjugated": (turned_round, (*PHASE, "path_phase")),
    "coupling of the wrong sign": (with_velocity(-1.0), ("range_migration", "range_doppler_coupling")),
    "no motion within the sweep": (with_velocity(0.0), ("range_migration", "range_doppler_coupling")),
    "residual video phase left in": (with_video_phase, ("absolute_phase",)),
    "window forgotten": (
        lambda s, r: bench.simulate_bins(s, Radar.model_validate({**r.model_dump(), "range_window": "none"})),
        ("range_profile",),
    ),
}


@pytest.mark.parametrize("fault", SWEPT_FAULTS)
def test_a_fault_of_fmcw_fails_exactly_its_checks_and_no_others_waveform(fault):
    simulator, wanted = SWEPT_FAULTS[fault]
    radars = list_suite_radars("cw", "fmcw") if simulator is turned_round else list_suite_radars("fmcw")
    assert failed(run_conformance(simulator, radars=radars)) == each(*wanted, radar="fmcw")


def test_a_beat_of_twice_the_slope_or_of_the_wrong_coupling_fails():
    def half(scatterers, radar):
        return bench.simulate_sweep(scatterers.assign(range=0.5 * scatterers["range"]), radar)

    def against(scatterers, radar):
        return bench.simulate_sweep(scatterers.assign(radial_velocity=-scatterers["radial_velocity"]), radar)

    def conjugated(scatterers, radar):  # the text books' sign
        return np.conj(bench.simulate_sweep(scatterers, radar))

    for sweep, wanted in ((half, False), (against, False), (conjugated, True)):
        (check,) = run_conformance(only=["beat_frequency"], sweep=sweep)
        assert check.passed is wanted


def one_way_wall(scatterers, **wall):
    behind = bench.apply_wall(scatterers, **wall)
    return behind.assign(path_gain=np.sqrt(behind["path_gain"]))


def wall_without(name):
    def part(scatterers, **wall):
        behind = bench.apply_wall(scatterers, **wall)
        return behind.drop_vars(name) if name == "path_phase" else behind.assign({name: scatterers[name]})

    return part


def wall_that_spreads(scatterers, **wall):  # 0.4 dB at 5 m behind 115 mm of brick
    behind = bench.apply_wall(scatterers, **wall)
    return behind.assign(path_gain=behind["path_gain"] * (scatterers["range"] / behind["range"]) ** 4)


def real_noise(radar, *, n_pulses, rng):
    return math.sqrt(2) * bench.sample_receiver_noise(radar, n_pulses=n_pulses, rng=rng).real


def slow_noise(radar, *, n_pulses, rng):
    noise = bench.sample_receiver_noise(radar, n_pulses=n_pulses, rng=rng)
    return (noise + np.roll(noise, 1, axis=0)) / math.sqrt(2)


def truncated(samples, *, bits, full_scale_v):
    step_v = 2 * full_scale_v / 2**bits
    return step_v * (np.floor(samples.real / step_v) + 1j * np.floor(samples.imag / step_v))


def floor_of_the_other_sign(scatterers, **floor):
    over = bench.apply_floor(scatterers, **floor)
    once = np.char.endswith(over["marker"].values.astype(str), ":bounce")
    return over.assign(path_phase=over["path_phase"] + np.where(once, np.pi, 0.0))


PART_FAULTS = {
    "noise 0.5 dB high": (
        {"noise": lambda r, *, n_pulses, rng: 10**0.025 * bench.sample_receiver_noise(r, n_pulses=n_pulses, rng=rng)},
        {"noise_power[fmcw]", "matched_snr[fmcw]"},
    ),
    "noise in one channel": ({"noise": real_noise}, {"noise_whiteness[fmcw]"}),
    "noise from two pulses": ({"noise": slow_noise}, {"noise_whiteness[fmcw]"}),
    "no noise": (
        {"noise": lambda r, *, n_pulses, rng: np.zeros((n_pulses, 65))},
        {"noise_power[fmcw]", "noise_whiteness[fmcw]", "matched_snr[fmcw]"},
    ),
    "no rounding": ({"quantise": lambda s, *, bits, full_scale_v: s}, {"quantisation_snr"}),
    "one bit less": (
        {"quantise": lambda s, *, bits, **scale: bench.quantise_samples(s, bits=bits - 1, **scale)},
        {"quantisation_snr", "quantisation_bias"},
    ),
    "truncation": ({"quantise": truncated}, {"quantisation_snr", "quantisation_bias"}),
    "one-way loss": ({"wall": one_way_wall}, {"wall_loss"}),
    "no delay": ({"wall": wall_without("range")}, {"wall_delay", "wall_phase", "wall_loss"}),
    "delay that spreads": ({"wall": wall_that_spreads}, {"wall_loss"}),
    "no rest of the phase": ({"wall": wall_without("path_phase")}, {"wall_phase"}),
    "no wall": ({"wall": lambda s, **wall: s}, {"wall_loss", "wall_delay", "wall_phase"}),
    "no bounce": ({"two_ray": lambda s, **floor: s}, {"two_ray_pattern"}),
    "bounce without a change of sign": ({"two_ray": floor_of_the_other_sign}, {"two_ray_pattern"}),
    "one bounce alone": (
        {"two_ray": lambda s, **floor: bench.apply_floor(s, **floor).isel(scatterer=[0, 1])},
        {"two_ray_pattern"},
    ),
}


@pytest.mark.parametrize("fault", PART_FAULTS)
def test_a_fault_of_a_part_fails_exactly_its_checks(fault):
    parts, wanted = PART_FAULTS[fault]
    checks = run_conformance(radars=list_suite_radars("fmcw"), only=OF_PARTS, **parts)
    assert failed(checks) == wanted
    own = [rule for rule in RULES if rule.name in OF_PARTS and (not rule.waveforms or "fmcw" in rule.waveforms)]
    assert len(checks) == len(own)


def averaged_noise(radar, *, n_pulses, rng):
    return bench.sample_receiver_noise(change_radar(radar, threshold_step_v=None), n_pulses=n_pulses, rng=rng)


def fixed_ratio_noise(radar, *, n_pulses, rng):
    """A counter whose noise does not rise with the root of the input noise: right at 5 steps, not at 1 and 20."""
    noise = bench.sample_receiver_noise(change_radar(radar, threshold_step_v=None), n_pulses=n_pulses, rng=rng)
    return noise if radar.threshold_step_v is None else noise * math.sqrt(1 / (5 * math.sqrt(math.pi)))


def white_noise(radar, *, n_pulses, rng):
    return bench.sample_receiver_noise(change_radar(radar, noise_correlation=()), n_pulses=n_pulses, rng=rng)


def shuffled_noise(radar, *, n_pulses, rng):
    """The right correlation over every second bin."""
    noise = bench.sample_receiver_noise(radar, n_pulses=n_pulses, rng=rng)
    return np.concatenate([noise[:, ::2], noise[:, 1::2]], axis=1)


@pytest.mark.parametrize(
    ("noise", "wanted"),
    [
        (averaged_noise, "counter_noise"),
        (fixed_ratio_noise, "counter_noise"),
        (white_noise, "noise_correlation"),
        (shuffled_noise, "noise_correlation"),
    ],
)
def test_a_fault_of_the_noise_of_bins_fails_exactly_its_check(noise, wanted):
    checks = run_conformance(radars=list_suite_radars("impulse"), only=OF_PARTS, noise=noise)
    assert failed(checks) == {f"{wanted}[impulse]"}
    # the X4 states both itself: its noise power shows the law too
    checks = run_conformance(radars={"x4": X4}, only=["noise_power", "noise_correlation"], noise=noise)
    shown = {"counter_noise": "noise_power[x4]", "noise_correlation": "noise_correlation[x4]"}
    assert failed(checks) == {shown[wanted]}


def test_a_weak_echo_shows_in_the_signal_to_noise_ratio():
    for name in ("impulse", "rectangular", "stepped", "cw"):
        checks = run_conformance(
            lambda s, r: 0.9 * bench.simulate_bins(s, r), radars=list_suite_radars(name), only=["matched_snr"],
            noise=bench.sample_receiver_noise,
        )  # fmt: skip
        assert failed(checks) == {f"matched_snr[{name}]"}
        assert checks[0].figure == pytest.approx(-20 * math.log10(0.9), abs=0.03)


def test_an_error_or_a_wrong_shape_is_a_failure_with_its_text():
    def broken(scatterers, radar):
        raise ZeroDivisionError("no such thing")

    (check,) = run_conformance(broken, radars=list_suite_radars("cw"), only=["radar_equation"])
    assert check.passed is False
    assert check.note == "ZeroDivisionError: no such thing"
    (check,) = run_conformance(lambda s, r: np.zeros((5, 7)), radars=list_suite_radars("cw"), only=["radar_equation"])
    assert (check.passed, "(5, 7)" in check.note) == (False, True)


def test_silence_and_nan_fail():
    for value in (0.0, np.nan):
        checks = run_conformance(
            lambda s, r, value=value: np.full((s.sizes["slow_time"], 65), value), radars=list_suite_radars("fmcw")
        )
        passed = {check.name for check in checks if check.passed is True}
        assert passed == set()


def test_an_own_range_axis_of_a_data_array_counts():
    def finer(scatterers, radar):
        fine = Radar.model_validate({**radar.model_dump(), "sample_rate_hz": 2 * radar.sample_rate_hz})
        return bench.simulate_bins(scatterers, fine)

    checks = run_conformance(finer, radars=list_suite_radars("impulse"), only=["range_migration", "range_profile"])
    assert failed(checks) == set()


def test_presets_can_be_measured_too():
    radars = {name: Radar.preset(name) for name in ("x4", "ti-60", "xband-cw")}
    checks = run_conformance(radars=radars, only=[r.name for r in RULES if not r.name.startswith("same")])
    assert failed(checks) == set()
    assert {"radar_equation[x4]", "beat_frequency[ti-60]", "noise_power[xband-cw]"} <= {c.name for c in checks}


def test_only_takes_rules_and_single_checks_and_refuses_others():
    names = [c.name for c in run_conformance(only=["wall_loss", "radar_equation[cw]", "beat_frequency"])]
    assert names == ["radar_equation[cw]", "beat_frequency[fmcw]", "wall_loss"]
    with pytest.raises(ConfigError, match=r"no check 'wal'.*wall_loss"):
        run_conformance(only=["wal"])
    with pytest.raises(ConfigError, match="no theory for waveform 'chaos'"):
        list_suite_radars("chaos")
    with pytest.raises(ConfigError, match="radars is empty"):
        run_conformance(radars={})


def test_report_says_what_was_passed_failed_and_left_out():
    checks = [
        Check("a[b]", "this", 0.123456, 1.0, "dB", True, "E-1"),
        Check("c", "that | this", 3.0, 1.0, "m", False, "E-2"),
        Check("d", "more", math.nan, 1.0, "m", None, "E-3", "no such part"),
    ]
    lines = format_report(checks).splitlines()
    assert lines[2] == "| a[b] | this | 0.12 | 1 | dB | passed | E-1 |"
    assert lines[3] == "| c | that \\| this | 3 | 1 | m | FAILED | E-2 |"
    assert lines[4] == "| d | more |  | 1 | m | not applicable | E-3 (no such part) |"
    assert lines[-1] == "3 checks: 1 passed, 1 failed, 1 not applicable"


def test_command_prints_a_table_or_json_and_its_exit_tells(capsys, monkeypatch):
    assert __main__.main(["--only", "wall_loss"]) == 0
    assert "| wall_loss |" in capsys.readouterr().out
    assert __main__.main(["--only", "wall_loss", "--only", "quantisation_snr", "--json"]) == 0
    assert [c["name"] for c in json.loads(capsys.readouterr().out)] == ["quantisation_snr", "wall_loss"]
    assert __main__.main(["--only", "nonsense"]) == 2
    assert "nonsense" in capsys.readouterr().err
    monkeypatch.setattr(bench, "quantise_samples", lambda s, *, bits, full_scale_v: s)
    assert __main__.main(["--only", "quantisation_snr", "--json"]) == 1
    (check,) = json.loads(capsys.readouterr().out)
    assert check["figure"] is None  # infinite
    assert check["passed"] is False


def test_theory_has_the_figures_of_the_literature():
    assert theory.pulse_sigma_s(X4) == pytest.approx(0.3450e-9, rel=1e-4)
    assert theory.half_power_width_m(X4) == pytest.approx(0.0861, abs=5e-5)
    assert theory.count_averages(X4) == 94  # 0.95 x 15.1875 MHz / (1000 Hz x 152 levels)
    power_w = theory.received_w(X4, range_m=np.array(5.0), gain_m2=np.array(1.0))
    assert 10 * math.log10(1e3 * power_w) == pytest.approx(-80.7, abs=0.05)
    one = change_radar(X4, receiver_gain_db=0.0, noise_figure_db=0.0, noise_bandwidth_hz=1.4e9, threshold_step_v=None)
    noise_w = theory.bin_noise_v2(one) * 94 / (2 * 50)
    assert 10 * math.log10(1e3 * noise_w) == pytest.approx(-82.5, abs=0.05)
    # a counter with input noise of 5 steps, n = 94: 0.564 x 5 / 94 steps^2 of an RF sample
    five = change_radar(X4, threshold_step_v=theory.input_noise_v(X4) / 5, noise_bandwidth_hz=X4.sample_rate_hz / 4)
    assert theory.bin_noise_v2(five) / five.threshold_step_v**2 == pytest.approx(0.5642 * 5 / 94, rel=1e-4)
    fmcw = Radar(waveform="fmcw", carrier_hz=24e9, bandwidth_hz=1e9, sweep_s=1e-3, sample_rate_hz=256e3, prf_hz=500.0,
                 range_stop_m=9.0)  # fmt: skip
    assert 2.0 * theory.coupling_s(fmcw) == pytest.approx(-0.048)
    assert theory.half_power_width_m(fmcw) / (C / 2e9) == pytest.approx(1.441, abs=2e-3)
    lfm = list_suite_radars("lfm")["lfm"]
    assert theory.half_power_width_m(lfm) == pytest.approx(0.886 * C / 2e9, rel=0.01)
    rectangular = list_suite_radars("rectangular")["rectangular"]
    assert theory.half_power_width_m(rectangular) == pytest.approx((2 - math.sqrt(2)) * C * 1e-9 / 2, rel=1e-3)
    assert theory.compute_profile(rectangular, np.array([0.0, 0.075, 0.16])) == pytest.approx(
        [1.0, 1 - 2 * 0.075 / C / 1e-9, 0.0], abs=1e-3
    )


@pytest.mark.parametrize(("wall", "loss_db"), [(0, 0.8), (1, 3.7), (2, 32.7)])
def test_theory_of_walls_is_that_of_p_2040_at_7_29_ghz(wall, loss_db):
    from doppelgait_conformance.receiver import WALLS

    given = dict(WALLS[wall])
    thickness_m = given.pop("thickness_m")
    eps = theory.compute_permittivity(carrier_hz=7.29e9, **given)
    t = theory.compute_slab_insertion(1.0, permittivity=eps, thickness_m=thickness_m, wavelength_m=C / 7.29e9)
    assert -20 * math.log10(abs(t)) == pytest.approx(loss_db, rel=0.2)


def test_theory_of_a_half_wave_slab_and_of_a_floor():
    eps, wavelength_m = complex(4.0), 0.04
    t = theory.compute_slab_insertion(1.0, permittivity=eps, thickness_m=0.01, wavelength_m=wavelength_m)
    assert t == pytest.approx(-1.0 * np.exp(2j * np.pi * 0.25))  # half a wave inside, a quarter of one displaced
    grazing, brewster, upright = theory.compute_floor_reflection(
        np.array([0.0, 1 / math.sqrt(5.0), 1.0]), permittivity=eps
    )
    assert (grazing, brewster, upright) == pytest.approx((-1.0, 0.0, 1 / 3), abs=1e-12)
