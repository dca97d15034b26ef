"""Scatterer tables from places in closed form, and their field at a radar of one frequency, for tests."""

import numpy as np
import xarray as xr

from doppelgait_conformance.radars import make_table

C_MPS = 299_792_458.0
LAMBDA_M = C_MPS / 7.29e9


def echo_table(position_m, radar_m, slow_time_s=None, *, velocity_mps=None, rcs_m2=1.0, names=None, aspect=False):
    """Table of points (I, L, 3) seen from ``radar_m``; velocities 0 unless given."""
    sight = np.asarray(position_m, float) - np.asarray(radar_m, float)
    n_pulses, n_points = sight.shape[:2]
    velocity = np.zeros_like(sight) if velocity_mps is None else velocity_mps
    distance = np.linalg.norm(sight, axis=-1)
    values = {
        "range": (distance, "m"),
        "radial_velocity": (-(sight * velocity).sum(axis=-1) / distance, "m/s"),
        "azimuth": (np.arctan2(sight[..., 1], sight[..., 0]), "rad"),
        "elevation": (np.arcsin(sight[..., 2] / distance), "rad"),
        "rcs": (np.full_like(distance, rcs_m2), "m^2"),
        "path_gain": (np.ones_like(distance), "1"),
    }
    if aspect:
        values["aspect"] = (np.zeros_like(distance), "rad")
    names = names or [f"p{n}" for n in range(n_points)]
    times = np.arange(n_pulses) / 1000.0 if slow_time_s is None else slow_time_s
    return xr.Dataset(
        {name: (("slow_time", "scatterer"), array, {"units": unit}) for name, (array, unit) in values.items()},
        coords={
            "slow_time": ("slow_time", times, {"units": "s"}),
            "target": ("scatterer", np.zeros(n_points, int)),
            "marker": ("scatterer", np.array(names)),
            "part": ("scatterer", np.array(["torso"] * n_points)),
        },
    )


def range_table(range_m, rcs_m2=1.0, prf_hz=1000.0):
    """Table of ranges (I, L) with the velocities that they have from pulse to pulse."""
    ranges_m = np.asarray(range_m, dtype=float)
    slope_mps = np.gradient(ranges_m, 1 / prf_hz, axis=0) if len(ranges_m) > 1 else np.zeros(ranges_m.shape)
    times_s, rcs = np.arange(len(ranges_m)) / prf_hz, np.broadcast_to(rcs_m2, ranges_m.shape)
    return make_table(ranges_m, slow_time_s=times_s, radial_velocity=-slope_mps, rcs=rcs)


def echoes(table, wavelength_m=LAMBDA_M):
    """Complex field of every row for a radar with unit constant: sqrt(rcs gain) / R^2 exp(j(phase - 4 pi R/lambda))."""
    range_m = table["range"].values
    amplitude = np.sqrt(table["rcs"].values * table["path_gain"].values) / range_m**2
    phase = table["path_phase"].values if "path_phase" in table else 0.0
    return amplitude * np.exp(1j * (phase - 4 * np.pi * range_m / wavelength_m))


def rows(table, ending):
    """The rows whose marker has an ending."""
    chosen = [str(name).endswith(ending) for name in table["marker"].values]
    return table.isel(scatterer=np.flatnonzero(chosen))
