"""Sums of matched-filter responses: rectangular pulses and linear chirps after compression."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

SMALL_ANGLE = 1e-3
"""Below it sin(x) / x is 1 - x^2 / 6, to 1e-14."""

Float64Array = npt.NDArray[np.float64]


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
            lowest = _bin(math.floor((-1.0 - start) / step) + 1, n_bins)
            middle = _bin(math.ceil(-start / step), n_bins)
            stop = _bin(math.ceil((1.0 - start) / step), n_bins)
            delta = doppler[pulse, scatterer]
            _add_side(total, lowest, middle, start, step, -1.0, delta, time_bandwidth, peak)
            _add_side(total, middle, stop, start, step, 1.0, delta, time_bandwidth, peak)
        for n in range(n_bins):
            out[pulse, n] = total[n]
