"""Six gait features with their quality (E-34 to E-39)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from operator import attrgetter
from typing import Any

from doppelgait.core.labels import SIGNATURE, Signal, measures_signal
from doppelgait.core.plugins import plugin
from doppelgait.features.doppler import (
    LEAST_NOISE_SIGMAS,
    WIDTH_LEVEL,
    bandwidth_threshold_hz,
    compute_quantile,
    compute_snr_db,
    single_tone_width_hz,
    strongest_cells_v2,
)
from doppelgait.features.feature_set import FEATURE_UNITS, Extraction, GaitFeatures
from doppelgait.features.gait_frequency import GaitFrequency
from doppelgait.features.harmonics import LimbTorsoRatio, highest_cadence_hz, peak_ratio, ratio_of_rows
from doppelgait.features.observed import MIN_SNR_DB, Observation

MAX_HOP_SHARE = 0.5
"""Largest hop as a share of the processing interval; with a larger hop the modulation aliases."""
MIN_PERIODS = 1.5
LOW_CONFIDENCE = 0.7
CLOSE_OCTAVE = 0.1
"""Probability of half or twice f_mu above which the decision between step and stride is flagged as close."""
FULL_BAND_SHARE = 0.9
"""Bandwidth between envelopes above which Doppler may be folded, as a share of the pulse rate."""
NO_GAIT_RATIO = 0.1
"""Smallest limb-torso ratio rho of a target with a gait; walkers and dogs have 0.4 or more."""


@measures_signal(SIGNATURE)
def snr_mu_db(signature: Signal, floor_v2: float) -> float:
    """Compute the signature SNR in dB.

    The SNR is the median over time of (strongest cell - floor) / floor; inf without noise.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> round(dg.features.snr_mu_db(result.signature, result.quality["noise_floor_v2"]))
    22
    """
    return compute_snr_db(strongest_cells_v2(signature), floor_v2)


def extract(observed: Observation, *, bandwidth_threshold: float, cpi_s: float, window_steepness: float) -> Extraction:
    """Extract six features from a target's signature (E-34 to E-38).

    Parameters
    ----------
    observed : Observed
    bandwidth_threshold : float
        t_mu of the threshold form of the bandwidth.
    cpi_s, window_steepness : float
        T_d and sigma_w, for the width of a single line.

    Returns
    -------
    Extraction
        If nothing is above the noise, all features are None and the flag is ``no_signal``.

    See Also
    --------
    doppelgait.analyze : analyze a recording, from baseband to features.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> from doppelgait.pipeline.target import observe
    >>> observed = observe(result.signature, result.analysis)
    >>> found = dg.features.extract(observed, bandwidth_threshold=0.04, cpi_s=0.1, window_steepness=0.4)
    >>> round(found.features.torso_velocity_mps, 1), round(found.features.step_length_m, 1)
    (1.2, 0.7)
    """
    quality: dict[str, Any] = {
        "snr_mu_db": observed.snr_db,
        "noise_floor_v2": observed.floor_v2,
        "observation_s": observed.observation_s,
    }
    if not observed.snr_db > MIN_SNR_DB:
        return Extraction(GaitFeatures(), None, None, None, quality, ("no_signal",))
    flags: list[str] = []
    torso_hz, velocity_mps, gait = observed.torso_hz, observed.torso_mps, observed.gait
    if not observed.agreed:
        flags.append("torso_velocity,step_length:main_line_differs_from_track")
    bandwidth_hz = None
    if compute_quantile(observed.width_level_v2, 0.5) < LEAST_NOISE_SIGMAS * observed.noise_sd_v2:
        flags.append("doppler_bandwidth:noise_above_its_level")
    elif math.isnan(observed.width_bins) or not observed.width_level_v2.any():
        flags.append("doppler_bandwidth:signal_in_too_few_columns")
    else:
        bandwidth_hz = observed.width_bins * observed.bin_mps / observed.mps_per_hz
        if observed.is_folded:  # the blur of the window below 0 Hz lies on the side above
            bandwidth_hz += (
                single_tone_width_hz(cpi_s=cpi_s, window_steepness=window_steepness, threshold=WIDTH_LEVEL) / 2
            )
    full_hz, band_mps = observed.envelope_width_hz, observed.bin_mps * observed.velocity_mps.size
    if full_hz is not None and full_hz * observed.mps_per_hz > FULL_BAND_SHARE * band_mps:
        flags.append("doppler_band_full:aliasing_is_possible")
    frequency_hz = _check_frequency(gait, observed.signature.attrs, flags)
    rho = LimbTorsoRatio(None, None)
    if frequency_hz is not None and observed.occupied_rows.size:
        cadence_hz, values = observed.cadence_parts.rows(observed.occupied_rows, highest_cadence_hz(frequency_hz))
        rho = ratio_of_rows(cadence_hz, values, observed.mean_row[observed.occupied], frequency_hz)
    if rho.ratio is not None and rho.ratio < NO_GAIT_RATIO:
        flags.append("gait_frequency:no_modulation")
        frequency_hz = None
    step_m = second = third = None
    if frequency_hz is None:
        flags.append("step_length,harmonic_ratios,limb_torso_ratio:need_a_gait_frequency")
    else:
        cadence_hz, power = observed.spectrum.axis("cadence"), observed.spectrum.values
        second, third = (peak_ratio(cadence_hz, power, frequency_hz, h) for h in (2, 3))
        for number, value in ((2, second), (3, third)):
            if value is None:
                flags.append(f"harmonic_ratio_{number}:no_peak_6_db_above_its_surroundings")
        if rho.ratio is None:
            flags.append("limb_torso_ratio:no_doppler_row_above_the_noise")
        step_m = abs(velocity_mps or 0.0) / frequency_hz
    ratio = None if frequency_hz is None else rho.ratio
    features = GaitFeatures(velocity_mps, bandwidth_hz, step_m, second, third, ratio)
    threshold_hz = bandwidth_threshold_hz(
        observed.mean_row, observed.aligned.axis("doppler"), threshold=bandwidth_threshold
    ) - single_tone_width_hz(cpi_s=cpi_s, window_steepness=window_steepness, threshold=bandwidth_threshold)
    quality |= {
        "periodicity": gait.periodicity,
        "salience": gait.salience,
        "second_candidate_hz": gait.second_hz,
        "gait_confidence": gait.confidence,
        "gait_half_probability": gait.half_probability,
        "gait_double_probability": gait.double_probability,
        "doppler_bandwidth_threshold_hz": threshold_hz,
        "limb_torso_amplitude_ratio": rho.amplitude_ratio,
        "track_velocity_mps": observed.track_mps,
        "main_line_drift_hz": float(observed.main_line_hz[-1] - observed.main_line_hz[0]),
    }
    periods = gait.n_periods if frequency_hz is not None else None
    return Extraction(features, frequency_hz, torso_hz, periods, quality, tuple(flags))


def _check_frequency(gait: GaitFrequency, columns: Mapping[Any, Any], flags: list[str]) -> float | None:
    if columns["hop"] > MAX_HOP_SHARE * columns["cpi_pulses"]:
        flags.append("gait_frequency:columns_do_not_overlap")
        return None
    if gait.frequency_hz is None:
        flags.append("gait_frequency:no_peak_in_the_cadence_spectrum")
        return None
    if (gait.n_periods or 0.0) < MIN_PERIODS:
        flags.append(f"gait_frequency:fewer_than_{MIN_PERIODS}_periods_observed")
        return None
    if (gait.confidence or 0.0) < LOW_CONFIDENCE:
        flags.append("low_confidence")
    if max(gait.half_probability or 0.0, gait.double_probability or 0.0) > CLOSE_OCTAVE:
        flags.append("gait_frequency:step_or_stride_is_a_close_decision")
    return gait.frequency_hz


# extract measures the whole set, because each feature needs the features before it
for _place, (_name, _source) in enumerate(
    zip(FEATURE_UNITS, ("E-34", "E-35", "E-36", "E-37", "E-37", "E-38"), strict=True)
):
    _read = attrgetter(f"extraction.features.{_name}")
    plugin("feature", _name, unit=FEATURE_UNITS[_name], source=_source, set_f=_place)(_read)
