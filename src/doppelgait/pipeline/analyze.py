"""Recording -> signature, step-Doppler map and features, one result per target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from doppelgait import processing
from doppelgait.core.errors import AnalysisError
from doppelgait.pipeline.result import Result
from doppelgait.pipeline.target import analyze_gated, analyze_signature
from doppelgait.pipeline.tracked import Tracking, track_targets
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.gate import GateChoice
from doppelgait.radar.recording import Recording

__all__ = ["Result", "analyze", "analyze_signature", "flag_overlaps"]


def analyze(
    recording: Recording, *, gate: GateChoice | Gate = "track",
    analysis: Analysis | None = None, tracking: Tracking | None = None, gate_error_m: float = 0.0,
) -> list[Result]:  # fmt: skip
    """Analyse a recording, simulated or measured.

    Parameters
    ----------
    recording : Recording
    gate : {"track", "truth"}, (float, float) or Gate
        ``truth`` takes the body's true range from a simulated recording, and nothing else; two numbers are a gate that
        stays between these ranges, m; a :class:`doppelgait.processing.Gate` is used unchanged.
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
    list of Result
        One per target of the truth or per track (none where nothing was found), or one for a given gate.

    Raises
    ------
    AnalysisError
        If there is no gate to be had, or the recording is too short.
    """
    settings = (analysis or Analysis()).resolved(gate)
    if isinstance(gate, str) and gate == "track":
        return flag_overlaps(track_targets(recording, settings, tracking or Tracking()))
    baseband = processing.remove_clutter(recording.baseband, settings)
    wavelength_m = recording.radar.wavelength_m
    if isinstance(gate, tuple):
        gate = Gate.fixed(*gate, time_s=recording.slow_time_s, range_m=recording.range_m)
    if isinstance(gate, Gate):
        return [analyze_gated(baseband, wavelength_m, gate, settings, None)]
    _check_source(recording, gate)
    gates = [
        Gate.from_truth(truth, recording.slow_time_s, settings, wavelength_m=wavelength_m, error_m=gate_error_m)
        for truth in recording.truth
    ]
    results = [
        analyze_gated(baseband, wavelength_m, gate, settings, truth.label or None)
        for gate, truth in zip(gates, recording.truth, strict=True)
    ]
    return flag_overlaps(results)


def _check_source(recording: Recording, gate: str) -> None:
    if gate != "truth":
        raise AnalysisError(f"gate {gate!r} is not known; allowed are 'track', 'truth', two ranges or a Gate")
    if not recording.truth:
        raise AnalysisError(
            f"{recording.source}: has no truth, so --gate truth is not possible; take --gate track, or give the range, "
            "--gate 1.2:2.8"
        )


def flag_overlaps(results: Sequence[Result]) -> list[Result]:
    """The results, with the flag ``gates_overlap`` where another target's gate shares range with a target's own."""
    return [
        replace(result, flags=(*result.flags, "gates_overlap"))
        if any(other is not result and result.gate.overlaps(other.gate) for other in results)
        else result
        for result in results
    ]
