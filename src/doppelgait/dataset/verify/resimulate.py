"""Random examples of a dataset, simulated again from its plan.

The SNR is measured from separate signal and noise.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.dataset.config import list_some
from doppelgait.dataset.plan import PlannedExample
from doppelgait.dataset.shard import BuildContext, build_planned
from doppelgait.dataset.shard_files import INDEX_NAMES, Arrays, decode
from doppelgait.dataset.verify.contents import Check, Contents
from doppelgait.dataset.verify.truth import SNR_TOLERANCE_DB
from doppelgait.features import FEATURE_UNITS
from doppelgait.pipeline import run_simulation

LEAST_PER_CLASS = 3
ARRAY_TOLERANCE, HALF_TOLERANCE = 1e-4, 2e-2
"""Relative L2 of an array. Single precision keeps 6e-8 and sums over thousands of pulses about 1e-6; float16 of
10 log10 has steps of up to 3 % of the power, so that a cell on an edge moves by as much."""
FEATURE_TOLERANCE = 1e-2
MOST_OTHER = 0.05
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


def choose(contents: Contents, share: float, rng: np.random.Generator) -> list[PlannedExample]:
    """Choose a share of the examples, at least three per class."""
    if contents.plan is None or not share > 0:
        return []
    present = set(contents.index["scene_id"])
    chosen: list[PlannedExample] = []
    for number in range(len(contents.plan.config.classes)):
        members = [e for e in contents.plan.examples if e.class_number == number and e.id in present]
        count = min(len(members), max(LEAST_PER_CLASS, math.ceil(share * len(members))))
        chosen += [members[n] for n in sorted(rng.choice(len(members), count, replace=False))] if members else []
    return chosen


def check_resimulation(contents: Contents, chosen: Sequence[PlannedExample], tick: Callable[[], None]) -> Check:
    """Compare examples that are made again with the stored ones."""
    if contents.plan is None or contents.unlike or not chosen:
        reason = contents.no_plan or contents.unlike or "none was requested, or none exists"
        status: Any = (
            contents.no_plan_status if contents.plan is None else "skipped" if contents.unlike else "not applicable"
        )
        return Check("re-simulation", status, f"nothing made again: {reason}")
    context = BuildContext(contents.plan.config, str(contents.plan.folder), str(contents.directory))
    found: list[Difference] = []
    for entry in chosen:
        tick()
        rows = contents.index[contents.index["scene_id"] == entry.id]
        (made,) = build_planned([entry], context)
        if isinstance(made, Exception):
            found.append(Difference(entry.id, False, reason=f"cannot be made again: {made}"))
            continue
        if [row["id"] for row in made.rows] != rows["id"].tolist():
            found.append(Difference(entry.id, False, reason="has other rows"))
            continue
        found += [_compare(contents, rows.iloc[n], row, arrays) for n, (row, arrays) in enumerate(made)]
    identical = sum(difference.identical for difference in found)
    reasons = [f"{d.id}: {d.reason}" for d in found if d.reason]
    off = [f"{d.id}: array off by {d.array_l2:.1f} times the tolerance" for d in found if d.array_l2 > 1]
    turned = [f"{d.id}: features off by {100 * d.feature:.2g} %" for d in found if d.feature > FEATURE_TOLERANCE]
    if len(turned) > MOST_OTHER * len(found):
        off += turned
    numbers = {
        "examples": len(chosen),
        "rows": len(found),
        "identical": identical,
        "worst_array_over_tolerance": max(d.array_l2 for d in found),
        "features_off": len(turned),
        "largest_feature_difference": max((d.feature for d in found if math.isfinite(d.feature)), default=0.0),
    }
    if reasons or off:
        return Check("re-simulation", "failed", list_some([*reasons, *off]), numbers)
    if identical == len(found):
        return Check("re-simulation", "passed", f"{len(chosen)} examples made again: identical bytes", numbers)
    words = (
        f"{len(chosen)} examples made again: {identical} of {len(found)} rows identical, of the others {len(turned)} "
        f"with features off by more than {100 * FEATURE_TOLERANCE:g} %, arrays within tolerance (another processor or "
        f"library? made with doppelgait {contents.description.get('doppelgait_version')})"
    )
    return Check("re-simulation", "warning" if turned else "passed", words, numbers)


def _compare(contents: Contents, there: pd.Series, row: dict[str, Any], arrays: Arrays) -> Difference:
    equal_row = all(_is_same(there.get(INDEX_NAMES.get(name, name)), value) for name, value in row.items())
    other = [name for name in NAMES if not _is_same(there.get(name), row[name])]
    for name, made in row.items():
        if name.startswith(FACTS):
            exact = isinstance(made, str) or made is None
            far = (
                not _is_same(there.get(name), made)
                if exact
                else _compare_numbers(made, there.get(name)) > FEATURE_TOLERANCE
            )
            other += [name] if far else []
    features = [*(f"feature_{name}" for name in FEATURE_UNITS), "gait_frequency_hz"]
    feature = max(_compare_numbers(row[name], there.get(name)) for name in features)
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
    reason = f"{other[0]} is {there.get(other[0])}, made again {row[other[0]]}" if other else ""
    return Difference(row["id"], equal_row and equal_arrays, worst, feature, reason)


def _is_same(there: Any, made: Any) -> bool:
    """Return True for equal values, unknown being None or NaN."""
    if there is None or there != there:
        return made is None
    return bool(there == made)


def _compare_numbers(made: Any, there: Any) -> float:
    """Return the relative difference of two numbers, infinite if one is unknown."""
    unknown = (made is None, there is None or there != there)
    if any(unknown):
        return 0.0 if all(unknown) else math.inf
    size = max(abs(made), abs(there))
    return float(abs(made - there) / size) if size > 0 else 0.0


def check_measured_snr(contents: Contents, chosen: Sequence[PlannedExample], tick: Callable[[], None]) -> Check:
    """Compare SNR_frame of a few examples with the index."""
    # signal: time mean of the strongest range bin's power without noise
    if contents.plan is None or contents.unlike:
        status: Any = contents.no_plan_status if contents.plan is None else "skipped"
        return Check("measured SNR", status, contents.no_plan or contents.unlike)
    few = [
        entry
        for number in sorted({e.class_number for e in chosen})
        for entry in [e for e in chosen if e.class_number == number][:LEAST_PER_CLASS]
    ]
    known = contents.index.drop_duplicates("scene_id").set_index("scene_id")["snr_frame_db"]
    errors, tolerance_db = {}, {}
    for entry in few:
        tick()
        stated = known.get(entry.id)
        if stated is None or stated != stated:
            continue
        run = contents.plan.example(entry.number).run
        bodies = tuple(target for target in run.scene.targets if not target.background)
        alone = {"impairments": (), "scene": run.scene.model_copy(update={"targets": bodies})}
        run = run.model_copy(update=alone)
        quiet = run.model_copy(update={"noise": run.noise.model_copy(update={"kind": "none"})})
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DoppelgaitWarning)
            both, echoes = (
                run_simulation(spec, folder=contents.plan.folder, angles=False).baseband.values for spec in (run, quiet)
            )
        signal_v2 = float(np.mean(np.max(np.abs(echoes) ** 2, axis=1)))
        noise_v2 = float(np.mean(np.abs(both - echoes) ** 2))
        snr_db = 10.0 * math.log10(signal_v2 / noise_v2) if signal_v2 > 0 and noise_v2 > 0 else math.nan
        errors[entry.id] = snr_db - float(stated)
        tolerance_db[entry.id] = max(SNR_TOLERANCE_DB, 4.0 * 10.0 / math.log(10.0) / math.sqrt(both.size))
    if not errors:
        return Check("measured SNR", "not applicable", "no example to measure, or none with a known SNR")
    wrong = [f"{name} by {error:+.1f} dB" for name, error in errors.items() if not abs(error) <= tolerance_db[name]]
    numbers = {"examples": len(errors), "largest_error_db": max(abs(error) for error in errors.values())}
    if wrong:
        return Check("measured SNR", "failed", f"SNR_frame of the index is off: {list_some(wrong)}", numbers)
    words = f"{len(errors)} examples: SNR_frame as in the index, off by {numbers['largest_error_db']:.2f} dB at most"
    return Check("measured SNR", "passed", words, numbers)
