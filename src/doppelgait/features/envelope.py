"""Features of the Doppler envelopes (E-35), relative to the main line and in the direction of motion.

Björklund, Petersson and Hendeby, "Features for micro-Doppler based activity classification", IET Radar, Sonar &
Navigation 9(9), 2015, describe walkers by the main cycle time and properties of the envelope. Kim and Ling, "Human
activity classification based on micro-Doppler signatures using a support vector machine", IEEE Transactions on
Geoscience and Remote Sensing 47(5), 2009, use bandwidth, offset and strength of the whole signature. The exact forms
here are ours, on the quantile envelopes of E-35.
"""

from __future__ import annotations

from doppelgait.features.observed import Observed, likeness_at, limits
from doppelgait.features.registry import FEATURES, Feature

BJORKLUND = "envelope properties after Björklund et al. 2015, on the envelopes of E-35"
KIM_LING = "after Kim and Ling 2009, on the envelopes of E-35"
SIDES = ("direction", "envelope")


def forward_mean_mps(observed: Observed) -> float:
    """Mean reach of the leading envelope ahead of the main line."""
    return float(observed.forward_mps.mean())


def backward_mean_mps(observed: Observed) -> float:
    """Mean reach of the trailing envelope behind the main line."""
    return float(observed.backward_mps.mean())


def forward_sd_mps(observed: Observed) -> float:
    """Standard deviation over time of the leading envelope about the main line."""
    return float(observed.forward_mps.std())


def backward_sd_mps(observed: Observed) -> float:
    """Standard deviation over time of the trailing envelope about the main line."""
    return float(observed.backward_mps.std())


def forward_range_mps(observed: Observed) -> float:
    """95th minus 5th percentile over time of the leading envelope."""
    low, high = observed.forward_limits_mps
    return high - low


def backward_range_mps(observed: Observed) -> float:
    """95th minus 5th percentile over time of the trailing envelope."""
    low, high = observed.backward_limits_mps
    return high - low


def asymmetry(observed: Observed) -> float | None:
    """Bandwidth ahead minus bandwidth behind, over their sum; 95th percentiles over time, -1 to 1."""
    ahead = observed.forward_limits_mps[1]
    behind = observed.backward_limits_mps[1]
    return (ahead - behind) / (ahead + behind) if ahead > 0 and behind > 0 else None


def offset_mps(observed: Observed) -> float:
    """Mean middle of the envelopes ahead of the main line."""
    return float((observed.forward_mps - observed.backward_mps).mean()) / 2.0


def torso_bandwidth_mps(observed: Observed) -> float:
    """Width between the envelopes where it is least, the 5th percentile over time: the body without its swings."""
    return limits(observed.width_mps)[0]


def strength_variation(observed: Observed) -> float | None:
    """Standard deviation over mean of the power near the main line over time, range taken out (E-28)."""
    power = observed.near_power_v2
    mean = float(power.mean())
    return float(power.std()) / mean if mean > 0 else None


def periodicity(observed: Observed) -> float | None:
    """Likeness of the envelopes' width to itself one gait period later, at most 1 (E-33)."""
    if not observed.seen.all():  # the width is known at every column or the lag means nothing
        return None
    width = observed.width_mps
    return likeness_at(width - width.mean(), observed.rate_hz / observed.frequency_hz)


def swing_duty(observed: Observed) -> float | None:
    """Share of the time in which the leading envelope is beyond the middle of its range: duration of limb spikes."""
    low, high = observed.forward_limits_mps
    if high - low < 2.0 * observed.bin_mps:
        return None
    return float((observed.forward_mps > (low + high) / 2.0).mean())


FEATURES.add("forward_envelope_mean_mps", Feature("m/s", BJORKLUND, forward_mean_mps, SIDES))
FEATURES.add("backward_envelope_mean_mps", Feature("m/s", BJORKLUND, backward_mean_mps, SIDES))
FEATURES.add("forward_envelope_sd_mps", Feature("m/s", BJORKLUND, forward_sd_mps, SIDES))
FEATURES.add("backward_envelope_sd_mps", Feature("m/s", BJORKLUND, backward_sd_mps, SIDES))
FEATURES.add("forward_envelope_range_mps", Feature("m/s", BJORKLUND, forward_range_mps, SIDES))
FEATURES.add("backward_envelope_range_mps", Feature("m/s", BJORKLUND, backward_range_mps, SIDES))
FEATURES.add("envelope_asymmetry", Feature("1", "ours: bandwidth ahead against behind (E-35)", asymmetry, SIDES))
FEATURES.add("envelope_offset_mps", Feature("m/s", KIM_LING, offset_mps, SIDES))
FEATURES.add("torso_bandwidth_mps", Feature("m/s", KIM_LING, torso_bandwidth_mps, ("envelope",)))
FEATURES.add("strength_variation", Feature("1", KIM_LING, strength_variation))
FEATURES.add(
    "envelope_periodicity",
    Feature("1", "ours: E-33 on the width between the envelopes", periodicity, ("gait_frequency", "envelope")),
)
FEATURES.add("swing_duty", Feature("1", "ours: duration of limb spikes (E-35)", swing_duty, SIDES))
