"""Sums of range responses of pulses, chirps and sweeps."""

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
TWO, FOUR, QUARTER, TURN = np.float32(2.0), np.float32(4.0), np.float32(0.25), np.float32(2.0 * math.pi)
ONE_BIT, TWO_BIT = np.int32(1), np.int32(2)

ORDERS = 8
"""Terms of the power series by which a scatterer is moved and bent between the places of the table of taps."""
PLACES = 16
"""Places of that table within half a range bin."""
TAPS = 8
"""Half bins that a scatterer is spread over."""
ROW, WIDE = 24, 16
"""Values in a row of the table, its taps from the eighth on, and how many of them are added: two whole blocks."""
SHARES = tuple(np.float32(1.0 / (d + 1)) for d in range(ORDERS))
K1, K2, K3, K4, K5, K6, K7, K8 = (np.uint64(k) for k in range(1, 9))
ROW_ = np.uint64(ROW)

Float64Array = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]


@kernel(fastmath=("contract",), apart=True, inline="llvm")
def _phasors(size, turns, u, v):  # type: ignore[no-untyped-def]
    """Compute amplitude times phasor, reduced to half a turn.
    Sine and cosine are polynomials on an eighth of a turn, exact to 4e-9.
    """
    for scatterer in range(np.uint64(turns.shape[0])):
        part = turns[scatterer]
        quarter = np.rint(part * FOUR)
        angle = (part - quarter * QUARTER) * TURN
        square = angle * angle
        cos = ONE - (HALF * square - square * square * (C0 + square * (C1 + square * C2)))
        sin = angle + angle * square * (S0 + square * (S1 + square * S2))
        count = np.int32(quarter)
        odd = (count & ONE_BIT) != 0
        re = sin if odd else cos
        im = cos if odd else sin
        u[scatterer] = size[scatterer] * (-re if ((count + ONE_BIT) & TWO_BIT) != 0 else re)
        v[scatterer] = size[scatterer] * (-im if (count & TWO_BIT) != 0 else im)


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
    Shapes: amplitude, turns (I, L); delay, doppler (I, L); out (I, N).
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
    They are those of :func:`add_responses`, from a table.
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


@kernel(fastmath=("contract",), apart=True)
def _describe_sweep(range_m, velocity_mps, amplitude, extra_rad, facts, fine, places):  # type: ignore[no-untyped-def]
    """Compute amplitude, phase, bend and place of all scatterers in one sweep.
    Places are taken modulo the number of samples.
    """
    per_m, first_turns, carrier_hz, half_slope, bandwidth_hz = facts[0], facts[1], facts[2], facts[3], facts[4]
    lag, coupling, bend, first_bin, n_samples, turns_round = facts[5], facts[6], facts[7], facts[8], facts[9], facts[10]
    for scatterer in range(np.uint64(range_m.shape[0])):
        delay = range_m[scatterer] * per_m
        beta = velocity_mps[scatterer] * per_m
        turns = first_turns - delay * (carrier_hz - half_slope * delay)
        if extra_rad is not None:
            turns += extra_rad[scatterer] * (0.5 / math.pi)
        place = bandwidth_hz * delay * (1.0 + lag * beta) - coupling * beta - first_bin
        rounds = np.floor(place / n_samples)
        turns += turns_round * rounds
        halves = 2.0 * (place - rounds * n_samples)
        halves = halves if 0.0 <= halves <= 2.0 * n_samples else 0.0  # rounded to below 0, or no number
        whole = np.floor(halves)
        inside = (halves - whole) * PLACES
        row = np.floor(inside)
        fine[0, scatterer] = np.float32(amplitude[scatterer])
        fine[1, scatterer] = np.float32(turns - np.rint(turns))
        fine[2, scatterer] = np.float32((row + 0.5 - inside) * (0.5 * math.pi / PLACES))
        fine[3, scatterer] = np.float32(bend * beta * (1.0 + 0.5 * lag * beta))
        first = np.int64(whole) + (2 * TAPS - TAPS // 2 + 1)
        shift = first & 7
        places[0, scatterer] = np.uint64(first - shift)
        places[1, scatterer] = np.uint64(np.int64(row) * (ORDERS * ROW) + 7 - shift)


@kernel(fastmath=("contract",), apart=True, inline="llvm")
def _expand(fine, u, v):  # type: ignore[no-untyped-def]
    r"""Compute the complex weights of all orders from those of order 0."""
    n = np.uint64(fine.shape[1])
    for scatterer in range(n):
        eta, bend = fine[2, scatterer], TWO * fine[3, scatterer]
        re, im = u[scatterer], v[scatterer]
        next_re, next_im = eta * re, eta * im
        u[n + scatterer], v[n + scatterer] = next_re, next_im
        for order in range(1, ORDERS - 1):
            share = SHARES[order]
            new_re, new_im = share * (eta * next_re + bend * im), share * (eta * next_im - bend * re)
            at = np.uint64(order + 1) * n + scatterer
            u[at], v[at] = new_re, new_im
            re, im, next_re, next_im = next_re, next_im, new_re, new_im


@kernel(fastmath=("contract",), apart=True, inline="llvm")
def _spread(taps, places, u, v, n, scatterer, grid):  # type: ignore[no-untyped-def]
    """Add one scatterer to the half bins around it."""
    first, row = places[0, scatterer], places[1, scatterer]
    i1, i2, i3 = n + scatterer, K2 * n + scatterer, K3 * n + scatterer
    i4, i5, i6, i7 = K4 * n + scatterer, K5 * n + scatterer, K6 * n + scatterer, K7 * n + scatterer
    u0, u1, u2, u3, u4, u5, u6, u7 = u[scatterer], u[i1], u[i2], u[i3], u[i4], u[i5], u[i6], u[i7]
    v0, v1, v2, v3, v4, v5, v6, v7 = v[scatterer], v[i1], v[i2], v[i3], v[i4], v[i5], v[i6], v[i7]
    for k in range(WIDE):
        at, half = row + np.uint64(k), first + np.uint64(k)
        x0, x1, x2, x3 = taps[at], taps[at + ROW_], taps[at + K2 * ROW_], taps[at + K3 * ROW_]
        x4, x5, x6, x7 = taps[at + K4 * ROW_], taps[at + K5 * ROW_], taps[at + K6 * ROW_], taps[at + K7 * ROW_]
        grid[0, half] += (u0 * x0 + u1 * x1 + u2 * x2 + u3 * x3) + (u4 * x4 + u5 * x5 + u6 * x6 + u7 * x7)
        grid[1, half] += (v0 * x0 + v1 * x1 + v2 * x2 + v3 * x3) + (v4 * x4 + v5 * x5 + v6 * x6 + v7 * x7)


@kernel(fastmath=("contract",), apart=True, inline="llvm")
def _add_halves(response, even, odd, grid, begin, sums):  # type: ignore[no-untyped-def]
    """Add the responses of eight half bins to the sums."""
    j1, j2, j3, j4 = begin + K1, begin + K2, begin + K3, begin + K4
    j5, j6, j7 = begin + K5, begin + K6, begin + K7
    u0, u1, u2, u3 = grid[0, begin], grid[0, j1], grid[0, j2], grid[0, j3]
    u4, u5, u6, u7 = grid[0, j4], grid[0, j5], grid[0, j6], grid[0, j7]
    v0, v1, v2, v3 = grid[1, begin], grid[1, j1], grid[1, j2], grid[1, j3]
    v4, v5, v6, v7 = grid[1, j4], grid[1, j5], grid[1, j6], grid[1, j7]
    for n in range(np.uint64(sums.shape[1])):
        x0, x2, x4, x6 = response[even + n], response[even + n - K1], response[even + n - K2], response[even + n - K3]
        x1, x3, x5, x7 = response[odd + n], response[odd + n - K1], response[odd + n - K2], response[odd + n - K3]
        sums[0, n] += u0 * x0 + u1 * x1 + u2 * x2 + u3 * x3 + u4 * x4 + u5 * x5 + u6 * x6 + u7 * x7
        sums[1, n] += v0 * x0 + v1 * x1 + v2 * x2 + v3 * x3 + v4 * x4 + v5 * x5 + v6 * x6 + v7 * x7


@kernel(fastmath=("contract",))
def add_sweep_responses(
    range_m: Float64Array,
    velocity_mps: Float64Array,
    amplitude: Float64Array,
    extra_phase_rad: Float64Array | None,
    facts: Float64Array,
    taps: Float32Array,
    response: Float32Array,
    turn: Float32Array,
    fine: Float32Array,
    places: npt.NDArray[np.uint64],
    weights: Float32Array,
    grid: Float32Array,
    used: npt.NDArray[np.uint8],
    sums: Float32Array,
    out: npt.NDArray[np.complex64],
) -> None:
    r"""Write the range bins of frequency sweeps, without their samples.
    A non-uniform Fourier transform of type 1 (Fessler and Sutton, IEEE Trans. Signal Processing 51(2), 2003) with a
    Kaiser-Bessel window over TAPS half bins. Errors are below 1e-6 of the sum of amplitudes. Shapes: range_m (I, L).
    """
    n_scatterers, n_samples = np.uint64(range_m.shape[1]), np.int64(facts[9])
    width = np.uint64(response.shape[0] // 2)
    u, v = weights[0], weights[1]
    for pulse in range(out.shape[0]):
        extra_rad = None if extra_phase_rad is None else extra_phase_rad[pulse]
        _describe_sweep(range_m[pulse], velocity_mps[pulse], amplitude[pulse], extra_rad, facts, fine, places)
        _phasors(fine[0], fine[1], u, v)
        _expand(fine, u, v)
        for scatterer in range(n_scatterers):
            block = places[0, scatterer] // K8
            used[block] = 1
            used[block + K1] = 1
            _spread(taps, places, u, v, n_scatterers, scatterer, grid)
        for n in range(np.uint64(sums.shape[1])):
            sums[0, n] = 0.0
            sums[1, n] = 0.0
        for block in range(np.uint64(used.shape[0])):
            if used[block]:
                used[block] = 0
                even = np.uint64(n_samples + 16 - 4 * np.int64(block))  # half bin 8 block is whole bin 4 block - 8
                _add_halves(response, even, even + width, grid, block * K8, sums)
                for n in range(block * K8, block * K8 + K8):
                    grid[0, n] = 0.0
                    grid[1, n] = 0.0
        for n in range(np.uint64(out.shape[1])):
            re, im = sums[0, n], sums[1, n]
            out[pulse, n] = complex(re * turn[0, n] - im * turn[1, n], re * turn[1, n] + im * turn[0, n])
