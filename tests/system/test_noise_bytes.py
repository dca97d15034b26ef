"""Bytes of the noise on another processor: compiled anew, in a process of its own."""

import pytest

import processes

DIGEST = 0x9FF76EFC  # as in tests/core/kernels/test_noise.py
CHECKSUM = """
import zlib
import numpy as np
from doppelgait.core.kernels.noise import add_noise_block
from doppelgait.core.samples import WHITE
re, im = np.zeros((2, 40, 500), dtype=np.float32)
add_noise_block(re, im, 0, 500, 3, 1000, np.uint64(77), 1e-5, WHITE)
print(zlib.crc32(re.astype("<f4").tobytes() + im.astype("<f4").tobytes()))
"""


@pytest.mark.release
def test_bytes_do_not_depend_on_the_processor(tmp_path):
    """Compiled without any vector extension beyond the baseline: no fused multiply-adds, other vector lengths."""
    plain = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": str(tmp_path)}
    assert int(processes.python(CHECKSUM, **plain).stdout) == DIGEST
