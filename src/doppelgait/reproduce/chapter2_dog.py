"""Chapter 2, a recorded dog that gallops at the radar: Figures 2.18 to 2.20."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait import viz
from doppelgait.reproduce.entry import Entry, Made, Reading, judged
from doppelgait.reproduce.gait_lines import departure, forward_m, one_cycle_s, part_line, phase_between_deg
from doppelgait.reproduce.material import Material
from doppelgait.reproduce.movers import Mover

TOGETHER_TOLERANCE_DEG = 20.0
"""The report says "same phase" in words."""
DOG_PRF_HZ = 1491.0
"""1938 frames in 1.3 s: the report's Figure 3.14 shows the same recording."""
CHOSEN = "the stand-in's speed is chosen so; that it agrees shows nothing"


def _gait_note(dog: Mover) -> str:
    return "" if dog.gait == "bound" else f"this dog's gait is a {dog.gait}: left and right do not land together"


def make_2_18(material: Material) -> Made:
    """Nine side views of a gait cycle."""
    dog = material.galloping_dog()
    start_s, cycle_s = one_cycle_s(dog.motion, "left_hind")
    figure = viz.stick_frames(dog.motion, start_s=start_s, duration_s=cycle_s, title=f"One gait cycle, {dog.gait}")
    lines = forward_m(dog.motion)
    readings = [
        Reading("points of the body", dog.motion.sizes["marker"], "1", note="the report's dog carries 24 markers"),
        *[
            Reading(f"phase between left and right {pair} paw", _phase_deg(dog, lines, pair), "deg", 0.0,
                    TOGETHER_TOLERANCE_DEG, _gait_note(dog), not dog.real)
            for pair in ("fore", "hind")
        ],
        Reading("stride frequency", float(dog.motion.attrs["stride_frequency_hz"]), "Hz"),
    ]  # fmt: skip
    text = (
        "with left and right together it is a bound, which the report calls a gallop; its stride is the period of "
        "everything, so one pair of paws swings once a stride."
        if dog.gait == "bound"
        else f"the recording at hand is a {dog.gait}, in which left and right are out of step; the report's dog bounds."
    )
    return Made(figure, readings, judged(readings, text))


def _phase_deg(dog: Mover, lines: xr.DataArray, pair: str) -> float:
    left, right = (part_line(lines, f"{side}_{pair}_paw") for side in ("left", "right"))
    stride_hz, rate_hz = (float(dog.motion.attrs[name]) for name in ("stride_frequency_hz", "rate_hz"))
    return phase_between_deg(left, right, stride_hz=stride_hz, rate_hz=rate_hz)


def make_2_19(material: Material) -> Made:
    """Range of every point over time."""
    dog = material.galloping_dog()
    truth = material.recording(dog, prf_hz=DOG_PRF_HZ).truth[0]
    figure = viz.range_lines(truth.scatterers, title=f"Range of every point of a dog, {dog.gait}")
    range_m = truth.scatterers["range"]
    trunk_m = part_line(range_m, "trunk")
    left_m, right_m = (part_line(range_m, f"{side}_hind_paw") for side in ("left", "right"))
    phase = phase_between_deg(left_m, right_m, stride_hz=truth.stride_frequency_hz, rate_hz=DOG_PRF_HZ)
    readings = [
        Reading("phase between the hind paws", phase, "deg", 0.0, TOGETHER_TOLERANCE_DEG, _gait_note(dog),
                not dog.real),
        Reading("trunk nearer to the radar than the hind paws, mean", float((left_m - trunk_m).mean()), "m",
                note="the report: the marker on the trunk lies ahead of them"),
        Reading("hind paw about its straight line (rms)", departure(left_m), "m"),
        Reading("trunk about its straight line (rms)", departure(trunk_m), "m"),
    ]  # fmt: skip
    text = (
        f"the hind paws swing about the trunk {phase:.0f} degrees apart, once a stride: what repeats in the range "
        "lines is the stride, not the step frequency that the report names (E-07)."
    )
    return Made(figure, readings, judged(readings, text))


def make_2_20(material: Material) -> Made:
    """Doppler shift of every point over time."""
    dog = material.galloping_dog()
    recording = material.recording(dog, prf_hz=DOG_PRF_HZ)
    truth, wavelength_m = recording.truth[0], recording.radar.wavelength_m
    title = f"Doppler shift of every point of a dog, {dog.gait}"
    figure = viz.doppler_lines(truth.scatterers, wavelength_m=wavelength_m, title=title)
    doppler_hz = viz.scatterer_doppler(truth.scatterers, wavelength_m=wavelength_m)
    trunk_hz = part_line(doppler_hz, "trunk")
    paws_hz = [part_line(doppler_hz, f"{side}_hind_paw") for side in ("left", "right")]
    person = material.recording(material.person())
    torso_hz = part_line(viz.scatterer_doppler(person.truth[0].scatterers, wavelength_m=wavelength_m), "torso")
    variation_hz = [float(np.std(line)) for line in (trunk_hz, torso_hz)]
    readings = [
        Reading("radial velocity of the trunk, mean", float(trunk_hz.mean() * wavelength_m / 2), "m/s", 3.0, 0.3,
                f"{'' if dog.real else CHOSEN + '; '}section 5.3.2 has 263 Hz, 5.4 m/s, for the same recording",
                not dog.real),
        Reading("hind paws, smallest shift", max(float(np.abs(line).min()) for line in paws_hz), "Hz", 0.0, 10.0,
                "at rest on the ground", not dog.real),
        Reading("hind paws, highest shift", max(float(line.max()) for line in paws_hz), "Hz"),
        Reading("trunk, rms variation", variation_hz[0], "Hz", note=_relative(trunk_hz)),
        Reading("torso of a person, rms variation", variation_hz[1], "Hz", note=_relative(torso_hz)),
        Reading("trunk varies more than a person's torso (1: yes)", float(variation_hz[0] > variation_hz[1]), "1", 1.0,
                note="in Hz, as the figures show it"),
    ]  # fmt: skip
    text = (
        f"the hind paws come down to {readings[1].ours:.1f} Hz, and the trunk varies by {variation_hz[0]:.0f} "
        "Hz. The report's two speeds for its one recording, 3 m/s here and 263 Hz (5.4 m/s) in chapter 5, cannot both "
        "be right."
    )
    return Made(figure, readings, judged(readings, text))


def _relative(line_hz: npt.NDArray[np.float64]) -> str:
    return f"{np.std(line_hz) / abs(np.mean(line_hz)):.0%} of the mean"


ENTRIES = (
    Entry(
        "fig-2.18", "A galloping dog from the side, one gait cycle",
        "Nine side views of the only usable dog recording. Left and right legs move in the same phase and land "
        "together; fore and hind legs meet under the trunk before the hind legs kick off.",
        make_2_18,
    ),
    Entry(
        "fig-2.19", "Range of every point of that dog",
        "The marker on the trunk lies ahead of the hind paws; both hind paws swing in phase, at what the report calls "
        "the step frequency.",
        make_2_19,
    ),
    Entry(
        "fig-2.20", "Doppler shift of every point of that dog",
        "The trunk varies more than a person's, going up and down with the head, at about 3 m/s; the hind paws have no "
        "shift while they stand before they kick off.",
        make_2_20,
    ),
)  # fmt: skip
"""Figures of the dog in chapter 2."""
