"""Checks of features against truth, class by class, and of rows against a repeated simulation.

A check of a class fails where fewer than :data:`MIN_SHARE` of its rows are within the tolerance, by a
one-sided binomial test: a wrong sign, unit or label fails, single wrong estimates never do.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby, islice
from typing import Any

import numpy as np
import pandas as pd

from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.core.units import FloatArray
from doppelgait.dataset.config import list_some
from doppelgait.dataset.feasibility import LIMITS, limits_of_index
from doppelgait.dataset.resolve import ExampleSpec
from doppelgait.dataset.shard import BuildContext, build_planned
from doppelgait.dataset.shard_files import INDEX_NAMES, Arrays, decode
from doppelgait.dataset.verify.contents import MIN_PER_CLASS, Check, Contents, judge
from doppelgait.features import FEATURE_UNITS
from doppelgait.pipeline import run_simulation

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


def judge_classes(table: pd.DataFrame, what: str, *, extra: str = "") -> Check:
    """Check rows with ``label``, ``inside`` and ``error`` per class."""
    if table.empty:
        return Check("not applicable", f"no row to compare: {what}")
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


def check_velocity(contents: Contents) -> Check:
    """Check the torso velocity against the body's mean radial velocity."""
    index = contents.index
    truth = read_column(index, "truth_radial_velocity_mps")
    error = np.abs(read_column(index, "feature_torso_velocity_mps") - truth)
    table = pd.DataFrame({"label": index["label"], "error": error})
    table["inside"] = error <= VELOCITY_TOLERANCE_MPS + VELOCITY_TOLERANCE_SHARE * np.abs(truth)
    known = np.isfinite(error) & (read_column(index, "quality_snr_mu_db") >= SHOWN_DB)
    return judge_classes(table[known], "within 0.15 m/s + 10 % of the truth", extra=" (rms {rms:.2f} m/s)")


def check_gait_frequency(contents: Contents) -> Check:
    """Check the gait frequency against the truth."""
    index = contents.index
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = read_column(index, "gait_frequency_hz") / read_column(index, "truth_gait_frequency_hz")
    error = np.abs(ratio - 1.0)
    sure = ~index["quality_flags"].fillna("").astype(str).str.contains("low_confidence").to_numpy(dtype=bool)
    known = np.isfinite(error) & sure & (read_column(index, "quality_snr_mu_db") >= FREQUENCY_MIN_SNR_DB)
    table = pd.DataFrame({"label": index["label"], "error": error, "inside": error <= FREQUENCY_TOLERANCE_SHARE})
    return judge_classes(table[known], "within 10 % of the truth where not flagged and 10 dB or more")


def check_snr(contents: Contents) -> Check:
    """Check SNR_frame of the index against the plan."""
    planned = {e.id: e.run.noise.snr_db for e in contents.examples if e.run.noise.kind == "snr"}
    if not planned:
        return Check("not applicable", "the plan sets no SNR")
    index = contents.index
    rows = index[index["scene_id"].isin(list(planned)) & (index["source"] != "none")]
    error = np.abs(read_column(rows, "snr_frame_db") - np.array([planned[name] for name in rows["scene_id"]]))
    table = pd.DataFrame({"label": rows["label"], "error": error, "inside": error <= SNR_TOLERANCE_DB})
    return judge_classes(table, "SNR_frame within 0.1 dB of the plan")


def check_aspect(contents: Contents) -> Check:
    """Check the aspect angle against the plan's."""
    # bodies that walk straight through the planned place are used
    table = []
    first = contents.index[contents.index["id"] == contents.index["scene_id"]].drop_duplicates("id")
    rows: dict[str, Any] = {row["id"]: row for row in first.to_dict("records")}
    for example in contents.examples:
        if example.is_episode:
            continue
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


def check_feasibility(contents: Contents) -> Check:
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
    return Check("warning" if many else "passed", summary, numbers)


MIN_SEEN = 0.5
"""Share of a class's rows in which its targets must be seen; none of ten rows is beyond chance."""
MOVING_MPS = 0.2
MAX_EMPTY_SHARE = 0.05


def check_visible_targets(contents: Contents) -> Check:
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
        return Check("failed", f"noise instead of motion: {'; '.join([*noise, *odd])}", numbers)
    listed = ", ".join(f"{label} {100 * found['share_seen']:.0f} %" for label, found in numbers.items())
    summary = "; ".join(odd) or f"rows with a visible target: {listed}"
    return Check("warning" if odd else "passed", summary, numbers)


ARRAY_TOLERANCE, HALF_TOLERANCE = 1e-4, 2e-2
"""Relative L2 of an array. Single precision keeps 6e-8 and sums over thousands of pulses about 1e-6; float16 of
10 log10 has steps of up to 3 % of the power, so that a cell on an edge moves by as much."""
FEATURE_TOLERANCE = 1e-2
MAX_OTHER = 0.05
"""Share of rows in which features may differ by more, because a decision between two nearly equal
candidates can change."""
NAMES = ("label", "split", "subject", "others", "group", "source", "recording", "motion")

FACTS = ("truth_", "prf_hz", "observation_s", "radar_height_m", "rcs_total_m2", "snr_frame_db", "gate_error_m")
"""Columns that depend only on the plan; if they differ by more than :data:`FEATURE_TOLERANCE`, the
row is from another plan."""


@dataclass(frozen=True)
class Difference:
    """Difference between a stored row and its repetition."""

    id: str
    identical: bool
    array_l2: float = 0.0
    feature: float = 0.0
    reason: str = ""


def check_resimulation(contents: Contents) -> Check:
    """Compare examples that are made again with the stored ones."""
    plan, chosen = contents.require_plan(), contents.chosen
    if not chosen:
        return Check("not applicable", "nothing made again: none was requested, or none exists")
    context = BuildContext(plan.config, str(plan.folder), str(contents.directory))
    found: list[Difference] = []
    for entry in chosen:
        contents.tick()
        rows = contents.index[contents.index["scene_id"] == entry.id]
        (made,) = build_planned([entry], context)
        if isinstance(made, Exception):
            found.append(Difference(entry.id, False, reason=f"cannot be made again: {made}"))
        elif [row["id"] for row in made.rows] != rows["id"].tolist():
            found.append(Difference(entry.id, False, reason="has other rows"))
        else:
            found += [_compare(contents, rows.iloc[n], row, arrays) for n, (row, arrays) in enumerate(made)]
    identical = sum(difference.identical for difference in found)
    reasons = [f"{d.id}: {d.reason}" for d in found if d.reason]
    off = [f"{d.id}: array off by {d.array_l2:.1f} times the tolerance" for d in found if d.array_l2 > 1]
    turned = [f"{d.id}: features off by {100 * d.feature:.2g} %" for d in found if d.feature > FEATURE_TOLERANCE]
    if len(turned) > MAX_OTHER * len(found):
        off += turned
    numbers = {
        "examples": len(chosen),
        "rows": len(found),
        "identical": identical,
        "worst_array_over_tolerance": max(d.array_l2 for d in found),
        "features_off": len(turned),
        "largest_feature_difference": max((d.feature for d in found if math.isfinite(d.feature)), default=0.0),
    }
    if reasons or off or identical == len(found):
        return judge(list_some([*reasons, *off]), f"{len(chosen)} examples made again: identical bytes", numbers)
    words = (
        f"{len(chosen)} examples made again: {identical} of {len(found)} rows identical, of the others {len(turned)} "
        f"with features off by more than {100 * FEATURE_TOLERANCE:g} %, arrays within tolerance (another processor or "
        f"library? made with doppelgait {contents.description.get('doppelgait_version')})"
    )
    return Check("warning" if turned else "passed", words, numbers)


def _compare(contents: Contents, there: pd.Series, row: dict[str, Any], arrays: Arrays) -> Difference:
    off = {name: _compare_values(made, there.get(INDEX_NAMES.get(name, name))) for name, made in row.items()}
    wrong = [name for name in NAMES if off[name] > 0]
    wrong += [name for name, value in off.items() if name.startswith(FACTS) and value > FEATURE_TOLERANCE]
    feature = max(off[name] for name in (*(f"feature_{name}" for name in FEATURE_UNITS), "gait_frequency_hz"))
    files, worst, equal_arrays = contents.dataset.files, 0.0, True
    for name, values in arrays.items():
        stored = files.read(str(there["shard"]), name, int(there["row"]))
        if stored is None or stored.shape != values.shape:
            return Difference(row["id"], False, reason=f"{name} has another shape")
        if stored.dtype == values.dtype and stored.tobytes() == values.tobytes():
            continue
        equal_arrays = False
        facts = contents.description["fields"].get(name, {})
        tolerance = HALF_TOLERANCE if facts.get("scale") == "db" else ARRAY_TOLERANCE
        one, two = decode(stored, facts), decode(values, facts)
        # relative L2 in linear units, over the tolerance of the precision
        size = float(np.linalg.norm(one)) or 1.0
        worst = max(worst, float(np.linalg.norm(two - one)) / size / tolerance)
    files.close()
    reason = f"{wrong[0]} is {there.get(wrong[0])}, made again {row[wrong[0]]}" if wrong else ""
    return Difference(row["id"], equal_arrays and not any(off.values()), worst, feature, reason)


def _compare_values(made: Any, there: Any) -> float:
    """Return the relative difference of two values, infinite for texts and where one is unknown (None or NaN)."""
    stored = None if there is None or there != there else there
    if made == stored:
        return 0.0
    if made is None or stored is None or isinstance(made, str):
        return math.inf
    return float(abs(made - stored) / max(abs(made), abs(stored)))


def check_measured_snr(contents: Contents) -> Check:
    """Compare SNR_frame of a few examples with the index."""
    # signal: time mean of the strongest range bin's power without noise
    plan = contents.require_plan()
    by_class = groupby(contents.chosen, key=lambda entry: entry.class_number)
    stated_db = contents.index.drop_duplicates("scene_id").set_index("scene_id")["snr_frame_db"].dropna()
    errors_db, wrong = [], []
    for entry in (entry for _, group in by_class for entry in islice(group, MIN_PER_CLASS)):
        contents.tick()
        if entry.id not in stated_db:
            continue
        run = plan.example(entry.number).run
        bodies = tuple(target for target in run.scene.targets if not target.background)
        alone = {"impairments": (), "scene": run.scene.model_copy(update={"targets": bodies})}
        run = run.model_copy(update=alone)
        quiet = run.model_copy(update={"noise": run.noise.model_copy(update={"kind": "none"})})
        with warnings.catch_warnings(action="ignore", category=DoppelgaitWarning):
            both, echoes = (
                run_simulation(spec, folder=plan.folder, angles=False).baseband.values for spec in (run, quiet)
            )
        signal_v2 = float(np.mean(np.max(np.abs(echoes) ** 2, axis=1)))
        noise_v2 = float(np.mean(np.abs(both - echoes) ** 2))
        snr_db = 10.0 * math.log10(signal_v2 / noise_v2) if signal_v2 > 0 and noise_v2 > 0 else math.nan
        errors_db.append(snr_db - float(stated_db[entry.id]))
        if not abs(errors_db[-1]) <= max(SNR_TOLERANCE_DB, 4.0 * 10.0 / math.log(10.0) / math.sqrt(both.size)):
            wrong.append(f"{entry.id} by {errors_db[-1]:+.1f} dB")
    if not errors_db:
        return Check("not applicable", "no example to measure, or none with a known SNR")
    largest_db = max(map(abs, errors_db))
    numbers = {"examples": len(errors_db), "largest_error_db": largest_db}
    words = f"{len(errors_db)} examples: SNR_frame as in the index, off by {largest_db:.2f} dB at most"
    return judge(f"SNR_frame of the index is off: {list_some(wrong)}" if wrong else "", words, numbers)
