"""Complex matrices in .npz and .npy files, read and written.

A TOML file of the same stem describes them.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import OutputError, RecordingError
from doppelgait.core.files import open_atomically
from doppelgait.core.npz import NPY_MAGIC, is_npz, load_npy, load_npz
from doppelgait.core.plugins import plugin
from doppelgait.radar.measured import check_shape, label_measured
from doppelgait.radar.readers.array_facts import describe, read_facts
from doppelgait.radar.recording import NAN, Recording, list_further_facts

MATRIX = "baseband"
PARTS = ("i", "q")
AXES = ("slow_time_s", "range_m")

Arrays = Mapping[str, npt.NDArray[Any] | None]


def sniff_arrays(path: Path) -> bool:
    """Return whether a file is ``.npy`` or npz."""
    with path.open("rb") as file:
        head = file.read(4096)
    return head.startswith(NPY_MAGIC) or is_npz(head)


@plugin("radar_reader", "arrays", sniff=sniff_arrays, suffixes=(".npz", ".npy"))
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
    """Read a recording of a complex matrix (pulses, range bins).
    A one-dimensional array is a continuous-wave recording. A ``.npy`` file holds one array.
    """
    options = {
        "prf_hz": prf_hz,
        "carrier_hz": carrier_hz,
        "range_start_m": range_start_m,
        "bin_spacing_m": bin_spacing_m,
        "time_first": time_first,
        "conjugate": conjugate,
        "scale_v": scale_v,
        "key": key,
        "radar": None if radar is None else {"preset": str(radar)},
    }
    facts = read_facts(path, {name: value for name, value in options.items() if value is not None})
    with path.open("rb") as file:
        is_npy = file.read(len(NPY_MAGIC)) == NPY_MAGIC
    wanted = (facts.key or MATRIX, *PARTS, *AXES)
    arrays = {wanted[0]: load_npy(path, RecordingError)} if is_npy else load_npz(path, wanted, RecordingError)
    values = _pick(path, arrays, facts.key)
    if values.dtype.kind not in "fiuc":
        raise RecordingError(f"{path}: holds {values.dtype} values; a baseband is numbers")
    if values.dtype.kind != "c":
        if values.ndim < 2 or values.shape[-1] != 2:
            raise RecordingError(
                f"{path}: holds real values of shape {values.shape}; a baseband is complex, or real with I and Q along "
                "a last axis of 2, or two arrays named i and q"
            )
        values = _join(values[..., 0], values[..., 1])
    if values.ndim not in (1, 2):
        raise RecordingError(f"{path}: has the shape {values.shape}; it must be (pulses, range bins) or (pulses,)")
    if values.ndim == 1:
        values = values[:, None]
    elif not facts.time_first:
        values = values.T
    check_shape(path, values)
    values = values.conj() if facts.conjugate else values
    if facts.scale_v is not None and facts.scale_v != 1.0:
        values = facts.scale_v * values
    frame = describe(path, facts, values.shape, arrays)
    recording = label_measured(
        path,
        values,
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


def _pick(path: Path, arrays: Arrays, key: str | None) -> npt.NDArray[Any]:
    """Return the matrix as stored in the file."""
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
    """Join I and Q to complex values.
    The type is wide enough to keep 32-bit integers exact before scaling.
    """
    joined = np.empty(i.shape, np.result_type(i.dtype, np.complex64))
    joined.real, joined.imag = i, q
    return joined


FIRST_LINE = "# Radar recording, written by doppelgait: what the arrays beside it are."


@plugin("radar_writer", "arrays", suffix=".npz")
def write_arrays(recording: Recording, path: str | os.PathLike[str]) -> None:
    """Write a recording as NumPy arrays and a TOML file.

    Both have the same stem; reading restores the same recording.

    The ``.npz`` file holds ``baseband`` complex64 (pulses, range bins) in V, ``slow_time_s`` and ``range_m``; the TOML
    file holds the radar, the notes and the further facts. The truth about the targets is not stored.

    Parameters
    ----------
    recording : Recording
    path : path-like
        Path that ends in ``.npz``.

    Raises
    ------
    OutputError
        If the name does not end in ``.npz``, another kind of TOML file with this stem exists, or the files cannot be
        written; existing files then do not change.

    See Also
    --------
    read_recording : read the file again.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=3.0)
    >>> recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=640.0))
    >>> dg.radar.write_arrays(recording, "walk.npz")
    >>> dg.radar.read_recording("walk.npz").n_pulses
    1920
    """
    target = Path(path)
    if target.suffix.lower() != ".npz":
        raise OutputError(f"{target}: must end in .npz")
    sidecar = target.with_suffix(".toml")
    if sidecar.exists():
        try:
            with sidecar.open(encoding="utf-8", errors="replace") as text:
                first = text.readline().rstrip()
        except OSError as error:
            raise OutputError(f"{sidecar}: cannot be read: {error}") from None
        if first != FIRST_LINE:
            raise OutputError(
                f"{sidecar}: exists and is not a description of arrays; choose another name than {target.name}"
            )
    with open_atomically(sidecar) as partial_facts, open_atomically(target) as partial:
        facts: dict[str, Any] = {
            "scale_v": 1.0,
            "conjugate": False,
            "notes": list(recording.notes),
            "noise_power_v2": recording.noise_power_v2,
            "snr_frame_db": recording.snr_frame_db,
            "seed": recording.seed,
        }
        known = {name: value for name, value in facts.items() if value is not None and value == value}  # not NaN
        lines = [
            FIRST_LINE,
            *_format_lines(known),
            "",
            "[radar]",
            *_format_lines(recording.radar.model_dump(exclude_none=True)),
        ]
        if attributes := list_further_facts(recording.baseband):
            lines += ["", "[attributes]", *_format_lines(attributes)]
        partial_facts.write_text(("\n".join(lines) + "\n"), encoding="utf-8")
        with partial.open("wb") as file:
            np.savez(
                file,
                baseband=recording.baseband.values.astype("<c8"),
                slow_time_s=recording.slow_time_s,
                range_m=recording.range_m,
            )


def _format_lines(table: Mapping[str, Any]) -> list[str]:
    return [f"{_quote_text(key)} = {_format_value(value)}" for key, value in table.items()]


def _format_value(value: Any) -> str:
    """Return a value in TOML."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(_format_lines(value)) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_format_value(item) for item in value) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return str(float(value))
    return _quote_text(value) if isinstance(value, str) else json.dumps(value)


def _quote_text(text: str) -> str:
    """Quote a text in TOML.
    TOML has the escapes of JSON, except for one character.
    """
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
