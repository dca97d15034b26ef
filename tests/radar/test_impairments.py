"""Impairments: declaration, order, streams, timing and the quadrature channels."""

import json
import math
from typing import Literal

import numpy as np
import pytest

from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.radar import Radar
from doppelgait.radar.impairments import (
    IMPAIRMENTS,
    Adc,
    ColouredNoise,
    DcLeak,
    DroppedFrames,
    FrameJitter,
    Impairments,
    Interference,
    IqImbalance,
    Leakage,
    PhaseNoise,
    Spur,
    StaticClutter,
    ThermalNoise,
    X4Counts,
    apply_impairments,
    image_ratio_db,
    make_impairment,
    shift_pulse_times,
)

X4 = Radar.preset("x4", volts_per_unit=0.4)
RADARS = {
    "impulse": X4,
    "rectangular": Radar(
        waveform="rectangular", carrier_hz=10e9, prf_hz=1000, sample_rate_hz=1e9, range_stop_m=9, sweep_s=4e-9
    ),
    "lfm": Radar(
        waveform="lfm", carrier_hz=10e9, prf_hz=1000, sample_rate_hz=1e9, range_stop_m=9, sweep_s=1e-6, bandwidth_hz=4e8
    ),
    "fmcw": Radar(
        waveform="fmcw", carrier_hz=60e9, prf_hz=1000, sample_rate_hz=2e6, range_stop_m=9, sweep_s=64e-6,
        bandwidth_hz=1e9,
    ),
    "stepped": Radar(
        waveform="stepped", carrier_hz=6e9, prf_hz=100, sample_rate_hz=2e4, range_stop_m=9, sweep_s=5e-3,
        bandwidth_hz=1e9,
    ),
    "cw": Radar(waveform="cw", carrier_hz=24.1e9, prf_hz=1000, sample_rate_hz=3000, range_stop_m=9),
}  # fmt: skip
EXAMPLES = (
    ThermalNoise(),
    Interference(rate_hz=100.0),
    PhaseNoise(density_dbc_per_hz=-80.0),
    FrameJitter(),
    DroppedFrames(probability=0.2),
    IqImbalance(),
    DcLeak(),
    Leakage(),
    StaticClutter(rcs_per_metre_m2=0.1),
    Adc(),
    ColouredNoise(),
    Spur(),
)


def n_samples(radar):
    return radar.waveform.n_samples(radar)


def random_samples(shape, seed=3):
    rng = np.random.default_rng(seed)
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)).astype(np.complex64)


def only(samples, spec, radar=X4, seed=1):
    return impaired(samples, [spec], radar=radar, seed=seed)


def impaired(samples, specs, radar=X4, seed=7):
    return apply_impairments(samples, specs, radar=radar, rng=np.random.default_rng(seed)).matrix


def test_examples_cover_every_kind_but_the_x4s():
    assert {spec.kind for spec in EXAMPLES} | {"x4_counts"} == set(IMPAIRMENTS)


@pytest.mark.parametrize("spec", [*EXAMPLES, X4Counts(pulses_per_step=5, dac_max=1000)], ids=lambda spec: spec.kind)
def test_table_and_json_give_the_same_model(spec):
    assert make_impairment(spec.model_dump()) == spec
    assert make_impairment(json.loads(spec.model_dump_json())) == spec
    assert make_impairment(spec) is spec


class Hum(FrozenModel):
    kind: Literal["hum"] = "hum"


@pytest.mark.parametrize(
    ("returned", "text"),
    [
        (lambda samples: None, "returns nothing; it must return the samples"),
        (lambda samples: samples.matrix[0], r": receiver samples must be complex, .*, not complex64 of shape \(5,\)"),
        (lambda samples: [[1j, 2j], [3j]], ": .*inhomogeneous"),
        (lambda samples: samples.matrix[1:], r"returns samples of shape \(3, 5\) instead of \(4, 5\)"),
    ],
)
def test_an_impairment_of_a_plugin_that_returns_no_samples_is_named(register, returned, text):
    register("impairment", parameters=Hum)(lambda samples, parameters, radar, rng: returned(samples))
    with pytest.raises(AnalysisError, match=f"^impairment 'hum' of tests ?{text}"):
        only(random_samples((4, 5)), Hum())


class Owner(FrozenModel):
    impairments: Impairments = ()


def test_field_takes_tables_and_models_in_order_and_writes_all_their_keys():
    owner = Owner(impairments=[{"kind": "adc", "bits": 10}, PhaseNoise(white_rad=0.1)])
    assert owner.impairments == (Adc(bits=10), PhaseNoise(white_rad=0.1))
    dumped = owner.model_dump(mode="json")["impairments"]
    assert dumped[0]["bits"] == 10
    assert dumped[1]["white_rad"] == 0.1
    assert Owner.model_validate(json.loads(owner.model_dump_json())) == owner


def test_wrong_entries_are_named():
    text = '[[impairments]]\nkind = "adc"\n\n[[impairments]]\nkind = "adc"\nbits = 99\n'
    table = {"impairments": [{"kind": "adc"}, {"kind": "adc", "bits": 99}]}
    with pytest.raises(ConfigError, match=r"impairments\.1\.bits \(line 6\): 99 is not allowed"):
        validate(Owner, table, text=text)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"kind": "echo"}, r"kind 'echo' is not allowed: known are adc, coloured_noise, dc_leak"),
        ({}, "kind None is not allowed"),
        (X4, "unknown impairment 'None'"),
        ({"kind": "adc", "bit": 8}, "bit: unknown key; allowed are backoff_db, bits"),
        ({"kind": "coloured_noise", "levels": [[10, -60], [5, -70]]}, "must rise"),
        ({"kind": "dropped_frames"}, "exactly one of probability and frames"),
        ({"kind": "dropped_frames", "probability": 0.8, "mean_length": 2}, r"0\.8 needs longer bursts.*0\.6667"),
        ({"kind": "dropped_frames", "frames": [-1]}, "counted from 0; -1 is not allowed"),
        ({"kind": "leakage", "level_db": 0, "isolation_db": 3}, "level_db or isolation_db, not both"),
        ({"kind": "static_clutter"}, "exactly one of levels and rcs_per_metre_m2"),
        ({"kind": "static_clutter", "levels": [[3, -50], [2, -60]]}, "entry to entry, but 2 m follows 3 m"),
        ({"kind": "x4_counts", "dac_max": 900}, "dac_max 900 must be larger than dac_min 949"),
    ],
)
def test_impairments_that_cannot_be_are_refused(table, message):
    with pytest.raises(ConfigError, match=message):
        make_impairment(table)


@pytest.mark.parametrize("waveform", RADARS)
@pytest.mark.parametrize("spec", EXAMPLES, ids=lambda spec: spec.kind)
def test_every_kind_on_every_waveform_keeps_shape_and_leaves_its_input(waveform, spec):
    radar = RADARS[waveform]
    samples = random_samples((40, n_samples(radar)))
    before = samples.copy()
    samples.flags.writeable = False
    out = only(samples, spec, radar)
    assert out.shape == samples.shape
    assert out.dtype == np.complex64
    assert np.isfinite(out).all()
    np.testing.assert_array_equal(samples, before)
    assert (out == before).all() == (spec.kind == "frame_jitter")


def test_samples_of_another_shape_or_type_are_refused():
    with pytest.raises(AnalysisError, match="must be complex"):
        only(np.zeros((3, 188)), Adc())
    for spec in (Leakage(), StaticClutter(rcs_per_metre_m2=1), PhaseNoise(density_dbc_per_hz=-80)):
        with pytest.raises(AnalysisError, match="has 188 samples, but these have 5"):
            only(np.zeros((3, 5), np.complex64), spec)


def test_same_seed_same_bytes_other_seed_or_order_other_bytes():
    samples = random_samples((50, 188))
    specs = [ThermalNoise(level_db=-3), PhaseNoise(white_rad=1), Adc(bits=3)]
    one, same = (impaired(samples, specs) for _ in range(2))
    assert one.tobytes() == same.tobytes()
    assert one.tobytes() != impaired(samples, specs, seed=8).tobytes()
    assert one.tobytes() != impaired(samples, specs[::-1]).tobytes()


def test_random_numbers_of_one_do_not_depend_on_those_before():
    samples = np.zeros((50, 188), np.complex64)
    noise = ThermalNoise(level_db=-3)
    a, b = (impaired(samples, [first, noise]) for first in (IqImbalance(), PhaseNoise(density_dbc_per_hz=-80)))
    np.testing.assert_array_equal(a, b)
    twice = impaired(samples, [noise, noise])
    assert np.mean(np.abs(twice) ** 2) == pytest.approx(2 * 10**-0.3, rel=0.05)  # independent, so powers add


def test_empty_list_changes_nothing():
    samples = random_samples((2, 188))
    assert np.shares_memory(impaired(samples, []), samples)


def test_jitter_moves_the_pulses_and_not_the_samples():
    nominal = np.arange(20_000) / X4.prf_hz
    specs = [IqImbalance(), FrameJitter(sd_s=3e-5), FrameJitter(sd_s=4e-5)]
    times = shift_pulse_times(nominal, specs, radar=X4, rng=np.random.default_rng(2))
    error = (times - nominal)[1:-1]
    assert error.std() == pytest.approx(5e-5, rel=0.03)  # 3-4-5: independent errors
    assert abs(error.mean()) < 4 * 5e-5 / math.sqrt(error.size)
    for seed in range(5):  # else one of them would leave it at either end
        ends = shift_pulse_times(nominal[:9], specs, radar=X4, rng=np.random.default_rng(seed))
        assert ends[0] >= nominal[0]
        assert ends[-1] <= nominal[8]
    again = shift_pulse_times(nominal, specs, radar=X4, rng=np.random.default_rng(2))
    np.testing.assert_array_equal(times, again)
    np.testing.assert_array_equal(shift_pulse_times(nominal, [Adc()], radar=X4, rng=np.random.default_rng(2)), nominal)


def test_jitter_that_would_exchange_pulses_is_refused():
    with pytest.raises(ConfigError, match=r"sd_s = 0\.001.*prf_hz = 1000.*0\.0001 s"):
        shift_pulse_times(np.arange(3) / 1000, [FrameJitter(sd_s=1e-3)], radar=X4, rng=np.random.default_rng(2))


@pytest.mark.parametrize(("probability", "mean_length"), [(0.05, 1.0), (0.2, 5.0), (0.6, 20.0)])
def test_lost_frames_have_the_share_and_the_length_asked_for(probability, mean_length):
    n = 400_000
    samples = np.ones((n, 1), np.complex64)
    spec = DroppedFrames(probability=probability, mean_length=mean_length, fill="zero")
    lost = only(samples, spec, RADARS["cw"])[:, 0] == 0
    begins = np.count_nonzero(np.diff(lost.astype(int)) == 1)
    # runs are independent, so that the share's error is that of their number
    tolerance = 5 * probability * math.sqrt(2 * mean_length / (n * probability))
    assert lost.mean() == pytest.approx(probability, abs=tolerance)
    assert lost.sum() / begins == pytest.approx(mean_length, rel=5 / math.sqrt(begins) + 1e-4)


def test_lost_frames_repeat_the_last_that_arrived():
    samples = random_samples((10, 188))
    out = only(samples, DroppedFrames(frames=(0, 1, 4, 7, 8, 9)))
    wanted = [2, 2, 2, 3, 3, 5, 6, 6, 6, 6]
    np.testing.assert_array_equal(out, samples[wanted])
    zeros = only(samples, DroppedFrames(frames=(3,), fill="zero"))
    assert not zeros[3].any()
    np.testing.assert_array_equal(np.delete(zeros, 3, 0), np.delete(samples, 3, 0))
    assert not only(samples, DroppedFrames(frames=tuple(range(10)))).any()


def test_a_lost_frame_must_be_in_the_recording():
    with pytest.raises(ConfigError, match="frame 10 is not in a recording of 10 frames"):
        only(random_samples((10, 188)), DroppedFrames(frames=(10,)))


@pytest.mark.parametrize(("gain_db", "phase_deg"), [(0.5, 3.0), (3.0, 25.0), (-2.0, -10.0), (0.0, 5.0)])
def test_image_ratio_of_a_tone_is_the_closed_form(gain_db, phase_deg):
    spec = IqImbalance(gain_db=gain_db, phase_deg=phase_deg)
    tone = np.exp(2j * np.pi * 10 * np.arange(256) / 256).astype(np.complex64)[:, None]
    spectrum = np.abs(np.fft.fft(only(tone, spec, RADARS["cw"])[:, 0])) ** 2
    g, cos = 10 ** (gain_db / 20), math.cos(math.radians(phase_deg))
    wanted_db = 10 * math.log10((1 + g * g - 2 * g * cos) / (1 + g * g + 2 * g * cos))
    assert 10 * math.log10(spectrum[-10] / spectrum[10]) == pytest.approx(wanted_db, abs=1e-3)
    assert image_ratio_db(spec) == pytest.approx(wanted_db, abs=1e-9)


def test_quadrature_channel_has_the_gain_and_angle_and_the_other_is_untouched():
    samples = random_samples((20, 188))
    out = only(samples, IqImbalance(gain_db=2.0, phase_deg=10.0))
    np.testing.assert_allclose(out.real, samples.real, atol=1e-6)
    turn = math.radians(10.0)
    channel = 10**0.1 * (samples.imag * math.cos(turn) + samples.real * math.sin(turn))
    np.testing.assert_allclose(out.imag, channel, atol=1e-6)
    assert image_ratio_db(IqImbalance(gain_db=0.0, phase_deg=0.0)) == -math.inf


def test_leak_is_a_constant_of_the_level_and_phase():
    out = only(np.zeros((5, 188), np.complex64), DcLeak(level_db=-40.0, phase_deg=90.0, walk_per_sqrt_min=0.0))
    np.testing.assert_allclose(out, 0.01j, atol=1e-8)
    units = only(np.zeros((1, 188), np.complex64), DcLeak(level_db=0.0, in_units=True, phase_deg=0.0))
    np.testing.assert_allclose(units, 0.4, rtol=1e-6)
    with pytest.raises(ConfigError, match=r"dc_leak: level_db is in the sensor's own unit.*volts_per_unit"):
        only(np.zeros((1, 1), np.complex64), DcLeak(in_units=True), RADARS["cw"])


def test_leak_walks_as_far_in_a_minute_as_asked():
    radar = RADARS["cw"].model_copy(update={"prf_hz": 10.0})
    spec = DcLeak(level_db=0.0, phase_deg=0.0, walk_per_sqrt_min=0.3)
    zero = np.zeros((601, 1), np.complex64)
    ends = np.array([only(zero, spec, radar, seed)[[0, 300, 600], 0] for seed in range(1500)])
    np.testing.assert_allclose(ends[:, 0], 1.0)
    powers = np.mean(np.abs(ends - 1.0) ** 2, axis=0)
    assert powers[2] == pytest.approx(0.09, rel=0.12)
    assert powers[1] == pytest.approx(0.045, rel=0.12)
    walk = ends[:, 2] - 1.0
    assert abs(np.mean(walk**2)) < 0.012  # circular
