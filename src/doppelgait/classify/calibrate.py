"""Probabilities that are true of rows which no model was fitted to: one slope for all classes and a shift for each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from doppelgait.classify.learned import FloatArray, IntArray, log_softmax

LEAST_ROWS = 5
"""Of every class; with fewer nothing is fitted."""
STEEPEST = 20.0


@dataclass(frozen=True, eq=False)
class Calibration:
    """p = softmax(slope log q + shift).

    Parameters
    ----------
    slope : float
        Above 0.
    shift : ndarray, shape (n_classes,)
        The first is 0.
    n_rows : int
        Rows it was fitted to; 0 if it changes nothing.
    """

    slope: float
    shift: FloatArray
    n_rows: int

    def __call__(self, log_probability: FloatArray) -> FloatArray:
        """Calibrated probabilities, shape (n, n_classes)."""
        return np.asarray(np.exp(log_softmax(self.slope * log_probability + self.shift)))


def class_weights(labels: IntArray, n_classes: int) -> FloatArray:
    """Weight of every row that makes all classes that occur weigh the same; mean 1."""
    counts = np.bincount(labels, minlength=n_classes)
    return np.asarray(labels.size / ((counts > 0).sum() * counts[labels]), dtype=np.float64)


def calibrate(log_probability: FloatArray, labels: IntArray) -> Calibration:
    """Fit a calibration to rows that the model was not fitted to.

    For two classes that is Platt's sigmoid of the log odds, with his targets (n + 1) / (n + 2) instead of 1 so that
    classes without an error do not become certain; for more, temperature scaling with corrected biases (Alexandari et
    al. 2020). Every class weighs the same: the probabilities are those for classes that are equally frequent.

    Parameters
    ----------
    log_probability : ndarray, shape (n, n_classes)
    labels : ndarray of int, shape (n,)

    Returns
    -------
    Calibration
        One that changes nothing if a class has fewer than 5 rows.
    """
    from scipy.optimize import minimize

    n_classes = log_probability.shape[1]
    counts = np.bincount(labels, minlength=n_classes)
    if counts.min() < LEAST_ROWS:
        return Calibration(1.0, np.zeros(n_classes), 0)
    targets = np.tile(1.0 / (counts[labels] + n_classes)[:, None], (1, n_classes))
    targets[np.arange(labels.size), labels] += counts[labels] / (counts[labels] + n_classes)
    weights = class_weights(labels, n_classes)[:, None] / labels.size

    def loss(parameters: FloatArray) -> tuple[float, FloatArray]:
        shift = np.concatenate([[0.0], parameters[1:]])
        found = log_softmax(parameters[0] * log_probability + shift)
        pull = weights * (np.exp(found) * targets.sum(axis=1, keepdims=True) - targets)
        gradient = np.concatenate([[(pull * log_probability).sum()], pull.sum(axis=0)[1:]])
        return float(-(weights * targets * found).sum()), gradient

    bounds: list[tuple[float | None, float | None]] = [(1e-3, STEEPEST), *[(None, None)] * (n_classes - 1)]
    best = minimize(loss, np.array([1.0, *[0.0] * (n_classes - 1)]), jac=True, bounds=bounds, method="L-BFGS-B").x
    return Calibration(float(best[0]), np.concatenate([[0.0], best[1:]]), int(labels.size))


def detection_threshold(probability: FloatArray, positive: npt.NDArray[np.bool_], share: float) -> float:
    """Highest threshold that at least this share of the positive rows reach; NaN without positive rows."""
    found = np.sort(probability[positive])[::-1]
    if not found.size:
        return float("nan")
    return float(found[int(np.ceil(share * found.size - 1e-9)) - 1])
