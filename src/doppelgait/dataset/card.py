"""The dataset card and the licences of its sources."""

from __future__ import annotations

import re
from collections.abc import Iterable

import pandas as pd

from doppelgait import __version__
from doppelgait.dataset.config import PlanConfig
from doppelgait.features import FEATURE_UNITS

FREE = re.compile(
    r"(cc0|cc[ -]by|cc[ -]by[ -]sa|odc[ -]by|odbl|pddl|mit|isc|unlicense|bsd[ -][0-4][ -]clause|apache([ -]2\.0)?"
    r"|cdla[ -](permissive|sharing)|public domain|own)([ -][0-9.]+)?",
    re.IGNORECASE,
)
"""Licences under which what is made from a file may be handed on, as SPDX writes them, and ``own`` recordings. Every
other text blocks a release: nobody can list all the ways of saying no."""


def blocks_release(licence: str) -> bool:
    """Whether a licence keeps what is made from a file from being released: all that are not known to allow it."""
    return FREE.fullmatch(licence.strip()) is None


def licences_of(index: pd.DataFrame) -> pd.DataFrame:
    """Recordings of an index with their licences: ``recording``, ``licence``, ``rows``, ``blocked``; empty for models.

    Parameters
    ----------
    index : DataFrame
        With columns ``recording`` and, for schema 2, ``licence``.
    """
    columns = ["recording", "licence", "rows", "blocked"]
    if index.empty or "recording" not in index:
        return pd.DataFrame(columns=columns)
    known = index.assign(licence=index.get("licence", ""))
    known = known[known["recording"].fillna("").astype(bool)]
    counts = known.fillna({"licence": ""}).groupby(["recording", "licence"]).size().rename("rows").reset_index()
    return counts.assign(blocked=[blocks_release(text) for text in counts["licence"]])[columns]


def blocked_recordings(index: pd.DataFrame) -> list[str]:
    """Each recording whose licence blocks a release, with that licence, for a message."""
    table = licences_of(index)
    blocked = table[table["blocked"]].to_dict("records")
    return [f"{row['recording']} ({row['licence'] or 'licence unknown'})" for row in blocked]


def citations(entries: Iterable[object]) -> list[str]:
    """What must be cited, each once, in the order of ``[[sources]]``."""
    return list(dict.fromkeys(text for entry in entries if (text := getattr(entry, "citation", ""))))


CARD = """---
pretty_name: {name}
{licence}task_categories: [other]
tags: [radar, micro-doppler, gait, synthetic]
size_categories: [{size}]
configs:
  - config_name: default
    data_files: index.parquet
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

- `index.parquet`: one row per target: labels, split, subject, source, recording, licence, resolved parameters, truth
  (`truth_*`), features (`feature_*`, `extended_*`), their standard deviations (`sd_*`), diagnostics (`quality_*`),
  `flags` that say why a value is missing. Targets of one scene share `scene_id` and split.
- `splits/*.txt`: identifiers, one a line.
- `shards/*.h5`: arrays by row, see `fields` in `dataset.json`; axes stand beside them (`signature_time_s`).
- `dataset.json`: identity, classes, the whole configuration. The same configuration gives the same bytes.

SNR: `snr_frame_db` is the time mean of the strongest range bin's power over the noise power, before any transform;
`quality_snr_mu_db` is that of the signature.
{gate}

## Limits

{limits}

## Make it again

    doppelgait dataset build PLAN.toml -o {name}

with the `config` of `dataset.json` as the plan; `doppelgait dataset verify {name}` proves that it is the same.
"""

RADAR_SENTENCE = "point scatterers on moving bodies, pulse-Doppler radar, receiver noise."

TRUTH_GATE = (
    "The gate comes from the true range of the body plus a random error of {error} m (standard deviation), the same "
    "for every class; no other truth reaches a feature."
)
TRACK_GATE = (
    "The gate was found without the truth, as in a measured recording; the truth only says which track is whose. A "
    "target that no track follows has no features and the flag `not_tracked`."
)

MODEL_SENTENCES = {
    "boulic": "Human motion: model of Boulic et al. 1990 as implemented by Chen 2011.",
    "human": "Human motion: a walking and running model of 31 points; its laws and what is assumed: docs/motion.md.",
    "quadruped": (
        "Dog motion: a simplified quadruped whose parameters come from one measured dog and published gait laws."
    ),
    "none": "Examples of nobody hold the noise, clutter and background of the scene; their gate follows no one.",
}
"""What a reader should know of a motion model, by its kind."""


def dataset_card(plan: PlanConfig, identity: str, index: pd.DataFrame) -> str:
    """Markdown card of a dataset."""
    gate = TRACK_GATE if plan.dataset.gate == "track" else TRUTH_GATE.format(error=plan.dataset.gate_error_sd_m)
    return CARD.format(
        name=plan.dataset.name,
        licence="license: other\n" if len(licences_of(index)) else "",
        size=_size(len(index)),
        total=len(index),
        version=__version__,
        identity=identity,
        origin=_origin(plan, index),
        subjects=_subjects(index),
        limits=_limits(plan, index),
        counts=markdown_table(counts_table(index)),
        features=markdown_table(feature_table(index)),
        gate=gate,
    )


def _size(count: int) -> str:
    """Size category as data hubs write it."""
    steps = [("n<1K", 1e3), ("1K<n<10K", 1e4), ("10K<n<100K", 1e5), ("100K<n<1M", 1e6)]
    return next((name for name, limit in steps if count < limit), "n>1M")


def _recorded(index: pd.DataFrame) -> pd.DataFrame:
    return index if index.empty else index[index["source"] == "recording"]


def _origin(plan: PlanConfig, index: pd.DataFrame) -> str:
    """Where the motion comes from, and the recordings with their licences where there are any."""
    recorded = _recorded(index)
    if recorded.empty:
        return f"Everything is simulated: {RADAR_SENTENCE} No recording of a person or animal is in it."
    others = "" if len(recorded) == len(index) else " The motion of the others comes from models."
    table = licences_of(index)
    labels = {str(name): _listed(group["label"]) for name, group in recorded.groupby("recording")}
    files = [
        f"- `{row['recording']}`: {row['rows']} ({labels[row['recording']]}), {row['licence'] or 'licence unknown'}"
        for row in table.to_dict("records")
    ]
    blocked = int(table["blocked"].sum())
    warning = (
        f"\n\n**Not for release**: {blocked} of {len(table)} recordings are non-commercial or of unknown licence; "
        "`dataset export --release` refuses this dataset."
        if blocked
        else ""
    )
    cited = "".join(f"\n- {text}" for text in citations(plan.sources))
    return (
        f"The radar is simulated: {RADAR_SENTENCE} The motion of {len(recorded)} examples comes from recordings of "
        f"people or animals.{others}\n\n## Recordings\n\nMotion files and the number of examples made from each; "
        f"their licences apply to this dataset.{warning}\n\n" + "\n".join(files)
        + (f"\n\n## To be cited\n{cited}" if cited else "")
    )  # fmt: skip


def _listed(values: pd.Series[str]) -> str:
    return ", ".join(sorted(values.unique()))


def _subjects(index: pd.DataFrame) -> str:
    recorded = _recorded(index)
    text = ["Examples of one subject, and of all who share a scene with it, are in one split."]
    if len(recorded) < len(index):
        text.append("A model's parameter draw is its own subject.")
    if len(recorded) and recorded["subject"].str.startswith("file/").any():
        text.append(
            "A motion file without an entry `subject` in `[[sources]]` is one subject, whoever moves in it: two "
            "recordings of the same person or animal may be in different splits."
        )
    return " ".join(text)


def _limits(plan: PlanConfig, index: pd.DataFrame) -> str:
    kinds = [] if index.empty else sorted(set(index["motion_kind"]) - {"file"})
    law = "total drawn by one law for every class, assumed"
    rcs = plan.target.get("rcs", {})
    if "total_m2" not in rcs and "choice" not in rcs:
        law = "by body mass, assumed for dogs; so the echo's power differs between classes"
    return "\n".join([
        f"- {_scattering(plan)}",
        *(f"- {MODEL_SENTENCES.get(kind, f'Motion model `{kind}`.')}" for kind in kinds),
        f"- Radar cross section: {law}.",
        "- What is assumed about bodies, rooms and the receiver is randomised, not measured in your room.",
    ])  # fmt: skip


def _scattering(plan: PlanConfig) -> str:
    """Which of the usual simplifications hold for a plan."""
    present = [
        name
        for name, there in (("environment", plan.environment), ("impairments", plan.impairments))
        if there not in (None, [], {})
    ]
    rest = [] if "environment" in present else ["no multipath"]
    rest += [] if "impairments" in present else ["no clutter or receiver faults but those of the radar's preset"]
    occlusion = "occlusion as planned" if "occlusion" in plan.target.get("rcs", {}) else "no occlusion"
    return f"Isotropic point scatterers, {', '.join([occlusion, *rest])}."


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
        for label, group in index.groupby("label") if len(index) and column in index else []:
            values = group[column].dropna()
            missing = len(group) - len(values)
            text = "-"
            if len(values):
                low, middle, high = values.quantile([0.05, 0.5, 0.95])
                text = f"{middle:.2f} ({low:.2f} to {high:.2f})"
            row[str(label)] = text + (f", {missing} missing" if missing else "")
        rows.append(row)
    return pd.DataFrame(rows)


def markdown_table(table: pd.DataFrame) -> str:
    """Markdown of a table."""
    header = [str(name) for name in table.columns]
    lines = ["| " + " | ".join(header) + " |", "|" + " --- |" * len(header)]
    lines += ["| " + " | ".join(str(value) for value in row) + " |" for row in table.itertuples(index=False)]
    return "\n".join(lines)
