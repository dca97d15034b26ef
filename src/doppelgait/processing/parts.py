"""Torso, legs and other limbs in range-Doppler maps (E-40).

In the plane of range and radial velocity relative to the torso, a swinging limb moves around the torso: it has the
torso's velocity when it is farthest ahead or behind, and the torso's range when it is fastest. The torso is the power
inside an ellipse around the origin. The width of the ellipse in velocity is a share of the body's speed (the torso
sways with every step) plus a share of the Doppler resolution. Its length is that of the power at the torso's velocity
for at least half of the time; this includes the long trunk of a dog and excludes limbs. Power at velocities above or
below those of arms belongs to legs. Arms and thighs move alike, so the remaining power is not separated further.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.frames import Frames
from doppelgait.core.labels import PART_POWER, Coord, Signal, check_signal, read_axis
from doppelgait.core.lazy import xr
from doppelgait.core.units import FloatArray, doppler_to_velocity_mps
from doppelgait.processing.cadence import observation_s
from doppelgait.processing.config import Analysis, Transform
from doppelgait.processing.gate import Gate
from doppelgait.processing.main_line import choose_line_order, main_line_hz
from doppelgait.processing.normalise import noise_floor_v2
from doppelgait.processing.signature import compute_cell_power, plan_columns

PARTS = ("torso", "legs", "limbs")
"""Names along ``part``; ``limbs`` are arms and the parts of legs that move like arms."""

# studies/parts.py --tune chose these values: they maximise the share of energy that is assigned correctly to torso and
# limbs on the tuning seeds (mean over people and dogs, points and ellipsoids)
SWAY_SHARE, SWAY_CELLS = 0.19, 0.7
"""Half the torso's width in velocity: a share of its radial speed and of the Doppler resolution lambda / (2 T_d)."""
LENGTH_M, LENGTH_EXTENTS = 0.05, 3.25
"""Half the torso's length in range: a constant, and times the half extent of the ridge's power."""
LEGS_AHEAD, LEGS_BEHIND = 0.7, 0.5
"""Speed relative to the body, as a share of its speed, beyond which power belongs to legs.
On the tuning seeds more than three quarters of a person's energy there is from legs, in both
directions of motion and for both kinds of scatterer."""
SLOWEST, FASTEST = -1.5, 2.5
"""Speed relative to the torso, as a share of its speed, beyond which power is noise: no limb moves at this speed."""
LEAST_SPEED_CELLS = 3.0
"""Lowest speed in cells of Doppler resolution; below it a band of fixed width is as accurate on the tuning seeds."""
LEAST_SNR_DB = 5.0
"""Smallest ratio of a column's strongest cell to the noise floor (median over time); at 0 dB shares err by 0.2."""
LEAST_BINS = 5
RIDGE_STEP_M = 0.05
BLOCK = 32  # number of columns for which maps are computed together


@dataclass(frozen=True)
class PartMask:
    """Mask of a body's parts in its range-Doppler maps; arrays have the shape (J,)."""

    columns: npt.NDArray[np.int64]
    torso_mps: FloatArray
    torso_range_m: FloatArray
    middle_mps: float
    width_mps: float
    length_m: float
    beyond_mps: float
    floor_v2: float
    low: FloatArray
    high: FloatArray

    def power_v2(self, frames: Frames, analysis: Analysis, *, wavelength_m: float) -> Signal:
        """Compute the power of every part, noise floor subtracted."""
        transform, times_s, doppler_hz, *_ = plan_columns(frames.slow_time, analysis)
        velocity_mps = np.asarray(doppler_to_velocity_mps(doppler_hz, wavelength_m))
        powers_v2 = []
        for cells, bins, at in _iterate_cells(frames, transform, self.columns, self.low, self.high, self.floor_v2):
            ahead = velocity_mps[None, :] - self.torso_mps[at, None]
            off_m = (frames.range_m[None, bins] - self.torso_range_m[at, None]) / self.length_m
            inside = (ahead / self.width_mps)[:, :, None] ** 2 + off_m[:, None, :] ** 2 < 1.0
            torso, all_v2 = (cells * inside).sum(axis=2), cells.sum(axis=2)
            swing, speed_mps = ahead * np.sign(self.middle_mps), abs(self.middle_mps)
            slowest_mps, fastest_mps = SLOWEST * speed_mps - self.beyond_mps, FASTEST * speed_mps + self.beyond_mps
            limb = (swing > slowest_mps) & (swing < fastest_mps)
            leg = limb & ((swing > LEGS_AHEAD * speed_mps) | (swing < -LEGS_BEHIND * speed_mps))
            rest = np.where(limb, all_v2 - torso, 0.0)
            powers_v2.append(np.stack([torso, rest * leg, rest * ~leg]).astype(np.float32))
        coords: dict[str, Coord] = {
            "part": (("part",), np.arange(len(PARTS), dtype=np.float64), {}),
            "time": (("time",), times_s[self.columns], {}),
            "doppler": (("doppler",), doppler_hz, {}),
            "velocity": (("doppler",), velocity_mps, {}),
        }
        attrs = {"units": PART_POWER.units, "parts": " ".join(PARTS), "torso_mps": self.middle_mps}
        return Signal(PART_POWER, np.concatenate(powers_v2, axis=1), coords, attrs)


def locate_parts(frames: Frames, signature: Signal, gate: Gate, analysis: Analysis) -> tuple[PartMask | None, str]:
    """Locate torso and limbs in range-Doppler maps (E-40)."""
    wavelength_m = float(signature.attrs["wavelength_m"])
    nu_v2 = noise_floor_v2(signature)
    snr = float(np.median(signature.values.max(axis=1))) / max(nu_v2, 1e-300)
    if snr < 10.0 ** (LEAST_SNR_DB / 10.0):
        return None, f"snr_below_{LEAST_SNR_DB:.0f}_db"
    seconds = observation_s(signature)
    line_hz = main_line_hz(signature, order=choose_line_order(seconds))
    torso_mps = np.asarray(doppler_to_velocity_mps(line_hz, wavelength_m))
    middle_mps, cell_mps = float(np.median(torso_mps)), wavelength_m / (2.0 * analysis.cpi_s)
    speed_mps = abs(middle_mps)
    if speed_mps < LEAST_SPEED_CELLS * cell_mps:
        return None, f"torso_slower_than_{LEAST_SPEED_CELLS:g}_doppler_cells"
    width_mps = SWAY_SHARE * speed_mps + SWAY_CELLS * cell_mps
    transform, centres_s, doppler_hz, *_ = plan_columns(frames.slow_time, analysis)
    times_s, range_m = signature.axis("time"), frames.range_m
    columns = int(np.abs(centres_s - times_s[0]).argmin()) + np.arange(times_s.size)
    low, high = gate.edges(range_m, times_s, sharp=analysis.sharp_edges)
    floor_v2 = nu_v2 / float(high[0] - low[0])
    # power at the torso's velocity, by range
    profile = np.zeros((times_s.size, range_m.size))
    velocity_mps = np.asarray(doppler_to_velocity_mps(doppler_hz, wavelength_m))
    for cells, bins, at in _iterate_cells(frames, transform, columns, low, high, floor_v2):
        near = np.abs(velocity_mps[None, :] - torso_mps[at, None]) < width_mps
        profile[at, bins] = np.einsum("jkn,jk->jn", cells, near)
    np.maximum(profile, 0.0, out=profile)
    weight = profile.sum(axis=1)
    known = weight > 0
    centroid_m = (profile[known] @ range_m) / weight[known]
    position = np.linspace(-1.0, 1.0, times_s.size)
    fit = np.polynomial.legendre.Legendre.fit(
        position[known], centroid_m, choose_line_order(seconds), domain=[-1, 1], w=np.sqrt(weight[known])
    )
    torso_range_m = np.asarray(fit(position))
    length_m = np.inf
    if high[0] - low[0] >= LEAST_BINS:
        # power that is present for half of the time is the body's ridge; limbs are present for less
        off_m = np.arange(-gate.span_m / 2.0, gate.span_m / 2.0 + 1e-9, RIDGE_STEP_M)
        ridge = np.median(
            [
                np.interp(centre_m + off_m, range_m, row) / total
                for centre_m, row, total in zip(torso_range_m[known], profile[known], weight[known], strict=True)
            ],
            axis=0,
        )
        distance_m = np.abs(off_m - (ridge @ off_m) / ridge.sum())
        order = np.argsort(distance_m)
        summed = np.cumsum(ridge[order])
        extent_m = float(np.interp(0.5, summed / summed[-1], distance_m[order]))
        length_m = LENGTH_M + LENGTH_EXTENTS * extent_m
    shape = (middle_mps, width_mps, length_m, cell_mps)
    return PartMask(columns, torso_mps, torso_range_m, *shape, floor_v2, low, high), ""


def _iterate_cells(
    frames: Frames,
    transform: Transform,
    columns: npt.NDArray[np.int64],
    low: FloatArray,
    high: FloatArray,
    floor_v2: float,
) -> Iterator[tuple[npt.NDArray[Any], slice, slice]]:
    """Yield the gated power above the floor, with bins and columns."""
    for start in range(0, columns.size, BLOCK):
        at = slice(start, min(start + BLOCK, columns.size))
        first = max(int(np.floor(low[at].min() + 0.5)), 0)
        bins = slice(first, min(int(np.ceil(high[at].max() + 0.5)), frames.n_bins))
        numbers = np.arange(bins.start, bins.stop)
        power_v2 = compute_cell_power(frames.take_bins(bins), transform, transform.window, columns[at])
        upper = np.minimum(numbers[None, :] + 0.5, high[at, None])
        share = np.clip(upper - np.maximum(numbers[None, :] - 0.5, low[at, None]), 0.0, 1.0)
        yield (power_v2 - np.float32(floor_v2)) * share[:, None, :], bins, at


def measure_parts(power: xr.DataArray) -> xr.Dataset:
    """Measure energy, Doppler and spread per part (E-40)."""
    check_signal(power, PART_POWER)
    values, velocity_mps = power.values.astype(np.float64), read_axis(power, "velocity")
    energy = values.sum(axis=(1, 2))
    column = values.sum(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        centroid = np.where(column > 0, (values @ velocity_mps) / column, np.nan)
        square = (values * (velocity_mps - centroid[:, :, None]) ** 2).sum(axis=2) / column
        spread = np.where((column > 0) & (square >= 0), np.sqrt(np.maximum(square, 0.0)), np.nan)
    label = np.where(values.max(axis=0) > 0, values.argmax(axis=0), -1).astype(np.int8)
    names = str(power.attrs["parts"]).split()
    return xr.Dataset(
        {
            "power": (power.dims, power.values, {"units": "V^2"}),
            "label": (("time", "doppler"), label, {"units": "1", "parts": power.attrs["parts"]}),
            "share": ("part", energy / energy.sum(), {"units": "1"}),
            "velocity_mps": (("part", "time"), centroid, {"units": "m/s"}),
            "spread_mps": (("part", "time"), spread, {"units": "m/s"}),
        },
        coords={
            "part": names,
            "time": read_axis(power, "time"),
            "doppler": read_axis(power, "doppler"),
            "velocity": ("doppler", velocity_mps),
        },
    )
