"""Chapter 5: step lengths and features of all scenarios."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from doppelgait.features import FEATURE_UNITS
from doppelgait_liland2018 import style
from doppelgait_liland2018.entry import EntryResult, Reading, compare_statement, entry, judge
from doppelgait_liland2018.material import RUNS, Material
from doppelgait_liland2018.scenarios import (
    METHOD_NAMES,
    METHODS,
    WRONG,
    cohens_d,
    fit_line,
    is_wrong,
    make_scenarios,
    roc_area,
    run_study,
    tabulate_separation,
)

GROUP_COLOURS = {
    "recorded person": style.BLUE,
    "model person": style.SKY,
    "Boulic walker": "#000000",
    "recorded dog": style.VERMILLION,
    "model dog": style.ORANGE,
}
WALKERS, PEOPLE = "Boulic walker", ("recorded person", "model person")
COMPARED = (*FEATURE_UNITS, "gait_frequency_hz")
CLASSES = ("human", "dog")
NEAR_M = 0.15
"""Step lengths within this distance of the line through the people agree with it."""
LONG_M = 1.5
"""Steps longer than this are called wrong in the report."""
FEATURE_LABELS = {
    "torso_velocity_mps": "torso velocity (m/s)",
    "doppler_bandwidth_hz": "Doppler bandwidth (Hz)",
    "step_length_m": "step length, radial (m)",
    "harmonic_ratio_2": "second harmonic ratio",
    "harmonic_ratio_3": "third harmonic ratio",
    "limb_torso_ratio": "limb-torso ratio",
}
NEAR_RATIO = 0.1
SPEED_OFF_MPS, SLOW_MPS = 0.3, 0.1
FEWEST_STRIDES = 1.2
"""Shorter recorded segments show no repetition at all."""


def make_study_table(material: Material) -> pd.DataFrame:
    """Return study features by scenario and method."""

    def make() -> pd.DataFrame:
        # recorded motions with a known stride that is seen more than once
        people, dogs = (
            {
                one.name: one.motion
                for one in motions
                if one.real and one.seconds * one.motion.facts.stride_frequency_hz >= FEWEST_STRIDES
            }
            for motions in (material.people(), material.dogs())
        )
        found = run_study(make_scenarios(people, dogs, seed=material.seed), material.radar())
        unsigned = {name: found[name].abs() for name in ("torso_velocity_mps", "step_length_m")}
        wrong = is_wrong(found, WRONG)
        return found.assign(**unsigned, wrong=wrong)

    table = material.compute_once("study", make)
    counts = table.drop_duplicates("number")["group"].value_counts(sort=False)
    material.note("scenarios: " + ", ".join(f"{count} {group}" for group, count in counts.items()))
    return table


def describe_counts(table: pd.DataFrame) -> str:
    """Describe the number of scenarios by group."""
    sizes = table[table["method"] == METHODS[0]].groupby("group", sort=False).size()
    words = [f"{size} {group}{'' if size == 1 else 's'}" for group, size in sizes.items()]
    return ", ".join(words).replace("persons", "people")


@entry(
    "fig-5.8",
    "Step length against speed, people and dogs",
    "Step length grows linearly with speed for most targets; values above 1.5 m are wrong estimates of f_m; the "
    "dog's step is far shorter for its speed.",
)
def make_step_length(material: Material) -> EntryResult:
    table = make_study_table(material)
    figure, axes = style.make_panels(2, height_in=5.6)
    for letter, panel, method in zip("ab", axes, METHODS, strict=True):
        part = table[table["method"] == method]
        _plot_groups(panel, part, "torso_velocity_mps", "step_length_m")
        slope, offset = _fit_line(part)
        speeds = np.array([0.3, float(part["torso_velocity_mps"].max())])
        panel.plot(speeds, offset + slope * speeds, color=style.LINE, lw=1.2, ls="--", label="line through the people")
        panel.axhline(LONG_M, color=style.REFERENCE, lw=0.8, ls=":")
        panel.set(xlim=(0.0, None), ylim=(0.0, 3.0))
        style.name_axes(panel, title=f"({letter}) {METHOD_NAMES[method]}", x="torso speed (m/s)", y="step length (m)")
    style.place_legend_below(figure, axes[0])
    readings = []
    for length_method in METHODS:
        length_part, name = table[table["method"] == length_method], METHOD_NAMES[length_method]
        people = np.asarray(
            length_part.loc[length_part["label"] == "human", ["torso_velocity_mps", "step_length_m"]].corr()
        )
        long_steps = length_part[length_part["step_length_m"] > LONG_M]
        readings += [
            Reading(f"slope of the line through the people, {name}", _fit_line(length_part)[0], "s"),
            Reading(f"people within {NEAR_M} m of it, {name}", 100.0 * _count_near_line(length_part), "%"),
            Reading(f"correlation of step length and speed, people, {name}", float(people[0, 1]), "1"),
            *_read_distance_below_line(length_part, name),
            Reading(f"steps longer than {LONG_M} m, {name}", float(len(long_steps)), "1"),
            Reading(
                f"of these, share with a wrong step frequency, {name}",
                float(long_steps["wrong"].mean()) if len(long_steps) else math.nan,
                "1",
                1.0,
                0.05,
                "a runner's step and a dog's stride are as long as that",
            ),
        ]
        if length_method == METHODS[0]:
            readings.append(
                compare_statement(
                    f"most people within {NEAR_M} m of the line, {name}",
                    _count_near_line(length_part) > 0.5,
                    note="more than half of them",
                )
            )
        error_mps = (length_part["torso_velocity_mps"] - length_part["true_velocity_mps"].abs()).abs()
        still = int((length_part["torso_velocity_mps"] < SLOW_MPS).sum())
        readings.append(
            Reading(
                f"speeds off by more than {SPEED_OFF_MPS} m/s, {name}",
                100.0 * float((error_mps > SPEED_OFF_MPS).mean()),
                "%",
                note=f"of {len(length_part)}"
                + (f"; {still} near 0, where a standing foot outshines the torso" if still else ""),
            )
        )
        readings += read_wrong_shares(length_part, name)
    return judge(figure, readings, _describe_lengths(table), table)


def _plot_groups(axes: Axes, part: pd.DataFrame, x: str, y: str) -> None:
    for group, colour in GROUP_COLOURS.items():
        chosen = part[part["group"] == group]
        if len(chosen):
            axes.scatter(chosen[x], chosen[y], s=13, color=colour, alpha=0.75, lw=0, label=f"{group} ({len(chosen)})")
    style.draw_grid(axes)


def _fit_line(part: pd.DataFrame) -> tuple[float, float]:
    people = part[part["label"] == "human"]
    return fit_line(people["torso_velocity_mps"], people["step_length_m"])


def _compare_with_line(part: pd.DataFrame, label: str) -> pd.Series:
    """Return step lengths relative to the people's line."""
    slope, offset = _fit_line(part)
    chosen = part[part["label"] == label]
    return chosen["step_length_m"] - offset - slope * chosen["torso_velocity_mps"]


def _count_near_line(part: pd.DataFrame) -> float:
    """Return the share of people near the line."""
    return float(_compare_with_line(part, "human").dropna().abs().le(NEAR_M).mean())


def _read_distance_below_line(part: pd.DataFrame, name: str) -> list[Reading]:
    """Read how far dogs lie below the line."""
    people_m, dogs_m = (_compare_with_line(part, label) for label in CLASSES)
    asymmetric = part.loc[dogs_m.index, "gait"].isin(RUNS)
    kinds = {"walk, pace, trot": dogs_m[~asymmetric], "canter, gallop, bound": dogs_m[asymmetric]}
    readings = [
        Reading(
            f"dogs' length below people's at the same speed, {kind}, {name}",
            -float(off_m.median()),
            "m",
            note=f"median of {len(off_m)}, ROC area {roc_area(people_m, off_m):.2f}",
        )
        for kind, off_m in kinds.items()
        if len(off_m)
    ]
    readings.append(
        Reading(
            f"ROC area of people against dogs by that length, {name}",
            roc_area(people_m, dogs_m),
            "1",
            note=f"Cohen's d {cohens_d(people_m, dogs_m):.2f}",
        )
    )
    return readings


def read_wrong_shares(part: pd.DataFrame, name: str) -> list[Reading]:
    """Read the shares of wrong step frequencies."""
    part = part[part["true_gait_frequency_hz"].notna()]
    beyond = is_wrong(part, WRONG, bins=1.0)
    percent = f"{100 * WRONG:.0f} %"
    return [
        _read_share(f"step frequencies off by more than {percent}, {name}", part["wrong"]),
        *(_read_share(f"the same, {group}", rows["wrong"]) for group, rows in part.groupby("group", sort=False)),
        _read_share(f"off by more than {percent} and a bin of 1 / T_o, {name}", beyond),
    ]


def _read_share(words: str, marked: pd.Series) -> Reading:
    return Reading(words, 100.0 * float(marked.mean()), "%", note=f"{int(marked.sum())} of {len(marked)}")


def _describe_lengths(table: pd.DataFrame) -> str:
    report = table[table["method"] == METHODS[0]]
    ours = table[table["method"] == METHODS[1]]
    near = [100.0 * _count_near_line(part) for part in (report, ours)]
    left_out = table.attrs.get("left_out", {})
    words = (
        f"{near[0]:.0f} % of the people lie within {NEAR_M} m of one straight line by the report's method, "
        f"{near[1]:.0f} % by ours. Dogs that walk, pace or trot take shorter steps at the same speed; in a canter, "
        "gallop or bound f_m is the stride's, and so is the length. Steps above 1.5 m are not always wrong: runners "
        f"and galloping dogs have them. Scenarios: {describe_counts(table)}"
    )
    return words + (f"; {len(left_out)} could not be observed." if left_out else ".")


@entry(
    "fig-5.9",
    "The six features of all scenarios",
    "v_m alone shows nothing; B_mu follows it and is high for the walkers; beta_1 and beta_2 are mostly 2 and 3; "
    "rho is higher for the walkers and expected to be higher for people than for pets, of which there was one.",
)
def make_features(material: Material) -> EntryResult:
    table = make_study_table(material)
    # Every feature against the number of the scenario, the report's method on the left, ours on the right.
    figure, axes = style.make_panels(2, len(FEATURE_UNITS), width_in=12.0, height_in=16.0)
    for row, name in enumerate(FEATURE_UNITS):
        for column, method in enumerate(METHODS):
            panel, part = axes[2 * row + column], table[table["method"] == method]
            _plot_groups(panel, part, "number", name)
            # Limits that hold all but the outermost 1 % at either end; from 0 unless most of the axis were empty then.
            known, limits = part[name].dropna(), (0.0, 1.0)
            if not known.empty:
                low, high = (float(known.quantile(share)) for share in (0.01, 0.99))
                limits = (0.85 * low if low > 0.5 * high else 0.0), 1.15 * max(high, 1e-9)
            panel.set_ylim(*limits)
            letter = "abcdef"[row]
            title = f"({letter}) {METHOD_NAMES[method]}" if row == 0 else f"({letter})"
            style.name_axes(panel, title=title, x="scenario number" if row == 5 else "", y=FEATURE_LABELS[name])
    style.place_legend_below(figure, axes[0])
    separation = tabulate_separation(table, COMPARED, classes=CLASSES)
    separation["method"] = separation["method"].map(METHOD_NAMES)
    readings = []
    for feature_method in METHODS:
        feature_part, feature_name = table[table["method"] == feature_method], METHOD_NAMES[feature_method]
        walkers, people = (
            feature_part[feature_part["group"] == WALKERS],
            feature_part[feature_part["group"].isin(PEOPLE)],
        )
        rho, width = "limb_torso_ratio", "doppler_bandwidth_hz"
        speeds = walkers["torso_velocity_mps"]
        as_fast = people[people["torso_velocity_mps"].between(speeds.min(), speeds.max())]
        readings += [
            Reading(
                f"rho of the walkers over that of the other people, medians, {feature_name}",
                float(walkers[rho].median() / people[rho].median()),
                "1",
            ),
            Reading(f"rho of people over that of dogs, medians, {feature_name}", _read_ratio(feature_part, rho), "1"),
            Reading(
                f"B_mu of the walkers over that of other people at their speeds, medians, {feature_name}",
                float(walkers[width].median() / as_fast[width].median()),
                "1",
            ),
            *(
                Reading(
                    f"beta_{place} within {NEAR_RATIO} of {place + 1}, {feature_name}",
                    100.0 * float((feature_part[column].dropna() - (place + 1)).abs().le(NEAR_RATIO).mean()),
                    "%",
                    note=f"known in {int(feature_part[column].notna().sum())} of {len(feature_part)}",
                )
                for place, column in ((1, "harmonic_ratio_2"), (2, "harmonic_ratio_3"))
            ),
        ]
    readings += _compare_statements(readings, METHOD_NAMES[METHODS[0]])
    for feature_row in separation.to_dict("records"):
        readings.append(
            Reading(
                f"ROC area of people against dogs by {feature_row['feature']}, {feature_row['method']}",
                feature_row["roc_area"],
                "1",
                note=f"Cohen's d {feature_row['cohens_d']:.2f}",
            )
        )
    return judge(figure, readings, _describe_features(table, separation), separation)


def _compare_statements(readings: list[Reading], name: str) -> list[Reading]:
    """Compare the report's statements on features with numbers."""
    ours = {reading.name: reading.ours for reading in readings}
    said = {
        "rho higher for the walkers": ours[f"rho of the walkers over that of the other people, medians, {name}"] > 1.0,
        "rho higher for people than for dogs": ours[f"rho of people over that of dogs, medians, {name}"] > 1.0,
        "B_mu high for the walkers": ours[
            f"B_mu of the walkers over that of other people at their speeds, medians, {name}"
        ]
        > 1.0,
        "beta_1 mostly 2": ours[f"beta_1 within {NEAR_RATIO} of 2, {name}"] > 50.0,
        "beta_2 mostly 3": ours[f"beta_2 within {NEAR_RATIO} of 3, {name}"] > 50.0,
    }
    return [compare_statement(f"{words}, {name}", is_so) for words, is_so in said.items()]


def _read_ratio(part: pd.DataFrame, name: str) -> float:
    return float(part.loc[part["label"] == "human", name].median() / part.loc[part["label"] == "dog", name].median())


def _describe_features(table: pd.DataFrame, separation: pd.DataFrame) -> str:
    report = table[table["method"] == METHODS[0]]
    ranked = separation.assign(apart=(separation["roc_area"] - 0.5).abs()).sort_values("apart")
    best = ranked[ranked["method"] == METHOD_NAMES[METHODS[0]]].iloc[-1]
    higher = _read_ratio(report, "limb_torso_ratio") > 1.0
    return (
        f"by the report's method rho is {'higher' if higher else 'not higher'} for people than for dogs; its rho adds "
        "up rows and so depends on the frame rate of the scenario. "
        f"{'No single feature separates' if best['apart'] < 0.45 else 'One feature nearly separates'} the classes; the "
        f"best is {best['feature']} (ROC area {best['roc_area']:.2f})."
    )
