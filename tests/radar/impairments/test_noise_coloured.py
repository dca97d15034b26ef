"""Coloured noise and lines in Doppler against the density and the amplitude that they promise."""

import numpy as np
import pytest
from scipy.signal import welch

from doppelgait.radar import Radar
from doppelgait.radar.impairments import ColouredNoise, Spur, apply_impairments

X4 = Radar.preset("x4")


def made(spec: object, n: int, radar: Radar = X4, seed: int = 0) -> np.ndarray:
    silence = np.zeros((n, radar.waveform.n_samples(radar)), complex)
    return apply_impairments(silence, [spec], radar=radar, rng=np.random.default_rng(seed)).matrix


def test_the_density_is_that_of_white_noise_of_the_stated_level() -> None:
    spec = ColouredNoise(levels=((0.0, -60.0), (100.0, -60.0), (200.0, -80.0)))
    noise = made(spec, 8192)
    f_hz, density = welch(noise, fs=X4.prf_hz, nperseg=512, axis=0, return_onesided=False)
    level_db = 10 * np.log10(density.mean(axis=1) * X4.prf_hz)
    for at_hz, expected in ((50, -60), (-50, -60), (150, -70), (-150, -70), (300, -80), (-400, -80)):
        assert level_db[np.argmin(np.abs(f_hz - at_hz))] == pytest.approx(expected, abs=0.4)
    both = noise[:, 3].conj() @ noise[:, 4] / np.linalg.norm(noise[:, 3]) / np.linalg.norm(noise[:, 4])
    assert abs(both) < 0.08


def test_its_end_knows_nothing_of_its_beginning() -> None:
    """A Fourier series repeats, so that the last pulses would go on in the first."""
    noise = made(ColouredNoise(levels=((0.0, -60.0), (5.0, -60.0), (10.0, -120.0))), 1024)
    steps = [np.mean(np.abs(noise[pulse] - noise[pulse - 1]) ** 2) for pulse in (512, 0)]  # neighbours, and both ends
    assert steps[1] > 20 * steps[0]
    both = np.abs(np.sum(noise[0].conj() * noise[-1])) / np.linalg.norm(noise[0]) / np.linalg.norm(noise[-1])
    assert both < 3 / np.sqrt(noise.shape[1])


def test_its_change_over_range() -> None:
    noise = made(ColouredNoise(levels=((0.0, -60.0),), range_db=((2.0, 0.0), (6.0, -20.0))), 4096)
    level_db = 10 * np.log10(np.mean(np.abs(noise) ** 2, axis=0))
    for at_m, expected in ((1.0, -60), (4.0, -70), (8.0, -80)):
        assert level_db[np.argmin(np.abs(X4.range_axis_m() - at_m))] == pytest.approx(expected, abs=0.6)


def test_its_level_is_that_of_a_range_bin_behind_a_window() -> None:
    radar = Radar.preset("ti-77")
    bins = radar.waveform.compress(made(ColouredNoise(levels=((0.0, -60.0),)), 512, radar), radar)
    assert 10 * np.log10(np.mean(np.abs(bins) ** 2)) == pytest.approx(-60.0, abs=0.2)


def test_a_line_has_its_frequency_and_amplitude_in_all_bins() -> None:
    line = made(Spur(frequency_hz=-125.0, level_db=-80.0), 800)
    assert np.ptp(np.abs(line)) < 1e-9
    assert np.abs(line[0, 0]) == pytest.approx(1e-4, rel=1e-4)
    assert np.allclose(line, line[:, :1])
    assert np.angle(line[1:, 0] / line[:-1, 0]) == pytest.approx(-2 * np.pi * 125 / 1000, abs=1e-4)
    other = made(Spur(frequency_hz=-125.0, level_db=-80.0), 800, seed=1)
    assert abs(np.angle(other[0, 0] / line[0, 0])) > 1e-3  # a phase of its own
