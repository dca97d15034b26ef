"""Complex samples as float32 planes or a matrix, with noise computed where they are read."""

from __future__ import annotations

import math
import threading
import weakref
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
from numpy.lib.mixins import NDArrayOperatorsMixin

from doppelgait._core import native
from doppelgait.core.errors import AnalysisError

Planes = npt.NDArray[np.float32]
Matrix = npt.NDArray[np.complex64]
Spans = npt.NDArray[np.int64]
Factor = npt.NDArray[np.float32]
Turns = npt.NDArray[np.float64]
Rows = Callable[[int, int], Matrix]
T = TypeVar("T", np.float32, np.float64)

WHITE: Factor = np.ones(1, dtype=np.float32)  # factor of white noise
ROWS = 32
"""Rows of planes or of a matrix that are processed together, so that intermediate results stay in the cache."""
LARGEST_SPARE_BYTES = 1 << 25
"""Maximum size of memory that a thread keeps for its next samples or table. Larger memory is released at once."""
MAX_SPARE_BYTES = 1 << 26  # maximum size of all memory that a thread keeps
Spare = list[tuple[int, npt.NDArray[np.uint8]]]
_of_thread = threading.local()


def borrow_planes(shape: tuple[int, ...]) -> Planes:
    """Make float32 planes in reused memory of this thread: new pages cost a third of the echoes."""
    return borrow_memory(shape, np.float32)


def borrow_memory(shape: tuple[int, ...], dtype: type[T]) -> npt.NDArray[T]:
    """Make an undefined array in reused memory of this thread."""
    n_values, n_bytes = math.prod(shape), math.prod(shape) * np.dtype(dtype).itemsize
    spare: Spare = _of_thread.__dict__.setdefault("spare", [])
    fits = [number for number, (size, _) in enumerate(spare) if n_bytes <= size <= 2 * n_bytes]
    if not fits and sum(size for size, _ in spare) > MAX_SPARE_BYTES // 2:
        del spare[0]
    size, memory = spare.pop(fits[-1]) if fits else (n_bytes, np.empty(n_bytes, dtype=np.uint8))
    # Views refer to the array that owns the memory. Through a buffer, they refer to this array, which is finalised.
    values: npt.NDArray[T] = np.frombuffer(memory.data, dtype=dtype, count=n_values)
    if 0 < size <= LARGEST_SPARE_BYTES:
        weakref.finalize(values, _return_memory, spare, size, memory).atexit = False
    return values.reshape(shape)


def _return_memory(spare: Spare, size: int, memory: npt.NDArray[np.uint8]) -> None:
    if sum(other for other, _ in spare) + size <= MAX_SPARE_BYTES:
        spare.append((size, memory))


class Noise(NamedTuple):
    """Pending receiver noise, which depends only on key, pulse and sample."""

    key: int
    rms_v: float
    factor: Factor


class Samples(NDArrayOperatorsMixin):
    """Complex samples, one row per pulse.

    In arithmetic they are like a complex64 array of shape (pulses, samples). ``samples + 0.1`` or
    ``samples * turn[:, None]`` return new samples. ``samples += row`` reuses the memory if the
    samples own it. ``numpy.asarray(samples)`` is the complex matrix.

    Parameters
    ----------
    matrix : array_like, shape (pulses, samples), complex
        Values in V. The matrix is never changed: the samples copy it when they are changed.

    Notes
    -----
    The values keep the layout they were made in: the *matrix* has one row per pulse; the *planes*, float32 of shape (2,
    samples, at least pulses), have one contiguous row per sample, undefined beyond the last pulse. Receiver
    noise may be pending (:meth:`with_noise`): it is computed for the values that are read. *Stored* samples
    (:meth:`stored`) are read or computed on every access.
    """

    __slots__ = ("_matrix", "_noise", "_owned", "_planes", "_stored", "shape")

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
        self._stored: Rows | None = None
        self._owned = False
        self.shape: tuple[int, int] = values.shape

    @classmethod
    def _make(
        cls,
        shape: tuple[int, int],
        matrix: Matrix | None = None,
        planes: Planes | None = None,
        noise: Noise | None = None,
        owned: bool = False,
        stored: Rows | None = None,
    ) -> Samples:
        made = cls.__new__(cls)
        made.shape, made._matrix, made._planes, made._noise, made._owned = shape, matrix, planes, noise, owned
        made._stored = stored
        return made

    def _share(self) -> Samples:
        """Return the same values in memory that the result does not own."""
        return self._make(self.shape, self._matrix, self._planes, self._noise, stored=self._stored)

    @classmethod
    def stored(cls, shape: tuple[int, int], rows: Rows) -> Samples:
        """Wrap samples that ``rows(first, stop)`` reads or computes on every access."""
        return cls._make(shape, stored=rows)

    @property
    def in_memory(self) -> bool:
        """False for samples that are read or computed on every access."""
        return self._stored is None

    @classmethod
    def own(cls, matrix: Matrix) -> Samples:
        """Wrap a complex64 matrix that nothing else uses; the samples may change it."""
        return cls._make(matrix.shape, np.ascontiguousarray(matrix, dtype=np.complex64), None, None, True)

    @classmethod
    def from_planes(cls, planes: Planes, n_pulses: int) -> Samples:
        """Wrap planes (2, samples, n_pulses or more) of no other owner, which may be changed."""
        return cls._make((n_pulses, planes.shape[1]), None, np.ascontiguousarray(planes), None, True)

    @classmethod
    def join(cls, tiles: Iterable[Samples], shape: tuple[int, int]) -> Samples:
        """Join tiles of pulses, one or more, in the layout that they have."""
        matrix, planes, first = None, None, 0
        for tile in tiles:
            if tile.shape == shape:
                return tile
            pulses = slice(first, first + tile.shape[0])
            if tile._planes is None:
                matrix = np.empty(shape, dtype=np.complex64) if matrix is None else matrix
                matrix[pulses] = tile.matrix
            else:
                planes = np.empty((2, shape[1], shape[0]), dtype=np.float32) if planes is None else planes
                planes[:, :, pulses] = tile._planes[:, :, : tile.shape[0]]
            first = pulses.stop
        return cls._make(shape, matrix, planes, None, True)

    @property
    def matrix(self) -> Matrix:
        """Complex64 array, one row per pulse."""
        if self._stored is not None:
            return self._stored(0, self.shape[0])
        noisy = self._share().add_pending_noise()
        if noisy._matrix is not None:
            return noisy._matrix
        assert noisy._planes is not None
        joined = np.empty(self.shape, dtype=np.complex64)
        native.join_planes(noisy._planes[0], noisy._planes[1], joined)
        return joined

    def rows(self, first: int, stop: int) -> Matrix:
        """Return some pulses of the matrix."""
        return self._stored(first, stop) if self._stored is not None else self.matrix[first:stop]

    @property
    def planes(self) -> Planes:
        """Real and imaginary planes, float32, one row per sample."""
        noisy = self if self._stored is not None else self._share().add_pending_noise()
        return noisy._planes if noisy._planes is not None else _split(noisy.matrix, slice(0, self.shape[1]))

    def read(self, spans: Spans, margin: int = 0) -> tuple[Planes, int]:
        """Read planes of the samples with a span, never to be changed, and the number of the first one.
        A row of ``spans`` is the first and one past the last pulse; beyond them and ``margin``, values may be NaN.
        """
        needed = np.flatnonzero(spans[:, 0] < spans[:, 1])
        first, stop = (int(needed[0]), int(needed[-1]) + 1) if needed.size else (0, 0)
        rows = slice(first, stop)
        matrix = self._matrix if self._stored is None else self.matrix
        split = None if matrix is None else _split(matrix, rows)
        source = self._planes[:, rows] if split is None and self._planes is not None else split
        assert source is not None
        if self._noise is None:
            return source, first
        noisy = source if split is not None else borrow_planes(source.shape)
        native.copy_noise_spans(source[0], source[1], spans[rows], first, *self._noise, margin, noisy[0], noisy[1])
        return noisy, first

    def read_tile(self, pulses: slice, columns: slice) -> Planes:
        """Copy planes (2, columns, pulses) of some pulses and range bins."""
        if self._stored is not None:
            tile = _split(self._stored(pulses.start, pulses.stop), columns)
        elif self._matrix is not None:
            tile = _split(self._matrix[pulses], columns)
        else:
            assert self._planes is not None
            tile = borrow_planes((2, columns.stop - columns.start, pulses.stop - pulses.start))
            tile[:] = self._planes[:, columns, pulses]
        if self._noise is not None:
            native.add_noise_block(tile[0], tile[1], 0, tile.shape[2], columns.start, pulses.start, *self._noise)
        return tile

    def with_noise(self, key: int, power_v2: float, factor: Factor = WHITE, *, first_pulse: int = 0) -> Samples:
        """Return the samples with complex Gaussian noise pending, white or correlated by the taps ``factor`` (E-18c).
        The result shares the memory of these samples, which then only it may change. To an excerpt that starts at
        ``first_pulse`` of a longer recording, the noise of that recording is added at once.
        """
        if first_pulse:
            planes, n_pulses = self.planes[:, :, : self.shape[0]].copy(), self.shape[0]
            native.add_noise_block(planes[0], planes[1], 0, n_pulses, 0, first_pulse, key, math.sqrt(power_v2), factor)
            return Samples.from_planes(planes, n_pulses)
        quiet = self.add_pending_noise()
        owned, quiet._owned, self._owned = quiet._owned, False, False
        return self._make(quiet.shape, quiet._matrix, quiet._planes, Noise(key, math.sqrt(power_v2), factor), owned)

    def add_pending_noise(self) -> Samples:
        """Add pending noise, in place if the samples own their memory."""
        if self._stored is not None:
            return Samples.own(self.matrix)
        if self._noise is None:
            return self
        noisy = self._make(self.shape, self._matrix, self._planes, None, self._owned)._make_writable()
        if noisy._matrix is not None:
            native.add_noise_matrix(noisy._matrix, *self._noise)
        elif noisy._planes is not None:
            native.add_noise_block(noisy._planes[0], noisy._planes[1], 0, self.shape[0], 0, 0, *self._noise)
        if self._owned:
            self._noise = None
        return noisy

    def copy(self) -> Samples:
        """Copy the samples."""
        return self._share()._make_writable() if self._stored is None else self.add_pending_noise()

    def _make_writable(self, keep: bool = True) -> Samples:
        """Return samples that may be changed: these, a copy if ``keep``, or undefined ones."""
        if self._owned:
            return self
        matrix = None if self._matrix is None else np.empty_like(self._matrix)
        planes = None if self._planes is None else borrow_planes(self._planes.shape)
        if keep and matrix is not None:
            matrix[:] = self._matrix
        if keep and planes is not None:
            planes[:] = self._planes
        return self._make(self.shape, matrix, planes, self._noise, True)

    def take_pulses(self, first: int, stop: int) -> Samples:
        """Copy some pulses, in the layout of the samples; pending noise is added."""
        if self._planes is None or self._noise is not None:
            return Samples(self.rows(first, stop))
        return Samples.from_planes(self._planes[:, :, first:stop], stop - first)

    def freeze(self) -> Samples:
        """Return the same values; a later change of either object is made in a copy."""
        self._owned = False
        return self._share()

    def quantise(self, step: float, lowest: float, highest: float, limit: float = math.inf) -> tuple[Samples, int]:
        """Round both parts to converter steps; also count the values above ``limit``."""
        noisy = self.add_pending_noise()
        changed = noisy._make_writable(keep=False)
        values, n = noisy._rows()
        n_beyond: int = native.quantise_parts(values, n, step, lowest, highest, limit, changed._rows()[0])
        return changed, n_beyond

    def rotate(self, common: Turns, phases: Turns, weights: Turns) -> Samples:
        """Rotate sample n of pulse i by common[i] + weights[n] @ phases[:, i] turns."""
        noisy = self.add_pending_noise()
        if noisy._planes is None:
            noisy = Samples.from_planes(noisy.planes, self.shape[0])
        changed = noisy._make_writable(keep=False)
        assert noisy._planes is not None
        assert changed._planes is not None
        native.rotate_parts(*noisy._planes, common, phases, weights, *changed._planes)
        return changed

    def find_largest_part(self) -> float:
        """Return the largest in-phase or quadrature magnitude."""
        largest: float = native.find_largest_part(*self.add_pending_noise()._rows())
        return largest

    def _rows(self) -> tuple[Planes, int]:
        """Return all float32 rows and the number of filled columns."""
        if self._planes is not None:
            return self._planes.reshape(-1, self._planes.shape[2]), self.shape[0]
        return self.matrix.view(np.float32), 2 * self.shape[1]

    def _parts(self) -> tuple[Planes, Planes]:
        """Return views of the in-phase and the quadrature parts, one row per sample."""
        if self._planes is not None:
            return self._planes[0], self._planes[1]
        return self.matrix.real.T, self.matrix.imag.T

    def repeat(self, pulses: npt.NDArray[np.int64], sources: npt.NDArray[np.int64]) -> Samples:
        """Replace some pulses by copies of other pulses."""
        changed = self.add_pending_noise()._make_writable()
        for values in changed._parts():
            values[:, pulses] = values[:, sources]
        return changed

    def add_at(self, pulses: npt.NDArray[np.int64], columns: npt.NDArray[np.int64], values: npt.ArrayLike) -> Samples:
        """Add values to samples, broadcast; every sample may occur only once."""
        changed, added = self.add_pending_noise()._make_writable(), np.asarray(values)
        for values_of_part, added_to_part in zip(changed._parts(), (added.real, added.imag), strict=True):
            values_of_part[columns, pulses] += added_to_part
        return changed

    def apply_imbalance(self, gain: float, phase_rad: float) -> Samples:
        """Make Re y + j gain Im(y e^(j phase)): gain and phase imbalance of the quadrature part."""
        changed = self.add_pending_noise()._make_writable()
        by_im, by_re = np.float32(gain * math.cos(phase_rad)), np.float32(gain * math.sin(phase_rad))
        re, im = changed._parts()
        im *= by_im
        for begin in range(0, re.shape[0], ROWS):
            im[begin : begin + ROWS] += by_re * re[begin : begin + ROWS]
        return changed

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[Any]:
        values = self.matrix
        if copy and values is self._matrix:
            values = values.copy()
        return values if dtype is None else values.astype(dtype, copy=False)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, out: Any = None, **options: Any) -> Any:
        in_place = out is not None
        if (in_place and not out[0] is inputs[0] is self) or method not in ("__call__", "reduce"):
            return NotImplemented
        in_layout = ufunc in (np.add, np.multiply) or (ufunc is np.subtract and inputs[0] is self)
        if method == "__call__" and not options and in_layout:
            other = inputs[1] if inputs[0] is self else inputs[0]  # an array on the left
            return _change_samples(self if in_place else self.copy(), ufunc, other)
        arrays = [value.matrix if isinstance(value, Samples) else value for value in inputs]
        found = getattr(ufunc, method)(*arrays, **options)
        same = isinstance(found, np.ndarray) and found.dtype.kind == "c" and found.shape == self.shape
        return Samples.own(found) if same else found

    def __truediv__(self, other: Any) -> Samples:
        return _change_samples(self.copy(), np.multiply, 1.0 / np.asarray(other))

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, index: Any) -> Any:
        return self.matrix[index]


def _change_samples(samples: Samples, ufunc: Any, other: Any) -> Samples:
    changed = samples.add_pending_noise()._make_writable()
    if changed._matrix is not None:
        values = other.matrix if isinstance(other, Samples) else np.asarray(other)
        ufunc(changed._matrix, values, out=changed._matrix, casting="same_kind")
        return changed
    assert changed._planes is not None
    n_pulses = samples.shape[0]
    re, im = changed._planes[0, :, :n_pulses], changed._planes[1, :, :n_pulses]
    if isinstance(other, Samples):
        by_re, by_im = other.planes[:, :, :n_pulses]
    else:
        values = np.atleast_2d(np.asarray(other)).T
        np.broadcast_shapes(values.shape, re.shape)
        by_re, by_im = (np.ascontiguousarray(part, dtype=np.float32) for part in (values.real, values.imag))
    if ufunc is not np.multiply:
        ufunc(re, by_re, out=re)
        ufunc(im, by_im, out=im)
    elif not by_im.any():
        re *= by_re
        im *= by_re
    else:
        native.turn_planes(re, im, *(np.broadcast_to(part, (by_re.shape[0], n_pulses)) for part in (by_re, by_im)))
    return changed


def _split(matrix: Matrix, rows: slice) -> Planes:
    planes = borrow_planes((2, rows.stop - rows.start, matrix.shape[0]))
    columns = matrix[:, rows]
    if columns.strides[1] != columns.itemsize:  # stored samples may be read in any memory order
        columns = np.ascontiguousarray(columns)
    native.split_planes(columns, planes[0], planes[1])
    return planes
