"""Which track follows which target: for the label of a row only, no feature sees it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from doppelgait.core.labels import axis
from doppelgait.pipeline import TargetResult
from doppelgait.radar.recording import TargetTruth

MOST_APART_M = 1.0
"""A track that is farther from the body than this, in the mean, is of something else."""
LEAST_SHARE = 0.3
"""Part of the observation that a track must cover."""


def match_tracks(
    results: Sequence[TargetResult], truths: Sequence[TargetTruth], observation_s: float
) -> list[TargetResult | None]:
    """Result of every target: the nearest track to its body, each track used once, nearest pairs first.

    Parameters
    ----------
    results : sequence of TargetResult
        With gates from tracks.
    truths : sequence of TargetTruth
    observation_s : float
    """
    found: list[TargetResult | None] = [None] * len(truths)
    pairs = sorted(
        (distance_m, number, place)
        for number, truth in enumerate(truths)
        for place, result in enumerate(results)
        if (distance_m := _distance_m(result, truth, observation_s)) <= MOST_APART_M
    )
    used: set[int] = set()
    for _, number, place in pairs:
        if found[number] is None and place not in used:
            found[number] = results[place]
            used.add(place)
    return found


def _distance_m(result: TargetResult, truth: TargetTruth, observation_s: float) -> float:
    """Mean distance between the middle of a gate and the body; infinite where the track is too short."""
    times_s = axis(result.gate_limits, "time")
    if times_s.size < 2 or times_s[-1] - times_s[0] < LEAST_SHARE * observation_s:
        return float("inf")
    middle_m = (result.gate_limits["range_low"].values + result.gate_limits["range_high"].values) / 2.0
    true_times_s = np.linspace(0.0, observation_s, truth.centre_range_m.size, endpoint=False)
    return float(np.abs(middle_m - np.interp(times_s, true_times_s, truth.centre_range_m)).mean())


def strongest_track(results: Sequence[TargetResult]) -> list[TargetResult | None]:
    """For an empty room: the track that is surest to be something, if there is any."""
    tracked = [result for result in results if "track_confidence" in result.quality]
    return [max(tracked, key=lambda result: float(result.quality["track_confidence"]), default=None)]
