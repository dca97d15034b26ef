"""Networks with 8-bit weights and activations, 32-bit sums."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from doppelgait.classify.learned import PICTURES_AT_A_TIME, FloatArray, IntArray, Network, log_softmax
from doppelgait.processing.patches import Levels, cut_pictures

LARGEST = 127
MULTIPLIER_BITS = 30
FURTHEST_SHIFT = 40


class IntegerLayer(NamedTuple):
    """Convolution of integers.
    The activation is (sum * multiplier + offset) >> shift, 0 to 127; half of the last place is in the offset.
    """

    kernel: IntArray
    multiplier: IntArray
    offset: IntArray
    shift: int


@dataclass(frozen=True, eq=False)
class IntegerNetwork(Network):
    """Network with layers in integers.
    The results are bit-identical to those of the exported C code.
    """

    layers: tuple[IntegerLayer, ...] = ()
    last_weight: IntArray = field(default_factory=lambda: np.zeros((0, 0), dtype=np.int64))
    last_scale: FloatArray = field(default_factory=lambda: np.zeros(0))

    def classify_pictures(self, pictures: Levels) -> FloatArray:
        """Return log-probabilities (n, n_classes) of images (n, n_velocity, n_time)."""
        parts = []
        for first in range(0, len(pictures), PICTURES_AT_A_TIME):
            chosen = pictures[first : first + PICTURES_AT_A_TIME, None].astype(np.float32)
            found = np.floor(chosen * np.float32(LARGEST) + np.float32(0.5)).astype(np.int64)
            for layer in self.layers:
                total = pooled(found, layer.kernel).astype(np.int64)
                found = total * layer.multiplier[:, None, None] + layer.offset[:, None, None]
                found = np.clip(found >> layer.shift, 0, LARGEST)
            scores = found.sum(axis=(2, 3)) @ self.last_weight.T * self.last_scale + self.bias
            parts.append(log_softmax(scores))
        return np.concatenate(parts)


def pooled(layer: npt.NDArray[np.generic], kernel: npt.NDArray[np.generic]) -> FloatArray:
    """Convolve and take the maximum of 2 x 2.
    Exact for integers with sums far below 2^53.
    """
    padded = np.pad(layer, ((0, 0), (0, 0), (1, 1), (1, 1))).astype(np.float64)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(2, 3))
    found = np.moveaxis(np.tensordot(windows, kernel.astype(np.float64), axes=((1, 4, 5), (1, 2, 3))), -1, 1)
    n, channels, height, width = found.shape
    return np.asarray(found.reshape(n, channels, height // 2, 2, width // 2, 2).max(axis=(3, 5)))


def quantise(network: Network, examples: list[Levels]) -> IntegerNetwork:
    """Convert a network to integers.
    Weights have one scale per output channel, activations one per layer: its largest value over the examples is 127.
    """
    pictures = np.concatenate([cut_pictures(whole, network.patch) for whole in examples])
    values = np.concatenate([pictures, pictures[:, ::-1]])[:, None].astype(np.float64)
    layers, unit = [], 1.0 / LARGEST
    for kernel, scale, bias in zip(network.kernels, network.scales, network.biases, strict=True):
        values = np.maximum(pooled(values, kernel) * scale[:, None, None] + bias[:, None, None], 0.0)
        step = np.maximum(np.abs(kernel).max(axis=(1, 2, 3)).astype(np.float64), 1e-12) / LARGEST
        whole = np.round(kernel / step[:, None, None, None]).astype(np.int64)
        after = max(float(values.max()), 1e-6) / LARGEST
        factor, start = unit * step * scale / after, bias / after
        largest = float(np.abs(factor).max())
        shift = min(MULTIPLIER_BITS - int(np.ceil(np.log2(largest))) if largest > 0 else 0, FURTHEST_SHIFT)
        offset = np.round((start + 0.5) * 2.0**shift).astype(np.int64)
        layers.append(IntegerLayer(whole, np.round(factor * 2.0**shift).astype(np.int64), offset, shift))
        unit = after
    step = np.maximum(np.abs(network.weight).max(axis=1).astype(np.float64), 1e-12) / LARGEST
    last = np.round(network.weight / step[:, None]).astype(np.int64)
    own = {part.name: getattr(network, part.name) for part in fields(Network)}
    scale = (step * unit / np.prod(values.shape[2:])).astype(np.float32).astype(np.float64)
    return IntegerNetwork(**own, layers=tuple(layers), last_weight=last, last_scale=scale)
