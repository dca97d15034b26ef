"""Pictures of signatures: against closed forms, between radars, without gain; and the network's plain form."""

import numpy as np
import pytest

from doppelgait.classify.scorer import covering
from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import SIGNATURE, make_array
from doppelgait.processing.patches import Patch, cut, levels, patch

SPEC = Patch()


def a_signature(power, *, wavelength_m=0.041, prf_hz=1300.0, column_s=0.01):
    n_time, n_doppler = power.shape
    doppler_hz = (np.arange(n_doppler) - n_doppler // 2) * prf_hz / n_doppler
    coords = {
        "time": 0.05 + column_s * np.arange(n_time),
        "doppler": doppler_hz,
        "velocity": ("doppler", doppler_hz * wavelength_m / 2),
    }
    return make_array(SIGNATURE, power.astype(np.float32), coords)


def of_body(*, wavelength_m=0.041, prf_hz=1300.0, n_doppler=160, column_s=0.01, gain=1.0, seconds=2.4):
    """A body whose velocity swings about 1.5 m/s, its line 0.8 m/s wide, over a floor of 1."""
    n_time = round(seconds / column_s)
    time_s = column_s * np.arange(n_time)
    velocity = (np.arange(n_doppler) - n_doppler // 2) * prf_hz / n_doppler * wavelength_m / 2
    line = 1.5 + 0.6 * np.sin(2 * np.pi * 1.5 * time_s)
    power = 1.0 + 1000.0 * np.exp(-0.5 * ((velocity[None] - line[:, None]) / 0.4) ** 2)
    return a_signature(gain * power, wavelength_m=wavelength_m, prf_hz=prf_hz, column_s=column_s)


def test_a_line_lies_at_its_velocity_and_level():
    power = np.ones((240, 160))
    power[:, 100] = 101.0  # one Doppler row; 20 * 8.125 Hz = 3.331 m/s
    found = patch(a_signature(power))
    assert found.shape == (64, 64)
    assert found.dtype == np.float32
    row = int((20 * 8.125 * 0.041 / 2 + 6.4) / 0.2)
    assert found[:, 32].argmax() == row
    # a Doppler row is 0.1666 m/s wide, a cell 0.2: where it lies wholly inside, 100 * 0.833 above the floor
    inside = found[row, 32] * 40
    assert 15.0 < inside <= 10 * np.log10(1 + 100 * 0.1666 / 0.2) + 0.05
    assert found[5, 32] == pytest.approx(0.0, abs=1e-6)


def test_gain_and_sampling_do_not_matter():
    reference = patch(of_body())
    assert np.allclose(patch(of_body(gain=1e-9)), reference, atol=1e-4)
    others = [
        of_body(wavelength_m=0.0125, prf_hz=4000.0, n_doppler=512),
        of_body(prf_hz=2600.0, n_doppler=400),
        of_body(column_s=0.004),
    ]
    for other in others:
        assert np.abs(patch(other) - reference).mean() < 0.01


def test_velocities_that_a_radar_does_not_see_are_floor():
    found = patch(of_body(prf_hz=200.0, n_doppler=64))  # to +-2.05 m/s
    assert (found[:21] == 0).all()
    assert (found[-21:] == 0).all()
    assert found[24:42].max() > 0.5


def test_a_quiet_simulation_shows_40_db():
    array = of_body()
    found = patch(a_signature(array.values - 1.0 + 1e-12))
    assert 0.99 < np.median(found.max(axis=0)) <= 1.0
    assert (found[:20] == 0).all()
    assert not patch(a_signature(np.zeros((240, 160)))).any()


def test_short_and_long_recordings():
    short, long = levels(of_body(seconds=0.8)), levels(of_body(seconds=9.0))
    assert short.shape[1] == 25
    patches = covering(short, vars(SPEC))
    assert patches.shape == (1, 64, 64)
    assert not patches[0, :, :19].any()
    patches = covering(long, vars(SPEC))
    assert len(patches) == 1 + -(-2 * (288 - 64) // 64)
    assert np.array_equal(patches[0], long[:, :64])
    assert np.array_equal(patches[-1], long[:, -64:])
    assert np.array_equal(cut(long, 100, SPEC), long[:, 100:164])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda s: s.transpose("doppler", "time"), "dimensions"),
        (lambda s: s.drop_vars("velocity"), "coordinates"),
        (lambda s: s.assign_coords(velocity=("doppler", np.full(160, np.nan))), "carrier"),
        (lambda s: 10 * np.log10(s * 0 + 0.5), "finite power"),
        (lambda s: s.assign_coords(time=np.geomspace(1, 3, 240)), "evenly spaced time axis"),
    ],
)
def test_what_is_no_signature_is_refused(change, says):
    with pytest.raises(AnalysisError, match=says):
        patch(change(of_body()))
