"""Signal processing from complex baseband to cadence-velocity diagram."""

from doppelgait.processing.bursts import find_burst_pulses, get_burst_pulses
from doppelgait.processing.cadence import (
    cadence_map,
    cadence_spectrum,
    detrend,
    detrend_order,
    mean_doppler_spectrum,
    observation_s,
)
from doppelgait.processing.clutter import (
    clutter_gain,
    measure_share_removed,
    predict_torso_share_removed,
    remove_clutter,
    remove_static_clutter,
)
from doppelgait.processing.config import Analysis, gaussian_window, plan_transform
from doppelgait.processing.detect import Detector, find_scans
from doppelgait.processing.gate import Gate
from doppelgait.processing.main_line import align, choose_line_order, main_line_hz, needs_alignment
from doppelgait.processing.normalise import count_independent_bins, count_independent_columns, noise_floor_v2, normalise
from doppelgait.processing.signature import burst_signature, crop_to_frame, decimate, range_doppler, signature

__all__ = [
    "Analysis",
    "Detector",
    "Gate",
    "align",
    "burst_signature",
    "cadence_map",
    "cadence_spectrum",
    "choose_line_order",
    "clutter_gain",
    "count_independent_bins",
    "count_independent_columns",
    "crop_to_frame",
    "decimate",
    "detrend",
    "detrend_order",
    "find_burst_pulses",
    "find_scans",
    "gaussian_window",
    "get_burst_pulses",
    "main_line_hz",
    "mean_doppler_spectrum",
    "measure_share_removed",
    "needs_alignment",
    "noise_floor_v2",
    "normalise",
    "observation_s",
    "plan_transform",
    "predict_torso_share_removed",
    "range_doppler",
    "remove_clutter",
    "remove_static_clutter",
    "signature",
]
