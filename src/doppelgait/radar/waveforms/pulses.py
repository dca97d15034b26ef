r"""Pulses (Gaussian, rectangular, chirped) and continuous wave.

The receiver samples are the range bins. A Gaussian pulse is down-converted and sampled along fast
time (E-11, E-15, E-18). Rectangular pulse and chirp (lfm) have a matched filter in closed form.

With x = t - t_0 from the echo's delay and f_d = 2 v / lambda (Richards, Fundamentals of Radar Signal Processing, 2nd
ed., sections 4.2 and 4.6.4: the ambiguity function of a pulse and of a chirp of slope S = B / T):

.. math:: y = a\, e^{j(\theta + \phi - 4 \pi R / \lambda)} (1 - |x| / T)\, e^{\pi j f_d x}\,
          \mathrm{sinc}((f_d + S x)(T - |x|)), \quad |x| < T

S = 0 gives the triangle of the rectangular pulse. The peak of a chirp is at x = -f_d / S: an approaching scatterer
appears nearer by v f_c T / B. The assumptions are: R and v are constant during the pulse (stop and hop, R at its
middle); the receiver is active during transmission; there is no weighting against side lobes (-13 dB for the chirp);
and the noise is white from bin to bin with the matched filter's bandwidth 1 / T, so that the peak's SNR is E / N0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.labels import AnyTable
from doppelgait.core.plugins import plugin
from doppelgait.core.samples import Matrix, Samples, borrow_planes
from doppelgait.core.units import SPEED_OF_LIGHT_MPS, range_to_delay_s, velocity_to_doppler_hz
from doppelgait.radar.link import compute_echoes, radial_velocity_mps
from doppelgait.radar.parameters import IMPULSE, PULSE_SIGMA_S, Radar, Waveform, check_band, check_sweep_fits

RECTANGULAR_WIDTH = 2.0 - math.sqrt(2.0)
"""Half-power width of the triangle (1 - |x|)^2, in pulse durations."""
RECTANGULAR_BANDWIDTH = 0.8859
"""Half-power bandwidth of a rectangular pulse times its duration (E-09)."""
MAX_PULSE_S = 1e-3
DOPPLER_ERROR = 5e-7
"""Maximum ratio of Doppler to bandwidth, and error, for which Doppler only shifts echoes."""
LONGEST_FRAME = 0.95
"""Maximum frame length, in pulse durations, for tabulated responses (kink at the ends)."""
VECTOR = 32
"""Vector length, bins; the row length of the table is a multiple of it."""
ROW_MULTIPLE = 32
"""Rows of planes have a multiple of this length: they start at whole cache lines."""
TABLE_ERROR = 1e-7
"""Maximum interpolation error of the tabulated response, relative to its peak."""


@plugin("waveform")
class Impulse(Waveform):
    """A Gaussian pulse."""

    takes: ClassVar[tuple[str, ...]] = (*Waveform.takes, *IMPULSE)

    kind: Literal["impulse"] = "impulse"

    def check(self, radar: Radar) -> None:
        """Check that the pulse is stated once, has an allowed length, and a band above 0 Hz."""
        if (radar.bandwidth_hz is None) == (radar.pulse_sigma_s is None):
            raise ValueError("give exactly one of bandwidth_hz and pulse_sigma_s")
        shortest_s, longest_s = PULSE_SIGMA_S
        if not shortest_s <= radar.sigma_s <= longest_s:
            key = "bandwidth_hz" if radar.pulse_sigma_s is None else "pulse_sigma_s"
            raise ValueError(
                f"{key} {getattr(radar, key)} makes a pulse of sigma {radar.sigma_s:.3g} s; allowed are "
                f"{shortest_s:g} to {longest_s:g} s"
            )
        check_band(radar, radar.pulse_bandwidth_hz(10))

    def synthesise(self, scatterers: AnyTable, radar: Radar) -> Matrix:
        """Sum Gaussian echoes exactly, with an extra phase per path."""
        return _sum_echoes(scatterers, radar).matrix

    def synthesise_planes(self, scatterers: AnyTable, radar: Radar) -> Samples:
        """Sum Gaussian echoes in the layout of the kernel."""
        if type(self).synthesise is not Impulse.synthesise:  # a subclass with samples of its own
            return super().synthesise_planes(scatterers, radar)
        return _sum_echoes(scatterers, radar)

    def resolution_m(self, radar: Radar) -> float:
        """Return the half-power width of one echo, c sqrt(ln 2) tau (E-11)."""
        return SPEED_OF_LIGHT_MPS * math.sqrt(math.log(2)) * radar.sigma_s

    def noise_bandwidth_hz(self, radar: Radar) -> float:
        """Return the down-conversion filter's bandwidth, the pulse's at -10 dB."""
        return radar.pulse_bandwidth_hz(10)

    def figures(self, radar: Radar) -> dict[str, float]:
        """Return pulse width and bandwidths (E-11)."""
        return {
            "pulse_sigma_s": radar.sigma_s,
            "pulse_bandwidth_3db_hz": radar.pulse_bandwidth_hz(3),
            "pulse_bandwidth_10db_hz": radar.pulse_bandwidth_hz(10),
        }


def _sum_echoes(scatterers: AnyTable, radar: Radar) -> Samples:
    range_m, amplitude_v, phase_rad = compute_echoes(scatterers, radar)
    n_pulses, sigma_m = range_m.shape[0], radar.sigma_s * SPEED_OF_LIGHT_MPS / 2.0
    geometry = radar.range_start_m, radar.bin_spacing_m, sigma_m, radar.wavelength_m, radar.transmit_phase_rad
    planes = borrow_planes((2, radar.n_range_bins, -(-n_pulses // ROW_MULTIPLE) * ROW_MULTIPLE))
    native.echo_planes(range_m, amplitude_v, *geometry, planes[0], planes[1], phase_rad)
    return Samples.from_planes(planes, n_pulses)


class _MatchedPulse(Waveform):
    """A pulse of duration ``sweep_s`` behind its matched filter."""

    def check(self, radar: Radar) -> None:
        """Check that the pulse lasts half a carrier period to 1 ms, or a frame."""
        duration_s = _duration_s(radar)
        if duration_s > MAX_PULSE_S:
            raise ValueError(f"sweep_s {duration_s:g} is too long for a pulse; at most {MAX_PULSE_S:g} s are allowed")
        check_sweep_fits(radar, duration_s)
        check_band(radar, radar.bandwidth_hz or 1.0 / duration_s)

    def synthesise(self, scatterers: AnyTable, radar: Radar) -> Matrix:
        range_m, amplitude_v, phase_rad = compute_echoes(scatterers, radar)
        extra_rad = radar.transmit_phase_rad + (0.0 if phase_rad is None else phase_rad)
        turns = extra_rad / (2.0 * math.pi) - range_m * (2.0 / radar.wavelength_m)
        duration_s = _duration_s(radar)
        doppler_hz = velocity_to_doppler_hz(radial_velocity_mps(scatterers), radar.wavelength_m)
        first, step = (float(range_to_delay_s(m)) / duration_s for m in (radar.range_start_m, radar.bin_spacing_m))
        delay = range_to_delay_s(range_m) / duration_s
        time_bandwidth = _time_bandwidth(radar)
        out = np.empty((range_m.shape[0], radar.n_range_bins), dtype=np.complex64)
        echoes = amplitude_v, turns, delay, doppler_hz * duration_s
        is_tabled = time_bandwidth != 0.0 and out.shape[1] * step <= LONGEST_FRAME
        table = tabulate(out.shape[1], step, time_bandwidth) if is_tabled else None
        native.add_responses(*echoes, first, step, time_bandwidth, DOPPLER_ERROR * time_bandwidth, out, table)
        return out

    def reach_m(self, radar: Radar) -> float:
        return SPEED_OF_LIGHT_MPS * _duration_s(radar) / 2.0

    def noise_bandwidth_hz(self, radar: Radar) -> float:
        return 1.0 / _duration_s(radar)


@plugin("waveform")
class Rectangular(_MatchedPulse):
    """A rectangular pulse behind its matched filter."""

    needs: ClassVar[tuple[str, ...]] = ("sweep_s",)

    kind: Literal["rectangular"] = "rectangular"

    def resolution_m(self, radar: Radar) -> float:
        """Return the half-power width of the triangle, (2 - sqrt 2) c T / 2."""
        return RECTANGULAR_WIDTH * SPEED_OF_LIGHT_MPS * _duration_s(radar) / 2.0

    def figures(self, radar: Radar) -> dict[str, float]:
        """Return the half-power bandwidth (E-09)."""
        return {"pulse_bandwidth_3db_hz": RECTANGULAR_BANDWIDTH / _duration_s(radar)}


@plugin("waveform")
class Lfm(_MatchedPulse):
    """Pulse with a linear frequency sweep and matched filter."""

    needs: ClassVar[tuple[str, ...]] = ("bandwidth_hz", "sweep_s")

    kind: Literal["lfm"] = "lfm"

    def check(self, radar: Radar) -> None:
        """Check the chirp's duration, band and time-bandwidth product, at least 2."""
        super().check(radar)
        if _time_bandwidth(radar) < 2.0:
            raise ValueError(
                f"bandwidth_hz {radar.bandwidth_hz:g} times sweep_s {radar.sweep_s:g} is below 2: that is not a chirp; "
                "use waveform 'rectangular' or a longer sweep"
            )

    def resolution_m(self, radar: Radar) -> float:
        """Return the half-power width of a compressed chirp, about 0.886 c / (2 B)."""
        width_s = _compute_half_power_width(_time_bandwidth(radar)) * _duration_s(radar)
        return width_s * SPEED_OF_LIGHT_MPS / 2.0

    def coupling_s(self, radar: Radar) -> float:
        """Return the range shift per velocity of a rising chirp, -f_c T / B."""
        return -radar.carrier_hz * _duration_s(radar) / float(radar.bandwidth_hz or math.nan)

    def figures(self, radar: Radar) -> dict[str, float]:
        """Return slope, time-bandwidth product and range shift at 1 m/s."""
        return {
            "sweep_slope_hz_per_s": float(radar.bandwidth_hz or 0.0) / _duration_s(radar),
            "time_bandwidth_product": _time_bandwidth(radar),
            "coupling_shift_at_1mps_m": self.coupling_s(radar),
        }


def _duration_s(radar: Radar) -> float:
    return float(radar.sweep_s or math.nan)


def _time_bandwidth(radar: Radar) -> float:
    return float(radar.bandwidth_hz or 0.0) * _duration_s(radar)


@lru_cache(maxsize=4)
def tabulate(n_bins: int, step: float, time_bandwidth: float) -> npt.NDArray[np.float32]:
    """Tabulate the response of a chirp, three rows (Chebyshev nodes) for every place within a bin."""
    n_places = max(8, math.ceil(0.5 * math.pi * time_bandwidth * step / (24.0 * TABLE_ERROR) ** (1.0 / 3.0)))
    nodes = (1.0 + np.array([-1.0, 0.0, 1.0]) * math.sqrt(0.75)) / 2.0
    place = (np.arange(n_places)[:, None] + nodes) / n_places
    x = (np.arange(1 - n_bins, -(-n_bins // VECTOR) * VECTOR) - place[..., None]) * step
    inside = np.maximum(1.0 - np.abs(x), 0.0)
    table: npt.NDArray[np.float32] = (inside * np.sinc(time_bandwidth * x * inside)).astype(np.float32)
    table = table.reshape(-1, table.shape[2])
    table.flags.writeable = False
    return table


@lru_cache(maxsize=64)
def _compute_half_power_width(time_bandwidth: float) -> float:
    """Return the half-power width of a chirp's response in pulse durations, about 0.886 / (B T)."""
    from scipy.optimize import brentq

    def excess(x: float) -> float:
        return float((1.0 - x) * np.sinc(time_bandwidth * x * (1.0 - x))) - math.sqrt(0.5)

    return 2.0 * float(brentq(excess, 0.0, min(0.5, 1.0 / time_bandwidth)))


@plugin("waveform")
class Cw(Waveform):
    """Continuous wave: one sample per frame, the sum of the echoes at all ranges."""

    takes: ClassVar[tuple[str, ...]] = ("noise_bandwidth_hz", "integration_share")
    ranged: ClassVar[bool] = False

    kind: Literal["cw"] = "cw"

    def fill(self, table: Mapping[str, Any]) -> Mapping[str, Any]:
        """Set the default sampling rate, the frame rate; it has no effect for this waveform."""
        return {"sample_rate_hz": table["prf_hz"], **table} if "prf_hz" in table else table

    def synthesise(self, scatterers: AnyTable, radar: Radar) -> Matrix:
        """Sum the echoes of all scatterers at all ranges, a exp(j(theta + phi - 4 pi R / lambda))."""
        range_m, amplitude_v, extra_rad = compute_echoes(scatterers, radar)
        turns = range_m * (2.0 / radar.wavelength_m)
        phase_rad = -2.0 * np.pi * (turns - np.rint(turns)) + radar.transmit_phase_rad
        if extra_rad is not None:
            phase_rad += extra_rad
        total = (amplitude_v * np.exp(1j * phase_rad)).sum(axis=1, keepdims=True)
        return np.asarray(total, dtype=np.complex64)

    def n_range_bins(self, radar: Radar) -> int:
        """Return 1, the single range bin."""
        return 1

    def first_bin_m(self, radar: Radar) -> float:
        """Return the middle of the frame."""
        return 0.5 * (radar.range_start_m + radar.range_stop_m)

    def bin_spacing_m(self, radar: Radar) -> float:
        """Return the span of the frame."""
        return radar.range_stop_m - radar.range_start_m

    resolution_m = bin_spacing_m

    def noise_bandwidth_hz(self, radar: Radar) -> float:
        """Return the noise bandwidth of a sample, 1 / T_i for a mean over T_i."""
        return radar.prf_hz / (radar.integration_share or 1.0)

    def unambiguous_range_m(self, radar: Radar) -> float:
        """Return inf: echoes do not fold."""
        return float("inf")
