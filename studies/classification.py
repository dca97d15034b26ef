"""Classification of people and dogs: trained on models, tested on motion capture.

    python studies/classification.py MOTION_FOLDER OUT_FOLDER [--share 0.05] [--ablation]

MOTION_FOLDER holds recordings in its folders ``human``, ``clinic`` and ``dog``, with subjects named as in
:data:`SOURCES`. Datasets are built into OUT_FOLDER after ``plans/evidence.toml``; the report is
``classification.md`` with its figures. The charter's conditions (:func:`easy`) were written down before any score.

Complete datasets in OUT_FOLDER are taken as they are: empty it after a change of the package.

The headline is the held half: people and the dog that the models were not made of (:func:`with_half`). ``--ablation``
trains on variants of the plan (:data:`VARIANTS`) that lack one thing each.

What learns: six features, all features, the network on signatures if torch is there; beside them chance, the nuisance
parameters alone and the speed alone. Tested on are all straight stretches of all recordings, each several times.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from recorded_motion import Clip, is_tuning

from doppelgait.classify.evaluation import Evaluation, evaluate
from doppelgait.classify.scores import (
    CONDITIONS,
    balanced_accuracy,
    balanced_interval,
    clopper_pearson_interval,
    find_condition_values,
    make_bin_edges,
    wilson_interval,
)
from doppelgait.core.config import validate
from doppelgait.dataset import build_dataset, load_plan, open_dataset
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.open import Dataset
from doppelgait.viz.style import make_figure

PLAN = Path(__file__).parent / "plans" / "evidence.toml"
DURATIONS_S = (1.0, 2.0, 4.0, 8.0)
MAIN_S = 4.0
SIZES = {"models": 1500, "mocap": 1500}
"""Examples of a class; of the other durations and variants a third of it."""
SOURCES = [
    {"files": "human/*/cmu_*", "subject": r"/(cmu_\d+)_", "licence": ""},
    {"files": "human/*/bandai2_*", "subject": "/(bandai2)_", "licence": ""},
    {"files": "clinic/*", "subject": r"Subject([A-D]\d+)_", "licence": ""},
    {"files": "dog/*", "subject": "dog/([a-z]+)-", "licence": ""},
]
"""Who is who in the recordings; a file of none of these is a subject of its own."""
CLASSES = [
    {"label": "human", "motion": {"choice": [{"kind": "folder", "path": path} for path in ("human", "clinic")]}},
    {"label": "dog", "motion": {"kind": "folder", "path": "dog"}},
]
TUNING_DOG = "mann"
"""The dog that the quadruped's curves were made of."""
VARIATION = ("_sd", "_variation", "asymmetry")
"""Endings of the parameters by which successive steps differ."""
VARIANTS: dict[str, Callable[[dict[str, Any]], dict[str, Any] | None]] = {
    "as planned": lambda motion: motion,
    "walkers of Boulic alone": lambda motion: (
        None if (motion["kind"], motion.get("gait")) == ("human", "walk") else motion
    ),
    "no walker of Boulic": lambda motion: None if motion["kind"] == "boulic" else motion,
    "all steps alike": lambda motion: {k: v for k, v in motion.items() if not k.endswith(VARIATION)},
    "trunk without ripple": lambda motion: motion | {"trunk_ripple": 0.0} if "trunk_ripple" in motion else motion,
    "mean bodies": lambda motion: {k: v for k, v in motion.items() if k in BASIC or k.endswith(VARIATION)},
    "no gallop": lambda motion: None if "gallop" in motion.get("gait", "") else motion,
}
"""Plans that lack one thing: what they make of each entry of a class; None leaves it out."""
BASIC = ("kind", "gait", "speed_mps", "froude", "height_m", "withers_m", "start_phase")
LEAST_PERIODS, WIDEST_DEG, LEAST_SNR_DB = 3.0, 30.0, 15.0
FEATURE_MODELS = (
    "six-logistic", "six-boosting", "six-svm", "extended-logistic", "extended-boosting", "extended-svm",
)  # fmt: skip
"""With each of the subjects left out in turn; the network would take half an hour more."""
HALVES = ("held", "tuning")
ABLATION_MODELS = ("extended-logistic", "extended-boosting", "extended-svm")
MODELS_ON_AXES = (
    "ensemble", "extended-logistic", "extended-boosting", "extended-svm", "signature-network", "speed",
)  # fmt: skip


def easy(index: pd.DataFrame) -> pd.Series:
    """Mark rows under the reference conditions.

    3 periods or more, within 30 degrees, SNR_mu of 15 dB or more.
    """
    aspect = CONDITIONS[1]
    _, aspect_deg = find_condition_values(index, aspect)
    periods = index["truth_gait_frequency_hz"] * index["observation_s"]
    near = pd.Series(aspect_deg <= WIDEST_DEG, index=index.index)
    return (periods >= LEAST_PERIODS) & near & (index["quality_snr_mu_db"] >= LEAST_SNR_DB)


def with_half(index: pd.DataFrame, folder: Path) -> pd.DataFrame:
    """Add the half of each recording to the index: held or tuning."""

    def half(label: str, recording: str) -> str:
        tuning = TUNING_DOG in recording if label == "dog" else is_tuning(Clip(recording, ""), folder)
        return "tuning" if tuning else "held"

    return index.assign(half=[half(*row) for row in zip(index["label"], index["recording"], strict=True)])


def vary(table: dict[str, Any], variant: str) -> None:
    """Change the motions of a plan to those of a variant."""
    for section in table["classes"]:
        changed = (VARIANTS[variant](dict(motion)) for motion in section["motion"]["choice"])
        section["motion"] = {"choice": [motion for motion in changed if motion is not None]}


def dataset(
    kind: str, duration_s: float, folder: Path, out: Path, *, share: float, clean: bool = False, variant: str = ""
) -> Dataset:
    """Build or resume one of the datasets."""
    target = out / "-".join(filter(None, (kind, f"{duration_s:g}s", clean * "clean", variant.replace(" ", "-"))))
    if (target / "dataset.json").is_file() and open_dataset(target).description.get("complete"):
        print(f"{target.name}: was there", flush=True)
        return open_dataset(target)
    size = SIZES[kind] // (1 if duration_s == MAIN_S and not (clean or variant) else 3)
    plan, base = load_plan(PLAN, overrides=[
        f"scene.duration_s={duration_s}", f"dataset.examples_per_class={max(int(size * share), 20)}",
    ])  # fmt: skip
    if kind == "mocap":
        table = plan.model_dump(mode="python")
        table["dataset"].update(name="evidence-mocap", seed=2026, fractions={"test": 1.0})
        table.update(classes=CLASSES, sources=SOURCES)
        if clean:
            table["noise"] = {"kind": "none"}
        plan, base = validate(PlanConfig, table, where="evidence-mocap"), folder
    elif variant:
        table = plan.model_dump(mode="python")
        vary(table, variant)
        plan = validate(PlanConfig, table, where=variant)
    report = build_dataset(plan, target, folder=base, max_failed_share=0.02)
    print(f"{target.name}: {report.n_rows} rows, {report.n_built} made in {report.seconds:.0f} s", flush=True)
    return open_dataset(target)


def joined(found: Evaluation, tested: Dataset) -> pd.DataFrame:
    """Return the tested rows with the predictions of every model.

    Columns ``right:NAME`` and ``NAME:human``.
    """
    answers = found.answers.set_index("id")
    index = tested.index.set_index("id").loc[answers.index]
    for name in found.document["models"]:
        index[f"right:{name}"] = answers[f"{name}:class"] == answers["label"]
        index[f"p:{name}"] = answers[f"{name}:human"]
    return index


def score(index: pd.DataFrame, name: str) -> dict[str, Any]:
    """Return balanced accuracy and recalls of some rows, with intervals.

    The intervals count targets, not rows.
    """
    labels = (index["label"] == "dog").to_numpy(dtype=np.int64)
    right = index[f"right:{name}"].to_numpy(dtype=bool)
    groups = index["subject"].to_numpy(dtype=str)
    if not right.size:
        return {"n": 0}
    found = balanced_interval(labels, right, groups, 2, np.random.default_rng(0))
    shares = {
        label: (float(right[labels == n].mean()), int((labels == n).sum()))
        for n, label in enumerate(("human", "dog"))
        if (labels == n).any()
    }
    return {
        "n": right.size,
        "value": balanced_accuracy(labels, right, 2),
        "low": found.low,
        "high": found.high,
        **shares,
    }


def percent(value: float) -> str:
    """Format a share in percent."""
    return "" if not np.isfinite(value) else f"{100 * value:.1f}"


def main_table(parts: dict[str, pd.DataFrame], names: Sequence[str]) -> list[str]:
    """Tabulate the balanced accuracy of every model in several sets."""
    lines = ["| model | " + " | ".join(parts) + " |", "| --- " * (len(parts) + 1) + "|"]
    for name in names:
        cells = []
        for rows in parts.values():
            found = score(rows, name)
            if not found["n"]:
                cells.append("none")
                continue
            cells.append(
                f"**{percent(found['value'])}** ({percent(found['low'])}-{percent(found['high'])}); people "
                f"{percent(found.get('human', (np.nan,))[0])}, dogs {percent(found.get('dog', (np.nan,))[0])}"
            )
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return lines


def by_column(index: pd.DataFrame, columns: Sequence[str], names: Sequence[str]) -> list[str]:
    """Tabulate the accuracy by values of columns, for several models.

    Exact intervals of the first model.
    """
    lines = [f"| {' | '.join(columns)} | rows | {' | '.join(names)} | interval of {names[0]} |"]
    lines.append("| --- " * (len(columns) + len(names) + 2) + "|")
    for values, rows in index.groupby(list(columns), observed=True, dropna=False):
        shares = [percent(float(rows[f"right:{name}"].mean())) for name in names]
        low, high = wilson_interval(
            rows[f"right:{names[0]}"].to_numpy(dtype=bool), rows["recording"].to_numpy(dtype=str)
        )
        words = " | ".join(map(str, values))
        lines.append(f"| {words} | {len(rows)} | {' | '.join(shares)} | {percent(low)}-{percent(high)} |")
    return lines


def by_recording(index: pd.DataFrame, columns: Sequence[str], names: Sequence[str]) -> list[str]:
    """Tabulate the recordings that are right in most of their rows, with exact intervals."""
    lines = [f"| {' | '.join(columns)} | {' | '.join(names)} | wrong by {names[0]} |"]
    lines.append("| --- " * (len(columns) + len(names) + 1) + "|")
    for values, rows in index.groupby(list(columns), observed=True):
        cells = []
        for name in names:
            right = rows.groupby("recording")[f"right:{name}"].mean() > 0.5
            low, high = clopper_pearson_interval(float(right.sum()), right.size)
            cells.append(f"{right.sum()} of {right.size} ({percent(low)}-{percent(high)})")
        share = rows.groupby("recording")[f"right:{names[0]}"].mean()
        wrong = ", ".join(Path(recording).stem for recording in share.index[share <= 0.5])
        lines.append(f"| {' | '.join(map(str, values))} | {' | '.join(cells)} | {wrong} |")
    return lines


def ablation(folder: Path, out: Path, tested: Dataset, *, share: float) -> list[str]:
    """Tabulate what each variant of the plan is worth: balanced accuracy and recalls."""
    lines = []
    for variant in VARIANTS:
        trained = dataset("models", MAIN_S, folder, out, share=share, variant=variant)
        rows = with_half(joined(evaluate(trained, other=tested, models=ABLATION_MODELS), tested), folder)
        rows = rows[easy(rows)]
        parts = {half: rows[rows["half"] == half] for half in HALVES}
        head, rule, *cells = main_table(parts, ABLATION_MODELS)
        lines = lines or [f"| trained on {head}", f"| --- {rule}"]
        lines += [f"| {variant} {line}" for line in cells]
    return lines


def speed_bins(index: pd.DataFrame) -> pd.DataFrame:
    """Add the ground speed in steps of 0.5 m/s to the index."""
    step = np.floor(index["truth_ground_speed_mps"] / 0.5) * 0.5
    return index.assign(speed=[f"{low:.1f}-{low + 0.5:.1f} m/s" for low in step])


def draw_curves(main: pd.DataFrame, by_time: dict[float, pd.DataFrame], names: Sequence[str]) -> Figure:
    """Tabulate balanced accuracy by SNR, aspect and observation time.

    With intervals of the first model.
    """
    figure = make_figure(width_in=13.0, height_in=4.0)
    panels = figure.subplots(1, 3, sharey=True)
    for panel, condition in zip(panels, (CONDITIONS[0], CONDITIONS[1]), strict=False):
        _, values = find_condition_values(main, condition)
        edges = make_bin_edges(values, condition.step)
        middle = (edges[:-1] + edges[1:]) / 2
        sets = [main[(values >= low) & (values < high)] for low, high in itertools.pairwise(edges)]
        draw_lines(panel, middle.tolist(), sets, names)
        panel.set_xlabel(condition.words)
    draw_lines(panels[2], list(by_time), list(by_time.values()), names)
    panels[2].set_xlabel("observation time (s)")
    panels[0].set_ylabel("balanced accuracy")
    panels[0].legend(fontsize=8, loc="lower right")
    return figure


def draw_lines(panel: Any, places: list[float], sets: list[pd.DataFrame], names: Sequence[str]) -> None:
    """Plot one line per model, with error bars for the first."""
    for number, name in enumerate(names):
        found = [score(rows, name) if len(rows) >= 10 else {"n": 0} for rows in sets]
        known = [(x, f) for x, f in zip(places, found, strict=True) if f["n"] and {"human", "dog"} <= set(f)]
        x, y = [x for x, _ in known], np.array([f["value"] for _, f in known])
        if number == 0:
            bars = np.array([[f["value"] - f["low"], f["high"] - f["value"]] for _, f in known]).T
            panel.errorbar(x, y, yerr=np.clip(bars, 0, None), marker="o", capsize=3, label=name)
        else:
            panel.plot(x, y, marker="o", label=name)
    panel.set_ylim(0.4, 1.02)
    panel.grid(alpha=0.3)


def errors_in_common(index: pd.DataFrame, name: str) -> list[str]:
    """Compare conditions and flags of right and wrong rows."""
    wrong = index[~index[f"right:{name}"]]
    lines = [f"{len(wrong)} of {len(index)} rows wrong by {name}.", "", "| | wrong | right |", "| --- | --- | --- |"]
    right = index[index[f"right:{name}"]]
    for column in (
        "quality_snr_mu_db", "truth_aspect_deg", "truth_ground_speed_mps", "truth_gait_frequency_hz",
        "quality_gait_confidence", "feature_limb_torso_ratio",
    ):  # fmt: skip
        low, high = wrong[column].abs().median(), right[column].abs().median()
        lines.append(f"| median of {column} | {low:.2f} | {high:.2f} |")
    missing = [part["feature_step_length_m"].isna().mean() for part in (wrong, right)]
    lines.append(f"| no gait frequency, % | {percent(missing[0])} | {percent(missing[1])} |")
    counts = wrong.groupby(["label", "recording"]).size().sort_values(ascending=False).head(8)
    lines += ["", "Most errors: " + "; ".join(f"{place[1]} ({place[0]}) {n}" for place, n in counts.items())]
    return lines


def report(folder: Path, out: Path, *, share: float, ablated: bool = False) -> list[str]:
    """Build, train and test; return the lines of the report."""
    began = time.monotonic()
    trained = {s: dataset("models", s, folder, out, share=share) for s in DURATIONS_S}
    tested = {s: dataset("mocap", s, folder, out, share=share) for s in DURATIONS_S}
    clean = dataset("mocap", MAIN_S, folder, out, share=share, clean=True)
    built = time.monotonic()
    models = (*FEATURE_MODELS, "ensemble")
    found = {s: evaluate(trained[s], other=tested[s], models=models) for s in DURATIONS_S}
    by_time = {s: joined(found[s], tested[s]) for s in DURATIONS_S}
    silent = joined(evaluate(trained[MAIN_S], other=clean, models=models), clean)
    apart_found = evaluate(tested[MAIN_S], models=ABLATION_MODELS, left_out="subject")
    apart = joined(apart_found, tested[MAIN_S])
    main, names = with_half(by_time[MAIN_S], folder), list(found[MAIN_S].document["models"])
    shown = [name for name in MODELS_ON_AXES if name in names]
    draw_curves(main, by_time, shown).savefig(out / "classification-curves.png", dpi=110)
    lines = ["# People or dog", "", f"{len(main)} rows tested, of {main['subject'].nunique()} targets.", ""]
    lines += ["## Trained on models, tested on motion capture", ""]
    under = main[easy(main)]
    halves = {f"{half} half, charter's conditions": under[under["half"] == half] for half in HALVES}
    lines += main_table({**halves, "both halves there": under, "all rows": main, "no noise": silent}, names)
    lines += ["", f"Rows under the charter's conditions: {len(under)}.", "", "Recordings by gait there:", ""]
    lines += by_recording(under, ["half", "label", "truth_gait"], shown)
    lines += ["", "Rows by gait and speed there:", ""]
    lines += by_column(speed_bins(under), ["half", "label", "truth_gait", "speed"], shown)
    lines += ["", "Rows by target there:", "", *by_column(under, ["label", "half", "subject"], shown)]
    if ablated:
        lines += ["", "## Ablation (a third of the examples, charter's conditions)", ""]
        lines += ablation(folder, out, tested[MAIN_S], share=share)
    lines += ["", "## Motion capture in training, each subject left out in turn", ""]
    names_apart = [name for name in names if f"right:{name}" in apart]
    lines += main_table({"charter's conditions": apart[easy(apart)], "all rows": apart}, names_apart)
    lines += ["", "## Observation time (all rows)", ""]
    lines += main_table({f"{s:g} s": rows for s, rows in by_time.items()}, names)
    lines += ["", "## What the errors have in common (charter's conditions, then all)", ""]
    lines += [*errors_in_common(under, shown[0]), "", *errors_in_common(main, shown[0])]
    done = time.monotonic()
    return [*lines, "", f"Datasets {built - began:.0f} s, training and scores {done - built:.0f} s."]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("motion_folder", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--share", type=float, default=1.0, help="share of the examples, 0.02 to 1; 1 takes 30 min")
    parser.add_argument("--ablation", action="store_true", help="train on plans that lack one thing each, too")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    lines = report(options.motion_folder.absolute(), options.out, share=options.share, ablated=options.ablation)
    (options.out / "classification.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    sys.exit(main())
