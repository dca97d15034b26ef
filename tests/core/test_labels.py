"""Labelled arrays: made, given new values, and read."""

import re

import numpy as np
import pytest
import xarray as xr

from doppelgait.core import labels
from doppelgait.core.errors import AnalysisError

TIME_S, DOPPLER_HZ = np.linspace(0.0, 1.0, 5), np.array([-10.0, 0.0, 10.0])


def signature():
    coords = {
        "time": TIME_S,
        "doppler": DOPPLER_HZ,
        "velocity": ("doppler", 0.02 * DOPPLER_HZ),
        "centre_range": ("time", TIME_S + 2.0, {"units": "m"}),
    }
    return labels.make_array(labels.SIGNATURE, np.arange(15.0).reshape(5, 3), coords, {"hop": 8})


def test_an_array_is_the_one_that_xarray_makes_of_the_same_parts():
    made = signature()
    wanted = xr.DataArray(
        np.arange(15.0).reshape(5, 3),
        dims=("time", "doppler"),
        coords={
            "time": ("time", TIME_S, {"units": "s"}),
            "doppler": ("doppler", DOPPLER_HZ, {"units": "Hz"}),
            "velocity": ("doppler", 0.02 * DOPPLER_HZ, {"units": "m/s"}),
            "centre_range": ("time", TIME_S + 2.0, {"units": "m"}),
        },
        name="signature",
        attrs={"units": "V^2", "hop": 8},
    )
    xr.testing.assert_identical(made, wanted)
    xr.testing.assert_identical(made.sel(time=0.25, doppler=10.0), wanted.sel(time=0.25, doppler=10.0))
    xr.testing.assert_identical(made.isel(time=slice(1, 3)) + 1.0, wanted.isel(time=slice(1, 3)) + 1.0)


def test_arrays_of_another_byte_order_are_converted():
    axes = {"doppler": DOPPLER_HZ.astype(">f8"), "centre_range": ("time", (TIME_S + 2.0).astype(">f8"))}
    plain = labels.Signal.of(signature().astype(">f8").assign_coords(axes), labels.SIGNATURE)
    assert all(array.dtype.isnative for array in (plain.values, plain.axis("doppler"), plain.axis("centre_range")))


def test_new_values_share_the_coordinates_and_leave_the_old_array_alone():
    old = signature()
    plain = labels.Signal.of(old, labels.SIGNATURE)
    new = plain.replace(np.zeros((5, 3)), schema=labels.NORMALISED_SIGNATURE, attrs={"normalisation": "sum"}).label()
    assert (new.name, new.attrs) == ("normalised_signature", {"units": "1", "hop": 8, "normalisation": "sum"})
    assert (old.name, old.attrs) == ("signature", {"units": "V^2", "hop": 8})
    assert old.values.any()
    xr.testing.assert_identical(new.coords.to_dataset(), old.coords.to_dataset())
    assert labels.replace_array_values(old, np.zeros((5, 3))).attrs == old.attrs
    for shape in ((5,), (4, 3)):
        with pytest.raises(ValueError, match=rf"{re.escape(str(shape))} do not fit .*\(5, 3\)"):
            labels.replace_array_values(old, np.zeros(shape))


def test_a_coordinate_of_another_length_or_missing_is_named():
    coords = {"time": TIME_S, "doppler": DOPPLER_HZ}
    with pytest.raises(ValueError, match="coordinate 'time'"):
        labels.make_array(labels.SIGNATURE, np.zeros((4, 3)), coords)
    with pytest.raises(AnalysisError, match="'velocity' along 'doppler' is missing"):
        labels.make_array(labels.SIGNATURE, np.zeros((5, 3)), coords)


def test_an_edit_of_one_array_reaches_no_other():
    from doppelgait.motion.models import boulic_walk

    first = boulic_walk(speed_mps=1.2, height_m=1.75, duration_s=1.0)
    parts = first.positions.coords["part"].values.copy()
    first.positions.coords["part"][:] = "leg"
    first.positions.coords["marker"].attrs["edited"] = True
    second = boulic_walk(speed_mps=1.2, height_m=1.75, duration_s=1.0)
    np.testing.assert_array_equal(second.positions.coords["part"].values, parts)
    assert "edited" not in second.positions.coords["marker"].attrs
    assert (first.parts, second.parts) == (["leg"] * parts.size, parts.tolist())
    with pytest.raises(AnalysisError, match="must be real floats"):
        second.with_positions(np.zeros(second.position_m.shape, dtype=int))
    made = signature()
    new = labels.replace_array_values(made, made.values + 1.0)
    new.coords["velocity"].values[0] = 99.0
    new.coords["velocity"].attrs["units"] = "knots"
    assert made.coords["velocity"].values[0] == pytest.approx(-0.2)
    assert made.coords["velocity"].attrs == {"units": "m/s"}
