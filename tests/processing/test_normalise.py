"""Noise floor and column normalisation (E-28)."""

import numpy as np
import pytest

from doppelgait import processing
from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import BASEBAND, SIGNATURE, make_array
from doppelgait.core.rng import Streams
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.pipeline import simulate
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target

W2 = (processing.gaussian_window(101, 0.4) ** 2).sum()
SPACING_M = 0.05


def noise_signature(n_gate, *, seed=0, power=1e-6, doppler_bins=128, seconds=5.0, echo=0.0, taps=(1.0,)):
    """Signature of white noise, with an optional line at 100 Hz, gate of n_gate bins."""
    rng = np.random.default_rng(seed)
    n_pulses = round(seconds * 1000)
    y = np.sqrt(power / 2) * (rng.standard_normal((n_pulses, n_gate + len(taps) - 1, 2)) @ np.array([1, 1j]))
    y = np.apply_along_axis(np.convolve, 1, y, taps, mode="valid")
    t = np.arange(n_pulses) / 1000
    y[:, n_gate // 2] += echo * np.exp(2j * np.pi * 100 * t)
    padded = np.zeros((n_pulses, n_gate + 2), np.complex64)
    padded[:, 1:-1] = y
    coords = {"slow_time": t, "range": SPACING_M * np.arange(n_gate + 2)}
    span_m = max((n_gate - 1) * SPACING_M, 1e-3)
    gate = processing.Gate.around(t, np.full(t.size, SPACING_M * (n_gate + 1) / 2), span_m=span_m, source="given")
    sharp = processing.Analysis(doppler_bins=doppler_bins, gate_edges="sharp")
    mu = processing.signature(make_array(BASEBAND, padded, coords), gate, sharp, wavelength_m=0.04)
    assert mu.attrs["n_gate_bins"] == n_gate
    return mu


@pytest.mark.parametrize("taps", [(1.0,), (0.5, 0.7, 0.5), (0.2, 0.5, 0.7, 0.5, 0.2)])
def test_independent_bins_are_counted_from_correlated_noise_e27(taps):
    # a sum of n exponential variables whose amplitudes correlate with rho_l: mean^2 / var = n^2 / sum |rho_ij|^2
    n = 20
    share = np.correlate(taps, taps, mode="full")[len(taps) - 1 :] / np.dot(taps, taps)
    rho = np.array([[share[abs(i - j)] if abs(i - j) < share.size else 0.0 for j in range(n)] for i in range(n)])
    found = [
        processing.count_independent_bins(mu, processing.noise_floor_v2(mu))
        for mu in (noise_signature(n, seed=s, echo=1e-2, taps=taps) for s in range(4))
    ]
    assert np.mean(found) == pytest.approx(n**2 / (rho**2).sum(), rel=0.06)


def test_bins_are_as_stated_where_there_are_few_quiet_rows_e27():
    mu = noise_signature(6)
    full = mu.copy(data=np.where(np.arange(128) < 11, mu.values, 1.0))
    assert processing.count_independent_bins(full, processing.noise_floor_v2(mu)) == 6.0


@pytest.mark.parametrize("n_gate", [1, 20, 32])
@pytest.mark.parametrize("doppler_bins", [128, 512])
def test_floor_of_noise_alone_e28(n_gate, doppler_bins):
    wanted = n_gate * 1e-6 * W2
    estimates = [
        processing.noise_floor_v2(noise_signature(n_gate, seed=s, doppler_bins=doppler_bins)) for s in range(4)
    ]
    assert estimates == pytest.approx([wanted] * 4, rel=0.02)


# a gate across a bin edge sums parts of two variables: up to 12 % above the law of one
@pytest.mark.parametrize(
    ("snr_db", "settings", "rel"),
    [
        *((snr_db, {}, 0.05) for snr_db in (0.0, 10.0, 20.0, 30.0)),
        *((10.0, {"gate_span_m": span_m}, 0.12) for span_m in (0.01, 0.03, 0.2)),
    ],
)
def test_floor_under_a_walker_e28(snr_db, settings, rel):
    analysis = processing.Analysis(**settings)
    scene = Scene([Target(boulic_walk(speed_mps=1.2, height_m=1.8, duration_s=4.0))])
    recording = simulate(scene, Radar.preset("x4"), rng=Streams(1), snr_db=snr_db)
    gate = processing.Gate.from_truth(recording.truth[0], recording.slow_time_s, analysis)
    mu = processing.signature(recording.baseband, gate, analysis, wavelength_m=recording.radar.wavelength_m)
    n_gate = mu.attrs["n_gate_bins"] / recording.independent_bin_share  # the attribute counts independent ones
    wanted = n_gate * recording.noise_power_v2 * W2
    assert processing.noise_floor_v2(mu) == pytest.approx(wanted, rel=rel)


def small_signature(values, centre_range_m=5.0, n_gate=4):
    values = np.asarray(values, dtype=float)
    n_columns, k = values.shape
    doppler_hz = (np.arange(k) - k // 2) * 10.0
    coords = {
        "time": 0.05 + np.arange(n_columns) * 0.01,
        "doppler": doppler_hz,
        "velocity": ("doppler", doppler_hz * 0.02),
        "centre_range": ("time", np.broadcast_to(centre_range_m, n_columns)),
    }
    return make_array(SIGNATURE, values, coords, {"n_gate_bins": n_gate})


def test_columns_over_their_maximum_e28():
    found = processing.normalise(small_signature([[1, 5, 3], [1, 1, 9]]), 0.0, mode="max")
    np.testing.assert_allclose(found.values, [[0.2, 1, 0.6], [1 / 9, 1 / 9, 1]])


def test_fourth_power_of_range_undoes_the_radar_equation_e28():
    range_m = np.linspace(4, 8, 5)
    pattern = np.array([1.0, 3.0, 2.0])
    found = processing.normalise(small_signature(pattern / range_m[:, None] ** 4, range_m), 0.0, mode="r4").values
    np.testing.assert_allclose(found, np.tile(found[0], (5, 1)), rtol=1e-12)
    np.testing.assert_allclose(found[0] / found[0].sum(), pattern / 6)


def test_unknown_normalisation_is_refused():
    with pytest.raises(AnalysisError, match=r"'mean'.*sum, max and r4"):
        processing.normalise(small_signature(np.ones((3, 3))), 0.0, mode="mean")


def test_independent_columns_are_60_ms_apart_e38():
    assert processing.count_independent_columns(noise_signature(4, seconds=3.1)) == pytest.approx(3.0 / 0.06, rel=0.01)
    assert processing.count_independent_columns(small_signature(np.ones((2, 3)))) == 1.0
