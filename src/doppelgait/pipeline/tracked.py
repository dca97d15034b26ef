"""Targets found without the truth: tracks of moving bodies, and people who keep still."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from doppelgait import processing
from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.core.labels import axis, sampling_rate_hz
from doppelgait.features import GaitFeatures
from doppelgait.features.ground_motion import piece_motion
from doppelgait.pipeline.result import Result
from doppelgait.pipeline.target import analyze_gated
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.breathing import BreathingSettings, BreathingTarget, find_breathing
from doppelgait.processing.clutter import share_removed, torso_share_removed
from doppelgait.processing.common_phase import without_common_phase
from doppelgait.processing.config import MIN_CPI_PULSES
from doppelgait.processing.detect import Detector, find_scans
from doppelgait.processing.pieces import PieceSettings, find_pieces
from doppelgait.processing.track import Track, Tracker, track
from doppelgait.radar.recording import Recording

LEAST_BREATHING_S, LEAST_BREATHING_HZ = 10.0, 3.0
NEAR_M = 1.0
"""A breath so near to a track is that of the tracked body."""
CLUTTER_SHARE = 0.2
"""From this share of a gate's power lost to clutter removal on, the torso may have gone with it."""
STILL_SPAN_M = 0.6


class Tracking(FrozenModel):
    """How ``gate = "track"`` finds targets.

    Parameters
    ----------
    detector : Detector
        Clutter, thresholds and clusters of one scan.
    tracker : Tracker
        From scan to scan.
    pieces : PieceSettings
        Where a track is cut.
    breathing : BreathingSettings
        People who keep still.
    """

    detector: Detector = Detector()
    tracker: Tracker = Tracker()
    pieces: PieceSettings = PieceSettings()
    breathing: BreathingSettings = BreathingSettings()


def track_targets(recording: Recording, analysis: Analysis, tracking: Tracking) -> list[Result]:
    """Results of all bodies that are found in a recording, those that move first, in the order of their appearance.

    Parameters
    ----------
    recording : Recording
        Its truth is not looked at.
    analysis : Analysis
        As :meth:`doppelgait.processing.Analysis.resolved` returns it for tracks.
    tracking : Tracking
    """
    raw, wavelength_m = without_common_phase(recording.baseband), recording.radar.wavelength_m
    clean = processing.remove_clutter(raw, analysis)
    tracks = _tracks(raw, wavelength_m, tracking)
    moving = [_follow(raw, clean, wavelength_m, found, analysis, tracking) for found in tracks]
    still = [
        _still_result(clean, wavelength_m, person, analysis)
        for person in _breathing(recording.baseband, wavelength_m, tracking)
        if not any(_is_near(person, found) for found in tracks)
    ]
    return moving + still


def _tracks(raw: xr.DataArray, wavelength_m: float, tracking: Tracking) -> list[Track]:
    prf_hz = sampling_rate_hz(axis(raw, "slow_time"))
    if prf_hz * tracking.detector.cpi_s < MIN_CPI_PULSES:
        warnings.warn(
            f"frame rate {prf_hz:g} Hz: radial speeds are unambiguous to {wavelength_m * prf_hz / 4:.2g} m/s only and "
            f"{tracking.detector.cpi_s:g} s hold fewer than {MIN_CPI_PULSES} frames; moving bodies are not looked for, "
            "only people who keep still",
            DoppelgaitWarning,
            stacklevel=4,
        )
        return []
    scans = find_scans(raw, tracking.detector, wavelength_m=wavelength_m, in_phase=True)
    return track(scans, tracking.tracker, velocity_span_mps=wavelength_m * prf_hz / 2)


def _follow(
    raw: xr.DataArray, clean: xr.DataArray, wavelength_m: float, found: Track, analysis: Analysis, tracking: Tracking
) -> Result:
    """Result of one track: that of its longest piece of steady motion, with those of all pieces."""
    gate = Gate.from_track(
        found, span_m=analysis.gate_span_m, time_s=axis(raw, "slow_time"), cpi_s=tracking.detector.cpi_s,
        doppler_hz=analysis.gate_doppler_hz,
    )  # fmt: skip
    pieces = find_pieces(found.times_s, found.range_m, settings=tracking.pieces)
    usable = [piece for piece in pieces if piece.usable]
    results = [
        _piece_result(raw, clean, wavelength_m, found, gate.during(piece.start_s, piece.stop_s), analysis)
        for piece in usable
    ]
    facts = {**_track_facts(found), "n_pieces": len(results)}
    if not results:
        whole = _piece_result(raw, clean, wavelength_m, found, gate, analysis)
        reasons = sorted({piece.reason for piece in pieces}) or ["too_short"]
        flags = (*whole.flags, *(f"no_steady_piece:{reason}" for reason in reasons))
        return replace(whole, quality={**whole.quality, **facts}, flags=flags)
    longest = max(range(len(usable)), key=lambda n: usable[n].stop_s - usable[n].start_s)
    return replace(
        results[longest], quality={**results[longest].quality, **facts}, gate_limits=gate, segments=tuple(results)
    )


def _piece_result(
    raw: xr.DataArray, clean: xr.DataArray, wavelength_m: float, found: Track, gate: Gate, analysis: Analysis
) -> Result:
    result = analyze_gated(gate.crop(clean), wavelength_m, gate, analysis, None)
    start_s, stop_s = gate.start_s, gate.stop_s
    flags = [*result.flags, *_aspect_flags(found, start_s, stop_s)]
    lost = _lost(raw, clean, gate, wavelength_m, analysis)
    if lost > CLUTTER_SHARE:
        flags.append(f"clutter_removal_took_{100 * lost:.0f}_per_cent:a_torso_without_radial_speed_may_be_gone")
    quality = {"start_s": start_s, "stop_s": stop_s, "clutter_share_removed": lost}
    return replace(result, quality={**result.quality, **quality}, flags=tuple(dict.fromkeys(flags)))


def _lost(raw: xr.DataArray, clean: xr.DataArray, gate: Gate, wavelength_m: float, analysis: Analysis) -> float:
    """Share of the gate's power that went with the clutter: as measured where a reference is known, and by the gain."""
    if analysis.clutter == "none":
        return 0.0
    measured = share_removed(raw, clean, gate).values
    known = measured[np.isfinite(measured)]
    times_s = axis(raw, "slow_time")
    by_gain = torso_share_removed(
        gate, gate.time_s, kind=analysis.clutter, wavelength_m=wavelength_m, prf_hz=sampling_rate_hz(times_s),
        n_pulses=times_s.size, clutter_time_s=analysis.clutter_time_s,
    )  # fmt: skip
    return max(float(known.mean()) if known.size else 0.0, float(by_gain.mean()))


def _aspect_flags(found: Track, start_s: float, stop_s: float) -> Iterator[str]:
    inside = (found.times_s >= start_s - 1e-9) & (found.times_s <= stop_s + 1e-9)
    if inside.sum() < 3:
        return
    seen = piece_motion(found.times_s, found.range_m, start_s=start_s, stop_s=stop_s).visibility
    if seen == "hidden":
        yield "aspect_beyond_75_deg:gait_is_hidden"


def _track_facts(found: Track) -> dict[str, Any]:
    return {
        "track_start_s": found.first_s,
        "track_stop_s": found.last_s,
        "track_confirmed_at_s": found.confirmed_at_s,
        "track_confidence": found.confidence,
        "track_range_m": float(found.range_m.mean()),
    }


def _breathing(raw: xr.DataArray, wavelength_m: float, tracking: Tracking) -> list[BreathingTarget]:
    times_s = axis(raw, "slow_time")
    short = times_s[-1] - times_s[0] < LEAST_BREATHING_S or sampling_rate_hz(times_s) < LEAST_BREATHING_HZ
    if short or raw.sizes["range"] < 2:
        return []
    return find_breathing(raw, wavelength_m=wavelength_m, settings=tracking.breathing)


def _is_near(person: BreathingTarget, found: Track) -> bool:
    return bool((np.abs(found.range_m - person.range_m) < NEAR_M).any())


def _still_result(clean: xr.DataArray, wavelength_m: float, person: BreathingTarget, analysis: Analysis) -> Result:
    """Result of a person who keeps still: a breath, no gait."""
    prf_hz = sampling_rate_hz(axis(clean, "slow_time"))
    slow = analysis.model_copy(update={"cpi_s": max(analysis.cpi_s, 3 * MIN_CPI_PULSES / prf_hz)})
    span_m = STILL_SPAN_M / 2
    gate = Gate.fixed(person.range_m - span_m, person.range_m + span_m, time_s=axis(clean, "slow_time"), source="track")
    result = analyze_gated(clean, wavelength_m, gate, slow, None)
    quality = {
        "breathing_rate_hz": person.rate_hz,
        "breathing_displacement_m": person.displacement_m,
        "breathing_snr_db": person.snr_db,
        "breathing_confidence": person.confidence,
        "track_range_m": person.range_m,
        "start_s": person.start_s,
        "stop_s": person.stop_s,
        **{name: result.quality[name] for name in ("observation_s", "noise_floor_v2") if name in result.quality},
    }
    return replace(
        result, features=GaitFeatures(torso_velocity_mps=0.0), gait_frequency_hz=None, torso_doppler_hz=0.0,
        n_periods=None, quality=quality, flags=("keeps_still:found_by_breathing", "gait:none"),
    )  # fmt: skip
