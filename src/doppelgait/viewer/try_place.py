"""Where the movers of "Try it" are: never nearer to the radar than a metre, and within what it sees."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from doppelgait.core.errors import ConfigError
from doppelgait.viewer.try_limits import seen_m

NEAREST_M = 1.0
"""Nearer a body fills the beam, and the moment of passing holds all the power that the SNR is measured by."""
BESIDE_M = 1.0
"""Way between two movers."""
STEP_M = 0.1


def middle_range_m(values: Mapping[str, Any]) -> float:
    """Range in the middle of the time: what was asked for, or the next farther that keeps all movers away enough.

    Raises
    ------
    ConfigError
        If the radar does not see that far.
    """
    asked_m, (start_m, stop_m) = float(values["range_m"]), seen_m(str(values["radar"]))
    if stop_m is not None and asked_m > stop_m:
        raise ConfigError(
            f"range_m: {asked_m:g} is not allowed: the radar {values['radar']} sees {start_m:.3g} to {stop_m:.3g} m; "
            "take x4-long or come nearer"
        )
    allowed_m, steps = max(NEAREST_M, start_m), 0
    while nearest_m(values, asked_m + steps * STEP_M) < allowed_m - 1e-9:
        steps += 1
    return round(asked_m + steps * STEP_M, 4)


def nearest_m(values: Mapping[str, Any], range_m: float) -> float:
    """Least distance of the movers' ways from the radar, m, if they are at a range in the middle of the time."""
    half_m = float(values.get("speed_mps", 0.0)) * float(values["duration_s"]) / 2.0
    heading = math.radians(180.0 + float(values["aspect_deg"]))
    sides = [0.0] if values.get("company", "nobody") == "nobody" else [0.0, BESIDE_M]
    found = []
    for side_m in sides:
        along_m, across_m = range_m * math.cos(heading), side_m - range_m * math.sin(heading)
        found.append(math.hypot(max(abs(along_m) - half_m, 0.0), across_m))
    return min(found)


def moved_note(values: Mapping[str, Any]) -> tuple[str, ...]:
    """Sentence that says that the movers stand elsewhere than asked for; none if they do not."""
    asked_m, taken_m = float(values["range_m"]), middle_range_m(values)
    if taken_m == asked_m:
        return ()
    allowed_m = max(NEAREST_M, seen_m(str(values["radar"]))[0])
    return (
        f"range: {taken_m:g} m in the middle of the time instead of {asked_m:g} m, so that nobody comes nearer to the "
        f"radar than {allowed_m:.3g} m",
    )


def beside(range_m: float, aspect_deg: float) -> dict[str, float]:
    """Place of a second mover, to the side of the first and on a parallel way."""
    heading = math.radians(180.0 + aspect_deg)
    x, y = range_m - BESIDE_M * math.sin(heading), BESIDE_M * math.cos(heading)
    bearing_deg = math.degrees(math.atan2(y, x))
    turned = (aspect_deg - bearing_deg + 180.0) % 360.0 - 180.0
    return {"range_m": round(math.hypot(x, y), 4), "bearing_deg": round(bearing_deg, 3), "aspect_deg": round(turned, 3)}
