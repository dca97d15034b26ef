"""Range-Doppler gate of a target over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol, Self

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.core.frames import SLACK_S, Frames
from doppelgait.core.lazy import xr
from doppelgait.core.units import FloatArray
from doppelgait.processing.config import Analysis
from doppelgait.processing.track.live import Track

GateName = Literal["track", "truth"]
GateChoice = GateName | tuple[float, float]
"""Gates that a user may choose: detected targets, the simulation's truth, or two ranges in m."""

LILAND_SPAN_M = {"human": 1.0, "dog": 1.5}
"""Gate span by class in the report (its Table 4.1): the label leaks into the signature; for reproduction only."""


class TrueTrack(Protocol):
    """Truth of a target, as used by a gate."""

    @property
    def label(self) -> str:
        """Class; used only by the report's method."""

    @property
    def centre_range_m(self) -> FloatArray:
        """Range of the body's centre at every pulse."""

    def doppler_hz(self, wavelength_m: float) -> FloatArray:
        """Return every scatterer's Doppler shift per pulse."""


@dataclass(frozen=True, eq=False)
class Gate:
    """Limits in range and Doppler around a target (E-26).

    The range extent is constant. E-26 is an equation of docs/theory.md.

    Parameters
    ----------
    time_s, centre_m : ndarray, shape (T,)
        Track of the body: times in rising order, and ranges R_c. The gate is interpolated between them.
    span_m : float
        Range extent g: R_c - g/2 to R_c + g/2.
    doppler_hz : (float, float), optional
        Doppler band B_L to B_H; all Doppler frequencies by default.
    source : str
        Source of the track: ``"truth"``, ``"track"`` or ``"given"`` (set by the user).
    range_sd_m : float, optional
        Standard deviation of the ranges R_c, if a tracker provides it.

    Raises
    ------
    AnalysisError
        If times and ranges do not match, or a range is not finite.
    """

    time_s: FloatArray
    centre_m: FloatArray
    span_m: float
    doppler_hz: tuple[float, float] | None = None
    source: str = "given"
    range_sd_m: float | None = None

    def __post_init__(self) -> None:
        times, centre = np.asarray(self.time_s, dtype=float), np.asarray(self.centre_m, dtype=float)
        if times.shape != centre.shape or times.ndim != 1 or not times.size or not np.isfinite(centre).all():
            raise AnalysisError(f"a gate needs one finite range per time; got shapes {times.shape} and {centre.shape}")
        object.__setattr__(self, "time_s", times)
        object.__setattr__(self, "centre_m", centre)
        object.__setattr__(self, "span_m", float(self.span_m))
        if self.doppler_hz is not None:
            low, high = self.doppler_hz
            object.__setattr__(self, "doppler_hz", (float(low), float(high)))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Gate):
            return NotImplemented
        same_track = np.array_equal(self.time_s, other.time_s) and np.array_equal(self.centre_m, other.centre_m)
        return same_track and self.facts == other.facts and self.doppler_hz == other.doppler_hz

    __hash__ = None  # type: ignore[assignment]

    @classmethod
    def around(
        cls,
        time_s: npt.ArrayLike,
        centre_m: npt.ArrayLike,
        *,
        span_m: float,
        doppler_hz: tuple[float, float] | None = None,
        source: str = "given",
    ) -> Self:
        """Make a gate of constant span around a track."""
        return cls(np.asarray(time_s, dtype=float), np.asarray(centre_m, dtype=float), span_m, doppler_hz, source)

    @classmethod
    def fixed(
        cls,
        low_m: float,
        high_m: float,
        *,
        time_s: npt.ArrayLike,
        range_m: npt.ArrayLike | None = None,
        source: str = "given",
    ) -> Self:
        """Make a gate between two fixed ranges, from the first to the last of the times.

        With the range axis ``range_m`` of the recording, the gate is limited to its cells; limits
        outside it are an AnalysisError. A recording without range (one cell) is inside any gate.
        """
        if not -np.inf < low_m < high_m < np.inf:
            raise AnalysisError(f"gate {low_m:g} to {high_m:g} m: use two rising ranges in m, for example 1.2 to 2.8")
        cells_m = np.zeros(1) if range_m is None else np.asarray(range_m, dtype=float)
        if cells_m.size > 1:
            first_m, last_m = frame_limits_m(cells_m)
            if high_m <= first_m or low_m >= last_m:
                raise _make_frame_error(low_m, high_m, cells_m)
            low_m, high_m = max(low_m, first_m), min(high_m, last_m)
        ends_s = np.asarray(time_s, dtype=float)[[0, -1]]
        return cls(ends_s, np.full(2, (low_m + high_m) / 2), high_m - low_m, None, source)

    @classmethod
    def from_track(
        cls,
        track: Track,
        *,
        time_s: npt.ArrayLike,
        span_m: float,
        cpi_s: float = 0.1,
        doppler_hz: tuple[float, float] | None = None,
    ) -> Self:
        """Make the gate of a track over the pulses in its time, two or more.

        Pulse times from half a processing interval ``cpi_s`` before the first detection to half of
        one after the last are kept: a scan uses the pulses within this distance of its time.
        """
        times_s = np.asarray(time_s, dtype=float)
        first_s, last_s = track.first_s - cpi_s / 2 - SLACK_S, track.last_s + cpi_s / 2 + SLACK_S
        times_s = times_s[(times_s >= first_s) & (times_s <= last_s)]
        if times_s.size < 2:
            raise AnalysisError(
                f"track from {track.first_s:g} to {track.last_s:g} s: the recording has {times_s.size} pulses in this "
                "time; two or more are needed"
            )
        before_s, after_s = np.minimum(times_s - track.first_s, 0.0), np.maximum(times_s - track.last_s, 0.0)
        centre_m = np.interp(times_s, track.times_s, track.range_m)
        centre_m -= before_s * track.velocity_mps[0] + after_s * track.velocity_mps[-1]  # dR/dt = -v
        return cls(times_s, centre_m, span_m, doppler_hz, "track", float(np.quantile(track.range_sd_m, 0.25)))

    @classmethod
    def from_truth(
        cls,
        truth: TrueTrack,
        time_s: npt.ArrayLike,
        analysis: Analysis,
        *,
        wavelength_m: float | None = None,
        error_m: float = 0.0,
    ) -> Self:
        """Make the gate around a body's true range, with a constant error like that of a tracker.

        Span and Doppler band are those of the analysis; the report's method has its own.
        """
        span_m, band_hz = analysis.gate_span_m, analysis.gate_doppler_hz
        if analysis.method == "liland2018":
            if wavelength_m is None:
                raise AnalysisError("the gate of method 'liland2018' uses the true Doppler band: set wavelength_m")
            span_m = LILAND_SPAN_M.get(truth.label, LILAND_SPAN_M["human"])
            doppler_hz = truth.doppler_hz(wavelength_m)
            band_hz = (float(np.nanmin(doppler_hz)), float(np.nanmax(doppler_hz)))
        there = np.isfinite(truth.centre_range_m)  # a gate ends where the body goes
        times_s, centre_m = np.asarray(time_s, dtype=float)[there], truth.centre_range_m[there]
        return cls(times_s, centre_m + error_m, span_m, band_hz, "truth")

    @staticmethod
    def parse(
        value: Any, *, names: Sequence[GateName] = ("track", "truth"), lowest_m: float = -math.inf, where: str = ""
    ) -> GateChoice:
        """Parse a gate: an allowed name, ``"1.2:2.8"`` or two ranges in m.

        A ConfigError names the key or option ``where``, or only the allowed values without it.
        """
        said = f"{where}: {value!r} is not allowed; it " if where else ""
        for name in names:
            if isinstance(value, str) and value == name:
                return name
        parts = value.split(":") if isinstance(value, str) else value
        try:
            low_m, high_m = (float(part) for part in parts)
        except (TypeError, ValueError):
            raise ConfigError(
                f"{said}must be {', '.join(names)} or FROM:TO in m, for example 1.2:2.8, or (1.2, 2.8) in Python"
            ) from None
        if not (-math.inf < low_m < high_m < math.inf and low_m >= lowest_m):
            lowest = "" if lowest_m == -math.inf else f", {lowest_m:g} or more"
            raise ConfigError(f"{said}must be two rising ranges in m{lowest}, for example 1.2:2.8")
        return low_m, high_m

    @property
    def low_m(self) -> FloatArray:
        """Lower limit R_L at ``time_s``."""
        return self.centre_m - self.span_m / 2

    @property
    def high_m(self) -> FloatArray:
        """Upper limit R_H at ``time_s``."""
        return self.centre_m + self.span_m / 2

    @property
    def start_s(self) -> float:
        """First time."""
        return float(self.time_s[0])

    @property
    def stop_s(self) -> float:
        """Last time."""
        return float(self.time_s[-1])

    @property
    def facts(self) -> dict[str, str | float | bool]:
        """Facts of the gate that a signature stores."""
        return {"source": self.source, "span_m": self.span_m, "doppler_limited": self.doppler_hz is not None}

    @property
    def limits(self) -> xr.Dataset:
        """Limits over time with labels and units, for figures."""
        low_hz, high_hz = self.doppler_hz or (-np.inf, np.inf)
        shape = self.time_s.shape
        values = {
            "range_low": (self.low_m, "m"),
            "range_high": (self.high_m, "m"),
            "doppler_low": (np.full(shape, low_hz), "Hz"),
            "doppler_high": (np.full(shape, high_hz), "Hz"),
        }
        return xr.Dataset(
            {name: ("time", array, {"units": units}) for name, (array, units) in values.items()},
            coords={"time": ("time", self.time_s, {"units": "s"})},
            attrs=self.facts,
        )

    def centre_at(self, time_s: npt.ArrayLike) -> FloatArray:
        """Interpolate the middle of the gate to other times."""
        # the middle of the limits, not centre_m: the last bit of older results
        middle = (self.low_m + self.high_m) / 2
        return np.asarray(np.interp(np.asarray(time_s, dtype=float), self.time_s, middle))

    def approach_mps(self, time_s: FloatArray) -> FloatArray:
        """Compute the radial velocity of the gate over half a second."""
        ends_s = np.clip(time_s + np.array([[-0.25], [0.25]]), self.start_s, self.stop_s)
        return np.asarray(-np.diff(self.centre_at(ends_s), axis=0)[0] / np.maximum(np.diff(ends_s, axis=0)[0], 1e-9))

    def shares(self, other: Gate, time_s: FloatArray | None = None) -> npt.NDArray[np.bool_]:
        """Mark the times, by default those of the gate, at which another gate overlaps in range."""
        times_s = self.time_s if time_s is None else time_s
        inside = (times_s >= other.start_s) & (times_s <= other.stop_s)
        apart_m = np.abs(self.centre_at(times_s) - other.centre_at(times_s))
        return np.asarray(inside & (apart_m < (self.span_m + other.span_m) / 2))

    def overlaps(self, other: Gate) -> bool:
        """Return True if two gates overlap in range."""
        return bool(self.shares(other).any())

    def during(self, start_s: float, stop_s: float) -> Gate:
        """Limit the gate to its times between two others."""
        chosen = (self.time_s >= start_s - SLACK_S) & (self.time_s <= stop_s + SLACK_S)
        return replace(self, time_s=self.time_s[chosen], centre_m=self.centre_m[chosen])

    def crop(self, frames: Frames) -> Frames:
        """Crop a recording to the times of the gate."""
        return frames.take_pulses(frames.slow_time.find_pulses(self.start_s, self.stop_s))

    def edges(self, range_m: FloatArray, time_s: npt.ArrayLike, *, sharp: bool) -> tuple[FloatArray, FloatArray]:
        """Compute lower and upper edges in range bins.

        The cell of a bin extends half a bin to either side. Sharp edges are placed between bins, so that every cell is
        entirely inside or outside (:meth:`whole_bins`). A recording with one bin is inside.
        """
        if range_m.size == 1:
            low = np.full(np.shape(time_s), -0.5)
            return low, low + 1.0
        first_m, spacing_m = float(range_m[0]), float((range_m[-1] - range_m[0]) / (range_m.size - 1))
        if sharp:
            first, count = self.whole_bins(time_s, first_bin_m=first_m, bin_spacing_m=spacing_m)
            low = first.astype(np.float64) - 0.5
            return low, low + count
        low = np.asarray((self.centre_at(time_s) - self.span_m / 2 - first_m) / spacing_m)
        return low, low + self.span_m / spacing_m

    def whole_bins(
        self, time_s: npt.ArrayLike, *, first_bin_m: float, bin_spacing_m: float
    ) -> tuple[npt.NDArray[np.int64], int]:
        """Compute first range bins and number of bins (E-27).

        These are ``ceil((R_L - r_min) / dR)``, also outside the frame, and ``floor(g / dR) + 1``.
        """
        low = self.centre_at(time_s) - self.span_m / 2
        first = np.ceil((low - first_bin_m) / bin_spacing_m - 1e-9).astype(np.int64)
        return first, int(np.floor(self.span_m / bin_spacing_m + 1e-9)) + 1

    def touched_bins(self, low: FloatArray, high: FloatArray, range_m: FloatArray) -> slice:
        """Return the range bins that the edges touch at any time, one or more."""
        if (high <= -0.5).all() or (low >= range_m.size - 0.5).all():
            raise _make_frame_error(float(self.low_m.min()), float(self.high_m.max()), range_m)
        return slice(max(math.floor(low.min()), 0), min(math.ceil(high.max()) + 1, range_m.size))

    def close_doppler_band(self, power: npt.NDArray[np.float32], doppler_hz: FloatArray) -> None:
        """Zero the Doppler cells of ``power``, shape (J, K), outside the gate's band, in place."""
        low_hz, high_hz = self.doppler_hz or (-math.inf, math.inf)
        power[:, (doppler_hz < low_hz) | (doppler_hz > high_hz)] = 0.0


def frame_limits_m(range_m: FloatArray) -> tuple[float, float]:
    """Compute the limits of a range axis with two or more cells."""
    half_m = float(range_m[1] - range_m[0]) / 2
    return float(range_m[0]) - half_m, float(range_m[-1]) + half_m


def _make_frame_error(low_m: float, high_m: float, range_m: FloatArray) -> AnalysisError:
    first_m, last_m = frame_limits_m(range_m)
    return AnalysisError(
        f"gate {low_m:.4g} to {high_m:.4g} m: lies outside the recorded frame, {first_m:.2f} to {last_m:.2f} m; use "
        "ranges inside"
    )
