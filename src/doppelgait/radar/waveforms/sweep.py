r"""Frequency-swept radars: de-chirped FMCW and stepped frequency.

Both see the scatterers through the phase of a reference at the frequency :math:`f_c + S u`, with u the time from the
sweep's middle: R(u) = R - v u is the range then (the table's range belongs to the middle), t_d = 2 R(u) / c its delay.

.. math::

   b(u) = \sum_l a\, e^{j(\theta + \phi)}\, e^{-2 \pi j (f_c t_d + S u t_d - \epsilon S t_d^2 / 2)}

with epsilon = 1 for FMCW, where the echo started its sweep earlier, and 0 for stepped frequency, where echo and
reference have one frequency. (The usual b* of text books, conjugated so that approaching is positive Doppler.) A moving
scatterer thus shows at R - f_c v T_c / B: the Doppler shift passes for a part of the beat. An echo beyond the
unambiguous range folds: no anti-alias filter is modelled. The samples are complex (I and Q); a receiver with one
real channel has half the unambiguous range.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.radar.config import Radar
from doppelgait.radar.link import path_phase_rad, radial_velocity_mps, scatterer_arrays
from doppelgait.radar.waveforms.protocol import Samples, Waveform, check_band, check_sweep_fits
from doppelgait.radar.waveforms.windows import half_power_bins, independent_share, noise_ratio, range_window

MAX_SAMPLES = 65_536
ROWS = 2048
"""Sweeps compressed at a time, which bounds the memory of the transform."""


def n_samples(radar: Radar) -> int:
    """Receiver samples S of one sweep: sweep duration times sampling rate, rounded."""
    return round(float(radar.sweep_s or 0.0) * radar.sample_rate_hz)


def duration_s(radar: Radar) -> float:
    """Time T_c that the samples of one sweep take: S / f_s."""
    return n_samples(radar) / radar.sample_rate_hz


def slope_hz_per_s(radar: Radar) -> float:
    """Sweep slope: the bandwidth over the time in which the samples are taken."""
    return float(radar.bandwidth_hz or 0.0) / duration_s(radar)


def bin_spacing_m(radar: Radar) -> float:
    """Spacing of the range bins, c / (2 B): one per sample, without zero padding."""
    return SPEED_OF_LIGHT_MPS / (2.0 * float(radar.bandwidth_hz or math.nan))


def _first_bin(radar: Radar) -> int:
    return math.ceil(radar.range_start_m / bin_spacing_m(radar) - 1e-9)


def first_bin_m(radar: Radar) -> float:
    """Range of the first bin of the transform inside the frame."""
    return _first_bin(radar) * bin_spacing_m(radar)


def n_range_bins(radar: Radar) -> int:
    """Bins of the transform from range_start_m to below range_stop_m."""
    return math.ceil(radar.range_stop_m / bin_spacing_m(radar) - 1e-9) - _first_bin(radar)


def unambiguous_range_m(radar: Radar) -> float:
    """Range whose beat goes round once from sample to sample: f_s c / (2 S) = S_samples c / (2 B)."""
    return n_samples(radar) * bin_spacing_m(radar)


def check_sweep(radar: Radar) -> None:
    """Refuse a sweep of too few or too many samples, that overlaps the next, or a frame beyond the folding range."""
    if not 2 <= n_samples(radar) <= MAX_SAMPLES:
        raise ValueError(
            f"sweep_s {radar.sweep_s} at sample_rate_hz {radar.sample_rate_hz:g} makes {n_samples(radar):,} samples; "
            f"2 to {MAX_SAMPLES:,} are allowed"
        )
    check_sweep_fits(radar, duration_s(radar))
    check_band(radar, float(radar.bandwidth_hz or 0.0))
    farthest_m = unambiguous_range_m(radar)
    if radar.range_stop_m > farthest_m * (1.0 + 1e-9):
        raise ValueError(
            f"range_stop_m {radar.range_stop_m:g} lies beyond the unambiguous range of {n_samples(radar)} samples "
            f"over {radar.bandwidth_hz:g} Hz, {farthest_m:.6g} m; lower it, raise sample_rate_hz or lower bandwidth_hz"
        )


def synthesise_fmcw(scatterers: xr.Dataset, radar: Radar) -> Samples:
    """De-chirped samples of every sweep, with the motion within it and the residual video phase."""
    return _synthesise(scatterers, radar, lag=1.0)


def synthesise_stepped(scatterers: xr.Dataset, radar: Radar) -> Samples:
    """Frequency response at every step, with the motion from step to step."""
    return _synthesise(scatterers, radar, lag=0.0)


def _synthesise(scatterers: xr.Dataset, radar: Radar, *, lag: float) -> Samples:
    """Samples of a sweep; ``lag`` is the epsilon of the module's equation.

    With t_d = t_0 - beta u, beta = 2 v / c, the phase is the quadratic in u whose coefficients stand here.
    """
    from doppelgait.core.kernels.tones import add_tones

    range_m, amplitude_v = scatterer_arrays(scatterers, radar)
    delay_s = range_m * (2.0 / SPEED_OF_LIGHT_MPS)
    beta = radial_velocity_mps(scatterers) * (2.0 / SPEED_OF_LIGHT_MPS)
    slope, step_s = slope_hz_per_s(radar), 1.0 / radar.sample_rate_hz
    turns = radar.transmit_phase_rad / (2.0 * math.pi) - delay_s * (radar.carrier_hz - 0.5 * lag * slope * delay_s)
    phase_rad = path_phase_rad(scatterers)
    if phase_rad is not None:
        turns += phase_rad / (2.0 * math.pi)
    linear = step_s * (radar.carrier_hz * beta - slope * delay_s * (1.0 + lag * beta))
    bend = step_s**2 * slope * beta * (1.0 + 0.5 * lag * beta)
    out = np.empty((range_m.shape[0], n_samples(radar)), dtype=np.complex64)
    add_tones(amplitude_v, turns, linear, bend, out)
    return out


def compress_fmcw(samples: npt.NDArray[Any], radar: Radar) -> Samples:
    r"""Range bins of de-chirped samples, without the residual video phase.

    The transform's bins are turned by exp(-j pi S t_k^2), t_k the delay of the bin's middle, which removes the
    residual video phase of a scatterer there. Of one half a bin beside it at most pi t_d / T_c remains: 0.008 rad at
    10 m and a sweep of 25 us, the same for every sweep in which it stays in that bin.
    """
    return _compress(samples, radar, lag=1.0)


def compress_stepped(samples: npt.NDArray[Any], radar: Radar) -> Samples:
    """Range bins of a stepped-frequency response."""
    return _compress(samples, radar, lag=0.0)


def _compress(samples: npt.NDArray[Any], radar: Radar, *, lag: float) -> Samples:
    """Window and inverse transform, divided by the window's sum and referred to the sweep's middle."""
    from scipy.fft import ifft

    size = n_samples(radar)
    window = range_window(radar.range_window, size)
    weights = (window * (size / window.sum())).astype(np.float32)
    bins = _first_bin(radar) + np.arange(n_range_bins(radar))
    delay_s = bins / float(radar.bandwidth_hz or math.nan)
    turns = -0.5 * bins * (size - 1) / size - 0.5 * lag * slope_hz_per_s(radar) * delay_s**2
    turn = np.exp(2j * np.pi * np.mod(turns, 1.0)).astype(np.complex64)
    out = np.empty((samples.shape[0], bins.size), dtype=np.complex64)
    for begin in range(0, samples.shape[0], ROWS):
        block = np.asarray(samples[begin : begin + ROWS], dtype=np.complex64) * weights
        out[begin : begin + ROWS] = ifft(block, axis=1, overwrite_x=True)[:, bins[0] : bins[0] + bins.size] * turn
    return out


def resolution_m(radar: Radar) -> float:
    """Half-power width of an echo: 0.886 (no window) to 1.64 (Blackman) times c / (2 B)."""
    return half_power_bins(radar.range_window, n_samples(radar)) * bin_spacing_m(radar)


def noise_bandwidth_hz(radar: Radar) -> float:
    """Noise bandwidth of a complex sample: the sampling rate, the noise being white up to it."""
    return radar.sample_rate_hz


def noise_gain(radar: Radar) -> float:
    """Noise power in a bin over that in a sample: sum(w^2) / sum(w)^2; neighbouring bins share noise by the window."""
    return noise_ratio(radar.range_window, n_samples(radar))


def independent_bins(radar: Radar) -> float:
    """Independent noise values per range bin."""
    return independent_share(radar.range_window, n_samples(radar))


def coupling_s(radar: Radar) -> float:
    """Range shift per velocity by range-Doppler coupling of a rising sweep: -f_c T_c / B."""
    return -radar.carrier_hz / slope_hz_per_s(radar)


def figures(radar: Radar) -> dict[str, float]:
    """Slope, samples and range shift of 1 m/s."""
    return {
        "n_samples": n_samples(radar),
        "sweep_slope_hz_per_s": slope_hz_per_s(radar),
        "coupling_shift_at_1mps_m": coupling_s(radar),
    }


FMCW = Waveform(
    check=check_sweep,
    n_samples=n_samples,
    n_range_bins=n_range_bins,
    first_bin_m=first_bin_m,
    bin_spacing_m=bin_spacing_m,
    synthesise=synthesise_fmcw,
    compress=compress_fmcw,
    resolution_m=resolution_m,
    noise_bandwidth_hz=noise_bandwidth_hz,
    noise_gain=noise_gain,
    unambiguous_range_m=unambiguous_range_m,
    coupling_s=coupling_s,
    figures=figures,
    independent_bins=independent_bins,
    folds=True,
    needs=("bandwidth_hz", "sweep_s"),
    takes=("range_window",),
)

STEPPED = Waveform(
    check=check_sweep,
    n_samples=n_samples,
    n_range_bins=n_range_bins,
    first_bin_m=first_bin_m,
    bin_spacing_m=bin_spacing_m,
    synthesise=synthesise_stepped,
    compress=compress_stepped,
    resolution_m=resolution_m,
    noise_bandwidth_hz=noise_bandwidth_hz,
    noise_gain=noise_gain,
    unambiguous_range_m=unambiguous_range_m,
    coupling_s=coupling_s,
    figures=figures,
    independent_bins=independent_bins,
    folds=True,
    needs=("bandwidth_hz", "sweep_s"),
    takes=("range_window", "noise_bandwidth_hz"),
)
