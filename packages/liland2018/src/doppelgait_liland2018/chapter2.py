"""Chapter 2: Doppler shift, walkers and a dog."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from doppelgait import viz
from doppelgait.radar import Radar
from doppelgait_liland2018.entry import EntryResult, Reading, compare_statement, entry, judge
from doppelgait_liland2018.material import Material, NamedMotion, make_point_table, simulate_slow_time_signal
from doppelgait_liland2018.measures import (
    average_part_line,
    forward_m,
    list_parts,
    measure_departure,
    one_cycle_s,
    phase_between_deg,
    read_axis,
    velocity_to_doppler_hz,
)
from doppelgait_liland2018.style import ACCENT, make_axes, make_figure, name_axes, place_legend_below

FloatArray = npt.NDArray[np.float64]

PRF_2_6_HZ = 300.0
FRAMES_2_6 = 300
ANKLE = "right_ankle"
BONES = (
    ("head", "neck"),
    ("neck", "base"),
    ("neck", "left_shoulder"),
    ("neck", "right_shoulder"),
    *[
        (f"{s}_{a}", f"{s}_{b}")
        for s in ("left", "right")
        for a, b in (("shoulder", "elbow"), ("elbow", "hand"), ("hip", "knee"), ("knee", "ankle"), ("ankle", "toe"))
    ],
    ("base", "left_hip"),
    ("base", "right_hip"),
)
"""Points of the walker that are joined in Figure 2.15."""


@entry(
    "fig-2.6",
    "Doppler shift against radial velocity",
    "The shift is proportional to the radial velocity; in the example shifts beyond 150 Hz either way alias. "
    "Elsewhere the report takes 300 frames a second to allow 6 m/s.",
)
def make_2_6(material: Material) -> EntryResult:
    radar = material.radar(prf_hz=PRF_2_6_HZ, range_stop_m=16.0)
    velocity_mps = np.linspace(-6.0, 6.0, 97)
    measured_hz = np.array([_measure_doppler_hz(radar, speed) for speed in velocity_mps])
    line_hz = velocity_to_doppler_hz(velocity_mps, radar.wavelength_m)
    figure, axes = make_axes(width_in=8.0, height_in=6.0)
    axes.plot(velocity_mps, line_hz, color="black", lw=1.5, label="twice the velocity over the wavelength")
    axes.plot(velocity_mps, measured_hz, "o", color=ACCENT, ms=4, label="measured at 300 frames a second")
    for limit_hz in (-PRF_2_6_HZ / 2, PRF_2_6_HZ / 2):
        axes.axhline(limit_hz, color="gray", lw=1, ls="--")
    axes.grid(color="#e0e0e0", lw=0.6)
    name_axes(axes, title="Doppler frequency of single points", x="radial velocity (m/s)", y="Doppler frequency (Hz)")
    place_legend_below(figure, axes)
    inside = np.abs(velocity_mps) < 3.0
    slope = float(np.polyfit(velocity_mps[inside], measured_hz[inside], 1)[0])
    highest_mps = float(np.abs(velocity_mps[np.abs(measured_hz - line_hz) < PRF_2_6_HZ / 4]).max())
    readings = [
        Reading(
            "measured shift per radial velocity",
            slope,
            "Hz/(m/s)",
            300.0 / 6.17,
            0.05,
            "the report's 300 Hz for 6.17 m/s, printed with three digits",
        ),
        Reading(
            "highest shift measured at any velocity",
            float(np.abs(measured_hz).max()),
            "Hz",
            150.0,
            float(np.diff(line_hz)[0]),
            "to within one step of velocity",
        ),
        Reading(
            "velocity at 150 Hz",
            radar.unambiguous_velocity_mps,
            "m/s",
            6.0,
            0.25,
            "its section 5.1 has 6 m/s for 300 Hz: that is the whole span from -3.1 to 3.1 m/s (E-06)",
        ),
        Reading("highest speed measured without aliasing, in steps of 0.125 m/s", highest_mps, "m/s"),
    ]
    text = (
        "shifts beyond +-150 Hz alias. The limits are +-3.08 m/s; the 6 m/s that the report takes from them for "
        "300 frames a second is the width of the whole band, so a walking person's feet alias there."
    )
    return judge(figure, readings, text)


def _measure_doppler_hz(radar: Radar, velocity_mps: float) -> float:
    table = make_point_table(radar, FRAMES_2_6, range_m=8.0, velocity_mps=velocity_mps)
    signal_v = simulate_slow_time_signal(radar, table, range_m=8.0)
    return float(np.angle(np.vdot(signal_v[:-1], signal_v[1:])) / (2 * np.pi) * radar.prf_hz)


@entry("fig-2.15", "The walker of Boulic and Chen", "The model has 17 point scatterers with names.")
def make_2_15(material: Material) -> EntryResult:
    motion = material.make_walker().motion
    frame = int(0.55 * np.ptp(motion.time_s) / 5 * motion.rate_hz)
    middle_m = (motion.position_m.min(axis=1) + motion.position_m.max(axis=1))[:, :2] / 2.0
    path = (middle_m[-1] - middle_m[0]) / np.linalg.norm(middle_m[-1] - middle_m[0])
    ground_m = motion.position_m[frame][:, :2] - middle_m[frame]
    side_m = np.stack([ground_m @ path, motion.position_m[frame][:, 2]], axis=-1)
    front_m = motion.position_m[frame][:, 1:] - [motion.position_m[frame][:, 1].mean(), 0.0]
    names = motion.markers
    figure = make_figure(width_in=11.0, height_in=7.0)
    panels = figure.subplots(1, 2, sharey=True)
    for panel, points_m, across in zip(panels, (side_m, front_m), ("along the path (m)", "across (m)"), strict=True):
        for ends in BONES:
            panel.plot(*np.transpose([points_m[names.index(end)] for end in ends]), color="#a0a0a0", lw=1.2, zorder=1)
        panel.scatter(*points_m.T, s=28, color=ACCENT, zorder=2)
        name_axes(panel, title="", x=across, y="height (m)")
        panel.set(aspect="equal", xlim=(-0.9, 0.9), ylim=(-0.05, 1.8))
        panel.tick_params(labelleft=True)
    # Names next to the points, on their own side, without overlap.
    name_panel = panels[1]
    placed: dict[float, float] = {-1.0: np.inf, 1.0: np.inf}
    for number in np.argsort(-front_m[:, 1]):
        name_across, height = front_m[number]
        side = 1.0 if name_across >= 0 else -1.0
        at = min(height, placed[side] - 0.075)
        placed[side] = at
        name_panel.annotate(
            names[number].replace("_", " "),
            xy=(name_across, height),
            xytext=(side * 0.42, at),
            fontsize=9,
            va="center",
            ha="left" if side > 0 else "right",
            arrowprops={"arrowstyle": "-", "color": "#b0b0b0", "lw": 0.6},
        )
    panels[0].set_title("from the side", fontsize=11.5, loc="left")
    panels[1].set_title("from the front", fontsize=11.5, loc="left")
    readings = [Reading("points of the walker", len(names), "1", 17.0, fixed=True)]
    return judge(figure, readings, "one point for every joint and end of the limbs, as published.")


@entry(
    "fig-2.16",
    "Doppler shift of that walker, one gait cycle",
    "Head-on, one gait cycle from the contact of the right foot. The right ankle stands still in stance, moves "
    "slightly backwards at the end of it, and peaks in mid-swing at about 300 Hz, 6.17 m/s.",
)
def make_2_16(material: Material) -> EntryResult:
    walker = material.make_walker()
    recording = material.recording(walker)
    truth, wavelength_m = recording.truth[0], recording.radar.wavelength_m
    cycle_s = 1.0 / truth.stride_frequency_hz
    rows = truth.scatterers.sel(slow_time=slice(0.0, cycle_s))
    figure = viz.doppler_lines(rows, wavelength_m=wavelength_m, title="Doppler shift of the walker, one gait cycle")
    time_s = read_axis(rows, "slow_time")
    ankle_hz = viz.scatterer_doppler(rows, wavelength_m=wavelength_m).values[:, read_axis(rows, "marker") == ANKLE][
        :, 0
    ]
    axes = figure.axes[0]
    axes.plot(time_s, ankle_hz, color="black", lw=2.4)
    axes.axhline(300.0, color=ACCENT, lw=1.0, ls="--")
    ankle_peak = int(ankle_hz.argmax())
    axes.annotate(
        f"right ankle (black): {ankle_hz[ankle_peak]:.0f} Hz",
        xy=(time_s[ankle_peak], ankle_hz[ankle_peak]),
        xytext=(0.45 * time_s[-1], 330.0),
        fontsize=10,
        arrowprops={"arrowstyle": "-", "lw": 0.8},
    )
    peak = int(ankle_hz.argmax())
    torso_hz = average_part_line(viz.scatterer_doppler(rows, wavelength_m=wavelength_m), "torso")
    readings = [
        Reading("right ankle, highest shift", float(ankle_hz[peak]), "Hz", 300.0, 10.0, "read off an axis, \u2248"),
        Reading(
            "right ankle, highest radial velocity",
            float(ankle_hz[peak] * wavelength_m / 2),
            "m/s",
            note="the report: 6.17 m/s, the same number as its 300 Hz",
        ),
        Reading(
            "right ankle at its contact with the ground",
            float(ankle_hz[0]),
            "Hz",
            0.0,
            10.0,
            "the published curves bring the foot down while it still moves and let it slip in stance",
        ),
        Reading("right ankle, lowest shift", float(ankle_hz.min()), "Hz", note="the report: slightly negative"),
        compare_statement("right ankle below zero before its swing", ankle_hz.min() < 0),
        Reading(
            "highest shift, at this share of the gait cycle",
            float(time_s[peak] / cycle_s),
            "1",
            note="the report: in mid-swing",
        ),
        Reading("torso, mean", float(torso_hz.mean()), "Hz"),
    ]
    text = (
        f"the ankle peaks at {ankle_hz[peak]:.0f} Hz in the swing, the torso has {torso_hz.mean():.0f} Hz. The ankle "
        "rests only a tenth of a second after its contact: Boulic's curves do not lock the foot to the floor."
    )
    return judge(figure, readings, text)


OPPOSITE_TOLERANCE_DEG = 20.0
"""Tolerance, degrees, of the report's statement "opposite phase"."""


@entry(
    "fig-2.12",
    "A walking person from the side, one gait cycle",
    "Nine side views of a recorded walk (CMU, 41 markers). The right foot is in front at the start; after one gait "
    "cycle, two steps, the right heel is back at its place relative to the body.",
)
def make_2_12(material: Material) -> EntryResult:
    person = material.person()
    motion = person.motion
    start_s, cycle_s = one_cycle_s(motion, "right_foot")
    title = "One gait cycle, right foot landing first"
    figure = viz.stick_frames(motion, start_s=start_s, duration_s=cycle_s, title=title)
    times_s = motion.time_s
    ends = [int(np.abs(times_s - time).argmin()) for time in (start_s, start_s + cycle_s)]
    right_m, left_m = (average_part_line(forward_m(motion), f"{side}_foot") for side in ("right", "left"))
    landings = [time for times in motion.facts.footfalls.values() for time in times]
    steps = sum(start_s + 1e-6 < time <= start_s + cycle_s + 1e-6 for time in landings)
    readings = [
        Reading("points of the body", len(motion.markers), "1", note="the report's person carries 41 markers"),
        Reading("steps in the gait cycle", steps, "1", 2.0, fixed=not person.real),
        Reading(
            "right foot against the body, last view minus first",
            right_m[ends[1]] - right_m[ends[0]],
            "m",
            0.0,
            0.05,
            "the same place to within the size of a dot",
            not person.real,
        ),
        Reading("right foot ahead of the left in the first view", right_m[ends[0]] - left_m[ends[0]], "m"),
    ]
    text = (
        f"the right foot lands {readings[3].ours:.2f} m before the left, and after {steps} steps is within "
        f"{abs(readings[2].ours):.2f} m of its place against the body."
    )
    return judge(figure, readings, text)


@entry(
    "fig-2.13",
    "Range of every point of that walk",
    "The feet swing about the body most and in opposite phase; the breast-bone marker runs in a straight line, so "
    "the person keeps a constant velocity.",
)
def make_2_13(material: Material) -> EntryResult:
    person = material.person()
    truth = material.recording(person).truth[0]
    figure = viz.range_lines(truth.scatterers, title="Range of every point of a walking person")
    range_m = truth.scatterers["range"]
    left_m, right_m, torso_m = (average_part_line(range_m, part) for part in ("left_foot", "right_foot", "torso"))
    phase = phase_between_deg(left_m, right_m, stride_hz=truth.stride_frequency_hz, rate_hz=1000.0)
    # True if both feet together swing farther than any other part; limbs count left and right together.
    swings: dict[str, list[float]] = {}
    for part in list_parts(range_m):
        pair = part.removeprefix("left_").removeprefix("right_")
        swings.setdefault(pair, []).append(measure_departure(average_part_line(range_m, part)))
    readings = [
        Reading(
            "phase between left and right foot", phase, "deg", 180.0, OPPOSITE_TOLERANCE_DEG, fixed=not person.real
        ),
        Reading("right foot about its straight line (rms)", measure_departure(right_m), "m"),
        Reading("torso about its straight line (rms)", measure_departure(torso_m), "m", note="the report: very little"),
        compare_statement(
            "both feet together swing farthest of all parts",
            max(swings, key=lambda pair: float(np.mean(np.square(swings[pair])))) == "foot",
        ),
    ]
    text = (
        f"the feet swing {measure_departure(right_m) / measure_departure(torso_m):.0f} times as far about the "
        f"straight line of "
        f"constant velocity as the torso, {phase:.0f} degrees apart."
    )
    return judge(figure, readings, text)


@entry(
    "fig-2.14",
    "Doppler shift of every point of that walk",
    "With a wavelength of 0.0411 m the breast bone hardly varies in Doppler, the heels have the largest shifts. So "
    "many markers clutter the picture.",
)
def make_2_14(material: Material) -> EntryResult:
    person = material.person()
    recording = material.recording(person)
    truth, wavelength_m = recording.truth[0], recording.radar.wavelength_m
    start_s, cycle_s = one_cycle_s(person.motion, "right_foot")
    rows = truth.scatterers.sel(slow_time=slice(start_s, start_s + cycle_s))
    figure = viz.doppler_lines(
        rows, wavelength_m=wavelength_m, title="Doppler shift of every point of a walking person, one gait cycle"
    )
    doppler_hz = viz.scatterer_doppler(rows, wavelength_m=wavelength_m)
    highest_hz = {part: float(average_part_line(doppler_hz, part).max()) for part in list_parts(doppler_hz)}
    feet_hz = [highest_hz.pop(f"{side}_foot") for side in ("left", "right")]
    torso_hz = average_part_line(doppler_hz, "torso")
    readings = [
        Reading("wavelength", wavelength_m, "m", 0.0411, 5e-5, "of the radar as set", fixed=True),
        Reading("torso, mean", float(torso_hz.mean()), "Hz"),
        Reading("torso, rms variation", float(np.std(torso_hz)), "Hz", note="the report: little"),
        Reading("feet, highest", max(feet_hz), "Hz"),
        Reading("all other parts, highest", max(highest_hz.values()), "Hz"),
        compare_statement("both feet above every other part", min(feet_hz) > max(highest_hz.values())),
    ]
    text = (
        f"the torso keeps near {torso_hz.mean():.0f} Hz (rms {np.std(torso_hz):.0f} Hz) while the feet in their swing "
        f"reach {max(feet_hz) / torso_hz.mean():.1f} times that, other parts {max(highest_hz.values()):.0f} Hz."
    )
    return judge(figure, readings, text)


TOGETHER_TOLERANCE_DEG = 20.0
"""Tolerance, degrees, of the report's statement "same phase"."""
DOG_PRF_HZ = 1491.0
"""Frame rate, Hz, of the recording: 1938 frames in 1.3 s in the report's Figure 3.14."""
CHOSEN = "the speed of the substitute model was set to this value, so that agreement is no evidence"


def _compare_paws(words: str, phase_deg: float, dog: NamedMotion) -> Reading:
    """Compare the phase of two paws with the report's "same phase"."""
    note = "" if dog.gait == "bound" else f"this dog's gait is a {dog.gait}: left and right do not land together"
    return Reading(words, phase_deg, "deg", 0.0, TOGETHER_TOLERANCE_DEG, note, not dog.real)


@entry(
    "fig-2.18",
    "A galloping dog from the side, one gait cycle",
    "Nine side views of the only usable dog recording. Left and right legs move in the same phase and land "
    "together; fore and hind legs meet under the trunk before the hind legs kick off.",
)
def make_2_18(material: Material) -> EntryResult:
    dog = material.find_galloping_dog()
    start_s, cycle_s = one_cycle_s(dog.motion, "left_hind")
    figure = viz.stick_frames(dog.motion, start_s=start_s, duration_s=cycle_s, title=f"One gait cycle, {dog.gait}")
    lines, facts, rate_hz = forward_m(dog.motion), dog.motion.facts, dog.motion.rate_hz
    phases_deg = {}
    for pair in ("fore", "hind"):
        left, right = (average_part_line(lines, f"{side}_{pair}_paw") for side in ("left", "right"))
        phases_deg[pair] = phase_between_deg(left, right, stride_hz=facts.stride_frequency_hz, rate_hz=rate_hz)
    readings = [
        Reading("points of the body", len(dog.motion.markers), "1", note="the report's dog carries 24 markers"),
        *[
            _compare_paws(f"phase between left and right {pair} paw", phase_deg, dog)
            for pair, phase_deg in phases_deg.items()
        ],
        Reading("stride frequency", facts.stride_frequency_hz, "Hz"),
    ]
    text = (
        "with left and right together it is a bound, which the report calls a gallop; its stride is the period of "
        "everything, so one pair of paws swings once a stride."
        if dog.gait == "bound"
        else f"the recording at hand is a {dog.gait}, in which left and right are out of step; the report's dog bounds."
    )
    return judge(figure, readings, text)


@entry(
    "fig-2.19",
    "Range of every point of that dog",
    "The marker on the trunk lies ahead of the hind paws; both hind paws swing in phase, at what the report calls "
    "the step frequency.",
)
def make_2_19(material: Material) -> EntryResult:
    dog = material.find_galloping_dog()
    truth = material.recording(dog, prf_hz=DOG_PRF_HZ).truth[0]
    figure = viz.range_lines(truth.scatterers, title=f"Range of every point of a dog, {dog.gait}")
    range_m = truth.scatterers["range"]
    trunk_m = average_part_line(range_m, "trunk")
    left_m, right_m = (average_part_line(range_m, f"{side}_hind_paw") for side in ("left", "right"))
    phase = phase_between_deg(left_m, right_m, stride_hz=truth.stride_frequency_hz, rate_hz=DOG_PRF_HZ)
    readings = [
        _compare_paws("phase between the hind paws", phase, dog),
        Reading(
            "trunk nearer to the radar than the hind paws, mean",
            float((left_m - trunk_m).mean()),
            "m",
            note="the report: the marker on the trunk lies ahead of them",
        ),
        Reading("hind paw about its straight line (rms)", measure_departure(left_m), "m"),
        Reading("trunk about its straight line (rms)", measure_departure(trunk_m), "m"),
    ]
    text = (
        f"the hind paws swing about the trunk {phase:.0f} degrees apart, once a stride: what repeats in the range "
        "lines is the stride, not the step frequency that the report names (E-07)."
    )
    return judge(figure, readings, text)


@entry(
    "fig-2.20",
    "Doppler shift of every point of that dog",
    "The trunk varies more than a person's, going up and down with the head, at about 3 m/s; the hind paws have no "
    "shift while they stand before they kick off.",
)
def make_2_20(material: Material) -> EntryResult:
    dog = material.find_galloping_dog()
    recording = material.recording(dog, prf_hz=DOG_PRF_HZ)
    truth, wavelength_m = recording.truth[0], recording.radar.wavelength_m
    title = f"Doppler shift of every point of a dog, {dog.gait}"
    figure = viz.doppler_lines(truth.scatterers, wavelength_m=wavelength_m, title=title)
    doppler_hz = viz.scatterer_doppler(truth.scatterers, wavelength_m=wavelength_m)
    trunk_hz = average_part_line(doppler_hz, "trunk")
    paws_hz = [average_part_line(doppler_hz, f"{side}_hind_paw") for side in ("left", "right")]
    person = material.recording(material.person())
    torso_hz = average_part_line(viz.scatterer_doppler(person.truth[0].scatterers, wavelength_m=wavelength_m), "torso")
    variation_hz = [float(np.std(line)) for line in (trunk_hz, torso_hz)]
    readings = [
        Reading(
            "radial velocity of the trunk, mean",
            float(trunk_hz.mean() * wavelength_m / 2),
            "m/s",
            3.0,
            0.3,
            f"{'' if dog.real else CHOSEN + '; '}section 5.3.2 has 263 Hz, 5.4 m/s, for the same recording",
            not dog.real,
        ),
        Reading(
            "hind paws, smallest shift",
            max(float(np.abs(line).min()) for line in paws_hz),
            "Hz",
            0.0,
            10.0,
            "at rest on the ground",
            not dog.real,
        ),
        Reading("hind paws, highest shift", max(float(line.max()) for line in paws_hz), "Hz"),
        Reading("trunk, rms variation", variation_hz[0], "Hz", note=_format_relative_note(trunk_hz)),
        Reading("torso of a person, rms variation", variation_hz[1], "Hz", note=_format_relative_note(torso_hz)),
        compare_statement(
            "trunk varies more than a person's torso",
            variation_hz[0] > variation_hz[1],
            note="in Hz, as the figures show it",
        ),
    ]
    text = (
        f"the hind paws come down to {readings[1].ours:.1f} Hz, and the trunk varies by {variation_hz[0]:.0f} "
        "Hz. The report's two speeds for its one recording, 3 m/s here and 263 Hz (5.4 m/s) in chapter 5, cannot both "
        "be right."
    )
    return judge(figure, readings, text)


def _format_relative_note(line_hz: npt.NDArray[np.float64]) -> str:
    return f"{np.std(line_hz) / abs(np.mean(line_hz)):.0%} of the mean"
