"""Gait features from labelled signatures and step-Doppler maps; nothing here knows whether they were simulated."""

from doppelgait.features.gait import FEATURE_UNITS, Evidence, Extraction, GaitFeatures, extract, snr_mu_db
from doppelgait.features.gait_frequency import GaitFrequency, gait_frequency
from doppelgait.features.ground_motion import GroundMotion, ground_motion
from doppelgait.features.harmonics import harmonic_ratio, limb_torso_ratio

__all__ = [
    "FEATURE_UNITS", "Evidence", "Extraction", "GaitFeatures", "GaitFrequency", "GroundMotion", "extract",
    "gait_frequency", "ground_motion", "harmonic_ratio", "limb_torso_ratio", "snr_mu_db",
]  # fmt: skip
