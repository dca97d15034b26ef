"""Features beyond the set F: envelopes, shares, cadence, swing.

Björklund, Petersson and Hendeby, "Features for micro-Doppler based activity classification", IET Radar, Sonar &
Navigation 9(9), 2015, describe walkers by the main cycle time and properties of the envelope. Kim and Ling, "Human
activity classification based on micro-Doppler signatures using a support vector machine", IEEE Transactions on
Geoscience and Remote Sensing 47(5), 2009, use bandwidth, offset and strength of the whole signature. The exact forms
here are specific to doppelgait: they use the quantile envelopes of E-35b, relative to the main line and in the
direction of motion.

Velocity bands are in m/s, so that they are valid for any carrier; at 7.29 GHz their limits are 20 Hz and 80 Hz. A short
CPI at a low carrier blurs the bands: a constant velocity has a width of about lambda / (2 T_d), 0.2 m/s at 7.29 GHz.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from doppelgait.core.errors import ConfigError
from doppelgait.core.plugins import plugin
from doppelgait.core.units import logarithm
from doppelgait.features.feature_set import FEATURES, NEEDS
from doppelgait.features.observed import TORSO_BAND_MPS, LinePower, Observation, compute_autocorrelation_at


def measure_extended(observed: Observation) -> dict[str, float | None]:
    """Measure a target's features beyond the set F, by name."""
    values: dict[str, float | None] = {}
    unmet = {need for need in NEEDS if observed.describe_missing((need,))}
    for feature in FEATURES.values():
        if "set_f" not in feature.facts:
            is_possible = observed.has_signal and unmet.isdisjoint(feature.facts.get("needs", ()))
            value = feature.run(observed) if is_possible else None
            if not isinstance(value, float | int | np.number | None):
                raise ConfigError(f"feature {feature.name!r}: {value!r} is no number and not None")
            values[feature.name] = float(value) if value is not None and math.isfinite(value) else None
    return values


def list_features() -> list[tuple[str, str, str]]:
    """List name, unit and source of every extended feature. The list is in alphabetical order."""
    further = [feature for feature in FEATURES.values() if "set_f" not in feature.facts]
    return [(feature.name, feature.facts["unit"], feature.facts["source"]) for feature in further]


# Envelopes -----------------------------------------------------------------------------------------------------------

BJORKLUND = "envelope properties after Björklund et al. 2015, on the envelopes of E-35b"
WIDTH = "ours: E-33 on the width between the envelopes"
PERIODS = "ours: E-33 at one and at two periods"
KIM_LING = "after Kim and Ling 2009, on the envelopes of E-35b"
SIDES = ("direction", "envelope")


@plugin("feature", "doppler_bandwidth_envelope_hz", unit="Hz", source="ours: envelopes of E-35b", needs=("envelope",))
def bandwidth_envelope_hz(observed: Observation) -> float | None:
    """Measure the bandwidth between the envelopes."""
    # 95th percentile over time of the upper envelope minus the 5th of the lower; noise matters
    return observed.envelope_width_hz


_EDGES: dict[str, Callable[[Observation], float]] = {
    "forward_envelope_mean_mps": lambda observed: observed.edges.lead_mean_mps,
    "backward_envelope_mean_mps": lambda observed: observed.edges.lag_mean_mps,
    "forward_envelope_sd_mps": lambda observed: observed.edges.lead_sd_mps,
    "backward_envelope_sd_mps": lambda observed: observed.edges.lag_sd_mps,
    "forward_envelope_range_mps": lambda observed: observed.edges.lead_high_mps - observed.edges.lead_low_mps,
    "backward_envelope_range_mps": lambda observed: observed.edges.lag_high_mps - observed.edges.lag_low_mps,
}
"""Mean reach, standard deviation and 5 to 95 % range of the leading and the trailing envelope about the main line."""

for _name, _measure in _EDGES.items():
    plugin("feature", _name, unit="m/s", source=BJORKLUND, needs=SIDES)(_measure)


@plugin("feature", "envelope_asymmetry", unit="1", source="ours: bandwidth ahead against behind (E-35b)", needs=SIDES)
def measure_asymmetry(observed: Observation) -> float | None:
    """Compare the bandwidths on both sides of the line."""
    # the asymmetry, -1 to 1, is the difference of the 95th percentiles over time, divided by their sum
    ahead, behind = observed.edges.lead_high_mps, observed.edges.lag_high_mps
    return (ahead - behind) / (ahead + behind) if ahead > 0 and behind > 0 else None


@plugin("feature", "envelope_offset_mps", unit="m/s", source=KIM_LING, needs=SIDES)
def offset_mps(observed: Observation) -> float:
    """Measure the mean offset of the envelopes from the main line."""
    return (observed.edges.lead_mean_mps - observed.edges.lag_mean_mps) / 2.0


@plugin("feature", "torso_bandwidth_mps", unit="m/s", source=KIM_LING, needs=("envelope",))
def torso_bandwidth_mps(observed: Observation) -> float:
    """Measure the smallest width between the envelopes."""
    # it is the 5th percentile over time: the bandwidth of the body without swinging limbs
    return observed.edges.least_width_mps


@plugin("feature", "strength_variation", unit="1", source=KIM_LING)
def measure_strength_variation(observed: Observation) -> float | None:
    """Measure the variation of power near the main line."""
    # the variation is the standard deviation over time divided by the mean, with the influence of
    # range removed (E-28)
    power, _, _ = observed.about_line
    return power.near_sd_v2 / power.near_mean_v2 if power.near_mean_v2 > 0 else None


@plugin("feature", "envelope_periodicity", unit="1", source=WIDTH, needs=("gait_frequency", "envelope"))
def measure_periodicity(observed: Observation) -> float | None:
    """Measure the envelope width's autocorrelation at one period."""
    # the autocorrelation is normalised and at most 1 (E-33)
    if observed.edges.seen_share < 1.0 or not observed.counted.all():  # a lag needs the width at every column
        return None
    low_hz, high_hz = observed.envelopes_hz
    width_hz = high_hz - low_hz
    return compute_autocorrelation_at(
        width_hz - width_hz.sum() / width_hz.size, observed.rate_hz / observed.frequency_hz
    )


@plugin("feature", "swing_duty", unit="1", source="ours: duration of limb spikes (E-35b)", needs=SIDES)
def measure_swing_duty(observed: Observation) -> float | None:
    """Measure the share of time with limb spikes."""
    # during a spike the leading envelope is above the middle of its range
    if observed.edges.lead_high_mps - observed.edges.lead_low_mps < 2.0 * observed.bin_mps:
        return None
    return observed.edges.swing_share


# Power and cadence ---------------------------------------------------------------------------------------------------

STANCE_BAND_MPS = 0.3
BAND_SOURCE = "ours: power shares by velocity about the main line"
HARMONIC_SOURCE = "relative harmonic powers (E-37)"
CADENCE_SOURCE = "moments of the cadence spectrum S (E-32); cadence-velocity features as in Björklund et al. 2015"


def _share(power_v2: float, observed: Observation) -> float | None:
    total = observed.about_line[0].total_v2
    return power_v2 / total if total > 0 else None


_BANDS: dict[str, Callable[[LinePower], float]] = {
    "torso_share": lambda power: power.torso_v2,
    "limb_share": lambda power: power.near_v2 - power.torso_v2,
    "far_limb_share": lambda power: power.total_v2 - power.near_v2,  # feet and paws in full swing
}
"""Power within 0.4 m/s of the main line, from there to 1.6 m/s, and beyond."""


def measure_band(observed: Observation, *, band: Callable[[LinePower], float]) -> float | None:
    """Measure the share of a band's power."""
    return _share(band(observed.about_line[0]), observed)


for _name, _band in _BANDS.items():
    plugin("feature", _name, unit="1", source=BAND_SOURCE)(partial(measure_band, band=_band))


@plugin("feature", "stance_share", unit="1", source="ours: power of standing feet")
def measure_stance_share(observed: Observation) -> float | None:
    """Measure the power share within 0.3 m/s of zero velocity."""
    # this is the share of feet on the ground; it is None for a target that is too slow to be
    # distinguished from them
    if abs(observed.mean_line_mps) < STANCE_BAND_MPS + TORSO_BAND_MPS:
        return None
    share = np.minimum(((STANCE_BAND_MPS - np.abs(observed.velocity_mps)) / observed.bin_mps + 0.5).clip(0.0), 1.0)
    rows = np.flatnonzero(share)
    first, some = (int(rows[0]), share[rows[0] : rows[-1] + 1]) if rows.size else (0, share[:0])
    weight = observed.range_weight
    power = float(weight @ (observed.power_v2[:, first : first + some.size] @ some))
    return _share(power - observed.floor_v2 * float(some.sum()) * float(weight.sum()), observed)


@plugin("feature", "entropy_width_mps", unit="m/s", source="Shannon entropy of the mean Doppler spectrum")
def entropy_width_mps(observed: Observation) -> float | None:
    """Measure the mean Doppler spectrum's entropy as a width."""
    # A uniform distribution of power with this width has the same entropy. The width is exp(-sum p
    # ln p) times the bin width, over the rows above the noise (E-38). Unlike the entropy it does
    # not depend on the transform length
    mean = observed.mean_row[observed.occupied]
    mean = mean[mean > 0]
    if not mean.size:
        return None
    p = mean / mean.sum()
    return math.exp(-(p * logarithm(p)).sum()) * observed.bin_mps


@plugin("feature", "cadence_centroid_hz", unit="Hz", source=CADENCE_SOURCE)
def cadence_centroid_hz(observed: Observation) -> float | None:
    """Compute the mean cadence from 0.5 to 20 Hz, weighted with S."""
    cadence_hz, power = observed.cadence
    total = float(power.sum())
    return float(cadence_hz @ power) / total if total > 0 else None


@plugin("feature", "cadence_bandwidth_hz", unit="Hz", source=CADENCE_SOURCE)
def cadence_bandwidth_hz(observed: Observation) -> float | None:
    """Compute the cadence's standard deviation, weighted with S, 0.5 to 20 Hz."""
    centroid_hz = cadence_centroid_hz(observed)
    if centroid_hz is None:
        return None
    cadence_hz, power = observed.cadence
    return float(np.sqrt(((cadence_hz - centroid_hz) ** 2 @ power) / power.sum()))


def compare_harmonic(observed: Observation, *, harmonic: int) -> float | None:
    """Compare S at a harmonic and f_mu (E-37)."""
    # both powers are those of harmonic_powers. The result is None beyond the end of the cadence axis
    cadence_hz, _ = observed.cadence
    frequency_hz = observed.frequency_hz
    if not cadence_hz.size or harmonic * frequency_hz > cadence_hz[-1]:
        return None
    first, upper = observed.harmonic_powers[0], observed.harmonic_powers[harmonic - 1]
    return upper / first if first > 0 else None


for _harmonic in (2, 3, 4):
    _name, _compare = f"relative_harmonic_{_harmonic}", partial(compare_harmonic, harmonic=_harmonic)
    plugin("feature", _name, unit="1", source=HARMONIC_SOURCE, needs=("gait_frequency",))(_compare)


# Torso ---------------------------------------------------------------------------------------------------------------

TORSO_LINE = "ours: torso line of E-33 about the main line"
MIN_PERIODS_OF_PAIRS = 3.0
"""Fewest observed periods from which alternate periods can be compared."""
MIN_LIKENESS = 0.1


@plugin("feature", "torso_ripple_mps", unit="m/s", source=TORSO_LINE, needs=("line",))
def ripple_mps(observed: Observation) -> float:
    """Measure the RMS torso velocity around its slow part."""
    return observed.torso_ripple_rms_mps


@plugin("feature", "torso_ripple_gait_mps", unit="m/s", source=TORSO_LINE, needs=("gait_frequency", "line"))
def ripple_at_gait_mps(observed: Observation) -> float | None:
    """Measure the RMS torso swing that repeats with f_mu."""
    return math.sqrt(0.5) * observed.ripple_parts[2]


@plugin("feature", "torso_ripple_half_mps", unit="m/s", source=TORSO_LINE, needs=("gait_frequency", "line"))
def ripple_at_half_mps(observed: Observation) -> float | None:
    """Measure the RMS torso swing at f_mu / 2."""
    # the swing is caused by sway and limp, which alternate from step to step
    if observed.frequency_hz * observed.observation_s < MIN_PERIODS_OF_PAIRS:
        return None
    return math.sqrt(0.5) * observed.ripple_parts[1]


@plugin("feature", "alternate_likeness", unit="1", source=PERIODS, needs=("gait_frequency",))
def alternate_likeness(observed: Observation) -> float | None:
    """Compare autocorrelations of neighbouring and alternate periods."""
    # the value is at most about 1. It is near 1 if a period is a step and left and right steps have
    # the same signature. It is lower if left and right, or the two halves of a stride, differ.
    # Noise lowers both autocorrelations alike. Rows without signal are left out (K+ of E-38)
    if observed.frequency_hz * observed.observation_s < MIN_PERIODS_OF_PAIRS or not observed.counted.all():
        return None
    rows = observed.occupied_columns
    rows -= observed.mean_row[observed.occupied]
    lag = observed.rate_hz / observed.frequency_hz
    once, twice = compute_autocorrelation_at(rows, lag), compute_autocorrelation_at(rows, 2.0 * lag)
    if once is None or twice is None or twice < MIN_LIKENESS:
        return None
    return once / twice
