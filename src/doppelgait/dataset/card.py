"""The dataset card and the licences of its sources."""

from __future__ import annotations

import re
from collections.abc import Sequence

import pandas as pd

from doppelgait import __version__
from doppelgait.dataset.config import ImportConfig, PlanConfig, list_some
from doppelgait.dataset.feasibility import LIMITS, format_limit_keys, limits_of_index
from doppelgait.features import FEATURE_UNITS

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
    if not blocked:
        return ""
    return (
        f"**Not for release**: {blocked} of {len(licences)} recordings are non-commercial or of unknown licence; "
        "`dataset export --release` refuses this dataset."
    )


CARD = """---
pretty_name: {name}
{front}configs:
  - config_name: default
    data_files: index.parquet
---

# {name}

{summary}

## Counts

{counts}

{subjects}

## Features (median, 5 % to 95 %) by class

{features}

`step_length_m` is |v_m| / f_mu, radial. For asymmetric gaits (gallop) it is the stride length.

{making}## Files

- `index.parquet`: one row per {rows}
- `splits/*.txt`: identifiers, one a line.
- `shards/*.h5`: arrays by row, see `fields` in `dataset.json`; axes are stored next to them (`signature_time_s`).
{files}## Limits

{limits}
"""


def _fill(index: pd.DataFrame, **texts: str) -> str:
    counts, features = format_markdown_table(count_examples(index)), format_markdown_table(tabulate_features(index))
    return CARD.format(counts=counts, features=features, **texts)


RADAR_SENTENCE = "point scatterers on moving bodies, pulse-Doppler radar, receiver noise."

TRUTH_GATE = (
    "The gate comes from the true range of the body plus a random error of {error} m (standard deviation), the same "
    "for every class; no other truth reaches a feature."
)
TRACK_GATE = (
    "The gate was found without the truth, as in a measured recording; the truth only assigns tracks to targets. A "
    "target that no track follows has no features and the flag `not_tracked`."
)

MODEL_SENTENCES = {
    "boulic": "Human motion: model of Boulic et al. 1990 as implemented by Chen 2011.",
    "human": "Human motion: a walking and running model of 31 points; docs/motion.md describes its equations and "
    "assumptions.",
    "quadruped": ("Dog motion: a simplified quadruped with parameters from one measured dog and published gait laws."),
    "none": "Examples of empty scenes contain the noise, clutter and background of the scene; their gate follows no "
    "target.",
}
"""Descriptions of the motion models for the card, by kind."""

SIMULATED_ROWS = """\
target: labels, split, subject, source, recording, licence, resolved parameters, truth
  (`truth_*`), features (`feature_*`, `extended_*`), their standard deviations (`sd_*`), diagnostics (`quality_*`),
  `quality_flags` with the reason for a missing value. Targets of one scene share `scene_id` and split."""
SIMULATED_FILES = """\
- `dataset.json`: identity, classes, the whole configuration. The same configuration gives the same bytes.

SNR: `snr_frame_db` is the time mean of the strongest range bin's power over the noise power, before
any transform; `quality_snr_mu_db` is that of the signature.
{gate}

"""
MAKE_AGAIN = """

## Build it again

    doppelgait dataset build PLAN.toml -o {name}

with the `config` of `dataset.json` as the plan; `doppelgait dataset verify {name}` proves that it is the same."""


def format_card(plan: PlanConfig, identity: str, index: pd.DataFrame) -> str:
    """Write the Markdown card of a simulated dataset."""
    name, total = plan.dataset.name, len(index)
    sizes = [("n<1K", 1e3), ("1K<n<10K", 1e4), ("10K<n<100K", 1e5), ("100K<n<1M", 1e6)]  # in the notation of data hubs
    size = next((words for words, limit in sizes if total < limit), "n>1M")
    front = (
        f"{'license: other' + chr(10) if len(list_licences(index)) else ''}task_categories: [other]\n"
        f"tags: [radar, micro-doppler, gait, synthetic]\nsize_categories: [{size}]\n"
    )
    recorded = index if index.empty else index[index["source"] == "recording"]
    subjects = ["Examples of one subject, and of all who share a scene with it, are in one split."]
    if len(recorded) < total:
        subjects.append("A model's parameter draw is its own subject.")
    if len(recorded) and recorded["subject"].str.startswith("file/").any():
        subjects.append(
            "A motion file without an entry `subject` in `[[sources]]` is one subject, even if several people move in "
            "it: two recordings of the same person or animal may be in different splits."
        )
    kinds = [] if index.empty else sorted(set(index["motion_kind"]) - {"file"})
    law = "total sampled from the same assumed distribution for every class"
    rcs = plan.target.get("rcs", {})
    if "total_m2" not in rcs and "choice" not in rcs:
        law = "by body mass, assumed for dogs; the echo power therefore differs between classes"
    if "target.rcs" in plan.dataset.leaks:
        law = "set by class: a leak (see above)"
    simplifications = ["occlusion as set in the plan" if "occlusion" in rcs else "no occlusion"]
    if plan.environment in (None, [], {}):
        simplifications.append("no multipath")
    if plan.impairments in (None, [], {}):
        simplifications.append("no clutter or receiver faults except those of the radar's preset")
    limits = "\n".join(
        [
            f"- Isotropic point scatterers, {', '.join(simplifications)}.",
            *(f"- {MODEL_SENTENCES.get(kind, f'Motion model `{kind}`.')}" for kind in kinds),
            f"- Radar cross section: {law}.",
            "- The assumptions about bodies, rooms and the receiver are randomised, not measured in your room.",
            *_radar_limits(index),
        ]
    )
    gate = TRACK_GATE if plan.dataset.gate == "track" else TRUTH_GATE.format(error=plan.dataset.gate_error_sd_m)
    return _fill(
        index,
        name=name,
        front=front,
        subjects=" ".join(subjects),
        making=_format_leaks(plan.dataset.leaks),
        rows=SIMULATED_ROWS,
        summary=f"{total} simulated micro-Doppler examples made by doppelgait {__version__}, dataset id `{identity}`.\n"
        + _describe_origin(plan, index, recorded),
        files=SIMULATED_FILES.format(gate=gate),
        limits=limits + MAKE_AGAIN.format(name=name),
    )


def _radar_limits(index: pd.DataFrame) -> list[str]:
    counts = limits_of_index(index)
    reached = [name for name in LIMITS if any(row[name] for row in counts)]
    if not reached:
        return ["- Radar: no row aliases in Doppler, leaves the frame or has a truncated gate."]
    table = format_markdown_table(pd.DataFrame(counts).sort_values("class")[["class", "rows", *reached]])
    return [
        "- Radar: the table counts rows that reach a limit; a row can reach several. A limit that any body of a",
        "  scene reaches counts for every row of the scene; a truncated gate counts for its own row.",
        f"  Keys of the plan to change: {format_limit_keys(reached)}.",
        "",
        table,
    ]


LEAK_SENTENCES = {
    "radar.prf_hz": "the frame rate is the lowest without aliasing for each example, so that it reveals the speed",
    "scene.duration_s": "every example is as long as its recording",
}
"""Sentences on what each leak of a plan reveals; keys of ``target`` differ by class."""


def _format_leaks(leaks: Sequence[str]) -> str:
    if not leaks:
        return ""
    named = [f"- `{leak}`: {LEAK_SENTENCES.get(leak, 'set by class, so that it reveals the class')}." for leak in leaks]
    return (
        "## Leaks\n\nThis dataset reproduces a published one, including values that reveal the class. A "
        "score on it does not "
        "measure how well people and animals are distinguished.\n\n" + "\n".join(named) + "\n\n"
    )


def _describe_origin(plan: PlanConfig, index: pd.DataFrame, recorded: pd.DataFrame) -> str:
    if recorded.empty:
        return f"Everything is simulated: {RADAR_SENTENCE} It contains no recording of a person or animal."
    others = "" if len(recorded) == len(index) else " The motion of the other examples is generated by models."
    table = list_licences(index)
    labels = {str(name): ", ".join(sorted(group["label"].unique())) for name, group in recorded.groupby("recording")}
    files = [
        f"- `{row['recording']}`: {row['rows']} ({labels[row['recording']]}), {row['licence'] or 'licence unknown'}"
        for row in table.to_dict("records")
    ]
    warning = release_warning(table)
    cited = dict.fromkeys(entry.citation for entry in plan.sources if entry.citation)
    return (
        f"The radar is simulated: {RADAR_SENTENCE} The motion of {len(recorded)} examples is from recordings of "
        f"people or animals.{others}\n\n## Recordings\n\nMotion files and the number of examples made from each; "
        f"their licences apply to this dataset.{f'{chr(10) * 2}{warning}' if warning else ''}\n\n"
        + "\n".join(files)
        + ("\n\n## Citations\n" + "".join(f"\n- {text}" for text in cited) if cited else "")
    )


IMPORTED_ROWS = """recording{or_window}: label, split, subject, recording with its SHA-256, licence,
  features (`feature_*`, `extended_*`), their standard deviations (`sd_*`), diagnostics (`quality_*`), `quality_flags`
  with the reason for a missing value, `warnings`, and `notes` on values that a file does not state. `truth_*` and
  `meta_*` are columns of the labels: measured by hand, not by doppelgait."""
IMPORTED_MAKING = """## Recordings

{sources}

## Processing

{gate} {windows} A row without a target has no features and the flag `not_tracked`; it is kept, so
that scores count it. If the scene is labelled as empty, the flag is `nobody:nothing_found`.

"""
IMPORTED_LIMITS = """- Labels are provided by the user and are not verified.
- Unknown values of a measured scene are empty: noise, range of the body, speed, aspect.
- Radars: {radars}. Properties of the radar (carrier, pulse rate, range) may predict the class."""


def import_card(
    index: pd.DataFrame, *, name: str, identity: str, config: ImportConfig, labels: str, n_failed: int
) -> str:
    """Write the Markdown card of an imported dataset."""
    failed = "It contains every labelled recording."
    if n_failed:
        noun = "recording or window" if n_failed == 1 else "recordings or windows"
        failed = f"**Incomplete**: {n_failed} {noun} could not be read or analysed; the reasons are in `shards/*.json`."
    subjects = ["All rows of a recording, of a subject, and of subjects that share a recording are in one split."]
    if index["subject"].str.startswith("file/").any():
        subjects.append(
            "A recording without a subject counts as a subject of its own: two recordings of the same person or animal "
            "may be in different splits."
        )
    if isinstance(config.split, dict):
        shares = ", ".join(f"{split} {share:g}" for split, share in config.split.items())
        subjects.append(f"The subjects of every class were assigned at random by shares: {shares}; seed {config.seed}.")
    table = list_licences(index)
    counts = table.groupby("licence")["recording"].nunique()
    sources = [f"- {licence or 'licence unknown'}: {count} recordings" for licence, count in counts.items()]
    if warning := release_warning(table):
        sources = [warning, "", *sources]
    if cited := [text for text in index["citation"].unique() if text]:
        sources += ["", "Citations:", "", *(f"- {text}" for text in cited)]
    tracked = int((index["gate"] == "track").sum())
    gates = []
    if tracked:
        gates.append(
            f"{tracked} rows: targets were detected and tracked; the label was assigned to the track with the longest "
            "duration weighted by confidence, and features are those of its longest steady segment. "
            f"{int((index['n_tracks'] > 1).sum())} rows have further tracks (`n_tracks`), which are not in this "
            "dataset."
        )
    if tracked < len(index):
        gates.append(f"{len(index) - tracked} rows: the gate was set by hand, from one range to another.")
    windows = "Each row is one recording, or the part of it that its line names."
    if config.window_s is not None:
        windows = (
            f"Recordings were split into windows of {config.window_s:g} s, one every {config.step_s:g} s, each "
            "analysed separately; windows of one recording share `scene_id`."
        )
    kinds = (index["carrier_hz"] / 1e9).map("{:g} GHz".format) + index["prf_hz"].map(" at {:.4g} Hz".format)
    radars = [f"{kind} ({count} rows)" for kind, count in kinds.value_counts(sort=False).items()]
    shown = list_some(radars, 8)
    making = IMPORTED_MAKING.format(sources="\n".join(sources), gate="\n".join(gates), windows=windows)
    return _fill(
        index,
        name=name,
        subjects=" ".join(subjects),
        making=making,
        files="\n",
        front="license: other\ntask_categories: [other]\ntags: [radar, micro-doppler, gait, measured]\n",
        summary=f"{len(index)} rows from {index['recording'].nunique()} radar recordings of the user, labelled by "
        f"`{labels}`, imported by doppelgait {__version__};\ndataset id `{identity}`. {failed}",
        rows=IMPORTED_ROWS.format(or_window=" or window" if config.window_s is not None else ""),
        limits=IMPORTED_LIMITS.format(radars=shown),
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
