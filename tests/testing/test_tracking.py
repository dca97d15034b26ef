"""OSPA, GOSPA and identity against brute force and worked examples."""

import itertools
import math

import numpy as np
import pytest

from doppelgait.testing.tracking import compare_tracks, gospa, ospa


def brute_gospa(a: np.ndarray, b: np.ndarray, c: float, p: float) -> float:
    """Proposition 1 of the paper: the least over all assignment sets of any size, alpha = 2."""
    best = math.inf
    for k in range(min(len(a), len(b)) + 1):
        for rows in itertools.combinations(range(len(a)), k):
            for columns in itertools.permutations(range(len(b)), k):
                pairs = sum(np.linalg.norm(a[i] - b[j]) ** p for i, j in zip(rows, columns, strict=True))
                best = min(best, pairs + c**p / 2 * (len(a) + len(b) - 2 * k))
    return best ** (1 / p)


def brute_ospa(a: np.ndarray, b: np.ndarray, c: float, p: float) -> float:
    few, many = sorted((a, b), key=len)
    best = min(
        sum(min(np.linalg.norm(x - many[j]), c) ** p for x, j in zip(few, order, strict=True))
        for order in itertools.permutations(range(len(many)), len(few))
    )
    return ((best + c**p * (len(many) - len(few))) / len(many)) ** (1 / p)


@pytest.mark.parametrize("seed", range(25))
def test_distances_equal_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = (rng.uniform(0, 3, size=(int(rng.integers(1, 5)), 2)) for _ in range(2))
    p = float(rng.choice([1.0, 2.0]))
    assert ospa(a, b, cutoff=0.9, order=p) == pytest.approx(brute_ospa(a, b, 0.9, p))
    assert gospa(a, b, cutoff=0.9, order=p).distance == pytest.approx(brute_gospa(a, b, 0.9, p))


def test_worked_example() -> None:
    """Truth at 1, 5, 8; found at 1.3 and 12; c = 1, p = 2: one pair 0.3 apart, two missed, one false."""
    got = gospa([1.3, 12.0], [1.0, 5.0, 8.0])
    assert got.localisation == pytest.approx(0.09)
    assert (got.missed, got.false, got.n_missed, got.n_false) == (1.0, 0.5, 2, 1)
    assert got.distance == pytest.approx(math.sqrt(1.59))
    assert ospa([1.3, 12.0], [1.0, 5.0, 8.0]) == pytest.approx(math.sqrt((0.09 + 1 + 1) / 3))


def test_empty_sets_and_nan() -> None:
    assert ospa([], []) == 0.0
    assert gospa([], [2.0]).distance == pytest.approx(math.sqrt(0.5))
    assert ospa([np.nan], [2.0]) == 1.0
    assert gospa([np.nan, 2.0], [2.0]).distance == 0.0


def test_exchange_at_a_crossing_is_two_switches() -> None:
    t = np.linspace(0, 4, 41)
    truth = np.c_[2 + t, 6 - t]
    exact = compare_tracks(truth, truth)
    assert (exact.switches, exact.gospa, exact.rms) == (0, 0.0, 0.0)
    swapped = np.where((t < 2)[:, None], truth, truth[:, ::-1])
    found = compare_tracks(swapped, truth)
    assert found.switches == 2
    assert found.purity == pytest.approx([0.61, 0.61], abs=0.15)  # near the crossing both pairings are allowed
    assert found.completeness == pytest.approx([1.0, 1.0])


def test_parts_of_a_track_false_tracks_and_delay() -> None:
    n = 20
    truth = np.full((n, 1), 3.0)
    found = np.full((n, 3), np.nan)
    found[4:10, 0] = 3.1  # first part
    found[12:, 1] = 2.9  # second part, another track
    found[:, 2] = 8.0  # nobody
    result = compare_tracks(found, truth)
    assert result.switches == 1
    assert result.completeness.tolist() == [14 / 20]
    assert result.purity.tolist() == [1.0, 1.0, 0.0]
    assert result.owner.tolist() == [0, 0, -1]
    assert result.first_match.tolist() == [4]
    assert result.rms == pytest.approx(0.1)
    assert result.gospa == pytest.approx((6 * math.sqrt(0.5) + 14 * math.sqrt(0.51) + 6 * (1 - math.sqrt(0.5))) / n)
