"""Closed-form tests of docs/theory.md from scene to feature, by their numbers there."""

import numpy as np
import pytest

import literal
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.core.rng import Streams
from doppelgait.motion import make_motion
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.motion.retime import resample, scale_to_height
from doppelgait.pipeline import analyze, simulate
from doppelgait.processing import Analysis, Gate, range_doppler, signature
from doppelgait.radar import Radar, Recording, add_noise, noise_power_v2, received_power_w, synthesise, synthesise_rf
from doppelgait.scene import Scene, Target
from echo_table import range_table

PRF_HZ = 1000.0
WAVELENGTH_M = 299_792_458.0 / 7.29e9


def moving(start_m, velocity_mps, n_pulses, prf_hz=PRF_HZ):
    """Range of one scatterer that approaches at velocity_mps, shape (I, 1)."""
    return start_m - velocity_mps * np.arange(n_pulses)[:, None] / prf_hz


def wide_signature(baseband, **analysis):
    """Signature over all range bins."""
    range_m = baseband.coords["range"].values
    slow_time_s = baseband.coords["slow_time"].values
    gate = Gate.around(
        slow_time_s, np.full(slow_time_s.size, range_m.mean()), span_m=float(np.ptp(range_m)), source="given"
    )
    settings = Analysis(**{"gate_edges": "sharp", **analysis})
    return signature(baseband, gate, settings, wavelength_m=WAVELENGTH_M)


def width_at(axis, power, share):
    """Width of the main peak at a share of its maximum, crossings interpolated."""
    level = power / power.max() - share
    peak = int(power.argmax())
    right = peak + int(np.argmax(level[peak:] < 0))
    left = peak - int(np.argmax(level[peak::-1] < 0))
    step = axis[1] - axis[0]
    return (
        axis[right]
        - step * level[right] / (level[right] - level[right - 1])
        - axis[left]
        + step * level[left] / (level[left + 1] - level[left])
    )


def relative_errors(found, wanted):
    return {key: abs(found[key] / wanted[key] - 1) for key in wanted}


def test_mean_power_of_many_scatterers_is_that_of_their_total_rcs_e08():
    radar = Radar.preset("x4", pulse_sigma_s=1e-9)
    rng = np.random.default_rng(0)
    at_m = radar.range_axis_m()[100]
    range_m = at_m + rng.uniform(-0.25, 0.25, (20_000, 25)) * WAVELENGTH_M  # every phase alike
    y = synthesise(range_table(range_m, 0.8 / 25), radar).values[:, 100].astype(np.complex128)
    power_w = np.abs(y) ** 2 / 100 / 10
    assert power_w.mean() == pytest.approx(received_power_w(radar, range_m=at_m, rcs_m2=0.8), rel=0.03)
    assert power_w.std() / power_w.mean() == pytest.approx(1.0, abs=0.04)  # Swerling 1


@pytest.mark.parametrize(
    ("velocity_mps", "sigma_ns", "width_hz"),
    [
        (0.5, 0.345, 13.9),
        (2, 0.345, 17.0),
        (4, 0.345, 24.5),
        (8, 0.345, 43.1),
        (0.5, 1.0, 13.7),
        (2, 1.0, 14.1),
        (4, 1.0, 15.3),
        (8, 1.0, 19.5),
    ],
)
def test_doppler_width_of_a_migrating_scatterer_e27(velocity_mps, sigma_ns, width_hz):
    radar = Radar.preset("x4", pulse_sigma_s=sigma_ns * 1e-9, range_start_m=2.0, range_stop_m=10.0)
    y = synthesise(range_table(moving(6.0, velocity_mps, 150), 1.0), radar)
    mu = wide_signature(y, doppler_bins=4096)
    width = width_at(mu.coords["doppler"].values, mu.values.mean(axis=0).astype(float), 0.5)
    assert width == pytest.approx(width_hz, abs=0.01 * width_hz)


def test_05_levels_follow_range_rcs_and_receiver_gain():
    radar = Radar.preset("x4")
    axis_m = radar.range_axis_m()

    def peak_db(range_bin, rcs_m2=0.5, receiver=radar):
        y = synthesise(range_table([[axis_m[range_bin]]], rcs_m2), receiver).values
        return 20 * np.log10(np.abs(y).max())

    assert peak_db(180) - peak_db(90) == pytest.approx(-12.0412, abs=1e-4)
    assert peak_db(90, 1.0) - peak_db(90) == pytest.approx(3.0103, abs=1e-4)
    louder = Radar.preset("x4", receiver_gain_db=20.0)
    assert peak_db(90, receiver=louder) - peak_db(90) == pytest.approx(10, abs=1e-4)
    # a counter's noise rises with the root of the input noise, that of a receiver that averages in proportion
    assert 10 * np.log10(noise_power_v2(louder) / noise_power_v2(radar)) == pytest.approx(5, abs=1e-9)
    quiet, loud = (Radar.preset("liland2018", receiver_gain_db=gain_db) for gain_db in (10.0, 20.0))
    assert 10 * np.log10(noise_power_v2(loud) / noise_power_v2(quiet)) == pytest.approx(10, abs=1e-9)


def noise_recording(n_pulses, n_bins, power, seed):
    empty = make_array(
        BASEBAND,
        np.zeros((n_pulses, n_bins), dtype=np.complex64),
        {"slow_time": np.arange(n_pulses) / PRF_HZ, "range": 0.05 * np.arange(n_bins)},
    )
    return add_noise(empty, noise_power_v2=power, rng=np.random.default_rng(seed))


def test_06_noise_has_the_level_of_theory_in_every_cell():
    power = 2.5e-9
    y = noise_recording(6000, 40, power, 8)
    analysis = Analysis(doppler_bins=128, hop=8)
    w2 = (literal.window(101, 0.4) ** 2).sum()
    total, count = 0.0, 0
    for block in range_doppler(y, analysis, wavelength_m=WAVELENGTH_M):
        assert block.attrs["window_energy"] == pytest.approx(w2, rel=1e-12)
        total += float(block.values.sum(dtype=float))
        count += block.size
    assert total / count / w2 == pytest.approx(power, rel=0.01)
    mu = wide_signature(y, doppler_bins=128, hop=8)
    assert mu.attrs["n_gate_bins"] == 40
    assert float(mu.values.mean(dtype=float)) == pytest.approx(40 * power * w2, rel=0.01)


@pytest.mark.parametrize("preset", ["x4", "liland2018"])
def test_07_rf_path_equals_the_direct_baseband_model(preset):
    radar = Radar.preset(preset, range_start_m=2.0, range_stop_m=5.0)
    rng = np.random.default_rng(4)
    table = range_table(rng.uniform(2.5, 4.5, (6, 5)), rng.uniform(0.1, 1, (6, 5)))
    direct = synthesise(table, radar).values
    error = np.abs(direct - synthesise_rf(table, radar).values).max() / np.abs(direct).max()
    assert 20 * np.log10(error) < -80


@pytest.fixture(scope="module")
def walker():
    return boulic_walk(speed_mps=1.3, height_m=1.8, duration_s=4.0)


def main_features(recording, **analysis):
    result = analyze(recording, gate="truth", analysis=Analysis(**analysis))[0]
    return {
        "v_m": result.features.torso_velocity_mps,
        "f_mu": result.gait_frequency_hz,
        "rho": result.features.limb_torso_ratio,
    }


def test_09_transform_length_hop_and_decimation_do_not_change_the_features(walker):
    scene = Scene([Target(walker)])
    frame = {"range_start_m": 1.0, "range_stop_m": 9.0}
    plain = simulate(scene, Radar.preset("x4", **frame))
    noisy = simulate(scene, Radar.preset("x4", **frame), rng=Streams(1), snr_db=15.0)
    for recording in (plain, noisy):
        reference = main_features(recording, doppler_bins=512, hop=10)
        for k, hop in ((101, 1), (101, 10), (256, 5), (512, 1)):
            errors = relative_errors(main_features(recording, doppler_bins=k, hop=hop), reference)
            assert max(errors.values()) < 0.02, (k, hop, errors)
    full_rate = simulate(scene, Radar.preset("x4", decimation=1, **frame))
    errors = relative_errors(main_features(full_rate), main_features(plain))
    assert max(errors.values()) < 0.02, errors


def marker_motion(t):
    """One marker: walks 1.2 m/s, swings 0.3 m at 2 Hz, heights to 1.5 m."""
    swing = 0.3 * np.sin(2 * np.pi * 2.0 * t)
    body = np.stack([1.2 * t, 0 * t, 1.0 + 0 * t], axis=-1)
    limb = np.stack([1.2 * t + swing, 0.1 + 0 * t, 0.5 + 0.2 * np.sin(2 * np.pi * 2.0 * t)], axis=-1)
    return np.stack([body, limb], axis=1)


@pytest.mark.parametrize(
    ("mode", "speed", "frequency", "length"),
    [("uniform", 2 / 3, 1.0, 2 / 3), ("froude", np.sqrt(2 / 3), np.sqrt(3 / 2), 2 / 3), ("z_only", 1.0, 1.0, 1.0)],
)
def test_10_height_factor_two_thirds_in_the_three_modes(mode, speed, frequency, length):
    facts = {"height_m": 1.8, "mass_kg": 80.0, "gait_frequency_hz": 2.0, "stride_frequency_hz": 1.0}
    t = np.arange(0, 4, 1 / 200)
    motion = make_motion(
        marker_motion(t), rate_hz=200, markers=["hip", "hand"], parts=["torso", "left_hand"], facts=facts
    )
    scaled = scale_to_height(motion, height_m=1.2, mode=mode)
    times = np.arange(0, 3.2, 1e-3)
    position, velocity = resample(scaled, times)
    assert velocity[:, 0, 0].mean() == pytest.approx(1.2 * speed, rel=1e-6)
    swing = velocity[:, 1, 0] - velocity[:, 0, 0]
    amplitude = {"uniform": 0.2, "froude": 0.2, "z_only": 0.3}[mode]
    swing_wanted = amplitude * 4 * np.pi * frequency * np.cos(4 * np.pi * frequency * times)
    assert np.abs(swing - swing_wanted)[50:-50].max() < 1e-3 * swing_wanted.max()
    step_m = velocity[:, 0, 0].mean() / (2.0 * frequency)
    assert step_m == pytest.approx(0.6 * length, rel=1e-6)
    assert position[:, 0, 2] == pytest.approx(2 / 3)  # heights always scale
    assert scaled.facts.gait_frequency_hz == pytest.approx(2.0 * frequency)
    assert scaled.facts.stride_frequency_hz == pytest.approx(frequency)
    assert scaled.facts.height_m == 1.2


class Untouchable:
    """Raises on any use."""

    def _refuse(self, *args, **kwargs):
        raise AssertionError("the truth was read")

    __iter__ = __len__ = __getitem__ = __bool__ = __contains__ = __eq__ = __getattr__ = _refuse
    __hash__ = None


def without_truth(recording):
    bare = Recording.from_baseband(recording.baseband, recording.radar)
    object.__setattr__(bare, "truth", Untouchable())
    return bare


@pytest.mark.parametrize("method", ["standard", "liland2018"])
def test_12_analysis_with_a_given_gate_reads_no_truth(walker, method):
    recording = simulate(Scene([Target(walker, label="human")]), Radar.preset("x4"))
    truth = recording.truth[0]
    slow_time_s = recording.baseband.coords["slow_time"].values
    gate = Gate.around(slow_time_s, truth.centre_range_m, span_m=1.6, source="given")
    bare = without_truth(recording)
    with pytest.raises(AssertionError):
        list(bare.truth)
    result = analyze(bare, gate=gate, analysis=Analysis(method=method))[0]
    assert result.gate.source == "given"
    assert result.label is None
    assert result.gait_frequency_hz is not None


def test_12b_the_truth_gate_reads_the_range_and_the_label_alone(walker):
    recording = simulate(Scene([Target(walker, label="human")]), Radar.preset("x4"))
    wanted = analyze(recording, gate="truth")[0]

    class OnlyRange:
        label = "human"
        centre_range_m = recording.truth[0].centre_range_m

    bare = without_truth(recording)
    object.__setattr__(bare, "truth", (OnlyRange(),))
    assert analyze(bare, gate="truth")[0].features == wanted.features


def test_12c_the_label_changes_no_feature(walker):
    radar = Radar.preset("x4")
    results = []
    for label in ("human", "dog", ""):
        scene = Scene([Target(walker, label=label)])
        results.append(analyze(simulate(scene, radar, rng=Streams(3)), gate="truth")[0])
    assert results[0].features == results[1].features == results[2].features
