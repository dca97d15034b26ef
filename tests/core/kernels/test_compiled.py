"""Kernels as object code: fresh, and careful with what it is given."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from numba.core.errors import NumbaError

import doppelgait.core.kernels as package
from doppelgait.core.kernels import compiled
from doppelgait.core.kernels.cadence import project
from doppelgait.core.kernels.columns import row_means

FOLDER = Path(package.__file__).parent


@pytest.mark.parametrize("level", compiled.LEVELS)
def test_object_code_is_that_of_the_sources(level):
    """Else: make kernels."""
    header = json.loads((FOLDER / "objects" / f"linux-{level}.bin").read_bytes().partition(b"\n")[0])
    assert len(header["entries"]) > 30
    for stem, digest in header["sources"].items():
        assert hashlib.sha256((FOLDER / f"{stem}.py").read_bytes()).hexdigest() == digest, f"{stem}.py: make kernels"


def test_the_best_level_that_a_processor_has():
    v3 = dict.fromkeys(compiled.LEVELS["x86-64-v3"], True)
    assert compiled.level_of(v3) == "x86-64-v3"
    assert compiled.level_of({**v3, **dict.fromkeys(compiled.LEVELS["x86-64-v4"], True)}) == "x86-64-v4"
    assert compiled.level_of({**v3, "fma": False}) is None


@pytest.fixture
def parts():
    return np.random.default_rng(0).standard_normal((5, 8))


@pytest.mark.parametrize("dtype", ["f8", "f4"])
@pytest.mark.parametrize("view", [slice(None), slice(None, None, 2)])
def test_arrays_of_any_type_and_order_are_taken_as_they_are(parts, dtype, view):
    values, out = parts.astype(dtype)[:, view], np.empty(parts[:, view].shape[1])
    row_means(values, out)
    np.testing.assert_allclose(out, values.mean(axis=0), rtol=1e-6)
    turned = np.asfortranarray(values)
    row_means(turned, out)
    np.testing.assert_allclose(out, values.mean(axis=0), rtol=1e-6)


@pytest.mark.parametrize("wrong", [[[1.0, 2.0]], None, "text", 1.0, np.ones(3), np.ones((2, 3, 4))])
def test_what_is_no_array_of_the_kind_is_refused_and_does_not_end_the_process(wrong):
    with pytest.raises(NumbaError):
        project(wrong, np.empty((2, 2)), np.empty((2, 2)))


def test_arrays_that_may_not_be_written_are_not_written(parts):
    out = np.zeros(8)
    out.flags.writeable = False
    with pytest.raises((NumbaError, AttributeError)):  # the second one is how Numba trips over its own message
        row_means(parts, out)
    assert not out.any()


def test_other_byte_order_is_not_read_as_ours(parts):
    out = np.empty(8)
    with pytest.raises(NumbaError):
        row_means(parts.astype(">f8"), out)


def test_another_layout_of_arrays_is_left_to_numba(monkeypatch):
    assert compiled._arrays_are_laid_out_as_known()

    class Longer(np.ndarray):
        pass

    empty = np.empty((2, 3), np.float32)
    monkeypatch.setattr(compiled.np, "zeros", lambda *args, **options: empty.view(Longer))
    assert not compiled._arrays_are_laid_out_as_known()
