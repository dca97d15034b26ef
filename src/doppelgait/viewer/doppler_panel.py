"""Range-Doppler maps of a run, a chunk of frames at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.core.labels import axis, sampling_rate_hz
from doppelgait.core.units import power_to_db
from doppelgait.processing import Analysis, burst_pulses_of, range_doppler
from doppelgait.processing.config import MIN_CPI_PULSES
from doppelgait.processing.signature import plan_for
from doppelgait.viewer.images import DEEPEST_DB, axis_facts, doppler_facts, encode, level_db, shown_range_db
from doppelgait.viewer.payload import pack
from doppelgait.viewer.query import Gate
from doppelgait.viewer.run import Run
from doppelgait.viewer.settings import Clutter

MOST_FRAMES = 600
MOST_PER_REQUEST = 256
MOST_PARTS = (300, 256)
"""Most range bins and Doppler rows of a frame; more are put together, the strongest staying."""
LOOKED_AT = 8
"""Frames that say what levels to show."""
SLOW_PULSES = 3 * MIN_CPI_PULSES
"""Fewest pulses of a frame's processing interval."""
ONE_BIN = "this radar has no range: its signature shows all there is"
IN_BURSTS = "this recording comes in bursts of pulses; its signature has one column a burst"


@dataclass(frozen=True)
class Frames:
    """Frames of a recording and their levels, the same for every chunk.

    Parameters
    ----------
    columns : ndarray of int
        Processing intervals shown.
    db, shown_db : (float, float)
    """

    columns: npt.NDArray[np.int64]
    db: tuple[float, float]
    shown_db: tuple[float, float]


def range_doppler_payload(
    run: Run, gate: Gate | None, *, start: int, count: int, clutter: Clutter | None = None
) -> bytes:
    """Payload of ``api/range-doppler``.

    Raises
    ------
    ConfigError
        If there is no frame ``start``.
    """
    reason = why_none(run)
    if reason is not None:
        return pack({"frames": None, "reason": reason}, {})
    baseband = run.clean_baseband(gate, clutter)
    analysis = frame_analysis(baseband, run.analysis(gate, clutter))
    wavelength_m = run.needed_recording().radar.wavelength_m
    frames = run.keep(f"frames, {analysis.clutter}", lambda: plan_frames(baseband, analysis, wavelength_m))
    if start >= frames.columns.size:
        raise ConfigError(f"from: {start} is not allowed; this recording has frames 0 to {frames.columns.size - 1}")
    wanted = frames.columns[start : start + count]
    cube = _cube(baseband, analysis, wavelength_m, wanted)
    levels, ranges, rows = _for_screen(cube)
    facts = {
        "time": _time_axis(baseband, analysis, frames.columns),
        "from": start,
        "count": int(wanted.size),
        "range": ranges,
        "doppler": rows,
        "db": frames.db,
        "shown_db": frames.shown_db,
        "unit": "dB re 1 V²",
        "cpi_s": analysis.cpi_s,
        "clutter": analysis.clutter,
        "frames": "frames",
        "reason": None,
    }
    return pack(facts, {"frames": encode(levels, *frames.db)})


def why_none(run: Run) -> str | None:
    """Why a run has no range-Doppler maps, None where it has."""
    if run.recording is None:
        return run.reason
    baseband = run.recording.baseband
    if baseband.sizes["range"] < 2:
        return ONE_BIN
    if burst_pulses_of(baseband) is not None:
        return IN_BURSTS
    try:
        plan_for(baseband, frame_analysis(baseband, run.analysis(None)))
    except AnalysisError as error:
        return str(error)
    return None


def frame_analysis(baseband: xr.DataArray, analysis: Analysis) -> Analysis:
    """Parameters of the frames: of slow recordings the interval is longer, as for people who keep still."""
    least_s = SLOW_PULSES / sampling_rate_hz(axis(baseband, "slow_time"))
    return analysis if analysis.cpi_s >= least_s else analysis.model_copy(update={"cpi_s": least_s})


def plan_frames(baseband: xr.DataArray, analysis: Analysis, wavelength_m: float) -> Frames:
    """Which intervals are shown, and levels that hold for all: no map can be higher than all its echoes in phase."""
    transform, _ = plan_for(baseband, analysis)
    step = math.ceil(transform.n_columns / MOST_FRAMES)
    columns = np.arange(0, transform.n_columns, step)
    looked_at = columns[np.unique(np.linspace(0, columns.size - 1, LOOKED_AT).round().astype(int))]
    levels = level_db(_cube(baseband, analysis, wavelength_m, looked_at).values)
    known = levels[np.isfinite(levels)]
    highest = float(known.max()) if known.size else 0.0
    bound = float(np.abs(baseband.values).max()) * float(transform.window.sum())
    top = float(power_to_db(bound**2)) if bound > 0 else 0.0
    low, high = shown_range_db(levels, highest)
    return Frames(columns, (top - DEEPEST_DB, top), (low, high))


def _cube(
    baseband: xr.DataArray, analysis: Analysis, wavelength_m: float, columns: npt.NDArray[np.int64]
) -> xr.DataArray:
    blocks = range_doppler(baseband, analysis, wavelength_m=wavelength_m, columns=columns)
    return xr.concat(list(blocks), dim="time")


def _time_axis(baseband: xr.DataArray, analysis: Analysis, columns: npt.NDArray[np.int64]) -> dict[str, Any]:
    transform, prf_hz = plan_for(baseband, analysis)
    times_s = axis(baseband, "slow_time")[0] + transform.centre_pulses()[columns] / prf_hz
    return axis_facts("time", "s", times_s)


def _for_screen(cube: xr.DataArray) -> tuple[npt.NDArray[Any], dict[str, Any], dict[str, Any]]:
    """Levels (time, range, Doppler) no larger than a screen needs, and the axes of range and Doppler."""
    levels = level_db(cube.transpose("time", "range", "doppler").values)
    ranges = axis_facts("range", "m", axis(cube, "range"))
    doppler_hz = axis(cube, "doppler")
    wavelength_m = float(2.0 * axis(cube, "velocity")[0] / doppler_hz[0])
    rows = doppler_facts(doppler_hz, wavelength_m)
    for dim, facts in ((1, ranges), (2, rows)):
        block = math.ceil(levels.shape[dim] / MOST_PARTS[dim - 1])
        if block > 1:
            levels = np.maximum.reduceat(levels, np.arange(0, levels.shape[dim], block), axis=dim)
            facts.update(_of_blocks(facts, block, levels.shape[dim]))
    return levels, ranges, rows


def _of_blocks(facts: dict[str, Any], block: int, count: int) -> dict[str, Any]:
    first = facts["first"] + (block - 1) / 2 * facts["step"]
    return {"first": first, "step": block * facts["step"], "n": count, "block": block}
