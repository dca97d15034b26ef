"""Parts of the short-time transform: pass order, twiddle factors, compiler options."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba.core.compiler import Compiler

Float32Array = npt.NDArray[np.float32]


class Apart(Compiler):
    """Compiler for functions whose array arguments never overlap.

    Their loops need no test for overlap.

    The tests, of sixteen streams in pairs, cost as much as a pass over sixteen lanes.
    """

    def define_pipelines(self) -> Any:
        """Return Numba's own passes with the arguments marked."""
        self.state.flags.noalias = True
        return super().define_pipelines()  # type: ignore[no-untyped-call]


OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}
APART: dict[str, Any] = {**OPTIONS, "pipeline_class": Apart}
INLINE: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}, "inline": "always"}


def stage_radices(n_bins: int) -> npt.NDArray[np.int64]:
    """Factorise a length into the radices of all passes.

    An eight comes first, a four or a two last where they divide, prime factors between.
    """
    first, rest = ([8], n_bins // 8) if n_bins % 8 == 0 else ([], n_bins)
    last = [4] if rest % 4 == 0 else [2] if rest % 2 == 0 else []
    rest //= math.prod(last)
    between, factor = [], 4
    while rest > 1:
        if rest % factor == 0:
            between.append(factor)
            rest //= factor
        else:
            factor = {4: 5, 5: 3, 3: 2, 2: 7}.get(factor, factor + 2)
    return np.array([*first, *between, *last] or [1], dtype=np.int64)


def twiddle_table(n_bins: int) -> tuple[Float32Array, Float32Array]:
    """Compute twiddle factors exp(-j 2 pi q / K) as float32 planes."""
    angle = -2.0 * np.pi * np.arange(n_bins) / n_bins
    return np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32)
