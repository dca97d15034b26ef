"""Verdicts: classification of targets as bodies, things, echoes or unknown.

Echoes have the path of another target. Whether the rest is a body, or more than one, is told by a network from
pictures of the power about the target's range and velocity, and from its features (``studies/verdicts.py``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np

from doppelgait import processing
from doppelgait.core.frames import Frames
from doppelgait.core.samples import Samples
from doppelgait.core.units import FloatArray, decimal_logarithm, exponential
from doppelgait.pipeline.result import DEFINITE, Result
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.gate import frame_limits_m
from doppelgait.processing.patches import N_CELLS, N_SLICES, Levels, compute_layers, draw_pictures
from doppelgait.processing.signature import compute_signature
from doppelgait.radar import Radar

STEP_S = 0.05  # time step of tracks and Doppler for verdicts
STRIP_M = 0.5  # range extent of the strip in which Doppler is measured, smaller than a body's gate
SIGNIFICANT = 4.0  # ratio to the noise floor above which a cell of a strip is used
STEPS_AT_ONCE = 4096  # number of averaged steps; all columns of an hour would need a gigabyte
FOLD_GAP_S, FOLD_EDGE_M, FOLD_RANGE_M, FOLD_SPEED, FOLD_LEVEL_DB = 1.0, 1.0, 0.4, 0.2, 8.0
"""Limits for a folded echo: longest pause between body and echo, largest distance from the edges of
the frame at that time, and largest differences in range, speed and level."""
SLOWEST_MPS = 0.15  # speed below which a target has no direction
SLICE_M, CELL_MPS, COLUMN_S = 0.12, 0.125, 0.1  # cells of pictures about track and velocity
NO_BODIES = {"thing", "reflection", "folded"}
MOST_SD = 4.0  # largest deviation of a value from its mean, in standard deviations
LEAST_MIRROR_S, LEAST_EXCESS_M, LEAST_CHANGE_M = 0.7, 0.3, 0.3
MIRROR_ERROR_M, MIRROR_DRIFT_PER_S = 0.03, 0.2
GHOST_LEVEL_DB, IN_STEP_LEVEL_DB = -11.0, 1.0
"""Highest level of a reflection relative to its body, without and with a common rhythm. The two-way
path by a brick wall loses 12 dB or more; small dogs are up to 10 dB weaker than people."""
RHYTHM_TOLERANCE, SURE, IN_STEP = 0.12, 0.5, 0.75
"""Relative difference and confidence of two rhythms, smallest correlation of a common one."""


@dataclass(frozen=True)
class TrackStrip:
    """Track and Doppler of a target over time: power_v2 (T, K), velocity_mps (K,)."""

    time_s: FloatArray
    range_m: FloatArray
    approach_mps: FloatArray
    power_v2: FloatArray
    velocity_mps: FloatArray

    @property
    def level_db(self) -> FloatArray:
        """Return the level, scaled to 1 m, in dB."""
        power_v2 = np.maximum(self.power_v2.sum(axis=1), 1e-30)
        return np.asarray(10.0 * decimal_logarithm(power_v2) + 40.0 * decimal_logarithm(np.maximum(self.range_m, 0.1)))

    def between(self, start_s: float, stop_s: float) -> TrackStrip:
        """Return the steps between two times."""
        kept = (self.time_s >= start_s - 1e-9) & (self.time_s <= stop_s + 1e-9)
        chosen = {name: values[kept] for name, values in vars(self).items() if name != "velocity_mps"}
        return replace(self, **chosen)


@dataclass(frozen=True)
class Verdict:
    """Verdict on a target: kind (body, thing, reflection, folded, unknown) and evidence."""

    kind: str = "body"
    flags: tuple[str, ...] = ()
    evidence: Mapping[str, float] = field(default_factory=dict)
    pictures: Levels | None = None


def judge(results: Sequence[Result], clean: Frames, analysis: Analysis, radar: Radar) -> list[Result]:
    """Add verdict, evidence and flags to tracked targets."""
    outside = Verdict("unknown", ("unknown_target:outside_the_frame",))
    verdicts = {n: outside if "track_start_s" in result.quality else Verdict() for n, result in enumerate(results)}
    seen: dict[int, TrackStrip] = {}
    for n, result in enumerate(results):
        gate = result.gate
        if verdicts[n] is outside and is_inside(gate, clean.range_m):
            frames = gate.crop(clean)
            if frames.samples.in_memory:  # as planes, which every strip reads
                frames = frames.with_samples(Samples.from_planes(frames.samples.planes, frames.n_pulses))
            seen[n] = observe_strip(gate, frames, analysis, radar.wavelength_m)
            slices = observe_slices(gate, frames, analysis, radar.wavelength_m, seen[n])
            verdicts[n] = judge_body(result, seen[n], slices)
    folding_m = radar.waveform.unambiguous_range_m(radar) if radar.folds_pulses else None
    for n, other in permutations(seen, 2):
        if not NO_BODIES.isdisjoint((verdicts[n].kind, verdicts[other].kind)):
            continue
        found = None
        if folding_m is not None:
            found = judge_fold(seen[n], seen[other], other, folding_m=folding_m, frame_stop_m=radar.range_stop_m)
        found = found or judge_reflection(seen[n], seen[other], other, _get_rhythms(results[n], results[other]))
        if found is not None:
            evidence = {**verdicts[n].evidence, **found.evidence}
            verdicts[n] = replace(verdicts[n], kind=found.kind, flags=found.flags, evidence=evidence)
    return [mark_result(result, verdicts[n]) for n, result in enumerate(results)]


def judge_body(result: Result, strip: TrackStrip, slices: Levels) -> Verdict:
    """Decide by the evidence whether a target is a body, and whether it is more than one."""
    values = {**result.extended, **result.quality, **measure_way(strip)}
    values["without_range"] = float("track_range_m" not in result.quality)
    columns_s = strip.time_s[0] + COLUMN_S * np.arange(slices.shape[1])
    pictures = draw_pictures(slices, np.interp(columns_s, strip.time_s, strip.approach_mps))
    body, several = compute_probabilities(values, pictures)
    several = float(result.quality.get("both_directions", several))  # without range, only this tells two from one
    found = {"body_probability": body, "more_than_one_probability": several}
    if 1.0 - body >= DEFINITE:
        return Verdict("thing", ("not_a_moving_body:moves_like_a_thing",), found, pictures)
    flags = ("may_be_more_than_one_body",) if 1.0 - several <= DEFINITE else ()
    if body < DEFINITE:
        return Verdict("unknown", ("unknown_target:body_or_thing", *flags), found, pictures)
    return Verdict("body", flags, found, pictures)


def compute_probabilities(values: Mapping[str, Any], pictures: Levels) -> tuple[float, float]:
    """Compute the probabilities of a body, and of more than one; missing values are means."""
    network = load_network()
    given = np.array([float("nan") if values.get(name) is None else values[name] for name in network["names"]])
    scaled = np.clip((given - network["mean"]) / network["sd"], -MOST_SD, MOST_SD)
    scaled = np.where(np.isfinite(given), scaled, 0.0)
    n_layers = sum(name.startswith("kernel") for name in network)
    layers = [(network[f"kernel_{n}"], network[f"scale_{n}"], network[f"bias_{n}"]) for n in range(n_layers)]
    layer = compute_layers(pictures, layers)
    inputs = [layer.mean(axis=(2, 3)), layer.max(axis=(2, 3)), np.tile(scaled, (len(pictures), 1))]
    hidden = np.maximum(np.concatenate(inputs, axis=1) @ network["hidden"].T + network["offsets"], 0.0)
    logits = (hidden @ network["output"].T + network["shifts"]).mean(axis=0)
    body, several = np.round(1.0 / (1.0 + exponential(-logits)), 4)  # more digits depend on the processor
    return float(body), float(several)


@cache
def load_network() -> dict[str, Any]:
    """Load the network with names, means and standard deviations of its values."""
    with np.load(Path(__file__).with_name("evidence.npz"), allow_pickle=False) as file:
        return dict(file)


def mark_result(result: Result, verdict: Verdict) -> Result:
    """Add verdict, evidence and flags to a target and its segments."""
    quality: dict[str, Any] = {**result.quality, "verdict": verdict.kind, **verdict.evidence}
    segments = tuple(mark_result(segment, replace(verdict, pictures=None)) for segment in result.segments)
    flags = (*result.flags, *verdict.flags)
    return replace(result, quality=quality, flags=flags, segments=segments, pictures=verdict.pictures)


def is_echo(result: Result, number: int) -> bool:
    """Return True for the echo of a numbered target."""
    return not {f"reflection_of:{number}", f"folded_echo_of:{number}"}.isdisjoint(result.flags)


def _get_rhythms(ghost: Result, body: Result) -> tuple[float, float] | None:
    both = (ghost, body)
    if any(one.gait_frequency_hz is None or (one.quality.get("gait_confidence") or 0.0) < SURE for one in both):
        return None
    return float(ghost.gait_frequency_hz or 0.0), float(body.gait_frequency_hz or 0.0)


def is_inside(gate: Gate, range_m: FloatArray) -> bool:
    """Return True if a gate's centre is ever in the frame."""
    first_m, last_m = frame_limits_m(range_m)
    return bool(((gate.centre_m > first_m) & (gate.centre_m < last_m)).any())


def observe_strip(
    gate: Gate, frames: Frames, analysis: Analysis, wavelength_m: float, *, span_m: float = STRIP_M
) -> TrackStrip:
    """Measure Doppler in a strip around a target's track."""
    strip = Gate(gate.time_s, gate.centre_m, span_m)
    mu = processing.decimate(compute_signature(frames, strip, analysis, wavelength_m=wavelength_m))
    floor_v2, times_s = processing.noise_floor_v2(mu), mu.axis("time")
    velocity_mps = mu.axis("doppler") * wavelength_m / 2
    every = max(round(STEP_S / max(float(np.median(np.diff(times_s))), 1e-9)), 1) if times_s.size > 1 else 1
    steps = max(times_s.size // every, 1)
    grouped = []  # means of the power above the noise
    for first in range(0, steps, STEPS_AT_ONCE):
        values = mu.values[first * every : min(first + STEPS_AT_ONCE, steps) * every]
        excess_v2 = np.where(values > SIGNIFICANT * floor_v2, values - floor_v2, 0.0)
        grouped.append(excess_v2.reshape(-1, min(every, len(values)), values.shape[1]).mean(axis=1))
    del mu, values  # as long as the recording
    time_s = times_s[: steps * every].reshape(steps, -1).mean(axis=1)
    return TrackStrip(time_s, gate.centre_at(time_s), gate.approach_mps(time_s), np.concatenate(grouped), velocity_mps)


def observe_slices(gate: Gate, frames: Frames, analysis: Analysis, wavelength_m: float, strip: TrackStrip) -> Levels:
    """Measure the power in slices along range about a track: (slices, columns, cells)."""
    slices, nothing = [], 0.0 * align_power(strip)  # outside the frame
    for number in range(-(N_SLICES // 2), N_SLICES // 2 + 1):
        near = replace(gate, centre_m=gate.centre_m + SLICE_M * number)
        inside = is_inside(near, frames.range_m)
        own = observe_strip(near, frames, analysis, wavelength_m, span_m=SLICE_M) if inside else None
        slices.append(nothing if own is None else align_power(own))
    return np.stack(slices)


def align_power(one: TrackStrip) -> Levels:
    """Sum the power in the cells of a picture, about the target's own velocity. Shapes: returns (columns, cells)."""
    step_mps, n_velocities = float(one.velocity_mps[1] - one.velocity_mps[0]), one.velocity_mps.size
    edges_mps, half_mps = CELL_MPS * (np.arange(N_CELLS + 1) - N_CELLS / 2), step_mps * n_velocities / 2
    if one.velocity_mps[0] < 0.0:  # every cell once, unfolded about the own velocity
        edges_mps = np.clip(edges_mps, -half_mps, half_mps)
    place = (edges_mps + one.approach_mps[:, None] - one.velocity_mps[0]) / step_mps + 0.5
    if one.velocity_mps[0] >= 0.0:
        place = np.clip(place, 0.0, n_velocities)
    turns, place = np.divmod(place, n_velocities)
    low = np.minimum(place.astype(np.int64), n_velocities - 1)
    summed = np.pad(np.cumsum(one.power_v2, axis=1), ((0, 0), (1, 0)))
    part = np.take_along_axis(one.power_v2, low, axis=1) * (place - low) + turns * summed[:, -1:]
    cells = np.diff(np.take_along_axis(summed, low, axis=1) + part, axis=1)
    steps, n_columns = one.time_s.size, max(int((one.time_s[-1] - one.time_s[0]) / COLUMN_S), 1)
    column_s = one.time_s[0] + COLUMN_S * (np.arange(n_columns) + 0.25)  # between two steps
    at = np.interp(column_s, one.time_s, np.arange(steps))
    before = np.minimum(at.astype(np.int64), max(steps - 2, 0))
    share = (at - before)[:, None]
    return np.asarray((1.0 - share) * cells[before] + share * cells[np.minimum(before + 1, steps - 1)], np.float32)


def measure_way(one: TrackStrip) -> dict[str, float]:
    """Measure how far, how fast and how straight a target moves."""
    seconds = float(one.time_s[-1] - one.time_s[0]) + STEP_S
    speed_mps = np.abs(one.approach_mps)
    ahead = np.where(speed_mps > SLOWEST_MPS, np.sign(one.approach_mps), 0.0)
    return {
        "duration": math.log10(seconds),
        "median_speed": math.log10(max(float(np.median(speed_mps)), 1e-2)),
        "range_span": math.log10(max(float(np.ptp(one.range_m)), 1e-2)),
        "net_way": abs(float(one.approach_mps.sum())) / max(float(speed_mps.sum()), 1e-2),
        "turns_per_s": np.count_nonzero(np.diff(ahead[ahead != 0.0])) / seconds,
    }


def judge_fold(
    one: TrackStrip, body: TrackStrip, number: int, *, folding_m: float, frame_stop_m: float
) -> Verdict | None:
    """Recognise a folded echo from beyond the frame."""
    later = one.time_s[0] > body.time_s[0]
    first, second = (body, one) if later else (one, body)
    gap_s = float(second.time_s[0] - first.time_s[-1])
    if not -FOLD_GAP_S <= gap_s <= FOLD_GAP_S:
        return None
    far, near = (-1, 0) if later else (0, -1)
    if body.range_m[far] < frame_stop_m - FOLD_EDGE_M or one.range_m[near] > FOLD_EDGE_M:
        return None
    # the second before the edge, without its last half, when a part of the body is outside
    count = min(one.time_s.size, body.time_s.size)
    skip, stop = min(10, count // 2), min(30, count)
    edge = slice(-stop, -skip or None) if later else slice(skip, stop)  # of the body
    own_edge = slice(skip, stop) if later else slice(-stop, -skip or None)
    speed_mps, own_mps = (float(np.median(x)) for x in (body.approach_mps[edge], one.approach_mps[own_edge]))
    if speed_mps * own_mps <= 0 or abs(own_mps - speed_mps) > FOLD_SPEED * abs(speed_mps) + 0.05:
        return None
    expected_m = body.range_m[edge].mean() - speed_mps * (one.time_s[own_edge].mean() - body.time_s[edge].mean())
    error_m = float(one.range_m[own_edge].mean() + folding_m - expected_m)
    true = replace(one, range_m=one.range_m + folding_m)
    level_db = float(np.median(true.level_db[own_edge]) - np.median(body.level_db[edge]))
    if abs(error_m) > FOLD_RANGE_M or abs(level_db) > FOLD_LEVEL_DB:
        return None
    return Verdict("folded", (f"folded_echo_of:{number}",), {"fold_error_m": error_m, "fold_level_db": level_db})


def judge_reflection(
    ghost: TrackStrip, body: TrackStrip, number: int, rhythms: tuple[float, float] | None
) -> Verdict | None:
    """Recognise a body's echo from a vertical wall."""
    # the mirror image has the range g with g^2 = R^2 + 4 q
    start_s, stop_s = max(ghost.time_s[0], body.time_s[0]), min(ghost.time_s[-1], body.time_s[-1])
    own, direct = ghost.between(start_s, stop_s), body.between(start_s, stop_s)
    if stop_s - start_s < LEAST_MIRROR_S or own.time_s.size < 8 or direct.time_s.size < 8:
        return None
    if stop_s - start_s < 0.9 * (ghost.time_s[-1] - ghost.time_s[0]):
        return None  # a ghost exists only together with its body
    range_m = np.interp(own.time_s, direct.time_s, direct.range_m)
    excess_m = own.range_m - range_m
    if excess_m.min() < LEAST_EXCESS_M or np.ptp(excess_m) < LEAST_CHANGE_M:
        return None
    if rhythms is not None and abs(rhythms[0] - rhythms[1]) > RHYTHM_TOLERANCE * rhythms[1]:
        return None
    level_db = float(np.median(own.level_db - np.interp(own.time_s, direct.time_s, direct.level_db)))
    in_step = correlate_rhythms(own, direct)
    if level_db > (IN_STEP_LEVEL_DB if in_step > IN_STEP else GHOST_LEVEL_DB):
        return None
    found: list[tuple[float, float]] = []
    for product, path in ((own.range_m * excess_m, "one_way"), ((own.range_m**2 - range_m**2) / 4, "two_ways")):
        centre_s = own.time_s - own.time_s.mean()
        drift, mean = np.polyfit(centre_s, product, 1)
        fitted = np.maximum(mean + drift * centre_s, 0.0)
        image_m = np.sqrt(range_m**2 + 4 * fitted)
        modelled_m = (range_m + image_m) / 2 if path == "one_way" else image_m
        error_m = float(np.sqrt(np.mean((modelled_m - own.range_m) ** 2)))
        if error_m <= MIRROR_ERROR_M and abs(drift) <= MIRROR_DRIFT_PER_S * mean:
            found.append((error_m, float(mean)))
    if not found:
        return None
    error_m, mean_m2 = min(found)
    evidence = {
        "mirror_error_m": error_m,
        "mirror_product_m2": mean_m2,
        "mirror_level_db": level_db,
        "mirror_rhythm_correlation": in_step,
    }
    return Verdict("reflection", (f"reflection_of:{number}",), evidence)


def correlate_rhythms(one: TrackStrip, other: TrackStrip) -> float:
    """Correlate the Doppler rhythms of two targets. Returns the smaller of both correlations."""
    found = []
    for first, second in zip(_compute_moments(one), _compute_moments(other), strict=True):
        second = np.interp(one.time_s, other.time_s, second)
        order = 1 if np.ptp(one.time_s) < 1.5 else 2
        both = [x - np.polynomial.Polynomial.fit(one.time_s, x, order)(one.time_s) for x in (first, second)]
        power = float(np.sqrt((both[0] ** 2).sum() * (both[1] ** 2).sum()))
        found.append(float((both[0] * both[1]).sum()) / power if power > 0 else 0.0)
    return min(found)


def _compute_moments(one: TrackStrip) -> tuple[FloatArray, FloatArray]:
    amplitude = np.sqrt(one.power_v2) + 1e-30
    total = amplitude.sum(axis=1)
    mean_mps = (amplitude * one.velocity_mps).sum(axis=1) / total
    squared = (amplitude * (one.velocity_mps[None, :] - mean_mps[:, None]) ** 2).sum(axis=1) / total
    return mean_mps, np.sqrt(squared)
