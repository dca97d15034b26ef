"""Chapter 5 of the report: what its best case leaves out, a walk across and a walk to and fro (Figs. 5.10 and 5.11)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait import viz
from doppelgait.core.labels import axis
from doppelgait.core.rng import Streams
from doppelgait.motion import loop
from doppelgait.motion.retime import travel_speed_mps
from doppelgait.pipeline import analyze, simulate
from doppelgait.processing import Analysis
from doppelgait.reproduce.chapter4 import ENVELOPE
from doppelgait.reproduce.chapter5 import number
from doppelgait.reproduce.drawing import panels
from doppelgait.reproduce.entry import Entry, Made, Reading, judged
from doppelgait.reproduce.material import RCS_M2
from doppelgait.reproduce.measures import torso_line_hz, upper_envelope_hz
from doppelgait.reproduce.scenarios import WRONG
from doppelgait.scene import Scene, Target
from doppelgait.scene.rcs import RcsSpec
from doppelgait.viz.maps import DOPPLER_LABEL
from doppelgait.viz.signatures import draw_signature
from doppelgait.viz.style import LINE_COLOURS, name_axes

if TYPE_CHECKING:
    import xarray as xr

    from doppelgait.pipeline import TargetResult
    from doppelgait.radar.recording import Recording
    from doppelgait.reproduce.material import Material

PRF_HZ = 1000.0
ACROSS_RANGE_M = 8.0
LEG_M, LANE_M, CORNER_M = 4.0, 1.0, 0.4
START_M = (9.0, -1.5)
WALKED_SHARE = 0.9
"""Of the way along the corners; rounded, they are shorter than that."""
LEGS = 4
STILL_MPS = 0.3
SNR_DB = 20.0
"""Of the frames, for the tracker: it needs a noise floor to tell a target from nothing."""


def make_aspect(material: Material) -> Made:
    """Fig. 5.10."""
    person = material.person()
    views = {
        90.0: material.result(person, prf_hz=PRF_HZ, aspect_deg=90.0, range_m=ACROSS_RANGE_M),
        0.0: material.result(person, prf_hz=PRF_HZ),
    }
    figure, axes = panels(2, height_in=5.0)
    highest_hz = float(upper_envelope_hz(views[0.0].normalised_signature, ENVELOPE).max()) + 60.0
    for letter, panel, (aspect, result) in zip("ab", axes, views.items(), strict=True):
        draw_signature(panel, result.normalised_signature, db_range=30.0, doppler_hz=(-150.0, highest_hz))
        name_axes(panel, title=f"({letter}) aspect {aspect:.0f} degrees, 30 dB", x="time (s)", y=DOPPLER_LABEL)
    widths = {aspect: number(result.features.doppler_bandwidth_hz) for aspect, result in views.items()}
    bin_hz = PRF_HZ / views[0.0].signature.sizes["doppler"]
    readings = [
        Reading("f_d across the line of sight", number(views[90.0].torso_doppler_hz), "Hz", 0.0, bin_hz),
        Reading("f_d along the line of sight", number(views[0.0].torso_doppler_hz), "Hz"),
        Reading("B_mu across", widths[90.0], "Hz"),
        Reading("B_mu along", widths[0.0], "Hz"),
        Reading("B_mu across over along", widths[90.0] / widths[0.0], "1", note="the report: far smaller envelopes"),
        Reading("B_mu smaller across than along (1: yes)", float(widths[90.0] < widths[0.0]), "1", 1.0),
    ]
    return Made(
        figure, readings,
        judged(readings, f"across the line of sight the main line is at {readings[0].ours:.0f} Hz and B_mu is "
               f"{readings[4].ours:.2f} of that along it. The report's caption repeats that of Fig. 5.1; its text says "
               "what is shown."),
    )  # fmt: skip


def to_and_fro(material: Material) -> tuple[Recording, TargetResult, TargetResult]:
    """A person on four parallel lanes, towards the radar and away in turn: recording, the report's result and ours."""
    person = material.person()

    def make() -> tuple[Recording, TargetResult, TargetResult]:
        scene, radar = lanes(person.motion), material.radar(prf_hz=PRF_HZ)
        noisy = simulate(scene, radar, rng=Streams(material.seed), snr_db=SNR_DB, angles=False)
        report = analyze(noisy, gate="truth", analysis=Analysis(method="liland2018", hop=5))[0]
        tracks = analyze(noisy, gate="track", analysis=Analysis(extended=False))
        ours = max(tracks, key=lambda one: one.gate.time_s.size)
        return noisy, report, ours

    return material.once("to and fro", make)


def lanes(motion: xr.DataArray) -> Scene:
    """A straight walk laid on four parallel lanes, the ends joined by short ways across."""
    points = [(LEG_M * ((lane + end) % 2), LANE_M * lane) for lane in range(LEGS) for end in (0, 1)]
    way_m = LEGS * LEG_M + (LEGS - 1) * LANE_M
    walked = loop(motion, duration_s=2.0 * way_m / travel_speed_mps(motion))
    seconds = WALKED_SHARE * way_m / travel_speed_mps(walked)
    target = Target(
        walked, label="human", rcs=RcsSpec(kind="equal", total_m2=RCS_M2["human"]), start_position_m=START_M,
        heading_deg=180.0, path={"kind": "polyline", "points_m": points, "corner_radius_m": CORNER_M},
    )  # fmt: skip
    return Scene([target], duration_s=seconds)


def make_directions(material: Material) -> Made:
    """Fig. 5.11."""
    recording, report, ours = to_and_fro(material)
    true_hz = recording.truth[0].gait_frequency_hz
    figure = viz.signature(report.normalised_signature, db_range=25.0, title="A person who walks to and fro")
    pieces = pieces_of(ours)
    for start_s, stop_s in zip(pieces["from (s)"], pieces["to (s)"], strict=True):
        figure.axes[0].axvspan(start_s, stop_s, ymin=0.97, color=LINE_COLOURS[0], lw=0)
    still_hz = STILL_MPS * 2.0 / recording.radar.wavelength_m
    line_hz = torso_line_hz(report.normalised_signature, reach_hz=PRF_HZ)
    changes = sign_changes(line_hz, still_hz)
    report_hz, error = number(report.gait_frequency_hz), (pieces["f_m (Hz)"] / true_hz - 1.0).abs().max()
    readings = [
        Reading("changes of direction that the main line shows", float(changes), "1",
                note=f"true {sign_changes(recording.truth[0].centre_velocity_mps, STILL_MPS)}"),
        Reading("main line changes sign (1: yes)", float(changes > 0), "1", 1.0),
        Reading("f_m of the whole by the report's method", report_hz, "Hz", note=f"true {true_hz:.2f} Hz"),
        Reading("pieces of steady motion found by ours", float(len(pieces)), "1", note=f"{LEGS} lanes are walked"),
        Reading("pieces whose f_m is known", float(pieces["f_m (Hz)"].notna().sum()), "1"),
        Reading("largest relative error of f_m in them", float(error), "1"),
    ]  # fmt: skip
    wrong = not abs(report_hz / true_hz - 1.0) < WRONG
    return Made(
        figure, readings,
        judged(readings, f"the main line changes sign {changes} times. The report's method takes the whole and finds "
               f"{report_hz:.2f} Hz, {'wrong' if wrong else 'right all the same'}; ours divides the observation by "
               "itself (bars at the top), as the report proposes, and without any truth."),
        pieces,
    )  # fmt: skip


def pieces_of(result: TargetResult) -> pd.DataFrame:
    """Times, speed and step frequency of the pieces of steady motion of a track."""
    return pd.DataFrame(
        {
            "from (s)": float(axis(piece.signature, "time")[0]), "to (s)": float(axis(piece.signature, "time")[-1]),
            "v_m (m/s)": number(piece.features.torso_velocity_mps), "f_m (Hz)": number(piece.gait_frequency_hz),
        }
        for piece in result.pieces or (result,)
    )  # fmt: skip


def sign_changes(values: npt.ArrayLike, still: float) -> int:
    """How often a curve changes its sign; values nearer to 0 than ``still`` have none."""
    curve = np.asarray(values, dtype=np.float64)
    return int(np.count_nonzero(np.diff(np.sign(curve[np.abs(curve) > still]))))


ENTRIES = (
    Entry(
        "fig-5.10", "The same walk across and along the line of sight",
        "At an aspect of 90 degrees the main line is near 0 Hz and the envelopes are far smaller than at 0 degrees.",
        make_aspect,
    ),
    Entry(
        "fig-5.11", "Signature of a person who walks in several directions",
        "The main line changes sign, which makes it nearly impossible to find the step frequency; divided into four "
        "shorter observations it could be found, if they are not too short.", make_directions,
    ),
)  # fmt: skip
