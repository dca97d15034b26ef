"""Range bins of waveforms that are sampled along fast time: impulse, rectangular and lfm."""

from __future__ import annotations

import math

from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.radar.config import Radar


def bin_spacing_m(radar: Radar) -> float:
    """Spacing of the range bins: D c / (2 f_s) (E-15)."""
    return radar.decimation * SPEED_OF_LIGHT_MPS / (2.0 * radar.sample_rate_hz)


def n_range_bins(radar: Radar) -> int:
    """Number of range bins N = ceil(r_span / bin spacing) (E-15)."""
    return math.ceil((radar.range_stop_m - radar.range_start_m) / bin_spacing_m(radar) - 1e-9)


def first_bin_m(radar: Radar) -> float:
    """Range of the first bin: the start of the frame (E-15)."""
    return radar.range_start_m


def unambiguous_range_m(radar: Radar) -> float:
    """Range at which the next pulse leaves: c / (2 pulse rate)."""
    return SPEED_OF_LIGHT_MPS / (2.0 * (radar.pulse_rate_hz or radar.prf_hz))
