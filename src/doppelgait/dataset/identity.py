"""What a dataset is: its configuration, its source files and what this version makes of them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from doppelgait.core.config import canonical_json
from doppelgait.core.errors import ConfigError
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.motions import motion_files

SCHEMA_VERSION = 2
"""Form of the files of a dataset. 2: one row per target with scene, group, licence; axes by field; half precision."""

DATA_VERSION = 7
"""What a configuration means in bytes. It is part of every dataset's identity and raised by hand whenever the same
configuration gives other bytes (a draw, a kernel, a stored type), so that a dataset is never finished with examples of
another making. 1: first form. 2: compiled kernels for geometry, noise and signature; splits by subject names.
3: another order of operations in amplitudes, tracks, the short-time transform and the cadence map; features from the
columns of the lossless hop. 4: gait frequency by limbs, harmonics and a decision between step and stride. 5: rows by
target, splits by groups. 6: alignment by cubic convolution; the last bits of features."""


def dataset_id(plan: PlanConfig, folder: Path) -> str:
    """Identity of the dataset: hash of canonical configuration, source files and data version; 16 hex digits.

    Parameters
    ----------
    plan : PlanConfig
        With its folders expanded.
    folder : Path
        Folder that relative paths start from.

    Raises
    ------
    ConfigError
        If a motion or preset file cannot be read.
    """
    digest = hashlib.sha256(f"{DATA_VERSION}\n{canonical_json(plan)}\n".encode())
    motions = [section.motion for section in plan.classes]
    sources = {
        "motion file": motion_files([*motions, {"companions": plan.companions}]),
        "preset file": _preset_files(plan.radar),
    }
    for noun, paths in sources.items():
        for path in paths:
            try:
                digest.update(hashlib.sha256((folder / path).read_bytes()).digest())
            except OSError as error:
                raise ConfigError(f"{noun} {path}: cannot be read: {error}") from None
    return digest.hexdigest()[:16]


def _preset_files(value: Any) -> Iterator[str]:
    """Files of sensor twins that a radar table names, under ``preset`` or among its choices."""
    if isinstance(value, Mapping):
        value = [inner for key, inner in value.items() if key != "name"]
    if isinstance(value, list):
        for inner in value:
            yield from _preset_files(inner)
    elif isinstance(value, str) and value.endswith(".toml"):
        yield value
