"""Score a model file of doppelgait with NumPy alone.

``doppelgait model export --form numpy`` copies this file next to a model. It imports nothing of
doppelgait. Features and pictures go in, probabilities come out.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

NEWEST_FORMAT = 4
FARTHEST_SD, LONGEST_S, MOST_LOG, SCALE = 4.0, 6.0, 8.0, 10.0
"""Of networks of tracks: limits of standardised features, pauses and logarithms of weights, and scale of the sum."""

Array = npt.NDArray[Any]
Arrays = Mapping[str, Array]
Memory = tuple[Any, Any, int]


class Scorer:
    """Model of one file (``.npz``).

    ``classes`` and ``features`` are names in their order (no features: a model of signatures
    alone), ``patch`` is the format of the pictures (None: a model of features alone), ``facts`` has
    training data, conditions, thresholds. ``part="track"`` is the model of tracks in a file that
    has one, see :meth:`follow`.
    """

    def __init__(self, path: str | Path, part: str = "") -> None:
        with np.load(Path(path), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        document = json.loads(arrays.pop("model").tobytes().decode())
        if document["format"] != "doppelgait-model" or document["format_version"] > NEWEST_FORMAT:
            raise ValueError(f"{path}: this scorer reads format doppelgait-model up to version {NEWEST_FORMAT}")
        if part and part not in document:
            raise ValueError(f"{path}: has no model {part!r}")
        if part:
            document, arrays = document[part], select_part(arrays, f"{part}.")
        self.facts = document["facts"]
        self.classes, self.features = self.facts["classes"], self.facts["names"]
        self._arrays, self._joined = arrays, document["learned"] == "ensemble"
        forms = enumerate(document["members"]) if self._joined else ()
        joined = [(form, select_part(arrays, f"member.{number}.")) for number, form in forms]
        self._members = joined or [(document, arrays)]
        self.patch = next((form["patch"] for form, _ in self._members if form["patch"]), None)

    def probability(self, features: npt.ArrayLike | None = None, whole: Sequence[Array | None] | None = None) -> Array:
        """Return calibrated probabilities (n, n_classes) for equally frequent classes.

        ``features`` (n, d) are in the order of ``Scorer.features``, NaN for unknown; ``whole`` has
        the levels of every signature (``doppelgait.classify.levels``), or None.
        """
        table = None if features is None else np.asarray(features, dtype=np.float64)
        answers = [self._member(form, own, table, whole) for form, own in self._members]
        return self._calibrate(join(self._arrays, answers) if self._joined else answers[0])

    def _calibrate(self, log_probability: Array) -> Array:
        slope, shift = self._arrays["calibration.slope"][0], self._arrays["calibration.shift"]
        return np.asarray(np.exp(log_softmax(slope * log_probability + shift)))

    def follow(
        self, memory: Memory | None, features: npt.ArrayLike, pictures: Array, since_s: float
    ) -> tuple[Memory, Array]:
        """Add a window to a track; return its memory and its probabilities.

        ``features`` (d,) and ``pictures`` (any, slices, times, velocities; 0 to 1) are of the
        window, ``memory`` is None for the first one, ``since_s`` the time since the end of the
        window before, 0 for the first.
        """
        embedding = embed(self._arrays, np.asarray(features, dtype=np.float64)[None], [pictures])[0]
        memory, answer = remember(self._arrays, memory or (0.0, 0.0, 0), embedding, since_s)
        return memory, self._calibrate(answer[None])[0]

    def decide(self, probability: Array) -> list[str | None]:
        """Return a class per row, None below the threshold.

        doppelgait abstains for more reasons: flags of the analysis, another radar, features unlike the training data.
        """
        sure = probability.max(axis=1) >= self.facts["abstain_below"]
        return [self.classes[best] if ok else None for best, ok in zip(probability.argmax(axis=1), sure, strict=True)]

    def _member(self, form: Mapping[str, Any], own: Arrays, features: Array | None, whole: Any) -> Array:
        kind = form["learned"]
        if kind == "track":
            raise ValueError("this model follows the windows of tracks: Scorer.follow")
        if kind == "network" and whole is not None:
            return network(own, form["patch"], whole)
        if kind == "constant":
            return np.tile(own["log_share"], (len(whole if features is None else features), 1))
        if kind == "network" or features is None:
            needed = "levels of signatures" if kind == "network" else f"{len(self.features)} features"
            raise ValueError(f"this model needs {needed}")
        return {"linear": linear, "trees": trees}[kind](own, features)


def select_part(arrays: Arrays, start: str) -> dict[str, Array]:
    """Select the arrays whose names begin so."""
    return {name[len(start) :]: values for name, values in arrays.items() if name.startswith(start)}


def log_softmax(scores: Array) -> Array:
    """Convert scores (n, n_classes) to log-probabilities; one score means two classes."""
    if scores.shape[1] == 1:
        scores = np.hstack([np.zeros_like(scores), scores])
    shifted = scores - scores.max(axis=1, keepdims=True)
    return np.asarray(shifted - np.log(np.exp(shifted).sum(axis=1, keepdims=True)))


def join(own: Arrays, answers: Sequence[Array]) -> Array:
    """Join the log-probabilities of an ensemble's members."""
    joined = zip(own["weights"], own["slopes"], own["shifts"], answers, strict=True)
    return log_softmax(sum(weight * log_softmax(slope * each + shift) for weight, slope, shift, each in joined))


def take_logarithms(values: Array, floor: Array) -> Array:
    """Take the logarithm of features that have a floor above 0; NaN stays."""
    return np.where(floor > 0, np.log(np.maximum(values, np.where(floor > 0, floor, 1.0))), values)


def standardise(own: Arrays, values: Array) -> Array:
    """Standardise features (n, d) to columns."""
    unknown = np.isnan(values)
    filled = np.where(unknown, own["median"], take_logarithms(values, own["floor"]))
    columns = np.hstack([filled, unknown[:, own["told"].astype(int)]])
    return np.asarray((columns - own["mean"]) / own["scale"])


def linear(own: Arrays, values: Array) -> Array:
    """Return log-probabilities of logistic regression."""
    columns = standardise(own, values)
    return log_softmax(columns @ own["weight"].T + own["bias"])


def trees(own: Arrays, values: Array) -> Array:
    """Return log-probabilities of boosted trees."""
    rows = np.arange(len(values))[:, None]
    node = np.tile(own["root"].astype(int).ravel(), (len(values), 1))
    while (inner := own["feature"][node] >= 0).any():
        seen = values[rows, np.maximum(own["feature"][node], 0)]
        goes_left = np.where(np.isnan(seen), own["unknown_left"][node] > 0, seen <= own["threshold"][node])
        node = np.where(inner, np.where(goes_left, own["left"][node], own["right"][node]), node)
    return log_softmax(own["start"] + own["value"][node].reshape(len(values), *own["root"].shape).sum(axis=1))


def network(own: Arrays, patch: Mapping[str, Any], whole: Sequence[Array | None]) -> Array:
    """Return mean log-probabilities of covering pictures."""
    answers = np.zeros((len(whole), own["bias"].size))
    for row, signature_levels in enumerate(whole):
        if signature_levels is not None:
            pictures = covering(signature_levels, patch)
            pictures = np.concatenate([pictures, pictures[:, ::-1]])
            answers[row] = of_pictures(own, pictures).mean(axis=0)
    return log_softmax(answers)


def of_pictures(own: Arrays, pictures: Array) -> Array:
    """Return log-probabilities of pictures (n, n_velocity, n_time)."""
    layer = convolve(own, np.asarray(pictures, dtype=np.float32)[:, None])
    return log_softmax((layer.mean(axis=(2, 3)) @ own["weight"].T + own["bias"]).astype(np.float64))


def convolve(own: Arrays, layer: Array) -> Array:
    """Compute the convolutional layers of pictures (n, n_channels, height, width)."""
    for number in range(sum(name.startswith("kernel.") for name in own)):
        weights, scale, bias = (own[f"{kind}.{number}"] for kind in ("kernel", "scale", "bias"))
        padded = np.pad(layer, ((0, 0), (0, 0), (1, 1), (1, 1)))
        windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(2, 3))
        layer = np.einsum("nchwij,ocij->nohw", windows, weights, optimize=True)
        n, channels, height, width = layer.shape
        layer = layer.reshape(n, channels, height // 2, 2, width // 2, 2).max(axis=(3, 5))
        layer = np.maximum(layer * scale[:, None, None] + bias[:, None, None], 0.0)
    return layer


def embed(own: Arrays, features: Array, pictures: Sequence[Array]) -> Array:
    """Return the embedding (n, e) of windows: features (n, d) and pictures of each."""
    counts = [len(each) for each in pictures]
    layer = convolve(own, np.concatenate(pictures).astype(np.float32))
    pooled = np.hstack([layer.mean(axis=(2, 3)), layer.max(axis=(2, 3))])
    pooled = np.add.reduceat(pooled, np.cumsum([0, *counts[:-1]]), axis=0) / np.array(counts)[:, None]
    columns = np.clip(standardise(own, features), -FARTHEST_SD, FARTHEST_SD)
    columns = np.maximum(columns @ own["feature_weight"].T + own["feature_bias"], 0.0)
    scores = np.hstack([pooled, columns]) @ own["embed_weight"].T + own["embed_bias"]
    return np.asarray(np.maximum(scores, 0.0))


def remember(own: Arrays, memory: Memory, embedding: Array, since_s: float) -> tuple[Memory, Array]:
    """Add a window's embedding to the memory of a track; return log-probabilities, too.

    The memory is a sum with forgetting, its weights, and the number of windows; it begins as (0, 0,
    0). ``since_s`` is the time since the end of the window before, 0 for the first.
    """
    total, weights, count = memory
    inputs = np.append(embedding, [min(since_s, LONGEST_S), np.log(count + 1.0)])
    weight = np.exp(np.clip(own["gate_weight"] @ inputs + own["gate_bias"], -MOST_LOG, MOST_LOG))
    kept = np.exp(-since_s * own["forgetting_hz"])
    weights = kept * weights + weight
    total = kept * total + weight * (own["value_weight"] @ inputs + own["value_bias"])
    summary = np.concatenate([total / weights, np.log(weights), total / SCALE])
    hidden = np.maximum(own["hidden_weight"] @ summary + own["hidden_bias"], 0.0)
    return (total, weights, count + 1), log_softmax((own["weight"] @ hidden + own["bias"])[None])[0]


def covering(whole: Array, patch: Mapping[str, Any]) -> Array:
    """Cut pictures (n, n_velocity, n_time) that cover all levels."""
    n_time, spare = patch["n_time"], whole.shape[1] - patch["n_time"]
    if spare < 0:
        before = -(spare // 2)
        return np.pad(whole, ((0, 0), (before, -spare - before)))[None]
    starts = np.linspace(0, spare, 1 + -(-2 * spare // n_time)).round().astype(int)
    return np.stack([whole[:, start : start + n_time] for start in starts])
