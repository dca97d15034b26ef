"""Networks in integers: the arithmetic, bit by bit, and how near it is."""

import numpy as np

from doppelgait.classify.export.device import quantise
from doppelgait.classify.learned import log_softmax
from doppelgait.processing.patches import Patch, cut_pictures
from export_models import random_levels, random_network


def literal(network, picture):
    """Log-probabilities of one picture, sum by sum, in Python's integers."""
    layer = [[[int(np.floor(np.float32(v) * np.float32(127) + np.float32(0.5))) for v in row] for row in picture]]
    for kernel, multiplier, offset, shift in network.layers:
        height, width, found = len(layer[0]), len(layer[0][0]), []
        for o in range(len(kernel)):

            def total(y, x, o=o, layer=layer, kernel=kernel, height=height, width=width):
                return sum(
                    int(kernel[o, i, ky, kx]) * layer[i][y + ky - 1][x + kx - 1]
                    for i in range(len(layer)) for ky in range(3) for kx in range(3)
                    if 0 <= y + ky - 1 < height and 0 <= x + kx - 1 < width
                )  # fmt: skip

            best = [
                [max(total(2 * y + a, 2 * x + b) for a in (0, 1) for b in (0, 1)) for x in range(width // 2)]
                for y in range(height // 2)
            ]
            found.append(
                [[min(max((v * int(multiplier[o]) + int(offset[o])) >> shift, 0), 127) for v in row] for row in best]
            )
        layer = found
    sums = np.array(layer).sum(axis=(1, 2))
    return log_softmax((network.last_weight @ sums * network.last_scale + network.bias)[None])[0]


def test_integers_are_those_of_the_definition():
    rng, patch = np.random.default_rng(5), Patch(n_velocity=16, n_time=16)
    examples = [random_levels(rng, patch, 16) for _ in range(3)]
    network = quantise(random_network(rng, 3, patch, (3, 4)), examples)
    found = network.classify_pictures(np.stack(examples))
    expected = np.array([literal(network, picture) for picture in examples])
    assert np.allclose(found, expected, atol=1e-12)
    for layer in network.layers:
        assert np.abs(layer.kernel).max() == 127
        assert np.abs(layer.multiplier).max() < 2**31


def test_integers_are_near_the_network_they_are_of():
    rng, patch = np.random.default_rng(6), Patch()
    network = random_network(rng, 2, patch, (8, 16, 32, 64))
    examples = [random_levels(rng, patch, 80) for _ in range(30)]
    pictures = np.concatenate([cut_pictures(each, patch) for each in examples])
    exact, near = network.classify_pictures(pictures), quantise(network, examples[:10]).classify_pictures(pictures)
    apart = np.abs(np.exp(near) - np.exp(exact))
    assert np.exp(exact).std(axis=0).min() > 0.1
    assert apart.mean() < 0.01
    assert apart.max() < 0.1


def test_activations_beyond_the_examples_are_clipped():
    rng, patch = np.random.default_rng(7), Patch(n_velocity=16, n_time=16)
    network = quantise(random_network(rng, 2, patch, (3, 4)), [np.full((16, 16), 0.02, np.float32)])
    assert np.isfinite(network.classify_pictures(np.ones((1, 16, 16), np.float32))).all()
