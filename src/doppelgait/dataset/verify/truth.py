"""Checks of features against truth, class by class.

Wrong labels, units or levels affect a class as a whole.

A check of one class fails where fewer than :data:`LEAST_SHARE` of its rows are within the
tolerance, at a level of significance of 0.1 % (one-sided binomial test), so that single wrong
estimates or a handful of rows never fail it, and a wrong sign, unit, label or truth, which hits
nearly every row, always does from seven rows on. Whether an estimator is good is another question;
:mod:`doppelgait.features` describes how often each is correct (the gait frequency: 96 % of those
that are not flagged are within 5 %).

Tolerances: the torso velocity 0.15 m/s, a cell of Doppler at 0.1 s and 24 GHz or a quarter of one
at 7 GHz and the body's own swing, and 10 % for a main line that is not the body's centre; the gait
frequency 10 %, five times its resolution at five periods and far from the factor of two of a
mistaken step. The SNR 0.1 dB: it is set, not estimated. The aspect 10 degrees from that of the
body's straight path: the rise and fall of a walker's centre tilts its velocity by 8 degrees in the mean.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.dataset.feasibility import LIMITS, limits_of_index
from doppelgait.dataset.resolve import ExampleSpec
from doppelgait.dataset.verify.contents import Check, Contents

FloatArray = npt.NDArray[np.float64]

LEAST_SHARE = 2.0 / 3.0
LEVEL = 1e-3
VELOCITY_TOLERANCE_MPS, VELOCITY_TOLERANCE_SHARE = 0.15, 0.1
FREQUENCY_TOLERANCE_SHARE = 0.1
FREQUENCY_LEAST_SNR_DB = 10.0
SNR_TOLERANCE_DB = 0.1
ASPECT_TOLERANCE_DEG = 10.0
SHOWN_DB = 3.0
"""A row shows something from this signature SNR on. Noise alone stays below 0 dB in gates of many range bins."""


def has_too_few_hits(hits: int, rows: int, least: float = LEAST_SHARE) -> bool:
    """Return True if fewer than ``least`` rows hit, beyond chance."""
    from scipy.special import bdtr

    return rows > 0 and bool(bdtr(hits, rows, least) < LEVEL)


def judge(name: str, table: pd.DataFrame, what: str, *, extra: str = "") -> Check:
    """Check rows with ``label``, ``inside`` and ``error`` per class."""
    if table.empty:
        return Check(name, "not applicable", f"no row to compare: {what}")
    numbers: dict[str, Any] = {}
    wrong, parts = [], []
    for label, part in table.groupby("label"):
        hits, rows = int(part["inside"].sum()), len(part)
        rms = float(np.sqrt(np.mean(np.square(part["error"]))))
        numbers[str(label)] = {"rows": rows, "share_inside": hits / rows, "rms": rms}
        parts.append(f"{label} {100 * hits / rows:.0f} % of {rows}{extra.format(rms=rms)}")
        if has_too_few_hits(hits, rows):
            wrong.append(str(label))
    summary = f"{what}: {', '.join(parts)}"
    return (
        Check(name, "failed", f"off as a whole: {', '.join(wrong)}; {summary}", numbers)
        if wrong
        else Check(name, "passed", summary, numbers)
    )


def read_column(index: pd.DataFrame, name: str) -> FloatArray:
    """Return a column of numbers, NaN where absent."""
    values = index[name] if name in index else pd.Series(np.nan, index=index.index)
    return np.asarray(pd.to_numeric(values).to_numpy(dtype=np.float64, na_value=np.nan))


def check_velocity(index: pd.DataFrame) -> Check:
    """Check the torso velocity against the body's mean radial velocity."""
    truth, found = read_column(index, "truth_radial_velocity_mps"), read_column(index, "feature_torso_velocity_mps")
    error = np.abs(found - truth)
    table = pd.DataFrame({"label": index["label"], "error": error})
    table["inside"] = error <= VELOCITY_TOLERANCE_MPS + VELOCITY_TOLERANCE_SHARE * np.abs(truth)
    known = np.isfinite(error) & (read_column(index, "quality_snr_mu_db") >= SHOWN_DB)
    return judge("torso velocity", table[known], "within 0.15 m/s + 10 % of the truth", extra=" (rms {rms:.2f} m/s)")


def check_gait_frequency(index: pd.DataFrame) -> Check:
    """Check the gait frequency against the truth."""
    truth, found = read_column(index, "truth_gait_frequency_hz"), read_column(index, "gait_frequency_hz")
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.abs(found / truth - 1.0)
    sure = ~index["quality_flags"].fillna("").astype(str).str.contains("low_confidence").to_numpy(dtype=bool)
    known = np.isfinite(error) & sure & (read_column(index, "quality_snr_mu_db") >= FREQUENCY_LEAST_SNR_DB)
    table = pd.DataFrame({"label": index["label"], "error": error, "inside": error <= FREQUENCY_TOLERANCE_SHARE})
    what = "within 10 % of the truth where not flagged and 10 dB or more"
    return judge("gait frequency", table[known], what)


def check_snr(index: pd.DataFrame, examples: Sequence[ExampleSpec]) -> Check:
    """Check SNR_frame of the index against the plan."""
    asked = {e.id: e.run.noise.snr_db for e in examples if e.run.noise.kind == "snr"}
    if not asked:
        return Check("planned SNR", "not applicable", "the plan sets no SNR")
    rows = index[index["scene_id"].isin(list(asked)) & (index["source"] != "none")]
    error = np.abs(read_column(rows, "snr_frame_db") - np.array([asked[name] for name in rows["scene_id"]]))
    table = pd.DataFrame({"label": rows["label"], "error": error, "inside": error <= SNR_TOLERANCE_DB})
    return judge("planned SNR", table, "SNR_frame within 0.1 dB of the plan")


def check_aspect(index: pd.DataFrame, examples: Sequence[ExampleSpec]) -> Check:
    """Check the aspect angle against the plan's."""
    # bodies that walk straight through the planned place are used
    table = []
    first = index[index["id"] == index["scene_id"]].drop_duplicates("id")
    rows: dict[str, Any] = {row["id"]: row for row in first.to_dict("records")}
    for example in examples:
        target = example.run.scene.targets[0]
        placed = target.start_position_m is None and target.path is None and example.rows[0].source != "none"
        if example.id not in rows or not placed:
            continue
        row = rows[example.id]
        found, expected = float(row["truth_aspect_deg"]), expected_aspect_deg(example, row)
        if math.isfinite(found) and math.isfinite(expected):
            table.append({"label": row["label"], "error": abs(found - expected)})
    frame = pd.DataFrame(table, columns=["label", "error"])
    frame["inside"] = frame["error"] <= ASPECT_TOLERANCE_DEG
    return judge("aspect", frame, "within 10 degrees of the planned path's", extra=" (rms {rms:.1f} degrees)")


def expected_aspect_deg(example: ExampleSpec, row: Mapping[str, Any]) -> float:
    """Return a planned path's mean aspect at a point (E-04)."""
    target = example.run.scene.targets[0]
    range_m = target.range_m or float(row["truth_range_m"])
    turn = math.radians(180.0 + target.aspect_deg)
    along_m = float(row["truth_ground_speed_mps"]) * float(row["observation_s"]) * np.linspace(-0.5, 0.5, 41)
    x, y = range_m + along_m * math.cos(turn), along_m * math.sin(turn)
    height = float(row["truth_height_m"]) / 2.0 if row["truth_height_m"] == row["truth_height_m"] else 0.5
    up = height - example.run.scene.radar_position_m[2]
    cosine = -(x * math.cos(turn) + y * math.sin(turn)) / np.sqrt(x**2 + y**2 + up**2)
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).mean())


MOST_LIMITED = 0.05
"""Share of a class's rows that a limit of the radar may affect without a warning."""


def check_feasibility(contents: Contents) -> Check:
    """Check how many rows reach a limit of the radar."""
    if contents.measured:
        return Check("feasibility", "not applicable", "imported recordings have no truth to compare with")
    counts = limits_of_index(contents.index)
    reached = [(row, {name: row[name] for name in LIMITS if row[name]}) for row in counts]
    numbers = {row["class"]: {name: value for name, value in row.items() if name != "class"} for row in counts}
    words = "; ".join(
        f"{row['class']}: " + ", ".join(f"{name} {count}" for name, count in found.items()) + f" of {row['rows']} rows"
        for row, found in reached
        if found
    )
    many = any(count >= MOST_LIMITED * row["rows"] for row, found in reached for count in found.values())
    return Check(
        "feasibility", "warning" if many else "passed", words or "no row reaches a limit of the radar", numbers
    )


LEAST_SEEN = 0.5
"""Share of a class's rows in which its targets must be seen; none of ten rows is beyond chance."""
MOVING_MPS = 0.2
MAX_EMPTY_SHARE = 0.05


def check_visible_targets(contents: Contents) -> Check:
    """Check that targets which declare motion are visible."""
    # a class that is mostly noise fails; an empty scene that moves is a warning
    if contents.measured:
        return Check("visible targets", "not applicable", "imported recordings declare no motion")
    index = contents.index
    seen = read_column(index, "quality_snr_mu_db") >= SHOWN_DB
    moving = seen & (abs(read_column(index, "feature_torso_velocity_mps")) >= MOVING_MPS)
    empty_scene = (index["source"] == "none").to_numpy(dtype=bool)
    table = pd.DataFrame({"label": index["label"], "empty_scene": empty_scene, "seen": seen, "moving": moving})
    empty, odd, numbers = [], [], {}
    for (label, none), part in table.groupby(["label", "empty_scene"]):
        share = float(part["moving" if none else "seen"].mean())
        numbers[str(label)] = {"rows": len(part), "nobody": bool(none), "share_seen": share}
        if none and share > MAX_EMPTY_SHARE:
            odd.append(f"{label} is an empty scene, but something moves in {100 * share:.0f} % of {len(part)} rows")
        elif not none and has_too_few_hits(int(part["seen"].sum()), len(part), LEAST_SEEN):
            empty.append(f"{label} declares motion, but only {100 * share:.0f} % of {len(part)} rows show any")
    if empty:
        return Check("visible targets", "failed", "noise instead of motion: " + "; ".join([*empty, *odd]), numbers)
    if odd:
        return Check("visible targets", "warning", "; ".join(odd), numbers)
    listed = ", ".join(f"{label} {100 * found['share_seen']:.0f} %" for label, found in numbers.items())
    return Check("visible targets", "passed", f"rows with a visible target: {listed}", numbers)
