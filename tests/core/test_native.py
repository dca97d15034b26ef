"""Native code makes the same bytes at every level with fused products, and level 1 differs by rounding.

Every file in ``native`` has a function ``compute`` that returns the outputs of some kernels of a module by name.
"""

import runpy
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from doppelgait._core import _level1

TOPICS = sorted((Path(__file__).parent / "native").glob("*.py"))
LEVELS = range(1, _level1.find_processor_level() + 1)


@pytest.mark.parametrize("topic", TOPICS, ids=lambda path: path.stem)
def test_levels_make_the_same_bytes(topic):
    compute = runpy.run_path(str(topic))["compute"]
    first, *outputs = (compute(import_module(f"doppelgait._core._level{level}")) for level in LEVELS)
    assert first
    for name, values in first.items():
        largest = np.nanmax(np.abs(values), initial=0.0)
        for others in outputs:
            np.testing.assert_allclose(values, others[name], rtol=1e-5, atol=1e-6 * largest, err_msg=name)
            assert others[name].tobytes() == outputs[0][name].tobytes(), name
