"""Peaks of a one-dimensional spectrum: local maxima, refined by a parabola."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def local_maxima(values: FloatArray, *, first: int, last: int) -> npt.NDArray[np.int64]:
    """Indices i in ``first..last`` with values[i-1] < values[i] >= values[i+1], never the ends of the array."""
    inner = np.arange(max(first, 1), min(last, values.size - 2) + 1)
    if not inner.size:
        return inner.astype(np.int64)
    rising = values[inner] > values[inner - 1]
    falling = values[inner] >= values[inner + 1]
    return inner[rising & falling].astype(np.int64)


def refine(values: FloatArray, index: int) -> tuple[float, float]:
    """Position (in samples) and height of the parabola through a local maximum and its two neighbours."""
    left, centre, right = values[index - 1 : index + 2]
    bend = left - 2.0 * centre + right
    offset = 0.5 * (left - right) / bend if bend < 0 else 0.0
    return index + float(offset), float(centre - 0.25 * (left - right) * offset)
