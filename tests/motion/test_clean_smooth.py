"""How much the low-pass takes from the fastest points, against the unfiltered model."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from doppelgait.motion.clean import choose_cutoff_hz, filter_lowpass
from doppelgait.motion.models import boulic_walk

RATE_HZ = 250.0


def peak_speed_mps(path: np.ndarray) -> float:
    time = np.arange(len(path)) / RATE_HZ
    inner = np.arange(250, len(path) - 250, 0.25) / RATE_HZ
    return float(np.linalg.norm(CubicSpline(time, path)(inner, 1), axis=1).max())


@pytest.mark.parametrize("frequency_hz", [3.0, 8.0, 12.0, 16.0, 40.0])
def test_speed_of_an_oscillation_is_lowered_by_the_known_gain(frequency_hz: float) -> None:
    """Two fourth-order passes that leave half the power at the cutoff: gain 1 / (1 + (sqrt(2) - 1) (tan / tan)^8)."""
    time = np.arange(2000) / RATE_HZ
    path = np.zeros((2000, 3))
    path[:, 0] = 0.1 * np.sin(2 * np.pi * frequency_hz * time)
    smooth = filter_lowpass(path[:, np.newaxis], rate_hz=RATE_HZ, cutoff_hz=12.0)[:, 0]
    ratio = np.tan(np.pi * frequency_hz / RATE_HZ) / np.tan(np.pi * 12.0 / RATE_HZ)
    gain = 1.0 / (1.0 + (np.sqrt(2.0) - 1.0) * ratio**8)
    assert peak_speed_mps(smooth) / peak_speed_mps(path) == pytest.approx(gain, rel=2e-3)
    np.testing.assert_allclose(smooth[200:-200], gain * path[200:-200], atol=2e-4)  # without delay


def test_three_frames_per_period_are_needed() -> None:
    for rate_hz, cutoff_hz, chosen_hz in ((36.0, 12.0, 12.0), (35.9, 12.0, None), (100.0, None, None)):
        assert choose_cutoff_hz(0.0, rate_hz=rate_hz, cutoff_hz=cutoff_hz) == chosen_hz


@pytest.mark.parametrize("rate_hz", [60.0, 120.0])
@pytest.mark.parametrize("frame", [2, -2, 15, -15])
def test_a_jump_near_an_end_stays_where_it_is(rate_hz, frame):
    """The continuation of the ends must not grow: a step of 0.7 m may ring, not leave the room."""
    t = np.arange(0, 3, 1 / rate_hz)
    path = np.stack([1.2 * t, 0.2 * np.sin(2 * np.pi * t), 1 + 0 * t], axis=-1)[:, None]
    path[frame if frame < 0 else slice(0, frame), :, :] += 0.7
    smooth = filter_lowpass(path, rate_hz=rate_hz, cutoff_hz=12.0)
    assert np.abs(smooth - path).max() < 0.7


def test_coordinates_beyond_reason_are_refused():
    from doppelgait.core.errors import MotionError
    from doppelgait.motion.clean import clean_motion

    walk = boulic_walk(duration_s=2.0)
    with pytest.raises(MotionError, match=r"a coordinate is 1e\+30 m, but at most 10000 m"):
        clean_motion(walk.with_positions(np.where(walk.position_m > 1.0, 1e30, walk.position_m)))
