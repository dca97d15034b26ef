"""Chapter 2, Doppler shift and the walker of Boulic and Chen: Figures 2.6, 2.15 and 2.16."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from doppelgait import viz
from doppelgait.core.labels import axis
from doppelgait.core.units import velocity_to_doppler_hz
from doppelgait.radar import Radar
from doppelgait.reproduce.entry import Entry, Made, Reading, judged
from doppelgait.reproduce.gait_lines import part_line
from doppelgait.reproduce.material import Material
from doppelgait.reproduce.points import point_table, slow_time_signal
from doppelgait.viz.motion import side_view_m
from doppelgait.viz.style import ACCENT, legend_below, name_axes, new_axes, new_figure

FloatArray = npt.NDArray[np.float64]

PRF_2_6_HZ = 300.0
FRAMES_2_6 = 300
ANKLE = "right_ankle"
BONES = (
    ("head", "neck"), ("neck", "base"), ("neck", "left_shoulder"), ("neck", "right_shoulder"),
    *[(f"{s}_{a}", f"{s}_{b}") for s in ("left", "right")
      for a, b in (("shoulder", "elbow"), ("elbow", "hand"), ("hip", "knee"), ("knee", "ankle"), ("ankle", "toe"))],
    ("base", "left_hip"), ("base", "right_hip"),
)  # fmt: skip
"""Points of the walker that are joined in Figure 2.15."""


def make_2_6(material: Material) -> Made:
    """Doppler shift against radial velocity: the line, and what the radar measures of single points."""
    radar = material.radar(prf_hz=PRF_2_6_HZ, range_stop_m=16.0)
    velocity_mps = np.linspace(-6.0, 6.0, 97)
    measured_hz = np.array([_measured_doppler_hz(radar, speed) for speed in velocity_mps])
    line_hz = velocity_to_doppler_hz(velocity_mps, radar.wavelength_m)
    figure, axes = new_axes(width_in=8.0, height_in=6.0)
    axes.plot(velocity_mps, line_hz, color="black", lw=1.5, label="2 v / λ")
    axes.plot(velocity_mps, measured_hz, "o", color=ACCENT, ms=4, label="measured at 300 frames a second")
    for limit_hz in (-PRF_2_6_HZ / 2, PRF_2_6_HZ / 2):
        axes.axhline(limit_hz, color="gray", lw=1, ls="--")
    axes.grid(color="#e0e0e0", lw=0.6)
    name_axes(axes, title="Doppler shift of single points", x="radial velocity (m/s)", y="Doppler shift (Hz)")
    legend_below(figure, axes)
    inside = np.abs(velocity_mps) < 3.0
    slope = float(np.polyfit(velocity_mps[inside], measured_hz[inside], 1)[0])
    highest_mps = float(np.abs(velocity_mps[np.abs(measured_hz - line_hz) < PRF_2_6_HZ / 4]).max())
    readings = [
        Reading("measured shift per radial velocity", slope, "Hz/(m/s)", 300.0 / 6.17, 0.05,
                "the report's 300 Hz for 6.17 m/s, printed with three digits"),
        Reading("highest shift measured at any velocity", float(np.abs(measured_hz).max()), "Hz", 150.0,
                float(np.diff(line_hz)[0]), "to within one step of velocity"),
        Reading("velocity at 150 Hz", radar.unambiguous_velocity_mps, "m/s", 6.0, 0.25,
                "its section 5.1 has 6 m/s for 300 Hz: that is the whole span from -3.1 to 3.1 m/s (E-06)"),
        Reading("highest speed measured without aliasing, in steps of 0.125 m/s", highest_mps, "m/s"),
    ]  # fmt: skip
    text = (
        "shifts beyond +-150 Hz alias. The limits are +-3.08 m/s; the 6 m/s that the report takes from them for "
        "300 frames a second is the width of the whole band, so a walking person's feet alias there."
    )
    return Made(figure, readings, judged(readings, text))


def _measured_doppler_hz(radar: Radar, velocity_mps: float) -> float:
    """Mean phase step from frame to frame of the range bin that a moving point passes, as a frequency."""
    table = point_table(radar, FRAMES_2_6, range_m=8.0, velocity_mps=velocity_mps)
    signal_v = slow_time_signal(radar, table, range_m=8.0)
    return float(np.angle(np.vdot(signal_v[:-1], signal_v[1:])) / (2 * np.pi) * radar.prf_hz)


def make_2_15(material: Material) -> Made:
    """The walker's points with their names, from the side and from the front."""
    motion = material.walker().motion
    frame = int(0.55 * np.ptp(axis(motion, "time")) / 5 * motion.attrs["rate_hz"])
    side_m = side_view_m(motion.values)[frame]
    front_m = motion.values[frame][:, 1:] - [motion.values[frame][:, 1].mean(), 0.0]
    names = list(axis(motion, "marker").astype(str))
    figure = new_figure(width_in=11.0, height_in=7.0)
    panels = figure.subplots(1, 2, sharey=True)
    for panel, points_m, across in zip(panels, (side_m, front_m), ("along the path (m)", "across (m)"), strict=True):
        for ends in BONES:
            panel.plot(*np.transpose([points_m[names.index(end)] for end in ends]), color="#a0a0a0", lw=1.2, zorder=1)
        panel.scatter(*points_m.T, s=28, color=ACCENT, zorder=2)
        name_axes(panel, title="", x=across, y="height (m)")
        panel.set(aspect="equal", xlim=(-0.9, 0.9), ylim=(-0.05, 1.8))
        panel.tick_params(labelleft=True)
    _name_points(panels[1], names, front_m)
    panels[0].set_title("from the side", fontsize=11.5, loc="left")
    panels[1].set_title("from the front", fontsize=11.5, loc="left")
    readings = [Reading("points of the walker", len(names), "1", 17.0, given=True)]
    return Made(figure, readings, judged(readings, "one point for every joint and end of the limbs, as published."))


def _name_points(panel: Axes, names: list[str], points_m: FloatArray) -> None:
    """Names beside the points: those of the left on the left, of the right on the right, none over another."""
    placed: dict[float, float] = {-1.0: np.inf, 1.0: np.inf}
    for number in np.argsort(-points_m[:, 1]):
        across, height = points_m[number]
        side = 1.0 if across >= 0 else -1.0
        at = min(height, placed[side] - 0.075)
        placed[side] = at
        panel.annotate(
            names[number].replace("_", " "), xy=(across, height), xytext=(side * 0.42, at), fontsize=9, va="center",
            ha="left" if side > 0 else "right", arrowprops={"arrowstyle": "-", "color": "#b0b0b0", "lw": 0.6},
        )  # fmt: skip


def make_2_16(material: Material) -> Made:
    """Doppler shift of the walker's points during one gait cycle, the right ankle in bold."""
    walker = material.walker()
    recording = material.recording(walker)
    truth, wavelength_m = recording.truth[0], recording.radar.wavelength_m
    cycle_s = 1.0 / truth.stride_frequency_hz
    rows = truth.scatterers.sel(slow_time=slice(0.0, cycle_s))
    figure = viz.doppler_lines(rows, wavelength_m=wavelength_m, title="Doppler shift of the walker, one gait cycle")
    time_s = axis(rows, "slow_time")
    ankle_hz = viz.scatterer_doppler(rows, wavelength_m=wavelength_m).values[:, axis(rows, "marker") == ANKLE][:, 0]
    _mark_ankle(figure.axes[0], time_s, ankle_hz)
    peak = int(ankle_hz.argmax())
    torso_hz = part_line(viz.scatterer_doppler(rows, wavelength_m=wavelength_m), "torso")
    readings = [
        Reading("right ankle, highest shift", float(ankle_hz[peak]), "Hz", 300.0, 10.0, "read off an axis, \u2248"),
        Reading("right ankle, highest radial velocity", float(ankle_hz[peak] * wavelength_m / 2), "m/s",
                note="the report: 6.17 m/s, the same number as its 300 Hz"),
        Reading("right ankle at its contact with the ground", float(ankle_hz[0]), "Hz", 0.0, 10.0,
                "the published curves bring the foot down while it still moves and let it slip in stance"),
        Reading("right ankle, lowest shift", float(ankle_hz.min()), "Hz", note="the report: slightly negative"),
        Reading("right ankle below zero before its swing (1: yes)", float(ankle_hz.min() < 0), "1", 1.0),
        Reading("highest shift, at this share of the gait cycle", float(time_s[peak] / cycle_s), "1",
                note="the report: in mid-swing"),
        Reading("torso, mean", float(torso_hz.mean()), "Hz"),
    ]  # fmt: skip
    text = (
        f"the ankle peaks at {ankle_hz[peak]:.0f} Hz in the swing, the torso has {torso_hz.mean():.0f} Hz. The ankle "
        "rests only a tenth of a second after its contact: Boulic's curves do not lock the foot to the floor."
    )
    return Made(figure, readings, judged(readings, text))


def _mark_ankle(axes: Axes, time_s: FloatArray, ankle_hz: FloatArray) -> None:
    axes.plot(time_s, ankle_hz, color="black", lw=2.4)
    axes.axhline(300.0, color=ACCENT, lw=1.0, ls="--")
    peak = int(ankle_hz.argmax())
    axes.annotate(
        f"right ankle (black): {ankle_hz[peak]:.0f} Hz", xy=(time_s[peak], ankle_hz[peak]),
        xytext=(0.45 * time_s[-1], 330.0), fontsize=10, arrowprops={"arrowstyle": "-", "lw": 0.8},
    )  # fmt: skip


ENTRIES = (
    Entry(
        "fig-2.6", "Doppler shift against radial velocity",
        "The shift is proportional to the radial velocity; in the example shifts beyond 150 Hz either way alias. "
        "Elsewhere the report takes 300 frames a second to allow 6 m/s.",
        make_2_6,
    ),
    Entry("fig-2.15", "The walker of Boulic and Chen", "The model has 17 point scatterers with names.", make_2_15),
    Entry(
        "fig-2.16", "Doppler shift of that walker, one gait cycle",
        "Head-on, one gait cycle from the contact of the right foot. The right ankle stands still in stance, moves "
        "slightly backwards at the end of it, and peaks in mid-swing at about 300 Hz, 6.17 m/s.",
        make_2_16,
    ),
)  # fmt: skip
"""Figures of chapter 2 that need no recording."""
