"""Verdicts: classification of targets as bodies, things, echoes or unknown.

Echoes of another target are recognised by their path (:func:`judge_reflection`, :func:`judge_fold`). Whether the rest
is a body, and whether it is more than one, are probabilities: networks of one hidden layer with the evidence of
:func:`measure_evidence` as input, learned on simulated scenes of many kinds (``studies/verdicts.py``).
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
from doppelgait.core.config import read_toml
from doppelgait.core.frames import Frames
from doppelgait.core.units import FloatArray, decimal_logarithm, exponential
from doppelgait.pipeline.result import Result
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.gate import frame_limits_m
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
SIDE_MPS = 0.3  # difference from the target's own velocity above which power is from moving parts
SURE_BODY = 0.6  # least probability of a body; a thing has its complement at most, in between it is unknown
DOUBT_ONE = 0.2  # probability of more than one body from which a target is flagged
NO_BODIES = {"thing", "reflection", "folded"}
MOST_SD = 4.0  # largest deviation of a value from its mean, in standard deviations
EDGE_SHARE = 0.003  # power of a cell relative to the strongest one of its step up to which the spectrum reaches
LEAST_MIRROR_S, LEAST_EXCESS_M, LEAST_CHANGE_M = 0.7, 0.3, 0.3
MIRROR_ERROR_M, MIRROR_DRIFT_PER_S = 0.03, 0.2
GHOST_LEVEL_DB, IN_STEP_LEVEL_DB = -11.0, 1.0
"""Highest level of a reflection relative to its body, without and with a common rhythm.
The two-way path by a brick wall loses 12 dB or more; small dogs are up to 10 dB weaker than people."""
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
    """Verdict on one target with its evidence. ``kind`` is body, thing, reflection, folded or unknown."""

    kind: str = "body"
    flags: tuple[str, ...] = ()
    evidence: Mapping[str, float] = field(default_factory=dict)


def judge(results: Sequence[Result], clean: Frames, analysis: Analysis, radar: Radar) -> list[Result]:
    """Add verdict, evidence and flags to tracked targets."""
    first_m, last_m = frame_limits_m(clean.range_m)
    seen = {
        n: observe_strip(result.gate, clean, analysis, radar.wavelength_m)
        for n, result in enumerate(results)
        if "track_start_s" in result.quality
        and ((result.gate.centre_m > first_m) & (result.gate.centre_m < last_m)).any()
    }
    verdicts = {n: Verdict() for n in range(len(results))}
    verdicts |= {n: judge_body(results[n], strip) for n, strip in seen.items()}
    folding_m = radar.waveform.unambiguous_range_m(radar) if radar.folds_pulses else None
    for n, other in permutations(seen, 2):
        if not NO_BODIES.isdisjoint((verdicts[n].kind, verdicts[other].kind)):
            continue
        found = None
        if folding_m is not None:
            found = judge_fold(seen[n], seen[other], other, folding_m=folding_m, frame_stop_m=radar.range_stop_m)
        found = found or judge_reflection(seen[n], seen[other], other, _get_rhythms(results[n], results[other]))
        if found is not None:
            verdicts[n] = replace(found, evidence={**verdicts[n].evidence, **found.evidence})
    return [mark_result(result, verdicts[n]) for n, result in enumerate(results)]


def judge_body(result: Result, strip: TrackStrip) -> Verdict:
    """Decide by the evidence whether a target is a body, and whether it is more than one."""
    evidence = measure_evidence(strip) | {"without_range": float("track_range_m" not in result.quality)}
    body, several = compute_probabilities({**result.extended, **result.quality, **evidence})
    several = float(result.quality.get("both_directions", several))  # without range nothing else tells two from one
    found = {"body_probability": body, "more_than_one_probability": several}
    if body <= 1.0 - SURE_BODY:
        return Verdict("thing", ("not_a_moving_body:moves_like_a_thing",), found)
    flags = ("may_be_more_than_one_body",) if several >= DOUBT_ONE else ()
    if body < SURE_BODY:
        return Verdict("unknown", ("unknown_target:body_or_thing", *flags), found)
    return Verdict("body", flags, found)


def compute_probabilities(values: Mapping[str, Any]) -> tuple[float, float]:
    """Compute the probabilities of a body, and of more than one; what is missing counts as its mean."""
    table = load_networks()
    given = np.array([float("nan") if values.get(name) is None else values[name] for name in table["names"]])
    scaled = np.clip((given - table["mean"]) / table["sd"], -MOST_SD, MOST_SD)
    scaled = np.where(np.isfinite(given), scaled, 0.0)
    found = []
    for network in (table["body"], table["several"]):
        hidden = np.maximum((np.array(network["hidden"]) * scaled).sum(axis=1) + network["offsets"], 0.0)
        logit = float((hidden * network["output"]).sum()) + network["offset"]
        found.append(float(1.0 / (1.0 + exponential(np.array([-logit]))[0])))
    return found[0], found[1]


@cache
def load_networks() -> dict[str, Any]:
    """Load names, means and standard deviations of the evidence, and both networks."""
    return read_toml(Path(__file__).with_name("evidence.toml"))[0]


def mark_result(result: Result, verdict: Verdict) -> Result:
    """Add verdict, evidence and flags to a target and its segments."""
    quality: dict[str, Any] = {**result.quality, "verdict": verdict.kind, **verdict.evidence}
    segments = tuple(mark_result(segment, verdict) for segment in result.segments)
    return replace(result, quality=quality, flags=(*result.flags, *verdict.flags), segments=segments)


def is_echo(result: Result, number: int) -> bool:
    """Return True for the echo of a numbered target."""
    return not {f"reflection_of:{number}", f"folded_echo_of:{number}"}.isdisjoint(result.flags)


def _get_rhythms(ghost: Result, body: Result) -> tuple[float, float] | None:
    both = (ghost, body)
    if any(one.gait_frequency_hz is None or (one.quality.get("gait_confidence") or 0.0) < SURE for one in both):
        return None
    return float(ghost.gait_frequency_hz or 0.0), float(body.gait_frequency_hz or 0.0)


def observe_strip(gate: Gate, clean: Frames, analysis: Analysis, wavelength_m: float) -> TrackStrip:
    """Measure Doppler in a strip around a target's track."""
    strip = Gate(gate.time_s, gate.centre_m, STRIP_M)
    mu = processing.decimate(compute_signature(gate.crop(clean), strip, analysis, wavelength_m=wavelength_m))
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


def measure_evidence(one: TrackStrip) -> dict[str, float]:
    """Measure how a target moves, and how its power lies about its own velocity."""
    seconds = float(one.time_s[-1] - one.time_s[0]) + STEP_S
    step_s, speed_mps = seconds / one.time_s.size, np.abs(one.approach_mps)
    total_v2 = max(float(one.power_v2.sum()), 1e-30)
    ahead = np.where(speed_mps > SLOWEST_MPS, np.sign(one.approach_mps), 0.0)
    forward_mps = one.velocity_mps[None, :] * ahead[:, None]
    relative_mps = one.velocity_mps[None, :] - one.approach_mps[:, None]
    leading_mps, reach_mps = relative_mps * ahead[:, None], np.maximum(SIDE_MPS, 0.4 * speed_mps)[:, None]
    leading, backward, line, above, below = (
        float(one.power_v2[cells].sum()) / total_v2
        for cells in (
            leading_mps > reach_mps,
            forward_mps < -SIDE_MPS,
            np.abs(relative_mps) <= reach_mps,
            relative_mps > SIDE_MPS,
            relative_mps < -SIDE_MPS,
        )
    )
    # edges of the spectrum about the target's own velocity, in the direction of its motion
    peak_v2 = one.power_v2.max(axis=1, keepdims=True)
    cells = (one.power_v2 > EDGE_SHARE * peak_v2) & (one.power_v2 > 0.0)
    outward_mps = relative_mps * np.where(ahead == 0.0, 1.0, ahead)[:, None]
    lead_mps, lag_mps = (
        np.where(cells, edge, -np.inf).max(axis=1)[cells.any(axis=1)] for edge in (outward_mps, -outward_mps)
    )
    lead_90, lag_90 = (float(np.quantile(edge_mps, 0.9)) if edge_mps.size else 0.0 for edge_mps in (lead_mps, lag_mps))
    # the path: R^2 of a straight one is quadratic in time
    square_m2, way_m = one.range_m**2, float(speed_mps.sum()) * step_s
    bend = np.polynomial.Polynomial.fit(one.time_s, square_m2, 2)
    curvature = float(bend.deriv(2)(0.0)) / 2.0
    residual_m = (square_m2 - bend(one.time_s)) / (2.0 * one.range_m)
    decades = {
        "leading_power": (leading, 1e-3),
        "backward_power": (backward, 1e-3),
        "balance_power": (min(above, below) / max(above, below, 1e-9), 1e-3),
        "lead_90": (lead_90, 0.02),
        "lag_90": (lag_90, 0.02),
        "range_span": (float(np.ptp(one.range_m)), 1e-2),
        "ground_way": (math.sqrt(max(curvature, 0.0)) * seconds, 1e-2),
        "bend": (float(np.sqrt(np.mean(residual_m**2))), 1e-2),
        "median_speed": (float(np.median(speed_mps)), 1e-2),
        "duration": (seconds, 1e-2),
    }
    return {
        **{name: math.log10(max(value, least)) for name, (value, least) in decades.items()},
        "line_power": line,
        "net_way": abs(float(one.approach_mps.sum())) * step_s / max(way_m, 1e-2),
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
