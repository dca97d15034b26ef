"""Recording -> signature, step-Doppler map and features, one result per target."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait import features as feature_layer
from doppelgait import processing
from doppelgait.core.errors import AnalysisError
from doppelgait.features import liland2018
from doppelgait.features.gait import Evidence, Extraction, GaitFeatures
from doppelgait.processing import Analysis
from doppelgait.radar.recording import Recording, TargetTruth

GateSource = Literal["truth", "track"]

LILAND_SPAN_M = {"human": 1.0, "dog": 1.5}
"""Gate span by class in the report (its Table 4.1): the label leaks into the signature; for reproduction only."""


@dataclass(frozen=True)
class TargetResult:
    """What the analysis says about one target.

    Parameters
    ----------
    label : str or None
        Class as stated by the recording's truth; None for measured recordings.
    gate : str
        Where the gate came from: ``"truth"``, ``"track"`` or ``"given"``.
    features : GaitFeatures
    gait_frequency_hz, torso_doppler_hz, n_periods : float or None
    quality : mapping
    flags : tuple of str
    signature, normalised_signature : DataArray (time, doppler)
    cadence_map : DataArray (cadence, doppler)
    cadence_spectrum : DataArray (cadence)
    mean_doppler_spectrum : ndarray, shape (K,)
        D_1 of the normalised signature.
    main_line_hz : ndarray, shape (J,)
        Main Doppler line whose mean is ``torso_doppler_hz``.
    gate_limits : Dataset (time)
    """

    label: str | None
    gate: str
    features: GaitFeatures
    gait_frequency_hz: float | None
    torso_doppler_hz: float | None
    n_periods: float | None
    quality: Mapping[str, Any]
    flags: tuple[str, ...]
    signature: xr.DataArray
    normalised_signature: xr.DataArray
    cadence_map: xr.DataArray
    cadence_spectrum: xr.DataArray
    mean_doppler_spectrum: npt.NDArray[np.float64]
    main_line_hz: npt.NDArray[np.float64]
    gate_limits: xr.Dataset


def analyze(
    recording: Recording, *, gate: GateSource | xr.Dataset = "track", analysis: Analysis | None = None,
    gate_error_m: float = 0.0,
) -> list[TargetResult]:  # fmt: skip
    """Analyse a recording, simulated or measured.

    Parameters
    ----------
    recording : Recording
    gate : {"track", "truth"} or Dataset
        ``truth`` takes the body's true range from a simulated recording, and nothing else; a Dataset from
        :func:`doppelgait.processing.make_gate` is used as it is. ``track`` (the default) is not available yet.
    analysis : Analysis, optional
        Parameters; the defaults of :class:`doppelgait.processing.Analysis`.
    gate_error_m : float
        Constant range error added to a truth gate, as a tracker would have.

    Returns
    -------
    list of TargetResult
        One per target of the truth, or one for a given gate.

    Raises
    ------
    AnalysisError
        If there is no gate to be had, or the recording is too short.
    """
    settings = analysis or Analysis()
    if isinstance(gate, xr.Dataset):
        return [_analyze_target(recording, gate, settings, None)]
    if gate == "track":
        raise AnalysisError(
            "gate 'track' (finding targets without the truth) is not built yet; for a simulated recording ask for "
            "the true range with --gate truth (gate='truth'), or pass a gate made with processing.make_gate"
        )
    if gate != "truth":
        raise AnalysisError(f"gate {gate!r} is not known; allowed are 'track', 'truth' or a gate dataset")
    if not recording.truth:
        raise AnalysisError(f"{recording.source}: has no truth, so --gate truth is not possible")
    return [
        _analyze_target(recording, truth_gate(recording, truth, settings, gate_error_m), settings, truth.label or None)
        for truth in recording.truth
    ]


def truth_gate(recording: Recording, truth: TargetTruth, analysis: Analysis, error_m: float = 0.0) -> xr.Dataset:
    """Gate around the true range of the body; the report's method adds span by class and the true Doppler band."""
    slow_time_s = recording.baseband.coords["slow_time"].values
    span_m, band_hz = analysis.gate_span_m, analysis.gate_doppler_hz
    if analysis.method == "liland2018":
        span_m = LILAND_SPAN_M.get(truth.label, LILAND_SPAN_M["human"])
        doppler_hz = truth.doppler_hz(recording.radar.wavelength_m)
        band_hz = (float(doppler_hz.min()), float(doppler_hz.max()))
    return processing.make_gate(
        slow_time_s, truth.centre_range_m + error_m, span_m=span_m, doppler_hz=band_hz, source="truth"
    )


def _analyze_target(recording: Recording, gate: xr.Dataset, analysis: Analysis, label: str | None) -> TargetResult:
    mu = processing.signature(recording.baseband, gate, analysis, wavelength_m=recording.radar.wavelength_m)
    chain = _liland_chain if analysis.method == "liland2018" else _standard_chain
    extraction, arrays = chain(mu, analysis)
    return TargetResult(
        label=label,
        gate=str(gate.attrs["source"]),
        features=extraction.features,
        gait_frequency_hz=extraction.gait_frequency_hz,
        torso_doppler_hz=extraction.torso_doppler_hz,
        n_periods=extraction.n_periods,
        quality=extraction.quality,
        flags=extraction.flags,
        signature=mu,
        gate_limits=gate,
        **arrays,
    )


def _standard_chain(mu: xr.DataArray, analysis: Analysis) -> tuple[Extraction, dict[str, Any]]:
    """E-28 to E-38: floor, normalise, align, detrend, cadence, features."""
    floor_v2 = processing.noise_floor_v2(mu)
    normalised = processing.normalise(mu, floor_v2, mode=analysis.normalisation)
    seconds = processing.observation_s(mu)
    straight = processing.main_line_hz(mu, order=1, tapered=True)
    excess = mu.copy(data=mu.values - np.float32(floor_v2))
    aligned = normalised
    if processing.needs_alignment(mu):
        line = processing.main_line_hz(mu, order=processing.line_order(seconds))
        aligned, excess = processing.align(normalised, line), processing.align(excess, line)
    rows = processing.detrend(aligned, order=processing.detrend_order(seconds))
    step_doppler = processing.cadence_map(rows)
    spectrum = processing.cadence_spectrum(step_doppler)
    evidence = Evidence(
        signature=mu, floor_v2=floor_v2, main_line_hz=straight, excess=excess, aligned=aligned,
        step_doppler=step_doppler, spectrum=spectrum, gait=feature_layer.gait_frequency(spectrum, rows),
        observation_s=seconds, n_independent=processing.independent_columns(mu),
    )  # fmt: skip
    extraction = feature_layer.extract(
        evidence,
        bandwidth_threshold=analysis.bandwidth_threshold,
        cpi_s=analysis.cpi_s,
        window_steepness=analysis.window_steepness,
    )
    return extraction, _arrays(normalised, step_doppler, spectrum, straight)


def _liland_chain(mu: xr.DataArray, analysis: Analysis) -> tuple[Extraction, dict[str, Any]]:
    """The report's chain: columns over their maximum, mean removed, plain transform, sum over Doppler."""
    normalised = processing.normalise(mu, 0.0, mode="max")
    rows = processing.detrend(normalised, order=0)
    step_doppler = processing.cadence_map(rows, padded=False, tapered=False)
    spectrum = processing.cadence_spectrum(step_doppler, power=False)
    extraction = liland2018.extract(
        processing.mean_doppler_spectrum(normalised),
        mu.coords["doppler"].values,
        spectrum,
        wavelength_m=float(mu.attrs["wavelength_m"]),
        threshold=analysis.bandwidth_threshold,
    )
    line = np.full(mu.sizes["time"], extraction.torso_doppler_hz)
    return extraction, _arrays(normalised, step_doppler, spectrum, line)


def _arrays(
    normalised: xr.DataArray, step_doppler: xr.DataArray, spectrum: xr.DataArray, line: npt.NDArray[np.float64]
) -> dict[str, Any]:
    return {
        "normalised_signature": normalised,
        "cadence_map": step_doppler,
        "cadence_spectrum": spectrum,
        "mean_doppler_spectrum": processing.mean_doppler_spectrum(normalised),
        "main_line_hz": line,
    }
