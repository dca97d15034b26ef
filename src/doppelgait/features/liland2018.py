"""Feature extraction of the report (section 4.5), for comparison.

The code follows the text of the report wherever the report is unambiguous.
"""

from __future__ import annotations

import numpy as np

from doppelgait.core.labels import Signal
from doppelgait.core.units import FloatArray, doppler_to_velocity_mps
from doppelgait.features.feature_set import Extraction, GaitFeatures

HARMONIC_WINDOW = 0.2
"""Relative half width of the search for a harmonic; the report specifies only "close to where it is expected"."""


def bandwidth_hz(mean_spectrum: FloatArray, doppler_hz: FloatArray, threshold: float) -> float:
    """Compute B_mu from the mean Doppler spectrum."""
    # B_mu is the span from the first to the last Doppler at which D_1 / max(D_1) reaches the threshold
    above = np.flatnonzero(mean_spectrum >= threshold * mean_spectrum.max())
    return float(doppler_hz[above[-1]] - doppler_hz[above[0]])


def extract(
    mean_spectrum: FloatArray, doppler_hz: FloatArray, spectrum: Signal, *, wavelength_m: float, threshold: float
) -> Extraction:
    """Extract the six features by the report's method, from mean_spectrum and doppler_hz (K,)."""
    best = int(mean_spectrum.argmax())
    torso_hz, torso_amplitude = float(doppler_hz[best]), float(mean_spectrum[best])
    velocity_mps = float(doppler_to_velocity_mps(torso_hz, wavelength_m))
    width_hz = bandwidth_hz(mean_spectrum, doppler_hz, threshold)
    quality = {"torso_amplitude": torso_amplitude}
    fundamental = _find_highest(spectrum, 0.0, np.inf)
    if fundamental is None:
        features = GaitFeatures(torso_velocity_mps=velocity_mps, doppler_bandwidth_hz=width_hz)
        return Extraction(features, None, torso_hz, None, quality, ("gait_frequency:no_peak_in_the_cadence_spectrum",))
    step_hz, amplitude = fundamental
    harmonics = [
        _find_highest(spectrum, h * step_hz * (1 - HARMONIC_WINDOW), h * step_hz * (1 + HARMONIC_WINDOW))
        for h in (2, 3)
    ]
    complete = all(h is not None for h in harmonics)
    total = amplitude + sum(h[1] for h in harmonics if h is not None)
    features = GaitFeatures(
        torso_velocity_mps=velocity_mps,
        doppler_bandwidth_hz=width_hz,
        step_length_m=velocity_mps / step_hz,
        harmonic_ratio_2=harmonics[0][0] / step_hz if harmonics[0] else None,
        harmonic_ratio_3=harmonics[1][0] / step_hz if harmonics[1] else None,
        limb_torso_ratio=total / torso_amplitude if complete else None,
    )
    seconds = 1.0 / float(spectrum.axis("cadence")[1])
    flags = () if complete else ("harmonics:no_peak_near_the_expected_place",)
    return Extraction(features, step_hz, torso_hz, step_hz * seconds, {**quality, "observation_s": seconds}, flags)


def _find_highest(spectrum: Signal, low_hz: float, high_hz: float) -> tuple[float, float] | None:
    cadence_hz = spectrum.axis("cadence")
    values = np.asarray(spectrum.values, dtype=np.float64)
    # local maxima, without the ends
    peaks = np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:])) + 1
    peaks = peaks[(cadence_hz[peaks] >= low_hz) & (cadence_hz[peaks] <= high_hz)]
    if not peaks.size:
        return None
    best = int(peaks[np.argmax(values[peaks])])
    return float(cadence_hz[best]), float(values[best])
