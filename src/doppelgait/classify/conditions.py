"""Conditions that a model learnt under - carrier, pulse rate, observation time - and what lies outside them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from doppelgait.classify.data import Rows, wavelengths_m
from doppelgait.classify.learned import FloatArray, IntArray
from doppelgait.core.units import SPEED_OF_LIGHT_MPS

TOLERANCE = {"carrier_hz": (0.9, 1.1), "prf_hz": (0.9, 1.1), "observation_s": (0.8, 4.0)}
"""From so much of the lowest to so much of the highest that was learnt. A radar of another band or pulse rate is
another radar; who is seen for longer is seen better, so that there is more room above."""

Conditions = Mapping[str, tuple[float, float]]


def wavelength_of(signature: xr.DataArray) -> float:
    """Wavelength in m: as the signature states it, else by its axes, v = f wavelength / 2; NaN where neither does."""
    if "wavelength_m" in signature.attrs:
        return float(signature.attrs["wavelength_m"])
    if not {"velocity", "doppler"} <= set(signature.coords):
        return math.nan
    doppler_hz = np.asarray(signature.coords["doppler"].values, dtype=np.float64)
    velocity_mps = np.asarray(signature.coords["velocity"].values, dtype=np.float64)
    return float(2.0 * np.ptp(velocity_mps) / np.ptp(doppler_hz)) if np.ptp(doppler_hz) > 0 else math.nan


def prf_of(signature: xr.DataArray) -> float:
    """Pulse rate in Hz, which the Doppler axis spans; NaN where there is no such axis."""
    if "doppler" not in signature.coords or signature.sizes["doppler"] < 2:
        return math.nan
    doppler_hz = np.asarray(signature.coords["doppler"].values, dtype=np.float64)
    return float(np.ptp(doppler_hz) * doppler_hz.size / (doppler_hz.size - 1))


def conditions_of_target(columns: Mapping[str, Any], signature: xr.DataArray) -> dict[str, float]:
    """Conditions that a target was seen under; NaN for unknown."""
    observed_s = columns.get("quality_observation_s")
    return {
        "carrier_hz": SPEED_OF_LIGHT_MPS / wavelength_of(signature),
        "prf_hz": prf_of(signature),
        "observation_s": math.nan if observed_s is None else float(observed_s),
    }


def conditions_of_rows(rows: Rows) -> dict[str, FloatArray]:
    """Conditions of every row, shape (n,); NaN for unknown. The observation time is what the analysis made use of."""
    observed_s = _numbers(rows.index, "quality_observation_s")
    return {
        "carrier_hz": SPEED_OF_LIGHT_MPS / wavelengths_m(rows),
        "prf_hz": _numbers(rows.index, "prf_hz"),
        "observation_s": np.where(np.isnan(observed_s), _numbers(rows.index, "observation_s"), observed_s),
    }


def _numbers(index: pd.DataFrame, column: str) -> FloatArray:
    if column not in index:
        return np.full(len(index), np.nan)
    return pd.to_numeric(index[column], errors="coerce").to_numpy(dtype=np.float64, na_value=np.nan)


def learnt_conditions(found: Mapping[str, FloatArray], train: IntArray) -> dict[str, tuple[float, float]]:
    """Lowest and highest value of every condition that is known of a row learnt from."""
    known = {name: values[train][np.isfinite(values[train])] for name, values in found.items()}
    return {name: (float(values.min()), float(values.max())) for name, values in known.items() if values.size}


def beyond(values: FloatArray, name: str, learnt: Conditions) -> npt.NDArray[np.bool_]:
    """Which values of a condition lie outside what was learnt by more than the tolerance; unknown ones do not."""
    if name not in learnt:
        return np.zeros(np.shape(values), dtype=bool)
    (low, high), (less, more) = learnt[name], TOLERANCE[name]
    return np.asarray((values < low * less) | (values > high * more))


def outside_conditions(found: Mapping[str, float], learnt: Conditions) -> list[str]:
    """What a target's conditions have outside those learnt, in words; what is unknown is said too."""
    said = []
    for name in TOLERANCE:
        if name not in learnt:
            continue
        words = span_words(*learnt[name])
        if math.isnan(found[name]):
            said.append(f"{name} is not known; learnt was {words}")
        elif beyond(np.array([found[name]]), name, learnt)[0]:
            said.append(f"{name} {found[name]:.4g} is outside what was learnt, {words}")
    return said


def span_words(low: float, high: float) -> str:
    """A span in words; one number if it is one."""
    return f"{low:.4g}" if f"{low:.4g}" == f"{high:.4g}" else f"{low:.4g} to {high:.4g}"


def conditions_outside(found: Mapping[str, FloatArray], train: IntArray, test: IntArray) -> dict[str, dict[str, Any]]:
    """Of every condition that tested rows have outside those learnt: how many rows, what was learnt, what is theirs."""
    learnt, said = learnt_conditions(found, train), {}
    for name, values in found.items():
        far = beyond(values[test], name, learnt)
        if far.any():
            theirs = values[test][far]
            said[name] = {
                "n": int(far.sum()), "of": int(test.size), "learnt": list(learnt[name]),
                "tested": [float(theirs.min()), float(theirs.max())],
            }  # fmt: skip
    return said
