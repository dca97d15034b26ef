"""Kalman filter and smoother of range and radial velocity.

The matrix products are written out for two states. A body at range R has the radial velocity v,
positive when approaching, with dR/dt = -v. A detection measures both with independent errors, so
the measurement matrix is the identity.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


class Gaussian(NamedTuple):
    """Mean and covariance of range and radial velocity."""

    range_m: float
    velocity_mps: float
    range_m2: float
    cross_m2ps: float
    velocity_m2ps2: float


class Model(NamedTuple):
    """Motion model over one interval."""

    # R becomes R - carry_s v, v becomes keep v, and the process noise is added
    carry_s: float
    keep: float
    range_m2: float
    cross_m2ps: float
    velocity_m2ps2: float


class Innovation(NamedTuple):
    """Difference of measurement and prediction, its covariance, NIS and log density."""

    range_m: float
    velocity_mps: float
    range_m2: float
    cross_m2ps: float
    velocity_m2ps2: float
    nis: float
    log_likelihood: float


def make_constant_velocity_model(interval_s: float, *, acceleration_noise_m2ps3: float) -> Model:
    """Build a constant-velocity model with white acceleration of spectral density q."""
    # Bar-Shalom, Li, Kirubarajan, Estimation with Applications, 6.2.2; minus since dR/dt = -v
    q, dt = acceleration_noise_m2ps3, interval_s
    return Model(dt, 1.0, q * dt**3 / 3, -q * dt**2 / 2, q * dt)


def make_resting_model(interval_s: float, *, time_constant_s: float, velocity_sd_mps: float) -> Model:
    """Build the model of a resting body: its velocity is an Ornstein-Uhlenbeck process."""
    tau, variance = time_constant_s, velocity_sd_mps**2
    keep = math.exp(-interval_s / tau)
    range_m2 = variance * tau**2 * (2 * interval_s / tau - 3 + 4 * keep - keep**2)
    return Model(tau * (1 - keep), keep, range_m2, -variance * tau * (1 - keep) ** 2, variance * (1 - keep**2))


def predict(state: Gaussian, model: Model) -> Gaussian:
    """Predict: F x and F P F' + Q with F = [[1, -carry], [0, keep]]."""
    carry, keep = model.carry_s, model.keep
    return Gaussian(
        state.range_m - carry * state.velocity_mps,
        keep * state.velocity_mps,
        state.range_m2 - 2 * carry * state.cross_m2ps + carry**2 * state.velocity_m2ps2 + model.range_m2,
        keep * (state.cross_m2ps - carry * state.velocity_m2ps2) + model.cross_m2ps,
        keep**2 * state.velocity_m2ps2 + model.velocity_m2ps2,
    )


def compute_innovation(
    predicted: Gaussian,
    *,
    range_m: float,
    velocity_mps: float,
    range_sd_m: float,
    velocity_sd_mps: float,
    velocity_span_mps: float | None = None,
) -> Innovation:
    """Compare a measurement with the prediction."""
    y_r, y_v = range_m - predicted.range_m, velocity_mps - predicted.velocity_mps
    if velocity_span_mps is not None:
        y_v -= velocity_span_mps * round(y_v / velocity_span_mps)
    s_rr, s_rv = predicted.range_m2 + range_sd_m**2, predicted.cross_m2ps
    s_vv = predicted.velocity_m2ps2 + velocity_sd_mps**2
    determinant = s_rr * s_vv - s_rv**2
    nis = (y_r**2 * s_vv - 2 * y_r * y_v * s_rv + y_v**2 * s_rr) / determinant
    return Innovation(y_r, y_v, s_rr, s_rv, s_vv, nis, -0.5 * (nis + math.log(determinant)) - math.log(2 * math.pi))


def update(predicted: Gaussian, measured: Innovation) -> Gaussian:
    """Update a state with a measurement."""
    # x + K y with K = P S^-1; because H = I, the covariance is K times that of the measurement
    p_rr, p_rv, p_vv = predicted.range_m2, predicted.cross_m2ps, predicted.velocity_m2ps2
    s_rr, s_rv, s_vv = measured.range_m2, measured.cross_m2ps, measured.velocity_m2ps2
    determinant = s_rr * s_vv - s_rv**2
    k_rr, k_rv = (p_rr * s_vv - p_rv * s_rv) / determinant, (p_rv * s_rr - p_rr * s_rv) / determinant
    k_vr, k_vv = (p_rv * s_vv - p_vv * s_rv) / determinant, (p_vv * s_rr - p_rv * s_rv) / determinant
    return Gaussian(
        predicted.range_m + k_rr * measured.range_m + k_rv * measured.velocity_mps,
        predicted.velocity_mps + k_vr * measured.range_m + k_vv * measured.velocity_mps,
        k_rr * (s_rr - p_rr),
        k_rv * (s_vv - p_vv),
        k_vv * (s_vv - p_vv),
    )


def merge_mixture(states: Sequence[Gaussian], weights: Sequence[float]) -> Gaussian:
    """Reduce a mixture to one Gaussian with its mean and covariance. The weights must sum to 1."""
    r = sum(w * s.range_m for w, s in zip(weights, states, strict=True))
    v = sum(w * s.velocity_mps for w, s in zip(weights, states, strict=True))
    rr = rv = vv = 0.0
    for w, s in zip(weights, states, strict=True):
        d_r, d_v = s.range_m - r, s.velocity_mps - v
        rr += w * (s.range_m2 + d_r * d_r)
        rv += w * (s.cross_m2ps + d_r * d_v)
        vv += w * (s.velocity_m2ps2 + d_v * d_v)
    return Gaussian(r, v, rr, rv, vv)


def smooth(filtered: Sequence[Gaussian], predicted: Sequence[Gaussian], models: Sequence[Model]) -> list[Gaussian]:
    """Smooth over a fixed interval (Rauch, Tung and Striebel, AIAA J. 3, 1965)."""
    states = list(filtered)
    for n in range(len(states) - 2, -1, -1):
        # x + C (x_after - x_predicted), P + C (P_after - P_predicted) C', C = P F' P_predicted^-1
        before, ahead, model, after = filtered[n], predicted[n + 1], models[n + 1], states[n + 1]
        transition = np.array([[1.0, -model.carry_s], [0.0, model.keep]])
        before_cov, ahead_cov = make_covariance(before), make_covariance(ahead)
        determinant = ahead.range_m2 * ahead.velocity_m2ps2 - ahead.cross_m2ps**2
        adjugate = np.array([[ahead.velocity_m2ps2, -ahead.cross_m2ps], [-ahead.cross_m2ps, ahead.range_m2]])
        gain = before_cov @ transition.T @ adjugate / determinant
        mean = np.array(before[:2]) + gain @ (np.array(after[:2]) - np.array(ahead[:2]))
        cov = before_cov + gain @ (make_covariance(after) - ahead_cov) @ gain.T
        states[n] = Gaussian(*map(float, (mean[0], mean[1], cov[0, 0], cov[0, 1], cov[1, 1])))
    return states


def make_covariance(state: Gaussian) -> FloatArray:
    """Return the covariance matrix, shape (2, 2)."""
    return np.array([[state.range_m2, state.cross_m2ps], [state.cross_m2ps, state.velocity_m2ps2]])
