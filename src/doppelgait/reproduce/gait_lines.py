"""What is read off the lines of single body parts: cycles, phases between limbs, departures from the straight line."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.errors import MotionError
from doppelgait.core.labels import axis

FloatArray = npt.NDArray[np.float64]


def one_cycle_s(motion: xr.DataArray, foot: str) -> tuple[float, float]:
    """Start and duration of a gait cycle: between the first two touchdowns of a foot.

    Parameters
    ----------
    motion : DataArray (time, marker, space)
    foot : str
        As in the motion's footfalls: "right_foot", "left_hind".

    Raises
    ------
    MotionError
        If the foot does not touch down twice.
    """
    touchdowns = motion.attrs["footfalls"].get(foot, [])
    if len(touchdowns) < 2:
        raise MotionError(
            f"{motion.attrs['source'] or 'motion'}: {foot} touches down {len(touchdowns)} times where two are needed "
            "for a gait cycle; take a longer recording"
        )
    return float(touchdowns[0]), float(touchdowns[1] - touchdowns[0])


def forward_m(motion: xr.DataArray) -> xr.DataArray:
    """Place of every point along the direction of travel, from the mean of all points: lines (time, marker), m."""
    ground = motion.values[:, :, :2]
    centre = ground.mean(axis=1)
    travel = centre[-1] - centre[0]
    along = (ground - centre[:, None]) @ (travel / np.linalg.norm(travel))
    return motion.isel(space=0).copy(data=along)


def part_line(lines: xr.DataArray, part: str) -> FloatArray:
    """Mean line of the points of a body part, shape (I,).

    Raises
    ------
    MotionError
        If no point belongs to it.
    """
    chosen = axis(lines, "part").astype(str) == part
    if not chosen.any():
        raise MotionError(f"no point is known to be of the {part.replace('_', ' ')}, whose line is needed")
    return np.asarray(lines.values[:, chosen].mean(axis=1), dtype=np.float64)


def parts_of(lines: xr.DataArray) -> list[str]:
    """Body parts of the points, by alphabet."""
    return sorted(set(axis(lines, "part").astype(str)))


def departure(values: npt.ArrayLike) -> float:
    """Root mean square departure of a line from the straight line through it, in its own unit."""
    line = np.asarray(values, dtype=np.float64)
    time = np.arange(line.size)
    return float(np.std(line - np.polyval(np.polyfit(time, line, 1), time)))


def phase_between_deg(first: npt.ArrayLike, second: npt.ArrayLike, *, stride_hz: float, rate_hz: float) -> float:
    """Phase between two lines at the stride frequency: straight line and wave fitted to whole strides of each.

    Parameters
    ----------
    first, second : array_like, shape (I,)
    stride_hz : float
    rate_hz : float
        Samples per second.

    Returns
    -------
    float
        0 (together) to 180 degrees (opposite).

    Raises
    ------
    MotionError
        If the lines do not cover one stride.
    """
    samples = round(np.floor(len(np.asarray(first)) * stride_hz / rate_hz + 1e-6) * rate_hz / stride_hz)
    if samples < 2:
        raise MotionError("the motion is shorter than one stride: no phase between the limbs can be read")
    angle = 2 * np.pi * stride_hz * np.arange(samples) / rate_hz
    shapes = np.stack([np.ones(samples), angle, np.cos(angle), np.sin(angle)], axis=1)
    lines = np.stack([np.asarray(values, dtype=np.float64)[:samples] for values in (first, second)], axis=1)
    cosine, sine = np.linalg.lstsq(shapes, lines, rcond=None)[0][2:]
    waves = cosine - 1j * sine
    return float(np.abs(np.degrees(np.angle(waves[0] * np.conj(waves[1])))))
