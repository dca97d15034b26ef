"""The report's own method, reproduced literally: its choices, its failures, its ratio."""

import numpy as np
import pytest

from doppelgait.core.labels import CADENCE_SPECTRUM, Signal, make_array
from doppelgait.features.liland2018 import bandwidth_hz, extract
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.pipeline import analyze, simulate
from doppelgait.processing import Analysis
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target

WAVELENGTH_M = 299_792_458 / 7.29e9
CADENCE_HZ = np.arange(80) / 4.0  # bin 1 / T_o, T_o = 4 s
DOPPLER_HZ = (np.arange(101) - 50) * 1000 / 101


def spectrum(**peaks):
    """D_g = 0.1 but at cadences given as f_1_75=height."""
    values = np.full(CADENCE_HZ.size, 0.1)
    for name, height in peaks.items():
        values[np.abs(CADENCE_HZ - float(name[2:].replace("_", "."))).argmin()] = height
    return Signal.of(make_array(CADENCE_SPECTRUM, values, {"cadence": CADENCE_HZ}), CADENCE_SPECTRUM)


def mean_spectrum():
    level = 0.02 * np.ones(101)
    level[55:61] = [0.1, 0.5, 0.79, 0.6, 0.3, 0.05]
    return level


def extracted(d_g):
    return extract(mean_spectrum(), DOPPLER_HZ, d_g, wavelength_m=WAVELENGTH_M, threshold=0.04)


def test_six_features_by_hand():
    found = extracted(spectrum(f_1_75=3.0, f_3_5=1.2, f_5_25=0.6))
    torso_hz = DOPPLER_HZ[57]
    assert found.gait_frequency_hz == 1.75
    assert found.torso_doppler_hz == pytest.approx(torso_hz)
    f = found.features
    assert f.torso_velocity_mps == pytest.approx(torso_hz * WAVELENGTH_M / 2)
    assert f.step_length_m == pytest.approx(torso_hz * WAVELENGTH_M / 2 / 1.75)
    assert (f.harmonic_ratio_2, f.harmonic_ratio_3) == (2.0, 3.0)
    assert f.limb_torso_ratio == pytest.approx((3.0 + 1.2 + 0.6) / 0.79)
    assert found.quality["torso_amplitude"] == pytest.approx(0.79)


def test_frequency_is_the_highest_peak_without_any_band():
    assert extracted(spectrum(f_1_75=3.0, f_0_25=5.0)).gait_frequency_hz == 0.25
    assert extracted(spectrum(f_1_75=3.0, f_12_5=5.0)).gait_frequency_hz == 12.5


def test_bandwidth_is_from_the_first_to_the_last_crossing():
    level = mean_spectrum()
    level[20] = 0.04 * 0.79 * 1.001
    level[90] = 0.04 * 0.79 * 0.999
    # from bin 20 to bin 60, across the gap; bin 90 is below the threshold
    assert bandwidth_hz(level, DOPPLER_HZ, 0.04) == pytest.approx(40 * 1000 / 101)


def test_no_peak_gives_no_frequency():
    falling = make_array(CADENCE_SPECTRUM, np.linspace(1, 0, CADENCE_HZ.size), {"cadence": CADENCE_HZ})
    found = extracted(Signal.of(falling, CADENCE_SPECTRUM))
    assert found.gait_frequency_hz is None
    assert found.features.step_length_m is None
    assert found.features.torso_velocity_mps is not None


@pytest.fixture(scope="module")
def recording():
    scene = Scene([Target(boulic_walk(speed_mps=1.2, height_m=1.8, duration_s=3.0), label="human")])
    return simulate(scene, Radar.preset("x4"))


def test_chain_has_the_choices_of_the_report(recording):
    result = analyze(recording, gate="truth", analysis=Analysis(method="liland2018"))[0]
    assert result.signature.shape == (3000, 101)  # hop 1, zero padding at the ends, K = M
    np.testing.assert_allclose(result.normalised_signature.values.max(axis=1), 1.0)
    cadence_hz = result.cadence_spectrum.coords["cadence"].values
    assert cadence_hz[1] == pytest.approx(1 / 3.0)
    d_g = result.cadence_map.values.sum(axis=1)
    np.testing.assert_allclose(result.cadence_spectrum.values, d_g, rtol=1e-12)
    # mu_0: the mean of every row is removed
    assert result.cadence_map.values[0].max() < 1e-12
    bin_error = abs(result.gait_frequency_hz - recording.truth[0].gait_frequency_hz)
    assert bin_error <= 0.5 / 3.0 + 1e-9
    torso_mps = recording.truth[0].centre_velocity_mps.mean()
    assert abs(result.features.torso_velocity_mps - torso_mps) <= 0.204 * 2


def test_gates_leak_the_label_and_the_truth_as_in_the_report(recording):
    result = analyze(recording, gate="truth", analysis=Analysis(method="liland2018"))[0]
    doppler_hz = recording.truth[0].doppler_hz(WAVELENGTH_M)
    assert result.gate.span_m == 1.0  # 1.5 for a dog
    assert result.gate.doppler_hz == pytest.approx((doppler_hz.min(), doppler_hz.max()))
    outside = result.signature.coords["doppler"].values > doppler_hz.max()
    assert not result.signature.values[:, outside].any()
    assert '"truth"' in result.signature.attrs["gate"]
    dog = simulate(Scene([Target(boulic_walk(speed_mps=1.2, duration_s=0.5), label="dog")]), Radar.preset("x4"))
    assert analyze(dog, gate="truth", analysis=Analysis(method="liland2018"))[0].gate.span_m == 1.5
    assert analyze(dog, gate="truth")[0].gate.span_m == 1.6


def test_ratio_grows_with_the_number_of_doppler_bins_as_found_e38(recording):
    ratios = {
        k: analyze(recording, gate="truth", analysis=Analysis(method="liland2018", doppler_bins=k, hop=5))[0]
        for k in (101, 512)
    }
    values = {k: r.features.limb_torso_ratio for k, r in ratios.items()}
    assert values[512] / values[101] == pytest.approx(512 / 101, rel=0.15)
