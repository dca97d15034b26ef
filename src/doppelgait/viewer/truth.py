"""What a simulation knows of the targets that an analysis found: which body each is, and what is true of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.labels import axis
from doppelgait.core.units import velocity_to_doppler_hz
from doppelgait.pipeline import TargetResult
from doppelgait.processing.gate import gate_centre_m
from doppelgait.radar.recording import Recording, TargetTruth

Span = tuple[float, float]
"""Start and stop, s."""
Truths = Callable[[float, float], dict[str, Any] | None]

NEAR_M = 0.8
"""Farther from a body than this, on the median, a gate does not follow that body."""
STILL = ("", "stand")
"""Gaits of what does not step."""
DIGITS = 6
"""Decimals of a true speed: what a model of something that stays adds up to is 0, not 1e-17 m/s."""


def span_of(result: TargetResult) -> Span:
    """Times that a result is about: of its piece, or all of its gate."""
    times_s = axis(result.gate_limits, "time")
    quality = result.quality
    return float(quality.get("start_s", times_s[0])), float(quality.get("stop_s", times_s[-1]))


def truths_of(recording: Recording, results: Sequence[TargetResult]) -> list[Truths]:
    """For every result, what gives the truth of its body between two times.

    A gate of the truth is of the body of the same number. Other gates are matched by range: each body to the result
    whose gate is nearest to it, on the median over the times of the result and within 0.8 m, and to no other result of
    the same time. In a gate that stays where the user said, it is the only body there.

    Parameters
    ----------
    recording : Recording
    results : sequence of TargetResult
    """
    times_s = axis(recording.baseband, "slow_time")
    matched = _matched(recording.truth, times_s, results)
    return [
        _truths(recording, None if body is None else recording.truth[body], result, times_s)
        for body, result in zip(matched, results, strict=True)
    ]


def _matched(
    truth: Sequence[TargetTruth], times_s: npt.NDArray[np.float64], results: Sequence[TargetResult]
) -> list[int | None]:
    """Number of the body of every result."""
    found: list[int | None] = [None] * len(results)
    pairs = []
    for number, body in product(range(len(results)), range(len(truth))):
        result = results[number]
        if result.gate == "truth":
            found[number] = number if number < len(truth) else None
        elif result.gate == "given":
            found[number] = _only_inside(truth, times_s, result)
        else:
            pairs.append((_distance_m(truth[body], times_s, result, span_of(result)), number, body))
    for distance_m, number, body in sorted(pairs):
        if distance_m >= NEAR_M or found[number] is not None:
            continue
        others = (n for n, known in enumerate(found) if known == body)
        if not any(_overlap(span_of(results[number]), span_of(results[n])) for n in others):
            found[number] = body
    return found


def _overlap(one: Span, other: Span) -> bool:
    return one[0] < other[1] and other[0] < one[1]


def _only_inside(truth: Sequence[TargetTruth], times_s: npt.NDArray[np.float64], result: TargetResult) -> int | None:
    """The body that is inside a fixed gate for most of the time; None where there are several or none."""
    gate = result.gate_limits
    low_m, high_m = float(gate["range_low"].values[0]), float(gate["range_high"].values[0])
    inside = [n for n, one in enumerate(truth) if low_m < np.median(one.centre_range_m) < high_m]
    touched = [n for n, one in enumerate(truth) if ((one.centre_range_m > low_m) & (one.centre_range_m < high_m)).any()]
    return inside[0] if len(inside) == 1 and touched == inside else None


def _distance_m(truth: TargetTruth, times_s: npt.NDArray[np.float64], result: TargetResult, span: Span) -> float:
    """Median distance of the middle of a gate from a body."""
    chosen = _during(times_s, span)
    middle_m = gate_centre_m(result.gate_limits, times_s[chosen])
    return float(np.median(np.abs(middle_m - truth.centre_range_m[chosen])))


def _during(times_s: npt.NDArray[np.float64], span: Span) -> npt.NDArray[np.bool_]:
    """Pulses between two times; all where none is between."""
    inside = (times_s >= span[0] - 1e-9) & (times_s <= span[1] + 1e-9)
    return inside if inside.any() else np.ones(times_s.shape, dtype=bool)


def _truths(
    recording: Recording, truth: TargetTruth | None, result: TargetResult, times_s: npt.NDArray[np.float64]
) -> Truths:
    def during(start_s: float, stop_s: float) -> dict[str, Any] | None:
        span = (start_s, stop_s)
        if truth is None:
            return None
        if result.gate == "track" and _distance_m(truth, times_s, result, span) >= NEAR_M:
            return None
        return true_values(truth, recording.radar.wavelength_m, _during(times_s, span))

    return during


def true_values(truth: TargetTruth, wavelength_m: float, during: npt.NDArray[np.bool_]) -> dict[str, Any]:
    """What a simulation knows of the features and frequencies, by their names; the rest under names of its own.

    Parameters
    ----------
    truth : TargetTruth
    wavelength_m : float
    during : ndarray of bool, shape (I,)
        Pulses that speeds are averaged over. Frequencies of the gait are known for the whole recording only.
    """
    radial_mps = round(float(np.mean(truth.centre_velocity_mps[during])), DIGITS) + 0.0
    steps = truth.gait not in STILL and truth.gait_frequency_hz > 0
    return {
        "torso_velocity_mps": radial_mps,
        "torso_doppler_hz": float(velocity_to_doppler_hz(radial_mps, wavelength_m)),
        "step_length_m": abs(radial_mps) / truth.gait_frequency_hz if steps else None,
        "harmonic_ratio_2": 2.0 if steps else None,
        "harmonic_ratio_3": 3.0 if steps else None,
        "gait_frequency_hz": truth.gait_frequency_hz if steps else None,
        "step_frequency_hz": truth.step_frequency_hz,
        "stride_frequency_hz": truth.stride_frequency_hz,
        "ground_speed_mps": truth.ground_speed_mps,
        "height_m": truth.height_m,
        "label": truth.label,
        "gait": truth.gait,
    }
