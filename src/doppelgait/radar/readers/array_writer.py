"""A recording as plain arrays: an .npz file and a TOML file beside it."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from doppelgait.core.errors import OutputError
from doppelgait.core.files import atomic_path
from doppelgait.radar.recording import Recording, further_facts

FIRST_LINE = "# Radar recording, written by doppelgait: what the arrays beside it are."


def write_arrays(recording: Recording, path: str | os.PathLike[str]) -> None:
    """Write a recording as NumPy arrays and a TOML file of the same stem; reading gives the same back.

    The ``.npz`` file holds ``baseband`` complex64 (pulses, range bins) in V, ``slow_time_s`` and ``range_m``; the TOML
    file holds the radar, the notes and the further facts. The truth about the targets is not stored.

    Parameters
    ----------
    recording : Recording
    path : path-like
        Ends in ``.npz``.

    Raises
    ------
    OutputError
        If the name does not end in ``.npz``, a TOML file of that stem is there that is not of this kind, or it cannot
        be written; older files are then untouched.
    """
    target = Path(path)
    if target.suffix.lower() != ".npz":
        raise OutputError(f"{target}: must end in .npz")
    sidecar = target.with_suffix(".toml")
    if sidecar.exists() and not _is_ours(sidecar):
        raise OutputError(
            f"{sidecar}: is there and is no description of arrays; choose another name than {target.name}"
        )
    with atomic_path(sidecar) as partial_facts, atomic_path(target) as partial:
        partial_facts.write_text(_as_toml(recording), encoding="utf-8")
        with partial.open("wb") as file:
            np.savez(
                file,
                baseband=recording.baseband.values.astype("<c8"),
                slow_time_s=recording.slow_time_s,
                range_m=recording.range_m,
            )


def _is_ours(path: Path) -> bool:
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            return file.readline().rstrip() == FIRST_LINE
    except OSError as error:
        raise OutputError(f"{path}: cannot be read: {error}") from None


def _as_toml(recording: Recording) -> str:
    facts: dict[str, Any] = {
        "scale_v": 1.0,
        "conjugate": False,
        "notes": list(recording.notes),
        "noise_power_v2": recording.noise_power_v2,
        "snr_frame_db": recording.snr_frame_db,
        "seed": recording.seed,
    }
    known = {name: value for name, value in facts.items() if value is not None and value == value}  # not NaN
    lines = [FIRST_LINE, *_lines(known), "", "[radar]", *_lines(recording.radar.model_dump(exclude_none=True))]
    if attributes := further_facts(recording.baseband):
        lines += ["", "[attributes]", *_lines(attributes)]
    return "\n".join(lines) + "\n"


def _lines(table: Mapping[str, Any]) -> list[str]:
    return [f"{_text(key)} = {_value(value)}" for key, value in table.items()]


def _value(value: Any) -> str:
    """A value in TOML."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(_lines(value)) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return str(float(value))
    return _text(value) if isinstance(value, str) else json.dumps(value)


def _text(text: str) -> str:
    """A quoted TOML text; JSON's escapes are TOML's but for one character."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
