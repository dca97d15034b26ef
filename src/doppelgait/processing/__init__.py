"""Signal processing from complex baseband to cadence-velocity diagram."""

from doppelgait.processing.bursts import burst_pulses_of, burst_signature, find_burst_pulses
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
    remove_clutter,
    share_removed,
    torso_share_removed,
    without_clutter,
)
from doppelgait.processing.config import Analysis, gaussian_window, plan_transform
from doppelgait.processing.detect import Detector, find_scans
from doppelgait.processing.gate import Gate
from doppelgait.processing.main_line import align, line_order, main_line_hz, needs_alignment
from doppelgait.processing.normalise import independent_bins, independent_columns, noise_floor_v2, normalise
from doppelgait.processing.signature import range_doppler, signature, thin, within_frame

__all__ = [
    "Analysis", "Detector", "Gate", "align", "burst_pulses_of", "burst_signature", "cadence_map", "cadence_spectrum",
    "clutter_gain", "detrend", "detrend_order", "find_burst_pulses", "find_scans",
    "gaussian_window", "independent_bins", "independent_columns", "line_order", "main_line_hz", "mean_doppler_spectrum",
    "needs_alignment", "noise_floor_v2", "normalise", "observation_s", "plan_transform", "range_doppler",
    "remove_clutter", "share_removed", "signature", "thin", "torso_share_removed", "within_frame", "without_clutter",
]  # fmt: skip
