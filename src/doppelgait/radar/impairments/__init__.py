"""Faults of real receivers and rooms, applied one after the other to the receiver samples."""

from doppelgait.radar.impairments.clutter import Leakage, StaticClutter
from doppelgait.radar.impairments.converter import Adc, X4Counts, x4_frame_rate_hz
from doppelgait.radar.impairments.noise import Interference, ThermalNoise, noise_power_per_sample_v2
from doppelgait.radar.impairments.phase import PhaseNoise
from doppelgait.radar.impairments.quadrature import DcLeak, IqImbalance, image_ratio_db
from doppelgait.radar.impairments.registry import (
    IMPAIRMENTS,
    Impairment,
    Impairments,
    apply_impairments,
    make_impairment,
    pulse_times,
)
from doppelgait.radar.impairments.timing import DroppedFrames, FrameJitter

__all__ = [
    "IMPAIRMENTS", "Adc", "DcLeak", "DroppedFrames", "FrameJitter", "Impairment", "Impairments", "Interference",
    "IqImbalance", "Leakage", "PhaseNoise", "StaticClutter", "ThermalNoise", "X4Counts", "apply_impairments",
    "image_ratio_db", "make_impairment", "noise_power_per_sample_v2", "pulse_times", "x4_frame_rate_hz",
]  # fmt: skip
