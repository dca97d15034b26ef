"""Level images of the X-band recordings: display and measures.

A level image has 256 rows of velocity, row 0 at +4.6 m/s and row 128 at 0, and 624 columns of time, in dB below its own
maximum, clipped to -30 and -10 dB. The display is that of the source (github.com/AmishaManga/MSc-Micro-Doppler-
Classification): 20 bursts of 256 sweeps, of each burst the mean over its sweeps taken off and one range bin kept, all
joined and transformed with a Hann window of 128 sweeps every 8 sweeps to 256 bins.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from harness import FloatArray

N_BURSTS, BURST_SWEEPS = 20, 256
WINDOW_SWEEPS, HOP_SWEEPS, N_ROWS = 128, 8, 256
N_SWEEPS = N_BURSTS * BURST_SWEEPS
N_COLUMNS = N_SWEEPS // HOP_SWEEPS - WINDOW_SWEEPS // HOP_SWEEPS
FLOOR_DB, CEILING_DB = -30.0, -10.0
LOBE_DB_PER_CELL2 = 6.0  # fall of a line per squared distance in cells: 3 dB at 0.72 with a Hann window
EDGE_MPS = 4.6
PRI_S = 1.68e-3
"""With a wavelength of 30.9 mm (9.7 GHz) the sweep interval at which the display ends at 4.6 m/s."""
VELOCITY_MPS = np.asarray((N_ROWS // 2 - np.arange(N_ROWS)) * (2.0 * EDGE_MPS / N_ROWS), dtype=np.float64)
SLOWEST_MPS = 0.4
"""Nearer to zero than this is the ground."""
QUIET_MPS = (0.8, 3.4)
"""Speeds on the far side of zero at which nothing but noise is expected."""


def read_levels(path: Path, keys: Iterable[str] | None = None) -> dict[str, FloatArray]:
    """Read the levels of images in dB by key."""
    if not path.is_file():
        sys.exit(f"{path}: not there; give the folder that holds {path.name}, see the head of the study")
    with np.load(path) as levels:
        wanted = levels.files if keys is None else list(keys)
        missing = [key for key in wanted if key not in levels]
        if missing:
            sys.exit(f"{path}: has no {', '.join(missing)}; this study needs them all")
        return {key: FLOOR_DB + levels[key] * ((CEILING_DB - FLOOR_DB) / 255.0) for key in wanted}


def hann(n_samples: int) -> FloatArray:
    """Return a Hann window without zeros at its ends, of sum 1."""
    window = np.sin(np.pi * (np.arange(n_samples) + 1.0) / (n_samples + 1.0)) ** 2
    return np.asarray(window / window.sum())


def noise_gain() -> float:
    """Return the noise gain from a range bin to a pixel."""
    return float((hann(WINDOW_SWEEPS) ** 2).sum())


def stitched(baseband: npt.NDArray[np.complexfloating[Any, Any]], bins: npt.ArrayLike) -> npt.NDArray[np.complex128]:
    """Concatenate one range bin per burst without the means of the bursts."""
    bursts = np.asarray(baseband, dtype=np.complex128)[:N_SWEEPS].reshape(N_BURSTS, BURST_SWEEPS, -1)
    kept = bursts[np.arange(N_BURSTS), :, np.asarray(bins)]
    return np.asarray((kept - kept.mean(axis=1, keepdims=True)).ravel())


def pixel_power(signal: npt.NDArray[np.complex128]) -> FloatArray:
    """Return the power of every pixel, V^2, shape (256, 624). Approaching, at positive frequency, is above."""
    starts = HOP_SWEEPS * np.arange(N_COLUMNS)
    blocks = signal[starts[:, None] + np.arange(WINDOW_SWEEPS)] * hann(WINDOW_SWEEPS)
    power = np.abs(np.fft.fft(blocks, N_ROWS, axis=1)) ** 2
    return np.asarray(power[:, (N_ROWS // 2 - np.arange(N_ROWS)) % N_ROWS].T)


def displayed_db(power: FloatArray) -> FloatArray:
    """Return levels relative to the maximum, dB, clipped as displayed."""
    level_db = 10.0 * np.log10(np.maximum(power / power.max(), 1e-30))
    return np.asarray(np.clip(level_db, FLOOR_DB, CEILING_DB))


def noise_db(level_db: FloatArray) -> float:
    """Estimate the mean noise of a pixel, dB.

    From the share p of quiet pixels above the floor. Power of noise is exponentially distributed, so that p = exp(-F /
    N) with floor F and mean N: N = F / ln(1 / p).
    """
    quiet = (QUIET_MPS[0] < -VELOCITY_MPS) & (QUIET_MPS[1] > -VELOCITY_MPS)
    share = float((level_db[quiet] > FLOOR_DB + 0.5 * (CEILING_DB - FLOOR_DB) / 255).mean())
    share = min(max(share, 1e-5), 1.0 - 1e-5)
    return FLOOR_DB - 10.0 * float(np.log10(-np.log(share)))


def rebuild_peaks(level_db: FloatArray, highest_db: float) -> FloatArray:
    """Rebuild clipped peaks as parabolas through both edges of a run of rows, (time, doppler)."""
    clipped, numbers = level_db >= CEILING_DB, np.arange(level_db.shape[1])
    below = np.maximum.accumulate(np.where(clipped, -1, numbers), axis=1) + 0.5
    above = np.minimum.accumulate(np.where(clipped, numbers.size, numbers)[:, ::-1], axis=1)[:, ::-1] - 0.5
    half = np.where(clipped, (above - below) / 2.0, 1.0)
    curvature_db = LOBE_DB_PER_CELL2 / (N_ROWS / WINDOW_SWEEPS) ** 2
    dome = (numbers - below) * (above - numbers) * np.minimum(curvature_db, (highest_db - CEILING_DB) / half**2)
    return np.asarray(np.clip(level_db, FLOOR_DB, CEILING_DB) + np.where(clipped, dome, 0.0))
