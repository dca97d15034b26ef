"""Where the power lies: in velocity about the main line, and in cadence.

Velocity bands are in m/s, so that they hold for any carrier; at 7.29 GHz they are 20, 80 Hz and beyond. A short CPI
at a low carrier blurs them: one constant velocity is about lambda / (2 T_d) wide, 0.2 m/s there.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from doppelgait.features.observed import TORSO_BAND_MPS, FloatArray, Observed
from doppelgait.features.registry import FEATURES, Feature

STANCE_BAND_MPS = 0.3
BAND_SOURCE = "ours: power shares by velocity about the main line"
CADENCE_SOURCE = "moments of the cadence spectrum S (E-32); cadence-velocity features as in Björklund et al. 2015"


def _share(power_v2: FloatArray, observed: Observed) -> float | None:
    total = float(observed.total_power_v2.sum())
    return float(power_v2.sum()) / total if total > 0 else None


def torso_share(observed: Observed) -> float | None:
    """Share of the power within 0.4 m/s of the main line."""
    return _share(observed.torso_power_v2, observed)


def limb_share(observed: Observed) -> float | None:
    """Share of the power at 0.4 to 1.6 m/s from the main line."""
    return _share(observed.near_power_v2 - observed.torso_power_v2, observed)


def far_limb_share(observed: Observed) -> float | None:
    """Share of the power beyond 1.6 m/s from the main line: feet in full swing, and paws."""
    return _share(observed.total_power_v2 - observed.near_power_v2, observed)


def stance_share(observed: Observed) -> float | None:
    """Share of the power within 0.3 m/s of standing still: feet on the ground; None for a target as slow as they."""
    if abs(float(observed.line_mps.mean())) < STANCE_BAND_MPS + TORSO_BAND_MPS:
        return None
    share = np.clip((STANCE_BAND_MPS - np.abs(observed.velocity_mps)) / observed.bin_mps + 0.5, 0.0, 1.0)
    rows = np.flatnonzero(share)
    power = observed.power_v2[:, rows] @ share[rows] - observed.evidence.floor_v2 * share.sum()
    return _share(power * observed.range_weight, observed)


def entropy_width_mps(observed: Observed) -> float | None:
    """Width that an even spread of power with the entropy of the mean Doppler spectrum would have.

    ``exp(-sum p ln p)`` bins times their width, over the rows that stand above the noise (E-38): it does not depend on
    the transform's length, unlike the entropy itself.
    """
    mean = observed.mean_row[observed.occupied]
    mean = mean[mean > 0]
    if not mean.size:
        return None
    p = mean / mean.sum()
    return float(np.exp(-(p * np.log(p)).sum()) * observed.bin_mps)


def cadence_centroid_hz(observed: Observed) -> float | None:
    """Mean cadence from 0.5 to 20 Hz, weighted with S."""
    cadence_hz, power = observed.cadence
    total = float(power.sum())
    return float(cadence_hz @ power) / total if total > 0 else None


def cadence_bandwidth_hz(observed: Observed) -> float | None:
    """Standard deviation of the cadence from 0.5 to 20 Hz, weighted with S."""
    centroid_hz = cadence_centroid_hz(observed)
    if centroid_hz is None:
        return None
    cadence_hz, power = observed.cadence
    return float(np.sqrt(((cadence_hz - centroid_hz) ** 2 @ power) / power.sum()))


def relative_harmonic(observed: Observed, *, harmonic: int) -> float | None:
    """S at a harmonic over S at f_mu, each the highest value within half a resolution cell, without the noise (E-37).

    The noise is the median of S between the first four harmonics. None beyond the end of the cadence axis.
    """
    cadence_hz, power = observed.cadence
    frequency_hz = observed.frequency_hz
    if not cadence_hz.size or harmonic * frequency_hz > cadence_hz[-1]:
        return None
    half_cell_hz = 0.5 / observed.evidence.observation_s
    noise = observed.between_harmonics
    first, upper = (
        max(_highest(cadence_hz, power, h * frequency_hz, half_cell_hz) - noise, 0.0) for h in (1, harmonic)
    )
    return upper / first if first > 0 else None


def _highest(cadence_hz: FloatArray, power: FloatArray, centre_hz: float, reach_hz: float) -> float:
    first, last = np.searchsorted(cadence_hz, (centre_hz - reach_hz, centre_hz + reach_hz))
    return float(power[first : max(last, first + 1)].max()) if first < power.size else 0.0


FEATURES.add("torso_share", Feature("1", BAND_SOURCE, torso_share))
FEATURES.add("limb_share", Feature("1", BAND_SOURCE, limb_share))
FEATURES.add("far_limb_share", Feature("1", BAND_SOURCE, far_limb_share))
FEATURES.add("stance_share", Feature("1", "ours: power of standing feet", stance_share))
FEATURES.add("entropy_width_mps", Feature("m/s", "Shannon entropy of the mean Doppler spectrum", entropy_width_mps))
FEATURES.add("cadence_centroid_hz", Feature("Hz", CADENCE_SOURCE, cadence_centroid_hz))
FEATURES.add("cadence_bandwidth_hz", Feature("Hz", CADENCE_SOURCE, cadence_bandwidth_hz))
for _harmonic in (2, 3, 4):
    _function = partial(relative_harmonic, harmonic=_harmonic)
    _declared = Feature("1", "relative harmonic powers (E-37)", _function, ("gait_frequency",))
    FEATURES.add(f"relative_harmonic_{_harmonic}", _declared)
