"""Association of detections with tracks, nearest or joint probabilistic."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from doppelgait.core.units import FloatArray, exponential

MAX_EVENTS = 20_000
"""Largest number of joint events that is enumerated; a cluster with more events uses its best assignment."""


class Associations(NamedTuple):
    """Assignment and association weights of one scan. Shapes: assigned (T,); weights (T, D + 1)."""

    assigned: npt.NDArray[np.int64]
    weights: FloatArray


def compute_gate_threshold(probability: float) -> float:
    """Compute a gate threshold, the chi-square quantile -2 ln(1 - P)."""
    return -2.0 * math.log1p(-probability)


def associate(
    log_likelihood: FloatArray,
    *,
    detection_probability: float,
    gate_probability: float,
    clutter_density: float,
    association: str = "auto",
) -> Associations:
    """Assign the detections of one scan to tracks. Shapes: log_likelihood (T, D)."""
    tracks, detections = log_likelihood.shape
    assigned = np.full(tracks, -1, dtype=np.int64)
    weights = np.zeros((tracks, detections + 1))
    weights[:, -1] = 1.0
    gain = log_likelihood + math.log(detection_probability / clutter_density)  # of a hit, against clutter
    miss = math.log1p(-detection_probability * gate_probability)
    for rows, columns in find_clusters(np.isfinite(gain)):
        part = gain[np.ix_(rows, columns)]
        chosen = find_best_assignment(part, miss)
        assigned[rows] = [columns[c] if c >= 0 else -1 for c in chosen]
        shared = len(rows) > 1
        soft = association == "jpda" or (association == "auto" and shared)
        most_events = float(np.prod(np.isfinite(part).sum(axis=1) + 1.0))
        if soft and most_events <= MAX_EVENTS:
            table = compute_joint_probabilities(part, miss)
        else:
            table = np.zeros((part.shape[0], part.shape[1] + 1))
            table[range(len(chosen)), chosen] = 1.0  # -1 is the last column: none
        weights[np.ix_(rows, [*columns, detections])] = table
    return Associations(assigned, weights)


def find_clusters(in_gate: npt.NDArray[np.bool_]) -> list[tuple[list[int], list[int]]]:
    """Find connected groups of tracks and detections, without lonely tracks."""
    wanted = {t: {d for d, inside in enumerate(row) if inside} for t, row in enumerate(in_gate.tolist())}
    found: list[tuple[list[int], list[int]]] = []
    for track, own in wanted.items():
        if not own:
            continue
        rows, columns, rest = [track], set(own), []
        for group in found:  # every group that shares a detection with this track is merged with it
            if columns.isdisjoint(group[1]):
                rest.append(group)
            else:
                rows, columns = rows + group[0], columns.union(group[1])
        found = [*rest, (sorted(rows), sorted(columns))]
    return sorted(found)


def find_best_assignment(gain: FloatArray, miss: float) -> list[int]:
    """Find the assignment of the largest total gain, -1 for none (Hungarian method)."""
    tracks, detections = gain.shape
    if tracks == 1:
        best = int(gain[0].argmax())
        return [best if gain[0, best] > miss else -1]
    from scipy.optimize import linear_sum_assignment

    forbidden = np.full((tracks, tracks), -np.inf)
    np.fill_diagonal(forbidden, miss)
    padded = np.hstack([gain, forbidden])
    # scipy rejects a matrix in which -inf excludes every assignment; the misses allow one
    _, columns = linear_sum_assignment(padded, maximize=True)
    return [int(c) if c < detections else -1 for c in columns]


def compute_joint_probabilities(gain: FloatArray, miss: float) -> FloatArray:
    """Compute marginal association probabilities over all joint events, (T, D + 1)."""
    # Fortmann, Bar-Shalom and Scheffe 1983: in an event no detection has two tracks
    tracks, detections = gain.shape
    finite = gain[np.isfinite(gain)]
    top = max(float(finite.max()), miss) if finite.size else miss  # avoids overflow
    factors = np.hstack([exponential(gain - top), np.full((tracks, 1), math.exp(miss - top))])
    table = np.zeros((tracks, detections + 1))

    def extend(track: int, taken: tuple[int, ...], weight: float) -> None:
        if track == tracks:
            table[range(tracks), taken] += weight
            return
        for column in np.flatnonzero(factors[track]):
            if column == detections or column not in taken:
                extend(track + 1, (*taken, int(column)), weight * factors[track, column])

    extend(0, (), 1.0)
    return np.asarray(table / table.sum(axis=1, keepdims=True))
