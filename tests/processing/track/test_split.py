"""Two bodies in one track."""

import numpy as np
import pytest

from doppelgait.core.frames import Frames
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.processing.track import Track, split_tracks

WAVELENGTH_M, PRF_HZ, BIN_M, PULSE_M = 0.0411, 500.0, 0.05, 0.11
TIMES_S = np.arange(0.1, 4.0, 0.1)


def echoes(*ways, seconds=4.1, noise=0.0):
    """Sum Gaussian echoes: (start range, speed, amplitude, swing speed) each, the last for a limb."""
    slow_s = np.arange(round(seconds * PRF_HZ)) / PRF_HZ
    range_m = 1.0 + BIN_M * np.arange(180)
    data = np.zeros((slow_s.size, range_m.size), dtype=np.complex128)
    for start_m, speed_mps, amplitude, swing_mps in ways:
        swing_m = swing_mps / (2 * np.pi * 1.8) * np.sin(2 * np.pi * 1.8 * slow_s)
        place_m = start_m - speed_mps * slow_s + swing_m
        pulse = np.exp(-(((range_m - place_m[:, None]) / PULSE_M) ** 2))
        data += amplitude * pulse * np.exp(-4j * np.pi * place_m / WAVELENGTH_M)[:, None]
    rng = np.random.default_rng(1)
    data += noise * (rng.standard_normal(data.shape) + 1j * rng.standard_normal(data.shape)) / np.sqrt(2)
    return make_array(BASEBAND, data.astype(np.complex64), {"slow_time": slow_s, "range": range_m}, {"units": "V"})


def track_of(start_m, speed_mps, times_s=TIMES_S):
    centre_m, same = start_m - speed_mps * times_s, np.full(times_s.size, speed_mps)
    width, yes = np.full(times_s.size, 0.1), np.ones(times_s.size, dtype=bool)
    return Track(
        times_s=times_s, range_m=centre_m, velocity_mps=same, range_sd_m=width, velocity_sd_mps=width, measured=yes,
        shared=~yes, range_low_m=centre_m - 0.5, range_high_m=centre_m + 0.5, velocity_low_mps=same - 1,
        velocity_high_mps=same + 1, confirmed_at_s=float(times_s[3]), mean_nis=2.0, mean_power_v2=1.0,
    )  # fmt: skip


def divided(clean, *tracks):
    return split_tracks(tracks, Frames.of(clean), wavelength_m=WAVELENGTH_M, cpi_s=0.1)


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize("apart_m", [0.7, 0.85, 1.1])
def test_who_follows_has_a_track_of_its_own(apart_m, noise):
    clean = echoes((7.0, 1.2, 1.0, 0.0), (7.0 + apart_m, 1.2, 0.6, 0.0), noise=noise)
    near, far = divided(clean, track_of(7.0 + apart_m / 2, 1.2))
    for one, start_m in ((near, 7.0), (far, 7.0 + apart_m)):
        assert one.range_m == pytest.approx(start_m - 1.2 * one.times_s, abs=0.06)
        assert one.velocity_mps == pytest.approx(1.2)
    assert far.last_s - far.first_s > 3.0


@pytest.mark.parametrize(
    "others",
    [
        (),
        ((7.45, 1.2, 0.7, 0.0),),  # chest and rump
        ((7.1, 1.2, 0.7, 2.5), (6.9, 1.2, 0.7, -2.5)),  # legs
        ((8.0, 1.2, 0.1, 0.0),),  # 20 dB below
        ((7.9, -1.2, 0.8, 0.0),),  # goes the other way
    ],
)
def test_one_body_stays_one(others):
    (one,) = divided(echoes((7.0, 1.2, 1.0, 0.0), *others, noise=0.02), track_of(7.0, 1.2))
    assert np.array_equal(one.range_m, track_of(7.0, 1.2).range_m)


def test_who_stands_beside_a_slow_body_is_not_followed():
    (one,) = divided(echoes((5.0, 0.2, 1.0, 0.0), (5.9, 0.2, 1.0, 0.0)), track_of(5.0, 0.2))
    assert np.array_equal(one.range_m, track_of(5.0, 0.2).range_m)


def test_an_echo_that_has_a_track_is_not_split_again():
    clean = echoes((7.0, 1.2, 1.0, 0.0), (8.0, 1.2, 0.6, 0.0))
    assert len(divided(clean, track_of(7.0, 1.2), track_of(8.0, 1.2))) == 2


def test_a_second_echo_is_joined_to_the_track_that_continues_it():
    clean = echoes((7.0, 1.2, 1.0, 0.0), (8.0, 1.2, 0.6, 0.0))
    late = track_of(8.0, 1.2, TIMES_S[TIMES_S > 2.9])
    near, far = divided(clean, track_of(7.0, 1.2), late)
    assert far.first_s < 0.3
    assert far.last_s == late.last_s
    assert (np.diff(far.times_s) > 0.05).all()
    assert far.range_m == pytest.approx(8.0 - 1.2 * far.times_s, abs=0.06)
    assert near.range_m == pytest.approx(7.0 - 1.2 * near.times_s, abs=0.06)
