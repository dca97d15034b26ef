"""Leakage test: classes predicted from nuisance parameters.

A Bayes classifier adds the log-likelihood ratios of quantile bins of every parameter and of every
pair. Each term counts by how much of its G statistic exceeds twice its degrees of freedom. The
accuracy of all parameters together is compared with that of permuted labels, so that the number of
parameters needs no correction.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.core.errors import DatasetError, DoppelgaitError, DoppelgaitWarning, warn_caller
from doppelgait.dataset.open import Dataset
from doppelgait.dataset.plan import collect_nuisance
from doppelgait.dataset.resolve import ExampleSpec
from doppelgait.dataset.verify.contents import Check, Contents, read_plan
from doppelgait.scene.placement import place
from doppelgait.scene.rcs import total_rcs_m2

Float32Array = npt.NDArray[np.float32]
FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

FOLDS = 5
BINS, PAIR_BINS = 6, 3
MAX_PAIRED = 40  # number of parameters above which no pairs are used
PRIOR_ROWS = 2.0  # prior number of rows of every class, distributed like all rows
ABOVE_CHANCE = 0.1
"""Allowed accuracy as a fraction of the distance from chance to 1: balanced accuracy 0.55 for two
classes, 0.4 for three."""
LEVEL = 1e-4
PERMUTATIONS, MAX_PERMUTATIONS = 1000, 10_000
"""Numbers of permutations. The second is used if no permutation of the first does as well: 1 in 10
001 is below the level."""
AT_A_TIME = 100
MIN_GROUPS = 5


@dataclass(frozen=True)
class Guess:
    """Result of guessing classes from nuisance parameters."""

    n_rows: int
    n_parameters: int
    accuracy: float
    allowed: float
    p_value: float = 1.0
    telling: tuple[tuple[str, float], ...] = ()
    reason: str = ""

    @property
    def leaks(self) -> bool:
        """True if the classes can be predicted beyond chance."""
        return self.accuracy > self.allowed and self.p_value < LEVEL

    def as_dict(self) -> dict[str, Any]:
        """Return the guess for JSON."""
        known = {**asdict(self), "telling": dict(self.telling)}
        return {name: None if value != value else value for name, value in known.items()}


Cells = tuple[Float32Array, IntArray]
"""Cells of the rows of a table: members (n, n_cells), and every term's first cell (n_terms,)."""


def guess_classes(table: pd.DataFrame, rng: np.random.Generator, *, only_leaks: bool = False) -> Guess:
    """Guess ``label`` from all columns but ``group``, which folds keep together."""
    columns = table.drop(columns=["label", "group"])
    labels, _ = pd.factorize(table["label"], sort=True)
    groups, _ = pd.factorize(table["group"])
    n_classes = int(labels.max()) + 1
    allowed = 1.0 / n_classes + ABOVE_CHANCE * (1.0 - 1.0 / n_classes)
    fewest = int(table.groupby("label")["group"].nunique().min())
    if fewest < MIN_GROUPS:
        words = f"too few groups: {fewest} in the smallest class, {MIN_GROUPS} are needed"
        return Guess(*columns.shape, float("nan"), allowed, reason=words)
    folds = rng.permutation(int(groups.max()) + 1)[groups] % FOLDS
    cells = make_cells([columns[name] for name in columns])
    accuracy = float(score_folds(cells, folds, labels[:, None])[0])
    if only_leaks and not accuracy > allowed:  # whatever permutations show, it is no leak
        return Guess(*columns.shape, accuracy, allowed)
    better, made = 0, 0
    while made < PERMUTATIONS or (not better and made < MAX_PERMUTATIONS):
        permuted = np.column_stack([permute_labels(labels, groups, rng) for _ in range(min(AT_A_TIME, PERMUTATIONS))])
        better += int((score_folds(cells, folds, permuted) >= accuracy - 1e-12).sum())
        made += permuted.shape[1]
    alone = {str(name): float(score_folds(make_cells([columns[name]]), folds, labels[:, None])[0]) for name in columns}
    telling = sorted(alone.items(), key=lambda entry: -entry[1])
    return Guess(*columns.shape, accuracy, allowed, (better + 1) / (made + 1), tuple(telling))


def make_cells(columns: Sequence[pd.Series]) -> Cells:
    """Return the cells of every column and of every pair."""
    terms = [bin_values(column, BINS) for column in columns]
    if len(columns) <= MAX_PAIRED:
        coarse = [bin_values(column, PAIR_BINS) for column in columns]
        terms += [one * (PAIR_BINS + 1) + two for one, two in combinations(coarse, 2)]
    blocks = [(term[:, None] == np.unique(term)).astype(np.float32) for term in terms]
    ends = np.cumsum([block.shape[1] for block in blocks])
    return np.hstack(blocks), np.append(0, ends[:-1])


def bin_values(column: pd.Series, count: int) -> IntArray:
    """Return every value's quantile bin from 1, missing 0."""
    values = encode_values(column)
    known = ~np.isnan(values)
    edges = np.unique(values[known])[1:]
    if edges.size >= count:
        edges = np.unique(np.quantile(values[known], np.arange(1, count) / count))
    return np.where(known, 1 + np.searchsorted(edges, values, side="right"), 0)


def encode_values(column: pd.Series) -> FloatArray:
    """Return numbers, or codes of texts in their order, NaN where missing."""
    if pd.api.types.is_bool_dtype(column) or pd.api.types.is_numeric_dtype(column):
        return column.to_numpy(dtype=np.float64, na_value=np.nan)
    codes = pd.factorize(column.where(column.isna(), column.astype(str)), sort=True)[0]
    return np.where(codes < 0, np.nan, codes.astype(np.float64))


def score_folds(cells: Cells, folds: IntArray, labels: IntArray) -> npt.NDArray[np.float64]:
    """Return the folds' mean balanced accuracy per label column."""
    # Each fold is guessed from the others; labels have the shape (n, n_columns).
    n_classes = int(labels.max()) + 1
    accuracies = []
    for test in (folds == fold for fold in range(FOLDS)):
        if test.any() and not test.all():
            levels = _compute_log_ratios(cells, test, labels[~test], n_classes)
            accuracies.append(balanced_accuracy(labels[test], levels.argmax(axis=0), n_classes))
    return np.asarray(np.mean(accuracies, axis=0))


def _compute_log_ratios(cells: Cells, test: npt.NDArray[np.bool_], labels: IntArray, n_classes: int) -> Float32Array:
    """Return the log-likelihood ratio of every class against all rows."""
    # The ratios are those of the rows of a fold, with shape (n_classes, n_test, P).
    members, starts = cells
    train = members[~test]
    spread = (train.mean(axis=0) + 1e-6)[:, None]
    ratios, strength = [], np.zeros((len(starts), labels.shape[1]), dtype=np.float32)
    for number in range(n_classes):
        member = (labels == number).astype(np.float32)
        counts = train.T @ member
        ratio = np.log((counts + PRIOR_ROWS * spread) / (member.sum(axis=0) + PRIOR_ROWS) / spread)
        strength += 2.0 * np.add.reduceat(counts * ratio, starts, axis=0)
        ratios.append(ratio)
    sizes = np.diff(np.append(starts, members.shape[1]))
    freedom = ((sizes - 1) * (n_classes - 1))[:, None]
    weight = np.maximum(1.0 - 2.0 * freedom / np.maximum(strength, 1e-9), 0.0).repeat(sizes, axis=0)
    return np.stack([members[test] @ (weight * ratio).astype(np.float32) for ratio in ratios])


def balanced_accuracy(labels: IntArray, guesses: IntArray, n_classes: int) -> npt.NDArray[np.float64]:
    """Return the mean accuracy over occurring classes, per column."""
    members = labels == np.arange(n_classes)[:, None, None]
    counts, hits = members.sum(axis=1), (members & (labels == guesses)).sum(axis=1)
    return np.asarray((hits / np.maximum(counts, 1)).sum(axis=0) / (counts > 0).sum(axis=0))


def permute_labels(labels: IntArray, groups: IntArray, rng: np.random.Generator) -> IntArray:
    """Permute labels over groups."""
    # groups with one label swap labels; groups with several permute them within the group
    n_groups = int(groups.max()) + 1
    low, high = np.full(n_groups, labels.max()), np.zeros(n_groups, dtype=labels.dtype)
    np.minimum.at(low, groups, labels)
    np.maximum.at(high, groups, labels)
    one_label = low == high
    low[one_label] = rng.permutation(low[one_label])
    pure = one_label[groups]
    permuted = np.where(pure, low[groups], labels)
    mixed = np.flatnonzero(~pure)
    in_order = mixed[np.argsort(groups[mixed], kind="stable")]
    permuted[in_order] = labels[mixed[np.lexsort((rng.random(mixed.size), groups[mixed]))]]
    return permuted


MEASURED = ("prf_hz", "observation_s", "rcs_total_m2", "gate_error_m", "radar_height_m")
MEASURED_LEAKS = {
    "radar.prf_hz": ("index.prf_hz", "prf_hz"),
    "scene.duration_s": ("index.observation_s", "observation_s"),
    "target.rcs": ("index.rcs_total_m2", "rcs_total_m2", "index.snr_frame_db"),
}
"""Columns of the index that follow a key of ``dataset.leaks``, in addition to the key itself."""
UNSEEN = ("target.rcs", "rcs_total_m2", "snr_frame_db")
"""Levels of echoes; an empty room has none, so that other parameters judge such a class."""
LEAK_FIX = "sample them from one distribution for every class, or name them in dataset.leaks"
RCS_FIX = (
    "the default cross section follows body mass: set [target] rcs = { total_m2 = { log_uniform = [0.1, 1.6] } } or "
    "another law for all classes, or list 'target.rcs' in dataset.leaks"
)
UNJUDGED = ("gate_error_m", "index.gate_error_m")
"""Range error of the gates, which no key of a plan can make class-dependent."""
MAX_ROWS = 2000
SHOWN_PARAMETERS = 3


def check_nuisance(contents: Contents) -> Check:
    """Check that nuisance parameters do not predict the class."""
    index, rng = contents.index, contents.random["guess"]
    leaks = (contents.description.get("config") or {}).get("dataset", {}).get("leaks", ())
    if contents.examples:
        table = tabulate_nuisances(index, contents.examples)
    elif len(index) <= MAX_ROWS:
        table = _select_measured(index)
    else:
        table = _select_measured(index.iloc[np.sort(rng.choice(len(index), MAX_ROWS, replace=False))])
    table = drop_leaks(table, (*leaks, *UNJUDGED))
    declared = f"; not judged, leaks that the plan names: {', '.join(leaks)}" if leaks else ""
    # compare classes with targets by all parameters, and all classes by the parameters that an empty room has
    empty = table.pop("empty").to_numpy(dtype=bool)
    questions = {"classes with a target" if empty.any() else "classes": select_varying(table[~empty])}
    if empty.any():
        seen = [name for name in table.columns if not str(name).removeprefix("index.").startswith(UNSEEN)]
        questions["all classes"] = select_varying(table[seen])
    guesses = {words: guess_classes(part, rng) for words, part in questions.items() if _has_question(part)}
    if not guesses:
        return Check("not applicable", f"one class, or no nuisance parameter that differs{declared}")
    numbers = {words: guess.as_dict() for words, guess in guesses.items()}
    predicted = [describe_guess(words, guess, table) for words, guess in guesses.items() if guess.leaks]
    if predicted:
        unstated = "target.rcs.total_m2" not in table and any("rcs_total_m2" in words for words in predicted)
        predicted.append(RCS_FIX if unstated else LEAK_FIX)
        return Check("warning" if contents.measured else "failed", "; ".join(predicted) + declared, numbers)
    unclear = "; ".join(f"{words}: {guess.reason}" for words, guess in guesses.items() if guess.reason)
    listed = "; ".join(
        f"{words} from {guess.n_parameters} parameters of {guess.n_rows} rows: balanced accuracy "
        f"{guess.accuracy:.2f} (p = {guess.p_value:.2g})"
        for words, guess in guesses.items()
        if not guess.reason
    )
    if not listed:
        return Check("not applicable", unclear + declared, numbers)
    return Check("passed", f"{listed}{'; not judged: ' if unclear else ''}{unclear}{declared}", numbers)


def _has_question(table: pd.DataFrame) -> bool:
    return table["label"].nunique() > 1 and len(table.columns) > 2


def find_leak(table: pd.DataFrame, rng: np.random.Generator) -> str:
    """Describe the leak of a table with varying parameters, or ""."""
    guess = guess_classes(table, rng, only_leaks=True) if _has_question(table) else None
    return describe_guess("classes", guess, table) if guess is not None and guess.leaks else ""


def drop_leaks(table: pd.DataFrame, leaks: Sequence[str]) -> pd.DataFrame:
    """Drop the columns of leaks that a plan names."""
    known = {column for leak in leaks for column in MEASURED_LEAKS.get(leak, ())}
    own = tuple(f"{leak}." for leak in leaks)
    return table[[n for n in table.columns if n not in known and n not in leaks and not str(n).startswith(own)]]


def select_varying(table: pd.DataFrame) -> pd.DataFrame:
    """Select label, group and the parameters that differ beyond rounding, each once."""
    # no radar measures the sixth digit of a level; the index repeats some values of the plan
    table = table.apply(lambda values: round_values(values) if pd.api.types.is_numeric_dtype(values) else values)
    kept = ["label", "group"]
    for name in table.columns.drop(kept):
        if table[name].nunique(dropna=False) > 1 and not any(table[name].equals(table[one]) for one in kept):
            kept.append(name)
    return table[kept]


def round_values(values: pd.Series) -> pd.Series:
    """Round numbers to five digits, so that equal sums are equal."""
    return values.map("{:.4e}".format, na_action="ignore").astype(np.float64)


def tabulate_nuisances(index: pd.DataFrame, examples: Sequence[ExampleSpec]) -> pd.DataFrame:
    """Tabulate the nuisance parameters of examples that were resolved again."""
    flat = tabulate_examples(examples).drop(columns=["label", "group"])
    if any(example.is_episode for example in examples):  # of each its first track; not every body has one
        index = index.drop_duplicates("scene_id").assign(id=lambda rows: rows["scene_id"])
        flat = flat[flat.index.isin(index["id"])]
    rows = index.drop_duplicates("id").set_index("id").loc[flat.index]
    stated = _select_measured(rows).rename(
        columns=lambda name: name if name in ("label", "group", "empty") else f"index.{name}"
    )
    if (flat["noise.kind"] == "snr").all():
        stated["index.snr_frame_db"] = rows["snr_frame_db"]  # for thermal noise the level depends on the motion
    if "target.rcs.total_m2" in flat and flat["target.rcs.total_m2"].notna().all():
        stated = stated.drop(columns="index.rcs_total_m2")  # over that of the plan it shows the shape of a body
    return pd.concat([flat, stated], axis=1)  # a value in both is judged under the key of the plan


def collect_nuisances(
    datasets: Iterable[Dataset], motion_folder: Path, *, empty: bool
) -> tuple[dict[str, npt.NDArray[np.float64]], str]:
    """Collect the varying nuisance parameters of rows as numbers, with a remark."""
    parts, notes = [], []
    for dataset in datasets:
        n_rows = dataset.description.get("n_examples", 0)  # of the whole dataset, of which this may be a part
        plan, reason = read_plan(dataset.description, motion_folder, n_rows)
        contents = Contents(dataset.directory, dataset.description, dataset.index, plan, reason)
        sampled = contents.resolve_sample(np.random.default_rng(0), most=10 * len(dataset) + 100)
        if sampled:
            rows = tabulate_nuisances(dataset.index, sampled).drop(columns=["label", "group", "empty"])
            rows = rows.reindex(dataset.index["id"])
        else:
            rows = dataset.index[[name for name in MEASURED if name in dataset.index]].add_prefix("index.")
            notes.append(f"Nuisance parameters of {dataset.directory} are only {', '.join(map(str, rows))} ({reason}).")
        parts.append(rows)
    table = pd.concat(parts, ignore_index=True, join="inner")
    kept = {}
    for name, column in table.items():
        if empty and str(name).removeprefix("index.").startswith(UNSEEN):
            continue
        values = round_values(pd.Series(encode_values(column))).to_numpy(dtype=np.float64)
        if np.unique(values[~np.isnan(values)]).size > 1:
            kept[str(name)] = values
    return kept, " ".join(notes)


def tabulate_examples(examples: Sequence[ExampleSpec]) -> pd.DataFrame:
    """Tabulate label, group and nuisance parameters of resolved examples."""
    records = []
    for example in examples:
        snr_db = example.run.noise.snr_db if example.run.noise.kind == "snr" else np.nan
        for number, row in enumerate(example.rows):
            stated = {"label": row.label, "group": example.group, **collect_nuisance(example, number)}
            records.append({"id": row.id, **stated, "noise.snr_db": snr_db})
    return pd.DataFrame(records).set_index("id")


def _select_measured(rows: pd.DataFrame) -> pd.DataFrame:
    kept = rows[["label", "group", *(name for name in MEASURED if name in rows)]].copy()
    return kept.assign(empty=(rows["source"] == "none").to_numpy(dtype=bool))


def describe_guess(words: str, guess: Guess, table: pd.DataFrame) -> str:
    """Describe a leak: accuracy, limit, and the most predictive parameters by class."""

    def describe(known: pd.Series) -> str:
        """Return the median of numbers, else the most frequent value."""
        if known.empty:
            return "none"
        return f"{known.median():.3g}" if pd.api.types.is_numeric_dtype(known) else str(known.mode().iloc[0])

    telling = []
    for name, alone in guess.telling[:SHOWN_PARAMETERS]:
        per_class = ", ".join(f"{label} {describe(part.dropna())}" for label, part in table.groupby("label")[name])
        telling.append(f"{name.removeprefix('index.')} ({per_class}; alone {alone:.2f})")
    return (
        f"nuisance parameters alone predict {words}: balanced accuracy {guess.accuracy:.2f} (allowed "
        f"{guess.allowed:.2f}), p = {guess.p_value:.1g}; most predictive: {', '.join(telling)}"
    )


MAX_PLACED = 200  # maximum number of examples with a generated motion, which the body mass needs


def refuse_leaks(examples: Sequence[ExampleSpec], rng: np.random.Generator, *, leaks: Sequence[str] = ()) -> None:
    """Raise a :class:`DatasetError` if nuisance parameters predict the class."""
    moving = [example for example in examples if all(row.source != "none" for row in example.rows)]
    if not moving:
        return
    # the range error of the gates is not judged: no key can make it differ by class
    table = select_varying(drop_leaks(tabulate_examples(moving), (*leaks, *UNJUDGED)))
    if leak := find_leak(table, rng):
        raise DatasetError(f"{leak}; {LEAK_FIX}")


def warn_of_leaks(examples: Sequence[ExampleSpec], rng: np.random.Generator, *, leaks: Sequence[str] = ()) -> None:
    """Warn of what :func:`refuse_leaks` refuses; do not stop the build."""
    try:
        refuse_leaks(examples, rng, leaks=leaks)
    except DatasetError as error:
        warn_caller(f"{error}; the dataset is built, but a classifier trained on it uses these parameters")


def warn_of_default_rcs(
    examples: Sequence[ExampleSpec], rng: np.random.Generator, *, folder: Path, leaks: Sequence[str] = ()
) -> None:
    """Warn if cross sections by body mass predict the class."""
    if "target.rcs" in leaks:
        return
    records, unstated = [], False
    labels = {example.label for example in examples}
    for label in sorted(labels):  # of every class: a rare one needs as many
        members = [example for example in examples if example.label == label]
        for example in members[:: -(-len(members) * len(labels) // MAX_PLACED)]:
            specs = [target.rcs for target in example.run.scene.targets if not target.background]
            masses_kg = [0.0] * len(specs)
            if any(spec.total_m2 is None for spec in specs):
                unstated = True
                try:  # the build adds the warnings to the example
                    with warnings.catch_warnings(action="ignore", category=DoppelgaitWarning):
                        observed = place(example.run.scene, example.run.streams, folder=folder).observed
                except DoppelgaitError:  # the build leaves the example out, too, and reports the reason
                    continue
                masses_kg = [target.motion.facts.mass_kg for target in observed]
            records += [
                {"label": row.label, "group": example.group, "rcs_total_m2": total_rcs_m2(spec, mass_kg)}
                for row, spec, mass_kg in zip(example.rows, specs, masses_kg, strict=True)
                if row.source != "none"
            ]
    if unstated and records and (leak := find_leak(pd.DataFrame(records), rng)):
        warn_caller(f"{leak}; {RCS_FIX}")
