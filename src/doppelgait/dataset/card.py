"""The dataset card and the licences of its sources."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pandas as pd

from doppelgait import __version__
from doppelgait.core.config import read_toml
from doppelgait.dataset.config import ImportConfig, PlanConfig, list_some
from doppelgait.dataset.feasibility import LIMIT_KEYS, format_limit_keys, limits_of_index
from doppelgait.features import FEATURE_UNITS

TEXTS: dict[str, Any] = read_toml(Path(__file__).with_name("card.toml"))[0]

FREE = re.compile(
    r"(cc0|cc[ -]by|cc[ -]by[ -]sa|odc[ -]by|odbl|pddl|mit|isc|unlicense|bsd[ -][0-4][ -]clause|apache([ -]2\.0)?"
    r"|cdla[ -](permissive|sharing)|public domain|own)([ -][0-9.]+)?",
    re.IGNORECASE,
)
"""Licences that allow redistribution of derived data, as SPDX names, and ``own`` for own recordings. Every other text
blocks a release, because the licences that forbid it cannot be listed."""


def blocks_release(licence: str) -> bool:
    """Return True if a licence blocks release of derived data."""
    # joined by AND, each licence must allow it
    return any(FREE.fullmatch(part.strip()) is None for part in licence.split(" AND "))


def list_licences(index: pd.DataFrame) -> pd.DataFrame:
    """List the recordings of an index with their licences."""
    columns = ["recording", "licence", "rows", "blocked"]
    if index.empty or "recording" not in index:
        return pd.DataFrame(columns=columns)
    known = index.assign(licence=index.get("licence", ""))
    known = known[known["recording"].fillna("").astype(bool)]
    counts = known.fillna({"licence": ""}).groupby(["recording", "licence"]).size().rename("rows").reset_index()
    return counts.assign(blocked=[blocks_release(text) for text in counts["licence"]])[columns]


def list_blocked_recordings(index: pd.DataFrame) -> list[str]:
    """List the recordings that block a release, with licence."""
    table = list_licences(index)
    blocked = table[table["blocked"]].to_dict("records")
    return [f"{row['recording']} ({row['licence'] or 'licence unknown'})" for row in blocked]


def release_warning(licences: pd.DataFrame) -> str:
    """Return a sentence on the licences that block a release, or ""."""
    blocked = int(licences["blocked"].sum())
    return TEXTS["blocked"].format(blocked=blocked, recordings=len(licences)) if blocked else ""


def format_card(plan: PlanConfig, identity: str, index: pd.DataFrame) -> str:
    """Write the Markdown card of a simulated dataset."""
    name, rows, texts = plan.dataset.name, len(index), TEXTS["simulated"]
    sizes = [("n<1K", 1e3), ("1K<n<10K", 1e4), ("10K<n<100K", 1e5), ("100K<n<1M", 1e6)]  # in the notation of data hubs
    size = next((words for words, limit in sizes if rows < limit), "n>1M")
    recorded = index if index.empty else index[index["source"] == "recording"]
    subjects = [texts["subjects"]]
    if len(recorded) < rows:
        subjects.append(texts["subjects_of_models"])
    if len(recorded) and recorded["subject"].str.startswith("file/").any():
        subjects.append(texts["subjects_of_files"])
    kinds = [] if index.empty else sorted(set(index["motion_kind"]) - {"file"})
    rcs, leaks = plan.target.get("rcs", {}), plan.dataset.leaks
    law = "distribution" if "total_m2" in rcs or "choice" in rcs else "mass"
    simplifications = ["occlusion as set in the plan" if "occlusion" in rcs else "no occlusion"]
    if plan.environment in (None, [], {}):
        simplifications.append("no multipath")
    if plan.impairments in (None, [], {}):
        simplifications.append("no clutter or receiver faults except those of the radar's preset")
    listed = [f"- `{leak}`: {TEXTS['leaks'].get(leak, TEXTS['leaks']['other'])}." for leak in leaks]
    gate = "windows" if plan.episodes else plan.dataset.gate
    counts, radar = limits_of_index(index), TEXTS["radar_limits"]["none"]
    if reached := {name: keys for name, keys in LIMIT_KEYS.items() if any(row[name] for row in counts)}:
        table = format_markdown_table(pd.DataFrame(counts).sort_values("class")[["class", "rows", *reached]])
        radar = TEXTS["radar_limits"]["table"].format(keys=format_limit_keys(reached), table=table)
    license_line = "license: other\n" if len(list_licences(index)) else ""
    return _fill_card(
        index,
        name=name,
        front=license_line + texts["front"].format(size=size),
        subjects=" ".join(subjects),
        making=TEXTS["leaks"]["section"].format(leaks="\n".join(listed)) if listed else "",
        rows=texts["rows"],
        summary=texts["summary"].format(
            rows=rows, version=__version__, identity=identity, origin=_describe_origin(plan, index, recorded)
        ),
        files=texts["files"].format(gate=TEXTS["gates"][gate].format(**plan.dataset.model_dump())),
        limits=texts["limits"].format(
            simplifications=", ".join(simplifications),
            models="".join(f"- {TEXTS['models'].get(kind, f'Motion model `{kind}`.')}\n" for kind in kinds),
            law=TEXTS["laws"]["leak" if "target.rcs" in leaks else law],
            radar=radar,
            name=name,
        ),
    )


def _fill_card(index: pd.DataFrame, **texts: str) -> str:
    counts, features = format_markdown_table(count_examples(index)), format_markdown_table(tabulate_features(index))
    return str(TEXTS["card"].format(counts=counts, features=features, **texts))


def _describe_origin(plan: PlanConfig, index: pd.DataFrame, recorded: pd.DataFrame) -> str:
    texts = TEXTS["simulated"]
    if recorded.empty:
        return str(texts["no_recording"].format(radar=texts["radar"]))
    table = list_licences(index)
    labels = {str(name): ", ".join(sorted(group["label"].unique())) for name, group in recorded.groupby("recording")}
    files = [
        f"- `{row['recording']}`: {row['rows']} ({labels[row['recording']]}), {row['licence'] or 'licence unknown'}"
        for row in table.to_dict("records")
    ]
    warning = release_warning(table)
    cited = dict.fromkeys(entry.citation for entry in plan.sources if entry.citation)
    return str(
        texts["recordings"].format(
            radar=texts["radar"],
            count=len(recorded),
            others="" if len(recorded) == len(index) else texts["others"],
            warning=f"\n\n{warning}" if warning else "",
            files="\n".join(files),
            citations="\n\n## Citations\n" + "".join(f"\n- {text}" for text in cited) if cited else "",
        )
    )


def import_card(
    index: pd.DataFrame, *, name: str, identity: str, config: ImportConfig, labels: str, n_failed: int
) -> str:
    """Write the Markdown card of an imported dataset."""
    texts, complete = TEXTS["imported"], TEXTS["imported"]["complete"]
    if n_failed:
        noun = "recording or window" if n_failed == 1 else "recordings or windows"
        complete = texts["incomplete"].format(count=n_failed, noun=noun)
    subjects = [texts["subjects"]]
    if index["subject"].str.startswith("file/").any():
        subjects.append(texts["subjects_of_files"])
    if isinstance(config.split, dict):
        shares = ", ".join(f"{split} {share:g}" for split, share in config.split.items())
        subjects.append(texts["subjects_at_random"].format(shares=shares, seed=config.seed))
    table = list_licences(index)
    counts = table.groupby("licence")["recording"].nunique()
    sources = [f"- {licence or 'licence unknown'}: {count} recordings" for licence, count in counts.items()]
    if warning := release_warning(table):
        sources = [warning, "", *sources]
    if cited := [text for text in index["citation"].unique() if text]:
        sources += ["", "Citations:", "", *(f"- {text}" for text in cited)]
    tracked, several = int((index["gate"] == "track").sum()), int((index["n_tracks"] > 1).sum())
    gates = [texts["tracked"].format(tracked=tracked, several=several)] if tracked else []
    if tracked < len(index):
        gates.append(texts["by_hand"].format(rows=len(index) - tracked))
    windows = texts["no_windows"]
    if config.window_s is not None:
        windows = texts["windows"].format(window_s=config.window_s, step_s=config.step_s)
    kinds = (index["carrier_hz"] / 1e9).map("{:g} GHz".format) + index["prf_hz"].map(" at {:.4g} Hz".format)
    radars = [f"{kind} ({count} rows)" for kind, count in kinds.value_counts(sort=False).items()]
    return _fill_card(
        index,
        name=name,
        front=texts["front"],
        subjects=" ".join(subjects),
        making=texts["making"].format(sources="\n".join(sources), gate="\n".join(gates), windows=windows),
        rows=texts["rows"].format(or_window=" or window" if config.window_s is not None else ""),
        summary=texts["summary"].format(
            rows=len(index),
            recordings=index["recording"].nunique(),
            labels=labels,
            version=__version__,
            identity=identity,
            complete=complete,
        ),
        files="\n",
        limits=texts["limits"].format(radars=list_some(radars, 8)),
    )


def count_examples(index: pd.DataFrame) -> pd.DataFrame:
    """Count the examples by class and split."""
    if index.empty:
        return pd.DataFrame({"label": []})
    return index.groupby(["label", "split"]).size().unstack(fill_value=0).reset_index()


def tabulate_features(index: pd.DataFrame) -> pd.DataFrame:
    """Tabulate median and 5 to 95 % range per feature and class."""
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


def format_markdown_table(table: pd.DataFrame) -> str:
    """Format a table as Markdown."""
    header = [str(name) for name in table.columns]
    lines = ["| " + " | ".join(header) + " |", "|" + " --- |" * len(header)]
    lines += ["| " + " | ".join(str(value) for value in row) + " |" for row in table.itertuples(index=False)]
    return "\n".join(lines)
