"""The change points of a continuous path, by functional dynamic programming over the value at the last one."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

TYPICAL_SPEED_MPS = 3.0
"""Standard deviation of a piece's radial velocity before it is seen, and of its ground speed: hardly a restriction."""
UNKNOWN_SD = 1e3
"""Standard deviation of the squared range at a change point before anything is seen, in units of its error."""
ENVELOPE_SPAN_SD = 6.0
ENVELOPE_POINTS = 25
"""Values at a change point, about the range measured there, at which histories are compared."""
REFERENCE_STEP_S = 0.1


def best_knots(
    time_s: FloatArray,
    range_m: FloatArray,
    *,
    range_sd_m: float,
    smooth_mps2: float,
    penalty: float,
    min_piece_s: float,
) -> tuple[list[int], float]:
    r"""Indices of the inner change points that minimise the cost of :func:`doppelgait.processing.find_pieces`.

    Everything is in s = R^2 (E-34b). Within a piece the state is (s, s', s''), s'' constant but for the departures
    :math:`2 R a`; at a change point s stays and s', s'' begin anew. For pieces from i to j the least cost, given the
    values at both ends, is a quadratic form of the two, which a Kalman filter with the first value kept in its state
    yields for all i at once. The least cost up to j, given the value there, is the lower envelope of parabolas, one a
    history; those nowhere lowest are dropped (the envelope is compared at 25 values).

    Parameters
    ----------
    time_s, range_m : ndarray, shape (J,)
    range_sd_m : float
    smooth_mps2 : float
        Standard deviation of a over 0.1 s.
    penalty : float
        Cost of a change point in units of sd^2.
    min_piece_s : float

    Returns
    -------
    knots : list of int
        Rising, without the ends; a change point is a sample that both pieces share.
    cost : float
        The least cost; inf if the track is shorter than one piece.
    """
    n = time_s.size
    value, noise = range_m**2, 2.0 * range_m * range_sd_m
    histories, filters = _Histories(value[0], noise[0]), _Filters(n)
    for j in range(1, n):
        filters.start(j - 1, value[j - 1], noise[j - 1], range_m[j - 1])
        filters.step(time_s[j] - time_s[j - 1], value[j], noise[j], 2.0 * range_m[j] * smooth_mps2)
        last_start = int(np.searchsorted(time_s, time_s[j] - min_piece_s + 1e-9, side="right")) - 1
        room_left = j == n - 1 or time_s[-1] - time_s[j] >= min_piece_s - 1e-9
        if last_start >= 0 and room_left:
            histories.extend(j, last_start, filters, penalty, (value[j], noise[j]))
    return histories.knots(n - 1)


class _Histories:
    """Parabolas a (x - b)^2 + c of the value x at a change point ``at``, and which history each continues."""

    def __init__(self, value: float, noise: float) -> None:
        self.abc = np.array([[noise**-2], [value], [0.0]])
        self.at = np.zeros(1, dtype=np.int64)
        self.before = np.full(1, -1, dtype=np.int64)

    def extend(self, j: int, last_start: int, filters: _Filters, penalty: float, measured: tuple[float, float]) -> None:
        """Add the histories that are lowest somewhere at sample j, and the one of the least minimum.

        The filter gives cost + (z - m)^T P^-1 (z - m) for z = (value at the start, value here), so that the history's
        a (x - b)^2 acts as one more measurement of the start's value: b, with variance 1 / a.
        """
        count = int(np.searchsorted(self.at, last_start, side="right"))
        at, (a, b, c) = self.at[:count], self.abc[:, :count]
        first, cross, last = (filters.covariance[p, q, at] for p, q in ((0, 0), (0, 1), (1, 1)))
        variance = first + 1.0 / a
        surprise = b - filters.mean[0, at]
        least = c + filters.cost[at] + surprise**2 / variance + penalty * (at > 0)
        centre = filters.mean[1, at] + cross / variance * surprise
        steep = 1.0 / (last - cross**2 / variance)
        x = measured[0] + measured[1] * np.linspace(-ENVELOPE_SPAN_SD, ENVELOPE_SPAN_SD, ENVELOPE_POINTS)
        best = int(least.argmin())
        hopeful = np.flatnonzero(least <= least[best] + (steep[best] * (x - centre[best]) ** 2).max())
        cost = steep[hopeful, None] * (x - centre[hopeful, None]) ** 2 + least[hopeful, None]
        kept = np.unique(np.append(hopeful[cost.argmin(axis=0)], best))
        self.abc = np.hstack([self.abc, np.stack([steep[kept], centre[kept], least[kept]])])
        self.at = np.append(self.at, np.full(kept.size, j))
        self.before = np.append(self.before, kept)

    def knots(self, last: int) -> tuple[list[int], float]:
        """Change points of the cheapest history of the last sample, and its cost; none and inf if there is none."""
        ends = np.flatnonzero(self.at == last)
        if not ends.size:
            return [], float("inf")
        found: list[int] = []
        cheapest = ends[self.abc[2, ends].argmin()]
        number = int(self.before[cheapest])
        while self.at[number] > 0:
            found.append(int(self.at[number]))
            number = int(self.before[number])
        return found[::-1], float(self.abc[2, cheapest])


class _Filters:
    """One Kalman filter for every start i, at one sample; state (s_i, s, s', s''), filters along axis -1."""

    def __init__(self, n: int) -> None:
        self.count = 0
        self.mean = np.zeros((4, n))
        self.covariance = np.zeros((4, 4, n))
        self.cost = np.zeros(n)

    def start(self, i: int, value: float, noise: float, range_m: float) -> None:
        """A piece from sample i on; what its value is is left to the piece before."""
        self.mean[:2, i] = value
        self.covariance[:2, :2, i] = (UNKNOWN_SD * noise) ** 2
        self.covariance[2, 2, i] = (2.0 * range_m * TYPICAL_SPEED_MPS) ** 2
        self.covariance[3, 3, i] = (2.0 * TYPICAL_SPEED_MPS**2) ** 2
        self.count = i + 1

    def step(self, dt: float, value: float, noise: float, drive: float) -> None:
        """Predict over dt, then take in one value."""
        mean, covariance = self.mean[:, : self.count], self.covariance[:, :, : self.count]
        for moved in (mean, covariance, covariance.swapaxes(0, 1)):  # F m, then F P F^T: its rows, then its columns
            moved[1] += dt * moved[2] + dt * dt / 2.0 * moved[3]
            moved[2] += dt * moved[3]
        push = np.array([0.0, dt / 2.0, 1.0, 0.0]) * drive * np.sqrt(REFERENCE_STEP_S * dt)
        covariance += np.outer(push, push)[:, :, None]
        seen = covariance[1].copy()
        variance = seen[1] + noise**2
        surprise = value - mean[1]
        self.cost[: self.count] += surprise**2 / variance
        mean += seen * (surprise / variance)
        covariance -= seen[:, None] * (seen / variance)[None]
