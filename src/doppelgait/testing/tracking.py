"""Agreement of tracks with a reference: distances, purity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


class Gospa(NamedTuple):
    """GOSPA at one time (Rahmathullah, Garcia-Fernandez, Svensson, FUSION 2017, Proposition 1)."""

    distance: float
    localisation: float
    missed: float
    false: float
    n_missed: int
    n_false: int


def ospa(found: npt.ArrayLike, reference: npt.ArrayLike, *, cutoff: float = 1.0, order: float = 2.0) -> float:
    """Compute the optimal subpattern assignment distance (OSPA)."""
    n_found, n_reference, pairs = _pair_points(found, reference, cutoff, order)
    n = max(n_found, n_reference)
    if n == 0:
        return 0.0
    total = pairs.sum() + cutoff**order * (n - len(pairs))
    return float((total / n) ** (1 / order))


def gospa(found: npt.ArrayLike, reference: npt.ArrayLike, *, cutoff: float = 1.0, order: float = 2.0) -> Gospa:
    """Compute the generalised OSPA with alpha = 2."""
    n_found, n_reference, pairs = _pair_points(found, reference, cutoff, order)
    pairs = pairs[pairs < cutoff**order]
    n_missed, n_false = n_reference - len(pairs), n_found - len(pairs)
    half = cutoff**order / 2
    localisation = float(pairs.sum())
    total = localisation + half * (n_missed + n_false)
    return Gospa(total ** (1 / order), localisation, half * n_missed, half * n_false, n_missed, n_false)


@dataclass(frozen=True)
class Agreement:
    """Tracks against reference tracks over all times."""

    gospa: float
    ospa: float
    rms: float
    completeness: FloatArray
    purity: FloatArray
    owner: npt.NDArray[np.int64]
    switches: int
    first_match: npt.NDArray[np.int64]


def compare_tracks(
    found: npt.ArrayLike, reference: npt.ArrayLike, *, cutoff: float = 1.0, order: float = 2.0
) -> Agreement:
    """Compare tracks with reference tracks."""
    tracks, truths = (np.atleast_2d(np.asarray(values, dtype=float)) for values in (found, reference))
    matches = np.full(truths.shape, -1, dtype=np.int64)
    before: dict[int, int] = {}
    for t in range(len(truths)):
        # a reference keeps its last track while that is near; the others are matched at minimum cost
        cost = np.abs(tracks[t][:, None] - truths[t])
        pairs = {n: m for n, m in before.items() if cost[m, n] < cutoff}
        rest_n = [n for n in range(truths.shape[1]) if n not in pairs and np.isfinite(truths[t, n])]
        rest_m = [m for m in range(tracks.shape[1]) if m not in pairs.values() and np.isfinite(tracks[t, m])]
        near = np.minimum(cost[np.ix_(rest_m, rest_n)], cutoff) ** order
        rows, columns = _assign(near)
        pairs |= {rest_n[c]: rest_m[r] for r, c in zip(rows, columns, strict=True) if near[r, c] < cutoff**order}
        before.update(pairs)
        matches[t, list(pairs)] = list(pairs.values())
    errors = [tracks[t, own] - truths[t, n] for (t, n), own in np.ndenumerate(matches) if own >= 0]
    present, lasting = np.isfinite(truths).sum(axis=0), np.isfinite(tracks).sum(axis=0)
    moments = list(zip(tracks, truths, strict=True))
    counts = np.array([[(column == m).sum() for m in range(tracks.shape[1])] for column in matches.T])
    counts = np.vstack([np.zeros(tracks.shape[1]), counts.reshape(truths.shape[1], tracks.shape[1])])
    return Agreement(
        gospa=float(np.mean([gospa(a, b, cutoff=cutoff, order=order).distance for a, b in moments])),
        ospa=float(np.mean([ospa(a, b, cutoff=cutoff, order=order) for a, b in moments])),
        rms=float(np.sqrt(np.mean(np.square(errors)))) if errors else float("nan"),
        completeness=(matches >= 0).sum(axis=0) / np.maximum(present, 1),
        purity=counts.max(axis=0) / np.maximum(lasting, 1),
        owner=counts.argmax(axis=0) - 1,
        switches=sum(int(np.count_nonzero(np.diff(column[column >= 0]))) for column in matches.T),
        first_match=np.where((matches >= 0).any(axis=0), (matches >= 0).argmax(axis=0), -1),
    )


def _pair_points(
    found: npt.ArrayLike, reference: npt.ArrayLike, cutoff: float, order: float
) -> tuple[int, int, FloatArray]:
    points = []
    for values in (found, reference):
        array = np.asarray(values, dtype=float)
        array = array.reshape(len(array), -1) if array.size else np.zeros((0, 1))
        points.append(array[np.isfinite(array).all(axis=1)])
    a, b = points
    if not (len(a) and len(b)):
        return len(a), len(b), np.zeros(0)
    near = np.minimum(np.linalg.norm(a[:, None, :] - b[None, :, :], axis=-1), cutoff) ** order
    return len(a), len(b), near[_assign(near)]


def _assign(cost: FloatArray) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(cost)
    return rows, columns
