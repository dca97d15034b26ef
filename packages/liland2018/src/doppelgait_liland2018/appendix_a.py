"""Appendix A: length of the processing interval."""

from __future__ import annotations

from functools import partial

import pandas as pd

from doppelgait import viz
from doppelgait.pipeline import Result, analyze
from doppelgait.processing import Analysis
from doppelgait_liland2018.chapter4_features import HARMONIC_NAMES, bin_hz, found_hz
from doppelgait_liland2018.chapter5 import format_number
from doppelgait_liland2018.drawing import MAX_CADENCE_HZ, plot_cadence_amplitude
from doppelgait_liland2018.entry import EntryResult, Reading, entry, judge
from doppelgait_liland2018.material import STEEPNESS, THRESHOLD, Material
from doppelgait_liland2018.measures import CLEAR_DB, HARMONICS, prominence_db
from doppelgait_liland2018.style import make_panels

PRF_HZ = 1000.0
INTERVALS_S = (1.0, 0.5, 0.3, 0.1, 0.05, 0.01)
"""T_d of Figs. A.1 to A.6."""
BEST_S = (0.3, 0.1)
"""Values of T_d, s, that the report finds best."""
MOST_HOP = 5
"""Frames between columns. The report's value of 1 takes five times as long and changes prominences by less than 0.1 dB,
because the window of an interval T_d suppresses modulation faster than 12 / T_d."""
REFERENCE_S = 0.1
"""The report's T_d, s, with which shorter intervals are compared."""
SAME_DB = 1.0
"""Difference, dB, up to which prominences count as equal."""


def _analyze_walk(material: Material, cpi_s: float) -> tuple[Result, float]:
    """Analyse the walk of chapter 4 with another T_d."""
    recording = material.recording(material.make_walker(), prf_hz=PRF_HZ)
    analysis = Analysis(
        method="liland2018",
        cpi_s=cpi_s,
        window_steepness=STEEPNESS,
        bandwidth_threshold=THRESHOLD,
        hop=min(MOST_HOP, max(1, int(cpi_s * PRF_HZ / 20.0))),
    )
    result = material.compute_once(
        ("appendix A", cpi_s), lambda: analyze(recording, gate="truth", analysis=analysis)[0]
    )
    return result, recording.truth[0].gait_frequency_hz


def prominences_db(material: Material, cpi_s: float) -> list[float]:
    """Return prominences of f_m, f_2, f_3 at interval T_d."""
    result, true_hz = _analyze_walk(material, cpi_s)
    return [prominence_db(result.cadence_spectrum, true_hz, harmonic) for harmonic in HARMONICS]


def tabulate_summary(material: Material) -> pd.DataFrame:
    """Tabulate the prominences and the measured f_m by T_d."""
    rows = []
    for cpi_s in INTERVALS_S:
        result, true_hz = _analyze_walk(material, cpi_s)
        levels = prominences_db(material, cpi_s)
        rows.append(
            {
                "T_d (s)": cpi_s,
                **{f"{name} (dB)": level for name, level in zip(HARMONIC_NAMES, levels, strict=True)},
                "least (dB)": min(levels),
                "f_m found (Hz)": format_number(found_hz(result)[0]),
                "true (Hz)": true_hz,
            }
        )
    return pd.DataFrame(rows)


def make_interval(cpi_s: float, material: Material) -> EntryResult:
    """Make one of Figs. A.1 to A.6."""
    result, true_hz = _analyze_walk(material, cpi_s)
    figure, (left, middle, right) = make_panels(3, width_in=15.0, height_in=5.0)
    limits_hz = (-200.0, 450.0)
    viz.signature(result.normalised_signature, db_range=30.0, doppler_hz=limits_hz, title="(a) signature", ax=left)
    title = "(b) cadence-velocity diagram"
    viz.cadence_map(result.cadence_map, max_cadence_hz=MAX_CADENCE_HZ, db_range=30.0, title=title, ax=middle)
    middle.set_ylim(*limits_hz)
    plot_cadence_amplitude(
        right, result.cadence_spectrum, found_hz(result), true_hz=true_hz, title="(c) cadence spectrum"
    )
    figure.suptitle(f"Processing interval {cpi_s:g} s", fontsize=11.5, x=0.01, ha="left")
    levels = prominences_db(material, cpi_s)
    readings = [
        Reading(f"prominence of {name}", level, "dB") for name, level in zip(HARMONIC_NAMES, levels, strict=True)
    ]
    # The report's statements on every peak for this T_d, as yes (1) or no (0).
    by_interval = tabulate_summary(material).set_index("T_d (s)")
    for name in HARMONIC_NAMES:
        column = by_interval[f"{name} (dB)"]
        if cpi_s > max(BEST_S):
            words, is_so, stated = "detected", column[cpi_s] >= CLEAR_DB, 0.0
            note = f"detected: stands out by {CLEAR_DB:g} dB"
        elif cpi_s in BEST_S:
            rank = int((column > column[cpi_s]).sum()) + 1
            words, is_so, stated = "among the two most prominent of the six T_d", rank <= len(BEST_S), 1.0
            note = f"number {rank} of the six"
        else:
            gain_db = float(column[cpi_s] - column[REFERENCE_S])
            words, is_so, stated = f"more prominent than with {REFERENCE_S:g} s", gain_db > SAME_DB, 0.0
            note = f"{gain_db:+.1f} dB; more: by over {SAME_DB:g} dB"
        readings.append(Reading(f"{name} {words} (1: yes)", float(is_so), "1", stated, note=note))
    found = format_number(found_hz(result)[0])
    readings.append(
        Reading("f_m as found", found, "Hz", note=f"true {true_hz:.3f} Hz; a bin is {bin_hz(result):.3f} Hz")
    )
    right_step = abs(found - true_hz) <= 0.6 * bin_hz(result)
    table = tabulate_summary(material) if cpi_s == INTERVALS_S[0] else None
    seen = [name for name, level in zip(HARMONIC_NAMES, levels, strict=True) if level >= CLEAR_DB]
    text = (
        f"{', '.join(seen) or 'no peak'} stand{'s' if len(seen) < 2 else ''} out by {CLEAR_DB:g} dB or more, and f_m "
        f"as found is {'right' if right_step else 'wrong'}."
    )
    return judge(figure, readings, text, table)


STATED = {
    1.0: "An interval of 1 s resolves time too poorly: none of f_m, f_2 and f_3 can be detected.",
    0.5: "The same holds for 0.5 s.",
    0.3: "0.3 s and 0.1 s give the most prominent peaks.",
    0.1: "0.1 s and 0.3 s give the most prominent peaks; 0.1 s is what the report uses.",
    0.05: "Shorter than 0.1 s does not make the peaks more prominent.",
    0.01: "Shorter than 0.1 s does not make the peaks more prominent.",
}

for place, interval_s in enumerate(INTERVALS_S, start=1):
    title = f"Signature, cadence-velocity diagram and cadence spectrum with T_d = {interval_s:g} s"
    entry(f"fig-A.{place}", title, STATED[interval_s])(partial(make_interval, interval_s))
