"""Signatures by formula and the evidence around them: features with known answers."""

from dataclasses import replace

import numpy as np

from doppelgait.core.labels import CADENCE_SPECTRUM, NORMALISED_SIGNATURE, SIGNATURE, Signal, make_array
from doppelgait.features import Extraction, GaitFeatures, Observation
from doppelgait.features.extended import measure_extended
from doppelgait.processing.main_line import find_column_peaks

RATE_HZ, PRF_HZ, WAVELENGTH_M = 125.0, 1000.0, 299_792_458 / 7.29e9
HALF_M = WAVELENGTH_M / 2
T = np.arange(625) / RATE_HZ


def velocities(k):
    return (np.arange(k) - k // 2) * PRF_HZ / k * HALF_M


def signature_of(values, range_m=None):
    k = values.shape[1]
    doppler_hz = velocities(k) / HALF_M
    time_s = np.arange(values.shape[0]) / RATE_HZ
    coords = {
        "time": time_s, "doppler": doppler_hz, "velocity": ("doppler", doppler_hz * HALF_M),
        "centre_range": ("time", np.full(time_s.size, 5.0) if range_m is None else range_m),
    }  # fmt: skip
    attrs = {"n_gate_bins": 16, "wavelength_m": WAVELENGTH_M, "hop": 8, "cpi_pulses": 101, "prf_hz": PRF_HZ}
    return Signal.of(make_array(SIGNATURE, values, coords, attrs), SIGNATURE)


def evidence_of(values, line_mps, *, floor=0.0, spectrum=None, **changes):
    """Evidence around a drawn signature, columns normalised to 1 and not aligned."""
    mu = signature_of(values, changes.pop("range_m", None))
    aligned = (values - floor) / (values - floor).sum(axis=1, keepdims=True)
    cadence_hz = np.arange(0, 20, 0.025)
    power = np.ones(cadence_hz.size) if spectrum is None else spectrum(cadence_hz)
    return Observation(
        signature=mu, floor_v2=floor, main_line_hz=np.broadcast_to(line_mps, T.shape) / HALF_M,
        make_excess=lambda: mu.replace(values - floor),
        aligned=mu.replace(aligned, schema=NORMALISED_SIGNATURE),
        cadence_parts=None, strongest_v2=values.max(axis=1), peaks_hz=find_column_peaks(mu)[1],
        spectrum=mu.with_axes(CADENCE_SPECTRUM, power, cadence=cadence_hz),
        observation_s=values.shape[0] / RATE_HZ, n_independent=83.0,
    )  # fmt: skip


def extraction_of(line_mps, frequency_hz=2.0):
    mean = float(np.mean(line_mps))
    return Extraction(GaitFeatures(torso_velocity_mps=mean), frequency_hz, mean / HALF_M, None)


def with_extraction(observed, extraction):
    """The same signature with other features of the set F."""
    return replace(observed, extraction=extraction)


def extended_of(values, line_mps, frequency_hz=2.0, **changes):
    observed = evidence_of(values, line_mps, **changes)
    return measure_extended(with_extraction(observed, extraction_of(line_mps, frequency_hz)))


def block(low_mps, high_mps, k=1023):
    """Even power between two velocities in every column, cells at the edges in part."""
    v = velocities(k)
    step = v[1] - v[0]
    ends = (np.broadcast_to(x, T.shape)[:, None] for x in (low_mps, high_mps))
    low, high = ends
    return np.clip((high - v) / step + 0.5, 0, 1) * np.clip((v - low) / step + 0.5, 0, 1)


def line_at(velocity_mps, k=1023, width_mps=0.1):
    return np.exp(-0.5 * ((velocities(k) - np.broadcast_to(velocity_mps, T.shape)[:, None]) / width_mps) ** 2)
