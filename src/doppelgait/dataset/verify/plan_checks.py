"""Find faults of a plan before anything is built."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from doppelgait.core.config import format_canonical_json
from doppelgait.core.errors import DatasetError, DoppelgaitError, DoppelgaitWarning, warn_caller
from doppelgait.dataset.resolve import ExampleSpec
from doppelgait.dataset.verify.leakage import (
    RCS_FIX,
    UNJUDGED,
    drop_leaks,
    find_leak,
    select_varying,
    tabulate_examples,
)
from doppelgait.motion.motion import Motion
from doppelgait.scene.placement import place
from doppelgait.scene.rcs import total_rcs_m2

MAX_PLACED = 200  # maximum number of examples with a generated motion, which the body mass needs


def refuse_leaks(examples: Sequence[ExampleSpec], rng: np.random.Generator, *, leaks: Sequence[str] = ()) -> None:
    """Raise a :class:`DatasetError` if nuisance parameters predict the class."""
    moving = [example for example in examples if all(row.source != "none" for row in example.rows)]
    if not moving:
        return
    # the range error of the gates is not judged: no key can make it differ by class
    table = select_varying(drop_leaks(tabulate_examples(moving), (*leaks, *UNJUDGED)))
    if leak := find_leak("classes", table, rng):
        raise DatasetError(f"{leak}; sample them from one distribution for every class")


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
                try:
                    with warnings.catch_warnings():
                        warnings.simplefilter("ignore", DoppelgaitWarning)  # the build adds the warnings to the example
                        observed = place(example.run.scene, example.run.streams, folder=folder).observed
                except DoppelgaitError:  # the build leaves the example out, too, and reports the reason
                    continue
                masses_kg = [target.motion.facts.mass_kg for target in observed]
            records += [
                {"label": row.label, "group": example.group, "rcs_total_m2": total_rcs_m2(spec, mass_kg)}
                for row, spec, mass_kg in zip(example.rows, specs, masses_kg, strict=True)
                if row.source != "none"
            ]
    if unstated and records and (leak := find_leak("classes", pd.DataFrame(records), rng)):
        warn_caller(f"{leak}; {RCS_FIX}")


MAX_READ = 20  # number of motion files that are read for their warnings
OF_A_CLIP = ("kind", "path", "hybrid", "segment", "loop_to_s", "loop_variation")
"""Keys of a motion without effect on what is read of its file."""


def warn_of_recordings(examples: Sequence[ExampleSpec], *, folder: Path) -> None:
    """Read the first motion files of a plan for their warnings."""
    from doppelgait.motion.readers import read

    motions = [target.motion for example in examples for target in example.run.scene.targets]
    files = {m["path"]: m for m in reversed(motions) if isinstance(m, Mapping) and m.get("kind") == "file"}
    for path, motion in sorted(files.items())[:MAX_READ]:
        options = {name: value for name, value in motion.items() if name not in OF_A_CLIP}
        with suppress(DoppelgaitError):  # the build leaves the example out, and reports the reason
            read(folder / path, **options)


def warn_of_equal_bodies(examples: Sequence[ExampleSpec]) -> None:
    """Warn of classes whose modelled bodies all have the same parameters."""
    motions: dict[str, list[str]] = {}
    for example in examples:
        for row, target in zip(example.rows, example.run.scene.targets, strict=False):  # background comes last
            if row.source == "model" and target.vary is None and not isinstance(target.motion, Motion):
                body = {**target.motion, "height_m": target.height_m}
                motions.setdefault(row.label, []).append(format_canonical_json(body))
    equal = [label for label, found in motions.items() if len(found) > 1 and len(set(found)) == 1]
    if equal:
        warn_caller(
            f"class {', '.join(equal)}: every example has the same motion parameters, so that training and test data "
            "have the same body; sample them, for example speed_mps = { uniform = [0.8, 1.6] }"
        )


def warn_of_unused_snr(noise: Mapping[str, Any]) -> None:
    """Warn if a plan states an SNR that its noise ignores."""
    kind = noise.get("kind", "thermal")
    if "snr_db" in noise and kind in ("thermal", "none"):
        warn_caller(f"noise.snr_db: is not used with noise.kind = {kind!r}; set noise.kind = 'snr' to use it")
