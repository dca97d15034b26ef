"""Vectors at many times, stored component by component."""

from __future__ import annotations

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
