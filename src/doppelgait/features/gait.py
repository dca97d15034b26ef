"""The six gait features and what qualifies them (E-34 to E-39)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.labels import axis
from doppelgait.core.units import doppler_to_velocity_mps, power_to_db
from doppelgait.features.doppler import bandwidth_of_hz, bandwidth_threshold_hz, envelopes_hz, single_tone_width_hz
from doppelgait.features.gait_frequency import GaitFrequency, settle
from doppelgait.features.harmonics import LimbTorsoRatio, limb_torso_ratio, peak_ratio
from doppelgait.features.peaks import quantile

FloatArray = npt.NDArray[np.float64]

MIN_SNR_DB = 0.0
MAX_HOP_SHARE = 0.5
"""Columns farther apart than half a processing interval do not resolve the modulation between them: it aliases."""
MIN_PERIODS = 1.5
LOW_CONFIDENCE = 0.7
"""Measured at all noise levels and views: 84 % of the models' estimates reach it and 96 % of those are within 5 %; of
recorded movers that were not looked at before 67 % and 87 % (a periodicity of 0.3: 25 % and 80 %)."""
FEW_PERIODS = 2.0
CLOSE_MARGIN = 0.25
"""Below this margin the decision for the step instead of the stride is said to be close."""
OCCUPIED_SIGMAS = 3.0
NO_GAIT_RATIO = 0.1
"""A target that oscillates less than this against its own mean (rho) has no gait; walkers and dogs: 0.4 and more."""

FEATURE_UNITS = {
    "torso_velocity_mps": "m/s",
    "doppler_bandwidth_hz": "Hz",
    "step_length_m": "m",
    "harmonic_ratio_2": "1",
    "harmonic_ratio_3": "1",
    "limb_torso_ratio": "1",
}
"""The feature set F in its order (E-39)."""


@dataclass(frozen=True)
class GaitFeatures:
    """The six features; None where one cannot be determined.

    Parameters
    ----------
    torso_velocity_mps : float or None
        v_m, positive when approaching.
    doppler_bandwidth_hz : float or None
        B_mu.
    step_length_m : float or None
        L_m = |v_m| / f_mu: radial; the stride length for asymmetric gaits.
    harmonic_ratio_2, harmonic_ratio_3 : float or None
        beta_1, beta_2.
    limb_torso_ratio : float or None
        rho.
    """

    torso_velocity_mps: float | None = None
    doppler_bandwidth_hz: float | None = None
    step_length_m: float | None = None
    harmonic_ratio_2: float | None = None
    harmonic_ratio_3: float | None = None
    limb_torso_ratio: float | None = None

    def vector(self) -> FloatArray:
        """The features in order, NaN for None, shape (6,)."""
        return np.array([np.nan if v is None else v for v in self.as_dict().values()], dtype=np.float64)

    def as_dict(self) -> dict[str, float | None]:
        """The features by name."""
        return {name: getattr(self, name) for name in FEATURE_UNITS}


@dataclass(frozen=True)
class Extraction:
    """Everything extracted from one target's signature.

    Parameters
    ----------
    features : GaitFeatures
    gait_frequency_hz, torso_doppler_hz, n_periods : float or None
        f_mu, the main line's mean Doppler, and observed periods.
    quality : mapping
        Diagnostics by name.
    flags : tuple of str
        Reasons for None values and for caution.
    """

    features: GaitFeatures
    gait_frequency_hz: float | None
    torso_doppler_hz: float | None
    n_periods: float | None
    quality: Mapping[str, Any] = field(default_factory=dict)
    flags: tuple[str, ...] = ()


@dataclass(frozen=True)
class Evidence:
    """What the processing hands over for one target; all from the recording, none from the truth.

    Parameters
    ----------
    signature : DataArray (time, doppler)
        mu, V^2.
    floor_v2 : float
        Noise floor nu.
    main_line_hz : ndarray, shape (J,)
        Straight main line.
    excess : DataArray (time, doppler)
        mu - nu, aligned as ``aligned``.
    aligned : DataArray (time, doppler)
        Normalised signature, aligned to the main line if that drifts.
    step_doppler : DataArray (cadence, doppler)
        D of the detrended ``aligned``.
    spectrum : DataArray (cadence)
        Power spectrum S.
    gait : GaitFrequency
    observation_s : float
    n_independent : float
        Independent columns J_eff.
    """

    signature: xr.DataArray
    floor_v2: float
    main_line_hz: FloatArray
    excess: xr.DataArray
    aligned: xr.DataArray
    step_doppler: xr.DataArray
    spectrum: xr.DataArray
    gait: GaitFrequency
    observation_s: float
    n_independent: float

    # what several features need, made once; .values of an xarray object costs more than many of the sums made of them
    @cached_property
    def envelopes_hz(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper Doppler envelope (E-35); shapes (J,)."""
        return envelopes_hz(self.signature, self.floor_v2)

    @cached_property
    def mean_row(self) -> FloatArray:
        """Time mean of the aligned normalised signature, D_1; shape (K,)."""
        return np.asarray(np.einsum("jk->k", self.aligned.values) / self.aligned.shape[0])

    @cached_property
    def occupied(self) -> npt.NDArray[np.bool_]:
        """Doppler rows that stand above the noise, K+ (E-38); shape (K,)."""
        return occupied_rows(self)


def snr_mu_db(signature: xr.DataArray, floor_v2: float) -> float:
    """Signature SNR: median over time of the strongest cell above the floor, over the floor, dB; inf without noise."""
    cells = signature.values
    peak = quantile(cells[np.arange(cells.shape[0]), cells.argmax(axis=1)], 0.5)  # max along rows takes twice as long
    if peak <= floor_v2:
        return -np.inf
    return float(power_to_db((peak - floor_v2) / floor_v2)) if floor_v2 > 0 else np.inf


def occupied_rows(evidence: Evidence) -> npt.NDArray[np.bool_]:
    """Doppler rows whose mean power stands 3 standard deviations above the noise, K+ (E-38); shape (K,)."""
    spread = evidence.floor_v2 / np.sqrt(evidence.signature.attrs["n_gate_bins"] * evidence.n_independent)
    return np.asarray(evidence.excess.values.mean(axis=0) > OCCUPIED_SIGMAS * spread)


def extract(evidence: Evidence, *, bandwidth_threshold: float, cpi_s: float, window_steepness: float) -> Extraction:
    """Six features from one target's signature, each in the form of E-34 to E-38.

    Parameters
    ----------
    evidence : Evidence
    bandwidth_threshold : float
        t_mu of the threshold form of the bandwidth.
    cpi_s, window_steepness : float
        T_d and sigma_w, for the width that a single line has by itself.

    Returns
    -------
    Extraction
        With all features None and the flag ``no_signal`` where nothing stands above the noise.
    """
    snr_db = snr_mu_db(evidence.signature, evidence.floor_v2)
    quality: dict[str, Any] = {
        "snr_mu_db": snr_db,
        "noise_floor_v2": evidence.floor_v2,
        "observation_s": evidence.observation_s,
    }
    if not snr_db > MIN_SNR_DB:
        return Extraction(GaitFeatures(), None, None, None, quality, ("no_signal",))
    flags: list[str] = []
    gait = settle(evidence.gait, evidence.spectrum, evidence.aligned, evidence.excess, evidence.floor_v2)
    torso_hz = float(evidence.main_line_hz.mean())
    wavelength_m = float(evidence.signature.attrs["wavelength_m"])
    velocity_mps = float(doppler_to_velocity_mps(torso_hz, wavelength_m))
    bandwidth_hz = bandwidth_of_hz(*evidence.envelopes_hz)
    if bandwidth_hz is None:
        flags.append("doppler_bandwidth:signal_in_too_few_columns")
    frequency_hz = _checked_frequency(gait, evidence.signature.attrs, flags)
    rho = _modulation(evidence, frequency_hz)
    if rho.ratio is not None and rho.ratio < NO_GAIT_RATIO:
        flags.append("gait_frequency:no_modulation")
        frequency_hz = None
    whole = GaitFeatures(torso_velocity_mps=velocity_mps, doppler_bandwidth_hz=bandwidth_hz)
    features = _with_gait(whole, evidence.spectrum, frequency_hz, rho, flags)
    threshold_hz = bandwidth_threshold_hz(
        evidence.mean_row, axis(evidence.aligned, "doppler"), threshold=bandwidth_threshold
    ) - single_tone_width_hz(cpi_s=cpi_s, window_steepness=window_steepness, threshold=bandwidth_threshold)
    quality |= {
        **_gait_quality(gait),
        "doppler_bandwidth_threshold_hz": threshold_hz,
        "limb_torso_amplitude_ratio": rho.amplitude_ratio,
        "main_line_drift_hz": float(evidence.main_line_hz[-1] - evidence.main_line_hz[0]),
    }
    periods = gait.n_periods if frequency_hz is not None else None
    return Extraction(features, frequency_hz, torso_hz, periods, quality, tuple(flags))


def _gait_quality(gait: GaitFrequency) -> dict[str, Any]:
    return {
        "periodicity": gait.periodicity,
        "salience": gait.salience,
        "second_candidate_hz": gait.second_hz,
        "limb_relative_hz": gait.limb_relative_hz,
        "gait_decision": gait.decision,
        "gait_margin": gait.margin,
        "gait_confidence": gait.confidence,
        "gait_uncertainty_hz": gait.uncertainty_hz,
    }


def _checked_frequency(gait: GaitFrequency, columns: Mapping[Any, Any], flags: list[str]) -> float | None:
    if columns["hop"] > MAX_HOP_SHARE * columns["cpi_pulses"]:
        flags.append("gait_frequency:columns_do_not_overlap")
        return None
    if gait.frequency_hz is None:
        flags.append("gait_frequency:no_peak_in_the_cadence_spectrum")
        return None
    if (gait.n_periods or 0.0) < MIN_PERIODS:
        flags.append(f"gait_frequency:fewer_than_{MIN_PERIODS}_periods_observed")
        return None
    if (gait.confidence or 0.0) < LOW_CONFIDENCE or (gait.n_periods or 0.0) < FEW_PERIODS:
        flags.append("low_confidence")
    if gait.decision in ("doubled", "limbs_doubled") and (gait.margin or 0.0) < CLOSE_MARGIN:
        flags.append("gait_frequency:step_or_stride_is_a_close_decision")
    return gait.frequency_hz


def _modulation(evidence: Evidence, frequency_hz: float | None) -> LimbTorsoRatio:
    if frequency_hz is None:
        return LimbTorsoRatio(None, None)
    return limb_torso_ratio(evidence.step_doppler, evidence.mean_row, frequency_hz, evidence.occupied)


def _with_gait(
    whole: GaitFeatures, spectrum: xr.DataArray, frequency_hz: float | None, rho: LimbTorsoRatio, flags: list[str]
) -> GaitFeatures:
    if frequency_hz is None:
        flags.append("step_length,harmonic_ratios,limb_torso_ratio:need_a_gait_frequency")
        return whole
    cadence_hz, power = axis(spectrum, "cadence"), spectrum.values
    second, third = (peak_ratio(cadence_hz, power, frequency_hz, h) for h in (2, 3))
    for number, value in ((2, second), (3, third)):
        if value is None:
            flags.append(f"harmonic_ratio_{number}:no_peak_6_db_above_its_surroundings")
    if rho.ratio is None:
        flags.append("limb_torso_ratio:no_doppler_row_above_the_noise")
    return replace(
        whole,
        step_length_m=abs(whole.torso_velocity_mps or 0.0) / frequency_hz,
        harmonic_ratio_2=second,
        harmonic_ratio_3=third,
        limb_torso_ratio=rho.ratio,
    )
