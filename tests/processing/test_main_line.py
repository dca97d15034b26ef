"""Main line, alignment, track and torso (E-29, E-34, E-34c)."""

from itertools import product

import numpy as np
import pytest

from doppelgait._core import native
from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import SIGNATURE, Signal, make_array
from doppelgait.processing import align, choose_line_order, main_line_hz, needs_alignment
from doppelgait.processing.main_line import choose_velocity, torso_velocity_mps, track_velocity

K, PRF_HZ = 128, 1000.0
DOPPLER_HZ = (np.arange(K) - K // 2) * PRF_HZ / K


def line_signature(line_hz, spread_hz=6.0, hop_s=0.008):
    """A Gaussian ridge of 6 Hz standard deviation (power of the E-23 window) along a line."""
    line_hz = np.asarray(line_hz, dtype=float)
    distance = (DOPPLER_HZ[None, :] - line_hz[:, None] + PRF_HZ / 2) % PRF_HZ - PRF_HZ / 2
    coords = {"doppler": DOPPLER_HZ, "velocity": ("doppler", DOPPLER_HZ * 0.02)}
    coords["time"] = 0.05 + hop_s * np.arange(line_hz.size)
    return make_array(SIGNATURE, np.exp(-0.5 * (distance / spread_hz) ** 2), coords, {"n_gate_bins": 8})


POSITION = np.linspace(-1, 1, 375)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_line_follows_a_polynomial_below_a_tenth_of_a_bin(order):
    wanted = np.polynomial.polynomial.polyval(POSITION, [60.3, 12.0, -9.0, 7.0][: order + 1])
    found = main_line_hz(line_signature(wanted), order=order)
    assert np.abs(found - wanted).max() < 0.1 * PRF_HZ / K


def test_line_is_robust_against_columns_in_which_a_leg_is_strongest():
    wanted = 60 + 5 * POSITION
    disturbed = wanted.copy()
    disturbed[::5] = 180.0  # swinging leg, a fifth of all columns
    disturbed[2::7] = 0.0  # standing foot, a seventh
    found = main_line_hz(line_signature(disturbed), order=1)
    assert np.abs(found - wanted).max() < 2.0


def test_the_time_taper_lessens_the_bias_of_steps_that_are_cut_off_e34():
    t = 0.008 * np.arange(300)
    errors = {tapered: [] for tapered in (False, True)}
    for phase in np.arange(0, 2 * np.pi, 0.5):
        mu = line_signature(60 + 5 * np.sin(2 * np.pi * 1.05 * t + phase))  # 2.5 periods
        for tapered in errors:
            errors[tapered].append(main_line_hz(mu, order=1, tapered=tapered).mean() - 60)
    rms = {tapered: np.sqrt(np.mean(np.square(e))) for tapered, e in errors.items()}
    assert rms[True] < 0.7 * rms[False]


@pytest.mark.parametrize(("seconds", "order"), [(1.0, 1), (1.29, 1), (1.31, 2), (2.49, 2), (2.51, 3), (10, 3)])
def test_order_of_the_line_e29(seconds, order):
    assert choose_line_order(seconds) == order


def test_alignment_is_for_drifts_above_10_hz_e29():
    assert not needs_alignment(line_signature(60 + 4.5 * POSITION))
    assert needs_alignment(line_signature(60 + 5.5 * POSITION))
    assert needs_alignment(line_signature(60 - 5.5 * POSITION))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_alignment_by_parts_of_bins_is_cubic_convolution_on_a_circle_e29(dtype):
    bin_hz = PRF_HZ / K
    line_hz = np.array([0.0, 5.0, -0.25, 5.5, -70.9, 63.999, 127.5, 300.0]) * bin_hz
    mu = line_signature(np.zeros(8))
    mu = mu.copy(data=np.random.default_rng(1).random(mu.shape).astype(dtype))
    found = align(mu, line_hz).values
    for j, shift in enumerate(line_hz / bin_hz):
        far = np.abs(np.arange(K)[:, None] + shift - np.arange(K))
        far = np.minimum(far % K, -far % K)  # on the circle
        near = np.where(far < 1, 1.5 * far**3 - 2.5 * far**2 + 1, -0.5 * far**3 + 2.5 * far**2 - 4 * far + 2)
        wanted = np.where(far < 2, near, 0.0) @ mu.values[j].astype(np.float64)
        np.testing.assert_allclose(found[j], wanted, atol=1e-11)
    np.testing.assert_allclose(found.sum(axis=1), mu.values.sum(axis=1, dtype=np.float64), rtol=1e-9)


def test_a_line_through_fewer_columns_than_its_order_goes_through_all_of_them():
    mu = line_signature([10.0, 40.0])
    np.testing.assert_allclose(main_line_hz(mu, order=3), main_line_hz(mu, order=1), atol=1e-9)


def test_a_line_goes_through_the_columns_of_one_body():
    wanted_hz, sides = 40.0 + 0.1 * np.arange(200), np.where(np.arange(200) // 60 == 1, 3, 0)
    mu = line_signature(np.where(sides == 3, -90.0, wanted_hz)).assign_coords(other_sides=("time", sides))
    for order, tapered in ((1, False), (1, True), (3, False)):
        np.testing.assert_allclose(main_line_hz(mu, order=order, tapered=tapered), wanted_hz, atol=1.0)


def test_a_line_of_another_length_is_refused():
    mu = line_signature(np.full(50, 20.0))
    for size in (10, mu.sizes["time"] + 1):
        with pytest.raises(AnalysisError, match=rf"line_hz has shape \({size},\)"):
            align(mu, np.zeros(size))


def test_track_velocity_is_the_slope_and_the_way_over_the_time_e34():
    time_s = np.arange(400) * 0.0125
    range_m = np.hypot(6.0 - 1.3 * time_s, 2.0)
    found = track_velocity(time_s, range_m)
    assert found.line_mps.mean() == pytest.approx(-np.polyfit(time_s, range_m, 1)[0], rel=1e-3)
    assert found.mean_mps == pytest.approx((range_m[0] - range_m[-1]) / np.ptp(time_s), rel=0.01)
    assert found.mean_mps == pytest.approx(found.line_mps.mean() + found.bend_mps)
    assert abs(found.bend_mps) > 0.03
    steady = track_velocity(time_s, 9.0 - 1.2 * time_s + 0.05 * time_s**2)
    np.testing.assert_allclose(steady.line_mps, 1.2 - 0.1 * time_s)
    assert steady.bend_mps == pytest.approx(0.0, abs=1e-12)


def lines(time_s, velocities_mps, powers, k=128, prf_hz=500.0):
    """Gaussian lines of 8 Hz, carrier of 2 cm half a wavelength, gate at the first velocity's range."""
    doppler_hz = np.fft.fftshift(np.fft.fftfreq(k, 1 / prf_hz))
    values = sum(
        p * np.exp(-0.5 * ((doppler_hz - np.broadcast_to(v, time_s.shape)[:, None] / 0.02) / 8.0) ** 2)
        for v, p in zip(velocities_mps, powers, strict=True)
    )
    coords = {"time": time_s, "doppler": doppler_hz, "velocity": ("doppler", 0.02 * doppler_hz)}
    coords["centre_range"] = ("time", 8.0 - np.cumsum(np.broadcast_to(velocities_mps[0], time_s.shape)) * 0.01)
    return make_array(SIGNATURE, values, coords, {"n_gate_bins": 8, "wavelength_m": 0.04})


@pytest.mark.parametrize(
    ("line_mps", "track_mps", "trunk", "wanted_mps", "agreed"),
    [
        (1.0, 1.02, 0.3, 1.0, True),  # they agree
        (0.5, 1.0, 0.3, 1.0, True),  # the trunk is there, weaker than a limb
        (0.5, 2.0, 0.01, 0.5, False),  # nothing on the track
        (0.5, 4.6, 0.3, 0.5, True),  # near half the pulse rate: it may be folded
    ],
)
def test_track_settles_what_the_main_line_is_e34(line_mps, track_mps, trunk, wanted_mps, agreed):
    time_s = np.arange(300) * 0.01
    mu = lines(time_s, [line_mps, track_mps], [1.0, trunk])
    lines_hz = np.full(300, line_mps / 0.02), np.full(300, track_mps / 0.02)
    found, same = choose_velocity(Signal.of(mu, SIGNATURE), 0.0, mu.values.max(axis=1), *lines_hz)
    assert found.mean() * 0.02 == pytest.approx(wanted_mps)
    assert same == agreed
    slow = Signal.of(lines(time_s, [-0.15, 0.15], [1.0, 0.3], prf_hz=19.0), SIGNATURE)  # all bins are near
    assert choose_velocity(slow, 0.0, slow.values.max(axis=1), np.full(300, -7.5), np.full(300, 7.5))[1]


def test_torso_is_followed_under_a_stronger_limb_e34c():
    time_s = np.arange(400) * 0.01
    torso = 1.0 + 0.2 * np.sin(2 * np.pi * 0.7 * time_s)
    limb = 1.0 + 2.0 * np.sin(2 * np.pi * 1.4 * time_s)  # crosses the torso, and is stronger
    mu = lines(time_s, [torso, limb], [1.0, 3.0])
    found = torso_velocity_mps(Signal.of(mu, SIGNATURE), 1e-3, np.full(400, 50.0))
    far = np.abs(limb - torso) > 1.0
    assert np.abs(found - torso)[far].max() < 0.12
    assert found.mean() == pytest.approx(1.0, abs=0.03)


def test_ridge_is_the_best_of_all_paths_e34c():
    rng = np.random.default_rng(2)
    for _ in range(5):
        values, line = rng.exponential(1.0, (6, 16)), np.full(6, 3.0)
        found = np.empty(6, np.int64)
        native.follow_ridge(values, 0.05, line, 2, 0.7, found)
        logs = np.log(np.maximum(values, 0.05))
        paths = [p for p in product(range(1, 6), repeat=6) if np.abs(np.diff(p)).max() <= 1]
        scores = [logs[np.arange(6), p].sum() - 0.7 * (np.diff(p) ** 2).sum() for p in map(np.array, paths)]
        np.testing.assert_array_equal(found, paths[int(np.argmax(scores))])
