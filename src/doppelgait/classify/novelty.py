"""Distance of a target from all training data.

A classifier always returns one of its classes. Other targets, such as a waving person or a vacuum cleaner, are
recognised by their distance from the training rows, not by the probabilities.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from doppelgait.classify.learned import FloatArray, Inputs, IntArray, LabelledRows, select_features, standardise

NOVEL_BELOW = 0.02
"""Rank below which no decision is made. The value was set in advance, so that one in fifty targets of the known kinds
is rejected."""
LEAST_FAR = 49
"""Minimum number of held-out rows. With fewer rows the minimum rank, 1 / (n + 1), exceeds :data:`NOVEL_BELOW` and no
target is rejected."""
LEVELS = 500
"""Maximum number of stored quantiles of the held-out distances."""
SHRINKAGE = 0.05
"""Share of the identity in the covariance of the standardised columns, assumed: a column without spread in training
counts as one with a fifth of the usual spread."""


@dataclass(frozen=True, eq=False)
class Novelty:
    """Distance of features from the nearest class, and its ranks.
    Mahalanobis: d² = min_k (x - m_k)' C⁻¹ (x - m_k) with the class means m_k and the covariance C about them (Lee et
    al. 2018), of the columns that logistic regression sees (:class:`doppelgait.classify.learned.Linear`).
    """

    median: FloatArray
    told: IntArray
    mean: FloatArray
    scale: FloatArray
    floor: FloatArray
    centre: FloatArray
    whitening: FloatArray
    held: FloatArray

    def distance(self, values: Inputs) -> FloatArray:
        """Return every row's distance from the nearest class."""
        columns = standardise(select_features(values), self) @ self.whitening
        apart = columns[:, None, :] - self.centre @ self.whitening
        return np.asarray(np.sqrt((apart**2).sum(axis=2).min(axis=1)))

    def rank(self, values: Inputs) -> FloatArray:
        """Return the share of held-out rows at least as far."""
        farther = self.held.size - np.searchsorted(self.held, self.distance(values), side="left")
        return np.asarray((farther + 1.0) / (self.held.size + 1.0))


def learn_novelty(
    standard: tuple[FloatArray, IntArray, FloatArray, FloatArray, FloatArray, FloatArray],
    train: LabelledRows,
    held: LabelledRows,
) -> Novelty:
    """Fit the distribution of training rows about their class means."""
    median, told, mean, scale, floor, columns = standard
    classes, labels = np.unique(train.labels, return_inverse=True)
    centre = np.array([columns[labels == number].mean(axis=0) for number in range(classes.size)])
    about = columns - centre[labels]
    covariance = (1.0 - SHRINKAGE) * about.T @ about / len(about) + SHRINKAGE * np.eye(columns.shape[1])
    whitening = np.linalg.cholesky(np.linalg.inv(covariance))
    bare = Novelty(median, told, mean, scale, floor, centre, whitening, np.zeros(0))
    far = np.sort(bare.distance(held.values)) if held.labels.size else np.zeros(0)
    if far.size > LEVELS:
        far = np.quantile(far, (np.arange(LEVELS) + 0.5) / LEVELS)
    return replace(bare, held=far)
