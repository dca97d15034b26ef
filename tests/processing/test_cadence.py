"""Detrending, step-Doppler map, cadence spectrum (E-30 to E-32)."""

import numpy as np
import pytest

from doppelgait import processing
from doppelgait.core.labels import NORMALISED_SIGNATURE, Signal, make_array
from doppelgait.processing.cadence import CadenceParts, compute_magnitudes, sum_powers

RATE_HZ = 100.0


def rows_of(values, rate_hz=RATE_HZ):
    values = np.asarray(values, dtype=float)
    doppler_hz = (np.arange(values.shape[1]) - values.shape[1] // 2) * 10.0
    coords = {
        "time": 0.05 + np.arange(values.shape[0]) / rate_hz,
        "doppler": doppler_hz,
        "velocity": ("doppler", doppler_hz * 0.02),
    }
    return make_array(NORMALISED_SIGNATURE, values, coords)


def wave(frequency_hz, seconds, amplitude=1.0, rate_hz=RATE_HZ):
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    return (amplitude * np.cos(2 * np.pi * frequency_hz * t + 0.3))[:, None] * np.array([[1.0, 0.5, 0.0]])


def test_observation_time_is_columns_times_their_spacing():
    assert processing.observation_s(rows_of(np.ones((250, 3)))) == pytest.approx(2.5)


@pytest.mark.parametrize(
    ("seconds", "order"), [(0.3, 1), (1.0, 1), (1.3, 2), (2.0, 2), (3.0, 4), (4.0, 5), (5.0, 6), (60.0, 6)]
)
def test_order_of_the_detrending_e31(seconds, order):
    assert processing.detrend_order(seconds) == order


def test_detrending_removes_polynomials_and_nothing_else_e31():
    t = np.linspace(-1, 1, 300)[:, None]
    polynomial = 2 - t + 3 * t**2 + 0.5 * t**3
    rows = rows_of(polynomial * np.ones((1, 3)))
    np.testing.assert_allclose(processing.detrend(rows, order=3).values, 0, atol=1e-12)
    assert np.abs(processing.detrend(rows, order=2).values).max() > 0.05
    random = np.random.default_rng(0).standard_normal((300, 3))
    once = processing.detrend(rows_of(random), order=4)
    np.testing.assert_allclose(processing.detrend(once, order=4).values, once.values, atol=1e-12)
    np.testing.assert_allclose(
        processing.detrend(rows_of(random), order=0).values, random - random.mean(axis=0), atol=1e-12
    )


def test_zeroth_line_is_the_mean_e30():
    values = np.random.default_rng(1).random((300, 3))
    found = processing.cadence_map(rows_of(values), tapered=False)
    np.testing.assert_allclose(found.values[0], values.mean(axis=0))
    np.testing.assert_allclose(processing.mean_doppler_spectrum(rows_of(values)), values.mean(axis=0))


@pytest.mark.parametrize(("seconds", "tapered"), [(2.0, False), (3.9, False), (4.0, True), (4.1, True), (6.0, True)])
def test_taper_is_rectangular_below_4_s_and_hann_from_there_e30(seconds, tapered):
    found = processing.cadence_map(rows_of(wave(10.0, seconds)))
    cadence_hz = found.coords["cadence"].values
    row = found.values[:, 0] / found.values[:, 0].max()
    distance = np.abs(cadence_hz - 10.0) * seconds
    # highest side lobe: -13.3 dB beyond 1 / T_o (rectangle), -31.5 dB beyond 2 / T_o (Hann)
    if tapered:
        assert 20 * np.log10(row[distance > 2.1].max()) == pytest.approx(-31.5, abs=0.5)
    else:
        assert 20 * np.log10(row[distance > 1.05].max()) == pytest.approx(-13.3, abs=0.3)


def test_four_seconds_are_four_seconds_at_every_column_rate_and_start():
    for rate_hz in (99.0, 100.0, 111.11, 120.0, 125.0, 1000 / 7, 130.0, 162.5, 1000.0):
        n = int(np.ceil(4.0 * rate_hz - 1e-9))
        for start_s in (0.0, 0.05, 0.0505, 0.3, 1.7, 12.34):
            rows = rows_of(wave(5.0, n / rate_hz, rate_hz=rate_hz), rate_hz)
            rows = rows.assign_coords(time=start_s + np.arange(n) / rate_hz)
            found, wanted = processing.cadence_map(rows), processing.cadence_map(rows, tapered=True)
            np.testing.assert_array_equal(found.values, wanted.values, err_msg=f"{rate_hz} Hz from {start_s} s")


@pytest.mark.parametrize(("n_columns", "n_rows", "gap"), [(300, 8, 0), (613, 7, 0), (1500, 9, 0), (613, 7, 90)])
def test_spectrum_and_rows_are_those_of_the_whole_map_e30_e32(n_columns, n_rows, gap):
    plain = Signal.of(
        rows_of(np.random.default_rng(n_columns).standard_normal((n_columns, n_rows))), NORMALISED_SIGNATURE
    )
    sides = np.where((np.arange(n_columns) >= 200) & (np.arange(n_columns) < 200 + gap), 3, 0)
    plain.values[sides == 3], plain.coords["other_sides"] = 0.0, (("time",), sides, {})
    parts, t = CadenceParts(plain, 2), np.arange(n_columns)[sides < 3]
    fitted = np.polynomial.polynomial.polyval(t, np.polynomial.polynomial.polyfit(t, plain.values[t], 2)).T
    np.testing.assert_allclose(parts.detrend().values[t], plain.values[t] - fitted, atol=1e-9)
    assert processing.cadence_map(plain.replace(0.0 * plain.values + (sides < 3)[:, None])).values[0] == pytest.approx(
        1.0
    )
    np.testing.assert_array_equal(parts.detrend().values, processing.detrend(plain, order=2).values)
    whole, power = processing.cadence_map(processing.detrend(plain, order=2)), parts.spectrum()
    spectrum = processing.cadence_spectrum(whole)
    np.testing.assert_array_equal(power.axis("cadence"), spectrum.axis("cadence"))
    np.testing.assert_allclose(power.values, spectrum.values, rtol=0, atol=1e-12 * spectrum.values.max())
    cadence_hz, found = parts.rows(np.array([1, 4]), 7.3)
    assert cadence_hz[-2] <= 7.3 < cadence_hz[-1]
    np.testing.assert_array_equal(cadence_hz, whole.axis("cadence")[: cadence_hz.size])
    wanted = whole.values[: cadence_hz.size, [1, 4]]
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * whole.values.max())


@pytest.mark.parametrize("n_rows", [5, 64, 70])
@pytest.mark.parametrize(
    ("n_columns", "length", "n_kept"),
    # smeared in time (step 9, 8, 3) and interpolated; interpolated by 4, 3, 2; plain where nothing else fits; all lines
    [(4900, 39366, 788), (800, 6400, 129), (1334, 10800, 649), (613, 5000, 801), (301, 2430, 784), (262, 2106, 260),
     (1953, 15625, 500), (300, 2400, 1201), (13, 108, 18), (2, 16, 9), (10, 80, 2), (500, 500, 41), (22, 176, 89),
     (100, 800, 100)],
)  # fmt: skip
def test_lowest_lines_are_those_of_the_full_transform_to_rounding(n_columns, length, n_kept, n_rows):
    rng = np.random.default_rng(n_columns)
    values, weights = rng.standard_normal((n_columns, n_rows)), rng.uniform(0.1, 1.0, n_columns)
    compute_magnitudes(values, weights, length, n_kept)
    for held in vars(processing.cadence._buffers).values():  # memory that is used again leaves nothing behind
        held[:] = np.nan
    wanted = np.abs(np.fft.rfft(values * weights[:, None], length, axis=0)[:n_kept])
    found = compute_magnitudes(values, weights, length, n_kept)
    assert found.shape == wanted.shape
    assert np.abs(found - wanted).max() < 1e-12 * wanted.max()
    powers = sum_powers(values, weights, length, n_kept)
    assert np.abs(powers - (wanted**2).sum(axis=1)).max() < 1e-12 * (wanted**2).sum(axis=1).max()
    # a strong wave beyond the lines asked for stays out of them as far as in the full transform
    if length > 12 * n_kept:
        high = 1e3 * np.cos(2 * np.pi * (0.4 * length) * np.arange(n_columns) / length)[:, None] * np.ones((1, 2))
        wanted = np.abs(np.fft.rfft(high, length, axis=0)[:n_kept])
        np.testing.assert_allclose(
            compute_magnitudes(high, np.ones(n_columns), length, n_kept), wanted, rtol=0, atol=1e-9
        )
