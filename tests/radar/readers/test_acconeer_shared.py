"""Real A121 recordings, the vendor's own test data (the shared test data)."""

import numpy as np
import pytest

from doppelgait.radar.readers import read_recording

pytestmark = pytest.mark.shared

BASE_STEP_M = 0.00250227400101721


@pytest.fixture(scope="module")
def folder(shared):
    return shared / "data" / "radar" / "a121_acconeer"


@pytest.mark.parametrize(
    ("name", "options", "shape", "first_point", "step", "prf_hz", "burst_pulses"),
    [
        ("breathing-sitting", {}, (773 * 16, 21), 119, 24, 1372.83, 16),
        ("presence-default", {"subsweep": 0}, (137 * 16, 3), 120, 48, 3421.57, 16),
        ("presence-default", {"subsweep": 3}, (137 * 16, 2), 976, 120, 3421.57, 16),
        ("surface_velocity_default", {}, (44 * 128, 4), 554, 12, 3000.0, None),
        ("corner-reflector", {"subsweep": 0}, (113, 54), 24, 4, 50.0, None),
    ],
)
def test_all_are_read(folder, name, options, shape, first_point, step, prf_hz, burst_pulses):
    recording = read_recording(folder / f"{name}.h5", **options)
    baseband = recording.baseband
    assert baseband.shape == shape
    np.testing.assert_allclose(baseband.range.values, BASE_STEP_M * (first_point + step * np.arange(shape[1])))
    assert recording.radar.prf_hz == pytest.approx(prf_hz, rel=1e-5)
    assert baseband.attrs.get("burst_pulses") == burst_pulses


def test_the_corner_reflector_is_as_wide_as_profile_1(folder):
    recording = read_recording(folder / "corner-reflector.h5", subsweep=0)
    ranges_m = recording.baseband.range.values
    level = np.abs(recording.baseband.values).mean(axis=0)
    near = (ranges_m > 0.12) & (ranges_m < 0.32)
    fine_m = np.linspace(0.12, 0.32, 20_001)
    shape = np.interp(fine_m, ranges_m[near], level[near])
    above = fine_m[shape > shape.max() / 2]
    assert np.ptp(above) == pytest.approx(0.04, abs=0.004)  # vendor's constant
    s_m = 299_792_458 * recording.radar.sigma_s / 2
    assert 2 * np.sqrt(2 * np.log(2)) * s_m == pytest.approx(0.04)
    assert 0.15 < fine_m[shape.argmax()] < 0.25
