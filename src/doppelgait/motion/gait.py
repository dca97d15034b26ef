"""Travel, footfalls, stride frequency and gait of a body (E-07)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from doppelgait.core.units import FloatArray
from doppelgait.motion.clean import fill_linear, find_body_centre, find_runs, find_stationary_points, pair_sides
from doppelgait.motion.motion import NAN, Motion, require_motion
from doppelgait.motion.skeleton import FOOT_PARTS

PERIOD_S = (0.25, 2.5)
OVERLAP_S = 0.25
"""Minimum overlap of the motion and its shifted copy."""
LIKENESS = 0.7
"""Minimum normalised autocorrelation of a repetition; 1 is an exact repetition."""
FIRST = 0.1
"""Tolerance from the highest peak within which the first peak is used, since multiples of the period are as high."""


def _first_peak_hz(here: FloatArray, there: FloatArray, rate_hz: float, period_s: tuple[float, float]) -> float:
    """Return the frequency of the first high correlation peak."""
    n = len(here)
    first, stop = int(period_s[0] * rate_hz), min(n - int(OVERLAP_S * rate_hz), int(period_s[1] * rate_hz))
    if first < 1 or stop - first < 3:
        return float("nan")
    likeness = np.empty(stop - first)
    for k in range(first, stop):
        a, b = here[: n - k].ravel(), there[k:].ravel()
        power = float(a @ a + b @ b)
        likeness[k - first] = 2.0 * float(a @ b) / power if power > 0.0 else 0.0
    before, now, after = likeness[:-2], likeness[1:-1], likeness[2:]
    peaks = np.flatnonzero((now >= before) & (now > after) & (now > LIKENESS))
    if not peaks.size:
        return float("nan")
    i = int(peaks[now[peaks] > now[peaks].max() - FIRST][0])
    # a parabola through the peak and its neighbours
    shift = 0.5 * (before[i] - after[i]) / (before[i] - 2.0 * now[i] + after[i])
    return float(rate_hz / (first + 1 + i + shift))


SMOOTHING_S = 0.5
"""Averaging time of the path of the body centre: about one step of a person."""
MIN_TRAVEL_M = 0.5
"""Smallest displacement with a direction, which fore-aft motion and stride require."""
STRIDE_BAND_HZ = (0.4, 6.0)


def smooth_path(position: FloatArray, *, rate_hz: float, smoothing_s: float = SMOOTHING_S) -> FloatArray:
    """Return the smoothed ground path of the body centre. Shapes: position (T, P, 3)."""
    return _smooth(find_body_centre(position)[:, :2], rate_hz=rate_hz, smoothing_s=smoothing_s)


def _smooth(path: FloatArray, *, rate_hz: float, smoothing_s: float) -> FloatArray:
    """Return the running mean of a path (T, 2)."""
    from scipy.ndimage import uniform_filter1d

    if len(path) < 2:
        return path
    width = max(1, round(smoothing_s * rate_hz)) | 1
    # straight continuation of the ends, since repeated end values would shorten the path
    edge = min(width // 2, len(path) - 1)
    longer = np.pad(path, ((edge, edge), (0, 0)), mode="reflect", reflect_type="odd") if edge else path
    return np.asarray(uniform_filter1d(longer, width, axis=0, mode="nearest")[edge : edge + len(path)])


def measure_travel(position: FloatArray, *, rate_hz: float) -> dict[str, Any]:
    """Measure displacement, path length, straightness and mean speed of points (T, P, 3)."""
    position = _find_seen_frames(position)
    path = find_body_centre(position)[:, :2]
    if len(path) < 2 or not np.isfinite(path).all():
        return {}
    # the sum of the mean steps of the seen points: points that appear or disappear cause no jump
    steps = np.diff(position[:, ~find_stationary_points(position), :2], axis=0)
    seen = np.asarray(np.isfinite(steps).all(axis=2))
    count = seen.sum(axis=1)[:, np.newaxis]
    total = np.where(seen[..., np.newaxis], steps, 0.0).sum(axis=1)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.diff(path, axis=0))
    path = path[0] + np.concatenate([np.zeros((1, 2)), np.cumsum(mean, axis=0)])
    path = _smooth(path, rate_hz=rate_hz, smoothing_s=SMOOTHING_S)
    step = np.diff(path, axis=0)
    net = path[-1] - path[0]
    length = float(np.linalg.norm(step, axis=1).sum())
    along = find_principal_direction(path)
    offset = path - path.mean(axis=0)
    lateral = offset - np.outer(offset @ along, along)
    speed = step @ along * rate_hz
    mean_speed = float(speed.mean())
    return {
        "travel_direction": f"{along[0]:+.2f}x{along[1]:+.2f}y".replace("-0.00", "+0.00"),
        "net_displacement_m": float(np.linalg.norm(net)),
        "path_length_m": length,
        "straightness": float(np.linalg.norm(net)) / length if length > 0 else None,
        "lateral_rms_m": float(np.sqrt((lateral**2).sum(axis=1).mean())),
        "mean_speed_mps": mean_speed,
        "speed_cv": float(speed.std() / mean_speed) if mean_speed > 0 else None,
    }


def _find_seen_frames(position: FloatArray) -> FloatArray:
    """Return the longest segment with half of the points seen."""
    seen = np.asarray(np.isfinite(position).all(axis=2))
    seen = seen[:, seen.any(axis=0)]
    if not seen.size:
        return position
    first, stop = max(find_runs(seen.mean(axis=1) >= 0.5), key=lambda run: run[1] - run[0], default=(0, 0))
    return position[first:stop]


def find_principal_direction(path: FloatArray) -> FloatArray:
    """Return the unit vector of a path's largest spread."""
    # the vector points in the direction of travel
    offset = path - path.mean(axis=0)
    along = np.linalg.svd(offset, full_matrices=False)[2][0]
    return np.asarray(-along if (path[-1] - path[0]) @ along < 0 else along)


def measure_stride(position: FloatArray, *, rate_hz: float) -> dict[str, Any]:
    """Measure stride and step frequency from the limbs' swing. Shapes: position (T, P, 3)."""
    # the spectra of the fore-aft motion of all points about the centre are summed
    none = {"stride_hz": None, "step_hz": None}
    position = _find_seen_frames(position)
    if len(position) < rate_hz * 0.8:
        return none
    path = smooth_path(position, rate_hz=rate_hz)
    if not np.isfinite(path).all() or np.linalg.norm(path[-1] - path[0]) < MIN_TRAVEL_M:
        return none
    from scipy.signal import detrend

    filled = fill_linear(position)
    filled = filled[:, np.isfinite(filled).all(axis=(0, 2)) & ~find_stationary_points(position)]
    centre = find_body_centre(position)
    swing = (filled[:, :, :2] - centre[:, np.newaxis, :2]) @ find_principal_direction(path)
    swing = detrend(swing, axis=0) * np.hanning(len(swing))[:, np.newaxis]
    n_fft = 1 << math.ceil(math.log2(len(swing) * 16))
    power = (np.abs(np.fft.rfft(swing, n_fft, axis=0)) ** 2).sum(axis=1)
    frequency = np.fft.rfftfreq(n_fft, 1.0 / rate_hz)
    band = (frequency >= STRIDE_BAND_HZ[0]) & (frequency <= STRIDE_BAND_HZ[1])
    if not power[band].any():
        return none
    best = int(np.argmax(power[band]))
    if best == 0:  # still rising towards slower motion: no stride
        return none
    stride = float(frequency[band][best])
    return {"stride_hz": stride, "step_hz": 2.0 * stride}


SWING_PEAK, SHORTEST_SWING_S = 1.4, 0.04
"""Minimum peak speed of a swing in body speeds (the foot is faster than the body), and duration."""
STILL = 0.01
"""A foot has landed when its speed has fallen to this share of its maximum in the swing."""
STANCE_SPEED = 0.5
"""A foot bears weight while its slowest point moves at less than half the body's speed."""
SLOWEST_BODY_MPS = 0.2
"""Speed below which a body stands. A swinging foot must be faster than this."""
LOW_POINTS = 0.15
"""Without named feet, points with a 5th percentile of height in the lowest 15 % of the body's height are feet."""


@dataclass(frozen=True)
class Steps:
    """Touchdowns and duty factor of one foot."""

    touchdown_s: FloatArray
    overtaken_s: FloatArray
    duty_factor: float


def is_quadruped(motion: Motion) -> bool:
    """Return True if a motion has paws or a non-human species."""
    paws = any(part.endswith("_paw") for part in motion.parts)
    return paws or motion.facts.species not in ("", "human")


def find_feet(motion: Motion) -> dict[str, list[int]]:
    """Find each foot's point numbers by name."""
    # names are left_foot and right_foot, or left_hind, left_fore and so on
    feet: dict[str, list[int]] = {}
    for n, part in enumerate(motion.parts):
        if part in FOOT_PARTS:
            feet.setdefault(part.removesuffix("_paw"), []).append(n)
    if feet:
        return feet
    position = fill_linear(motion.position_m)
    path = smooth_path(position, rate_hz=motion.rate_hz)
    if len(path) < 2 or not np.isfinite(path).all():
        return {}
    ahead = path[-1] - path[0]
    # comparisons with a point that was never seen are false, so it is not a foot
    offset = np.median(position[:, :, :2] - find_body_centre(position)[:, np.newaxis, :2], axis=0)
    left = offset @ np.array([-ahead[1], ahead[0]]) > 0
    hind = offset @ ahead < 0
    low = np.percentile(position[:, :, 2], 5, axis=0)
    near = low <= np.nanmin(low) + LOW_POINTS * (np.nanmax(position[:, :, 2]) - np.nanmin(low))
    four = is_quadruped(motion)
    for k in np.flatnonzero(near):
        end = ("hind" if hind[k] else "fore") if four else "foot"
        feet.setdefault(f"{'left' if left[k] else 'right'}_{end}", []).append(int(k))
    return feet if len(feet) == (4 if four else 2) else {}


def find_steps(motion: Motion, feet: Mapping[str, list[int]] | None = None) -> dict[str, Steps]:
    """Find touchdowns and duty factor of each foot."""
    # in the swing, a foot is faster than the body; on the ground, it is nearly at rest
    feet = find_feet(motion) if feet is None else feet
    position = motion.position_m
    rate, times = motion.rate_hz, motion.time_s
    path = smooth_path(position, rate_hz=rate)
    if len(path) < 5 or not np.isfinite(path).all():
        return {}
    velocity = np.gradient(path, 1.0 / rate, axis=0)
    body_mps = np.maximum(np.linalg.norm(velocity, axis=1), SLOWEST_BODY_MPS)
    ahead = velocity / body_mps[:, np.newaxis]
    found = {}
    for foot, points in feet.items():
        filled = fill_linear(position[:, points])
        filled = filled[:, np.isfinite(filled).all(axis=(0, 2)), :2]
        if filled.shape[1]:
            forward = np.einsum("tpk,tk->tp", np.gradient(filled, 1.0 / rate, axis=0), ahead)
            # swings of the foot, and the landing after each
            speed, slowest = forward.mean(axis=1), forward.min(axis=1)
            touchdown, overtaken, peaks = [], [], []
            for first, stop in find_runs(speed > body_mps):
                peak = first + int(np.argmax(speed[first:stop]))
                if speed[peak] < SWING_PEAK * body_mps[peak] or stop - first < SHORTEST_SWING_S * rate:
                    continue
                peaks.append(peak)
                slow = STILL * speed[peak]
                later = range(stop, len(speed) - 1)
                landed = next((n for n in later if speed[n] <= slow or speed[n + 1] >= speed[n]), None)
                if landed is not None:
                    touchdown.append(times[landed])
                    excess = (speed - body_mps)[stop - 1 : stop + 1]
                    overtaken.append(times[stop - 1] + excess[0] / (excess[0] - excess[1]) / rate)
            bears = slowest < STANCE_SPEED * body_mps
            duty = float(bears[peaks[0] : peaks[-1]].mean()) if len(peaks) > 1 else float("nan")
            found[foot] = Steps(np.array(touchdown), np.array(overtaken), duty)
    return found


SYMMETRICAL = ("walk", "run", "pace", "trot")
"""Gaits with mirrored half strides: a step is half a stride and f_mu = 2 f_stride (E-07)."""
ASYMMETRICAL = ("canter", "gallop", "transverse_gallop", "bound")
"""Gaits without mirrored half strides: f_mu = f_stride. ``gallop`` is the rotary gallop."""

HALF_STRIDE, TOGETHER = 0.15, 0.06
"""Tolerances of lags of half a stride and of 0 (simultaneous landing) of two limbs, in strides."""
QUARTER = 0.125
"""Half the spacing of the lateral lags of pace (0), walk (0.25) and trot (0.5), and limit between canter and gallop."""
STEADY = 0.8
"""Minimum length of the mean vector of a lag's phases over the strides. Below it, the lag is not constant."""
LANDING_HEIGHT = 0.25
"""Share of the paw's height range that 90 % of the touchdowns of a gallop do not exceed (recorded
gallops: at most 0.15; jumping dogs: 0.6 or more)."""
LEAST_LIFT_M = 0.02
LARGEST_SCATTER = 0.15
"""Maximum scatter of touchdowns about an even beat, in strides. Beyond it, the stride frequency is not measured."""
FLIGHT_ACCELERATION_MPS2 = -5.9
"""A body in flight falls at 9.81 m/s^2; 60 % of it is more than the dip of a brisk walk."""
PAIRS = {
    "lh_lf": ("left_hind", "left_fore"),
    "lh_rh": ("left_hind", "right_hind"),
    "lf_rf": ("left_fore", "right_fore"),
    "l_r": ("left_foot", "right_foot"),
}
"""Pairs of feet by the name of their lag, which is from the touchdown of the first foot to that of the second."""


@dataclass(frozen=True)
class GaitFacts:
    """Measured gait; unknown values are NaN, ``""`` or empty (E-07)."""

    gait: str = ""
    stride_frequency_hz: float = NAN
    step_frequency_hz: float = NAN
    gait_frequency_hz: float = NAN
    footfalls: dict[str, list[float]] = field(default_factory=dict)
    phases: dict[str, float] = field(default_factory=dict)
    duty_factor: float = NAN
    measured_from: str = ""


def measure_gait(motion: Motion) -> GaitFacts:
    """Measure footfalls, stride frequency, phases and gait. The speed should be about constant."""
    require_motion(motion)
    steps = find_steps(motion)
    footfalls = {foot: [float(t) for t in step.touchdown_s] for foot, step in steps.items()}
    stride_hz, source = fit_beat_hz([step.overtaken_s for step in steps.values()]), "footfalls"
    if not math.isfinite(stride_hz):
        stride_hz, source = _limbs_hz(motion), "autocorrelation"
    if not math.isfinite(stride_hz):
        return GaitFacts(footfalls=footfalls)
    # mean lag of every pair of feet, 0 to 1 strides; none if it is not constant
    phases: dict[str, float] = {}
    for name, (a, b) in ((name, pair) for name, pair in PAIRS.items() if set(pair) <= set(steps)):
        lags = (steps[b].touchdown_s[:, np.newaxis] - steps[a].touchdown_s) * stride_hz
        near = lags[np.abs(lags) < 1]
        vector = complex(np.exp(2j * np.pi * near).mean()) if near.size else 0j
        if abs(vector) >= STEADY:
            phases[name] = (math.atan2(vector.imag, vector.real) / (2 * math.pi)) % 1.0
    duties = [step.duty_factor for step in steps.values() if math.isfinite(step.duty_factor)]
    duty = float(np.mean(duties)) if duties else NAN
    gait = name_quadruped_gait(phases) if is_quadruped(motion) else _name_human_gait(motion, phases, duty)
    if gait in ASYMMETRICAL and not _has_low_paws(motion, footfalls):
        gait = ""
    return GaitFacts(gait, stride_hz, *step_and_gait_frequency_hz(gait, stride_hz), footfalls, phases, duty, source)


def _has_low_paws(motion: Motion, footfalls: Mapping[str, Sequence[float]]) -> bool:
    """Return True if the paws land low. In a leap, they stop in the air."""
    feet, heights = find_feet(motion), []
    for foot, touchdown_s in footfalls.items():
        z = fill_linear(motion.position_m[:, feet[foot]])[:, :, 2].min(axis=1)
        low, high = np.percentile(z, (5, 95))
        frames = np.round((np.array(touchdown_s) - motion.time_s[0]) * motion.rate_hz).astype(int)
        heights.append((z[frames] - low) / max(float(high - low), LEAST_LIFT_M))
    every = np.concatenate(heights or [np.empty(0)])
    return bool(every.size) and float(np.percentile(every, 90)) <= LANDING_HEIGHT


def _limbs_hz(motion: Motion) -> float:
    """Return the stride frequency of the limbs, or NaN."""
    position, rate = motion.position_m, motion.rate_hz
    path = smooth_path(position, rate_hz=rate)
    if len(path) < 3 or not np.isfinite(path).all() or np.linalg.norm(path[-1] - path[0]) < MIN_TRAVEL_M:
        return NAN
    seen = np.asarray(np.isfinite(position).all(axis=2).any(axis=0))
    relative = fill_linear(position[:, seen]) - find_body_centre(position)[:, np.newaxis]
    swing = np.stack([relative[:, :, :2] @ find_principal_direction(path), relative[:, :, 2]], axis=2)
    velocity = np.gradient(swing, axis=0)
    whole_hz = _first_peak_hz(velocity, velocity, rate, PERIOD_S)
    if math.isfinite(whole_hz):
        return whole_hz
    # in a walk, run, pace or trot, left parts repeat the motion of right parts half a stride later
    parts = [part for part, is_seen in zip(motion.parts, seen, strict=True) if is_seen]
    sides = [[swing[:, points].mean(axis=1) for points in both] for both in pair_sides(parts).values()]
    if not sides:
        return NAN
    left, right = (np.gradient(np.stack([pair[k] for pair in sides], axis=1), axis=0) for k in (0, 1))
    here, there = np.concatenate([left, right], axis=1), np.concatenate([right, left], axis=1)
    return _first_peak_hz(here, there, rate, (PERIOD_S[0] / 2, PERIOD_S[1] / 2)) / 2.0


def add_gait_facts(motion: Motion) -> Motion:
    """Add missing gait facts by measurement (E-07)."""
    measured, stated = measure_gait(motion), motion.facts
    gait, stride_hz = stated.gait or measured.gait, stated.stride_frequency_hz
    stride_hz = stride_hz if math.isfinite(stride_hz) else measured.stride_frequency_hz
    step_hz, gait_hz = step_and_gait_frequency_hz(gait, stride_hz)
    facts = replace(
        stated,
        gait=gait,
        footfalls=stated.footfalls or measured.footfalls,
        stride_from=measured.measured_from,
        stride_frequency_hz=stride_hz,
        step_frequency_hz=stated.step_frequency_hz if math.isfinite(stated.step_frequency_hz) else step_hz,
        gait_frequency_hz=stated.gait_frequency_hz if math.isfinite(stated.gait_frequency_hz) else gait_hz,
    )
    report = {"phases": measured.phases, "duty_factor": measured.duty_factor, "stride_from": measured.measured_from}
    return replace(motion, facts=facts).with_report(gait=report)


def step_and_gait_frequency_hz(gait: str, stride_frequency_hz: float) -> tuple[float, float]:
    """Return step frequency and f_mu of a gait (E-07). Undefined or unknown values are NaN."""
    if gait in SYMMETRICAL:
        return 2 * stride_frequency_hz, 2 * stride_frequency_hz
    return NAN, stride_frequency_hz if gait in ASYMMETRICAL else NAN


def name_quadruped_gait(phases: Mapping[str, float]) -> str:
    """Name the gait of a quadruped from footfall lags."""
    # Hildebrand (1965, 1977): in a symmetrical gait, both pairs have a lag of half a stride
    if not {"lh_lf", "lh_rh", "lf_rf"} <= set(phases):
        return ""
    hind, fore, side = (_wrap_about_zero(phases[name]) for name in ("lh_rh", "lf_rf", "lh_lf"))
    apart = [abs(abs(lag) - 0.5) <= HALF_STRIDE for lag in (hind, fore)]
    if all(apart):
        # mean of the left and the right side
        lag = abs(_wrap_about_zero(side + _wrap_about_zero(fore - hind) / 2))
        if lag < QUARTER:
            return "pace"
        return "trot" if lag > 0.5 - QUARTER else "walk"
    if any(apart):
        return ""
    if max(abs(hind), abs(fore)) <= TOGETHER:
        return "bound"
    if hind * fore < 0:
        return "gallop"
    # the later limb of the hind pair leads, the earlier one of the fore pair trails
    leading_hind = max(hind, 0.0)
    trailing_fore = side + min(fore, 0.0)
    return "canter" if abs(_wrap_about_zero(trailing_fore - leading_hind)) < QUARTER else "transverse_gallop"


def _name_human_gait(motion: Motion, phases: Mapping[str, float], duty: float) -> str:
    """Name a person's gait: walk, run or unknown."""
    # in a run, a foot bears weight for less than half of the stride, and the body falls freely between steps
    if "l_r" not in phases or abs(phases["l_r"] - 0.5) > HALF_STRIDE or not math.isfinite(duty):
        return ""
    # 2nd percentile of the vertical acceleration of the body centre, over spans of 0.1 s
    rate = motion.rate_hz
    half = max(1, round(0.05 * rate))
    z = find_body_centre(motion.position_m)[:, 2]
    if duty >= 0.5 or len(z) <= 2 * half:
        return "walk"
    lowest_mps2 = np.percentile((z[2 * half :] - 2 * z[half:-half] + z[: -2 * half]) * (rate / half) ** 2, 2)
    return "run" if lowest_mps2 < FLIGHT_ACCELERATION_MPS2 else "walk"


def fit_beat_hz(landings: list[FloatArray]) -> float:
    """Fit an even beat to all footfalls, in Hz. It is NaN if there is no even beat."""
    intervals = np.concatenate([np.diff(times) for times in landings] or [np.empty(0)])
    if intervals.size < min(2, len(landings)):
        return NAN
    period = float(np.median(intervals)) if intervals.size else NAN
    several = [times for times in landings if times.size > 1]
    # a missed landing counts as one more stride
    number = [np.concatenate([[0.0], np.cumsum(np.maximum(1, np.round(np.diff(t) / period)))]) for t in several]
    if not number:
        return NAN
    beats = np.concatenate([n - n.mean() for n in number])
    times = np.concatenate([t - t.mean() for t in several])
    fitted = float(beats @ times / (beats @ beats))
    scatter = float(np.sqrt(np.mean((times - fitted * beats) ** 2)))
    return 1.0 / fitted if scatter < LARGEST_SCATTER * fitted else NAN


def _wrap_about_zero(lag: float) -> float:
    return lag - math.floor(lag + 0.5)
