"""Piecewise cubic curves through a few knots: a spline, and one that repeats every cycle without overshoot.

SciPy has both; its module of interpolation takes as long to load as all of xarray does without pandas.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def columns(first: FloatArray, *others: FloatArray | float) -> FloatArray:
    """Columns side by side, shape (n, number of columns); a number stands for a constant one.

    Each column is contiguous in memory, and so it stays through arithmetic: a third of the time of rows of three.
    """
    found = np.empty((1 + len(others), first.size))
    found[0] = first
    for number, other in enumerate(others, 1):
        found[number] = other
    return found.T


_STEPS = 60
"""Most steps towards a root: Newton's method needs four, halving an interval to its last digit 52."""
_LAST_STEP = 1e-9
"""A step of Newton's method shorter than this share of the knots' distance leaves an error of about its square."""


@dataclass(frozen=True)
class Curve:
    """A cubic between every two knots; the outermost ones hold beyond the ends.

    Parameters
    ----------
    knots : ndarray, shape (K,)
        Rising.
    coefficients : ndarray, shape (4, K - 1)
        c_0 to c_3 of the sum of c_k u^k, u the distance from the knot on the left.
    """

    knots: FloatArray
    coefficients: FloatArray

    def __call__(self, x: npt.ArrayLike, order: int = 0) -> FloatArray:
        """Values (``order`` 0) or first derivatives (1), shaped like ``x``."""
        at = np.asarray(x, dtype=float)
        place = self.knots[1:-1].searchsorted(at, side="right")
        u = at - self.knots[place]
        c_0, c_1, c_2, c_3 = self.coefficients.take(place, axis=1)
        if order == 1:
            return np.asarray(c_1 + u * (2.0 * c_2 + u * (3.0 * c_3)))
        return np.asarray(c_0 + u * (c_1 + u * (c_2 + u * c_3)))

    def where(self, values: npt.ArrayLike) -> FloatArray:
        """Where a curve with rising knots takes values that lie between its first and its last knot's.

        Newton's method from the chord, halved back into the interval where it would leave it.
        """
        wanted = np.asarray(values, dtype=float)
        heights = np.append(self.coefficients[0], self(self.knots[-1]))
        place = np.clip(heights.searchsorted(wanted, side="right") - 1, 0, self.knots.size - 2)
        low, high = self.knots[place], self.knots[place + 1]
        width = high - low
        x = low + (wanted - heights[place]) / (heights[place + 1] - heights[place]) * width
        for _ in range(_STEPS):
            error = self(x) - wanted
            low, high = np.where(error <= 0, x, low), np.where(error >= 0, x, high)
            tried = x - error / self(x, 1)
            following = np.where((tried >= low) & (tried <= high), tried, (low + high) / 2.0)
            x, step = following, np.abs(following - x)
            if (step <= _LAST_STEP * width).all():
                break
        return np.asarray(x)


def _hermite(knots: FloatArray, heights: FloatArray, slopes: FloatArray) -> Curve:
    """Cubics from heights and slopes at the knots."""
    step = np.diff(knots)
    chord = np.diff(heights) / step
    bend = slopes[:-1] + slopes[1:] - 2.0 * chord
    c_2 = (chord - slopes[:-1] - bend) / step
    return Curve(knots, np.stack([heights[:-1], slopes[:-1], c_2, bend / step**2]))


def cubic_spline(knots: npt.ArrayLike, heights: npt.ArrayLike) -> Curve:
    r"""Cubic spline with two continuous derivatives and not-a-knot ends.

    .. math:: h_i s_{i-1} + 2 (h_{i-1} + h_i) s_i + h_{i-1} s_{i+1} = 3 (h_i m_{i-1} + h_{i-1} m_i)

    for the slopes s, with steps h and chords m; at the ends the third derivative is continuous across the second knot
    and the last but one (de Boor, A Practical Guide to Splines, ch. IV).

    Parameters
    ----------
    knots : array_like, shape (K,)
        Rising, K >= 4.
    heights : array_like, shape (K,)
    """
    x, y = np.asarray(knots, dtype=float), np.asarray(heights, dtype=float)
    h = np.diff(x)
    m = np.diff(y) / h
    first, last = x[2] - x[0], x[-1] - x[-3]
    lower = [0.0, *h[1:].tolist(), float(last)]
    diagonal = [float(h[1]), *(2.0 * (h[:-1] + h[1:])).tolist(), float(h[-2])]
    upper = [float(first), *h[:-1].tolist()]
    right = np.empty(x.size)
    right[1:-1] = 3.0 * (h[1:] * m[:-1] + h[:-1] * m[1:])
    right[0] = ((h[0] + 2.0 * first) * h[1] * m[0] + h[0] ** 2 * m[1]) / first
    right[-1] = (h[-1] ** 2 * m[-2] + (2.0 * last + h[-1]) * h[-2] * m[-1]) / last
    return _hermite(x, y, np.array(_solved(lower, diagonal, upper, right.tolist())))


def _solved(lower: list[float], diagonal: list[float], upper: list[float], right: list[float]) -> list[float]:
    """Solution of a tridiagonal system by elimination; all pivots of a spline's are positive."""
    for i in range(1, len(right)):
        factor = lower[i] / diagonal[i - 1]
        diagonal[i] -= factor * upper[i - 1]
        right[i] -= factor * right[i - 1]
    right[-1] /= diagonal[-1]
    for i in range(len(right) - 2, -1, -1):
        right[i] = (right[i] - upper[i] * right[i + 1]) / diagonal[i]
    return right


def periodic_pchip_curve(knots: npt.ArrayLike, heights: npt.ArrayLike) -> Curve:
    """Shape-preserving cubic (Fritsch and Carlson 1980) through knots that repeat every cycle, for 0 <= x <= 1.

    A slope is 0 where the chords on both sides differ in sign or one is level, else their weighted harmonic mean
    (Fritsch and Butland 1984).

    Parameters
    ----------
    knots : array_like, shape (K,)
        Rising, 0 <= x < 1, K >= 2.
    heights : array_like, shape (K,)
    """
    around = np.arange(-2, np.size(knots) + 2)  # slopes depend on the neighbours alone
    x, y = np.asarray(knots, dtype=float), np.asarray(heights, dtype=float)
    x, y = x[around % x.size] + around // x.size, y[around % y.size]
    step = np.diff(x)
    chord = np.diff(y) / step
    before, after = chord[:-1], chord[1:]
    weight_before, weight_after = 2.0 * step[1:] + step[:-1], step[1:] + 2.0 * step[:-1]
    level = before * after <= 0.0
    safe = (np.where(level, 1.0, before), np.where(level, 1.0, after))
    mean = (weight_before + weight_after) / (weight_before / safe[0] + weight_after / safe[1])
    return _hermite(x[1:-1], y[1:-1], np.where(level, 0.0, mean))
