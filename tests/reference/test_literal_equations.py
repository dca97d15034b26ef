"""The package against the literal float64 loops of literal.py."""

import numpy as np
import pytest

import literal
from doppelgait import processing
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.radar import Radar, echo_amplitude_v, synthesise, synthesise_rf
from echo_table import range_table

PRF_HZ = 1000.0
SPACING_M = 0.05
FIRST_M = 1.0
WAVELENGTH_M = 0.0411238


def echoes_in_noise(n_pulses, n_bins, seed=3):
    """Two crossing echoes and noise 20 dB below, complex64."""
    rng = np.random.default_rng(seed)
    bins = np.arange(n_bins)
    t = np.arange(n_pulses)[:, None] / PRF_HZ
    y = np.zeros((n_pulses, n_bins), dtype=complex)
    for start, speed, level in ((n_bins * 0.3, 20.0, 1.0), (n_bins * 0.7, -12.0, 0.4)):
        place = start + speed * t
        doppler_hz = -2 * speed * SPACING_M / WAVELENGTH_M
        y += level * np.exp(-0.5 * ((bins - place) / 1.5) ** 2) * np.exp(2j * np.pi * doppler_hz * t)
    y += 0.1 * (rng.standard_normal(y.shape) + 1j * rng.standard_normal(y.shape)) / np.sqrt(2)
    return y.astype(np.complex64)


def labelled(y):
    coords = {"slow_time": 0.3 + np.arange(y.shape[0]) / PRF_HZ, "range": FIRST_M + SPACING_M * np.arange(y.shape[1])}
    return make_array(BASEBAND, y, coords)


# (M, K, hop, zero padding at the ends, pulses)
TRANSFORMS = [
    (101, 101, 8, False, 160),
    (101, 108, 8, False, 180),
    (101, 128, 8, False, 420),
    (101, 160, 1, False, 140),
    (101, 512, 8, False, 130),
    (31, 101, 5, False, 100),
    (31, 31, 1, True, 45),
    (101, 128, 10, True, 130),
    (101, 109, 7, True, 110),
    (7, 512, 3, False, 40),
]


@pytest.mark.parametrize(("m", "k", "hop", "padded", "n_pulses"), TRANSFORMS)
def test_signature_equals_the_literal_loop_e22_e24_e27(m, k, hop, padded, n_pulses):
    n_bins = 9
    y = echoes_in_noise(n_pulses, n_bins)
    edges = {"method": "liland2018"} if padded else {"gate_edges": "sharp"}
    analysis = processing.Analysis(cpi_s=(m - 0.5) / PRF_HZ, doppler_bins=k, hop=hop, window_steepness=0.4, **edges)
    # a gate of 3 bins that walks across the frame and leaves it on both sides
    slow_time_s = 0.3 + np.arange(n_pulses) / PRF_HZ
    centre_m = np.linspace(FIRST_M - 0.021, FIRST_M + 0.4317, n_pulses)
    gate = processing.Gate.around(slow_time_s, centre_m, span_m=0.13, source="given")
    found = processing.signature(labelled(y), gate, analysis, wavelength_m=WAVELENGTH_M)

    h = (m - 1) // 2
    centres = range(0, n_pulses, hop) if padded else range(h, n_pulses - h, hop)
    low_m = centre_m[list(centres)] - 0.13 / 2
    first = np.ceil((low_m - FIRST_M) / SPACING_M).astype(int)
    n_gate = int(np.floor(0.13 / SPACING_M)) + 1
    wanted = literal.signature(y, list(centres), first, n_gate, literal.window(m, 0.4), k)
    assert found.shape == wanted.shape
    assert found.attrs["n_gate_bins"] == n_gate
    np.testing.assert_allclose(found.coords["time"], slow_time_s[list(centres)], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.coords["doppler"], literal.doppler_axis_hz(k, PRF_HZ), atol=1e-9)
    assert len(np.unique(first)) > 2
    assert literal.relative_l2(found.values, wanted) < 1e-6


@pytest.mark.parametrize("hop", [1, 7])
def test_signature_with_fractional_edges_weighs_cells_by_the_share_inside_e27(hop):
    n_pulses, n_bins = 400, 9
    y = echoes_in_noise(n_pulses, n_bins)
    slow_time_s = 0.3 + np.arange(n_pulses) / PRF_HZ
    centre_m = np.linspace(FIRST_M - 0.021, FIRST_M + 0.4317, n_pulses)
    gate = processing.Gate.around(slow_time_s, centre_m, span_m=0.13, source="given")
    found = processing.signature(
        labelled(y), gate, processing.Analysis(doppler_bins=128, hop=hop), wavelength_m=WAVELENGTH_M
    )

    window = literal.window(101, 0.4)
    for j, centre in enumerate(range(50, n_pulses - 50, hop)):
        low, high = ((centre_m[centre] + side * 0.065 - FIRST_M) / SPACING_M for side in (-1, 1))
        share = [max(0.0, min(high, n + 0.5) - max(low, n - 0.5)) for n in range(n_bins)]
        spectrum = np.fft.fft(y[centre - 50 : centre + 51] * window[:, None], 128, axis=0)
        wanted = np.fft.fftshift((np.abs(spectrum) ** 2 * share).sum(axis=1))
        np.testing.assert_allclose(found.values[j], wanted, rtol=1e-4, atol=1e-6 * wanted.max() + 1e-30)
    assert found.attrs["n_gate_bins"] == pytest.approx(0.13 / SPACING_M)


@pytest.mark.parametrize(("m", "k"), [(101, 101), (101, 128), (31, 512)])
def test_range_doppler_cells_equal_the_literal_loop_e24(m, k):
    y = echoes_in_noise(m + 20, 5)
    analysis = processing.Analysis(cpi_s=(m - 0.5) / PRF_HZ, doppler_bins=k, hop=10)
    found = next(processing.range_doppler(labelled(y), analysis, wavelength_m=WAVELENGTH_M)).values
    w = literal.window(m, 0.4)
    h = (m - 1) // 2
    y = y.astype(np.complex128)
    wanted = np.array(
        [[literal.range_doppler_cells(y, h + 10 * j, q, range(5), w, k) for q in range(k)] for j in range(3)]
    )
    assert found.shape == wanted.shape
    assert literal.relative_l2(found, wanted) < 1e-6


@pytest.mark.parametrize("k", [101, 128])
@pytest.mark.parametrize("padded", [True, False])
def test_step_doppler_map_equals_the_literal_loop_e28_e30_e31_e32(k, padded):
    y = echoes_in_noise(1000, 9)
    analysis = processing.Analysis(doppler_bins=k, hop=20, gate_edges="sharp")
    centre_m = np.full(1000, FIRST_M + 4 * SPACING_M)
    gate = processing.Gate.around(0.3 + np.arange(1000) / PRF_HZ, centre_m, span_m=0.23, source="given")
    mu = processing.signature(labelled(y), gate, analysis, wavelength_m=WAVELENGTH_M)
    floor = 0.05 * float(mu.values.mean())
    seconds = mu.sizes["time"] * 20 / PRF_HZ  # 0.9 s
    rows = processing.detrend(processing.normalise(mu, floor), order=processing.detrend_order(seconds))
    found = processing.cadence_map(rows, padded=padded)

    centres = list(range(50, 950, 20))
    first = [int(np.ceil((4 * SPACING_M - 0.115) / SPACING_M))] * len(centres)
    mu_literal = literal.signature(y, centres, first, 5, literal.window(101, 0.4), k)
    rows_literal = literal.detrended(literal.normalised_by_sum(mu_literal, floor), order=1)
    cadence_hz = found.coords["cadence"].values
    n_fft = round(PRF_HZ / 20 / cadence_hz[1])
    assert n_fft >= 8 * len(centres) if padded else n_fft == len(centres)
    assert cadence_hz[0] == 0
    wanted = literal.cadence_map(rows_literal, np.ones(len(centres)), n_fft, len(cadence_hz))
    assert literal.relative_l2(found.values, wanted) < 1e-6
    np.testing.assert_allclose(processing.cadence_spectrum(found), (found.values**2).sum(axis=1), rtol=1e-12)
    np.testing.assert_allclose(processing.cadence_spectrum(found, power=False), found.values.sum(axis=1), rtol=1e-12)


@pytest.mark.parametrize("decimation", [1, 8])
@pytest.mark.parametrize("pulse_sigma_s", [0.345e-9, 1e-9])
def test_closed_form_equals_rf_sampling_and_down_conversion_e16_e17(decimation, pulse_sigma_s):
    radar = Radar.preset("x4", decimation=decimation, pulse_sigma_s=pulse_sigma_s, range_start_m=2.0, range_stop_m=4.0)
    radar = radar.model_copy(update={"integration_share": 0.0})  # the places of a pulse have no velocity
    rng = np.random.default_rng(2)
    for theta_rad in (0.0, 1.3):
        turned = radar.model_copy(update={"transmit_phase_rad": theta_rad})
        # one scatterer at a time and three together; the last near the end of the frame, its tail cut
        for range_m in ([[2.9]], [[3.2345]], [[2.5, 3.1, 3.98]]):
            ranges = np.asarray(range_m) + rng.uniform(0, 0.05, (3, 1))
            table = range_table(ranges, 0.4)
            closed = synthesise(table, turned).values
            peak = np.abs(closed).max()
            assert np.abs(closed - synthesise_rf(table, turned).values).max() < 1e-4 * peak  # -80 dB
            mine = literal.rf_baseband(
                ranges,
                echo_amplitude_v(turned, range_m=ranges, rcs_m2=0.4),
                turned.range_axis_m(),
                sigma_s=pulse_sigma_s,
                carrier_hz=7.29e9,
                sample_rate_hz=23.328e9,
                decimation=decimation,
                theta_rad=theta_rad,
            )
            assert np.abs(closed - mine).max() < 1e-4 * peak
