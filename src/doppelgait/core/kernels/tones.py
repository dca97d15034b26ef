"""Sums of complex tones with quadratic phase, for frequency-swept radars."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

LANES = 16
"""Sweeps side by side in the inner loop."""
GROUP = 2
"""Samples that the inner loop makes of every lane."""

Z_RE, Z_IM, W_RE, W_IM, Q_RE, Q_IM = 0, LANES, 2 * LANES, 3 * LANES, 4 * LANES, 5 * LANES
"""Places of the tone, its step and the step's step in the buffer, each for all lanes."""

S = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(1, 9))
C = tuple((-1.0) ** k / math.factorial(2 * k) for k in range(1, 9))
"""Coefficients of the series of sine and cosine from the second on."""

Float64Array = npt.NDArray[np.float64]


@kernel(fastmath=("contract",), apart=True)
def _start(phases, amplitudes, state):  # type: ignore[no-untyped-def]
    """Set tone, step and the step's step of all lanes.
    They are numbers of turns, reduced to an eighth; there the series of sine and cosine end below 1e-16.
    """
    for part in range(3):
        for lane in range(LANES):
            turns = phases[part * LANES + lane]
            quarter = np.rint(4.0 * turns)
            x = 2.0 * math.pi * (turns - 0.25 * quarter)
            s = x * x
            sin = S[5] + s * (S[6] + s * S[7])
            sin = x + x * s * (S[0] + s * (S[1] + s * (S[2] + s * (S[3] + s * (S[4] + s * sin)))))
            cos = C[5] + s * (C[6] + s * C[7])
            cos = 1.0 + s * (C[0] + s * (C[1] + s * (C[2] + s * (C[3] + s * (C[4] + s * cos)))))
            left = quarter - 4.0 * np.floor(0.25 * quarter)  # 0 to 3 quarters
            swap = left == 1.0 or left == 3.0
            re = sin if swap else cos
            im = cos if swap else sin
            size = amplitudes[lane] if part == 0 else 1.0
            state[2 * part * LANES + lane] = -size * re if left == 1.0 or left == 2.0 else size * re
            state[(2 * part + 1) * LANES + lane] = -size * im if left >= 2.0 else size * im


@kernel(fastmath=("contract",), apart=True)
def _run(state, n_samples, re, im):  # type: ignore[no-untyped-def]
    """Add one tone in all lanes to the sums.
    Sample by sample: z <- z w, w <- w q. The state of a lane stays in registers for GROUP samples.
    """
    for first in range(0, n_samples, GROUP):
        row = first * LANES
        for lane in range(LANES):
            z_re, z_im = state[Z_RE + lane], state[Z_IM + lane]
            w_re, w_im = state[W_RE + lane], state[W_IM + lane]
            q_re, q_im = state[Q_RE + lane], state[Q_IM + lane]
            for n in range(GROUP):
                at = np.uint64(row + n * LANES + lane)
                re[at] += z_re
                im[at] += z_im
                z_re, z_im = z_re * w_re - z_im * w_im, z_re * w_im + z_im * w_re
                w_re, w_im = w_re * q_re - w_im * q_im, w_re * q_im + w_im * q_re
            state[Z_RE + lane], state[Z_IM + lane] = z_re, z_im
            state[W_RE + lane], state[W_IM + lane] = w_re, w_im


@kernel()
def add_tones(
    amplitude: Float64Array,
    turns: Float64Array,
    turns_per_sample: Float64Array,
    turns_per_sample2: Float64Array,
    out: npt.NDArray[np.complex64],
) -> None:
    r"""Write the sum of all tones into every sweep.
    Shapes: amplitude (I, L); turns, turns_per_sample, turns_per_sample2 (I, L); out (I, S).
    """
    n_sweeps, n_samples = out.shape
    first = -0.5 * (n_samples - 1)
    n_made = -(-n_samples // GROUP) * GROUP
    re = np.empty(n_made * LANES)
    im = np.empty(n_made * LANES)
    state = np.zeros(6 * LANES)
    phases = np.zeros(3 * LANES)
    amplitudes = np.zeros(LANES)
    for begin in range(0, n_sweeps, LANES):
        used = min(LANES, n_sweeps - begin)
        re[:] = 0.0
        im[:] = 0.0
        for scatterer in range(amplitude.shape[1]):
            for lane in range(used):
                sweep = begin + lane
                slope, bend = turns_per_sample[sweep, scatterer], turns_per_sample2[sweep, scatterer]
                phases[lane] = turns[sweep, scatterer] + first * (slope + bend * first)
                phases[LANES + lane] = slope + bend * (2.0 * first + 1.0)
                phases[2 * LANES + lane] = 2.0 * bend
                amplitudes[lane] = amplitude[sweep, scatterer]
            _start(phases, amplitudes, state)
            _run(state, n_made, re, im)
        for lane in range(used):
            for n in range(n_samples):
                out[begin + lane, n] = complex(re[n * LANES + lane], im[n * LANES + lane])
