"""Chapter 2, a recorded person walking at the radar: Figures 2.12 to 2.14."""

from __future__ import annotations

import numpy as np
import xarray as xr

from doppelgait import viz
from doppelgait.core.labels import axis
from doppelgait.reproduce.entry import Entry, Made, Reading, judged
from doppelgait.reproduce.gait_lines import (
    departure,
    forward_m,
    one_cycle_s,
    part_line,
    parts_of,
    phase_between_deg,
)
from doppelgait.reproduce.material import Material

OPPOSITE_TOLERANCE_DEG = 20.0
"""The report says "opposite phase" in words."""


def make_2_12(material: Material) -> Made:
    """Nine side views of a gait cycle."""
    person = material.person()
    motion = person.motion
    start_s, cycle_s = one_cycle_s(motion, "right_foot")
    title = "One gait cycle, right foot landing first"
    figure = viz.stick_frames(motion, start_s=start_s, duration_s=cycle_s, title=title)
    times_s = axis(motion, "time")
    ends = [int(np.abs(times_s - time).argmin()) for time in (start_s, start_s + cycle_s)]
    right_m, left_m = (part_line(forward_m(motion), f"{side}_foot") for side in ("right", "left"))
    landings = [time for times in motion.attrs["footfalls"].values() for time in times]
    steps = sum(start_s + 1e-6 < time <= start_s + cycle_s + 1e-6 for time in landings)
    readings = [
        Reading("points of the body", motion.sizes["marker"], "1", note="the report's person carries 41 markers"),
        Reading("steps in the gait cycle", steps, "1", 2.0, given=not person.real),
        Reading("right foot against the body, last view minus first", right_m[ends[1]] - right_m[ends[0]], "m", 0.0,
                0.05, "the same place to within the size of a dot", not person.real),
        Reading("right foot ahead of the left in the first view", right_m[ends[0]] - left_m[ends[0]], "m"),
    ]  # fmt: skip
    text = (
        f"the right foot lands {readings[3].ours:.2f} m before the left, and after {steps} steps is within "
        f"{abs(readings[2].ours):.2f} m of its place against the body."
    )
    return Made(figure, readings, judged(readings, text))


def make_2_13(material: Material) -> Made:
    """Range of every point over time."""
    person = material.person()
    truth = material.recording(person).truth[0]
    figure = viz.range_lines(truth.scatterers, title="Range of every point of a walking person")
    range_m = truth.scatterers["range"]
    left_m, right_m, torso_m = (part_line(range_m, part) for part in ("left_foot", "right_foot", "torso"))
    phase = phase_between_deg(left_m, right_m, stride_hz=truth.stride_frequency_hz, rate_hz=1000.0)
    readings = [
        Reading(
            "phase between left and right foot", phase, "deg", 180.0, OPPOSITE_TOLERANCE_DEG, given=not person.real
        ),
        Reading("right foot about its straight line (rms)", departure(right_m), "m"),
        Reading("torso about its straight line (rms)", departure(torso_m), "m", note="the report: very little"),
        Reading("both feet together swing farthest of all parts (1: yes)", float(_feet_farthest(range_m)), "1", 1.0),
    ]
    text = (
        f"the feet swing {departure(right_m) / departure(torso_m):.0f} times as far about the straight line of "
        f"constant velocity as the torso, {phase:.0f} degrees apart."
    )
    return Made(figure, readings, judged(readings, text))


def _feet_farthest(range_m: xr.DataArray) -> bool:
    """Whether both feet together swing farther than any other part; those of limbs count left and right together."""
    swings: dict[str, list[float]] = {}
    for part in parts_of(range_m):
        pair = part.removeprefix("left_").removeprefix("right_")
        swings.setdefault(pair, []).append(departure(part_line(range_m, part)))
    return max(swings, key=lambda pair: float(np.mean(np.square(swings[pair])))) == "foot"


def make_2_14(material: Material) -> Made:
    """Doppler shift of every point during one gait cycle."""
    person = material.person()
    recording = material.recording(person)
    truth, wavelength_m = recording.truth[0], recording.radar.wavelength_m
    start_s, cycle_s = one_cycle_s(person.motion, "right_foot")
    rows = truth.scatterers.sel(slow_time=slice(start_s, start_s + cycle_s))
    figure = viz.doppler_lines(
        rows, wavelength_m=wavelength_m, title="Doppler shift of every point of a walking person, one gait cycle"
    )
    doppler_hz = viz.scatterer_doppler(rows, wavelength_m=wavelength_m)
    highest_hz = {part: float(part_line(doppler_hz, part).max()) for part in parts_of(doppler_hz)}
    feet_hz = [highest_hz.pop(f"{side}_foot") for side in ("left", "right")]
    torso_hz = part_line(doppler_hz, "torso")
    readings = [
        Reading("wavelength", wavelength_m, "m", 0.0411, 5e-5, "of the radar as set", given=True),
        Reading("torso, mean", float(torso_hz.mean()), "Hz"),
        Reading("torso, rms variation", float(np.std(torso_hz)), "Hz", note="the report: little"),
        Reading("feet, highest", max(feet_hz), "Hz"),
        Reading("all other parts, highest", max(highest_hz.values()), "Hz"),
        Reading("both feet above every other part (1: yes)", float(min(feet_hz) > max(highest_hz.values())), "1", 1.0),
    ]
    text = (
        f"the torso keeps near {torso_hz.mean():.0f} Hz (rms {np.std(torso_hz):.0f} Hz) while the feet in their swing "
        f"reach {max(feet_hz) / torso_hz.mean():.1f} times that, other parts {max(highest_hz.values()):.0f} Hz."
    )
    return Made(figure, readings, judged(readings, text))


ENTRIES = (
    Entry(
        "fig-2.12", "A walking person from the side, one gait cycle",
        "Nine side views of a recorded walk (CMU, 41 markers). The right foot is in front at the start; after one gait "
        "cycle, two steps, the right heel is back at its place relative to the body.",
        make_2_12,
    ),
    Entry(
        "fig-2.13", "Range of every point of that walk",
        "The feet swing about the body most and in opposite phase; the breast-bone marker runs in a straight line, so "
        "the person keeps a constant velocity.",
        make_2_13,
    ),
    Entry(
        "fig-2.14", "Doppler shift of every point of that walk",
        "With a wavelength of 0.0411 m the breast bone hardly varies in Doppler, the heels have the largest shifts. So "
        "many markers clutter the picture.",
        make_2_14,
    ),
)  # fmt: skip
"""Figures of a recorded person in chapter 2."""
