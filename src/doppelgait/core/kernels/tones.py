"""Sums of complex tones with quadratic phase, for frequency-swept radars."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

LANES = 16
"""Sweeps side by side in the inner loop."""

Z_RE, Z_IM, W_RE, W_IM, Q_RE, Q_IM = 0, LANES, 2 * LANES, 3 * LANES, 4 * LANES, 5 * LANES
"""Places of the tone, its step and the step's step in the buffer, each for all lanes."""

Float64Array = npt.NDArray[np.float64]


@kernel()
def _start(turns, state, lane, amplitude):  # type: ignore[no-untyped-def]
    """Set tone, step and the step's step of one lane.

    They are numbers of turns, reduced to half a turn.
    """
    for part in range(3):
        angle = 2.0 * math.pi * (turns[part] - np.rint(turns[part]))
        size = amplitude if part == 0 else 1.0
        state[2 * part * LANES + lane] = size * math.cos(angle)
        state[(2 * part + 1) * LANES + lane] = size * math.sin(angle)


@kernel(fastmath=("contract",))
def _run(state, n_samples, re, im):  # type: ignore[no-untyped-def]
    """Add one tone in all lanes to the sums.

    Sample by sample: z <- z w, w <- w q.
    """
    for n in range(n_samples):
        row = n * LANES
        for lane in range(LANES):
            at = np.uint64(row + lane)
            z_re, z_im = state[Z_RE + lane], state[Z_IM + lane]
            w_re, w_im = state[W_RE + lane], state[W_IM + lane]
            q_re, q_im = state[Q_RE + lane], state[Q_IM + lane]
            re[at] += z_re
            im[at] += z_im
            state[Z_RE + lane] = z_re * w_re - z_im * w_im
            state[Z_IM + lane] = z_re * w_im + z_im * w_re
            state[W_RE + lane] = w_re * q_re - w_im * q_im
            state[W_IM + lane] = w_re * q_im + w_im * q_re


@kernel()
def add_tones(
    amplitude: Float64Array,
    turns: Float64Array,
    turns_per_sample: Float64Array,
    turns_per_sample2: Float64Array,
    out: npt.NDArray[np.complex64],
) -> None:
    r"""Write the sum of all tones into every sweep.

    .. math:: b_{in} = \sum_l a_{il}\, e^{2 \pi j (p_{il} + q_{il} u_n + r_{il} u_n^2)}, \quad u_n = n - (S - 1)/2

    Phases are reduced to half a turn in float64; from there a phasor is turned on by its step, and the step by its
    own, all in float64: the error after 10 000 samples is below 1e-11 of the amplitude. Only the sum is rounded to
    float32.

    Parameters
    ----------
    amplitude : ndarray, shape (I, L)
        Amplitude a of every scatterer in every sweep.
    turns, turns_per_sample, turns_per_sample2 : ndarray, shape (I, L)
        Phase p at the middle of the sweep, its slope q and half its curvature r, in turns.
    out : ndarray, shape (I, S), complex64, C-contiguous
        Overwritten; zero where there is no scatterer.
    """
    n_sweeps, n_samples = out.shape
    first = -0.5 * (n_samples - 1)
    re = np.empty(n_samples * LANES)
    im = np.empty(n_samples * LANES)
    state = np.zeros(6 * LANES)
    phases = np.empty(3)
    for begin in range(0, n_sweeps, LANES):
        used = min(LANES, n_sweeps - begin)
        re[:] = 0.0
        im[:] = 0.0
        for scatterer in range(amplitude.shape[1]):
            for lane in range(used):
                sweep = begin + lane
                slope, bend = turns_per_sample[sweep, scatterer], turns_per_sample2[sweep, scatterer]
                phases[0] = turns[sweep, scatterer] + first * (slope + bend * first)
                phases[1] = slope + bend * (2.0 * first + 1.0)
                phases[2] = 2.0 * bend
                _start(phases, state, lane, amplitude[sweep, scatterer])
            _run(state, n_samples, re, im)
        for lane in range(used):
            for n in range(n_samples):
                out[begin + lane, n] = complex(re[n * LANES + lane], im[n * LANES + lane])
