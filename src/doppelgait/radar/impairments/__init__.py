"""Faults of real receivers and rooms, applied in order."""

from doppelgait.core.samples import Samples
from doppelgait.radar.impairments.additive import (
    ColouredNoise,
    Interference,
    Leakage,
    Spur,
    StaticClutter,
    ThermalNoise,
    noise_power_per_sample_v2,
)
from doppelgait.radar.impairments.apply import (
    IMPAIRMENTS,
    Apply,
    Impairments,
    apply_impairments,
    make_impairment,
    shift_pulse_times,
)
from doppelgait.radar.impairments.receiver import (
    Adc,
    DcLeak,
    DroppedFrames,
    FrameJitter,
    IqImbalance,
    PhaseNoise,
    X4Counts,
    x4_frame_rate_hz,
)

__all__ = [
    "IMPAIRMENTS",
    "Adc",
    "Apply",
    "ColouredNoise",
    "DcLeak",
    "DroppedFrames",
    "FrameJitter",
    "Impairments",
    "Interference",
    "IqImbalance",
    "Leakage",
    "PhaseNoise",
    "Samples",
    "Spur",
    "StaticClutter",
    "ThermalNoise",
    "X4Counts",
    "apply_impairments",
    "make_impairment",
    "noise_power_per_sample_v2",
    "shift_pulse_times",
    "x4_frame_rate_hz",
]
