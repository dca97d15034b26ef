"""Answers of the server: JSON and binary arrays, images, errors."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.config import convert_to_json
from doppelgait.core.labels import label_axis, label_values, read_axis
from doppelgait.core.lazy import read_tiles
from doppelgait.core.units import doppler_to_velocity_mps, power_to_db

MAGIC = b"DGV1"
ALIGNMENT = 8
DTYPES = ("uint8", "uint16", "uint32", "int16", "int32", "float32", "float64")
"""Types of numbers for which a browser has typed arrays."""


def pack(facts: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]) -> bytes:
    """Pack magic, length of the JSON header (uint32), padded header and arrays, little-endian."""
    table, offset, parts = {}, 0, []
    for name, array in arrays.items():
        if array.dtype.name not in DTYPES:
            raise ValueError(f"{name}: values are {array.dtype}; a payload holds {', '.join(DTYPES)}")
        body = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<")).tobytes()
        table[name] = {"dtype": array.dtype.name, "shape": list(array.shape), "offset": offset}
        gap = -len(body) % ALIGNMENT
        parts += [body, bytes(gap)]
        offset += len(body) + gap
    header = as_json({**facts, "arrays": table})
    header += b" " * (-len(header) % ALIGNMENT)
    return b"".join([MAGIC, len(header).to_bytes(4, "little"), header, *parts])


def as_json(value: Any) -> bytes:
    """Encode a value as JSON in UTF-8."""
    return json.dumps(convert_to_json(value), ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()


def remove_folders(text: str, *folders: Path) -> str:
    """Replace folders in a text by their last name."""
    forms = {str(form): folder.resolve().name for folder in (*folders, Path()) for form in (folder, folder.resolve())}
    for form in sorted(forms, key=len, reverse=True):  # a folder before its parents
        if len(form) > 1:  # neither "." nor "/"
            text = text.replace(form, forms[form])
    return text


FloatArray = npt.NDArray[np.floating[Any]]

CODES = 65535
DEEPEST_DB = 160.0
"""Range of encoded levels below the highest; steps of 160 dB / 65535 keep 0.01 dB, and lower
levels are clipped."""
MOST = (2000, 600)
MEDIAN_OF = 500_000  # approximate number of cells from which the median of a picture is computed
AUTO_DB_RANGE = (20.0, 40.0)  # smallest and largest initial range of levels, as in the figures
Axis = dict[str, Any]


def level_db(power: npt.ArrayLike) -> FloatArray:
    """Convert powers to levels in dB, in their own precision."""
    return np.asarray(power_to_db(np.maximum(np.asarray(power), 0.0)))


def describe_axis(name: str, unit: str, values: npt.ArrayLike) -> Axis:
    """Describe a uniform axis: first value, step and number."""
    even = np.asarray(values, dtype=np.float64)
    step = float((even[-1] - even[0]) / (even.size - 1)) if even.size > 1 else 0.0
    return {"name": name, "unit": unit, "first": float(even[0]), "step": step, "n": int(even.size), "block": 1}


def describe_doppler(doppler_hz: npt.ArrayLike, wavelength_m: float) -> Axis:
    """Describe a Doppler axis and its velocity scale."""
    facts = describe_axis("Doppler", "Hz", doppler_hz)
    if math.isfinite(wavelength_m):
        scale = float(doppler_to_velocity_mps(1.0, wavelength_m))
        facts["second"] = {"name": "velocity", "unit": "m/s", "scale": scale}
    return facts


def encode_image(
    name: str, power: FloatArray | xr.DataArray, x: Axis, y: Axis, *, unit: str, most: tuple[int, int] = MOST
) -> tuple[dict[str, Any], npt.NDArray[np.uint16]]:
    """Encode a picture of levels."""
    blocks = [find_block_size(size, limit) for size, limit in zip(power.shape, most, strict=True)]
    every = max(1, power.size // MEDIAN_OF)
    maxima, some = [], []
    for first, tile in [(0, power)] if isinstance(power, np.ndarray) else read_tiles(power, blocks[0]):
        maxima.append(find_block_maxima(tile, *blocks))
        some.append(tile[-first % every :: every].copy())  # a view would keep the tile
    # maxima of powers: a logarithm of every cell takes ten times as long
    strongest = level_db(np.concatenate(maxima))
    finite = strongest[np.isfinite(strongest)]
    low, high = -1.0, 0.0
    if finite.size:  # limits of finite levels, within 160 dB
        high = float(finite.max())
        low = max(min(float(finite.min()), high - 1.0), high - DEEPEST_DB)
    facts = {
        "array": name,
        "x": average_axis(x, blocks[0]),
        "y": average_axis(y, blocks[1]),
        "db": [low, high],
        "shown_db": shown_range_db(level_db(np.concatenate(some)), high),
        "unit": unit,
    }
    return facts, encode(strongest, low, high)


def doppler_picture(
    array: xr.DataArray, power: FloatArray, x: Axis, name: str, unit: str
) -> tuple[dict[str, Any], npt.NDArray[np.uint16]]:
    """Encode powers over some quantity and Doppler as a picture."""
    doppler_hz, wavelength_m = read_axis(array, "doppler"), float("nan")
    farthest = int(np.abs(doppler_hz).argmax())
    if "velocity" in array.coords and doppler_hz[farthest] != 0:
        wavelength_m = float(2.0 * read_axis(array, "velocity")[farthest] / doppler_hz[farthest])
    axis = describe_doppler(doppler_hz, wavelength_m)
    facts, codes = encode_image(name, power, x, axis, unit=unit)
    return {**facts, "band_hz": find_band_hz(power, doppler_hz)}, codes


def find_band_hz(power: FloatArray, doppler_hz: npt.ArrayLike) -> tuple[float, float]:
    """Return the occupied part of the Doppler axis, as figures show it."""
    from doppelgait.viz.maps import doppler_limits_hz

    values, axes = label_values(("x", "doppler"), power), {"doppler": label_axis("doppler", doppler_hz)}
    return doppler_limits_hz(xr.DataArray(values, axes, indexes={}, fastpath=True))


def signature_picture(signature: xr.DataArray, name: str) -> tuple[dict[str, Any], npt.NDArray[np.uint16]]:
    """Encode a micro-Doppler signature as a picture."""
    unit = "dB re 1 V²" if signature.attrs.get("units") == "V^2" else "dB re 1"
    time = describe_axis("time", "s", read_axis(signature, "time"))
    return doppler_picture(signature, signature.values, time, name, unit)


def find_block_size(size: int, most: int) -> int:
    """Return the block size for at most ``most`` blocks."""
    return max(1, math.ceil(size / most))


def find_block_maxima(values: FloatArray, *blocks: int) -> FloatArray:
    """Return the strongest cell of every block, one size per axis."""
    for dim, block in enumerate(blocks):
        if block > 1:
            values = np.maximum.reduceat(values, np.arange(0, values.shape[dim], block), axis=dim)
    return values


def average_axis(facts: Axis, block: int) -> Axis:
    """Return the axis of the centres of blocks."""
    if block == 1:
        return facts
    first, n = facts["first"] + (block - 1) / 2 * facts["step"], math.ceil(facts["n"] / block)
    return {**facts, "first": first, "step": block * facts["step"], "n": n, "block": block}


def shown_range_db(levels_db: FloatArray, high_db: float) -> list[float]:
    """Return the initial limits of the levels, 20 to 40 dB apart."""
    finite = levels_db[np.isfinite(levels_db)]
    noise_db = float(np.median(finite)) - 3.0 if finite.size else -math.inf
    return [high_db - float(np.clip(high_db - noise_db, *AUTO_DB_RANGE)), high_db]


def encode(levels_db: FloatArray, low_db: float, high_db: float) -> npt.NDArray[np.uint16]:
    """Encode levels within the limits as codes 0 to 65535."""
    scaled = (levels_db - np.float64(low_db)) * (CODES / (high_db - low_db))
    return np.asarray(np.rint(np.clip(np.nan_to_num(scaled, nan=0.0), 0.0, CODES)), dtype=np.uint16)
