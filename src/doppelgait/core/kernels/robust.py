"""Medians and polynomials through points with outliers (E-29, E-34)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

FloatArray = npt.NDArray[np.float64]


@kernel()
def median_in_place(values: FloatArray) -> float:
    """Compute a median by selection (Hoare) and reorder the values.

    It needs one value or more, none of them NaN.
    """
    low, high, middle = 0, values.size - 1, values.size // 2
    while low < high:
        pivot, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            break
    if values.size % 2:
        return float(values[middle])
    below = values[0]
    for n in range(1, middle):
        below = max(below, values[n])
    return float(0.5 * (below + values[middle]))


@kernel()
def robust_fit(
    basis: FloatArray,
    values: FloatArray,
    prior: FloatArray,
    divisor: FloatArray,
    least_scale: float,
    tuning: float,
    iterations: int,
    line: FloatArray,
    coefficients: FloatArray,
) -> None:
    r"""Fit by iteratively reweighted least squares with Cauchy weights.

    In every iteration, with residuals :math:`r_j = (y_j - l_j) / d_j` and their scale
    :math:`s = \max(1.4826 \operatorname{med} |r|, s_0)`, the coefficients that minimise
    :math:`\sum_j a_j (y_j - \sum_p c_p b_{pj})^2 / (1 + (r_j / (t s))^2)` give the next line l, from the normal
    equations by Cholesky's factors.

    Parameters
    ----------
    basis : ndarray, shape (P, J)
        b; nearly orthogonal, or the normal equations lose digits.
    values, prior, divisor : ndarray, shape (J,)
        y, a and d.
    least_scale, tuning : float
        s_0 and t.
    iterations : int
    line : ndarray, shape (J,)
        The first line; overwritten by the last one.
    coefficients : ndarray, shape (P,)
        Overwritten with c.
    """
    n_terms, n_columns = basis.shape
    residual, weight, work = np.empty(n_columns), np.empty(n_columns), np.empty(n_columns)
    normal = np.empty((n_terms, n_terms))
    for _ in range(iterations):
        for j in range(n_columns):
            residual[j] = (values[j] - line[j]) / divisor[j]
            work[j] = abs(residual[j])
        scale = tuning * max(1.4826 * median_in_place(work), least_scale)
        for j in range(n_columns):
            weight[j] = prior[j] / (1.0 + (residual[j] / scale) ** 2)
        for p in range(n_terms):
            for q in range(p + 1):
                total = 0.0
                for j in range(n_columns):
                    total += basis[p, j] * weight[j] * basis[q, j]
                normal[p, q] = total
            total = 0.0
            for j in range(n_columns):
                total += basis[p, j] * weight[j] * values[j]
            coefficients[p] = total
        _solve(normal, coefficients)
        for j in range(n_columns):
            total = 0.0
            for p in range(n_terms):
                total += coefficients[p] * basis[p, j]
            line[j] = total


@kernel()
def _solve(matrix: FloatArray, right: FloatArray) -> None:
    """Solve a positive definite system in place.

    The solution replaces the right side; the lower half of the matrix is overwritten.
    """
    n = right.size
    for p in range(n):
        for q in range(p):
            total = matrix[p, q]
            for k in range(q):
                total -= matrix[p, k] * matrix[q, k]
            matrix[p, q] = total / matrix[q, q]
        total = matrix[p, p]
        for k in range(p):
            total -= matrix[p, k] ** 2
        matrix[p, p] = np.sqrt(total)
        for k in range(p):
            right[p] -= matrix[p, k] * right[k]
        right[p] /= matrix[p, p]
    for p in range(n - 1, -1, -1):
        for k in range(p + 1, n):
            right[p] -= matrix[k, p] * right[k]
        right[p] /= matrix[p, p]
