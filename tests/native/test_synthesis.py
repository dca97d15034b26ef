"""The synthesis kernel against the literal float64 loop, and its independence of tiles (E-13, E-18)."""

import numpy as np
import pytest

from doppelgait._core import native
from literal import relative_l2

C_MPS = 299_792_458.0
WAVELENGTH_M = C_MPS / 7.29e9
FULL_RATE_M = C_MPS / (2 * 23.328e9)
X4_M = 0.345e-9 * C_MPS / 2
SUPPORT_SIGMAS = 5.5
"""An echo is cut where its envelope is below 2.7e-7 of its peak."""
NANOSECOND_M = 1e-9 * C_MPS / 2
BEYOND_M = np.array([0.01, 0.3, 0.8])


def literal(range_m, amplitude, first_m, spacing_m, sigma_m, wavelength_m, phase_rad, n_bins):
    """E-18 in float64, uncut, one frame and one scatterer after the other."""
    axis_m = first_m + spacing_m * np.arange(n_bins)
    y = np.zeros((range_m.shape[0], n_bins), dtype=np.complex128)
    for i in range(range_m.shape[0]):
        for r, a in zip(range_m[i], amplitude[i], strict=True):
            envelope = np.exp(-((axis_m - r) ** 2) / (2 * sigma_m**2))
            y[i] += a * envelope * np.exp(1j * (phase_rad - 4 * np.pi * (r % wavelength_m) / wavelength_m))
    return y


def synthesise(range_m, amplitude, radar, n_bins, n_frames=None):
    """Return (frames, bins) complex."""
    planes = np.full((2, n_bins, n_frames or len(range_m)), np.nan, np.float32)
    native.echo_planes(range_m, amplitude, *radar, planes[0], planes[1], None)
    return (planes[0] + 1j * planes[1]).T


def walkers(n_frames, n_scatterers, *, speed_mps=1.5, start_m=(2.0, 8.0), seed=0):
    """Scatterers that walk and swing, 1000 frames a second, with amplitudes that change."""
    rng = np.random.default_rng(seed)
    t = np.arange(n_frames)[:, None] / 1000
    swing = 0.2 * np.sin(2 * np.pi * (t + rng.uniform(0, 1, n_scatterers)))
    range_m = rng.uniform(*start_m, n_scatterers) + speed_mps * t + swing
    return range_m, rng.uniform(0.1, 1, n_scatterers) * (1 + 0.1 * np.cos(7 * t))


def radar_of(spacing_m, sigma_m, first_m=0.0, phase_rad=0.4):
    return first_m, spacing_m, sigma_m, WAVELENGTH_M, phase_rad


CASES = {
    "x4": (8 * FULL_RATE_M, X4_M, 1.5),
    "x4 at the full rate": (FULL_RATE_M, X4_M, 1.5),
    "one nanosecond": (8 * FULL_RATE_M, NANOSECOND_M, 1.5),
    "one nanosecond at the full rate": (FULL_RATE_M, NANOSECOND_M, 1.5),
    "fast": (8 * FULL_RATE_M, X4_M, 60.0),
    "so fast that a block spans hundreds of bins": (FULL_RATE_M, X4_M, -60.0),
    "narrowest pulse": (0.05, 0.3 * 0.05, 1.5),
    "widest pulse": (FULL_RATE_M, 60 * FULL_RATE_M, 1.5),
}


@pytest.mark.parametrize("case", CASES)
def test_planes_equal_the_literal_loop_and_end_with_zeros_e18(case):
    spacing_m, sigma_m, speed_mps = CASES[case]
    range_m, amplitude = walkers(70, 9, speed_mps=speed_mps)
    n_bins = int(np.ceil(9.6 / spacing_m))
    radar = radar_of(spacing_m, sigma_m)
    wanted = literal(range_m, amplitude, *radar, n_bins)
    found = synthesise(range_m, amplitude, radar, n_bins)
    assert relative_l2(found, wanted) < 3e-7
    planes = synthesise(range_m, amplitude, radar, n_bins, 96)
    np.testing.assert_array_equal(planes[:70], found)
    assert not planes[70:].any()


@pytest.mark.parametrize("n_frames", [1, 2, 31, 32, 33, 95])
@pytest.mark.parametrize("n_scatterers", [1, 3])
@pytest.mark.parametrize("n_bins", [1, 2, 63, 64, 65, 130])
def test_any_shape_equals_the_literal_loop_e18(n_frames, n_scatterers, n_bins):
    radar = radar_of(0.0514, X4_M, first_m=2.0)
    range_m, amplitude = walkers(n_frames, n_scatterers, start_m=(2.0, 2.0 + 0.0514 * n_bins))
    range_m[0, 0] = 2.01  # at least one echo is inside
    found = synthesise(range_m, amplitude, radar, n_bins)
    # against the peak, not the L2 norm: a frame of one or two bins may hold nothing but tails, which the cut shortens
    assert np.abs(found - literal(range_m, amplitude, *radar, n_bins)).max() < 5e-7 * amplitude.max()


def test_ranges_that_jump_anywhere_from_frame_to_frame_e18():
    rng = np.random.default_rng(4)
    range_m = rng.uniform(-2, 12, (100, 7))
    range_m[::9, 0] = 1e12
    range_m[5::9, 1] = -1e300
    radar = radar_of(8 * FULL_RATE_M, X4_M)
    found = synthesise(range_m, np.ones((100, 7)), radar, 187)
    near = np.where(np.abs(range_m) < 100, range_m, 100.0)
    assert relative_l2(found, literal(near, np.ones((100, 7)), *radar, 187)) < 3e-7


@pytest.mark.parametrize(("spacing_m", "sigma_m"), [(0.05, 0.15), (0.0514, 0.0517), (0.0064, 0.0517), (0.2, 0.05)])
def test_envelope_and_tails_of_scatterers_outside_the_frame_e15_e18(spacing_m, sigma_m):
    """Relative to the echo at every bin; the tail up to the cut is written, and nothing of what is farther away."""
    n_bins = int(np.ceil(3.0 / spacing_m))
    radar, last_m = radar_of(spacing_m, sigma_m, first_m=1.0), 1.0 + spacing_m * (n_bins - 1)
    for range_m in (2.0, 2.0 + 0.3 * spacing_m, 1.0, last_m, *(1.0 - BEYOND_M), *(last_m + BEYOND_M)):
        found = synthesise(np.array([[range_m]]), np.ones((1, 1)), radar, n_bins)
        wanted = literal(np.array([[range_m]]), np.ones((1, 1)), *radar, n_bins)
        assert np.abs(found - wanted).max() < 4e-7
        near = np.abs(1.0 + spacing_m * np.arange(n_bins) - range_m) < SUPPORT_SIGMAS * sigma_m
        np.testing.assert_allclose(found[0, near], wanted[0, near], rtol=1e-5)
        assert found.any() == near.any()
    cut_m = SUPPORT_SIGMAS * sigma_m
    for range_m in (1.0 - cut_m - 1e-4, last_m + cut_m + 1e-4, -1e9, 1e9):
        assert not synthesise(np.array([[range_m]]), np.ones((1, 1)), radar, n_bins).any()


def test_the_cut_is_exact_in_every_frame_however_far_its_neighbours_reach_e18():
    range_m = 3.0 + np.linspace(-2, 2, 64)[:, None]
    y = synthesise(range_m, np.ones_like(range_m), radar_of(0.05, 0.08), 120)
    distance = np.abs(0.05 * np.arange(120) - range_m)
    np.testing.assert_array_equal(y != 0, distance < SUPPORT_SIGMAS * 0.08)


@pytest.mark.parametrize("case", ["x4", "one nanosecond at the full rate", "fast", "narrowest pulse"])
def test_no_byte_depends_on_the_tiling(case):
    spacing_m, sigma_m, speed_mps = CASES[case]
    radar = radar_of(spacing_m, sigma_m)
    n_bins = int(np.ceil(9.6 / spacing_m))
    range_m, amplitude = walkers(333, 6, speed_mps=speed_mps)
    every = synthesise(range_m, amplitude, radar, n_bins)
    assert every[:30].any(axis=1).all()
    rng = np.random.default_rng(9)
    for first in rng.integers(0, 332, 12):
        frames = slice(first, int(rng.integers(first + 1, 334)))
        found = synthesise(range_m[frames], amplitude[frames], radar, n_bins)
        assert np.ascontiguousarray(found).tobytes() == np.ascontiguousarray(every[frames]).tobytes()


def test_phase_and_range_are_split_in_double_precision_e13():
    """The error does not grow with range: at 10 km a float32 would not even hold the bin."""
    range_m = 10_000.0 + np.linspace(0, 0.3, 64)[:, None]
    radar = radar_of(FULL_RATE_M, X4_M, first_m=9_999.5)
    found = synthesise(range_m, np.ones_like(range_m), radar, 200)
    assert relative_l2(found, literal(range_m, np.ones_like(range_m), *radar, 200)) < 3e-7


def test_a_record_without_frames_or_scatterers_is_silent():
    for shape in ((0, 3), (40, 0)):
        assert not synthesise(np.ones(shape), np.ones(shape), radar_of(0.05, 0.05), 30).any()
        assert not synthesise(np.ones(shape), np.ones(shape), radar_of(0.05, 0.05), 30, 50).any()
