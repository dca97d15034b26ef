"""The motion table: positions of named points over time, with what is known about the mover."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.labels import MOTION, SPACE, make_array

NAN = float("nan")

FACTS: dict[str, Any] = {
    "source": "",  # file name or name of the model
    "kind": "",  # "recording" or the name of the model
    "subject": "",  # person or animal: the group of all leak-free splits
    "licence": "",
    "species": "",  # "human", "dog", ... or "" when unknown
    "gait": "",  # "walk", "run", "trot", "gallop", ... or "" when unknown
    "height_m": NAN,  # stature of a person, withers height of a dog or cat
    "mass_kg": NAN,
    "stride_frequency_hz": NAN,
    "step_frequency_hz": NAN,
    "gait_frequency_hz": NAN,  # f_mu, fundamental of the signature (E-07)
    "footfalls": {},  # touchdown times in s by foot, where exactly known
    "report": {},  # what reading and cleaning did: points dropped and why, gaps filled, units, axes
}
"""Keys that every motion carries in ``attrs`` and their values when nothing is known."""


def make_motion(
    position_m: npt.ArrayLike,
    *,
    rate_hz: float,
    markers: Sequence[str],
    parts: Sequence[str],
    start_s: float = 0.0,
    facts: Mapping[str, Any] | None = None,
) -> xr.DataArray:
    """Build a motion table.

    Parameters
    ----------
    position_m : array_like, shape (T, P, 3)
        Positions in metres, z up, floor at z = 0; NaN where a point was not seen (only before cleaning).
    rate_hz : float
        Frames per second, positive.
    markers : sequence of str, length P
        Unique point names.
    parts : sequence of str, length P
        Body part of each point (:mod:`doppelgait.motion.skeleton`), ``""`` when unknown.
    start_s : float
        Time of the first frame.
    facts : mapping, optional
        Values for the keys of :data:`FACTS`; other keys are not allowed.

    Returns
    -------
    xarray.DataArray
        Dimensions (time, marker, space), float64, m.

    Raises
    ------
    KeyError
        If ``facts`` holds a key that is not in :data:`FACTS`.
    """
    unknown = set(facts or {}) - set(FACTS)
    if unknown:
        raise KeyError(f"unknown motion facts: {sorted(unknown)}")
    values = np.asarray(position_m, dtype=np.float64)
    time_s = start_s + np.arange(values.shape[0]) / rate_hz
    known = {**FACTS, **(facts or {}), "rate_hz": float(rate_hz)}
    return make_array(MOTION, values, {"time": time_s}, known, like=_names(tuple(markers), tuple(parts)))


@lru_cache(maxsize=64)
def _names(markers: tuple[str, ...], parts: tuple[str, ...]) -> xr.DataArray:
    """Names of points as coordinates of no frames; a model asks for the same again and again."""
    coords = {"time": np.empty(0), "marker": list(markers), "space": list(SPACE), "part": ("marker", list(parts))}
    return make_array(MOTION, np.empty((0, len(markers), len(SPACE))), coords)
