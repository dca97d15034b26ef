"""Target panels: signature, cadence, features, gate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait import processing
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.core.labels import read_axis, replace_array_values
from doppelgait.pipeline.target import ALIGNED
from doppelgait.processing.gate import GateChoice
from doppelgait.viewer.payload import (
    MOST,
    describe_axis,
    doppler_picture,
    find_block_size,
    level_db,
    pack,
    signature_picture,
)
from doppelgait.viewer.run import Run, TargetView
from doppelgait.viewer.settings import Changes

Arrays = dict[str, npt.NDArray[Any]]

MOST_GATE_POINTS = 2000
HARMONIC_NAMES = ("2nd", "3rd")
NO_TARGET = "no target is detected: this recording has no steady motion and no breathing; try another gate"


def make_targets_payload(
    run: Run, gate: GateChoice | None, changes: Changes = (), *, segment: tuple[int, int] | None = None
) -> bytes:
    """Make the payload of ``api/targets``."""
    arrays: Arrays = {}
    # Stored targets are shown as stored, independently of the request.
    applied = () if run.has_stored_targets(gate) else changes
    done = run.analysis(gate, applied)
    facts = {"clutter": done.clutter, "analysis": run.analysis_facts(gate, applied)}
    try:
        targets, notes = run.targets(gate, changes), run.warnings(gate, changes)
    except AnalysisError as error:
        return pack({**facts, "targets": [], "reason": str(error), "notes": [], "failed": True}, {})
    views = targets if segment is None else select_segment(targets, *segment)
    shown = [_describe_target(number, view, done.method, arrays) for number, view in enumerate(views)]
    reason = None if shown else NO_TARGET
    return pack({**facts, "targets": shown, "reason": reason, "notes": [*_note_limits(gate, views), *notes]}, arrays)


def _note_limits(gate: GateChoice | None, views: Sequence[TargetView]) -> list[str]:
    """Note the range used of a gate beyond the frame."""
    limits = views[0].gate_limits if views else None
    if not isinstance(gate, tuple) or limits is None or limits.source != "given":
        return []
    used_m = float(limits.low_m.min()), float(limits.high_m.max())
    if np.allclose(used_m, gate, rtol=0.0, atol=1e-6):
        return []
    frame = "extends beyond the recorded frame"
    return [f"gate {gate[0]:g} to {gate[1]:g} m {frame}: {used_m[0]:.2f} to {used_m[1]:.2f} m is used"]


def select_segment(targets: Sequence[TargetView], number: int, segment: int) -> list[TargetView]:
    """Replace a target's view by that of another segment."""
    if number >= len(targets):
        known = f"there are targets 0 to {len(targets) - 1}" if targets else "there is no target"
        raise ConfigError(f"segment: {number}:{segment} is not allowed; {known}")
    views = targets[number].segment_views
    if segment >= len(views):
        known = (
            f"target {number} has segments 0 to {len(views) - 1}" if views else f"target {number} is shown as a whole"
        )
        raise ConfigError(f"segment: {number}:{segment} is not allowed; {known}")
    shown = replace(views[segment], segment_views=views, track_picture=targets[number].track_picture)
    return [*targets[:number], shown, *targets[number + 1 :]]


def _describe_target(number: int, view: TargetView, method: str, arrays: Arrays) -> dict[str, Any]:
    from doppelgait.viz.maps import doppler_limits_hz

    prefix = f"target_{number}_"
    signature = view.signature if view.signature is not None and view.signature.size else None
    cadence_map = view.cadence_map if view.cadence_map is not None and view.cadence_map.size else None
    pictures: dict[str, dict[str, Any] | None] = {"signature": None, "cadence_map": None}
    if view.track_picture is not None:
        facts, arrays[f"{prefix}signature"] = view.track_picture
        pictures["signature"] = {**facts, "array": f"{prefix}signature"}
    elif signature is not None:
        pictures["signature"], arrays[f"{prefix}signature"] = signature_picture(signature, f"{prefix}signature")
    lines = view.segment_views if view.track_picture is not None else (view,)
    main_lines = [_main_line(one, f"{prefix}main_line_{n}", arrays) for n, one in enumerate(lines)]
    power = None
    if cadence_map is not None:
        cadence, power = (
            describe_axis("cadence", "Hz", read_axis(cadence_map, "cadence")),
            np.square(cadence_map.values),
        )
        name = f"{prefix}cadence_map"
        pictures["cadence_map"], arrays[name] = doppler_picture(cadence_map, power, cadence, name, "dB re 1")
    spectrum = _describe_spectrum(view, f"{prefix}cadence_spectrum", method, arrays)
    gate_limits = None
    if view.gate_limits is not None:
        gate = view.gate_limits
        count = gate.time_s.size
        chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_GATE_POINTS)).round().astype(int))
        limits = {"time": gate.time_s, "low": gate.low_m, "high": gate.high_m}
        arrays.update({f"{prefix}gate_{key}": values[chosen].astype(np.float32) for key, values in limits.items()})
        gate_limits = {key: f"{prefix}gate_{key}" for key in limits}
    return {
        "number": number,
        "label": view.label,
        "gate": view.gate,
        "features": {
            **view.features,
            "gait_frequency_hz": view.gait_frequency_hz,
            "torso_doppler_hz": view.torso_doppler_hz,
        },
        "standard_deviation": view.standard_deviation,
        "quality": view.quality,
        "extended": view.extended,
        "flags": view.flags,
        "truth": view.truth,
        "signature": pictures["signature"],
        "whole_track": view.track_picture is not None,
        "main_lines": [line for line in main_lines if line is not None],
        "aligned": is_aligned(view, method),
        # Occupied rows of the cadence-velocity diagram, as in its figure.
        "cadence_band_hz": None
        if cadence_map is None or power is None
        else doppler_limits_hz(replace_array_values(cadence_map, power)),
        "cadence_map": pictures["cadence_map"],
        "cadence_spectrum": spectrum,
        "gate_limits": gate_limits,
        "segments": view.segments,
        "segment": view.segment,
    }


def _main_line(view: TargetView, name: str, arrays: Arrays) -> dict[str, Any] | None:
    """Describe a segment's main line at the picture's columns."""
    if view.signature is None or view.signature.sizes["time"] == 0 or view.main_line_hz is None:
        return None
    times_s, line_hz = read_axis(view.signature, "time"), view.main_line_hz
    block = find_block_size(times_s.size, MOST[0])
    at = np.arange(0, times_s.size, block) + (block - 1) / 2
    columns = np.arange(times_s.size)
    arrays[name] = np.interp(at, columns, line_hz).astype(np.float32)
    return {"x": describe_axis("time", "s", np.interp(at, columns, times_s)), "values": name}


def is_aligned(view: TargetView, method: str) -> bool | None:
    """Return True if the map's Doppler is relative."""
    if method == "liland2018" or view.cadence_map is None:
        return None if view.cadence_map is None else False
    if ALIGNED in view.cadence_map.attrs:
        return bool(view.cadence_map.attrs[ALIGNED])
    if view.signature is None or view.signature.sizes["time"] < 2:
        return None
    return processing.needs_alignment(view.signature)  # stored by an older version, or in a dataset


def _describe_spectrum(view: TargetView, name: str, method: str, arrays: Arrays) -> dict[str, Any] | None:
    """Describe the cadence spectrum in dB with its peaks.
    The spectrum of the report's method is a sum of magnitudes.
    """
    spectrum = view.cadence_spectrum
    if spectrum is None or spectrum.size == 0:
        return None
    values = np.square(spectrum.values) if method == "liland2018" else spectrum.values
    arrays[name] = level_db(values).astype(np.float32)
    named = [("f_mu", view.gait_frequency_hz), *zip(HARMONIC_NAMES, view.harmonics_hz, strict=False)]
    return {
        "x": describe_axis("cadence", "Hz", read_axis(spectrum, "cadence")),
        "db": name,
        "unit": "dB re 1",
        "peaks": [{"hz": hz, "name": name} for name, hz in named if hz is not None],
    }
