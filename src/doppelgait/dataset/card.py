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

{total} synthetic micro-Doppler examples made by doppelgait {version}, dataset id `{identity}`.
Everything is simulated: point scatterers on moving bodies, pulse-Doppler radar, receiver noise. No recording of a
person or animal is in it.

## Counts

{counts}

Examples of one subject are all in one split; a model's parameter draw is its own subject.

## Features (median, 5 % to 95 %) by class

{features}

`step_length_m` is |v_m| / f_mu, radial. For asymmetric gaits (gallop) it is the stride length.

## Files

- `index.parquet`: one row per example: labels, split, subject, resolved parameters, truth (`truth_*`), features
  (`feature_*`), diagnostics (`quality_*`), `flags` that say why a value is missing.
- `shards/*.h5`: arrays by row, see `fields` in `dataset.json`.
- `dataset.json`: identity, classes, the whole configuration. The same configuration gives the same bytes.

SNR: `snr_frame_db` is the time mean of the strongest range bin's power over the noise power, before any transform;
`quality_snr_mu_db` is that of the signature. The gate comes from the true range of the body plus a random error of
{gate_error} m (standard deviation), the same for every class; no other truth reaches a feature.

## Limits

Isotropic scatterers, no occlusion, no multipath, no clutter. Human motion: model of Boulic et al. 1990 as
implemented by Chen 2011. Dog motion: a simplified quadruped whose parameters come from one measured dog and published
gait laws. Radar cross section of dogs: assumed, by body mass.
"""


def dataset_card(plan: PlanConfig, identity: str, index: pd.DataFrame) -> str:
    """Markdown card of a dataset."""
    return CARD.format(
        name=plan.dataset.name,
        total=len(index),
        version=__version__,
        identity=identity,
        counts=_markdown(counts_table(index)),
        features=_markdown(feature_table(index)),
        gate_error=plan.dataset.gate_error_sd_m,
    )


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
