"""Trained models as plain arrays, independent of scikit-learn and torch.

A model is scored, saved and used only in this form, so that a report remains valid if the model is
later loaded with other library versions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from doppelgait.classify import scorer
from doppelgait.classify.scorer import Arrays
from doppelgait.processing.patches import Levels, Patch

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Inputs = npt.NDArray[Any]
"""Features (n, d), float64 with NaN for unknown; or levels (n,), objects, None for unknown; or
objects (n, d + 1) whose last column has levels, or :class:`Seen`."""

PICTURES_AT_A_TIME = 32
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


COLUMNS = {"median": "f", "told": "t", "mean": "k", "scale": "k"}
"""Arrays of the standardisation of features to columns: the median (of the logarithm above a floor), and the features
with a further column that marks them as unknown."""
LAYERS = {"kernel": "oi33", "scale": "o", "bias": "o"}  # of every layer of pictures: kernel.0, ...
ARRAYS: dict[str, dict[str, str]] = {
    "constant": {"log_share": "c"},
    "linear": {**COLUMNS, "weight": "ck", "bias": "c", "floor": "f"},
    "trees": {
        **dict.fromkeys(("feature", "threshold", "value", "unknown_left", "left", "right"), "n"),
        "root": "ru",
        "start": "u",
    },
    "network": {"weight": "ci", "bias": "c"},
    "track": {
        **{**COLUMNS, "floor": "f", "feature_weight": "vk", "feature_bias": "v"},
        **{"embed_weight": "ep", "embed_bias": "e", "gate_weight": "mq", "gate_bias": "m"},
        **{"value_weight": "mq", "value_bias": "m", "forgetting_hz": "m"},
        **{"hidden_weight": "ys", "hidden_bias": "y", "weight": "cy", "bias": "c"},
    },
    "ensemble": {"weights": "m", "slopes": "m", "shifts": "mc"},
}
"""Arrays of every kind of model, as in files, with their shapes, a letter for each size. c: classes, u: scores (one for
two classes), f: features, k: their columns, i and o: channels; the others are sizes of a model."""
NOVELTY = {**COLUMNS, "floor": "f", "centre": "gk", "whitening": "kk", "held": "h"}
INTEGERS = {"told", "feature", "unknown_left", "left", "right", "root"}


def list_arrays(kind: str, arrays: Arrays) -> dict[str, str]:
    """List the arrays of a kind of model, with as many layers as there are, and their shapes."""
    count = sum(name.startswith("kernel.") for name in arrays) if kind in ("network", "track") else 0
    return ARRAYS[kind] | {f"{name}.{n}": letters for name, letters in LAYERS.items() for n in range(count)}


@dataclass(frozen=True, eq=False)
class Learned:
    """A trained model: its kind and its arrays."""

    kind: str
    arrays: Arrays
    patch: Patch | None = None  # of the pictures of a network
    members: tuple[Learned, ...] = ()  # of an ensemble, a weighted mean of calibrated log-odds

    def log_probability(self, values: Inputs) -> FloatArray:
        """Return log-probabilities, shape (n, n_classes)."""
        match self.kind:
            case "constant":
                return np.tile(self.arrays["log_share"], (len(values), 1))
            case "network":
                return scorer.network(self.arrays, vars(self.patch), values.tolist())
            case "track":
                return follow_windows(self.arrays, values)
            case "ensemble":
                answers = [member.log_probability(select_inputs(member, values)) for member in self.members]
                return scorer.join(self.arrays, answers)
        return (scorer.linear if self.kind == "linear" else scorer.trees)(self.arrays, values)


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


def follow_windows(network: Arrays, values: Inputs) -> FloatArray:
    """Return a network's log-probabilities (n, n_classes) after each window."""
    n_classes = network["bias"].size
    found = np.full((len(values), n_classes), -np.log(n_classes))
    seen: list[Seen] = values[:, -1].tolist()
    whole = np.flatnonzero([each.pictures is not None for each in seen])
    seen = [seen[number] for number in whole]
    embedding, memories = embed_windows(network, values[whole]), {-1: EMPTY}
    order, before_each = find_windows_before(seen)
    for number, before in zip(order.tolist(), before_each[order].tolist(), strict=True):
        since_s = seen[number].stop_s - seen[before].stop_s if before >= 0 else 0.0
        answer = scorer.remember(network, memories[before], embedding[number], since_s)
        memories[number], found[whole[number]] = answer
    return found


def embed_windows(network: Arrays, values: Inputs) -> FloatArray:
    """Return the embeddings (n, e) of rows with pictures."""
    parts = [np.zeros((0, network["embed_bias"].size))]
    for first in range(0, len(values), PICTURES_AT_A_TIME):
        rows = values[first : first + PICTURES_AT_A_TIME]
        pictures = [to_levels(each.pictures) for each in rows[:, -1]]
        parts.append(scorer.embed(network, select_features(rows), pictures))
    return np.concatenate(parts)


def to_levels(pictures: npt.NDArray[Any]) -> Levels:
    """Convert stored pictures to levels, 0 to 1."""
    return pictures.astype(np.float32) / (255.0 if pictures.dtype == np.uint8 else 1.0)


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
    return values[:, -1] if learned.kind == "network" else select_features(values)


@dataclass(frozen=True, eq=False)
class Novelty:
    """Mahalanobis distance from the nearest class mean (Lee et al. 2018), and its ranks."""

    arrays: Arrays

    def distance(self, values: Inputs) -> FloatArray:
        """Return every row's distance from the nearest class."""
        whitening = self.arrays["whitening"]
        columns = scorer.standardise(self.arrays, select_features(values)) @ whitening
        apart = columns[:, None, :] - self.arrays["centre"] @ whitening
        return np.asarray(np.sqrt((apart**2).sum(axis=2).min(axis=1)))

    def rank(self, values: Inputs) -> FloatArray:
        """Return the share of held-out rows at least as far."""
        held = self.arrays["held"]
        farther = held.size - np.searchsorted(held, self.distance(values), side="left")
        return np.asarray((farther + 1.0) / (held.size + 1.0))
