"""The card of an imported dataset."""

from __future__ import annotations

import pandas as pd

from doppelgait import __version__
from doppelgait.dataset.card import counts_table, feature_table, licences_of, markdown_table
from doppelgait.dataset.importing.config import ImportConfig

CARD = """---
pretty_name: {name}
license: other
task_categories: [other]
tags: [radar, micro-doppler, gait, measured]
configs:
  - config_name: default
    data_files: index.parquet
---

# {name}

{total} rows from {recordings} radar recordings of the user, labelled by `{labels}`, imported by doppelgait {version};
dataset id `{identity}`. {failed}

## Counts

{counts}

{subjects}

## Features (median, 5 % to 95 %) by class

{features}

`step_length_m` is |v_m| / f_mu, radial. For asymmetric gaits (gallop) it is the stride length.

## Recordings

{sources}

## How rows were made

{gate}
{windows}
A row without a target has no features and the flag `not_tracked`; it stays, so that a score counts it. Where nobody
was to be expected the flag is `nobody:nothing_found`.

## Files

- `index.parquet`: one row per recording{or_window}: label, split, subject, recording with its SHA-256, licence,
  features (`feature_*`, `extended_*`), their standard deviations (`sd_*`), diagnostics (`quality_*`), `flags` that say
  why a value is missing, `warnings`, and `notes` on what a file does not tell. `truth_*` and `meta_*` are columns of
  the labels: measured by hand, not by doppelgait.
- `splits/*.txt`: identifiers, one a line.
- `shards/*.h5`: arrays by row, see `fields` in `dataset.json`; axes stand beside them (`signature_time_s`).

## Limits

- Labels are the user's; nothing here proves them.
- What is unknown of a measured scene is empty: noise, range of the body, speed, aspect.
- {radars}
"""


def import_card(
    index: pd.DataFrame, *, name: str, identity: str, config: ImportConfig, labels: str, n_failed: int
) -> str:
    """Markdown card of an imported dataset.

    Parameters
    ----------
    index : DataFrame
    name, identity : str
        Of the dataset.
    config : ImportConfig
    labels : str
        Name of the file of labels.
    n_failed : int
        Recordings or windows that are not in it.
    """
    return CARD.format(
        name=name,
        total=len(index),
        recordings=index["recording"].nunique(),
        labels=labels,
        version=__version__,
        identity=identity,
        failed=_failed(n_failed),
        counts=markdown_table(counts_table(index)),
        subjects=_subjects(index, config),
        features=markdown_table(feature_table(index)),
        sources=_sources(index),
        gate=_gate(index),
        windows=_windows(config),
        or_window=" or window" if config.window_s is not None else "",
        radars=_radars(index),
    )


def _failed(count: int) -> str:
    if not count:
        return "Every labelled recording is in it."
    noun = "recording or window" if count == 1 else "recordings or windows"
    return f"**Incomplete**: {count} {noun} could not be read or analysed; the reasons are in `shards/*.json`."


def _subjects(index: pd.DataFrame, config: ImportConfig) -> str:
    text = ["All rows of a recording, of a subject, and of who shares a recording with it are in one split."]
    if index["subject"].str.startswith("file/").any():
        text.append(
            "A recording without a subject counts as a subject of its own: two recordings of the same person or animal "
            "may be in different splits."
        )
    if isinstance(config.split, dict):
        shares = ", ".join(f"{split} {share:g}" for split, share in config.split.items())
        text.append(f"Subjects of every class were drawn by shares: {shares}; seed {config.seed}.")
    return " ".join(text)


def _sources(index: pd.DataFrame) -> str:
    """Licences with the number of recordings under each, what blocks a release, and what must be cited."""
    table = licences_of(index)
    counts = table.groupby("licence")["recording"].nunique()
    lines = [f"- {licence or 'licence unknown'}: {count} recordings" for licence, count in counts.items()]
    blocked = int(table["blocked"].sum())
    if blocked:
        lines = [
            f"**Not for release**: {blocked} of {len(table)} recordings are non-commercial or of unknown licence; "
            "`dataset export --release` refuses this dataset.",
            "",
            *lines,
        ]
    cited = [text for text in index["citation"].unique() if text]
    return "\n".join([*lines, *(["", "To be cited:", "", *(f"- {text}" for text in cited)] if cited else [])])


def _gate(index: pd.DataFrame) -> str:
    tracked = int((index["gate"] == "track").sum())
    text = []
    if tracked:
        several = int((index["n_tracks"] > 1).sum())
        text.append(
            f"{tracked} rows: targets were found and followed; the label went to the track with the most seconds, each "
            f"by its confidence, and features are those of its longest steady piece. {several} rows have further "
            "tracks (`n_tracks`), which are not in this dataset."
        )
    if tracked < len(index):
        text.append(f"{len(index) - tracked} rows: the gate was given by hand, from one range to another.")
    return "\n".join(text)


def _windows(config: ImportConfig) -> str:
    if config.window_s is None:
        return "A recording, or the part of it that its line names, is one row."
    return (
        f"Recordings were cut into windows of {config.window_s:g} s, one every {config.step_s:g} s, each analysed by "
        "itself; windows of one recording share `scene_id`."
    )


def _radars(index: pd.DataFrame) -> str:
    kinds = (index["carrier_hz"] / 1e9).map("{:g} GHz".format) + index["prf_hz"].map(" at {:.4g} Hz".format)
    radars = [f"{kind} ({count} rows)" for kind, count in kinds.value_counts(sort=False).items()]
    shown = ", ".join(radars[:8]) + (f" and {len(radars) - 8} more" if len(radars) > 8 else "")
    return f"Radars: {shown}. What differs with the radar (carrier, pulse rate, range) may tell the class."
