"""Sums of matched-filter responses: rectangular pulses and linear chirps after compression."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel
from doppelgait.core.kernels.noise import C0, C1, C2, HALF, ONE, S0, S1, S2

SMALL_ANGLE = 1e-3
"""Below it sin(x) / x is 1 - x^2 / 6, to 1e-14."""

NODE = math.sqrt(0.75)
"""Chebyshev nodes of an interval (-1, 1) are -NODE, 0 and NODE."""
FOUR, QUARTER, TURN = np.float32(4.0), np.float32(0.25), np.float32(2.0 * math.pi)

Float64Array = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]


@kernel()
def _phasor(turns):  # type: ignore[no-untyped-def]
    """Compute the unit phasor of a number of turns.

    The number is reduced to half a turn first.
    """
    angle = 2.0 * math.pi * (turns - np.rint(turns))
    return complex(math.cos(angle), math.sin(angle))


@kernel()
def _bin(n, n_bins):  # type: ignore[no-untyped-def]
    """Limit a bin number to 0..n_bins."""
    return int(min(max(n, 0.0), float(n_bins)))


@kernel()
def _add_side(total, begin, end, first, step, side, delta, beta, peak):  # type: ignore[no-untyped-def]
    """Add a response to the bins on one side of its middle.

    The bins are begin..end-1; x of bin n is first + n step.

    On one side (side = 1 above the middle, -1 below) the sine's argument g is quadratic in x, so that its phasor is
    turned on by its step, and the step by its own. The other factor is turned on by a step that stays.
    """
    x = first + begin * step
    slope = beta - side * delta
    g = delta + x * (slope - side * beta * x)
    sine = _phasor(0.5 * g)
    turn = _phasor(0.5 * step * (slope - side * beta * (2.0 * x + step)))
    bend = _phasor(-side * beta * step * step)
    doppler = peak * _phasor(0.5 * delta * x)
    doppler_turn = _phasor(0.5 * delta * step)
    for n in range(begin, end):
        x = first + n * step
        angle = math.pi * (delta + x * (slope - side * beta * x))
        sinc = sine.imag / angle if abs(angle) > SMALL_ANGLE else 1.0 - angle * angle / 6.0
        total[n] += doppler * ((1.0 - side * x) * sinc)
        sine *= turn
        turn *= bend
        doppler *= doppler_turn


@kernel(inline="llvm")
def _add_response(total, start, step, delta, beta, peak):  # type: ignore[no-untyped-def]
    """Add a response to all bins; x of bin 0 is ``start``."""
    n_bins = total.shape[0]
    lowest = _bin(math.floor((-1.0 - start) / step) + 1, n_bins)
    middle = _bin(math.ceil(-start / step), n_bins)
    stop = _bin(math.ceil((1.0 - start) / step), n_bins)
    _add_side(total, lowest, middle, start, step, -1.0, delta, beta, peak)
    _add_side(total, middle, stop, start, step, 1.0, delta, beta, peak)


@kernel()
def add_responses(
    amplitude: Float64Array,
    turns: Float64Array,
    delay: Float64Array,
    doppler: Float64Array,
    first: float,
    step: float,
    time_bandwidth: float,
    out: npt.NDArray[np.complex64],
) -> None:
    r"""Write the matched-filter responses of all scatterers into every pulse.

    .. math::

       y_{in} = \sum_l a\, e^{2 \pi j p}\, (1 - |x|)\, e^{\pi j \delta x}\,
       \mathrm{sinc}\left((\delta + \beta x)(1 - |x|)\right), \quad x = x_0 + n \Delta - x_{il}, \ |x| < 1

    Everything is in pulse durations T: x is delay / T, delta is Doppler shift times T, beta the time-bandwidth
    product (0 for a rectangular pulse). All in float64; only the sum is rounded to float32.

    Parameters
    ----------
    amplitude, turns : ndarray, shape (I, L)
        Amplitude a and phase p in turns.
    delay, doppler : ndarray, shape (I, L)
        Delay x_il and Doppler shift delta of every scatterer.
    first, step : float
        Delay of the first bin, and from bin to bin.
    time_bandwidth : float
    out : ndarray, shape (I, N), complex64
        Overwritten.
    """
    n_bins = out.shape[1]
    total = np.empty(n_bins, dtype=np.complex128)
    for pulse in range(out.shape[0]):
        total[:] = 0.0
        for scatterer in range(amplitude.shape[1]):
            peak = amplitude[pulse, scatterer] * _phasor(turns[pulse, scatterer])
            start = first - delay[pulse, scatterer]
            _add_response(total, start, step, doppler[pulse, scatterer], time_bandwidth, peak)
        for n in range(n_bins):
            out[pulse, n] = total[n]


@kernel(fastmath=("contract",), apart=True)
def _add_row(table, row, begin, weights, scatterer, sums):  # type: ignore[no-untyped-def]
    """Add one response, weighted rows of the table, to all bins.

    Without slices of arrays, whose references would be counted.
    """
    w0, w1, w2 = weights[scatterer, 0], weights[scatterer, 1], weights[scatterer, 2]
    u, v = weights[scatterer, 3], weights[scatterer, 4]
    for n in range(np.uint64(sums.shape[1])):
        at = begin + n
        x = w0 * table[row, 0, at] + w1 * table[row, 1, at] + w2 * table[row, 2, at]
        sums[0, n] += u * x
        sums[1, n] += v * x


@kernel()
def add_tabled_responses(
    amplitude: Float64Array,
    turns: Float64Array,
    delay: Float64Array,
    doppler: Float64Array,
    first: float,
    step: float,
    time_bandwidth: float,
    largest_doppler: float,
    table: Float32Array,
    weights: Float32Array,
    total: npt.NDArray[np.complex128],
    sums: Float32Array,
    out: npt.NDArray[np.complex64],
) -> None:
    r"""Write the responses of chirps that are longer than the frame.

    They are those of :func:`add_responses`, from a table. Doppler moves the response of a chirp by -delta / beta; all
    else that it changes is at most delta / beta of the peak and is left out. Scatterers outside the frame, or of more
    Doppler shift than ``largest_doppler``, are computed bin by bin as there. Sums are made in float32. Error below 1e-6
    of the sum of amplitudes.

    Parameters
    ----------
    amplitude, turns, delay, doppler, first, step, time_bandwidth, out
        As for :func:`add_responses`.
    largest_doppler : float
        Largest delta of which the response is taken from the table.
    table : ndarray, shape (P, 3, N - 1 + M), float32
        Response without Doppler shift, at the bins -(N - 1) to M - 1 from the one before the scatterer, at the
        Chebyshev nodes of P intervals of a bin.
    weights : ndarray, shape (L, 5), float32
        Memory to work in, as is the rest.
    total : ndarray, shape (N,), complex128
    sums : ndarray, shape (2, M), float32
        M is N or more, a multiple of the length of vectors: no loop has a remainder.
    """
    n_bins, n_places = out.shape[1], table.shape[0]
    for pulse in range(out.shape[0]):
        sums[:] = 0.0
        others = 0
        for scatterer in range(amplitude.shape[1]):
            phase = turns[pulse, scatterer]
            part = np.float32(phase - np.rint(phase))
            quarter = np.rint(part * FOUR)
            angle = (part - quarter * QUARTER) * TURN
            square = angle * angle
            cos = ONE - (HALF * square - square * square * (C0 + square * (C1 + square * C2)))
            sin = angle + angle * square * (S0 + square * (S1 + square * S2))
            count = np.int32(quarter)
            if count & np.int32(1):
                cos, sin = -sin, cos
            size = np.float32(amplitude[pulse, scatterer])
            size = -size if count & np.int32(2) else size
            weights[scatterer, 3] = size * cos
            weights[scatterer, 4] = size * sin
        for scatterer in range(amplitude.shape[1]):
            delta = doppler[pulse, scatterer]
            place = (delay[pulse, scatterer] - delta / time_bandwidth - first) / step
            whole = math.floor(place)
            if not (0.0 <= whole < n_bins and abs(delta) <= largest_doppler):
                others += 1
                continue
            fine = (place - whole) * n_places
            row = min(int(fine), n_places - 1)
            u = 2.0 * (fine - row) - 1.0
            weights[scatterer, 0] = u * (u - NODE) / 1.5
            weights[scatterer, 1] = 1.0 - u * u / 0.75
            weights[scatterer, 2] = u * (u + NODE) / 1.5
            _add_row(table, np.uint64(row), np.uint64(n_bins - 1 - int(whole)), weights, np.uint64(scatterer), sums)
        for n in range(n_bins):
            out[pulse, n] = complex(sums[0, n], sums[1, n])
        if others == 0:
            continue
        total[:] = 0.0
        for scatterer in range(amplitude.shape[1]):
            delta = doppler[pulse, scatterer]
            whole = math.floor((delay[pulse, scatterer] - delta / time_bandwidth - first) / step)
            if not (0.0 <= whole < n_bins and abs(delta) <= largest_doppler):
                peak = amplitude[pulse, scatterer] * _phasor(turns[pulse, scatterer])
                _add_response(total, first - delay[pulse, scatterer], step, delta, time_bandwidth, peak)
        for n in range(n_bins):
            out[pulse, n] += total[n]
