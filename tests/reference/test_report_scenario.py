"""The report, chapter 4: a Boulic/Chen person walks at the radar; f_p = 1000 Hz, T_d = 0.1 s, sigma_w = 0.4."""

import numpy as np
import pytest

from doppelgait.motion import boulic_walk
from doppelgait.pipeline import analyze, simulate
from doppelgait.processing import Analysis
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target


@pytest.fixture(scope="module")
def recording():
    # 1.8 m and q = 2: the walk whose ankle the report shows at about 300 Hz (its Fig. 2.16)
    walk = boulic_walk(speed_mps=2 * 0.491 * 1.8, height_m=1.8, duration_s=5.0, form="chen2011")
    return simulate(Scene([Target(walk, label="human")]), Radar.preset("x4-long"))


@pytest.fixture(scope="module")
def result(recording):
    analysis = Analysis(cpi_s=0.1, window_steepness=0.4, bandwidth_threshold=0.04)
    return analyze(recording, gate="truth", analysis=analysis)[0]


def test_the_ankle_peaks_near_300_hz(recording):
    truth = recording.truth[0]
    ankle = truth.scatterers.coords["marker"].values == "right_ankle"
    assert truth.doppler_hz(recording.radar.wavelength_m)[:, ankle].max() == pytest.approx(300, abs=5)


def test_the_six_features_stand_beside_their_truth(recording, result):
    truth = recording.truth[0]
    features = result.features
    span_hz = np.ptp(truth.doppler_hz(recording.radar.wavelength_m))
    assert result.gait_frequency_hz == pytest.approx(truth.gait_frequency_hz, rel=0.01)
    assert features.torso_velocity_mps == pytest.approx(truth.centre_velocity_mps.mean(), rel=0.04)
    assert features.step_length_m == pytest.approx(truth.centre_velocity_mps.mean() / truth.gait_frequency_hz, rel=0.04)
    assert 0.85 * span_hz < result.extended["doppler_bandwidth_envelope_hz"] < 1.05 * span_hz
    assert 0.5 * span_hz < features.doppler_bandwidth_hz < 0.7 * span_hz  # what is there for 5 % of the time
    assert features.harmonic_ratio_2 == pytest.approx(2, abs=0.03)
    assert features.harmonic_ratio_3 == pytest.approx(3, abs=0.05)
    assert features.limb_torso_ratio > 0.3
    assert result.flags == ()


def test_ten_steps_in_five_gait_cycles(recording, result):
    truth = recording.truth[0]
    five_cycles_s = 5 / truth.stride_frequency_hz
    assert result.gait_frequency_hz * five_cycles_s == pytest.approx(10, abs=0.1)
