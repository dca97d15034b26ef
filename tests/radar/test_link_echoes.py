"""What a frame's integration and the pulse repetition do to echoes, against closed forms and sums over pulses."""

import numpy as np
import pytest

from doppelgait.core.rng import rng
from doppelgait.motion import make_motion
from doppelgait.pipeline import Conditions, simulate
from doppelgait.radar import Radar, synthesise
from doppelgait.radar.link import fold_scatterers, noise_power_v2
from doppelgait.scene import Scene, Target
from doppelgait_conformance.radars import change_radar, make_table

C = 299_792_458.0
X4 = Radar.preset("x4")
PULSE_M = C / 2 / 15.1875e6
"""From one pulse of the X4 to the next."""


def test_noise_of_a_cw_radar_belongs_to_the_same_integration():
    plain = Radar.preset("xband-cw", integration_share=0.0)
    half = Radar.preset("xband-cw", integration_share=0.5)
    assert noise_power_v2(half) == pytest.approx(2 * noise_power_v2(plain))  # 1 / T_i in place of f_p


def pulse_train(radar, range_m):
    """Baseband of a point of 1 m^2 in the steady state: the sum over all pulses that ever left."""
    axis_m, wavelength_m = radar.range_axis_m(), C / radar.carrier_hz
    spread_m, pulse_m = radar.sigma_s * C / 2, C / 2 / radar.pulse_rate_hz
    level_db = radar.tx_power_dbm + radar.tx_gain_dbi + radar.rx_gain_dbi + radar.receiver_gain_db
    peak_v = np.sqrt(0.1 * 10 ** (level_db / 10) / (4 * np.pi) ** 3) * wavelength_m / max(range_m, 0.2) ** 2
    envelope = sum(np.exp(-((axis_m - range_m + k * pulse_m) ** 2) / (2 * spread_m**2)) for k in range(-6, 7))
    return peak_v * envelope * np.exp(1j * (radar.transmit_phase_rad - 4 * np.pi * range_m / wavelength_m))


@pytest.mark.parametrize("change", [{}, {"carrier_hz": 7.3e9}, {"range_start_m": 4.0, "range_stop_m": 13.5}])
@pytest.mark.parametrize(
    "range_m", [0.02, 0.3, 2.1, 9.55, 9.7, 9.8, 9.86, 9.87, 9.9, 10.1, 12.0, 19.7, 25.0, 43.3]
)  # fmt: skip
def test_an_echo_is_that_of_all_pulses_that_ever_left(change, range_m):
    radar = Radar.preset("x4", **change)
    found = synthesise(make_table([range_m]), radar).values[0]
    wanted = pulse_train(radar, range_m)
    assert np.abs(found - wanted).max() < 2e-6 * np.abs(wanted).max() + 1e-6 * np.abs(pulse_train(radar, 43.3)).max()


def test_reflections_beyond_the_next_pulse_fold_and_truth_does_not():
    """A body 8 m away, a wall 4 m to the side: its mirror image is 11.3 m away and appears at 1.44 m."""
    still = make_motion(np.tile([0.0, 0.0, 1.0], (20, 1, 1)), rate_hz=100, markers=["a"], parts=["torso"])
    scene = Scene([Target(still, range_m=8.0)], duration_s=0.1)
    wall = {"kind": "wall_ghost", "material": "concrete", "thickness_m": 0.2, "side_m": 4.0}
    conditions = Conditions(environment=[wall])
    for radar in (X4, change_radar(X4, fold_echoes=False)):
        recording = simulate(scene, radar, conditions=conditions, rng=rng(0), snr_db=np.inf)
        level = np.abs(recording.baseband.values[50])
        near = recording.range_m < 3.0
        assert bool(level[near].max() > 0) is radar.fold_echoes
        if radar.fold_echoes:
            assert recording.range_m[near][level[near].argmax()] == pytest.approx(np.hypot(8, 8) - PULSE_M, abs=0.03)
        assert recording.truth[0].centre_range_m == pytest.approx(8.0, abs=0.01)


def test_what_does_not_fold_is_not_touched():
    near = make_table(np.full((5, 3), [2.0, 5.0, 9.0]))
    far = make_table([[2.0, 12.0]], path_phase=0.3)
    assert fold_scatterers(near, X4) is near
    for radar in (Radar.preset("x4-long"), Radar.preset("liland2018"), Radar.preset("xband-cw"), Radar.preset("ti-77")):
        assert fold_scatterers(far, radar) is far
    folded = fold_scatterers(far, X4)
    assert folded["range"].values[0] == pytest.approx([2.0, 12.0 - PULSE_M])
    assert np.array_equal(folded["radial_velocity"], far["radial_velocity"])
    # 480 wavelengths of the carrier from pulse to pulse, and back
    assert np.mod(folded["path_phase"].values[0], 2 * np.pi) == pytest.approx([0.3, 0.3], abs=1e-6)


def test_a_frame_may_be_as_long_as_the_pulse_interval():
    assert Radar.preset("x4", range_stop_m=12.0, fold_echoes=False).n_range_bins == 234
    assert Radar.preset("x4", decimation=1, range_stop_m=1536 * 1.5e8 / 23.328e9).n_range_bins == 1538  # a whole frame
    assert Radar.preset("x4", range_start_m=5.0, range_stop_m=14.8).n_range_bins > 180  # a frame that starts later
