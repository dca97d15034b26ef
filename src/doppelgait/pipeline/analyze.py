"""Recording -> signature, step-Doppler map and features, one result per target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait import processing
from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import axis
from doppelgait.pipeline.target import TargetResult, analyze_gated, analyze_signature
from doppelgait.pipeline.tracked import Tracking, track_targets
from doppelgait.processing import Analysis
from doppelgait.radar.recording import Recording, TargetTruth

__all__ = ["TargetResult", "analyze", "analyze_signature", "flag_overlaps", "gate_of_truth", "truth_gate"]

GateSource = Literal["truth", "track"]

LILAND_SPAN_M = {"human": 1.0, "dog": 1.5}
"""Gate span by class in the report (its Table 4.1): the label leaks into the signature; for reproduction only."""


def analyze(
    recording: Recording, *, gate: GateSource | tuple[float, float] | xr.Dataset = "track",
    analysis: Analysis | None = None, tracking: Tracking | None = None, gate_error_m: float = 0.0,
) -> list[TargetResult]:  # fmt: skip
    """Analyse a recording, simulated or measured.

    Parameters
    ----------
    recording : Recording
    gate : {"track", "truth"}, (float, float) or Dataset
        ``truth`` takes the body's true range from a simulated recording, and nothing else; two numbers are a gate that
        stays between these ranges, m; a Dataset from :func:`doppelgait.processing.make_gate` is used as it is.
        ``track`` (the default) finds and follows moving bodies without any truth, and people who keep still by their
        breath; static clutter is taken off then even if ``analysis`` does not ask for it.
    analysis : Analysis, optional
        Parameters; the defaults of :class:`doppelgait.processing.Analysis`.
    tracking : Tracking, optional
        Parameters of ``track``.
    gate_error_m : float
        Constant range error added to a truth gate, as a tracker would have.

    Returns
    -------
    list of TargetResult
        One per target of the truth or per track (none where nothing was found), or one for a given gate.

    Raises
    ------
    AnalysisError
        If there is no gate to be had, or the recording is too short.
    """
    settings = analysis or Analysis()
    if isinstance(gate, str) and gate == "track":
        return flag_overlaps(track_targets(recording, settings, tracking or Tracking()))
    baseband = processing.remove_clutter(recording.baseband, settings)
    wavelength_m = recording.radar.wavelength_m
    if isinstance(gate, tuple):
        gate = processing.fixed_gate(axis(baseband, "slow_time"), *_within(axis(baseband, "range"), *gate))
    if isinstance(gate, xr.Dataset):
        return [analyze_gated(baseband, wavelength_m, gate, settings, None)]
    _check_source(recording, gate)
    gates = [truth_gate(recording, truth, settings, gate_error_m) for truth in recording.truth]
    results = [
        analyze_gated(baseband, wavelength_m, gate, settings, truth.label or None)
        for gate, truth in zip(gates, recording.truth, strict=True)
    ]
    return flag_overlaps(results)


def _within(range_m: npt.NDArray[np.float64], low_m: float, high_m: float) -> tuple[float, float]:
    """A fixed gate cut to the cells of the frame; one beside it is an error that says where the frame is."""
    if range_m.size == 1 or not low_m < high_m:
        return low_m, high_m
    half_m = float(range_m[1] - range_m[0]) / 2
    first_m, last_m = float(range_m[0]) - half_m, float(range_m[-1]) + half_m
    if high_m <= first_m or low_m >= last_m:
        raise AnalysisError(
            f"gate {low_m:g} to {high_m:g} m: lies outside the recorded frame, {first_m:.2f} to {last_m:.2f} m"
        )
    return max(low_m, first_m), min(high_m, last_m)


def _check_source(recording: Recording, gate: str) -> None:
    if gate != "truth":
        raise AnalysisError(f"gate {gate!r} is not known; allowed are 'track', 'truth', two ranges or a gate dataset")
    if not recording.truth:
        raise AnalysisError(
            f"{recording.source}: has no truth, so --gate truth is not possible; take --gate track, or give the range, "
            "--gate 1.2:2.8"
        )


def flag_overlaps(results: Sequence[TargetResult]) -> list[TargetResult]:
    """The results, with the flag ``gates_overlap`` where another target's gate shares range with a target's own."""
    return [
        replace(result, flags=(*result.flags, "gates_overlap"))
        if any(other is not result and _overlap(result.gate_limits, other.gate_limits) for other in results)
        else result
        for result in results
    ]


def _overlap(gate: xr.Dataset, other: xr.Dataset) -> bool:
    times, others = axis(gate, "time"), axis(other, "time")
    both = times[(times >= others[0]) & (times <= others[-1])]

    def limit(limits: xr.Dataset, name: str) -> npt.NDArray[np.float64]:
        return np.asarray(np.interp(both, axis(limits, "time"), limits[name].values))

    below = limit(gate, "range_low") < limit(other, "range_high")
    return bool((below & (limit(other, "range_low") < limit(gate, "range_high"))).any())


def truth_gate(recording: Recording, truth: TargetTruth, analysis: Analysis, error_m: float = 0.0) -> xr.Dataset:
    """Gate around the true range of the body; the report's method adds span by class and the true Doppler band."""
    slow_time_s = recording.slow_time_s
    return gate_of_truth(slow_time_s, truth, analysis, wavelength_m=recording.radar.wavelength_m, error_m=error_m)


def gate_of_truth(
    slow_time_s: npt.ArrayLike, truth: TargetTruth, analysis: Analysis, *, wavelength_m: float, error_m: float
) -> xr.Dataset:
    """As :func:`truth_gate`, from the pulse times alone."""
    span_m, band_hz = analysis.gate_span_m, analysis.gate_doppler_hz
    if analysis.method == "liland2018":
        span_m = LILAND_SPAN_M.get(truth.label, LILAND_SPAN_M["human"])
        doppler_hz = truth.doppler_hz(wavelength_m)
        band_hz = (float(doppler_hz.min()), float(doppler_hz.max()))
    return processing.make_gate(
        slow_time_s, truth.centre_range_m + error_m, span_m=span_m, doppler_hz=band_hz, source="truth"
    )
