"""What the machine itself allows: writing and copying planes, multiplying matrices, all with one thread."""

from __future__ import annotations

from typing import Any

import numpy as np
from clock import Timing, Work, combine

SGEMM_SIZE = 1024
SGEMM_FLOP = 2 * SGEMM_SIZE**3
FLOP_PER_TRANSFORM = 5070.0
"""One column of one bin, M = 101, K = 128: window 2 M, transform 5 K log2 K, squared magnitude and sum 3 K."""


def floor_work(planes: Any, full_planes: Any) -> dict[str, Work]:
    """Write and copy floors of planes that exist, and a matrix product."""
    copy = planes.copy()
    left, right = np.random.default_rng(1).standard_normal((2, SGEMM_SIZE, SGEMM_SIZE), dtype=np.float32)
    product = np.empty_like(left)
    return {
        "floor: write planes": lambda: copy.fill(1.0),
        "floor: copy planes": lambda: np.copyto(copy, planes),
        "floor: write planes, full rate": lambda: full_planes.fill(1.0),
        "floor: sgemm 1024": lambda: np.matmul(left, right, out=product),
    }


def floor_rates(seconds: dict[str, Timing], plane_bytes: int, n_transforms: int) -> dict[str, Timing]:
    """Bandwidths, arithmetic rate, and the time that the flops of the hop-1 signature take at that rate."""
    rate = combine(lambda s: SGEMM_FLOP / s / 1e9, seconds["floor: sgemm 1024"])
    return {
        "write, GB/s": combine(lambda s: plane_bytes / s / 1e9, seconds["floor: write planes"]),
        "copy, GB/s (bytes written)": combine(lambda s: plane_bytes / s / 1e9, seconds["floor: copy planes"]),
        "sgemm, GF/s": rate,
        "signature flop floor, ms": combine(lambda r: n_transforms * FLOP_PER_TRANSFORM / r / 1e6, rate),
    }
