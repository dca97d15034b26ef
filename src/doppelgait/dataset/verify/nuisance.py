"""Whether what must not tell the class tells it: a classifier on the nuisance parameters alone."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from doppelgait.core.errors import DatasetError, DoppelgaitWarning
from doppelgait.dataset.plan import nuisance_of
from doppelgait.dataset.resolve import ExampleSpec
from doppelgait.dataset.verify.chance import Guess, guess_classes
from doppelgait.dataset.verify.contents import Contents
from doppelgait.dataset.verify.report import Check

MEASURED = ("prf_hz", "observation_s", "rcs_total_m2", "gate_error_m", "radar_height_m")
UNSEEN = ("target.rcs", "rcs_total_m2", "snr_frame_db")
"""Levels of echoes that an empty room does not have; a class of nobody is judged by the other parameters."""
MOST_ROWS = 2000
SHOWN_PARAMETERS = 3


def check_nuisance(contents: Contents, drawn: Sequence[ExampleSpec], rng: np.random.Generator) -> Check:
    """Classes must not be told by PRF, range, bearing, aspect, level, noise, gate error and the like.

    A classifier learns the class from these values, as the plan drew them and as the index states them, and is scored
    in folds that keep groups together. The check fails where the mean balanced accuracy of the folds exceeds
    0.55 (of two classes; as far above chance for more) and fewer than 0.1 % of permutations of the labels over the
    groups do as well (:mod:`doppelgait.dataset.verify.chance`). Imported recordings are as they are: a warning only.
    """
    index = contents.index
    table = nuisance_table(index, drawn) if drawn else _measured(_some_rows(index, rng))
    findings = [
        (words, guess_classes(part, rng))
        for words, part in _questions(table)
        if part["label"].nunique() > 1 and len(part.columns) > 2
    ]
    if not findings:
        return Check("nuisance", "skipped", "one class, or no nuisance parameter that differs")
    numbers = {words: guess.as_dict() for words, guess in findings}
    told = [_words(words, guess, table) for words, guess in findings if guess.leaks]
    if told:
        return Check("nuisance", "warning" if contents.measured else "failed", "; ".join(told), numbers)
    unclear = [f"{words}: {guess.reason}" for words, guess in findings if guess.reason]
    if len(unclear) == len(findings):
        return Check("nuisance", "skipped", "; ".join(unclear), numbers)
    listed = "; ".join(
        f"{words} from {guess.n_parameters} parameters of {guess.n_rows} rows: balanced accuracy {guess.accuracy:.2f} "
        f"(p = {guess.p_value:.2g})"
        for words, guess in findings
        if not guess.reason
    )
    return Check("nuisance", "passed", f"{listed}{'; not judged: ' + '; '.join(unclear) if unclear else ''}", numbers)


def _questions(table: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    """Movers among each other by all parameters, and all classes by those that an empty room has, too."""
    nobody = table["nobody"].to_numpy(dtype=bool)
    table = table.drop(columns="nobody")
    movers = _varying(table[~nobody])
    if not nobody.any():
        return [("classes", movers)]
    seen = [name for name in table.columns if not str(name).removeprefix("index.").startswith(UNSEEN)]
    return [("classes of movers", movers), ("all classes", _varying(table[seen]))]


def _varying(table: pd.DataFrame) -> pd.DataFrame:
    """Label, group and the parameters that differ by more than rounding: no radar sees the sixth digit of a level."""
    table = table.apply(lambda values: rounded(values) if pd.api.types.is_float_dtype(values) else values)
    kept = [name for name in table.columns if name in ("label", "group") or table[name].nunique(dropna=False) > 1]
    return table[kept]


def rounded(values: pd.Series) -> pd.Series:
    """Numbers to five significant digits, which makes one of what was summed up in another order."""
    numbers = values.to_numpy(dtype=np.float64)
    known = np.isfinite(numbers) & (numbers != 0)
    unit = 10.0 ** (np.floor(np.log10(np.abs(numbers[known]))) - 4.0)
    numbers = numbers.copy()
    numbers[known] = np.round(numbers[known] / unit) * unit
    return pd.Series(numbers, index=values.index)


def _some_rows(index: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    if len(index) <= MOST_ROWS:
        return index
    return index.iloc[np.sort(rng.choice(len(index), MOST_ROWS, replace=False))]


def nuisance_table(index: pd.DataFrame, drawn: Sequence[ExampleSpec]) -> pd.DataFrame:
    """Nuisance parameters of examples that were drawn again, and what the index states of them."""
    flat = drawn_table(drawn).drop(columns=["label", "group"])
    rows = index.drop_duplicates("id").set_index("id").loc[flat.index]
    stated = _measured(rows).rename(
        columns=lambda name: name if name in ("label", "group", "nobody") else f"index.{name}"
    )
    if (flat["noise.kind"] == "snr").all():
        stated["index.snr_frame_db"] = rows["snr_frame_db"]  # of a thermal level of noise the motion is a part of it
    return pd.concat([stated, flat], axis=1)


def drawn_table(drawn: Sequence[ExampleSpec]) -> pd.DataFrame:
    """Label, group and nuisance parameters of every row of resolved examples, by its identifier."""
    records, names = [], []
    for example in drawn:
        snr_db = example.run.noise.snr_db if example.run.noise.kind == "snr" else np.nan
        for number, row in enumerate(example.rows):
            stated = {"label": row.label, "group": example.group, **nuisance_of(example, number)}
            records.append({**stated, "noise.snr_db": snr_db})
            names.append(row.id)
    return pd.DataFrame(records, index=names)


def refuse_leaks(drawn: Sequence[ExampleSpec], rng: np.random.Generator) -> None:
    """A :class:`DatasetError` if the drawn nuisance parameters of a plan tell its classes; nothing is simulated.

    Parameters
    ----------
    drawn : sequence of ExampleSpec
    rng : Generator
        Folds and permutations.
    """
    movers = [e for e in drawn if all(row.source != "none" for row in e.rows)]
    table = _varying(drawn_table(movers)) if movers else pd.DataFrame({"label": []})
    if table["label"].nunique() < 2 or len(table.columns) < 3:
        return
    guess = guess_classes(table, rng)
    if guess.leaks:
        raise DatasetError(f"{_words('classes', guess, table)}; draw them by one law for every class")


def warn_of_leaks(drawn: Sequence[ExampleSpec], rng: np.random.Generator) -> None:
    """A warning of what :func:`refuse_leaks` refuses, for a build that somebody may want all the same."""
    try:
        refuse_leaks(drawn, rng)
    except DatasetError as error:
        warnings.warn(
            f"{error}; the dataset is built, but what learns from it learns these", DoppelgaitWarning, stacklevel=3
        )


def _measured(rows: pd.DataFrame) -> pd.DataFrame:
    kept = rows[["label", "group", *(name for name in MEASURED if name in rows)]].copy()
    return kept.assign(nobody=(rows["source"] == "none").to_numpy(dtype=bool))


def _words(words: str, guess: Guess, table: pd.DataFrame) -> str:
    telling = [_parameter(name, alone, table) for name, alone in guess.telling[:SHOWN_PARAMETERS]]
    return (
        f"{words} are told by nuisance parameters alone: balanced accuracy {guess.accuracy:.2f} (allowed "
        f"{guess.allowed:.2f}), p = {guess.p_value:.1g}; most telling: {', '.join(telling)}"
    )


def _parameter(name: str, alone: float, table: pd.DataFrame) -> str:
    """Name of a parameter and what it is like in every class: the median of numbers, else the commonest value."""
    per_class: list[str] = []
    for label, part in table.groupby("label")[name]:
        known: Any = part.dropna()
        if known.empty:
            value = "none"
        elif pd.api.types.is_numeric_dtype(known):
            value = f"{float(known.median()):.3g}"
        else:
            value = str(known.mode().iloc[0])
        per_class.append(f"{label} {value}")
    return f"{name.removeprefix('index.')} ({', '.join(per_class)}; alone {alone:.2f})"
