"""Checks of features against truth, class by class.

A check fails where fewer than :data:`MIN_SHARE` of a class's rows are within the tolerance, by a one-sided binomial
test at 0.1 %. A wrong sign, unit, label or truth hits nearly every row and fails from seven rows on; single wrong
estimates never do. How often the estimators are right is another question; see :mod:`doppelgait.features`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.dataset.feasibility import LIMITS, limits_of_index
from doppelgait.dataset.resolve import ExampleSpec
from doppelgait.dataset.verify.contents import Contents, Finding, judge

FloatArray = npt.NDArray[np.float64]

MIN_SHARE = 2.0 / 3.0
LEVEL = 1e-3
# a Doppler cell at 0.1 s and 24 GHz (a quarter of one at 7 GHz); the share is for a main line off the body's centre
VELOCITY_TOLERANCE_MPS, VELOCITY_TOLERANCE_SHARE = 0.15, 0.1
FREQUENCY_TOLERANCE_SHARE = 0.1  # five times the resolution at five periods; a mistaken step is off by a factor of two
FREQUENCY_MIN_SNR_DB = 10.0
SNR_TOLERANCE_DB = 0.1  # the SNR is set, not estimated
ASPECT_TOLERANCE_DEG = 10.0  # the rise and fall of a walker's centre tilts its velocity by 8 degrees in the mean
SHOWN_DB = 3.0
"""A row shows something from this signature SNR on. Noise alone stays below 0 dB in gates of many range bins."""


def has_too_few_hits(hits: int, rows: int, least: float = MIN_SHARE) -> bool:
    """Return True if fewer than ``least`` rows hit, beyond chance."""
    from scipy.special import bdtr

    return rows > 0 and bool(bdtr(hits, rows, least) < LEVEL)


def judge_classes(table: pd.DataFrame, what: str, *, extra: str = "") -> Finding:
    """Check rows with ``label``, ``inside`` and ``error`` per class."""
    if table.empty:
        return Finding("not applicable", f"no row to compare: {what}")
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
    return judge(f"off as a whole: {', '.join(wrong)}; {summary}" if wrong else "", summary, numbers)


def read_column(index: pd.DataFrame, name: str) -> FloatArray:
    """Return a column of numbers, NaN where absent."""
    values = index[name] if name in index else pd.Series(np.nan, index=index.index)
    return np.asarray(pd.to_numeric(values).to_numpy(dtype=np.float64, na_value=np.nan))


def check_velocity(contents: Contents) -> Finding:
    """Check the torso velocity against the body's mean radial velocity."""
    index = contents.index
    truth = read_column(index, "truth_radial_velocity_mps")
    error = np.abs(read_column(index, "feature_torso_velocity_mps") - truth)
    table = pd.DataFrame({"label": index["label"], "error": error})
    table["inside"] = error <= VELOCITY_TOLERANCE_MPS + VELOCITY_TOLERANCE_SHARE * np.abs(truth)
    known = np.isfinite(error) & (read_column(index, "quality_snr_mu_db") >= SHOWN_DB)
    return judge_classes(table[known], "within 0.15 m/s + 10 % of the truth", extra=" (rms {rms:.2f} m/s)")


def check_gait_frequency(contents: Contents) -> Finding:
    """Check the gait frequency against the truth."""
    index = contents.index
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = read_column(index, "gait_frequency_hz") / read_column(index, "truth_gait_frequency_hz")
    error = np.abs(ratio - 1.0)
    sure = ~index["quality_flags"].fillna("").astype(str).str.contains("low_confidence").to_numpy(dtype=bool)
    known = np.isfinite(error) & sure & (read_column(index, "quality_snr_mu_db") >= FREQUENCY_MIN_SNR_DB)
    table = pd.DataFrame({"label": index["label"], "error": error, "inside": error <= FREQUENCY_TOLERANCE_SHARE})
    return judge_classes(table[known], "within 10 % of the truth where not flagged and 10 dB or more")


def check_snr(contents: Contents) -> Finding:
    """Check SNR_frame of the index against the plan."""
    planned = {e.id: e.run.noise.snr_db for e in contents.examples if e.run.noise.kind == "snr"}
    if not planned:
        return Finding("not applicable", "the plan sets no SNR")
    index = contents.index
    rows = index[index["scene_id"].isin(list(planned)) & (index["source"] != "none")]
    error = np.abs(read_column(rows, "snr_frame_db") - np.array([planned[name] for name in rows["scene_id"]]))
    table = pd.DataFrame({"label": rows["label"], "error": error, "inside": error <= SNR_TOLERANCE_DB})
    return judge_classes(table, "SNR_frame within 0.1 dB of the plan")


def check_aspect(contents: Contents) -> Finding:
    """Check the aspect angle against the plan's."""
    # bodies that walk straight through the planned place are used
    table = []
    first = contents.index[contents.index["id"] == contents.index["scene_id"]].drop_duplicates("id")
    rows: dict[str, Any] = {row["id"]: row for row in first.to_dict("records")}
    for example in contents.examples:
        target = example.run.scene.targets[0]
        placed = target.start_position_m is None and target.path is None and example.rows[0].source != "none"
        if placed and (row := rows.get(example.id)) is not None:
            error = abs(float(row["truth_aspect_deg"]) - expected_aspect_deg(example, row))
            table.append({"label": row["label"], "error": error, "inside": error <= ASPECT_TOLERANCE_DEG})
    frame = pd.DataFrame(table, columns=["label", "error", "inside"]).dropna(subset="error")
    return judge_classes(frame, "within 10 degrees of the planned path's", extra=" (rms {rms:.1f} degrees)")


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


MAX_LIMITED = 0.05  # share of a class's rows that a limit of the radar may affect without a warning


def check_feasibility(contents: Contents) -> Finding:
    """Check how many rows reach a limit of the radar."""
    counts = limits_of_index(contents.index)
    parts, many = [], False
    for row in counts:
        reached = {name: row[name] for name in LIMITS if row[name]}
        if reached:
            parts.append(f"{row['class']}: {', '.join(f'{n} {c}' for n, c in reached.items())} of {row['rows']} rows")
        many |= any(count >= MAX_LIMITED * row["rows"] for count in reached.values())
    numbers = {row["class"]: {name: value for name, value in row.items() if name != "class"} for row in counts}
    summary = "; ".join(parts) or "no row reaches a limit of the radar"
    return Finding("warning" if many else "passed", summary, numbers)


MIN_SEEN = 0.5
"""Share of a class's rows in which its targets must be seen; none of ten rows is beyond chance."""
MOVING_MPS = 0.2
MAX_EMPTY_SHARE = 0.05


def check_visible_targets(contents: Contents) -> Finding:
    """Check that targets which declare motion are visible."""
    # a class that is mostly noise fails; an empty scene that moves is a warning
    index = contents.index
    seen = read_column(index, "quality_snr_mu_db") >= SHOWN_DB
    moving = seen & (abs(read_column(index, "feature_torso_velocity_mps")) >= MOVING_MPS)
    empty_scene = (index["source"] == "none").to_numpy(dtype=bool)
    table = pd.DataFrame({"label": index["label"], "empty": empty_scene, "shown": np.where(empty_scene, moving, seen)})
    noise, odd, numbers = [], [], {}
    for (label, empty), part in table.groupby(["label", "empty"])["shown"]:
        share, rows = float(part.mean()), len(part)
        numbers[str(label)] = {"rows": rows, "nobody": bool(empty), "share_seen": share}
        if empty and share > MAX_EMPTY_SHARE:
            odd.append(f"{label} is an empty scene, but something moves in {100 * share:.0f} % of {rows} rows")
        elif not empty and has_too_few_hits(int(part.sum()), rows, MIN_SEEN):
            noise.append(f"{label} declares motion, but only {100 * share:.0f} % of {rows} rows show any")
    if noise:
        return Finding("failed", f"noise instead of motion: {'; '.join([*noise, *odd])}", numbers)
    listed = ", ".join(f"{label} {100 * found['share_seen']:.0f} %" for label, found in numbers.items())
    summary = "; ".join(odd) or f"rows with a visible target: {listed}"
    return Finding("warning" if odd else "passed", summary, numbers)
