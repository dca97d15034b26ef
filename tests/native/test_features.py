"""Compiled passes of normalisation, lines, periodicity and uncertainty against the literal equations in NumPy."""

import numpy as np
import pytest
from scipy import ndimage

from doppelgait._core import native
from doppelgait.features.gait_frequency import LOWEST_HZ, SALIENT_HZ, Rhythm, compute_salience, find_highest, find_torso
from doppelgait.features.observed import fit_waves, measure_swing
from doppelgait.features.uncertainty import Periods, compute_block_scatter


def random(*shape, seed=0):
    return np.random.default_rng(seed).standard_normal(shape)


@pytest.mark.parametrize(
    "values",
    [
        random(500),
        np.round(random(501), 1),  # with ties
        np.concatenate([[-9.0, 9.0], random(40)]),
        np.zeros(50),
        np.repeat([1.0, 2.0], 40),
        np.repeat([3.0, 1e9, -5.0], [30, 1, 30]),
    ],
)
def test_quantiles_are_those_of_numpy(values):
    for size in range(1, values.size + 1):
        assert native.quantile(values[:size], 0.5) == pytest.approx(np.median(values[:size]), rel=0, abs=1e-15)
        for share in (0.0, 0.05, 0.3, 0.95, 1.0):
            wanted = np.quantile(values[:size], share)
            assert native.quantile(values[:size], share) == pytest.approx(wanted, rel=1e-14, abs=1e-14)


@pytest.mark.parametrize("ends", [(0, 3), (4, 0), (10, 10)])
def test_quantiles_between_infinite_values(ends):
    values = np.concatenate([np.full(ends[0], -np.inf), random(60), np.full(ends[1], np.inf)])
    for share in (0.3, 0.5, 0.7):
        assert native.quantile(values, share) == pytest.approx(np.quantile(values, share), rel=1e-14)


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
    native.robust_fit(basis, values, prior, divisor, 0.01, 2.385, 5, line, found)
    np.testing.assert_allclose(line, wanted, rtol=1e-11, atol=1e-12)  # the line crosses zero
    np.testing.assert_allclose(found, solution, rtol=1e-10)


def test_means_of_rows_are_those_of_numpy():
    values, means = random(41, 33).astype(np.float32), np.empty(33)
    native.row_means(values, means)
    np.testing.assert_allclose(means, values.astype(float).mean(axis=0), rtol=1e-12)


def test_peaks_of_parabolas_in_the_logarithm_are_exact_also_at_the_ends():
    k, centre = np.arange(20), np.array([3.2, 7.5, 12.9, 17.6, 0.1, 19.0])
    values = np.exp(-0.3 * (k - centre[:, None]) ** 2)
    values[1, 9] = values[1].max()  # of equal cells the first
    strongest, place = np.empty(6), np.empty(6)
    native.column_peaks(values, strongest, place)
    np.testing.assert_array_equal(strongest, values.max(axis=1))
    np.testing.assert_allclose(place[[0, 2, 3]], centre[[0, 2, 3]], rtol=1e-12)
    assert abs(place[1] - values[1].argmax()) <= 0.5
    np.testing.assert_array_equal(place[4:], [0.5, 18.5])


def test_highest_value_on_straight_lines_between_samples():
    values = random(40)
    low, high = np.array([3.2, 0.0, 38.7, 12.0]), np.array([3.9, 39.0, 39.0, 12.0])
    wanted = [np.interp(np.linspace(a, b, 9), np.arange(40), values).max() for a, b in zip(low, high, strict=True)]
    np.testing.assert_allclose(find_highest(np.tile(values, (4, 1)), low, high), wanted, rtol=1e-13)


def test_amplitudes_of_groups_without_noise_are_those_of_rows_above_it():
    moved, noise = np.abs(random(20, 12)), np.linspace(0.1, 0.5, 20)
    moved[:, [0, 5, 10]] = 0.3
    starts, stops = np.array([0, 3, 8]), np.array([3, 6, 11])
    found = np.empty((20, 3))
    native.limb_amplitudes(moved, noise, 0.1, 0.25, starts, stops, found)
    clean = np.maximum(moved - noise[:, None], 0.0) * (moved.mean(axis=0) - 0.1 > 0.25)
    wanted = np.stack([clean[:, a:b].sum(axis=1) for a, b in zip(starts, stops, strict=True)], axis=1)
    np.testing.assert_allclose(found**2, wanted, rtol=1e-12)


def test_groups_of_columns_and_rows_are_summed():
    values = random(11, 7)
    for n_columns, n_rows in ((1, 1), (3, 1), (1, 2), (4, 3)):
        found = np.empty((11 // n_columns, 7 // n_rows))
        native.sum_groups(values, n_columns, n_rows, found)
        whole = values[: found.shape[0] * n_columns, : found.shape[1] * n_rows]
        wanted = whole.reshape(found.shape[0], n_columns, found.shape[1], n_rows).sum(axis=(1, 3))
        np.testing.assert_allclose(found, wanted, atol=1e-14)
    for values, n in ((random(11, 7).astype(np.float32), 3), (random(6, 37), 2)):
        sums = np.empty(n)
        native.positive_sums(values, 3, sums)
        wanted = np.maximum(values[: 3 * n].astype(float), 0.0).reshape(n, -1).sum(axis=1)
        np.testing.assert_allclose(sums, wanted, rtol=1e-12)


@pytest.mark.parametrize(("size", "sd"), [(200, 2.4), (9, 4.9), (5, 0.01), (30, 1.0)])
def test_smoothing_is_that_of_scipy(size, sd):
    values, found = random(size), np.empty(size)
    for mirrored, mode in ((True, "reflect"), (False, "nearest")):
        native.smooth(values, sd, mirrored, found)
        np.testing.assert_allclose(found, ndimage.gaussian_filter1d(values, sd, mode=mode), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("size", [40, 41])
def test_torso_line_is_the_centroid_about_the_median_peak_e33(size):
    values = np.abs(random(size, 16))
    values[:, 14] += np.linspace(0.0, 2.0, size)
    values[3] = 0.0
    middle, line = find_torso(values, 3)
    assert middle == int(np.median(values.argmax(axis=1)))
    for j in range(size):
        square = [values[j, (middle + i) % 16] ** 2 for i in range(-3, 4)]
        wanted = sum(i * square[i + 3] for i in range(-3, 4)) / sum(square) if sum(square) else 0.0
        assert line[j] == pytest.approx(wanted, rel=1e-12, abs=1e-15)


def test_a_trend_is_the_least_squares_polynomial_e31():
    values, t = random(50, 9), np.linspace(-1, 1, 50)
    basis = np.linalg.qr(np.vander(t, 4))[0]
    found = values.copy()
    native.remove_trend(found, basis)
    wanted = values - np.polynomial.polynomial.polyval(t, np.polynomial.polynomial.polyfit(t, values, 3)).T
    np.testing.assert_allclose(found, wanted, atol=1e-13)


def test_harmonics_of_periods_are_fourier_sums_without_the_mean():
    rows, starts, length, turn_rad = random(90, 6) + 3.0, np.array([1, 30, 61]), 28, 0.22
    parts = np.empty((21, 6))
    native.period_harmonics(rows, starts, length, turn_rad / (2.0 * np.pi), parts)
    for found, start in zip(parts.reshape(3, 7, 6), starts, strict=True):
        j, part = np.arange(start, start + length), rows[start : start + length]
        np.testing.assert_allclose(found[0], part.mean(axis=0))
        for h in (1, 2, 3):
            wanted = np.exp(-1j * h * turn_rad * j) @ (part - part.mean(axis=0)) / length
            np.testing.assert_allclose(found[h] + 1j * found[h + 3], wanted, atol=1e-13)


def test_powers_about_a_line_count_cells_at_the_edge_in_part_and_go_round():
    values, line = np.abs(random(30, 27)).astype(np.float32), np.linspace(1.3, 25.8, 30)
    sums, square, moment = np.empty(5), np.empty(30), np.empty(30)
    reaches, weight = np.array([1.7, 5.2, 3.1]), np.linspace(0.5, 2.0, 30)
    native.powers_about_line(values, 0.4, line, reaches, weight, sums, square, moment)
    distance = (np.arange(27) - line[:, None] + 13.5) % 27.0 - 13.5
    power = values.astype(float) - 0.4
    torso, near = (
        weight * (power * np.clip(reach - np.abs(distance) + 0.5, 0.0, 1.0)).sum(axis=1) for reach in reaches[:2]
    )
    wanted = [torso.sum(), near.sum(), weight @ power.sum(axis=1), near.mean(), near.std()]
    np.testing.assert_allclose(sums, wanted, rtol=1e-10)
    of_body = np.where(np.abs(distance) <= reaches[2], np.maximum(power, 0.0), 0.0) ** 2
    np.testing.assert_allclose(square, of_body.sum(axis=1), rtol=1e-10)
    np.testing.assert_allclose(moment, (of_body * distance).sum(axis=1), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("gaps", [[], [0, 1, 7, 8, 9, 39], [5]])
def test_torso_swing_is_the_filled_smoothed_centroid_without_its_slow_part(gaps):
    square, moment, basis = np.abs(random(40)) + 0.1, random(40), np.linalg.qr(np.vander(np.linspace(-1, 1, 40), 3))[0]
    square[gaps] = 0.0
    (found,) = measure_swing(square[None], moment[None], 2.2, basis)
    column = np.flatnonzero(square)
    line = np.interp(np.arange(40), column, moment[column] / square[column])
    line = ndimage.gaussian_filter1d(line, 2.2, mode="nearest")
    np.testing.assert_allclose(found, line - basis @ (basis.T @ line), atol=1e-12)
    assert np.isnan(measure_swing(np.arange(40.0)[None] - 20.0, moment[None], 2.2, basis)).all()


def test_a_ridge_is_refined_by_the_centroid_of_three_cells():
    values, path = np.abs(random(20, 9)).astype(np.float32), np.arange(-5, 15)
    found = np.empty(20)
    native.refine_path(values, 0.3, path, found)
    for j, k in enumerate(path):
        cells = [max(cell - 0.3, 1e-3 * cell) for cell in (float(values[j, (k + i) % 9]) for i in (-1, 0, 1))]
        assert found[j] == pytest.approx(k + (cells[2] - cells[0]) / sum(cells), rel=1e-12)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_edges_are_described_as_by_numpy_e35b(direction):
    middle, found = random(61), np.empty(12)
    low, high, line = middle - np.abs(random(61, seed=1)), middle + np.abs(random(61, seed=2)), random(61, seed=3)
    low[[3, 50]] = np.nan
    native.edge_statistics(low, high, line, direction, 0.05, 0.95, found)
    seen = np.isfinite(low)
    low, high, line = low[seen], high[seen], line[seen]
    lead, lag = (high - line, line - low) if direction > 0 else (line - low, high - line)
    limits = [*np.quantile(lead, (0.05, 0.95)), *np.quantile(lag, (0.05, 0.95))]
    wanted = [
        59 / 61, lead.mean(), lead.std(), lag.mean(), lag.std(), *limits, np.quantile(high - low, 0.05),
        np.quantile(high, 0.95) - np.quantile(low, 0.05), (lead > (limits[0] + limits[1]) / 2).mean(),
    ]  # fmt: skip
    np.testing.assert_allclose(found, wanted, rtol=1e-12)
    native.edge_statistics(np.full(5, np.nan), np.full(5, np.nan), np.zeros(5), direction, 0.05, 0.95, found)
    assert found[0] == 0.0
    assert np.isnan(found[1:]).all()


def test_scatter_of_blocks_is_the_sandwich_over_blocks():
    residual, starts, taper = random(80), np.array([0, 13, 30, 55]), 1.001 - np.linspace(-1, 1, 80) ** 2
    for counted, n in ((np.ones(80), 4), (np.arange(80) < 55, 3)):  # all columns; without those of the last block
        square = (residual / (2.385 * 1.4826 * np.median(np.abs(residual[counted > 0])))) ** 2
        sums = np.add.reduceat(counted * taper * residual / (1 + square), starts)
        wanted = np.sqrt((sums**2).sum() * n / (n - 2)) / (counted * taper * (1 - square) / (1 + square) ** 2).sum()
        found = compute_block_scatter(residual[None], 0.01, [starts], counted > 0)
        assert found == pytest.approx([wanted], rel=1e-12)


@pytest.mark.parametrize(("orders", "counted"), [([1, 2, 3, 4], np.ones(90)), ([2, 4], np.arange(90) % 60 < 40)])
def test_parts_of_a_swing_are_the_least_squares_fit(orders, counted):
    values, phase, chosen = random(90), 0.11 * np.outer(np.arange(90), orders), counted > 0
    waves = np.concatenate([np.cos(phase), np.sin(phase)], axis=1)
    wanted = np.linalg.lstsq(waves[chosen], values[chosen], rcond=None)[0]
    (found,) = fit_waves(values[None], np.array([0.11]), np.array(orders), counted)
    np.testing.assert_allclose(found, np.hypot(*wanted.reshape(2, -1)), rtol=1e-10)


def test_counts_above_a_level_e35():
    values, level, counts = random(20, 9).astype(np.float32), random(20, seed=1).astype(np.float32), np.empty((2, 9))
    native.count_above(values, level, np.array([3, 10, 19]), counts)
    above = values >= level[:, None]
    np.testing.assert_array_equal(counts, [above[3:10].sum(axis=0), above[10:19].sum(axis=0)])


def test_variance_of_rows_is_that_of_their_cells():
    values, chosen = random(33, 9).astype(np.float32) + 3.0, np.array([1, 0, 0, 1, 1, 0, 1, 1, 1], bool)
    wanted = values[::4, chosen].astype(float).var()
    assert native.variance_of_rows(values, chosen, 4) == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize("frequency_hz", [0.8, 1.9, 30.0])
def test_oscillating_power_is_that_of_peaks_less_the_noise_between_e38(frequency_hz):
    cadence_hz, values, found = np.arange(0.0, 8.0, 0.05), np.abs(random(160, 6)), np.empty(2)
    values[38] += 4.0
    native.oscillating_power(cadence_hz, values, frequency_hz, 0.06, 0.25, found)
    turns = cadence_hz / frequency_hz
    between = (turns > 1.0) & (turns < 4.0) & (np.abs(turns % 1.0 - 0.5) <= 0.2)
    noise = np.median(values[between] ** 2, axis=0) / np.log(2.0) if between.any() else np.zeros(6)
    energy = amplitude = 0.0
    for h in (1, 2, 3):
        near = np.abs(cadence_hz - h * frequency_hz) <= max(0.06 * h * frequency_hz, 0.25)
        if near.any():
            peak = values[near].max(axis=0)
            energy += np.maximum(peak**2 - 2.0 * noise, 0.0).sum()
            amplitude += 2.0 * peak.sum()
    np.testing.assert_allclose(found, [energy, amplitude], rtol=1e-12)


def test_harmonics_of_periods_are_projected_on_their_mean():
    harmonics = random(8, 3, 11) + 1j * random(8, 3, 11, seed=1)
    imaginary, real, rate_hz = Periods(harmonics, np.empty(0), np.arange(8.0), 1.0).phase_parts
    steady = harmonics * np.exp(-2j * np.pi * rate_hz * np.outer(np.arange(8), [1, 2, 3]))[:, :, None]
    wanted = (steady * steady.mean(axis=0).conj()).sum(axis=2)
    np.testing.assert_allclose(imaginary + 1j * real, wanted.imag + 1j * wanted.real.mean(axis=0), atol=1e-13)


def test_share_of_the_power_near_four_harmonics():
    share = random(250) ** 2
    cadence_hz = 0.1 * np.arange(250)
    near = np.min([np.abs(cadence_hz - h * 2.3) for h in (1, 2, 3, 4)], axis=0) <= 0.4
    band = (cadence_hz >= LOWEST_HZ) & (cadence_hz <= SALIENT_HZ)
    wanted = share[band & near].sum() / share[band].sum()
    shares = np.stack([share, np.zeros(250)])
    found = compute_salience(Rhythm(shares, 40.0, shares, 0.1), np.full(2, 2.3), 0.4)
    np.testing.assert_allclose(found, [wanted, 0.0], rtol=1e-12)


@pytest.mark.parametrize("size", [60, 300])
def test_rhythm_evidence_is_that_of_interpolated_numpy(size):
    likeness, share = np.tanh(random(size)), random(400, seed=1) ** 2
    rate_hz, step_hz, grid_hz = 40.0, 0.05, np.array([0.7, 1.9, 7.3])
    found = np.empty((9, 3))
    native.rhythm_evidence(likeness[np.newaxis], rate_hz, share[np.newaxis], step_hz, grid_hz, found)

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
