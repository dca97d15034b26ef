"""Radar recordings: readers selected by content, and writers.

A reader is a function ``(path, **options) -> Recording`` with keyword-only options, registered by
``plugin("radar_reader", NAME, sniff=..., suffixes=(...))``; ``sniff(path) -> bool`` is cheap, looks at the content and
is called for every path, also for one that does not exist. A writer is a function ``(recording, path, **options)``,
registered by ``plugin("radar_writer", NAME, suffix=...)``; the suffix picks it, "" stands for a folder. A reader of
files that may hold several recordings also has ``parts(path) -> list of options``, one entry per recording.
"""

from __future__ import annotations

import dataclasses
import inspect
import os
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from doppelgait.core.errors import DoppelgaitWarning, RecordingError
from doppelgait.core.own_hdf5 import read_stated_format
from doppelgait.core.plugins import Group, Plugin
from doppelgait.radar.recording import Recording, check_plausible

__all__ = [
    "RADAR_READERS",
    "RADAR_WRITERS",
    "find_formats",
    "find_recordings",
    "is_folder_of_recordings",
    "list_writers",
    "read_recording",
    "read_several",
]

Reader = Callable[..., Recording]
Writer = Callable[..., Any]

RADAR_READERS: Group[Reader] = Group(
    "radar_reader",
    built_in=(
        "doppelgait.radar.recordings",
        "doppelgait.radar.xethru.convert",
        "doppelgait.radar.readers.matlab",
        "doppelgait.radar.readers.arrays",
        "doppelgait.radar.readers.acconeer",
        "doppelgait.radar.readers.cw_text",
        "doppelgait.radar.readers.sigmf",
        "doppelgait.radar.readers.glasgow",
        "doppelgait.radar.readers.dca1000",
        "doppelgait.radar.frames",
    ),
)
"""Readers of radar recordings by name."""

RADAR_WRITERS: Group[Writer] = Group(
    "radar_writer",
    built_in=(
        "doppelgait.radar.recordings",
        "doppelgait.radar.xethru.writer",
        "doppelgait.radar.readers.arrays",
        "doppelgait.radar.readers.sigmf",
        "doppelgait.radar.frames",
    ),
)
"""Writers of radar recordings by name."""

SWITCHES = {"conjugate", "time_first", "ignore_checksum"}
"""Boolean options."""


def read_recording(path: str | os.PathLike[str], *, format: str | None = None, **options: Any) -> Recording:
    """Read a radar recording, simulated or measured.

    Parameters
    ----------
    path : path-like
        The file, or the folder of a XeThru recording; its format is found from its content.
    format : str, optional
        Name of the reader, for a file that none or several recognise.
    **options
        Options of the reader for values that the file does not state, for example ``carrier_hz`` or ``radar="PRESET"``.

    Returns
    -------
    Recording
        Recording with the axes of the file. Measured recordings have no truth, an unknown noise
        level, and ``notes`` on values that the file does not state.

    Raises
    ------
    RecordingError
        If the file does not exist, none or several readers recognise it, an option is not allowed,
        or the content is not valid.

    See Also
    --------
    write_recording : write a recording.
    open_stream : read frames as they arrive.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=3.0)
    >>> recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=640.0))
    >>> dg.radar.write_recording(recording, "walk.h5")
    >>> dg.radar.read_recording("walk.h5").n_pulses
    1920
    """
    file = Path(path)
    if not file.name:  # "." has no name for finding the other files of a recording
        file = file.resolve()
    if not file.name:
        raise RecordingError(f"{path}: is not a recording; pass a file, or the folder of a XeThru recording")
    try:
        if format is None:
            name = _find_format(file)
        elif format not in RADAR_READERS:
            raise RecordingError(f"{file}: format = {format!r} is not known; known are: {_list_known()}")
        elif not file.exists() and not file.parent.is_dir():
            raise RecordingError(f"{file}: no such file")
        else:
            name = format
        reader = RADAR_READERS[name].run
        allowed = [p.name for p in inspect.signature(reader).parameters.values() if p.kind is p.KEYWORD_ONLY]
        if unknown := sorted(set(options) - set(allowed)):
            said = f"allowed are {', '.join(allowed)}" if allowed else "it has none"
            raise RecordingError(f"{file}: the {name} reader has no option {', '.join(unknown)}; {said}")
        for switch in SWITCHES & set(options):
            if not isinstance(options[switch], bool):
                raise RecordingError(
                    f"{file}: option {switch} = {options[switch]!r} is not allowed: must be true or false"
                )
        recording = reader(file, **options)
        check_plausible(recording, str(file))
        return recording
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read: {error.strerror or error}") from None


def find_formats(path: Path) -> list[str]:
    """Return the readers that recognise a file or folder."""
    names = []
    for reader in RADAR_READERS.values():
        with suppress(OSError):  # a file that cannot be opened has no format
            if reader.facts["sniff"](path):
                names.append(reader.name)
    return names


def _find_format(path: Path) -> str:
    names = find_formats(path)
    if len(names) == 1:
        return names[0]
    if names:
        raise RecordingError(
            f"{path}: its content could be {' or '.join(names)}; the reader is ambiguous: name it, format='{names[0]}'"
        )
    if not path.exists():
        raise RecordingError(f"{path}: no such file")
    if path.is_file() and not path.stat().st_size:
        raise RecordingError(f"{path}: is empty (0 bytes)")
    if read_stated_format(path) == "doppelgait-result":
        raise RecordingError(
            f"{path}: holds results of doppelgait analyze, not a recording; pass the recording that was analysed"
        )
    raise RecordingError(f"{path}: its content has no known recording format; known are: {_list_known()}")


def is_folder_of_recordings(path: Path) -> bool:
    """Return whether a path is a folder of recordings; that of one XeThru recording is not."""
    return path.is_dir() and not find_formats(path)


def find_recordings(paths: Iterable[Path]) -> Iterator[tuple[Path, bool]]:
    """Yield the recordings of files and folders, each once.

    They are in the order of their names, with True for a named path and False for a file found in a
    folder. In folders, files without the suffix of a recording are skipped.
    """
    suffixes = tuple(s for one in RADAR_READERS.values() for s in one.facts["suffixes"] if s.startswith("."))
    seen: set[Path] = set()

    def walk(path: Path, named: bool) -> Iterator[tuple[Path, bool]]:
        if is_folder_of_recordings(path):
            for entry in sorted(path.iterdir()):
                yield from walk(entry, False)
            return
        if not named and not (find_formats(path) or (path.name.endswith(suffixes) and not path.name.endswith(".txt"))):
            return
        whole = path
        for part, other in (("_IM.txt", "_RE.txt"), (".sigmf-meta", ".sigmf-data")):  # one recording in two files
            if path.name.endswith(part) and (partner := path.with_name(path.name.removesuffix(part) + other)).is_file():
                whole = partner
        if whole not in seen:
            seen.add(whole)
            yield whole, named

    for path in paths:
        yield from walk(path, True)


def read_several(paths: Iterable[Path], **options: Any) -> tuple[list[Recording], list[str]]:
    """Read the recordings of files and folders.

    All recordings of a file are read, unless the options select one.

    Parameters
    ----------
    paths : iterable of Path
        Files, and folders that are searched with their subfolders.
    **options
        Options of readers; each reader gets the options that it has.

    Returns
    -------
    found : list of Recording
    left_out : list of str
        Reasons why other files in folders cannot be read.

    Raises
    ------
    RecordingError
        If a named file cannot be read, a folder cannot be listed, no recording remains, or no
        reader has one of the options (except ``radar``).
    """
    paths, found, left_out, taken = list(paths), [], [], {"radar"}
    try:
        for path, named in find_recordings(paths):
            readers = [RADAR_READERS[name] for name in find_formats(path)]
            allowed = {name for reader in readers for name in inspect.signature(reader.run).parameters}
            taken |= allowed
            chosen = {name: value for name, value in options.items() if name in allowed}
            parts = readers[0].facts["parts"](path) if len(readers) == 1 and "parts" in readers[0].facts else []
            if len(parts) < 2 or set(parts[0]) & set(chosen):
                parts = [{}]
            for part in parts:
                try:
                    with warnings.catch_warnings():
                        warnings.simplefilter("ignore", DoppelgaitWarning)  # clipping is found in the values
                        recording = read_recording(path, **chosen, **part)
                except RecordingError as error:
                    if named:
                        raise
                    left_out.append(str(error))
                    continue
                if part:
                    said = ", ".join(f"{name}={value}" for name, value in part.items())
                    recording = dataclasses.replace(recording, source=f"{recording.source} ({said})")
                found.append(recording)
    except OSError as error:
        raise RecordingError(f"{error.filename}: cannot be read: {error.strerror or error}") from None
    if not found:
        raise RecordingError("no recording can be read: " + ("; ".join(left_out) or ", ".join(map(str, paths))))
    if unknown := sorted(set(options) - taken):
        raise RecordingError(
            f"no reader of these files has the option {', '.join(unknown)}; see doppelgait radar formats"
        )
    return found, left_out


def _list_known() -> str:
    return ", ".join(f"{one.name} ({', '.join(one.facts['suffixes'])})" for one in RADAR_READERS.values())


def list_writers() -> dict[str, Plugin[Writer]]:
    """Return the writers by suffix; "" for a folder."""
    return {one.facts["suffix"]: one for one in RADAR_WRITERS.values()}
