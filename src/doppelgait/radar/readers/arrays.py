"""Plain complex matrices, .npz and .npy, with a TOML file beside them that says what they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import RecordingError
from doppelgait.radar.readers.array_facts import ArrayFacts, describe, read_facts
from doppelgait.radar.readers.measured import check_shape, label_measured
from doppelgait.radar.readers.npy import NPY_MAGIC, is_npz, load_npy_file, load_npz
from doppelgait.radar.recording import NAN, Recording

MATRIX = "baseband"
PARTS = ("i", "q")
AXES = ("slow_time_s", "range_m")

Arrays = Mapping[str, npt.NDArray[Any] | None]


def sniff_arrays(path: Path) -> bool:
    """Whether a file is a ``.npy`` array or a zip archive that starts with one."""
    with path.open("rb") as file:
        head = file.read(4096)
    return head.startswith(NPY_MAGIC) or is_npz(head)


def read_arrays(
    path: Path,
    *,
    radar: str | Path | None = None,
    prf_hz: float | None = None,
    carrier_hz: float | None = None,
    range_start_m: float | None = None,
    bin_spacing_m: float | None = None,
    time_first: bool | None = None,
    conjugate: bool | None = None,
    scale_v: float | None = None,
    key: str | None = None,
) -> Recording:
    """Recording of a complex matrix (pulses, range bins), or of a list of pulses of a continuous-wave radar.

    A ``.npy`` file holds one array, an ``.npz`` file the matrix as ``baseband``, as its only array or as real ``i``
    and ``q``, and optionally the axes ``slow_time_s`` and ``range_m``. Real arrays are I and Q along a last axis of
    two. What the values are stands in a TOML file of the same stem (``walk.npz``, ``walk.toml``) with the keys of
    :class:`~doppelgait.radar.readers.array_facts.ArrayFacts`; the options below replace its entries.

    Parameters
    ----------
    path : Path
        An existing file.
    radar : str or Path, optional
        Preset, or path of such a file, that stands for the sensor.
    prf_hz, carrier_hz, range_start_m, bin_spacing_m, time_first, conjugate, scale_v, key
        As in :class:`~doppelgait.radar.readers.array_facts.ArrayFacts`.

    Returns
    -------
    Recording
        Baseband in V.

    Raises
    ------
    RecordingError
        If the file is damaged, holds objects, NaN or infinity, something needed is not told, or a value is not
        allowed. Nothing is ever unpickled.
    """
    options = {
        "prf_hz": prf_hz, "carrier_hz": carrier_hz, "range_start_m": range_start_m, "bin_spacing_m": bin_spacing_m,
        "time_first": time_first, "conjugate": conjugate, "scale_v": scale_v, "key": key,
        "radar": None if radar is None else {"preset": str(radar)},
    }  # fmt: skip
    facts = read_facts(path, {name: value for name, value in options.items() if value is not None})
    arrays = _load(path, facts.key)
    values = _as_baseband(path, _pick(path, arrays, facts.key), facts)
    check_shape(path, values)
    frame = describe(path, facts, values.shape, arrays)
    recording = label_measured(
        path,
        _scaled(values, facts),
        radar=frame.radar,
        slow_time_s=frame.slow_time_s,
        range_m=frame.range_m,
        notes=frame.notes if facts.notes is None else facts.notes,
        attrs=facts.attributes,
    )
    return replace(
        recording,
        noise_power_v2=NAN if facts.noise_power_v2 is None else facts.noise_power_v2,
        snr_frame_db=NAN if facts.snr_frame_db is None else facts.snr_frame_db,
        seed=facts.seed,
    )


def _load(path: Path, key: str | None) -> Arrays:
    with path.open("rb") as file:
        is_npy = file.read(len(NPY_MAGIC)) == NPY_MAGIC
    return {key or MATRIX: load_npy_file(path)} if is_npy else load_npz(path, (key or MATRIX, *PARTS, *AXES))


def _pick(path: Path, arrays: Arrays, key: str | None) -> npt.NDArray[Any]:
    """The matrix as it is in the file."""
    found = arrays.get(key or MATRIX)
    if found is None and key is None and len(arrays) == 1:
        found = next(iter(arrays.values()))
    if found is not None:
        return found
    held = ", ".join(arrays) or "nothing"
    if key is not None:
        raise RecordingError(f"{path}: has no array {key!r}; it holds {held}")
    i, q = arrays.get("i"), arrays.get("q")
    if i is None or q is None:
        raise RecordingError(f"{path}: has no array {MATRIX!r} and not both 'i' and 'q'; it holds {held}: key='NAME'")
    if i.shape != q.shape or i.dtype.kind not in "fiu" or q.dtype.kind not in "fiu":
        raise RecordingError(
            f"{path}: i is {i.dtype} of shape {i.shape} and q {q.dtype} of shape {q.shape}; both must be real and of "
            "one shape"
        )
    return _join(i, q)


def _join(i: npt.NDArray[Any], q: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Complex values of I and Q; wide enough that 32-bit integers stay exact until they are scaled."""
    joined = np.empty(i.shape, np.result_type(i.dtype, np.complex64))
    joined.real, joined.imag = i, q
    return joined


def _as_baseband(path: Path, values: npt.NDArray[Any], facts: ArrayFacts) -> npt.NDArray[Any]:
    """Complex matrix (pulses, range bins), not scaled."""
    if values.dtype.kind not in "fiuc":
        raise RecordingError(f"{path}: holds {values.dtype} values; a baseband is numbers")
    if values.dtype.kind != "c":
        if values.ndim < 2 or values.shape[-1] != 2:
            raise RecordingError(
                f"{path}: holds real values of shape {values.shape}; a baseband is complex, or real with I and Q along "
                "a last axis of 2, or two arrays named i and q"
            )
        values = _join(values[..., 0], values[..., 1])
    if values.ndim == 1:
        return values[:, None]
    if values.ndim != 2:
        raise RecordingError(f"{path}: has the shape {values.shape}; it must be (pulses, range bins) or (pulses,)")
    return values if facts.time_first else values.T


def _scaled(values: npt.NDArray[Any], facts: ArrayFacts) -> npt.NDArray[Any]:
    values = values.conj() if facts.conjugate else values
    return values if facts.scale_v is None or facts.scale_v == 1.0 else facts.scale_v * values
