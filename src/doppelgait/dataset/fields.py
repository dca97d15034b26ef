"""Arrays that a dataset keeps: what each is, and how it is stored and read back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.dataset.config import FieldSpec

Array = npt.NDArray[Any]

FIELDS: dict[str, dict[str, Any]] = {
    "signature": {"dims": ["time", "doppler"], "units": "V^2", "dtype": "float32"},
    "cadence_map": {"dims": ["cadence", "doppler"], "units": "1", "dtype": "float32"},
    "baseband": {"dims": ["slow_time", "range"], "units": "V", "dtype": "complex64"},
    "truth_range_m": {"dims": ["slow_time", "scatterer"], "units": "m", "dtype": "float32"},
    "truth_radial_velocity_mps": {"dims": ["slow_time", "scatterer"], "units": "m/s", "dtype": "float32"},
}
"""Fields in full precision; axes stand beside them as ``FIELD_AXIS_UNIT``, for example ``signature_time_s``."""

AXIS_UNITS = {"time": "s", "doppler": "hz", "cadence": "hz", "slow_time": "s", "range": "m"}

DB_FLOOR = -400.0
"""Stored for a power of 0."""


def facts_of(specs: Sequence[FieldSpec]) -> dict[str, dict[str, Any]]:
    """What ``dataset.json`` says of each field: dims, units, dtype, scale and hop."""
    facts: dict[str, dict[str, Any]] = {}
    for spec in specs:
        half = spec.dtype == "half"
        kept = {"dtype": "float16", "scale": "db"} if half else {"scale": "linear"}
        facts[spec.name] = {**FIELDS[spec.name], **kept, "hop": spec.hop}
    return facts


def encode(values: npt.ArrayLike, spec: FieldSpec) -> Array:
    """Array as it is stored: every ``hop``-th row, in the precision of the field.

    ``half`` stores 10 log10 of a power; float16 has steps of 0.125 dB between 128 and 256 dB from 1, finer below.
    """
    kept = np.asarray(values)[:: spec.hop]
    if spec.dtype == "full":
        return np.ascontiguousarray(kept.astype(np.dtype(FIELDS[spec.name]["dtype"]).newbyteorder("<"), copy=False))
    with np.errstate(divide="ignore"):
        level_db = 10.0 * np.log10(kept.astype(np.float64))
    return np.maximum(level_db, DB_FLOOR).astype("<f2")


def decode(values: npt.ArrayLike, facts: Mapping[str, Any]) -> Array:
    """Array in linear units from what is stored; ``facts`` is the field's entry of ``dataset.json``."""
    stored = np.asarray(values)
    if facts.get("scale", "linear") == "linear":
        return stored
    power = 10.0 ** (stored.astype(np.float64) / 10.0)
    return np.where(stored <= DB_FLOOR, 0.0, power).astype(np.float32)
