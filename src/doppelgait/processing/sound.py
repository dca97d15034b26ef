"""Doppler signal of a target as sound."""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import IO, Any, Literal

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import AnalysisError
from doppelgait.core.frames import Frames
from doppelgait.processing.clutter import clean_frames, remove_common_phase
from doppelgait.processing.config import Analysis
from doppelgait.processing.gate import Gate

OVERLAP = 4
"""Number of overlapping frames in the result: squared Hann windows at steps of 1/4 window sum to a constant."""
FRAMES_AT_ONCE = 512
ONSET = 1e-3
"""Share of a line's amplitude one hop later below which the line is an onset and starts with its own phase."""
TINY = float(np.finfo(np.float32).tiny)


def lengthen(values: npt.ArrayLike, factor: float, *, window_samples: int) -> Values:
    """Lengthen a signal without changing its frequencies, of both signs."""
    # the sum over neighbouring bins locks the phases of a line (Puckette 1995)
    signal = np.asarray(values, dtype=np.complex64)
    hop = max(window_samples // OVERLAP, 4)
    size = OVERLAP * hop
    n_out = round(signal.size * factor)
    window = np.hanning(size + 1)[:size].astype(np.float32)
    padded = extend_by_mirroring(signal, size // 2 + hop, size)
    middle = hop / 2 * max(1.0 - 1.0 / factor, -1.0)
    places = np.arange(math.ceil(n_out / hop) + 1) * (hop / factor) + middle
    starts = np.clip(np.round(places).astype(int), 0, signal.size)
    out = np.zeros((starts.size + OVERLAP) * hop, dtype=np.complex64)
    for u, frame in enumerate(_rotate_frames(padded, starts, hop, window)):
        out[u * hop : u * hop + size] += frame * window
    first = size // 2
    return np.asarray(out[first : first + n_out] / np.float32((window**2).sum() / hop))


def _rotate_frames(
    padded: Values, starts: npt.NDArray[np.int64], hop: int, window: npt.NDArray[np.float32]
) -> Iterator[Values]:
    """Yield frames with continuous phases at steps of one hop, before the second window."""
    from scipy import fft

    size = window.size
    offsets = np.arange(size)
    signs = np.where(offsets % 2, np.float32(-1), np.float32(1))  # the phase reference is the middle of the window
    last = np.zeros(size, dtype=np.complex64)
    for first in range(0, starts.size, FRAMES_AT_ONCE):
        places = starts[first : first + FRAMES_AT_ONCE, None] + offsets
        before = _sum_neighbours(fft.fft(padded[places] * window, axis=1) * signs)
        now = fft.fft(padded[places + hop] * window, axis=1) * signs
        known = np.abs(before) > ONSET * np.abs(_sum_neighbours(now))
        made = np.empty_like(now)
        for row in range(now.shape[0]):
            turn = _sum_neighbours(last) * before[row].conj()
            size_of = np.abs(turn)
            last = now[row] * np.where(known[row] & (size_of > 0), turn / np.maximum(size_of, TINY), 1)
            made[row] = last
        yield from fft.ifft(made * signs, axis=1)


def _sum_neighbours(spectrum: Values) -> Values:
    return np.asarray(spectrum + np.roll(spectrum, 1, axis=-1) + np.roll(spectrum, -1, axis=-1))


def extend_by_mirroring(values: Values, before: int, after: int) -> Values:
    """Extend a signal at its ends by mirroring."""
    # time and phase are mirrored, so that tones continue
    return np.concatenate([_mirror(values, before), values, _mirror(values[::-1], after)[::-1]])


def _mirror(values: Values, count: int) -> Values:
    if not values.size:
        return np.zeros(count, dtype=np.complex64)
    turn = np.exp(2j * np.angle(values[0])).astype(np.complex64)
    found = values[1 : count + 1][::-1].conj() * turn
    return np.pad(found, (count - found.size, 0))


Channels = Literal["iq", "sides"]
Values = npt.NDArray[np.complex64]

AUDIO_RATES_HZ = (8000, 16000, 24000, 48000)
"""Rates of a sound file; the lowest rate that covers the Doppler band is used."""
USUAL_PITCH = 4.0
"""Default pitch factor. A walker's torso (60 Hz at 7.29 GHz and 1.2 m/s) is then at 240 Hz.
Small loudspeakers reproduce frequencies above about 200 Hz."""
PITCH_LIMITS = (0.1, 5000.0)
HEADROOM_DB = 1.0  # level of the loudest sample below full scale
FADE_S = 0.005
"""Duration of the fade at both ends of the sound, and at the beginning and end of a track."""
WINDOW_S, WINDOW_PULSES = 0.1, 16
"""Frame length of the pitch shift: the time, or the number of pulses if that takes longer."""
BLOCK_PULSES = 1 << 15
READ_PULSES = 1 << 12  # number of pulses that are read at once, for all range bins
MOST_STEPS = 500  # largest denominator of a rate conversion; the error is at most 4 us per second
HALF_FILTER = 32  # half length of the filter of a rate conversion, in samples of the lower rate
FULL_SCALE = 32767


def compute_doppler_signal(frames: Frames, gate: Gate, analysis: Analysis | None = None) -> Values:
    """Compute the complex Doppler signal of a gated target."""
    # the bins of an echo differ by a phase ramp, which is the same for all echoes (E-17, E-18)
    if reason := explain_silence(frames):
        raise AnalysisError(reason)
    if gate.source == "track":
        frames = remove_common_phase(frames)
    time_s, range_m, settings = frames.slow_time.time_s, frames.range_m, analysis or Analysis()
    low, high = gate.edges(range_m, time_s, sharp=False)
    bins = gate.touched_bins(low, high, range_m)
    clean = clean_frames(frames.take_bins(bins), settings)
    numbers = np.arange(bins.start, bins.start + clean.shape[1])

    def parts() -> Iterator[Values]:
        """Yield blocks of pulses, weighted by the share of each bin."""
        for first in range(0, clean.shape[0], BLOCK_PULSES):
            rows = slice(first, min(first + BLOCK_PULSES, clean.shape[0]))
            read = [clean.read(n, min(n + READ_PULSES, rows.stop)) for n in range(first, rows.stop, READ_PULSES)]
            inside = np.minimum(high[rows, None], numbers + 0.5) - np.maximum(low[rows, None], numbers - 0.5)
            yield np.concatenate(read) * np.clip(inside, 0.0, 1.0).astype(np.float32)

    # a long recording is read twice, because its parts may take as much memory as the whole
    kept = list(parts()) if clean.shape[0] <= BLOCK_PULSES else None
    ramp = sum(complex(np.vdot(part[:, :-1], part[:, 1:])) for part in kept or parts()) if clean.shape[1] > 1 else 0.0
    turn = np.exp(-1j * np.angle(ramp) * np.arange(clean.shape[1]))
    signal = np.concatenate([part @ turn for part in kept or parts()]).astype(np.complex64)
    # 1 within the time of the gate, with a short fade to 0 before and after
    outside_s = np.maximum(np.maximum(gate.start_s - time_s, time_s - gate.stop_s), 0.0)
    present = (0.5 + 0.5 * np.cos(np.pi * np.minimum(outside_s / FADE_S, 1.0))).astype(np.float32)
    return signal * present


def explain_silence(frames: Frames) -> str | None:
    """Return why a recording has no sound, or None; the reason holds for every gate."""
    if frames.slow_time.find_bursts().burst_pulses is not None:
        return "the pulses of this recording come in bursts, with pauses between them: it has no sound"
    return None


def make_doppler_sound(
    frames: Frames,
    gate: Gate,
    analysis: Analysis | None = None,
    *,
    pitch: float | None = None,
    channels: Channels = "iq",
) -> tuple[int, npt.NDArray[np.int16]]:
    """Convert the target in a gate to stereo sound (n, 2), as long as the recording."""
    from scipy.fft import next_fast_len
    from scipy.signal import firwin, hilbert, resample_poly

    signal = compute_doppler_signal(frames, gate, analysis)  # before the rate: the mean rate of bursts means nothing
    prf_hz = frames.slow_time.rate_hz
    factor, rate_hz = plan_sound(prf_hz, pitch)
    ratio = Fraction(rate_hz / (factor * prf_hz)).limit_denominator(MOST_STEPS)
    # rate conversion without images and aliases; 0.9 of the narrower band is unchanged
    up, down = ratio.numerator, ratio.denominator
    most = max(up, down)
    low_pass: Any = firwin(2 * HALF_FILTER * most + 1, 1.0 / most, window=("kaiser", 8.0)) if most > 1 else np.ones(1)
    steps = math.ceil(HALF_FILTER * most / (up * down))  # so many times ``down`` samples count beyond the ends
    made = resample_poly(extend_by_mirroring(signal, steps * down, steps * down), up, down, window=low_pass)
    heard = np.asarray(made[steps * up : made.size - steps * up], dtype=np.complex64)
    if factor != 1.0:
        frame_s = max(WINDOW_S, WINDOW_PULSES / prf_hz)
        heard = lengthen(heard, factor, window_samples=round(frame_s * rate_hz / factor))
    count = round(signal.size / prf_hz * rate_hz)
    heard = np.pad(heard[:count], (0, max(count - heard.size, 0)))
    stereo: npt.NDArray[np.float32] = np.stack([heard.real, heard.imag], axis=1)
    if channels == "sides":  # positive and negative frequencies, Re(z +- j H z) / 2, H of Hilbert
        quarter = hilbert(heard.imag, next_fast_len(heard.size))[: heard.size].imag
        stereo = np.asarray(np.stack([heard.real - quarter, heard.real + quarter], axis=1) / 2, dtype=np.float32)
    fade = min(round(FADE_S * rate_hz), stereo.shape[0] // 2)
    if fade:
        rise = 0.5 - 0.5 * np.cos(np.pi * np.arange(fade, dtype=np.float32) / fade)
        stereo[:fade] *= rise[:, None]
        stereo[-fade:] *= rise[::-1, None]
    peak = float(np.abs(stereo).max(initial=0.0))
    scale = FULL_SCALE * 10 ** (-HEADROOM_DB / 20) / peak if peak > 0 else 0.0
    return rate_hz, np.round(stereo * scale).astype(np.int16)


def plan_sound(prf_hz: float, pitch: float | None = None) -> tuple[float, int]:
    """Choose pitch and audio rate for a frame rate."""
    highest_hz = AUDIO_RATES_HZ[-1]
    most = highest_hz / min(prf_hz, highest_hz)
    factor = min(USUAL_PITCH, most) if pitch is None else pitch
    if not PITCH_LIMITS[0] <= factor <= PITCH_LIMITS[1]:
        raise AnalysisError(f"pitch {factor:g}: must be {PITCH_LIMITS[0]:g} to {PITCH_LIMITS[1]:g}")
    if factor > most * (1 + 1e-9):
        raise AnalysisError(
            f"pitch {factor:g}: Doppler frequencies reach {min(prf_hz, highest_hz) / 2:g} Hz at {prf_hz:g} frames per "
            f"second, and {factor:g} times that exceeds the {highest_hz // 2} Hz of a sound file; use a pitch of at "
            f"most {math.floor(most * 100) / 100:g}"
        )
    return factor, next((rate for rate in AUDIO_RATES_HZ if rate >= factor * prf_hz * (1 - 1e-9)), highest_hz)


def write_wav(file: str | IO[bytes], rate_hz: int, samples: npt.NDArray[np.int16]) -> None:
    """Write a WAV file with 16 bits per sample. Shapes: samples (n, channels)."""
    from scipy.io import wavfile

    wavfile.write(file, rate_hz, samples)
