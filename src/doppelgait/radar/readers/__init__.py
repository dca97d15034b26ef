"""Radar recordings: one reader per format, picked by what the file holds, not by what it is called."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from doppelgait.core.errors import RecordingError
from doppelgait.radar.readers.hdf5_heap import check_hdf5
from doppelgait.radar.readers.registry import RECORDING_READERS, RecordingReader
from doppelgait.radar.recording import Recording

__all__ = ["RECORDING_READERS", "RecordingReader", "read_recording"]

for _name, _module, _sniff, _read, _suffixes in (
    ("doppelgait", "recordings", "sniff_hdf5", "read_hdf5", (".h5",)),
    ("xethru", "xethru", "sniff_xethru", "recording_from_xethru", ("folder", ".dat")),
    ("matlab-rf", "readers.matlab", "sniff_matlab", "read_matlab", (".mat",)),
    ("arrays", "readers.arrays", "sniff_arrays", "read_arrays", (".npz", ".npy")),
    ("acconeer", "readers.acconeer", "sniff_acconeer", "read_acconeer", (".h5",)),
    ("cw-text", "readers.cw_text", "sniff_cw_text", "read_cw_text", (".txt",)),
    ("sigmf", "readers.sigmf", "sniff_sigmf", "read_sigmf", (".sigmf-meta", ".sigmf-data")),
):
    _where = f"doppelgait.radar.{_module}"
    RECORDING_READERS.add(_name, RecordingReader(f"{_where}:{_sniff}", f"{_where}:{_read}", _suffixes))


SWITCHES = {"conjugate", "time_first", "ignore_checksum"}
"""Options that are true or false."""


def read_recording(path: str | os.PathLike[str], *, format: str | None = None, **options: Any) -> Recording:
    """Read a radar recording, simulated or measured.

    Parameters
    ----------
    path : path-like
        The file, or the folder of a XeThru recording; its format is found from its content.
    format : str, optional
        Name of the reader, for a file that none or several recognise.
    **options
        Options of that reader: what the file does not tell, for example ``carrier_hz`` or ``radar="PRESET"``.

    Returns
    -------
    Recording
        With the axes of the file. Measured recordings have no truth, an unknown noise level, and ``notes`` on what
        the file does not tell.

    Raises
    ------
    RecordingError
        If there is no such file, no reader or several take it, an option is not allowed, or it cannot be read right.
    """
    file = Path(path)
    if not file.name:  # "." has no name to look for the other files of a recording by
        file = file.resolve()
    if not file.name:
        raise RecordingError(f"{path}: is no recording; give a file, or the folder of a XeThru recording")
    try:
        if file.is_file():
            check_hdf5(file)
        name = _find_format(file) if format is None else _check_format(file, format)
        reader = RECORDING_READERS[name].reader()
        _check_options(file, name, reader, options)
        return reader(file, **options)
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read: {error.strerror or error}") from None


def _check_format(path: Path, name: str) -> str:
    if name not in RECORDING_READERS:
        raise RecordingError(f"{path}: format = {name!r} is not known; known are: {_known()}")
    if not path.exists() and not path.parent.is_dir():
        raise RecordingError(f"{path}: no such file")
    return name


def _find_format(path: Path) -> str:
    names = [name for name in RECORDING_READERS if RECORDING_READERS[name].matches(path)]
    if len(names) == 1:
        return names[0]
    if names:
        raise RecordingError(
            f"{path}: its content could be {' or '.join(names)}; it cannot be told which reader is right: name it, "
            f"format='{names[0]}'"
        )
    if not path.exists():
        raise RecordingError(f"{path}: no such file")
    if path.is_file() and not path.stat().st_size:
        raise RecordingError(f"{path}: is empty (0 bytes)")
    raise RecordingError(f"{path}: its content is no recording format that is read; these are: {_known()}")


def _known() -> str:
    return ", ".join(f"{name} ({', '.join(RECORDING_READERS[name].suffixes)})" for name in RECORDING_READERS)


def _check_options(path: Path, name: str, reader: Callable[..., Any], options: Mapping[str, Any]) -> None:
    allowed = [p.name for p in inspect.signature(reader).parameters.values() if p.kind is p.KEYWORD_ONLY]
    if unknown := sorted(set(options) - set(allowed)):
        said = f"allowed are {', '.join(allowed)}" if allowed else "it has none"
        raise RecordingError(f"{path}: the {name} reader has no option {', '.join(unknown)}; {said}")
    for switch in SWITCHES & set(options):
        if not isinstance(options[switch], bool):
            raise RecordingError(f"{path}: option {switch} = {options[switch]!r} is not allowed: must be true or false")
