"""The filter of range and velocity against matrices and the moments of samples."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import multivariate_normal

from doppelgait.processing.track import kalman
from doppelgait.processing.track.kalman import Gaussian

Q, DT, RANGE_SD, VELOCITY_SD = 0.75, 0.1, 0.08, 0.2
START = Gaussian(5.0, 1.2, 0.04, -0.01, 0.09)


def van_loan(drift: np.ndarray, diffusion: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition and noise covariance of dx = A x dt + noise of density D (Van Loan 1978)."""
    n = len(drift)
    block = np.block([[-drift, diffusion], [np.zeros((n, n)), drift.T]]) * dt
    power = expm(block)
    transition = power[n:, n:].T
    return transition, transition @ power[:n, n:]


def matrices(model: kalman.Model) -> tuple[np.ndarray, np.ndarray]:
    transition = np.array([[1.0, -model.carry_s], [0.0, model.keep]])
    return transition, np.array([[model.range_m2, model.cross_m2ps], [model.cross_m2ps, model.velocity_m2ps2]])


@pytest.mark.parametrize("dt", [0.02, 0.1, 0.7])
def test_constant_velocity_is_the_sampled_white_acceleration(dt: float) -> None:
    transition, noise = van_loan(np.array([[0.0, -1.0], [0.0, 0.0]]), np.diag([0.0, Q]), dt)
    got = matrices(kalman.make_constant_velocity_model(dt, acceleration_noise_m2ps3=Q))
    np.testing.assert_allclose(got[0], transition, rtol=1e-12)
    np.testing.assert_allclose(got[1], noise, rtol=1e-9)


@pytest.mark.parametrize("dt", [0.02, 0.1, 2.0])
def test_rest_is_the_sampled_ornstein_uhlenbeck_process(dt: float) -> None:
    tau, sd = 0.3, 0.4
    transition, noise = van_loan(np.array([[0.0, -1.0], [0.0, -1 / tau]]), np.diag([0.0, 2 * sd**2 / tau]), dt)
    got = matrices(kalman.make_resting_model(dt, time_constant_s=tau, velocity_sd_mps=sd))
    np.testing.assert_allclose(got[0], transition, rtol=1e-10)
    np.testing.assert_allclose(got[1], noise, rtol=1e-6)


def test_steps_equal_the_matrix_form() -> None:
    model = kalman.make_constant_velocity_model(DT, acceleration_noise_m2ps3=Q)
    transition, noise = matrices(model)
    predicted = kalman.predict(START, model)
    mean, cov = transition @ np.array(START[:2]), transition @ kalman.make_covariance(START) @ transition.T + noise
    np.testing.assert_allclose(predicted[:2], mean)
    np.testing.assert_allclose(kalman.make_covariance(predicted), cov)
    z, r = np.array([4.8, 1.5]), np.diag([RANGE_SD**2, VELOCITY_SD**2])
    seen = kalman.compute_innovation(
        predicted, range_m=4.8, velocity_mps=1.5, range_sd_m=RANGE_SD, velocity_sd_mps=VELOCITY_SD
    )
    s = cov + r
    assert seen.nis == pytest.approx((z - mean) @ np.linalg.solve(s, z - mean))
    assert seen.log_likelihood == pytest.approx(multivariate_normal(mean, s).logpdf(z))
    gain = cov @ np.linalg.inv(s)
    joseph = (np.eye(2) - gain) @ cov @ (np.eye(2) - gain).T + gain @ r @ gain.T
    updated = kalman.update(predicted, seen)
    np.testing.assert_allclose(updated[:2], mean + gain @ (z - mean))
    np.testing.assert_allclose(kalman.make_covariance(updated), joseph)


def test_folded_velocity_is_taken_at_its_nearest() -> None:
    seen = kalman.compute_innovation(
        START._replace(velocity_mps=5.0), range_m=5, velocity_mps=-1.1, range_sd_m=1, velocity_sd_mps=1,
        velocity_span_mps=6.0,
    )  # fmt: skip
    assert seen.velocity_mps == pytest.approx(-0.1)


def test_mixture_has_the_moments_of_its_samples() -> None:
    rng = np.random.default_rng(1)
    states, weights = [START, Gaussian(5.6, 0.2, 0.02, 0.005, 0.2)], [0.3, 0.7]
    n = 400_000
    draws = np.concatenate([
        rng.multivariate_normal(s[:2], kalman.make_covariance(s), size=round(w * n))
        for s, w in zip(states, weights, strict=True)
    ])  # fmt: skip
    got = kalman.merge_mixture(states, weights)
    np.testing.assert_allclose(got[:2], draws.mean(axis=0), atol=3e-3)
    np.testing.assert_allclose(kalman.make_covariance(got), np.cov(draws.T), atol=3e-3)


def test_smoother_is_the_least_squares_solution() -> None:
    """Smoothed means and covariances equal those of one large linear problem over all states (information form)."""
    n = 12
    rng = np.random.default_rng(3)
    model = kalman.make_constant_velocity_model(DT, acceleration_noise_m2ps3=Q)
    transition, noise = matrices(model)
    truth = rng.multivariate_normal(START[:2], kalman.make_covariance(START))
    filtered, predicted = [START], [START]
    for _ in range(n - 1):
        truth = transition @ truth + rng.multivariate_normal([0, 0], noise)
        z = truth + rng.standard_normal(2) * [RANGE_SD, VELOCITY_SD]
        before = kalman.predict(filtered[-1], model)
        seen = kalman.compute_innovation(
            before, range_m=z[0], velocity_mps=z[1], range_sd_m=RANGE_SD, velocity_sd_mps=VELOCITY_SD
        )
        predicted.append(before)
        filtered.append(kalman.update(before, seen))
    information, vector = np.zeros((2 * n, 2 * n)), np.zeros(2 * n)
    prior = np.linalg.inv(kalman.make_covariance(START))
    information[:2, :2] += prior
    vector[:2] += prior @ np.array(START[:2])
    for t in range(1, n):
        link = np.hstack([-transition, np.eye(2)])
        part = slice(2 * t - 2, 2 * t + 2)
        information[part, part] += link.T @ np.linalg.inv(noise) @ link
        own = slice(2 * t, 2 * t + 2)
        # what the update added to the information of the prediction
        after, before = (np.linalg.inv(kalman.make_covariance(s[t])) for s in (filtered, predicted))
        information[own, own] += after - before
        vector[own] += after @ np.array(filtered[t][:2]) - before @ np.array(predicted[t][:2])
    means, covs = np.linalg.solve(information, vector), np.linalg.inv(information)
    for t, state in enumerate(kalman.smooth(filtered, predicted, [model] * n)):
        np.testing.assert_allclose(state[:2], means[2 * t : 2 * t + 2], rtol=1e-6)
        np.testing.assert_allclose(kalman.make_covariance(state), covs[2 * t : 2 * t + 2, 2 * t : 2 * t + 2], rtol=1e-5)
