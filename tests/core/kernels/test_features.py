"""Compiled passes of normalisation, lines, periodicity and uncertainty against the literal equations in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from doppelgait.core.kernels.cadence import magnitudes_of_parts
from doppelgait.core.kernels.columns import excess_columns, peak_offsets, row_means, sums_about_line
from doppelgait.core.kernels.features import power_quantiles
from doppelgait.core.kernels.periodicity import (
    highest_between,
    lag_products,
    limb_amplitudes,
    period_harmonics,
    rhythm_evidence,
    square_difference,
)
from doppelgait.core.kernels.robust import median_in_place, robust_fit


def random(*shape, seed=0):
    return np.random.default_rng(seed).standard_normal(shape)


@pytest.mark.parametrize("size", [1, 2, 3, 10, 11, 500, 501])
def test_median_is_that_of_numpy(size):
    for seed in range(20):
        values = np.round(random(size, seed=seed), 1)  # with ties
        assert median_in_place(values.copy()) == pytest.approx(np.median(values), abs=1e-15)


def test_robust_fit_is_iteratively_reweighted_least_squares():
    t = np.linspace(-1, 1, 301)
    basis = np.polynomial.legendre.legvander(t, 3).T.copy()
    values = 4 + 3 * t - t**2 + 0.1 * random(301)
    values[::7] += 20.0
    prior, divisor = 1.1 - t**2, 1.0 + 0.3 * t
    line, found = np.full(301, np.median(values)), np.empty(4)
    wanted = line.copy()
    for _ in range(5):
        residual = (values - wanted) / divisor
        scale = 2.385 * max(1.4826 * np.median(np.abs(residual)), 0.01)
        root = np.sqrt(prior / (1 + (residual / scale) ** 2))
        solution = np.linalg.lstsq((basis * root).T, values * root, rcond=None)[0]
        wanted = solution @ basis
    robust_fit(basis, values, prior, divisor, 0.01, 2.385, 5, line, found)
    np.testing.assert_allclose(line, wanted, rtol=1e-11, atol=1e-12)  # the line crosses zero
    np.testing.assert_allclose(found, solution, rtol=1e-10)


def test_a_robust_line_through_points_without_error_is_exact():
    t = np.linspace(-1, 1, 50)
    basis, found = np.stack([np.ones(50), t]), np.empty(2)
    robust_fit(basis, 2.0 - 5.0 * t, np.ones(50), np.ones(50), 1e-6, 2.385, 3, np.zeros(50), found)
    np.testing.assert_allclose(found, [2.0, -5.0], rtol=1e-12)


def test_columns_without_their_floor_and_their_sums_e28():
    values = random(40, 33).astype(np.float32)
    found, sums, means = np.empty((40, 33)), np.empty(40), np.empty(33)
    excess_columns(values, 0.3, found, sums)
    np.testing.assert_array_equal(found, np.maximum(values.astype(float) - 0.3, 0.0))
    np.testing.assert_allclose(sums, found.sum(axis=1), rtol=1e-13)
    row_means(values, means)
    np.testing.assert_allclose(means, values.astype(float).mean(axis=0), rtol=1e-12)


def test_peaks_of_parabolas_in_the_logarithm_are_exact_also_at_the_ends():
    k, centre = np.arange(16), np.array([3.2, 7.5, 12.9, 0.1, 15.0])
    values = np.exp(-0.3 * (k - centre[:, None]) ** 2)
    best, offset = values.argmax(axis=1), np.empty(5)
    peak_offsets(values, best, offset)
    np.testing.assert_allclose((best + offset)[:3], centre[:3], rtol=1e-12)
    np.testing.assert_array_equal(best[3:], [1, 14])
    np.testing.assert_array_equal(offset[3:], [-0.5, 0.5])


def test_power_quantiles_are_those_of_the_cumulative_power_e35():
    values = random(60, 41) ** 2
    low, high = np.empty((2, 60))
    power_quantiles(values, 0.8, 0.2, 0.01, 0.99, low, high)
    power = np.where(values > 0.8, values - 0.2, 0.0)
    edges = np.arange(42) - 0.5
    for share, found in ((0.01, low), (0.99, high)):
        for j in range(60):
            total = np.concatenate([[0.0], np.cumsum(power[j])])
            k = int(np.flatnonzero(total[1:] >= share * total[-1])[0])
            wanted = edges[k] + (share * total[-1] - total[k]) / power[j, k]
            assert found[j] == pytest.approx(wanted, abs=1e-9)
    power_quantiles(values, 1e9, 0.2, 0.01, 0.99, low, high)
    assert np.isnan(low).all()
    assert np.isnan(high).all()


@pytest.mark.parametrize(("first", "count"), [(0, 30), (4, 7), (29, 1), (0, 1), (10, 5)])
@pytest.mark.parametrize("n_rows", [1, 5, 64])
def test_lags_are_sums_of_products_e33(first, count, n_rows):
    rows = random(30, n_rows)
    products, likeness = np.empty(count), np.empty(count)
    lag_products(rows, first, products)
    square_difference(rows, first, likeness)
    for i, lag in enumerate(range(first, first + count)):
        early, late = rows[: 30 - lag], rows[lag:]
        assert products[i] == pytest.approx((early * late).sum(), abs=1e-12)
        assert likeness[i] == pytest.approx(2 * (early * late).sum() / (early**2 + late**2).sum(), abs=1e-12)
    square_difference(np.zeros((30, n_rows)), first, likeness)
    assert not likeness.any()


def test_highest_value_on_straight_lines_between_samples():
    values = random(40)
    for low, high in ((3.2, 3.9), (0.0, 39.0), (38.7, 39.0), (12.0, 12.0)):
        wanted = np.interp(np.linspace(low, high, 9), np.arange(40), values).max()
        assert highest_between(values, low, high, 9) == pytest.approx(wanted, rel=1e-13)


def test_amplitudes_of_groups_without_noise():
    moved, noise = np.abs(random(20, 12)), np.linspace(0.1, 0.5, 20)
    occupied = np.arange(12) % 5 != 0
    starts, stops = np.array([0, 3, 8]), np.array([3, 6, 11])
    found = np.empty((20, 3))
    limb_amplitudes(moved, occupied, noise, starts, stops, found)
    clean = np.maximum(moved - noise[:, None], 0.0) * occupied
    wanted = np.stack([clean[:, a:b].sum(axis=1) for a, b in zip(starts, stops, strict=True)], axis=1)
    np.testing.assert_allclose(found**2, wanted, rtol=1e-12)


def test_harmonics_of_periods_are_fourier_sums_without_the_mean():
    rows, starts, length, turn_rad = random(90, 6) + 3.0, np.array([1, 30, 61]), 28, 0.22
    real, imaginary, means = np.empty((3, 3, 6)), np.empty((3, 3, 6)), np.empty((3, 6))
    period_harmonics(rows, starts, length, turn_rad, real, imaginary, means)
    for b, start in enumerate(starts):
        j, part = np.arange(start, start + length), rows[start : start + length]
        np.testing.assert_allclose(means[b], part.mean(axis=0))
        for h in (1, 2, 3):
            wanted = np.exp(-1j * h * turn_rad * j) @ (part - part.mean(axis=0)) / length
            np.testing.assert_allclose(real[b, h - 1] + 1j * imaginary[b, h - 1], wanted, atol=1e-13)


def test_sums_about_a_line_count_cells_at_the_edge_in_part_and_go_round():
    values, line = np.abs(random(30, 24)).astype(np.float32), np.linspace(1.3, 22.8, 30)
    found, reaches = np.empty((4, 30)), np.array([1.7, 5.2, 3.1])
    sums_about_line(values, 0.4, line, reaches, *found)
    distance = (np.arange(24) - line[:, None] + 12.0) % 24.0 - 12.0
    power = values.astype(float) - 0.4
    for row, reach in zip(found[:2], reaches[:2], strict=True):
        share = np.clip(reach - np.abs(distance) + 0.5, 0.0, 1.0)
        np.testing.assert_allclose(row, (power * share).sum(axis=1), rtol=1e-10)
    square = np.where(np.abs(distance) <= reaches[2], np.maximum(power, 0.0), 0.0) ** 2
    np.testing.assert_allclose(found[2], square.sum(axis=1), rtol=1e-10)
    np.testing.assert_allclose(found[3], (square * distance).sum(axis=1), rtol=1e-9, atol=1e-12)


def test_magnitudes_of_real_parts_left_and_imaginary_parts_right():
    parts, found = random(9, 14), np.empty((8, 7))
    magnitudes_of_parts(parts, found)
    np.testing.assert_allclose(found, np.abs(parts[:8, :7] + 1j * parts[:8, 7:]), rtol=1e-14)


@pytest.mark.parametrize("size", [60, 300])
def test_rhythm_evidence_is_that_of_interpolated_numpy(size):
    likeness, share = np.tanh(random(size)), random(400, seed=1) ** 2
    rate_hz, step_hz, grid_hz = 40.0, 0.05, np.array([0.7, 1.9, 7.3])
    found = np.empty((9, 3))
    rhythm_evidence(likeness, rate_hz, share, step_hz, grid_hz, found)

    def near(lag):
        places = np.linspace(0.957 * lag, min(1.0443 * lag, size - 1), 7)
        return np.interp(places, np.arange(size), likeness).max() if lag <= size - 1 else 0.0

    def power(f):
        return np.interp(f / step_hz, np.arange(400), share, right=0.0)

    for column, f in zip(found.T, grid_hz, strict=True):
        lag = rate_hz / f
        whole, half = (sum(power((h - less) * f) for h in range(1, 7)) for less in (0.0, 0.5))
        wanted = [
            -np.log(1.1 - min(near(lag), 1.0)), near(lag / 2), near(1.5 * lag), near(lag / 3), power(f), power(2 * f),
            np.log(power(f) + 0.01), np.log(whole + 0.1), np.log(half + 0.1),
        ]  # fmt: skip
        np.testing.assert_allclose(column, wanted, rtol=1e-9)
