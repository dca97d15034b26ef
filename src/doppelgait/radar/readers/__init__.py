"""Radar recordings: readers selected by content, and writers.

A reader is a function ``(path, **options) -> Recording`` under ``plugin("radar_reader", ...)``, with the protocol of
:mod:`doppelgait.core.readers`. A writer is a function ``(recording, path, **options)``, registered by
``plugin("radar_writer", NAME, suffix=...)``; the suffix picks it, "" stands for a folder.
"""

from __future__ import annotations

import dataclasses
import os
import warnings
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from doppelgait.core.config import read_toml
from doppelgait.core.errors import DoppelgaitWarning, RecordingError, explain_memory
from doppelgait.core.files import list_files
from doppelgait.core.own_hdf5 import FAULTS, open_hdf5
from doppelgait.core.plugins import Group, Plugin
from doppelgait.core.readers import OtherFile, check_reader, choose_reader, find_readers, list_options, read_other_files
from doppelgait.radar.recording import Recording, check_plausible

__all__ = [
    "RADAR_READERS",
    "RADAR_WRITERS",
    "find_formats",
    "find_recordings",
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
        "doppelgait.radar.readers.samples",
        "doppelgait.radar.readers.acconeer",
        "doppelgait.radar.readers.text",
        "doppelgait.radar.readers.sigmf",
        "doppelgait.radar.readers.dca1000",
        "doppelgait.radar.frames",
    ),
    check=check_reader,
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


def _describe_hdf5(path: Path) -> str:
    try:
        with open_hdf5(path) as file:
            if file.attrs.get("format") == "doppelgait-result":
                return "it holds results of doppelgait analyze, not a recording; pass the recording that was analysed"
            held: list[str] = []
            file.visititems(lambda name, node: held.append(f"{name} {node.shape}") if hasattr(node, "shape") else None)
    except FAULTS as error:
        return f"it cannot be opened: {error}"
    listed = ", ".join(held[:12]) + (", ..." if len(held) > 12 else "")
    return f"it holds {listed or 'no arrays'}; save the complex matrix (pulses, range bins) with numpy.savez"


@cache
def list_other_files() -> tuple[OtherFile, ...]:
    """Return the files that are no recordings of a radar, but that people have."""
    return read_other_files(read_toml(Path(__file__).with_name("names.toml"))[0]["others"], hdf5=_describe_hdf5)


@explain_memory
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
    >>> recording = dg.data.sample()
    >>> dg.radar.write_recording(recording, "walk.h5")
    >>> dg.radar.write_arrays(recording, "walk.npz")
    >>> dg.radar.write_sigmf(recording, "walk.sigmf-data")
    >>> [dg.radar.read_recording(f"walk.{suffix}").n_pulses for suffix in ("h5", "npz", "sigmf-data")]
    [4000, 4000, 4000]
    """
    file = Path(path)
    if not file.name:  # "." has no name for finding the other files of a recording
        file = file.resolve()
    if not file.name:
        raise RecordingError(f"{path}: is not a recording; pass a file, or the folder of a XeThru recording")
    reader = choose_reader(
        RADAR_READERS, file, options, noun="recording", error=RecordingError, others=list_other_files(), format=format
    )
    try:
        recording = reader.run(file, **options)
        check_plausible(recording, str(file))
        return recording
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read: {error.strerror or error}") from None


TABLES = (".txt", ".csv", ".tsv")
"""Suffixes of files in a folder that are recordings only if their content is one."""


def find_formats(path: Path, *, by_name: bool = True) -> list[str]:
    """Return the readers that recognise a file or folder."""
    try:
        return find_readers(RADAR_READERS, path, by_name=by_name)
    except OSError:  # a file that cannot be opened has no format
        return []


def find_recordings(paths: Iterable[Path]) -> Iterator[tuple[Path, bool]]:
    """Yield recordings of files and folders once, sorted, with True for a named path."""
    endings = {s for reader in RADAR_READERS.values() for s in reader.facts["suffixes"] if s.startswith(".")}
    suffixes = tuple(endings.difference(TABLES))
    seen: set[Path] = set()

    def walk(path: Path, named: bool) -> Iterator[tuple[Path, bool]]:
        if not named and path.is_dir() and path.is_symlink():
            return  # it may lead back
        if path.is_dir() and not find_formats(path):  # one XeThru recording has one
            for entry in sorted(path.iterdir()):
                yield from walk(entry, False)
            return
        taken = find_formats(path, by_name=not path.name.endswith(TABLES)) or path.name.endswith(suffixes)
        if not named and not taken:
            return
        whole = path
        for part, other in (("_IM.txt", "_RE.txt"), (".sigmf-meta", ".sigmf-data")):  # one recording in two files
            if path.name.endswith(part) and (partner := path.with_name(path.name.removesuffix(part) + other)).is_file():
                whole = partner
        if whole not in seen:
            seen.add(whole)
            yield whole, named

    for path in paths:
        if path.is_dir():
            list_files(path)  # no whole disk
        yield from walk(path, True)


def read_several(paths: Iterable[Path], **options: Any) -> tuple[list[Recording], list[str]]:
    """Read all recordings of files and folders; also return why other files are left out."""
    paths, found, left_out, taken = list(paths), [], [], {"radar"}
    try:
        for path, named in find_recordings(paths):
            readers = [RADAR_READERS[name] for name in find_formats(path)]
            allowed = {name for reader in readers for name in list_options(reader.run)}
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


def list_writers() -> dict[str, Plugin[Writer]]:
    """Return the writers by suffix; "" for a folder."""
    return {one.facts["suffix"]: one for one in RADAR_WRITERS.values()}
