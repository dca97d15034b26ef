"""Subjects and signatures that are in different splits."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.dataset.config import SPLITS, list_some
from doppelgait.dataset.plan import list_names
from doppelgait.dataset.shard_files import decode
from doppelgait.dataset.verify.contents import Check, Contents, judge
from doppelgait.features import FEATURE_UNITS

Float32Array = npt.NDArray[np.float32]

SHAPE = (24, 32)
"""Numbers of cells in time and Doppler of averaged signatures for a first comparison."""
ALIKE = 0.999
CANDIDATE = 0.98
"""Correlation of the small pictures above which two signatures are compared in full."""
MAX_CANDIDATES = 2000
MAX_COMPARED = 60_000
"""Maximum number of rows that are compared for similarity; a larger dataset is sampled at random.
All rows are compared for identity."""

KINDS = {"group": "groups", "subject": "subjects", "recording": "recordings", "scene_id": "scenes"}


def check_groups(contents: Contents) -> Check:
    """Check that no subject or other group crosses splits."""
    # of a blended motion every subject and every recording counts
    index = contents.index
    torn: dict[str, list[str]] = {}
    for key in KINDS:
        names = pd.DataFrame({"name": list(list_names(index, key)), "split": index["split"]}).explode("name")
        splits = names.groupby("name")["split"].unique()
        found = [f"{name} ({', '.join(sorted(within))})" for name, within in splits.items() if len(within) > 1]
        if found:
            torn[key] = found
    numbers = {"in_two_splits": torn, "groups": int(index["group"].nunique())}
    if torn:
        listed = (f"{KINDS[key]} in more than one split: {list_some(names)}" for key, names in torn.items())
        return Check("failed", "; ".join(listed), numbers)
    models = index[index["source"] == "model"]
    same = int((models.groupby("motion")["split"].transform("nunique") > 1).sum()) if len(models) else 0
    if same:
        words = f"{same} rows of models have the parameters of a row in another split; sample their parameters"
        return Check("warning", words, {**numbers, "same_walkers": same})
    return Check("passed", f"{numbers['groups']} groups, each in one split", numbers)


def check_duplicates(contents: Contents) -> Check:
    """Find signatures that occur in two splits."""
    # identical: equal bytes, of all rows; near: differing in level and rounding only
    index = contents.index
    splits = index["split"].to_numpy(dtype=str)
    if len(set(splits)) < 2:
        return Check("not applicable", "rows of one split only")
    if "signature" not in contents.description["fields"]:
        values = index[[f"feature_{name}" for name in FEATURE_UNITS]].to_numpy(dtype=np.float64)
        known = np.flatnonzero(np.isfinite(values[:, :2]).all(axis=1))
        digests = {int(n): values[n].tobytes() for n in known}
        same = _find_equal(digests, splits)
        numbers: dict[str, Any] = {"rows": known.size, "compared_for_likeness": known.size, "identical": len(same)}
        fault = _describe_pairs(index, [(first, second, "identical") for first, second in same])
        found = judge(fault, f"no identical ones among {known.size} rows' features", numbers)
        return replace(found, summary=f"no signatures are kept; of the features: {found.summary}")
    chosen = contents.random["pairs"].choice(len(index), min(len(index), MAX_COMPARED), replace=False)
    digests, pictures = _read(contents, set(chosen.tolist()))
    same = _find_equal(digests, splits)
    has_target = (index["source"] != "none").to_numpy(dtype=bool)
    rows = np.array([n for n in sorted(pictures) if has_target[n]], dtype=np.int64)
    # for every row the most similar row in each later split, if it is similar enough
    parts = [part for split in SPLITS if len(part := rows[splits[rows] == split])]
    nearest = [pair for part, later in combinations(parts, 2) for pair in _find_nearest(later, part, pictures)]
    candidates = sorted(nearest, reverse=True)[:MAX_CANDIDATES]
    near, dataset, identical = [], contents.dataset, {frozenset(pair) for pair in same}
    for _, first, second in candidates:
        if frozenset((first, second)) in identical:
            continue
        one, two = (np.sqrt(np.maximum(dataset.array("signature", n), 0.0)) for n in (first, second))
        if one.shape == two.shape:
            correlation = float(_scale_to_unit(one.ravel()) @ _scale_to_unit(two.ravel()))
            if correlation > ALIKE:
                near.append((correlation, first, second))
    dataset.files.close()
    numbers = {
        "rows": len(index),
        "compared_for_likeness": len(rows),
        "candidates": len(candidates),
        "identical": len(same),
        "near_identical": len(near),
        "most_alike": max((value for value, *_ in candidates), default=None),
    }
    pairs = [(first, second, "identical") for first, second in same]
    pairs += [(first, second, f"{value:.5f}") for value, first, second in sorted(near, reverse=True)]
    words = f"no identical ones among {len(index)} signatures, no near-identical ones in different splits"
    if len(rows) < len(index):
        words += f" among {len(rows)} of them"
    return judge(_describe_pairs(index, pairs), words, numbers)


def _describe_pairs(index: pd.DataFrame, pairs: Sequence[tuple[int, int, str]]) -> str:
    ids, splits = index["id"].to_numpy(dtype=str), index["split"].to_numpy(dtype=str)
    listed = [f"{ids[a]} ({splits[a]}) and {ids[b]} ({splits[b]}) {how}" for a, b, how in pairs]
    return f"in different splits: {list_some(listed)}" if listed else ""


def _read(contents: Contents, chosen: set[int]) -> tuple[dict[int, bytes], dict[int, Float32Array]]:
    """Hash every row's signature, and picture the chosen rows."""
    files, facts = contents.dataset.files, contents.description["fields"]["signature"]
    digests: dict[int, bytes] = {}
    pictures: dict[int, Float32Array] = {}
    last = None
    for number, (shard, row) in enumerate(zip(contents.index["shard"], contents.index["row"], strict=True)):
        if shard != last:
            contents.tick()
            last = shard
        stored = files.read(shard, "signature", int(row))
        if stored is None or stored.size == 0:
            continue
        digests[number] = hashlib.blake2b(stored.tobytes(), digest_size=16).digest()
        if number in chosen:
            pictures[number] = make_picture(decode(stored, facts))
    files.close()
    return digests, pictures


def make_picture(power: npt.NDArray[Any]) -> Float32Array:
    """Average a signature into :data:`SHAPE` cells for comparison."""
    # dB above the median, mean removed, norm 1, flat
    small = _average(_average(np.asarray(power, dtype=np.float32), SHAPE[0]).T, SHAPE[1]).T
    level = np.maximum(small, max(float(np.median(small)), 1e-37))
    return _scale_to_unit(10.0 * np.log10(level).ravel())


def _average(values: npt.NDArray[Any], count: int) -> npt.NDArray[Any]:
    size = values.shape[0]
    starts = np.arange(count) * size // count
    if size < count:
        return np.asarray(values[starts])
    sums = np.add.reduceat(values, starts, axis=0)
    return np.asarray(sums / np.diff(np.append(starts, size))[:, None])


def _scale_to_unit(values: npt.NDArray[Any]) -> Float32Array:
    centred = values - values.mean()
    norm = float(np.linalg.norm(centred))
    return np.asarray(centred / norm if norm > 0 else centred, dtype=np.float32)


def _find_equal(digests: dict[int, bytes], splits: npt.NDArray[np.str_]) -> list[tuple[int, int]]:
    """Return the first pair across splits per digest."""
    numbers = list(digests)
    rows = pd.DataFrame({"number": numbers, "digest": list(digests.values()), "split": splits[numbers]})
    first = rows.drop_duplicates(["digest", "split"]).groupby("digest", sort=False)["number"].agg(list)
    return [(found[0], found[1]) for found in first if len(found) > 1]


def _find_nearest(
    rows: npt.NDArray[np.int64], others: npt.NDArray[np.int64], pictures: dict[int, Float32Array]
) -> Iterator[tuple[float, int, int]]:
    """Yield the nearest of ``others`` to each of ``rows``."""
    from sklearn.metrics import pairwise_distances_argmin_min

    left, table = (np.stack([pictures[int(n)] for n in part]) for part in (rows, others))
    nearest, distances = pairwise_distances_argmin_min(left, table)  # block by block
    likeness = 1.0 - distances**2 / 2.0  # of vectors of norm 1
    for n in np.flatnonzero(likeness > CANDIDATE):
        yield float(likeness[n]), int(others[nearest[n]]), int(rows[n])
