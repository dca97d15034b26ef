"""Threshold factors and windows against closed forms, counted noise and literal loops."""

import numpy as np
import pytest
from scipy import stats

from doppelgait.core.errors import AnalysisError
from doppelgait.processing.detect import ca_factor, noise_factor, os_factor, os_pfa
from doppelgait.processing.detect.cfar import count_training_cells, make_range_window, mark_above_ca, mark_above_os

SHORT = range(3, 7)
"""Eight training cells about the middle of 13."""


def exponential(shape, seed):
    return np.random.default_rng(seed).standard_exponential(shape, dtype=np.float32)


def assert_probability(hits, n, expected, confidence=0.999):
    """The count lies within an interval of a binomial variable."""
    low, high = stats.binom.interval(confidence, n, expected)
    assert low <= hits <= high, (hits / n, expected)


@pytest.mark.parametrize(
    ("n_summed", "pfa", "published"), [(1, 1e-2, 4.953), (1, 1e-3, 7.710), (4, 1e-6, 5.737), (20, 1e-3, 1.860)]
)
def test_cell_averaging_factor(n_summed, pfa, published):
    assert ca_factor(32, pfa, n_summed=n_summed) == pytest.approx(published, abs=6e-4)
    assert (1.0 + ca_factor(7, pfa) / 7) ** -7 == pytest.approx(pfa)


@pytest.mark.parametrize(("pfa", "published"), [(1e-2, 3.838), (1e-3, 6.086)])
def test_ordered_statistic_factor(pfa, published):
    factor = os_factor(32, 24, pfa)
    assert factor == pytest.approx(published, abs=6e-4)
    product = 1.0
    for i in range(24):
        product *= (32 - i) / (32 - i + factor)
    assert product == pytest.approx(pfa, rel=1e-9)


def test_the_integral_for_sums_agrees_with_the_product_for_single_cells():
    shares = np.linspace(0.0, 1.0, 200_001)[1:-1]  # Pfa by a plain Riemann sum over the ordered cell's quantile
    density = stats.beta.pdf(shares, 10, 7)
    expected = np.mean(density * stats.gamma.sf(4.0 * stats.gamma.ppf(shares, 2), 2))
    assert os_pfa(4.0, 16, 10, n_summed=2) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("pfa", [1e-2, 1e-3])
@pytest.mark.parametrize(
    "mask",
    [lambda x, p: mark_above_ca(x, SHORT, p), lambda x, p: mark_above_os(x, SHORT, p, rank_share=0.7)],
    ids=["ca", "os"],
)
def test_false_alarms_in_noise_are_as_designed(mask, pfa):
    hits = total = 0
    for seed in range(4):  # one cell of every window, so that all are independent
        cells = exponential((300_000, 13), seed)
        hits += int(np.count_nonzero(mask(cells, pfa)[:, 6]))
        total += 300_000
    assert_probability(hits, total, pfa, confidence=0.95)


@pytest.mark.parametrize("pfa", [1e-2, 1e-4])
def test_false_alarms_above_a_known_floor(pfa):
    cells = 3.7 * exponential(2_000_000, 12)
    assert_probability(int(np.count_nonzero(cells > 3.7 * noise_factor(pfa))), cells.size, pfa, confidence=0.95)
    sums = np.random.default_rng(2).gamma(5, size=1_000_000)
    assert_probability(int(np.count_nonzero(sums > 5 * noise_factor(pfa, n_summed=5))), sums.size, pfa)


def test_masks_are_those_of_a_literal_loop():
    window = range(3, 10, 2)
    cells = exponential((5, 40), 4)
    cells[2, 18:21] *= 40
    ca, os = mark_above_ca(cells, window, 1e-2), mark_above_os(cells, window, 1e-2, rank_share=0.6)
    for row in range(5):
        for n in range(40):
            places = [n + sign * d for d in (3, 5, 7, 9) for sign in (-1, 1) if 0 <= n + sign * d < 40]
            training = sorted(cells[row, places].astype(float))
            rank = int(np.ceil(0.6 * len(training)))
            assert ca[row, n] == (cells[row, n] > ca_factor(len(training), 1e-2) * np.mean(training))
            assert os[row, n] == (cells[row, n] > os_factor(len(training), rank, 1e-2) * training[rank - 1])
            assert count_training_cells(window, 40)[n] == len(training)
    assert ca[2].any()
    assert os[2].any()


def test_a_window_starts_beyond_its_guard():
    window = make_range_window(bin_spacing_m=0.05, window_m=2.0, guard_m=0.75, resolution_m=0.09)
    assert window == range(16, 41, 2)  # 0.80 to 2.00 m in steps of 0.10 m


def test_cells_without_enough_training_are_never_above():
    cells = np.ones((1, 12), dtype=np.float32)
    cells[0, [0, 5]] = 1e30  # 3 to 6 away: bins 3 to 6 from the first, only 2 and 8 to 11 from the other
    np.testing.assert_array_equal(count_training_cells(SHORT, 12)[[0, 5]], [4, 7])
    assert mark_above_ca(cells, SHORT, 1e-1)[0, 5]
    assert mark_above_os(cells, SHORT, 1e-1, rank_share=0.5)[0, 5]
    few = range(3, 6)
    assert count_training_cells(few, 12)[0] == 3
    assert not mark_above_ca(cells, few, 1e-1)[0, 0]
    assert not mark_above_os(cells, few, 1e-1, rank_share=0.5)[0, 0]


def test_what_cannot_be_had_is_refused():
    with pytest.raises(AnalysisError, match="rank 9 of 8"):
        os_factor(8, 9, 1e-3)
    with pytest.raises(AnalysisError, match="is not possible with"):
        os_factor(4, 1, 1e-12)
