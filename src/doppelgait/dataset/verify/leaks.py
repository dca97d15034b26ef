"""Who is in more than one split."""

from __future__ import annotations

import pandas as pd

from doppelgait.dataset.verify.contents import Contents
from doppelgait.dataset.verify.report import Check, some

KINDS = {"group": "groups", "subject": "subjects", "recording": "recordings", "scene_id": "scenes"}


def check_groups(contents: Contents) -> Check:
    """No group, subject, recording or scene may be in two splits; whoever shares a scene is then in one split, too.

    Walkers of models with the same parameters in two splits are a warning: the plan draws nothing, so that training
    and test meet the same body.
    """
    index = contents.index
    torn: dict[str, list[str]] = {}
    for key in KINDS:
        named = index[index[key].fillna("").astype(str) != ""] if key in index else index.iloc[:0]
        found = _in_two_splits(named, key)
        if found:
            torn[key] = found
    numbers = {"in_two_splits": torn, "groups": int(index["group"].nunique())}
    if torn:
        words = "; ".join(f"{KINDS[key]} in more than one split: {some(names)}" for key, names in torn.items())
        return Check("groups", "failed", words, numbers)
    same = _same_walkers(index)
    if same:
        words = f"{same} rows of models have the parameters of a row in another split; draw their parameters"
        return Check("groups", "warning", words, {**numbers, "same_walkers": same})
    return Check("groups", "passed", f"{numbers['groups']} groups, each in one split", numbers)


def _in_two_splits(rows: pd.DataFrame, key: str) -> list[str]:
    """Names in more than one split, each with the splits."""
    splits = rows.groupby(key)["split"].unique()
    return [f"{name} ({', '.join(sorted(found))})" for name, found in splits.items() if len(found) > 1]


def _same_walkers(index: pd.DataFrame) -> int:
    models = index[index["source"] == "model"]
    return int((models.groupby("motion")["split"].transform("nunique") > 1).sum()) if len(models) else 0
