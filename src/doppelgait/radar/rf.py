"""Full-rate RF samples and digital down-conversion (E-16, E-17).

This is slow and for validation only: :func:`doppelgait.radar.simulate.synthesise` gives the same
baseband in closed form.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from doppelgait.core.labels import AnyTable, ScattererTable
from doppelgait.core.lazy import xr
from doppelgait.core.units import range_to_delay_s
from doppelgait.radar.link import compute_echoes, fold_scatterers
from doppelgait.radar.parameters import Radar
from doppelgait.radar.simulate import label_baseband

FILTER_TAPS = 129
FILTER_CUTOFF_HZ = 3.2e9
FILTER_BETA = 9.5


def sample_rf_frames(scatterers: AnyTable, radar: Radar, *, margin: int) -> npt.NDArray[np.float64]:
    """Return full-rate real samples (I, n_full + 2 margin) of the received RF frames (E-16)."""
    n_full = (radar.n_range_bins - 1) * radar.decimation + 1
    first_s = range_to_delay_s(radar.range_start_m) - margin / radar.sample_rate_hz
    time_s = first_s + np.arange(n_full + 2 * margin) / radar.sample_rate_hz
    range_m, amplitude_v, extra_rad = compute_echoes(fold_scatterers(ScattererTable.of(scatterers), radar), radar)
    frames = np.zeros((range_m.shape[0], time_s.size))
    for i in range(range_m.shape[0]):
        delay_s = range_to_delay_s(range_m[i])[:, None]
        phase = (
            radar.transmit_phase_rad
            + (0.0 if extra_rad is None else extra_rad[i][:, None])
            - 4.0 * np.pi * np.mod(range_m[i], radar.wavelength_m)[:, None] / radar.wavelength_m
        )
        carrier = np.cos(2.0 * np.pi * radar.carrier_hz * time_s + phase)
        pulse = np.exp(-0.5 * ((time_s - delay_s) / radar.sigma_s) ** 2)
        frames[i] = (amplitude_v[i][:, None] * pulse * carrier).sum(axis=0)
    return frames


def down_convert(frames: npt.NDArray[np.float64], radar: Radar, *, margin: int) -> npt.NDArray[np.complex128]:
    """Convert real RF frames (I, n_full + 2 margin) to baseband: mix, low-pass, decimate (E-17)."""
    from scipy.signal import firwin, oaconvolve

    first_s = range_to_delay_s(radar.range_start_m) - margin / radar.sample_rate_hz
    time_s = first_s + np.arange(frames.shape[1]) / radar.sample_rate_hz
    mixed = 2.0 * frames * np.exp(-2j * np.pi * radar.carrier_hz * time_s)
    # a symmetric low-pass that rejects the image
    taps = firwin(FILTER_TAPS, FILTER_CUTOFF_HZ, window=("kaiser", FILTER_BETA), fs=radar.sample_rate_hz)
    filtered = oaconvolve(mixed, taps[None, :], mode="same", axes=1)
    stop = frames.shape[1] - margin
    return np.asarray(filtered[:, margin : stop : radar.decimation])


def synthesise_rf(scatterers: AnyTable, radar: Radar) -> xr.DataArray:
    """Synthesise the baseband by RF sampling and down-conversion.

    It is noise-free and serves as the reference for the closed form.

    Parameters and result are those of :func:`doppelgait.radar.simulate.synthesise`, in complex128.

    See Also
    --------
    synthesise : the same in closed form.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=3.0)
    >>> radar = dg.Radar.preset("x4")
    >>> table = dg.scene.assemble(scene, [0.0, 1.0])
    >>> exact, closed = dg.radar.synthesise_rf(table, radar), dg.radar.synthesise(table, radar)
    >>> round(float(abs(exact - closed).max() / abs(exact).max()), 2)  # relative difference
    0.0
    """
    margin = FILTER_TAPS + int(np.ceil(5.5 * radar.sigma_s * radar.sample_rate_hz))
    table = ScattererTable.of(scatterers)
    frames = sample_rf_frames(table, radar, margin=margin)
    values = down_convert(frames, radar, margin=margin)
    return label_baseband(values, table.slow_time_s, radar)
