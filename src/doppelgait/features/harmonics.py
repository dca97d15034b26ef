"""Harmonic ratios beta_1, beta_2 (E-37) and limb-to-torso ratio rho (E-38)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.labels import CADENCE_MAP, CADENCE_SPECTRUM, Signal, measures_signal
from doppelgait.core.units import FloatArray
from doppelgait.features.doppler import compute_quantile

SEARCH = 0.15
MIN_SNR = 4.0  # smallest ratio (6 dB) of a harmonic to the local median of the power spectrum
NEAR_SHARE, NEAR_HZ = 0.06, 0.25


@measures_signal(CADENCE_SPECTRUM)
def harmonic_ratio(spectrum: Signal, frequency_hz: float, harmonic: int) -> float | None:
    """Compare a harmonic with the fundamental (E-37).

    The ratio is a check of f_mu: it is near ``harmonic`` if f_mu is correct.

    Parameters
    ----------
    spectrum : DataArray (cadence)
        Cadence power spectrum S.
    frequency_hz : float
        f_mu.
    harmonic : int
        2 for beta_1, 3 for beta_2.

    Returns
    -------
    float or None
        None if no local maximum within 15 % of the expected frequency is 6 dB above the local median.

    See Also
    --------
    limb_torso_ratio : ratio of oscillating to constant power.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> round(dg.features.harmonic_ratio(result.cadence_spectrum, result.gait_frequency_hz, 2), 1)
    2.0
    """
    values = np.asarray(spectrum.values, dtype=np.float64)
    return peak_ratio(spectrum.axis("cadence"), values, frequency_hz, harmonic)


def peak_ratio(cadence_hz: FloatArray, values: FloatArray, frequency_hz: float, harmonic: int) -> float | None:
    """Compute :func:`harmonic_ratio` of a spectrum without checking its schema."""
    expected_hz = harmonic * frequency_hz
    first, stop = cadence_hz.searchsorted([expected_hz * (1.0 - SEARCH), expected_hz * (1.0 + SEARCH)]).tolist()
    first, stop = max(first, 1), min(stop, values.size - 1)
    around = values[first - 1 : max(stop, first) + 1].tolist()
    peaks = [n for n in range(1, len(around) - 1) if around[n - 1] < around[n] >= around[n + 1]]
    if not peaks:
        return None
    best = max(peaks, key=around.__getitem__)
    before, highest, after = around[best - 1 : best + 2]
    near = np.abs(cadence_hz - expected_hz) <= frequency_hz / 2.0
    if highest < MIN_SNR * compute_quantile(values[near], 0.5):
        return None
    bend = before - 2.0 * highest + after
    offset = 0.5 * (before - after) / bend if bend < 0 else 0.0
    return float((first - 1 + best + offset) * (cadence_hz[1] - cadence_hz[0])) / frequency_hz


@dataclass(frozen=True)
class LimbTorsoRatio:
    """Limb-to-torso ratio in energy, ``ratio``, and in amplitude, as in the report."""

    ratio: float | None
    amplitude_ratio: float | None


@measures_signal(CADENCE_MAP)
def limb_torso_ratio(
    step_doppler: Signal, mean_spectrum: FloatArray, frequency_hz: float, occupied: npt.NDArray[np.bool_]
) -> LimbTorsoRatio:
    """Compute the ratio of oscillating to constant Doppler power (E-38).

    Numerator and denominator use the same rows.

    Parameters
    ----------
    step_doppler : DataArray (cadence, doppler)
        D of the detrended normalised signature.
    mean_spectrum : ndarray, shape (K,)
        Time mean of the same signature before detrending.
    frequency_hz : float
        f_mu.
    occupied : ndarray of bool, shape (K,)
        Rows K+ above the noise.

    Returns
    -------
    LimbTorsoRatio
        Both forms are None if no row is occupied.

    See Also
    --------
    harmonic_ratio : compare a harmonic of the cadence spectrum with the fundamental.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> from doppelgait.pipeline.target import observe
    >>> observed = observe(result.signature, result.analysis)
    >>> found = dg.features.limb_torso_ratio(
    ...     result.cadence_map, observed.mean_row, result.gait_frequency_hz, observed.occupied
    ... )
    >>> round(found.ratio, 1)
    1.1
    """
    values = np.ascontiguousarray(step_doppler.values[:, occupied])
    return ratio_of_rows(step_doppler.axis("cadence"), values, mean_spectrum[occupied], frequency_hz)


def highest_cadence_hz(frequency_hz: float) -> float:
    """Return the highest cadence that :func:`ratio_of_rows` uses."""
    return 4.0 * frequency_hz + NEAR_HZ


def ratio_of_rows(cadence_hz: FloatArray, values: FloatArray, base: FloatArray, frequency_hz: float) -> LimbTorsoRatio:
    """Compute :func:`limb_torso_ratio` of D in the rows K+ alone."""
    # Shapes: cadence_hz (Q,); values (Q, K+); base (K+,)
    if not base.size or base.sum() <= 0:
        return LimbTorsoRatio(None, None)
    found = np.empty(2)
    native.oscillating_power(cadence_hz, values, float(frequency_hz), NEAR_SHARE, NEAR_HZ, found)
    energy, amplitude = found.tolist()
    return LimbTorsoRatio(math.sqrt(4.0 * energy / float(base @ base)), amplitude / float(base.sum()))
