"""The part that all ranges share: static echoes times one complex factor per frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

ComplexArray = npt.NDArray[np.complex128]
FloatArray = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class StaticPart:
    """Rank-one model y = z c + rest of an empty room.

    Parameters
    ----------
    echo_v : ndarray, shape (N,)
        Static echo c per bin, V: the time mean after the common phase is taken out.
    reference_v : ndarray, shape (N,)
        The same where the common factor was taken from, 0 elsewhere.
    factor : ndarray, shape (I,)
        Common factor z per frame: its angle is the phase of the frame, its size the gain; mean size about 1.
    rest_v : ndarray, shape (I, N)
        What is left: noise and movers, V.
    """

    echo_v: ComplexArray
    reference_v: ComplexArray
    factor: ComplexArray
    rest_v: ComplexArray


def static_part(samples_v: ComplexArray, *, bins: Mask | None = None) -> StaticPart:
    """Least-squares static echo and common factor: strongest eigenvector of the bins' covariance, then one average.

    A time mean alone would lose level when the phase wanders; the eigenvector does not.

    Parameters
    ----------
    samples_v : ndarray, shape (I, N)
        Frames.
    bins : ndarray of bool, shape (N,), optional
        Bins to take the common factor from; all by default. Leave out those with movers.
    """
    from scipy.linalg import eigh

    chosen = np.ones(samples_v.shape[1], dtype=bool) if bins is None else bins
    part = samples_v[:, chosen]
    last = part.shape[1] - 1
    shape = eigh(part.conj().T @ part, subset_by_index=(last, last))[1][:, 0].conj()
    shares = part @ shape.conj()
    turn = np.exp(1j * (np.angle(np.sum(shares)) - np.angle(shares)))  # phases count from that of the mean frame
    echo = np.mean(samples_v * turn[:, None], axis=0)
    reference = np.where(chosen, echo, 0.0)
    energy = _energy(reference)
    factor = samples_v @ reference.conj() / energy if energy > 0 else np.ones(len(samples_v), dtype=complex)
    return StaticPart(echo, reference, factor, samples_v - factor[:, None] * echo)


def still_part(samples_v: ComplexArray) -> StaticPart:
    """Time mean and rest, for echoes too weak to show a common phase."""
    echo = np.mean(samples_v, axis=0)
    return StaticPart(echo, np.zeros_like(echo), np.ones(len(samples_v), dtype=complex), samples_v - echo)


def _energy(values_v: ComplexArray) -> float:
    return float(np.sum(np.abs(values_v) ** 2))


def correlation_sum(values_v: ComplexArray, correlation: ComplexArray) -> ComplexArray:
    """R a: the noise correlation matrix, given by its lags 0, 1, ... (rho_l = E w_n+l w_n*), times a vector."""
    both = np.concatenate([correlation[:0:-1].conj(), correlation])
    summed = np.convolve(values_v, both, mode="full")
    first = len(correlation) - 1
    return np.asarray(summed[first : first + values_v.size])


def leverage(static: StaticPart, correlation: ComplexArray) -> FloatArray:
    """Share of each bin's noise that taking out the common factor removes too, shape (N,).

    For r = w - c (a^H w) / S, a the reference and S its energy: 2 Re(c_n* (R a)_n) / S - |c_n|^2 a^H R a / S^2.
    """
    echo, reference = static.echo_v, static.reference_v
    energy = _energy(reference)
    if not energy > 0:
        return np.zeros(echo.size)
    summed = correlation_sum(reference, correlation)
    whole = float(np.real(np.vdot(reference, summed)))
    share = 2.0 * np.real(echo.conj() * summed) / energy - np.abs(echo) ** 2 * whole / energy**2
    return np.asarray(share, dtype=np.float64)


def factor_variance(static: StaticPart, correlation: ComplexArray, *, noise_power_v2: float) -> float:
    """Variance that noise adds to the phase (rad^2) and to the relative gain of a frame: a^H R a sigma^2 / (2 S^2)."""
    reference = static.reference_v
    energy = _energy(reference)
    if not energy > 0:
        return float("inf")
    whole = float(np.real(np.vdot(reference, correlation_sum(reference, correlation))))
    return whole * noise_power_v2 / (2.0 * energy**2)
