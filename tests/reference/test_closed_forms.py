"""Closed-form tests of docs/theory.md from scene to feature, by their numbers there."""

import numpy as np
import pytest

from doppelgait.core.rng import Streams
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.pipeline import analyze, simulate
from doppelgait.processing import Analysis, Gate, signature
from doppelgait.radar import Radar, Recording, synthesise
from doppelgait.scene import Scene, Target
from echo_table import range_table

PRF_HZ = 1000.0
WAVELENGTH_M = 299_792_458.0 / 7.29e9


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
    range_m = 6.0 - velocity_mps * np.arange(150)[:, None] / PRF_HZ
    y = synthesise(range_table(range_m, 1.0), radar)
    mu = wide_signature(y, doppler_bins=4096)
    width = width_at(mu.coords["doppler"].values, mu.values.mean(axis=0).astype(float), 0.5)
    assert width == pytest.approx(width_hz, abs=0.01 * width_hz)


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


@pytest.mark.parametrize(("rcs", "most"), [("body_parts", 0.02), ("surfaces", 0.06)])
def test_09_transform_length_hop_and_decimation_do_not_change_the_features(walker, rcs, most):
    """In noise, the main line of a body that flashes lies on the torso or on a thigh, 0.07 m/s apart."""
    scene = Scene([Target(walker, rcs=rcs)])
    frame = {"range_start_m": 1.0, "range_stop_m": 9.0}
    plain = simulate(scene, Radar.preset("x4", **frame))
    noisy = simulate(scene, Radar.preset("x4", **frame), rng=Streams(1), snr_db=15.0)
    for recording in (plain, noisy):
        reference = main_features(recording, doppler_bins=512, hop=10)
        for k, hop in ((101, 1), (101, 10), (256, 5), (512, 1)):
            errors = relative_errors(main_features(recording, doppler_bins=k, hop=hop), reference)
            assert max(errors.values()) < most, (k, hop, errors)
    full_rate = simulate(scene, Radar.preset("x4", decimation=1, **frame))
    errors = relative_errors(main_features(full_rate), main_features(plain))
    assert max(errors.values()) < 0.02, errors


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
