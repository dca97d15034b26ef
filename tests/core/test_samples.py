"""Complex samples in both layouts: arithmetic, pending noise, memory."""

import numpy as np
import pytest

from doppelgait.core.errors import AnalysisError
from doppelgait.core.samples import WHITE, Samples, borrow_planes

N_PULSES, N_BINS, KEY = 70, 9, np.uint64(77)


def matrix(seed=0):
    generator = np.random.default_rng(seed)
    return (generator.normal(size=(N_PULSES, N_BINS)) + 1j * generator.normal(size=(N_PULSES, N_BINS))).astype("c8")


def both(seed=0):
    """The same samples as a matrix and as planes with columns to spare."""
    values = matrix(seed)
    planes = np.full((2, N_BINS, 96), 1e9, dtype=np.float32)
    planes[:, :, :N_PULSES] = values.real.T, values.imag.T
    return Samples.own(values.copy()), Samples.from_planes(planes, N_PULSES)


OPERANDS = {
    "number": 0.5,
    "complex number": 0.5 - 2j,
    "row": (np.arange(N_BINS) * (1 + 0.5j)).astype(np.complex64),
    "column": np.exp(1j * np.arange(N_PULSES)).astype(np.complex64)[:, None],
    "real column": (np.arange(N_PULSES) % 2 == 0)[:, None],
    "matrix": matrix(1),
    "samples": both(1)[1],
}


@pytest.mark.parametrize("operand", OPERANDS.values(), ids=OPERANDS)
@pytest.mark.parametrize("change", [lambda a, b: a + b, lambda a, b: a - b, lambda a, b: a * b, lambda a, b: b * a])
def test_arithmetic_is_that_of_the_matrix_in_both_layouts(operand, change):
    plain = np.asarray(operand) if isinstance(operand, Samples) else operand
    expected = change(matrix(), plain)
    for samples in both():
        found = change(samples, operand)
        assert isinstance(found, Samples)
        np.testing.assert_allclose(found.matrix, expected, rtol=2e-6, atol=1e-6)
        np.testing.assert_array_equal(samples.matrix, matrix())


def test_changes_in_place_keep_own_memory_and_leave_that_of_others():
    values = matrix()
    samples = Samples(values)
    samples += 1.0
    np.testing.assert_array_equal(values, matrix())
    for own in both():
        kept = own
        own += 1.0
        assert own is kept
        frozen = own.freeze()
        frozen *= 0.0
        np.testing.assert_array_equal(own.matrix, matrix() + np.float32(1.0))


@pytest.mark.parametrize("factor", [WHITE, np.array([0.8, 0.56, 0.2], np.float32)])
def test_pending_noise_is_the_noise_that_settles_and_that_is_read_in_part(factor):
    spans = np.array([[0, 0], [3, 40], [10, 70], [0, 0], [5, 6], [60, 70], [0, 0], [0, 0], [0, 0]])
    expected = both()[0].with_noise(KEY, 4.0, factor).add_pending_noise().matrix
    for samples in both():
        noisy = samples.with_noise(KEY, 4.0, factor)
        np.testing.assert_array_equal(noisy.matrix, expected)
        np.testing.assert_array_equal(noisy.planes[0, :, :N_PULSES], expected.real.T)
        planes, first = noisy.read(spans)
        assert first == 1
        for row, (begin, stop) in enumerate(spans[first : first + planes.shape[1]]):
            part = planes[0, row, begin:stop] + 1j * planes[1, row, begin:stop]
            np.testing.assert_array_equal(part, expected[begin:stop, first + row])
        np.testing.assert_array_equal((noisy + 0.0).matrix, expected)
        np.testing.assert_array_equal(noisy.matrix, expected)  # still the same after all that
    assert np.mean(np.abs(expected - matrix()) ** 2) == pytest.approx(4.0, rel=0.1)


def test_other_changes_agree_in_both_layouts():
    turns = np.random.default_rng(3).standard_normal((3, matrix().shape[0]))
    weights = np.random.default_rng(4).standard_normal((matrix().shape[1], 2))
    pulses, columns = np.array([[1], [5]]), np.array([[0, 1], [7, 8]])
    one, other = both()
    for change in (
        lambda s: s.quantise(0.25, -4, 4)[0],
        lambda s: s.freeze().quantise(0.25, -4, 4)[0],
        lambda s: s.rotate(turns[0], turns[1:], weights),
        lambda s: s.freeze().rotate(turns[0], turns[1:], weights),
        lambda s: s.repeat(np.array([3, 1]), np.array([0, 0])),
        lambda s: s.freeze().repeat(np.array([3, 1]), np.array([0, 2])),
        lambda s: s.add_at(pulses, columns, np.array([[1j, 2], [3, 4]])),
        lambda s: s.apply_imbalance(1.1, 0.2),
    ):
        np.testing.assert_allclose(change(one.copy()).matrix, change(other.copy()).matrix, rtol=1e-6, atol=1e-7)
    assert one.find_largest_part() == other.find_largest_part() == np.abs(matrix().view(np.float32)).max()


def test_what_is_no_complex_matrix_is_refused():
    for values in (np.zeros((3, 4)), np.zeros(3, np.complex64)):
        with pytest.raises(AnalysisError, match="must be complex, of shape"):
            Samples(values)
    with pytest.raises(ValueError, match="broadcast"):
        both()[1] + np.zeros(N_PULSES)


@pytest.mark.parametrize("layout", [0, 1])
def test_functions_of_numpy_and_further_operators_are_those_of_the_matrix(layout):
    samples, plain = both()[layout], matrix()
    for function in (np.add, np.multiply, np.subtract):
        for other in (2.0, plain[:1], plain[:, :1]):
            assert np.asarray(function(samples, other)) == pytest.approx(function(plain, other), rel=1e-6, abs=1e-6)
            assert np.asarray(function(other, samples)) == pytest.approx(function(other, plain), rel=1e-6, abs=1e-6)
    for change in (lambda s: s / 4.0, lambda s: 1.0 - s, lambda s: -s):
        assert np.asarray(change(samples)) == pytest.approx(change(plain))
    np.testing.assert_array_equal(np.abs(samples), np.abs(plain))
    assert isinstance(np.conj(samples), Samples)
    assert np.asarray(samples).dtype == np.complex64
    assert samples[3, 2] == plain[3, 2]
    assert len(samples) == N_PULSES
    with pytest.raises(TypeError):  # an array is not changed in place
        np.add(plain, samples, out=plain)
    np.testing.assert_array_equal(samples, plain, "nothing was changed in place")


def test_memory_of_planes_is_used_again_when_no_view_is_left():
    first = borrow_planes((2, 3, 32))
    view, place = first[1, :, 4:], first.ctypes.data
    view[:] = 7.0
    del first
    other = borrow_planes((2, 3, 32))
    other[:] = 1.0
    assert other.ctypes.data != place
    assert (view == 7.0).all()
    del view
    assert borrow_planes((2, 3, 32)).ctypes.data == place


@pytest.mark.parametrize(
    "read",
    [
        lambda rows: rows[:, ::2],
        lambda rows: rows[:, [0, 3, 4]],
        lambda rows: np.asfortranarray(rows)[:, :3],
        lambda rows: rows[:, :3].astype(complex),
    ],
)
def test_stored_samples_of_any_memory_order_are_read_as_planes(read):
    matrix = (np.arange(60) + 1j).reshape(10, 6).astype(np.complex64)
    stored = Samples.stored((10, 3), lambda first, stop: read(matrix[first:stop]))
    tile = stored.read_tile(slice(2, 7), slice(1, 3))
    np.testing.assert_array_equal((tile[0] + 1j * tile[1]).T, read(matrix[2:7])[:, 1:3])
    np.testing.assert_array_equal(stored.planes[0].T, read(matrix).real)
