"""The dataset card: what is in a dataset, written for whoever finds it."""

from __future__ import annotations

import pandas as pd

from doppelgait import __version__
from doppelgait.dataset.config import PlanConfig
from doppelgait.features import FEATURE_UNITS

CARD = """---
pretty_name: {name}
task_categories: [other]
tags: [radar, micro-doppler, gait, synthetic]
---

# {name}

{total} simulated micro-Doppler examples made by doppelgait {version}, dataset id `{identity}`.
{origin}

## Counts

{counts}

{subjects}

## Features (median, 5 % to 95 %) by class

{features}

`step_length_m` is |v_m| / f_mu, radial. For asymmetric gaits (gallop) it is the stride length.

## Files

- `index.parquet`: one row per example: labels, split, subject, source, recording, resolved parameters, truth
  (`truth_*`), features (`feature_*`), diagnostics (`quality_*`), `flags` that say why a value is missing.
- `shards/*.h5`: arrays by row, see `fields` in `dataset.json`.
- `dataset.json`: identity, classes, the whole configuration. The same configuration gives the same bytes.

SNR: `snr_frame_db` is the time mean of the strongest range bin's power over the noise power, before any transform;
`quality_snr_mu_db` is that of the signature. The gate comes from the true range of the body plus a random error of
{gate_error} m (standard deviation), the same for every class; no other truth reaches a feature.

## Limits

{limits}
"""

RADAR_SENTENCE = "point scatterers on moving bodies, pulse-Doppler radar, receiver noise."

MODEL_SENTENCES = {
    "boulic": "Human motion: model of Boulic et al. 1990 as implemented by Chen 2011.",
    "quadruped": (
        "Dog motion: a simplified quadruped whose parameters come from one measured dog and published gait laws."
    ),
}
"""What a reader should know of a motion model, by its kind."""


def dataset_card(plan: PlanConfig, identity: str, index: pd.DataFrame) -> str:
    """Markdown card of a dataset."""
    return CARD.format(
        name=plan.dataset.name,
        total=len(index),
        version=__version__,
        identity=identity,
        origin=_origin(index),
        subjects=_subjects(index),
        limits=_limits(plan, index),
        counts=_markdown(counts_table(index)),
        features=_markdown(feature_table(index)),
        gate_error=plan.dataset.gate_error_sd_m,
    )


def _recorded(index: pd.DataFrame) -> pd.DataFrame:
    return index if index.empty else index[index["source"] == "recording"]


def _origin(index: pd.DataFrame) -> str:
    """Where the motion comes from, and the recordings with their licences where there are any."""
    recorded = _recorded(index)
    if recorded.empty:
        return f"Everything is simulated: {RADAR_SENTENCE} No recording of a person or animal is in it."
    others = "" if len(recorded) == len(index) else " The motion of the others comes from models."
    files = [f"- `{name}`: {len(g)} ({_listed(g['label'])})" for name, g in recorded.groupby("recording")]
    return (
        f"The radar is simulated: {RADAR_SENTENCE} The motion of {len(recorded)} examples comes from recordings of "
        f"people or animals.{others}\n\n## Recordings\n\nMotion files and the number of examples made from each; "
        "their licences apply to this dataset.\n\n" + "\n".join(files)
    )


def _listed(values: pd.Series[str]) -> str:
    return ", ".join(sorted(values.unique()))


def _subjects(index: pd.DataFrame) -> str:
    recorded = _recorded(index)
    text = ["Examples of one subject are all in one split."]
    if len(recorded) < len(index):
        text.append("A model's parameter draw is its own subject.")
    if len(recorded):
        text.append(
            "A motion file is one subject, whoever moves in it: two recordings of the same person or animal may be in "
            "different splits."
        )
    return " ".join(text)


def _limits(plan: PlanConfig, index: pd.DataFrame) -> str:
    kinds = [] if index.empty else sorted(set(index["motion_kind"]) - {"file"})
    law = "total drawn by one law for every class, assumed"
    rcs = plan.target.get("rcs", {})
    if "total_m2" not in rcs and "choice" not in rcs:
        law = "by body mass, assumed for dogs; so the echo's power differs between classes"
    return "\n".join([
        "Isotropic scatterers, no occlusion, no multipath, no clutter.",
        *(MODEL_SENTENCES.get(kind, f"Motion model `{kind}`.") for kind in kinds),
        f"Radar cross section: {law}.",
    ])  # fmt: skip


def counts_table(index: pd.DataFrame) -> pd.DataFrame:
    """Number of examples by class and split."""
    if index.empty:
        return pd.DataFrame({"label": []})
    counts = index.groupby(["label", "split"]).size().unstack(fill_value=0)
    return counts.reset_index()


def feature_table(index: pd.DataFrame) -> pd.DataFrame:
    """Median and 5 % to 95 % range of every feature by class, as text, with the number of missing values."""
    rows = []
    for name, unit in {**FEATURE_UNITS, "gait_frequency_hz": "Hz"}.items():
        column = name if name in index else f"feature_{name}"
        row: dict[str, str] = {"feature": f"{name} [{unit}]"}
        for label, group in index.groupby("label") if len(index) else []:
            values = group[column].dropna()
            missing = len(group) - len(values)
            text = "-"
            if len(values):
                low, middle, high = values.quantile([0.05, 0.5, 0.95])
                text = f"{middle:.2f} ({low:.2f} to {high:.2f})"
            row[str(label)] = text + (f", {missing} missing" if missing else "")
        rows.append(row)
    return pd.DataFrame(rows)


def _markdown(table: pd.DataFrame) -> str:
    header = [str(name) for name in table.columns]
    lines = ["| " + " | ".join(header) + " |", "|" + " --- |" * len(header)]
    lines += ["| " + " | ".join(str(value) for value in row) + " |" for row in table.itertuples(index=False)]
    return "\n".join(lines)
