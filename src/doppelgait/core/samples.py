"""Complex samples of a recording as float32 planes or as a matrix, with receiver noise added where it is read."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import AnalysisError

Planes = npt.NDArray[np.float32]
Matrix = npt.NDArray[np.complex64]
Spans = npt.NDArray[np.int64]

LINEAR = (np.add, np.subtract, np.multiply)


class Noise(NamedTuple):
    """Receiver noise that is not added yet: a function of (key, pulse, sample), and its root mean square in V."""

    key: np.uint64
    rms_v: float


class Samples:
    """Complex samples, one row a pulse; in arithmetic like a complex64 array of shape (pulses, samples).

    ``samples + 0.1``, ``samples * turn[:, None]`` and the like give new samples, ``samples += row`` changes these.
    ``numpy.asarray(samples)`` is the complex matrix.

    Parameters
    ----------
    matrix : array_like, shape (pulses, samples), complex
        V. Kept as it is if it is complex64 and C-contiguous, else copied.

    Raises
    ------
    AnalysisError
        If it is no complex array of two dimensions.

    Notes
    -----
    The values are kept in the layout they were made in. The *matrix* has one row a pulse. The *planes*, a float32 array
    of shape (2, samples, at least pulses), hold real and imaginary parts with one row a sample: what the kernels read
    and write, because a range bin's pulses follow each other in memory. Columns beyond the last pulse mean nothing.

    Receiver noise may be pending (:meth:`with_noise`): every access shows it, but it is made for what is read only.
    """

    __slots__ = ("_matrix", "_noise", "_planes", "shape")

    def __init__(self, matrix: npt.ArrayLike) -> None:
        values = np.asarray(matrix)
        if values.ndim != 2 or values.dtype.kind != "c":
            raise AnalysisError(
                f"receiver samples must be complex, of shape (pulse, sample), not {values.dtype} of shape "
                f"{values.shape}"
            )
        self._matrix: Matrix | None = np.ascontiguousarray(values, dtype=np.complex64)
        self._planes: Planes | None = None
        self._noise: Noise | None = None
        self.shape: tuple[int, int] = values.shape

    @classmethod
    def from_planes(cls, planes: Planes, n_pulses: int) -> Samples:
        """Samples that keep these planes, shape (2, samples, n_pulses or more), without a copy."""
        made = cls.__new__(cls)
        made._matrix, made._planes, made._noise = None, planes, None
        made.shape = (n_pulses, planes.shape[1])
        return made

    @property
    def matrix(self) -> Matrix:
        """Complex64 array, one row a pulse."""
        settled = self if self._noise is None else self.copy().settle()
        if settled._matrix is not None:
            return settled._matrix
        from doppelgait.core.kernels.synthesis import join_planes

        assert settled._planes is not None
        joined = np.empty(self.shape, dtype=np.complex64)
        join_planes(settled._planes[0], settled._planes[1], 0, self.shape[1], joined)
        return joined

    @property
    def planes(self) -> Planes:
        """Real and imaginary planes, float32, one row a sample."""
        settled = self if self._noise is None else self.copy().settle()
        return settled._planes if settled._planes is not None else _split(settled.matrix, slice(0, self.shape[1]))

    def read(self, spans: Spans) -> tuple[Planes, int]:
        """Planes of some samples (range bins), with the noise of the pulses that are needed only.

        Parameters
        ----------
        spans : ndarray, shape (samples, 2)
            First and one past the last pulse that is needed of every sample; an empty span for one that is not needed.

        Returns
        -------
        planes : ndarray, shape (2, rows, at least pulses)
            From the first to the last sample that is needed. Values outside the spans mean nothing. Not to be changed.
        first : int
            The sample of row 0.
        """
        needed = np.flatnonzero(spans[:, 0] < spans[:, 1])
        first, stop = (int(needed[0]), int(needed[-1]) + 1) if needed.size else (0, 0)
        rows = slice(first, stop)
        split = None if self._matrix is None else _split(self._matrix, rows)
        source = self._planes[:, rows] if split is None and self._planes is not None else split
        assert source is not None
        if self._noise is None:
            return source, first
        from doppelgait.core.kernels.noise import copy_noise_spans

        noisy = source if split is not None else np.empty_like(source)
        copy_noise_spans(source[0], source[1], spans[rows], first, *self._noise, noisy[0], noisy[1])
        return noisy, first

    def with_noise(self, key: np.uint64, power_v2: float) -> Samples:
        """The same samples with complex white Gaussian noise pending; the values are shared, not copied."""
        made = self if self._noise is None else self.copy().settle()
        noisy = Samples.__new__(Samples)
        noisy._matrix, noisy._planes, noisy.shape = made._matrix, made._planes, made.shape
        noisy._noise = Noise(key, math.sqrt(power_v2))
        return noisy

    def settle(self) -> Samples:
        """Add pending noise to these samples now, in place."""
        from doppelgait.core.kernels.noise import add_noise_block, add_noise_matrix

        if self._noise is not None and self._matrix is not None:
            add_noise_matrix(self._matrix, *self._noise)
        elif self._noise is not None and self._planes is not None:
            add_noise_block(self._planes[0], self._planes[1], 0, self.shape[0], 0, 0, *self._noise)
        self._noise = None
        return self

    def copy(self) -> Samples:
        """Samples of their own memory."""
        made = Samples.__new__(Samples)
        made._matrix = None if self._matrix is None else self._matrix.copy()
        made._planes = None if self._planes is None else self._planes.copy()
        made._noise, made.shape = self._noise, self.shape
        return made

    def freeze(self) -> Samples:
        """The same values, which cannot be changed any more through these samples."""
        made = Samples.__new__(Samples)
        made._matrix, made._planes, made._noise, made.shape = self._matrix, self._planes, self._noise, self.shape
        for name in ("_matrix", "_planes"):
            if (values := getattr(made, name)) is not None:
                setattr(made, name, values := values.view())
                values.flags.writeable = False
        return made

    @property
    def parts(self) -> npt.NDArray[np.float32]:
        """All in-phase and quadrature values, in whatever order: a view to be read or changed in place."""
        self.settle()
        if self._planes is not None:
            return self._planes[:, :, : self.shape[0]]
        assert self._matrix is not None
        return self._matrix.view(np.float32)

    def take(self, pulses: npt.NDArray[np.int64]) -> Samples:
        """Samples of some pulses, in this order."""
        if self._planes is None:
            return Samples(self.matrix[pulses])
        return Samples.from_planes(np.ascontiguousarray(self.planes[:, :, pulses]), pulses.size)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[Any]:
        values = self.matrix
        if copy and values is self._matrix:
            values = values.copy()
        return values if dtype is None else values.astype(dtype, copy=False)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, out: Any = None, **options: Any) -> Any:
        target = out[0] if out is not None else None
        if method == "__call__" and not options and ufunc in LINEAR and (target is None or target is inputs[0]):
            one, other = inputs
            if not isinstance(one, Samples) and ufunc is not np.subtract:
                one, other = other, one
            if isinstance(one, Samples):
                return _change(one if target is not None else one.copy(), ufunc, other)
        arrays = [value.matrix if isinstance(value, Samples) else value for value in inputs]
        found = getattr(ufunc, method)(*arrays, **options)
        if isinstance(target, Samples):
            target._matrix, target._planes, target._noise = Samples(found)._matrix, None, None
            return target
        same = isinstance(found, np.ndarray) and found.dtype.kind == "c" and found.shape == self.shape
        return Samples(found) if same else found

    def __add__(self, other: Any) -> Samples:
        return _change(self.copy(), np.add, other)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Samples:
        return _change(self.copy(), np.subtract, other)

    def __mul__(self, other: Any) -> Samples:
        return _change(self.copy(), np.multiply, other)

    __rmul__ = __mul__

    def __iadd__(self, other: Any) -> Samples:
        return _change(self, np.add, other)

    def __isub__(self, other: Any) -> Samples:
        return _change(self, np.subtract, other)

    def __imul__(self, other: Any) -> Samples:
        return _change(self, np.multiply, other)


def _change(samples: Samples, ufunc: Any, other: Any) -> Samples:
    """Add, subtract or multiply in place by a number, an array that fits (pulses, samples), or samples."""
    samples.settle()
    if samples._planes is None:
        values = other.matrix if isinstance(other, Samples) else other
        ufunc(samples._matrix, values, out=samples._matrix, casting="same_kind")
        return samples
    re, im = samples._planes[0, :, : samples.shape[0]], samples._planes[1, :, : samples.shape[0]]
    if isinstance(other, Samples):
        other_re, other_im = other.planes[:, :, : samples.shape[0]]
    else:
        values = np.atleast_2d(np.asarray(other)).T
        other_re, other_im = (part.astype(np.float32) for part in (values.real, values.imag))
    if ufunc is np.multiply:
        _multiply(re, im, other_re, other_im)
    else:
        ufunc(re, other_re, out=re)
        ufunc(im, other_im, out=im)
    return samples


def _multiply(re: Planes, im: Planes, by_re: Planes, by_im: Planes) -> None:
    if not by_im.any():
        re *= by_re
        im *= by_re
        return
    from doppelgait.core.kernels.planes import turn_planes

    np.broadcast_shapes(re.shape, by_re.shape)
    shape = (by_re.shape[0], re.shape[1])
    turn_planes(re, im, *(np.ascontiguousarray(np.broadcast_to(part, shape)) for part in (by_re, by_im)))


def _split(matrix: Matrix, rows: slice) -> Planes:
    """Planes of some columns of a matrix."""
    from doppelgait.core.kernels.synthesis import split_planes

    planes = np.empty((2, rows.stop - rows.start, matrix.shape[0]), dtype=np.float32)
    split_planes(matrix, rows.start, planes[0], planes[1])
    return planes
