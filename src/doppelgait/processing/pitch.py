"""Every frequency of a complex signal times a factor, its duration kept: a phase vocoder for both signs."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.complex64]

OVERLAP = 4
"""Frames that overlap in the result: Hann windows squared, a quarter apart, sum to a constant."""
FRAMES_AT_ONCE = 512
ONSET = 1e-3
"""A line whose amplitude was below this share of what it is one hop later begins: it starts with its own phase."""
TINY = float(np.finfo(np.float32).tiny)


def stretched(values: npt.ArrayLike, factor: float, *, window_samples: int) -> Values:
    r"""The signal with the same frequencies and ``factor`` times as many samples.

    Played ``factor`` times as fast, it lasts as long as before and every frequency is ``factor`` times as high.
    Frame u of the result is the short-time spectrum X at the input's sample :math:`u H / P`, H the hop of the result
    and P the factor, turned by what the phase gains over one hop:

    .. math:: Y_u = X_u \frac{Z}{|Z|}, \qquad Z = \mathcal{L}(Y_{u-1}) \, \overline{\mathcal{L}(X'_u)}

    where :math:`X'_u` is the input's spectrum one hop H before :math:`X_u`; the pair lies so that the frequency
    measured between them is that of the middle of the hop. No phase is unwrapped, hence no limit on the hop, and no
    symmetry of the spectrum is used, hence both signs of frequency. :math:`\mathcal{L}` sums each bin and its two
    neighbours, which ties the bins of one line together (Puckette 1995, "Phase-locked vocoder").

    Parameters
    ----------
    values : array_like, shape (n,)
        Complex or real.
    factor : float
        P, above 0.
    window_samples : int
        Length of the Hann window, 16 at least: motion is resolved to this time, and lines to its inverse.

    Returns
    -------
    ndarray of complex64, shape (round(n factor),)
    """
    signal = np.asarray(values, dtype=np.complex64)
    hop = max(window_samples // OVERLAP, 4)
    size = OVERLAP * hop
    n_out = round(signal.size * factor)
    window = np.hanning(size + 1)[:size].astype(np.float32)
    padded = continued(signal, size // 2 + hop, size)
    middle = hop / 2 * max(1.0 - 1.0 / factor, -1.0)
    places = np.arange(math.ceil(n_out / hop) + 1) * (hop / factor) + middle
    starts = np.clip(np.round(places).astype(int), 0, signal.size)
    out = np.zeros((starts.size + OVERLAP) * hop, dtype=np.complex64)
    for u, frame in enumerate(_turned(padded, starts, hop, window)):
        out[u * hop : u * hop + size] += frame * window
    first = size // 2
    return np.asarray(out[first : first + n_out] / np.float32((window**2).sum() / hop))


def _turned(
    padded: Values, starts: npt.NDArray[np.int64], hop: int, window: npt.NDArray[np.float32]
) -> Iterator[Values]:
    """Frames of the result, one hop apart, before the second window."""
    from scipy import fft

    size = window.size
    signs = np.where(
        np.arange(size) % 2, np.float32(-1), np.float32(1)
    )  # phases from the window's middle, not its start
    offsets = np.arange(size)
    last = np.zeros(size, dtype=np.complex64)
    for first in range(0, starts.size, FRAMES_AT_ONCE):
        places = starts[first : first + FRAMES_AT_ONCE, None] + offsets
        before = _tied(fft.fft(padded[places] * window, axis=1) * signs)
        now = fft.fft(padded[places + hop] * window, axis=1) * signs
        known = np.abs(before) > ONSET * np.abs(_tied(now))
        made = np.empty_like(now)
        for row in range(now.shape[0]):
            turn = _tied(last) * before[row].conj()
            size_of = np.abs(turn)
            last = now[row] * np.where(known[row] & (size_of > 0), turn / np.maximum(size_of, TINY), 1)
            made[row] = last
        yield from fft.ifft(made * signs, axis=1)


def _tied(spectrum: Values) -> Values:
    return np.asarray(spectrum + np.roll(spectrum, 1, axis=-1) + np.roll(spectrum, -1, axis=-1))


def continued(values: Values, before: int, after: int) -> Values:
    """Signal with so many samples more at its ends as if it went on: mirrored in time and phase, so that tones do."""
    return np.concatenate([_mirrored(values, before), values, _mirrored(values[::-1], after)[::-1]])


def _mirrored(values: Values, count: int) -> Values:
    if not values.size:
        return np.zeros(count, dtype=np.complex64)
    turn = np.exp(2j * np.angle(values[0])).astype(np.complex64)
    found = values[1 : count + 1][::-1].conj() * turn
    return np.pad(found, (count - found.size, 0))
