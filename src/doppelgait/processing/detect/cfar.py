"""Constant false-alarm rate: thresholds and range window."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import AnalysisError

Power = npt.NDArray[np.floating[Any]]
Mask = npt.NDArray[np.bool_]

MIN_TRAINING = 4  # fewest training cells from which a level is estimated


def ca_factor(n_training: int, pfa: float, *, n_summed: int = 1) -> float:
    r"""Compute the threshold factor of cell averaging.

    The factor applies to the mean of ``n_training`` cells of noise.

    .. math:: \alpha = N (P_{fa}^{-1/N} - 1)

    for exponential cells. In general the ratio of two means of Gamma variables has an F distribution with
    :math:`(2 n_g, 2 n_g N)` degrees of freedom; this is the case :math:`n_g = 1`. In each cell ``n_summed``
    (n_g) cells are summed.
    """
    if n_summed == 1:
        return n_training * math.expm1(-math.log(pfa) / n_training)
    from scipy.stats import f

    return float(f.isf(pfa, 2 * n_summed, 2 * n_summed * n_training))


def os_pfa(factor: float, n_training: int, rank: int, *, n_summed: int = 1) -> float:
    r"""Compute an ordered-statistic threshold's false-alarm probability (Rohling, 1983).

    The threshold is ``factor``, alpha of 0 or more, times the ``rank``-th smallest of
    ``n_training`` independent cells (k of N), with ``n_summed`` (n_g) cells summed in each.

    .. math:: P_{fa} = \prod_{i=0}^{k-1} \frac{N - i}{N - i + \alpha}

    for exponential cells. For sums of :math:`n_g` cells it is the integral of :math:`P(x > \alpha z)` over the
    distribution of the ordered cell :math:`z = F^{-1}(u)`, where u is a Beta(k, N - k + 1) variable.
    """
    if n_summed == 1:
        left = n_training - np.arange(rank)
        return float(np.prod(left / (left + factor)))
    from scipy import stats

    nodes, weights = np.polynomial.legendre.leggauss(400)
    share = (nodes + 1.0) / 2.0
    density = stats.beta.pdf(share, rank, n_training - rank + 1)
    false_alarm = stats.gamma.sf(factor * stats.gamma.ppf(share, n_summed), n_summed)
    return float(np.sum(weights / 2.0 * density * false_alarm))


@lru_cache(maxsize=512)
def os_factor(n_training: int, rank: int, pfa: float, *, n_summed: int = 1) -> float:
    """Compute the threshold factor of an ordered statistic.

    The factor applies to the ``rank``-th smallest of ``n_training`` cells of noise; it is
    :func:`os_pfa` solved for alpha.

    Raises
    ------
    AnalysisError
        If the rank is not 1 to N, or if the factor would be above 1e9 (too few cells for this low probability).
    """
    from scipy.optimize import brentq

    if not 1 <= rank <= n_training:
        raise AnalysisError(f"rank {rank} of {n_training} cells: the rank must be 1 to the number of cells")
    if os_pfa(1e9, n_training, rank, n_summed=n_summed) > pfa:
        raise AnalysisError(
            f"a false-alarm probability of {pfa:g} is not possible with cell {rank} of {n_training}: "
            "raise pfa, or lengthen the window"
        )

    def excess(log_factor: float) -> float:
        found = os_pfa(math.exp(log_factor), n_training, rank, n_summed=n_summed)
        return math.log(max(found, 1e-300) / pfa)  # underflows for large factors

    return math.exp(float(brentq(excess, math.log(1e-6), math.log(1e9), xtol=1e-12, rtol=1e-12)))


def make_range_window(*, bin_spacing_m: float, window_m: float, guard_m: float, resolution_m: float) -> range:
    """Return the distances to the training cells along range, the same on both sides."""
    first = math.floor(guard_m / bin_spacing_m + 1e-9) + 1
    reach = math.floor(window_m / bin_spacing_m + 1e-9)
    return range(first, reach + 1, max(1, round(resolution_m / bin_spacing_m)))


def mark_above_ca(power_v2: Power, window: range, pfa: float) -> Mask:
    """Find cells above their cell-averaged threshold along range, the last axis."""
    total = np.zeros(power_v2.shape, dtype=power_v2.dtype)
    for here, there in _iterate_pairs(window, power_v2.shape[-1]):
        total[..., here] += power_v2[..., there]
    counts = count_training_cells(window, power_v2.shape[-1])
    factor = [ca_factor(int(n), pfa) / n if n >= MIN_TRAINING else 0.0 for n in counts]
    return np.asarray((power_v2 > total * np.array(factor, dtype=power_v2.dtype)) & (counts >= MIN_TRAINING))


def mark_above_os(power_v2: Power, window: range, pfa: float, *, rank_share: float) -> Mask:
    """Find cells above their ordered-statistic threshold along range, the last axis."""
    counts = count_training_cells(window, power_v2.shape[-1])
    ranks = np.maximum(np.ceil(rank_share * counts - 1e-9), 1).astype(int)
    factor = [
        os_factor(int(n), int(k), pfa) if n >= MIN_TRAINING else np.inf for n, k in zip(counts, ranks, strict=True)
    ]
    part = power_v2 / np.array(factor, dtype=power_v2.dtype)
    below = np.zeros(power_v2.shape, dtype=np.uint16)
    for here, there in _iterate_pairs(window, power_v2.shape[-1]):
        below[..., here] += power_v2[..., there] < part[..., here]
    return np.asarray(below >= ranks)


def count_training_cells(window: range, n_bins: int) -> npt.NDArray[np.int64]:
    """Count the training cells of every range bin; fewer at both ends of the frame."""
    counts = np.zeros(n_bins, dtype=np.int64)
    for here, _ in _iterate_pairs(window, n_bins):
        counts[here] += 1
    return counts


def _iterate_pairs(window: range, n_bins: int) -> Iterator[tuple[slice, slice]]:
    """Yield slices of cells and training cells by distance."""
    for distance in window:
        if distance < n_bins:
            near, far = slice(0, n_bins - distance), slice(distance, n_bins)
            yield near, far
            yield far, near
