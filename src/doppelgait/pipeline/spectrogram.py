"""Signatures from displayed levels of published spectrograms."""

from __future__ import annotations

import json
import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.documents import parse_json
from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import SIGNATURE, make_array, read_axis
from doppelgait.core.lazy import xr
from doppelgait.core.units import FloatArray, db_to_power, doppler_to_velocity_mps, velocity_to_doppler_hz
from doppelgait.processing import Gate

SAME_SPACING = 0.01
"""Largest relative disagreement of columns, rows and hop; the two durations in a figure often differ by more."""
MIN_ROWS, MIN_COLUMNS = 8, 8


def convert_levels_to_signature(
    level_db: npt.ArrayLike,
    *,
    time_s: npt.ArrayLike,
    doppler_hz: npt.ArrayLike | None = None,
    velocity_mps: npt.ArrayLike | None = None,
    wavelength_m: float,
    prf_hz: float,
    cpi_pulses: int,
    hop: int,
    range_m: tuple[float, float],
    floor_db: float | None = None,
    ceiling_db: float | None = None,
    blank_below_mps: float = 0.0,
    n_gate_bins: float = 1.0,
) -> xr.DataArray:
    """Convert spectrogram levels to a signature."""
    level = np.asarray(level_db, dtype=np.float64)
    times_s = _check_uniform(time_s, "time_s", MIN_COLUMNS)
    for name, value in {"wavelength_m": wavelength_m, "prf_hz": prf_hz, "n_gate_bins": n_gate_bins}.items():
        if not 0 < value < math.inf:
            raise AnalysisError(f"{name} is {value}; it must be positive")
    if (doppler_hz is None) == (velocity_mps is None):
        raise AnalysisError("pass doppler_hz or velocity_mps, one of the two, for the rows of a spectrogram")
    name, rows = ("doppler_hz", doppler_hz) if velocity_mps is None else ("velocity_mps", velocity_mps)
    rows = np.asarray(rows, dtype=np.float64)
    if rows.ndim == 1 and rows.size > 1 and rows[0] > rows[-1]:
        rows, level = rows[::-1], level[..., ::-1]
    rows = _check_uniform(rows, name, MIN_ROWS)
    rows_hz = rows if velocity_mps is None else np.asarray(velocity_to_doppler_hz(rows, wavelength_m))
    if level.shape != (times_s.size, rows_hz.size):
        raise AnalysisError(
            f"level_db has shape {level.shape}, its axes {times_s.size} times and {rows_hz.size} rows: it must be "
            "(time, doppler), time first"
        )
    if not np.isfinite(level).all():
        raise AnalysisError(
            "level_db has values that are not finite; pass the display's lowest level where nothing is shown"
        )
    if cpi_pulses < 1 or hop < 1:
        raise AnalysisError(f"cpi_pulses is {cpi_pulses} and hop {hop}; both must be 1 pulse or more")
    column_s = float((times_s[-1] - times_s[0]) / (times_s.size - 1))
    if abs(column_s * prf_hz / hop - 1.0) > SAME_SPACING:
        raise AnalysisError(
            f"time_s has a column every {1e3 * column_s:.4g} ms, but hop {hop} at prf_hz {prf_hz:.6g} is "
            f"{1e3 * hop / prf_hz:.4g} ms: one of the three is wrong, and so would be every gait frequency"
        )
    if floor_db is not None and ceiling_db is not None and floor_db >= ceiling_db:
        raise AnalysisError(f"floor_db {floor_db} must be below ceiling_db {ceiling_db}")
    low, high = (-np.inf if floor_db is None else floor_db), (np.inf if ceiling_db is None else ceiling_db)
    at_floor, at_ceiling = level <= low, level >= high
    clipped = {
        "floor_db": floor_db,
        "ceiling_db": ceiling_db,
        "floor_share": float(at_floor.mean()),
        "ceiling_share": float(at_ceiling.mean()),
    }
    power = np.asarray(db_to_power(np.clip(level, low, high))).astype(np.float32)
    rows_mps = doppler_to_velocity_mps(rows_hz, wavelength_m)
    if not 0 <= blank_below_mps < math.inf:
        raise AnalysisError(f"blank_below_mps is {blank_below_mps}; it must be 0 or more")
    power[:, np.abs(rows_mps) < blank_below_mps] = 0.0
    low_m, high_m = range_m
    gate = Gate.fixed(low_m, high_m, time_s=times_s)
    coords = {
        "time": times_s,
        "doppler": rows_hz,
        "velocity": ("doppler", rows_mps),
        "centre_range": ("time", np.full(times_s.size, (low_m + high_m) / 2.0), {"units": "m"}),
        "gate_share": ("time", np.ones(times_s.size), {"units": "1"}),
    }
    attrs = {
        "prf_hz": float(prf_hz),
        "wavelength_m": float(wavelength_m),
        "cpi_pulses": int(cpi_pulses),
        "hop": int(hop),
        "window_energy": 1.0,
        "n_gate_bins": float(n_gate_bins),
        "gate": json.dumps(gate.facts),
        "levels": json.dumps({**clipped, "blank_below_mps": float(blank_below_mps)}),
    }
    return make_array(SIGNATURE, power, coords, attrs)


def make_level_gate(signature: xr.DataArray) -> Gate:
    """Return the fixed gate of a signature from :func:`convert_levels_to_signature`."""
    times_s, centre_m = read_axis(signature, "time"), float(read_axis(signature, "centre_range")[0])
    half_m = parse_json(signature.attrs["gate"])["span_m"] / 2.0
    return Gate.fixed(centre_m - half_m, centre_m + half_m, time_s=times_s)


def _check_uniform(values: npt.ArrayLike, name: str, least: int) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or array.size < least:
        raise AnalysisError(f"{name} has shape {array.shape}; a spectrogram needs one axis of {least} values or more")
    steps = np.diff(array)
    if not (np.isfinite(array).all() and steps[0] > 0 and np.allclose(steps, steps.mean(), rtol=SAME_SPACING, atol=0)):
        raise AnalysisError(f"{name} must rise in equal steps; its steps are {steps.min():.4g} to {steps.max():.4g}")
    return array
