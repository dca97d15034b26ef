"""Trained models as plain arrays, independent of scikit-learn and torch.

A model is scored, saved and used only in this form, so that a report remains valid if the model is
later loaded with other library versions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from doppelgait.classify import scorer
from doppelgait.processing.patches import Levels, Patch

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Inputs = npt.NDArray[Any]
"""Features (n, d), float64 with NaN for unknown; or levels (n,), objects, None for unknown; or
objects (n, d + 1) whose last column has levels, or :class:`Seen`."""

PICTURES_AT_A_TIME = 32
LAYERS = {"kernel": "kernels", "scale": "scales", "bias": "biases"}  # in files, and fields
NOVEL_BELOW = 0.02
"""Rank below which no decision is made. The value was set in advance, so that one in fifty targets
of the known kinds is rejected."""
LEAST_FAR = 49
"""Minimum number of held-out rows. With fewer rows the minimum rank, 1 / (n + 1), exceeds
:data:`NOVEL_BELOW` and no target is rejected."""


class LabelledRows(NamedTuple):
    """Rows to train on: inputs and class numbers."""

    values: Inputs
    labels: IntArray


@dataclass(frozen=True, eq=False)
class Constant:
    """Constant probabilities."""

    log_share: FloatArray

    def log_probability(self, values: Inputs) -> FloatArray:
        """Return log-probabilities, shape (n, n_classes)."""
        return np.tile(self.log_share, (len(values), 1))


@dataclass(frozen=True, eq=False)
class Columns:
    """Standardisation of features (n, d) to columns (n, d + m)."""

    median: FloatArray  # (d,), of the logarithm where there is a floor
    told: IntArray  # (m,), features with a further column that marks them as unknown
    mean: FloatArray  # (d + m,)
    scale: FloatArray

    def standardise(self, values: Inputs) -> FloatArray:
        """Return the columns of features."""
        return scorer.standardise(vars(self), values)


@dataclass(frozen=True, eq=False)
class Linear(Columns):
    """Logistic regression on standardised features."""

    weight: FloatArray  # (n_classes, d + m)
    bias: FloatArray
    floor: FloatArray = field(default_factory=lambda: np.zeros(0))

    def log_probability(self, values: Inputs) -> FloatArray:
        """Return log-probabilities, shape (n, n_classes)."""
        return scorer.linear(vars(self), values)


@dataclass(frozen=True, eq=False)
class Trees:
    """Boosted decision trees, all nodes in one list."""

    feature: IntArray
    threshold: FloatArray
    value: FloatArray
    unknown_left: IntArray
    left: IntArray
    right: IntArray
    root: IntArray
    start: FloatArray

    def log_probability(self, values: Inputs) -> FloatArray:
        """Return log-probabilities, shape (n, n_classes)."""
        return scorer.trees(vars(self), values)


@dataclass(frozen=True, eq=False)
class Network:
    """Convolutional network over the pictures that cover a signature."""

    kernels: tuple[Levels, ...]
    scales: tuple[Levels, ...]
    biases: tuple[Levels, ...]
    weight: Levels
    bias: Levels
    patch: Patch

    def log_probability(self, values: Inputs) -> FloatArray:
        """Return log-probabilities, shape (n, n_classes)."""
        return scorer.network(list_arrays(self), vars(self.patch), values.tolist())


class Seen(NamedTuple):
    """Pictures of one window of a track, with its place in time."""

    pictures: npt.NDArray[Any] | None  # (any, slices, times, velocities), levels 0 to 1 or, as stored, 0 to 255
    track: int
    stop_s: float
    shared: bool = False  # another body is in the gate
    shown: int = -1  # class of what the gate then shows, if known: a person, if one of both is


def find_windows_before(seen: Sequence[Seen]) -> tuple[IntArray, IntArray]:
    """Return the order of windows by track and time, and the window whose memory each continues, -1 for none."""
    # a window of a shared gate continues the one before it, any other the last that shared none
    order = np.array(sorted(range(len(seen)), key=lambda n: (seen[n].track, seen[n].stop_s)), dtype=np.int64)
    before, last = np.full(len(seen), -1), dict[tuple[int, bool], int]()
    for number in order.tolist():
        one = seen[number]
        before[number] = last.get((one.track, one.shared), -1)
        last |= {(one.track, shared): number for shared in {True, one.shared}}
    return order, before


EMPTY: scorer.Memory = (0.0, 0.0, 0)


@dataclass(frozen=True, eq=False)
class TrackNetwork(Columns):
    """Network over the windows of a track, with a learned sum as its memory."""

    floor: FloatArray
    kernels: tuple[Levels, ...]
    scales: tuple[Levels, ...]
    biases: tuple[Levels, ...]
    feature_weight: Levels
    feature_bias: Levels
    embed_weight: Levels
    embed_bias: Levels
    gate_weight: Levels
    gate_bias: Levels
    value_weight: Levels
    value_bias: Levels
    forgetting_hz: Levels
    hidden_weight: Levels
    hidden_bias: Levels
    weight: Levels
    bias: Levels

    def log_probability(self, values: Inputs) -> FloatArray:
        """Return log-probabilities (n, n_classes) after each window."""
        found = np.full((len(values), self.bias.size), -np.log(self.bias.size))
        seen: list[Seen] = values[:, -1].tolist()
        whole = np.flatnonzero([each.pictures is not None for each in seen])
        seen = [seen[number] for number in whole]
        embedding, memories = self.embed(values[whole]), {-1: EMPTY}
        order, before_each = find_windows_before(seen)
        for number, before in zip(order.tolist(), before_each[order].tolist(), strict=True):
            since_s = seen[number].stop_s - seen[before].stop_s if before >= 0 else 0.0
            memories[number], found[whole[number]] = self.remember(memories[before], embedding[number], since_s)
        return found

    def embed(self, values: Inputs) -> FloatArray:
        """Return the embeddings (n, e) of rows with pictures."""
        parts = [np.zeros((0, self.embed_bias.size))]
        for first in range(0, len(values), PICTURES_AT_A_TIME):
            rows = values[first : first + PICTURES_AT_A_TIME]
            pictures = [to_levels(each.pictures) for each in rows[:, -1]]
            parts.append(scorer.embed(list_arrays(self), select_features(rows), pictures))
        return np.concatenate(parts)

    def remember(
        self, memory: scorer.Memory, embedding: FloatArray, since_s: float
    ) -> tuple[scorer.Memory, FloatArray]:
        """Add a window to the memory of a track."""
        return scorer.remember(list_arrays(self), memory, embedding, since_s)


def to_levels(pictures: npt.NDArray[Any]) -> Levels:
    """Convert stored pictures to levels, 0 to 1."""
    return pictures.astype(np.float32) / (255.0 if pictures.dtype == np.uint8 else 1.0)


def list_arrays(learned: Learned) -> dict[str, Any]:
    """Return what a model holds by name, the arrays of its layers singly."""
    each = {name: enumerate(getattr(learned, key, ())) for name, key in LAYERS.items()}
    return vars(learned) | {f"{name}.{n}": values for name, arrays in each.items() for n, values in arrays}


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Weighted mean of models' calibrated log-odds."""

    members: tuple[Learned, ...]
    weights: FloatArray
    slopes: FloatArray
    shifts: FloatArray

    def log_probability(self, values: Inputs) -> FloatArray:
        """Return log-probabilities, shape (n, n_classes)."""
        answers = [member.log_probability(select_inputs(member, values)) for member in self.members]
        return scorer.join(vars(self), answers)


def join_inputs(features: Inputs, pictures: Inputs) -> Inputs:
    """Join features (n, d) and objects (n,), such as levels."""
    joined = np.empty((len(features), features.shape[1] + 1), dtype=object)
    joined[:, :-1], joined[:, -1] = features, pictures
    return joined


def select_features(values: Inputs) -> Inputs:
    """Return the features of rows that may end with levels."""
    return values[:, :-1].astype(np.float64) if values.dtype == object and values.ndim == 2 else values


def select_inputs(learned: Learned, values: Inputs) -> Inputs:
    """Return what a member of an ensemble uses of rows."""
    return values[:, -1] if isinstance(learned, Network) else select_features(values)


@dataclass(frozen=True, eq=False)
class Novelty(Columns):
    """Mahalanobis distance from the nearest class mean (Lee et al. 2018), and its ranks."""

    floor: FloatArray
    centre: FloatArray
    whitening: FloatArray
    held: FloatArray

    def distance(self, values: Inputs) -> FloatArray:
        """Return every row's distance from the nearest class."""
        columns = self.standardise(select_features(values)) @ self.whitening
        apart = columns[:, None, :] - self.centre @ self.whitening
        return np.asarray(np.sqrt((apart**2).sum(axis=2).min(axis=1)))

    def rank(self, values: Inputs) -> FloatArray:
        """Return the share of held-out rows at least as far."""
        farther = self.held.size - np.searchsorted(self.held, self.distance(values), side="left")
        return np.asarray((farther + 1.0) / (self.held.size + 1.0))


Learned = Constant | Linear | Trees | Network | TrackNetwork | Ensemble
