"""What is read off figures: against closed forms, SciPy and curves whose answer is known."""

import math

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy import signal, stats
from sklearn.metrics import roc_auc_score

from doppelgait.processing import gaussian_window
from doppelgait_liland2018 import measures
from doppelgait_liland2018.drawing import band_hz
from doppelgait_liland2018.scenarios import cohens_d, fit_line, is_wrong, roc_area, tabulate_separation

WAVELENGTH_M = 299_792_458 / 7.29e9
RATE_HZ = 200.0


def signature_of(lines_hz, width_hz=8.0, doppler_hz=None, level=1.0):
    """Columns with Gaussian lines at given Dopplers, shape (J, L) of Hz."""
    doppler = np.linspace(-500, 500, 251) if doppler_hz is None else doppler_hz
    lines = np.atleast_2d(np.asarray(lines_hz, dtype=float))
    values = np.exp(-0.5 * ((doppler[None, :, None] - lines[:, None, :]) / width_hz) ** 2).sum(axis=2)
    times = np.arange(lines.shape[0]) / RATE_HZ
    coords = {"time": times, "doppler": doppler, "velocity": ("doppler", doppler * WAVELENGTH_M / 2)}
    return xr.DataArray(np.asarray(level)[..., None] * values, coords, ("time", "doppler"))


def spectrum(values, bin_hz):
    return xr.DataArray(values, {"cadence": bin_hz * np.arange(len(values))})


def test_side_lobe_of_the_reports_window_against_scipy():
    window = signal.windows.gaussian(40, std=0.3 * 19.5)
    frequency, response = signal.freqz(window, worN=200_000)
    level_db = 20 * np.log10(np.abs(response) / np.abs(response[0]))
    lobes = level_db[signal.argrelmax(level_db)[0]]  # the main lobe's top at 0 is no inner maximum
    assert frequency[0] == 0
    assert lobes.max() == pytest.approx(-65.44, abs=0.01)
    assert measures.side_lobe_db(gaussian_window(40, 0.3)) == pytest.approx(lobes.max(), abs=0.01)


def test_printed_window_is_off_its_centre():
    window = measures.make_printed_window(40, 0.3)
    assert window.argmax() == 19  # m = 20 = M/2, one of two middle frames
    assert window[19] == 1.0
    assert measures.side_lobe_db(window) == pytest.approx(-63.81, abs=0.01)


def test_half_power_width_of_the_analysis_window():
    # E-23: 1.384 bins for M = 101, sigma_w = 0.4
    assert measures.half_power_width_bins(gaussian_window(101, 0.4)) == pytest.approx(1.384, abs=1e-3)


def test_upper_envelope_is_where_the_highest_line_falls_to_the_level():
    top_hz = 150 + 100 * np.sin(np.linspace(0, 20, 400))
    mu = signature_of(np.column_stack([top_hz, np.full(400, 20.0)]))
    reach_hz = 8.0 * math.sqrt(-2 * math.log(0.04))  # exp(-x^2 / 2) = 0.04
    assert measures.upper_envelope_hz(mu, 0.04) - top_hz == pytest.approx(reach_hz, abs=4.0)  # a bin


@pytest.mark.parametrize("steps", [3, 10])
def test_peaks_are_counted_with_those_at_the_ends(steps):
    times = np.arange(1000) / RATE_HZ
    curve = np.cos(2 * np.pi * steps * times / times[-1])  # steps - 1 inside, one at each end
    noisy = curve + 0.1 * np.random.default_rng(0).standard_normal(times.size)
    places = measures.find_peaks(noisy, RATE_HZ, smoothing_s=0.03)
    assert places.size == steps + 1
    assert places[[0, -1]] == pytest.approx([0, 999], abs=20)


def test_oscillation_of_a_line_with_drift():
    times = np.arange(900) / RATE_HZ
    curve = 90 + 5 * times + 12 * np.sin(2 * np.pi * 2.1 * times) + 3 * np.sin(2 * np.pi * 4.2 * times)
    assert measures.main_frequency_hz(curve, RATE_HZ) == pytest.approx(2.1, abs=0.02)


def test_torso_line_follows_the_strongest_row():
    torso_hz = 100 + 15 * np.sin(np.linspace(0, 30, 500))
    mu = signature_of(np.column_stack([torso_hz, 300 + 6 * (torso_hz - 100)]))  # a limb swings wider
    assert measures.torso_line_hz(mu, reach_hz=60.0) == pytest.approx(torso_hz, abs=1.0)


def test_share_near_lines_of_a_gaussian_line():
    mu = signature_of(np.full((50, 1), 100.0), doppler_hz=np.linspace(-500, 500, 2001))
    within = 2 * stats.norm.cdf(15.25 / 8.0) - 1  # cells of 0.5 Hz
    found = measures.share_near_lines(mu, np.full((20, 1), 100.0), np.linspace(0, 0.3, 20), reach_hz=15.0)
    assert found == pytest.approx(within, abs=1e-3)
    assert measures.share_near_lines(mu, np.full((20, 1), -300.0), np.linspace(0, 0.3, 20), reach_hz=15.0) < 1e-6


def test_rise_of_the_columns_is_that_of_the_range():
    range_m = np.linspace(12.0, 4.0, 1000)
    mu = signature_of(np.full((1000, 1), 100.0), level=range_m**-4)
    first, last = (range_m[:100] ** -4).mean(), (range_m[-100:] ** -4).mean()
    assert measures.column_level_rise_db(mu) == pytest.approx(10 * math.log10(last / first), abs=1e-9)


def test_prominence_is_the_peak_over_the_median_about_it():
    values = np.full(200, 0.5)
    values[[40, 80, 120]] = 5.0, 2.0, 0.5  # f_m = 2 Hz; no third harmonic
    found = [measures.prominence_db(spectrum(values, 0.05), 2.0, h) for h in (1, 2, 3)]
    assert found == pytest.approx([20.0, 20 * math.log10(4.0), 0.0], abs=1e-9)


def test_side_lobes_between_the_peaks():
    values = np.full(200, 0.1)
    values[[40, 59, 80]] = 2.0, 0.4, 1.0
    assert measures.side_lobe_of_cadence_db(spectrum(values, 0.05), 2.0) == pytest.approx(20 * math.log10(0.2))


def test_band_goes_from_the_first_to_the_last_crossing():
    level = np.array([0.0, 0.05, 0.03, 1.0, 0.2, 0.039, 0.0])
    assert band_hz(level, np.arange(7.0), 0.04) == (1.0, 4.0)


def test_cohens_d_by_hand_and_without_unknown_values():
    first, second = [1.0, 2.0, 3.0, math.nan], [4.0, 6.0, 8.0]
    pooled = math.sqrt((2 * 1.0 + 2 * 4.0) / 4)
    assert cohens_d(first, second) == pytest.approx((2.0 - 6.0) / pooled)
    assert math.isnan(cohens_d([1.0], [2.0, 3.0]))


def test_roc_area_against_scikit_learn():
    rng = np.random.default_rng(1)
    first, second = rng.integers(0, 12, 80).astype(float), rng.integers(3, 15, 60).astype(float)  # with ties
    expected = roc_auc_score([1] * 80 + [0] * 60, np.concatenate([first, second]))
    assert roc_area(first, second) == pytest.approx(expected, abs=1e-12)
    assert roc_area([2.0, 3.0], [0.0, 1.0]) == 1.0
    assert math.isnan(roc_area([], [1.0]))


def rows(found, true=2.0, seconds=2.0, label="human", method="standard"):
    return pd.DataFrame({
        "gait_frequency_hz": found, "true_gait_frequency_hz": true, "observation_s": seconds, "label": label,
        "method": method,
    })  # fmt: skip


def test_wrong_step_frequencies():
    table = rows([2.0, 2.19, 2.21, 4.0, math.nan])
    assert is_wrong(table, 0.1).tolist() == [False, False, True, True, True]
    assert is_wrong(table, 0.1, bins=1.0).tolist() == [False, False, False, True, True]  # a bin is 0.5 Hz
    assert not is_wrong(rows([1.0], true=math.nan), 0.1).any()


def test_separation_by_method_and_feature():
    table = pd.concat([
        rows([2.0, 2.2, 2.4]), rows([3.0, 3.2, 3.4], label="dog"),
        rows([2.0, 3.0, math.nan], method="liland2018"), rows([2.0, 3.0], label="dog", method="liland2018"),
    ])  # fmt: skip
    found = tabulate_separation(table, ["gait_frequency_hz"], classes=("human", "dog")).set_index("method")
    assert found.loc["standard", "roc_area"] == 0.0
    assert found.loc["standard", "cohens_d"] == pytest.approx(-1.0 / 0.2)
    assert found.loc["standard", "median dog"] == 3.2
    assert found.loc["liland2018", "roc_area"] == 0.5
    assert found.loc["liland2018", "unknown"] == 1


def test_line_through_points_is_not_carried_off_by_a_quarter_of_them():
    x = np.append(np.linspace(0.5, 4.0, 40), math.nan)
    assert fit_line(x, 0.4 * x + 0.1) == pytest.approx((0.4, 0.1))
    off = np.where(np.arange(41) % 4 == 0, 9.0, 0.4 * x + 0.1)
    assert fit_line(x, off) == pytest.approx((0.4, 0.1), abs=0.02)
    assert np.polyfit(x[:40], off[:40], 1)[1] > 1.0  # least squares is
    assert all(math.isnan(value) for value in fit_line([1.0, 1.0, 1.0], [1.0, 2.0, 3.0]))
