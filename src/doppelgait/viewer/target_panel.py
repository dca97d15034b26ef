"""What is shown of the targets: signature, step-Doppler map, cadence spectrum, features and gate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait import processing
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.core.labels import axis
from doppelgait.pipeline.target import ALIGNED
from doppelgait.processing.gate import Gate, GateChoice
from doppelgait.viewer.payload import MOST, axis_facts, block_of, doppler_facts, image_facts, level_db, pack
from doppelgait.viewer.run import Run, TargetView
from doppelgait.viewer.settings import Clutter

Arrays = dict[str, npt.NDArray[Any]]

MOST_GATE_POINTS = 2000
HARMONIC_NAMES = ("2nd", "3rd")
NO_TARGET = "no target was found: nothing moves steadily or breathes in this recording; try a gate of your own"


def targets_payload(
    run: Run, gate: GateChoice | None, clutter: Clutter | None = None, *, piece: tuple[int, int] | None = None
) -> bytes:
    """Payload of ``api/targets``; of a run that cannot be analysed so, the reason.

    Parameters
    ----------
    run : Run
    gate : str, (float, float) or None
    clutter : {"kept", "removed"}, optional
    piece : (int, int), optional
        Number of a target, and of the piece of steady motion to show of it instead of its longest.

    Raises
    ------
    ConfigError
        If there is no such target, or no such piece of it.
    """
    arrays: Arrays = {}
    # What was stored is as it was stored, whatever is asked for.
    done = run.analysis(gate, None if run.shows_stored(gate) else clutter)
    try:
        targets, notes = run.targets(gate, clutter), run.warnings(gate, clutter)
    except AnalysisError as error:
        return pack({"targets": [], "reason": str(error), "notes": [], "clutter": done.clutter}, {})
    views = targets if piece is None else with_piece(targets, *piece)
    shown = [_target(number, view, done.method, arrays) for number, view in enumerate(views)]
    reason = None if shown else NO_TARGET
    return pack({"targets": shown, "reason": reason, "notes": notes, "clutter": done.clutter}, arrays)


def with_piece(targets: Sequence[TargetView], number: int, piece: int) -> list[TargetView]:
    """The targets, of one of which another piece is shown."""
    if number >= len(targets):
        known = f"there are targets 0 to {len(targets) - 1}" if targets else "there is no target"
        raise ConfigError(f"piece: {number}:{piece} is not allowed; {known}")
    views = targets[number].piece_views
    if piece >= len(views):
        known = f"target {number} has pieces 0 to {len(views) - 1}" if views else f"target {number} is shown as a whole"
        raise ConfigError(f"piece: {number}:{piece} is not allowed; {known}")
    return [*targets[:number], views[piece], *targets[number + 1 :]]


def _target(number: int, view: TargetView, method: str, arrays: Arrays) -> dict[str, Any]:
    prefix = f"target_{number}_"
    # Rows of the step-Doppler map that are worth looking at, as in its figure.
    from doppelgait.viz.maps import doppler_limits_hz

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
        "signature": _signature(view.signature, f"{prefix}signature", arrays),
        "main_line": _main_line(view, f"{prefix}main_line", arrays),
        "aligned": is_aligned(view, method),
        "cadence_band_hz": None
        if view.cadence_map is None or view.cadence_map.size == 0
        else doppler_limits_hz(view.cadence_map**2),
        "cadence_map": _cadence_map(view.cadence_map, f"{prefix}cadence_map", arrays),
        "cadence_spectrum": _spectrum(view, f"{prefix}cadence_spectrum", method, arrays),
        "gate_limits": _gate_limits(view.gate_limits, prefix, arrays),
        "pieces": view.pieces,
        "piece": view.piece,
    }


def _wavelength_m(array: xr.DataArray) -> float:
    """Wavelength that the velocity axis was made with; NaN without such an axis."""
    doppler_hz = axis(array, "doppler")
    furthest = int(np.abs(doppler_hz).argmax())
    if "velocity" not in array.coords or doppler_hz[furthest] == 0:
        return float("nan")
    return float(2.0 * axis(array, "velocity")[furthest] / doppler_hz[furthest])


def _signature(signature: xr.DataArray | None, name: str, arrays: Arrays) -> dict[str, Any] | None:
    if signature is None or signature.size == 0:
        return None
    facts, arrays[name] = image_facts(
        name,
        signature.values,
        axis_facts("time", "s", axis(signature, "time")),
        doppler_facts(axis(signature, "doppler"), _wavelength_m(signature)),
        unit="dB re 1 V²" if signature.attrs.get("units") == "V^2" else "dB re 1",
    )
    return facts


def _main_line(view: TargetView, name: str, arrays: Arrays) -> str | None:
    """Main line at the columns of the picture: at the middle of every block of columns."""
    if view.main_line_hz is None or view.signature is None or view.signature.size == 0:
        return None
    block = block_of(view.signature.sizes["time"], MOST[0])
    at = np.arange(0, view.main_line_hz.size, block) + (block - 1) / 2
    arrays[name] = np.interp(at, np.arange(view.main_line_hz.size), view.main_line_hz).astype(np.float32)
    return name


def is_aligned(view: TargetView, method: str) -> bool | None:
    """Whether the Doppler of the step-Doppler map is measured from the main line; None where it is not known."""
    if method == "liland2018" or view.cadence_map is None:
        return None if view.cadence_map is None else False
    if ALIGNED in view.cadence_map.attrs:
        return bool(view.cadence_map.attrs[ALIGNED])
    if view.signature is None or view.signature.sizes["time"] < 2:
        return None
    return processing.needs_alignment(view.signature)  # stored by an older version, or in a dataset


def _cadence_map(cadence_map: xr.DataArray | None, name: str, arrays: Arrays) -> dict[str, Any] | None:
    if cadence_map is None or cadence_map.size == 0:
        return None
    facts, arrays[name] = image_facts(
        name,
        np.square(cadence_map.values),
        axis_facts("cadence", "Hz", axis(cadence_map, "cadence")),
        doppler_facts(axis(cadence_map, "doppler"), _wavelength_m(cadence_map)),
        unit="dB re 1",
    )
    return facts


def _spectrum(view: TargetView, name: str, method: str, arrays: Arrays) -> dict[str, Any] | None:
    """Cadence spectrum in dB with its peaks; the report's own is a sum of magnitudes."""
    spectrum = view.cadence_spectrum
    if spectrum is None or spectrum.size == 0:
        return None
    values = np.square(spectrum.values) if method == "liland2018" else spectrum.values
    arrays[name] = level_db(values).astype(np.float32)
    named = [("f_mu", view.gait_frequency_hz), *zip(HARMONIC_NAMES, view.harmonics_hz, strict=False)]
    return {
        "x": axis_facts("cadence", "Hz", axis(spectrum, "cadence")),
        "db": name,
        "unit": "dB re 1",
        "peaks": [{"hz": hz, "name": name} for name, hz in named if hz is not None],
    }


def _gate_limits(gate: Gate | None, prefix: str, arrays: Arrays) -> dict[str, Any] | None:
    if gate is None:
        return None
    count = gate.time_s.size
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_GATE_POINTS)).round().astype(int))
    lines = {"time": gate.time_s, "low": gate.low_m, "high": gate.high_m}
    for key, values in lines.items():
        arrays[f"{prefix}gate_{key}"] = values[chosen].astype(np.float32)
    return {key: f"{prefix}gate_{key}" for key in lines}
