"""Gait features from labelled signatures and cadence maps."""

from doppelgait.features.feature_set import FEATURE_UNITS, FEATURES, Extraction, GaitFeatures
from doppelgait.features.gait import extract, snr_mu_db
from doppelgait.features.gait_frequency import GaitFrequency, gait_frequency
from doppelgait.features.ground_motion import GroundMotion, ground_motion
from doppelgait.features.harmonics import harmonic_ratio, limb_torso_ratio
from doppelgait.features.observed import Observed
from doppelgait.features.ti_frames import frame_numbers, window_statistics

__all__ = [
    "FEATURES", "FEATURE_UNITS", "Extraction", "GaitFeatures", "GaitFrequency", "GroundMotion", "Observed", "extract",
    "frame_numbers", "gait_frequency", "ground_motion", "harmonic_ratio", "limb_torso_ratio", "snr_mu_db",
    "window_statistics",
]  # fmt: skip
