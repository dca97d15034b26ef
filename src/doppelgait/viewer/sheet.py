"""Small signatures of many examples on common axes and a common scale, made of the arrays that a dataset keeps."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.errors import DatasetError
from doppelgait.core.labels import axis
from doppelgait.dataset import Dataset

THUMBNAIL = (112, 80)
"""Cells of a thumbnail in time and velocity."""
LEVELS = 255

FloatArray = npt.NDArray[np.float64]


def thumbnails(
    dataset: Dataset, rows: npt.NDArray[np.int64]
) -> tuple[dict[str, Any], dict[str, npt.NDArray[np.uint8]]]:
    """Signatures of some rows as small images.

    Parameters
    ----------
    dataset : Dataset
    rows : ndarray, shape (n,)
        Numbers of rows of the index.

    Returns
    -------
    facts : dict
        ``image`` as in the viewer's other images, with 255 levels: axes, ``db``, ``unit``; None where nothing can be
        shown. ``reasons``: for every row, why it has no image, or None.
    arrays : dict
        ``thumbnails``, uint8 (n, columns, rows); 0 also where there is nothing.
    """
    found = [_signature(dataset, int(row)) for row in rows]
    signatures = [signature for signature, _ in found if signature is not None]
    facts: dict[str, Any] = {"reasons": [reason for _, reason in found], "image": None}
    if not signatures:
        return facts, {}
    edges = _common_edges(signatures)
    maps = [None if signature is None else _small(signature, *edges) for signature, _ in found]
    low, high = _common_levels([values for values in maps if values is not None])
    codes = np.stack([np.zeros(THUMBNAIL, dtype=np.uint8) if m is None else _coded(m, low, high) for m in maps])
    times_s, velocities = edges
    moving = "m/s" if _has_velocity(signatures) else "Hz"
    facts["image"] = {
        "array": "thumbnails",
        "x": _axis_facts("time", "s", times_s),
        "y": _axis_facts("velocity" if moving == "m/s" else "doppler", moving, velocities),
        "db": [low, high],
        "shown_db": [low, high],
        "unit": f"dB re {'1 V²' if signatures[0].attrs['units'] == 'V^2' else '1'}",
    }
    return facts, {"thumbnails": codes}


def _signature(dataset: Dataset, row: int) -> tuple[xr.DataArray | None, str | None]:
    """Stored signature of a row, or why there is none to show."""
    try:
        dataset.check_fields(["signature"])
        signature = dataset.example(row).arrays.get("signature")
    except DatasetError as error:
        return None, str(error)
    if signature is None:
        return None, "no signature: the target was not tracked"
    if not {"time", "doppler"} <= set(signature.coords) or min(signature.shape) < 2:
        return None, "its shard tells no axes of the signature"
    return signature, None


def _has_velocity(signatures: list[xr.DataArray]) -> bool:
    """Whether the wavelength, and so the velocity axis, of all of them is known."""
    return all(np.isfinite(axis(signature, "velocity")).all() for signature in signatures)


def _common_edges(signatures: list[xr.DataArray]) -> tuple[FloatArray, FloatArray]:
    """Edges of the cells in time from the start of each, and in velocity, that hold the occupied part of all."""
    from doppelgait.viz.maps import doppler_limits_hz

    seconds = max(float(np.ptp(axis(s, "time"))) for s in signatures)
    limits = np.array([doppler_limits_hz(s) for s in signatures])
    if _has_velocity(signatures):
        limits *= np.array([[s.attrs["wavelength_m"] / 2.0] for s in signatures])
    columns, rows = THUMBNAIL
    return np.linspace(0.0, seconds, columns + 1), np.linspace(limits[:, 0].min(), limits[:, 1].max(), rows + 1)


def _small(signature: xr.DataArray, times_s: FloatArray, velocities: FloatArray) -> FloatArray:
    """Strongest level of every cell, dB; NaN where the signature does not reach."""
    from doppelgait.viz.maps import level_db_of

    own_s = axis(signature, "time") - axis(signature, "time")[0]
    own_velocities = axis(signature, "velocity")
    if not np.isfinite(own_velocities).all():
        own_velocities = axis(signature, "doppler")
    power = strongest(np.asarray(signature.values, dtype=np.float64), own_s, times_s)
    return level_db_of(strongest(power.T, own_velocities, velocities).T)


def strongest(values: FloatArray, samples: FloatArray, edges: FloatArray) -> FloatArray:
    """Largest of the samples that a cell touches, along the first axis; NaN where there are none.

    Parameters
    ----------
    values : ndarray, shape (n, m)
    samples : ndarray, shape (n,)
        Rising, evenly spaced; each stands for half a step to either side.
    edges : ndarray, shape (cells + 1,)

    Returns
    -------
    ndarray, shape (cells, m)
    """
    half = float(samples[1] - samples[0]) / 2.0
    first = np.searchsorted(samples + half, edges[:-1], side="right")
    behind = np.searchsorted(samples - half, edges[1:], side="left")
    padded = np.concatenate([values, np.full((1, values.shape[1]), np.nan)])
    found = np.maximum.reduceat(padded, np.column_stack([first, behind]).ravel(), axis=0)[::2]
    return np.asarray(np.where((first < behind)[:, None], found, np.nan))


def _common_levels(maps: list[FloatArray]) -> tuple[float, float]:
    from doppelgait.viz.maps import level_limits_db

    return level_limits_db(np.concatenate([values.ravel() for values in maps]), None)


def _coded(level_db: FloatArray, low: float, high: float) -> npt.NDArray[np.uint8]:
    share = np.clip(np.nan_to_num((level_db - low) / (high - low), nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
    return np.rint(share * LEVELS).astype(np.uint8)


def _axis_facts(name: str, unit: str, edges: FloatArray) -> dict[str, Any]:
    step = float(edges[1] - edges[0])
    first = float(edges[0]) + step / 2
    return {"name": name, "unit": unit, "first": first, "step": step, "n": edges.size - 1, "block": 1}
