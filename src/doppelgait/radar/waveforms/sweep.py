r"""Frequency-swept radars: de-chirped FMCW and stepped frequency.

Both measure the phase relative to a reference at the frequency :math:`f_c + S u`, with the time u from the middle of
the sweep: R(u) = R - v u is the range at u (the table has the range at the middle), and t_d = 2 R(u) / c its delay.

.. math::

   b(u) = \sum_l a\, e^{j(\theta + \phi)}\, e^{-2 \pi j (f_c t_d + S u t_d - \epsilon S t_d^2 / 2)}

with epsilon = 1 for FMCW, where the sweep of the echo started earlier, and 0 for stepped frequency, where echo and
reference have the same frequency. (It is the conjugate of the usual textbook signal, so that approaching is positive
Doppler.) A moving scatterer appears at R - f_c v T_c / B, because its Doppler shift adds to the beat frequency. An echo
beyond the unambiguous range folds: no anti-alias filter is modelled. The samples are complex (I and Q); a receiver with
one real channel has half the unambiguous range.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.labels import AnyTable
from doppelgait.core.plugins import plugin
from doppelgait.core.samples import Matrix
from doppelgait.core.units import SPEED_OF_LIGHT_MPS, modified_bessel
from doppelgait.radar.link import compute_echoes, radial_velocity_mps
from doppelgait.radar.parameters import Radar, Waveform, check_band, check_sweep_fits
from doppelgait.radar.waveforms.pulses import VECTOR

MAX_SAMPLES = 65_536
ROWS = 2048
"""Number of sweeps per block of the transform, which limits its memory."""
LONGEST_RESPONSE = 4096
"""Maximum sum of samples and range bins of sweeps that are synthesised without their samples."""
LARGEST_BEND = 0.05
"""Maximum phase by motion, rad, from a sweep's middle to its ends, without samples; the error,
which grows with its fourth power, is then 6.4e-7 of the sum of amplitudes."""
ORDERS = 8
"""Terms of the power series by which a scatterer is moved and bent between the places of the table of taps."""
PLACES = 16
"""Places of that table within half a range bin."""
TAPS = 8
"""Half bins that a scatterer is spread over."""
KAISER_BETA = 0.75 * math.pi * TAPS
ROW = 24
"""Values in a row of the table; its taps begin at the eighth."""
COSINES = {
    "none": (1.0,),
    "hann": (0.5, 0.5),
    "hamming": (0.54, 0.46),
    "blackman": (0.42, 0.5, 0.08),
}
"""Coefficients of the cosine sums (Harris 1978, DOI 10.1109/PROC.1978.10837, table 1)."""


class _Sweep(Waveform):
    """A frequency sweep per frame, transformed to range; ``lag`` is the equation's epsilon."""

    needs: ClassVar[tuple[str, ...]] = ("bandwidth_hz", "sweep_s")
    lag: ClassVar[float]

    def check(self, radar: Radar) -> None:
        if not 2 <= self.n_samples(radar) <= MAX_SAMPLES:
            raise ValueError(
                f"sweep_s {radar.sweep_s} at sample_rate_hz {radar.sample_rate_hz:g} makes {self.n_samples(radar):,} "
                f"samples; 2 to {MAX_SAMPLES:,} are allowed"
            )
        check_sweep_fits(radar, self.n_samples(radar) / radar.sample_rate_hz)
        check_band(radar, float(radar.bandwidth_hz or 0.0))
        farthest_m = self.unambiguous_range_m(radar)
        if radar.range_stop_m > farthest_m * (1.0 + 1e-9):
            raise ValueError(
                f"range_stop_m {radar.range_stop_m:g} lies beyond the unambiguous range of {self.n_samples(radar)} "
                f"samples over {radar.bandwidth_hz:g} Hz, {farthest_m:.6g} m; lower it, raise sample_rate_hz or lower "
                "bandwidth_hz"
            )

    def synthesise(self, scatterers: AnyTable, radar: Radar) -> Matrix:
        """Synthesise sweeps with their motion and FMCW's residual video phase.
        With t_d = t_0 - beta u, beta = 2 v / c, the phase is a quadratic function of u.
        """
        range_m, amplitude_v, phase_rad = compute_echoes(scatterers, radar)
        delay_s = range_m * (2.0 / SPEED_OF_LIGHT_MPS)
        beta = radial_velocity_mps(scatterers) * (2.0 / SPEED_OF_LIGHT_MPS)
        slope, step_s = _slope_hz_per_s(radar), 1.0 / radar.sample_rate_hz
        frequency_hz = radar.carrier_hz - 0.5 * self.lag * slope * delay_s
        turns = radar.transmit_phase_rad / (2.0 * math.pi) - delay_s * frequency_hz
        if phase_rad is not None:
            turns += phase_rad / (2.0 * math.pi)
        linear = step_s * (radar.carrier_hz * beta - slope * delay_s * (1.0 + self.lag * beta))
        bend = step_s**2 * slope * beta * (1.0 + 0.5 * self.lag * beta)
        out = np.empty((range_m.shape[0], self.n_samples(radar)), dtype=np.complex64)
        native.add_tones(amplitude_v, turns, linear, bend, out)
        return out

    def synthesise_bins(self, scatterers: AnyTable, radar: Radar) -> Matrix:
        """Synthesise range bins without the samples, to 1e-6 of the sum of all amplitudes."""
        # a non-uniform Fourier transform of type 1 (Fessler and Sutton, IEEE Trans. Signal Processing 51(2), 2003)
        # with a Kaiser-Bessel window over TAPS half bins
        own = type(self).synthesise is _Sweep.synthesise and type(self).compress is _Sweep.compress
        size, n_bins = self.n_samples(radar), self.n_range_bins(radar)
        if not own or size + n_bins > LONGEST_RESPONSE:
            return super().synthesise_bins(scatterers, radar)
        velocity_mps = radial_velocity_mps(scatterers)
        slope, duration_s = _slope_hz_per_s(radar), size / radar.sample_rate_hz
        bandwidth_hz, per_m = float(radar.bandwidth_hz or math.nan), 2.0 / SPEED_OF_LIGHT_MPS
        bend = 0.5 * math.pi * bandwidth_hz * duration_s
        fastest_mps = max(float(velocity_mps.max(initial=0.0)), -float(velocity_mps.min(initial=0.0)))
        if not bend * per_m * fastest_mps < LARGEST_BEND:
            return super().synthesise_bins(scatterers, radar)
        range_m, amplitude_v, phase_rad = compute_echoes(scatterers, radar)
        phase = [per_m, radar.transmit_phase_rad / (2.0 * math.pi), radar.carrier_hz, 0.5 * self.lag * slope]
        sweep = [bandwidth_hz, self.lag, radar.carrier_hz * duration_s, bend]
        facts = np.array([*phase, *sweep, self._find_first_bin(radar), size, 0.5 * ((size - 1) % 2)])
        n_columns = -(-n_bins // VECTOR) * VECTOR
        turns = np.pad(self._compute_video_turns(radar), (0, n_columns - n_bins))
        turn = np.stack([np.cos(2.0 * np.pi * turns), np.sin(2.0 * np.pi * turns)]).astype(np.float32)
        out = np.empty((range_m.shape[0], n_bins), dtype=np.complex64)
        tables = tabulate_taps(), tabulate_half_bin_responses(radar.range_window, size, n_columns)
        native.add_sweep_responses(range_m, velocity_mps, amplitude_v, phase_rad, facts, *tables, turn, out)
        return out

    def _compute_video_turns(self, radar: Radar) -> npt.NDArray[np.float64]:
        """Return the phasors that remove the residual video phase."""
        bins = self._find_first_bin(radar) + np.arange(self.n_range_bins(radar))
        delay_s = bins / float(radar.bandwidth_hz or math.nan)
        return np.asarray(-0.5 * self.lag * _slope_hz_per_s(radar) * delay_s**2)

    def compress(self, samples: npt.NDArray[Any], radar: Radar) -> Matrix:
        """Window and transform the samples to range bins, with phases at the sweep's middle."""
        from scipy.fft import ifft

        # The turns of FMCW, exp(-j pi S t_k^2) with the delay t_k of the bin's centre, remove the residual
        # video phase of a scatterer at the centre. At half a bin at most pi t_d / T_c remains:
        # 0.008 rad at 10 m and a sweep of 25 us, constant while the scatterer stays in the bin.
        size = self.n_samples(radar)
        window = make_range_window(radar.range_window, size)
        weights = (window * (size / window.sum())).astype(np.float32)
        bins = self._find_first_bin(radar) + np.arange(self.n_range_bins(radar))
        turns = self._compute_video_turns(radar) - 0.5 * bins * (size - 1) / size
        turn = np.exp(2j * np.pi * np.mod(turns, 1.0)).astype(np.complex64)
        out = np.empty((samples.shape[0], bins.size), dtype=np.complex64)
        for begin in range(0, samples.shape[0], ROWS):
            block = np.asarray(samples[begin : begin + ROWS], dtype=np.complex64) * weights
            out[begin : begin + ROWS] = ifft(block, axis=1, overwrite_x=True)[:, bins[0] : bins[0] + bins.size] * turn
        return out

    def n_samples(self, radar: Radar) -> int:
        return round(float(radar.sweep_s or 0.0) * radar.sample_rate_hz)

    def n_range_bins(self, radar: Radar) -> int:
        return math.ceil(radar.range_stop_m / self.bin_spacing_m(radar) - 1e-9) - self._find_first_bin(radar)

    def first_bin_m(self, radar: Radar) -> float:
        return self._find_first_bin(radar) * self.bin_spacing_m(radar)

    def _find_first_bin(self, radar: Radar) -> int:
        return math.ceil(radar.range_start_m / self.bin_spacing_m(radar) - 1e-9)

    def bin_spacing_m(self, radar: Radar) -> float:
        """Return the range bin spacing c / (2 B), one bin per sample, without zero padding."""
        return SPEED_OF_LIGHT_MPS / (2.0 * float(radar.bandwidth_hz or math.nan))

    def resolution_m(self, radar: Radar) -> float:
        """Return the half-power width, 0.886 (no window) to 1.64 (Blackman) c / (2 B)."""
        return half_power_bins(radar.range_window, self.n_samples(radar)) * self.bin_spacing_m(radar)

    def noise_gain(self, radar: Radar) -> float:
        window = make_range_window(radar.range_window, self.n_samples(radar))
        return float((window**2).sum() / window.sum() ** 2)

    def independent_bins(self, radar: Radar) -> float:
        # the window correlates neighbouring bins, whose correlation is the transform of w^2
        power = make_range_window(radar.range_window, self.n_samples(radar)) ** 2
        return float(power.sum() ** 2 / (power.size * (power**2).sum()))

    def unambiguous_range_m(self, radar: Radar) -> float:
        return self.n_samples(radar) * self.bin_spacing_m(radar)

    def coupling_s(self, radar: Radar) -> float:
        return -radar.carrier_hz / _slope_hz_per_s(radar)

    def figures(self, radar: Radar) -> dict[str, float]:
        return {
            "n_samples": self.n_samples(radar),
            "sweep_slope_hz_per_s": _slope_hz_per_s(radar),
            "coupling_shift_at_1mps_m": self.coupling_s(radar),
        }


@plugin("waveform")
class Fmcw(_Sweep):
    """De-chirped linear frequency sweep."""

    takes: ClassVar[tuple[str, ...]] = ("range_window",)
    lag: ClassVar[float] = 1.0

    kind: Literal["fmcw"] = "fmcw"


@plugin("waveform")
class Stepped(_Sweep):
    """Frequency response at every step of a sweep."""

    takes: ClassVar[tuple[str, ...]] = ("range_window", "noise_bandwidth_hz")
    lag: ClassVar[float] = 0.0

    kind: Literal["stepped"] = "stepped"


def _slope_hz_per_s(radar: Radar) -> float:
    """Return the sweep slope, the bandwidth over the sampling time T_c = S / f_s."""
    return float(radar.bandwidth_hz or 0.0) / (radar.waveform.n_samples(radar) / radar.sample_rate_hz)


def make_range_window(name: str, n_samples: int) -> npt.NDArray[np.float64]:
    """Return the symmetric window of a sweep without zeros, shape (S,)."""
    angle = 2.0 * np.pi * (np.arange(n_samples) + 0.5) / n_samples
    terms = [(-1.0) ** k * c * np.cos(k * angle) for k, c in enumerate(COSINES[name])]
    return np.asarray(np.sum(terms, axis=0), dtype=np.float64)


@lru_cache(maxsize=1)
def tabulate_taps() -> npt.NDArray[np.float32]:
    """Tabulate window derivatives (PLACES, ORDERS, ROW) at half bins."""
    y = np.arange(TAPS) - TAPS // 2 + 1 - ((np.arange(PLACES) + 0.5) / PLACES)[:, None]
    s0, s1, s2 = 1.0 - (2.0 * y / TAPS) ** 2, -8.0 * y / TAPS**2, -4.0 / TAPS**2
    series, power = np.zeros((2, ORDERS, *y.shape))
    size = 1.0 / float(modified_bessel(np.array(KAISER_BETA)))
    power[0] = 1.0
    for k in range(80):
        series += size * power
        size *= (KAISER_BETA / (2.0 * (k + 1))) ** 2
        raised = s0 * power
        raised[1:] += s1 * power[:-1]
        raised[2:] += s2 * power[:-2]
        power = raised
    table = np.zeros((PLACES, ORDERS, ROW), dtype=np.float32)
    for d in range(ORDERS):
        table[:, d, 7 : 7 + TAPS] = math.factorial(d) * (2.0 / math.pi) ** d * series[d]
    flat = np.ascontiguousarray(table.reshape(-1))
    flat.flags.writeable = False
    return flat


@lru_cache(maxsize=8)
def tabulate_half_bin_responses(name: str, n_samples: int, n_columns: int) -> npt.NDArray[np.float32]:
    """Tabulate the response of range bins to the half bins of :func:`tabulate_taps`."""
    from scipy.fft import ifft

    window, t = make_range_window(name, n_samples), (2 * np.arange(n_samples) + 1) / n_samples - 1.0
    node, weight = np.polynomial.legendre.leggauss(128)
    lobe = modified_bessel(KAISER_BETA * np.sqrt(1.0 - np.append(node, 0.0) ** 2))
    shape = weight * lobe[:-1] / lobe[-1] * (TAPS / 2)
    spectrum = np.cos(0.25 * math.pi * TAPS * t[:, None] * node) @ shape
    halves = 2 * np.arange(-n_samples - 8, n_columns + 8) - np.arange(2)[:, None]
    turned = 2 * n_samples * ifft(window / (spectrum * window.sum()), n=2 * n_samples)
    place = halves % (2 * n_samples)  # the transform's first sample stands at t = 1/S - 1
    shifted = turned * np.exp(-0.5j * np.pi * np.arange(2 * n_samples) * (n_samples - 1) / n_samples)
    sign = np.where((halves // (2 * n_samples)) % 2 == 1, (-1.0) ** (n_samples - 1), 1.0)
    table = np.asarray((shifted.real[place] * sign).reshape(-1), dtype=np.float32)
    table.flags.writeable = False
    return table


@lru_cache(maxsize=64)
def half_power_bins(name: str, n_samples: int) -> float:
    """Return the half-power width of a tone's main lobe, bins."""
    from scipy.optimize import brentq

    window = make_range_window(name, n_samples)
    place = 2.0 * math.pi * (np.arange(n_samples) - 0.5 * (n_samples - 1)) / n_samples

    def excess(offset_bins: float) -> float:
        return float((window * np.cos(place * offset_bins)).sum() / window.sum()) - math.sqrt(0.5)

    return 2.0 * float(brentq(excess, 0.0, 1.0))
