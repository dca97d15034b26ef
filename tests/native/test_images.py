"""Images by one and by two reflections against NumPy, with complex path amplitudes."""

import numpy as np
import pytest

from doppelgait._core import native


@pytest.mark.parametrize("n", [1, 3, 8, 13])
def test_images_in_a_table_are_those_of_their_paths(n):
    rng = np.random.default_rng(n)
    towards, mirrored = rng.normal(size=(2, 30, n, 3))
    direct_m, image_m = rng.uniform(0.2, 4.0, (2, 30, n))
    direct_mps, image_mps = rng.normal(size=(2, 30, n))
    reflection = rng.normal(size=(30, n)) + 1j * rng.normal(size=(30, n))
    before = rng.uniform(0.5, 2.0, (6, 30, 3 * n + 2))
    table = list(before.copy())
    least_m, place = 0.7, n + 1
    one, two = slice(place, place + n), slice(place + n, place + 2 * n)
    native.fill_images(
        [direct_m, direct_mps, *np.moveaxis(towards, -1, 0)],
        [image_m, image_mps, *np.moveaxis(mirrored, -1, 0)],
        reflection.real,
        reflection.imag,
        least_m,
        place,
        table,
    )
    range_m, velocity_mps, azimuth_rad, elevation_rad, gain, phase = table
    np.testing.assert_allclose(range_m[:, one], (direct_m + image_m) / 2.0, rtol=1e-15)
    np.testing.assert_allclose(range_m[:, two], image_m, rtol=0)
    np.testing.assert_allclose(velocity_mps[:, one], (direct_mps + image_mps) / 2.0, rtol=1e-15)
    np.testing.assert_allclose(velocity_mps[:, two], image_mps, rtol=0)
    mean = towards / direct_m[..., np.newaxis] + mirrored / image_m[..., np.newaxis]
    for columns, seen in ((one, mean), (two, mirrored)):
        x, y, z = np.moveaxis(seen, -1, 0)
        np.testing.assert_allclose(azimuth_rad[:, columns], np.arctan2(y, x), atol=1e-14)
        np.testing.assert_allclose(elevation_rad[:, columns], np.arctan2(z, np.hypot(x, y)), atol=1e-14)
    # two paths by one reflection add in phase; the path by two has the reflection twice
    mean_m = np.maximum((direct_m + image_m) / 2.0, least_m)
    factor = mean_m**2 / (np.maximum(direct_m, least_m) * np.maximum(image_m, least_m))
    for columns, amplitude in ((one, 2.0 * reflection * factor), (two, reflection**2)):
        np.testing.assert_allclose(gain[:, columns], before[4][:, columns] * np.abs(amplitude) ** 2, rtol=1e-13)
        turned = np.exp(1j * (phase - before[5])[:, columns])
        np.testing.assert_allclose(turned, amplitude / np.abs(amplitude), atol=1e-13)
    for now, then in zip(table, before, strict=True):
        np.testing.assert_array_equal(now[:, :place], then[:, :place])
        np.testing.assert_array_equal(now[:, place + 2 * n :], then[:, place + 2 * n :])


@pytest.mark.parametrize("n", [1, 3, 8, 13])
def test_ranges_of_images_are_those_of_mirrored_points(n):
    rng = np.random.default_rng(n)
    step_s, radar_m = 0.05, 0.9
    knots = np.cumsum(rng.normal(size=(30, n)), axis=0) * 0.1 + 0.2  # also below the plane, where there is no image
    moments = np.empty_like(knots)
    native.spline_moments(knots, step_s, moments)
    times = np.linspace(0.0, 29 * step_s, 200)
    height, rate = np.empty((2, 200, n))
    native.positions_and_velocities(knots, moments, step_s, times, height, rate)
    direct_m, direct_mps = rng.uniform(2.0, 5.0, (200, n + 2)), rng.normal(size=(200, n + 2))
    range_m, velocity_mps = np.full((2, 200, 3 * n + 1), np.nan)
    native.image_ranges(
        knots, moments, step_s, times, direct_m, direct_mps, 2, radar_m, n, 2 * n + 1, range_m, velocity_mps
    )
    rate, height = np.where(height > 0.0, rate, 0.0), np.maximum(height, 0.0)
    near_m, near_mps = direct_m[:, 2:], direct_mps[:, 2:]
    level_2 = near_m**2 - (height - radar_m) ** 2  # squared distance along the plane
    far_m = np.sqrt(level_2 + (height + radar_m) ** 2)
    far_mps = (near_m * near_mps - 2.0 * radar_m * rate) / far_m
    one, two = slice(n, 2 * n), slice(2 * n + 1, None)
    np.testing.assert_allclose(range_m[:, one], (near_m + far_m) / 2.0, rtol=1e-13)
    np.testing.assert_allclose(range_m[:, two], far_m, rtol=1e-13)
    np.testing.assert_allclose(velocity_mps[:, one], (near_mps + far_mps) / 2.0, atol=1e-12)
    np.testing.assert_allclose(velocity_mps[:, two], far_mps, atol=1e-12)
    assert (height == 0.0).any()
    assert np.isnan(range_m[:, :n]).all()
    assert np.isnan(range_m[:, 2 * n]).all()
