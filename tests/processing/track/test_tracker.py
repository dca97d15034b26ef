"""Association against brute force over all assignments."""

import itertools
import math

import numpy as np
import pytest
from scipy.stats import chi2

from doppelgait.processing.track import tracker as association

MISS = math.log(0.1)


def all_events(gain: np.ndarray) -> list[tuple[tuple[int, ...], float]]:
    """Every joint event as detections per track (-1: none) and its log weight."""
    tracks, detections = gain.shape
    events = []
    for event in itertools.product(range(-1, detections), repeat=tracks):
        hits = [d for d in event if d >= 0]
        if len(set(hits)) == len(hits):
            events.append((event, sum(gain[t, d] if d >= 0 else MISS for t, d in enumerate(event))))
    return events


@pytest.mark.parametrize("seed", range(30))
def test_assignment_and_probabilities_equal_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    gain = rng.normal(0, 3, size=(rng.integers(1, 4), rng.integers(1, 5)))
    gain[rng.random(gain.shape) < 0.3] = -np.inf
    events = all_events(gain)
    best = max(weight for _, weight in events)
    chosen = association.find_best_assignment(gain, MISS)
    assert sum(gain[t, d] if d >= 0 else MISS for t, d in enumerate(chosen)) == pytest.approx(best)
    table = np.zeros((gain.shape[0], gain.shape[1] + 1))
    for event, weight in events:
        for t, d in enumerate(event):
            table[t, d] += math.exp(weight)
    np.testing.assert_allclose(
        association.compute_joint_probabilities(gain, MISS), table / table.sum(axis=1, keepdims=True), rtol=1e-9
    )


def test_gate_is_the_chi_square_quantile() -> None:
    assert association.compute_gate_threshold(0.99) == pytest.approx(chi2.ppf(0.99, 2))


def test_single_track_has_the_closed_form_of_pda() -> None:
    """beta_j = L_j / (1 - Pd Pg + sum L), L = Pd N / lambda (Bar-Shalom, Tse 1975)."""
    densities = np.array([[0.8, 0.1, 0.03]])
    found = association.associate(
        np.log(densities), detection_probability=0.9, gate_probability=0.99, clutter_density=0.05, association="jpda"
    )
    likelihood = 0.9 * densities[0] / 0.05
    total = 1 - 0.9 * 0.99 + likelihood.sum()
    np.testing.assert_allclose(found.weights[0], [*(likelihood / total), (1 - 0.9 * 0.99) / total])
    assert found.assigned.tolist() == [0]


def test_auto_is_hard_alone_and_soft_where_gates_overlap() -> None:
    alone = np.log(np.array([[0.5, 0.2]]))
    kwargs = {"detection_probability": 0.9, "gate_probability": 0.99, "clutter_density": 0.005}
    assert association.associate(alone, **kwargs).weights.tolist() == [[1.0, 0.0, 0.0]]
    both = association.associate(np.log(np.array([[0.5], [0.4]])), **kwargs)
    assert both.assigned.tolist() == [0, -1]
    assert 0 < both.weights[1, 0] < both.weights[0, 0] < 1
    hard = association.associate(np.log(np.array([[0.5], [0.4]])), **kwargs, association="gnn")
    assert hard.weights.tolist() == [[1.0, 0.0], [0.0, 1.0]]


def test_weak_detection_loses_against_none() -> None:
    found = association.associate(
        np.log(np.array([[1e-6]])), detection_probability=0.9, gate_probability=0.99, clutter_density=0.5
    )
    assert found.assigned.tolist() == [-1]


@pytest.mark.parametrize("seed", range(20))
def test_clusters_are_the_connected_components(seed: int) -> None:
    from scipy.sparse.csgraph import connected_components

    rng = np.random.default_rng(seed)
    gate = rng.random((5, 6)) < 0.2
    graph = np.zeros((11, 11))
    graph[:5, 5:] = gate
    _, label = connected_components(graph, directed=False)
    expected = []
    for k in sorted(set(label[:5][gate.any(axis=1)])):
        expected.append((np.flatnonzero(label[:5] == k).tolist(), np.flatnonzero(label[5:] == k).tolist()))
    assert association.find_clusters(gate) == sorted(expected)


def test_no_detections() -> None:
    found = association.associate(
        np.zeros((2, 0)), detection_probability=0.9, gate_probability=0.99, clutter_density=0.01
    )
    assert found.assigned.tolist() == [-1, -1]
    assert found.weights.tolist() == [[1.0], [1.0]]
