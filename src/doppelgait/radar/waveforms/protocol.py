"""What every waveform can do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.radar.config import Radar

Samples = npt.NDArray[np.complex64]

CHOSEN = {
    "bandwidth_hz": None,
    "bandwidth_level_db": 10,
    "pulse_sigma_s": None,
    "sweep_s": None,
    "decimation": 1,
    "range_window": "hann",
    "noise_bandwidth_hz": None,
    "sweep_levels": 1,
    "pulse_rate_hz": None,
}
"""Parameters that not every waveform has, and the values that count as not given."""


@dataclass(frozen=True)
class Waveform:
    """A waveform: from scatterers to receiver samples, and from those to range bins.

    Parameters
    ----------
    check : callable
        Further checks of a radar; raises ``ValueError``.
    n_samples : callable
        Receiver samples S of one frame.
    n_range_bins : callable
        Range bins N of one frame.
    first_bin_m, bin_spacing_m : callable
        Range of the first bin, and from one bin to the next.
    synthesise : callable
        ``(scatterers, radar) -> samples``: complex64, shape (I, S), V; noise-free.
    compress : callable
        ``(samples, radar) -> bins``: complex64, shape (I, N), V. A point echo in the middle of a bin keeps its
        amplitude a and has the phase theta - 4 pi R / lambda.
    resolution_m : callable
        Half-power width in range of one echo.
    noise_bandwidth_hz : callable
        Noise bandwidth of one receiver sample unless the radar says otherwise.
    noise_gain : callable
        Noise power in a range bin over noise power in a receiver sample, for white noise.
    unambiguous_range_m : callable
        Range at which echoes fold back to 0; inf for none.
    coupling_s : callable
        Apparent range shift per radial velocity, in s: -f_c T_c / B for frequency-swept waveforms, else 0.
    figures : callable
        Further derived quantities by name.
    independent_bins : callable
        Independent noise values per range bin, 1 where the noise of neighbouring bins has nothing in common.
    folds : bool
        Whether ``synthesise`` shows echoes from beyond the unambiguous range at a wrong one, instead of losing them.
    needs, takes : tuple of str
        Parameters among ``CHOSEN`` that must be given, and those that may be.
    """

    check: Callable[[Radar], None]
    n_samples: Callable[[Radar], int]
    n_range_bins: Callable[[Radar], int]
    first_bin_m: Callable[[Radar], float]
    bin_spacing_m: Callable[[Radar], float]
    synthesise: Callable[[xr.Dataset, Radar], Samples]
    compress: Callable[[npt.NDArray[Any], Radar], Samples]
    resolution_m: Callable[[Radar], float]
    noise_bandwidth_hz: Callable[[Radar], float]
    noise_gain: Callable[[Radar], float]
    unambiguous_range_m: Callable[[Radar], float]
    coupling_s: Callable[[Radar], float]
    figures: Callable[[Radar], dict[str, float]]
    independent_bins: Callable[[Radar], float] = lambda radar: 1.0
    folds: bool = False
    needs: tuple[str, ...] = ()
    takes: tuple[str, ...] = ()

    def range_axis_m(self, radar: Radar) -> npt.NDArray[np.float64]:
        """Range of every bin."""
        steps = np.arange(self.n_range_bins(radar))
        return np.asarray(self.first_bin_m(radar) + self.bin_spacing_m(radar) * steps, dtype=np.float64)

    def noise_power_v2(self, radar: Radar) -> float:
        """Mean square of the complex receiver noise in one receiver sample, V^2 (E-18)."""
        from doppelgait.radar.link import white_noise_v2

        return white_noise_v2(radar, radar.receiver_bandwidth_hz)


def check_given(radar: Radar, waveform: Waveform) -> None:
    """Refuse a radar that lacks what its waveform needs, or has what means nothing to it (``ValueError``)."""
    missing = [name for name in waveform.needs if getattr(radar, name) == CHOSEN[name]]
    if missing:
        raise ValueError(f"waveform {radar.waveform!r} needs {' and '.join(missing)}")
    own = {*waveform.needs, *waveform.takes}
    idle = [name for name, unset in CHOSEN.items() if name not in own and getattr(radar, name) != unset]
    if idle:
        raise ValueError(
            f"{' and '.join(idle)} mean{'s' if len(idle) == 1 else ''} nothing to waveform {radar.waveform!r}; leave "
            f"out what it has no use for (it takes {', '.join(sorted(own)) or 'none of these'})"
        )


def check_band(radar: Radar, bandwidth_hz: float) -> None:
    """Refuse a band that reaches below 0 Hz."""
    if radar.carrier_hz < bandwidth_hz / 2.0:
        raise ValueError(
            f"carrier_hz {radar.carrier_hz:g} is below half of bandwidth_hz {bandwidth_hz:g}: the band would reach "
            "below 0 Hz; carrier_hz is the middle of the band"
        )


def check_sweep_fits(radar: Radar, duration_s: float) -> None:
    """Refuse a sweep or pulse that is longer than the time from one to the next."""
    if duration_s * radar.prf_hz > 1.0 + 1e-9:
        raise ValueError(
            f"sweep_s {duration_s:g} is longer than a frame at prf_hz {radar.prf_hz:g}, {1 / radar.prf_hz:.4g} s; "
            "shorten the sweep or lower prf_hz"
        )


def unchanged(samples: npt.NDArray[Any], radar: Radar) -> Samples:
    """Range bins of a waveform whose receiver samples are range bins already."""
    return np.asarray(samples, dtype=np.complex64)


def no_gain(radar: Radar) -> float:
    """Noise gain of a waveform whose receiver samples are range bins."""
    return 1.0


def no_coupling(radar: Radar) -> float:
    """Range shift per velocity of a waveform without range-Doppler coupling, s."""
    return 0.0
