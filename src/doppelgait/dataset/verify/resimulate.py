"""Random examples of a dataset, simulated again from its plan.

The SNR is measured from separate signal and noise.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from itertools import groupby, islice
from typing import Any

import numpy as np
import pandas as pd

from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.dataset.config import list_some
from doppelgait.dataset.shard import BuildContext, build_planned
from doppelgait.dataset.shard_files import INDEX_NAMES, Arrays, decode
from doppelgait.dataset.verify.contents import MIN_PER_CLASS, Contents, Finding, judge
from doppelgait.dataset.verify.truth import SNR_TOLERANCE_DB
from doppelgait.features import FEATURE_UNITS
from doppelgait.pipeline import run_simulation

ARRAY_TOLERANCE, HALF_TOLERANCE = 1e-4, 2e-2
"""Relative L2 of an array. Single precision keeps 6e-8 and sums over thousands of pulses about 1e-6; float16 of
10 log10 has steps of up to 3 % of the power, so that a cell on an edge moves by as much."""
FEATURE_TOLERANCE = 1e-2
MAX_OTHER = 0.05
"""Share of rows in which features may differ by more, because a decision between two nearly equal candidates can
change."""
NAMES = ("label", "split", "subject", "others", "group", "source", "recording", "motion")

FACTS = ("truth_", "prf_hz", "observation_s", "radar_height_m", "rcs_total_m2", "snr_frame_db", "gate_error_m")
"""Columns that depend only on the plan; if they differ by more than :data:`FEATURE_TOLERANCE`, the row is from another
plan."""


@dataclass(frozen=True)
class Difference:
    """Difference between a stored row and its repetition."""

    id: str
    identical: bool
    array_l2: float = 0.0
    feature: float = 0.0
    reason: str = ""


def check_resimulation(contents: Contents) -> Finding:
    """Compare examples that are made again with the stored ones."""
    plan, chosen = contents.require_plan(), contents.chosen
    if not chosen:
        return Finding("not applicable", "nothing made again: none was requested, or none exists")
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
    return Finding("warning" if turned else "passed", words, numbers)


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
        size = float(np.linalg.norm(one))  # relative L2 in linear units, over the tolerance of the precision
        worst = max(worst, float(np.linalg.norm(two - one)) / (size if size > 0 else 1.0) / tolerance)
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


def check_measured_snr(contents: Contents) -> Finding:
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
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DoppelgaitWarning)
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
        return Finding("not applicable", "no example to measure, or none with a known SNR")
    largest_db = max(map(abs, errors_db))
    numbers = {"examples": len(errors_db), "largest_error_db": largest_db}
    words = f"{len(errors_db)} examples: SNR_frame as in the index, off by {largest_db:.2f} dB at most"
    return judge(f"SNR_frame of the index is off: {list_some(wrong)}" if wrong else "", words, numbers)
