"""Gait features from labelled signatures and cadence maps."""

from doppelgait.features.feature_set import FEATURE_UNITS, FEATURES, Extraction, GaitFeatures
from doppelgait.features.gait import extract, snr_mu_db
from doppelgait.features.gait_frequency import GaitFrequency, estimate_gait_frequency
from doppelgait.features.ground_motion import GroundMotion, estimate_ground_motion
from doppelgait.features.harmonics import harmonic_ratio, limb_torso_ratio
from doppelgait.features.observed import Observation
from doppelgait.features.ti_frames import measure_columns, measure_windows

__all__ = [
    "FEATURES",
    "FEATURE_UNITS",
    "Extraction",
    "GaitFeatures",
    "GaitFrequency",
    "GroundMotion",
    "Observation",
    "estimate_gait_frequency",
    "estimate_ground_motion",
    "extract",
    "harmonic_ratio",
    "limb_torso_ratio",
    "measure_columns",
    "measure_windows",
    "snr_mu_db",
]
