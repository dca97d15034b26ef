"""Association against brute force over all assignments."""

import itertools
import math

import numpy as np
import pytest
from scipy.stats import chi2

from doppelgait.processing.track.associate import (
    associate,
    compute_gate_threshold,
    compute_joint_probabilities,
    find_best_assignment,
    find_clusters,
)

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
    chosen = find_best_assignment(gain, MISS)
    assert sum(gain[t, d] if d >= 0 else MISS for t, d in enumerate(chosen)) == pytest.approx(best)
    table = np.zeros((gain.shape[0], gain.shape[1] + 1))
    for event, weight in events:
        for t, d in enumerate(event):
            table[t, d] += math.exp(weight)
    np.testing.assert_allclose(
        compute_joint_probabilities(gain, MISS), table / table.sum(axis=1, keepdims=True), rtol=1e-9
    )


def test_gate_is_the_chi_square_quantile() -> None:
    assert compute_gate_threshold(0.99) == pytest.approx(chi2.ppf(0.99, 2))


def test_single_track_has_the_closed_form_of_pda() -> None:
    """beta_j = L_j / (1 - Pd Pg + sum L), L = Pd N / lambda (Bar-Shalom, Tse 1975)."""
    densities = np.array([[0.8, 0.1, 0.03]])
    found = associate(
        np.log(densities), detection_probability=0.9, gate_probability=0.99, clutter_density=0.05, association="jpda"
    )
    likelihood = 0.9 * densities[0] / 0.05
    total = 1 - 0.9 * 0.99 + likelihood.sum()
    np.testing.assert_allclose(found.weights[0], [*(likelihood / total), (1 - 0.9 * 0.99) / total])
    assert found.assigned.tolist() == [0]


def test_auto_is_hard_alone_and_soft_where_gates_overlap() -> None:
    alone = np.log(np.array([[0.5, 0.2]]))
    kwargs = {"detection_probability": 0.9, "gate_probability": 0.99, "clutter_density": 0.005}
    assert associate(alone, **kwargs).weights.tolist() == [[1.0, 0.0, 0.0]]
    both = associate(np.log(np.array([[0.5], [0.4]])), **kwargs)
    assert both.assigned.tolist() == [0, -1]
    assert 0 < both.weights[1, 0] < both.weights[0, 0] < 1
    hard = associate(np.log(np.array([[0.5], [0.4]])), **kwargs, association="gnn")
    assert hard.weights.tolist() == [[1.0, 0.0], [0.0, 1.0]]


def test_weak_detection_loses_against_none() -> None:
    found = associate(np.log(np.array([[1e-6]])), detection_probability=0.9, gate_probability=0.99, clutter_density=0.5)
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
    assert find_clusters(gate) == sorted(expected)


def test_no_detections() -> None:
    found = associate(np.zeros((2, 0)), detection_probability=0.9, gate_probability=0.99, clutter_density=0.01)
    assert found.assigned.tolist() == [-1, -1]
    assert found.weights.tolist() == [[1.0], [1.0]]


def test_stone_soup_gives_the_same_joint_probabilities() -> None:
    """Kalman update, gating and JPDA of Stone Soup on two tracks that share detections."""
    pytest.importorskip("stonesoup")
    from datetime import datetime, timedelta

    from stonesoup.dataassociator.probability import JPDA
    from stonesoup.hypothesiser.probability import PDAHypothesiser
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.detection import Detection
    from stonesoup.types.state import GaussianState
    from stonesoup.types.track import Track
    from stonesoup.updater.kalman import KalmanUpdater

    from doppelgait.processing.track import kalman

    q, dt, sd_r, sd_v, pd, pg, clutter = 0.75, 0.1, 0.08, 0.2, 0.9, 0.999, 0.05
    starts = [([5.0, 0.6], [[0.02, 0.002], [0.002, 0.05]]), ([5.15, 0.4], [[0.03, 0.0], [0.0, 0.04]])]
    points = [[5.07, 0.55], [5.18, 0.3], [4.95, 0.7]]  # range and its rate
    t0 = datetime(2020, 1, 1)
    model = CombinedLinearGaussianTransitionModel([ConstantVelocity(q)])
    sensor = LinearGaussian(2, (0, 1), np.diag([sd_r**2, sd_v**2]))
    updater = KalmanUpdater(sensor)
    maker = PDAHypothesiser(KalmanPredictor(model), updater, clutter, prob_detect=pd, prob_gate=pg)
    tracks = [Track([GaussianState(np.array(m)[:, None], np.array(c), timestamp=t0)]) for m, c in starts]
    now = t0 + timedelta(seconds=dt)
    seen = [Detection(np.array(p)[:, None], timestamp=now, measurement_model=sensor) for p in points]
    answer = JPDA(maker).associate(set(tracks), set(seen), now)
    expected = np.zeros((2, 4))
    for n, track in enumerate(tracks):
        for hypothesis in answer[track]:
            column = seen.index(hypothesis.measurement) if hypothesis else 3
            expected[n, column] = float(hypothesis.probability)

    own_model = kalman.make_constant_velocity_model(dt, acceleration_noise_m2ps3=q)
    table = np.zeros((2, 3))
    for n, (m, c) in enumerate(starts):  # their rate is dR/dt, our velocity -dR/dt
        state = kalman.Gaussian(m[0], -m[1], c[0][0], -c[0][1], c[1][1])
        predicted = kalman.predict(state, own_model)
        for d, p in enumerate(points):
            table[n, d] = kalman.compute_innovation(
                predicted, range_m=p[0], velocity_mps=-p[1], range_sd_m=sd_r, velocity_sd_mps=sd_v
            ).log_likelihood
    found = associate(table, detection_probability=pd, gate_probability=pg, clutter_density=clutter, association="jpda")
    np.testing.assert_allclose(found.weights, expected, atol=1e-6)
