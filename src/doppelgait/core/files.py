"""The files of doppelgait: atomic writing, stated format and version, hashes."""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import count
from operator import index
from pathlib import Path
from typing import Any

from doppelgait.core.documents import parse_json, read_document, stat_regular
from doppelgait.core.errors import ConfigError, DoppelgaitError, OutputError
from doppelgait.core.own_hdf5 import FAULTS, open_hdf5

PAGE = "index.html"
MAX_ENTRIES = 250_000  # maximum number of files and folders in a folder of input
_NUMBERS = count()


@contextmanager
def open_atomically(path: str | os.PathLike[str], *, os_errors: bool = False) -> Iterator[Path]:
    """Write a file atomically: complete under its name after the block, or absent."""
    target = Path(path) if os_errors else check_target(path)
    partial = target.with_name(f"{target.name}.{platform.node()}-{os.getpid()}-{next(_NUMBERS)}.partial")
    try:
        partial.unlink(missing_ok=True)  # of a process that had the same number, or a link
        partial.touch(exist_ok=False)
        yield partial
        with partial.open("rb+") as handle:
            os.fsync(handle.fileno())
        os.replace(partial, target)
    except OSError as error:
        if os_errors:
            raise
        reason = os.strerror(error.errno) if error.errno else error  # HDF5's own message has several lines
        raise OutputError(f"{target}: cannot be written: {reason}") from None
    finally:
        with suppress(OSError):
            partial.unlink()


def check_target(path: str | os.PathLike[str]) -> Path:
    """Check that a file can be made under this name, before long work for it."""
    target = Path(path)
    if not target.name:
        raise OutputError(f"path = {str(path)!r} names no file; give one, for example 'walk.h5'")
    if not target.parent.is_dir():
        raise OutputError(f"{target}: cannot be written: no such folder {target.parent}")
    if target.exists() and not target.is_file():
        raise OutputError(f"{target}: cannot be written: it is a folder or a device")
    return target


def write_atomically(path: Path, content: bytes) -> None:
    """Write a small file atomically; after an ``OSError`` an existing file is unchanged."""
    with open_atomically(path, os_errors=True) as partial:
        partial.write_bytes(content)


@dataclass(frozen=True)
class FileKind:
    """Kind of file: format, newest and oldest version that are read, remedy for others."""

    format: str
    version: int
    noun: str
    error: type[DoppelgaitError]
    oldest: int = 1
    remedy: str = ""

    def check_version(self, path: str | os.PathLike[str], version: int) -> None:
        """Refuse a version that this program does not read."""
        if self.oldest <= version <= self.version:
            return
        end = "; install the newer doppelgait" if version > self.version else self.tell_remedy(path)
        read = " to ".join(map(str, sorted({self.oldest, self.version})))
        raise self.error(f"{path}: is {self.noun} in format version {version}; this one reads {read}{end}")

    def tell_remedy(self, path: str | os.PathLike[str]) -> str:
        """Return the end of a message that says what to do."""
        return f"; {self.remedy.format(name=Path(path).name)}" if self.remedy else ""

    def check(self, path: str | os.PathLike[str], stated: Mapping[str, Any]) -> None:
        """Refuse another format or version than the file states."""
        found = stated.get("format") if isinstance(stated, Mapping) else stated
        if found != self.format:
            raise ValueError(f"it states the format {found!r}, must be {self.format!r}")
        self.check_version(path, index(stated["format_version"]))


@contextmanager
def create_hdf5(path: str | os.PathLike[str], kind: FileKind) -> Iterator[Any]:
    """Write an HDF5 file of a kind atomically."""
    import h5py

    with open_atomically(path) as partial, h5py.File(partial, "w", track_order=True) as file:
        file.attrs.update(format=kind.format, format_version=kind.version)
        yield file


@contextmanager
def open_own_hdf5(path: str | os.PathLike[str], kind: FileKind) -> Iterator[Any]:
    """Open an HDF5 file of a kind; faults inside the block are errors of the file."""
    try:
        if not Path(path).exists():
            raise kind.error(f"{path}: no such file")
        with open_hdf5(Path(path)) as file:
            kind.check(path, file.attrs)
            yield file
    except (*FAULTS, DoppelgaitError) as error:
        if str(error).startswith(f"{path}: "):
            raise
        if isinstance(error, OSError) and error.errno:  # HDF5's own errors have no number
            raise kind.error(f"{path}: cannot be read: {error.strerror}") from None
        raise kind.error(f"{path}: is damaged or not {kind.noun}: {error}{kind.tell_remedy(path)}") from None


def hash_file(path: Path) -> str:
    """Compute the hexadecimal SHA-256 of a file."""
    stat_regular(path)
    with path.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def list_files(root: Path, pattern: str = "*") -> list[Path]:
    """List the regular files below a folder; no whole disk, and no link to a folder."""
    count, whole = 0, root.resolve() == Path(root.resolve().anchor)
    for _, folders, files in os.walk(root):
        count += len(folders) + len(files)
        if whole or count > MAX_ENTRIES:
            raise ConfigError(f"{root}: is a disk or has over {MAX_ENTRIES:,} files; name a folder of it")
    try:
        if ".." in pattern:
            raise ValueError("it leads out of the folder")
        return sorted(path for path in root.rglob(pattern) if path.is_file())
    except (OSError, ValueError, NotImplementedError) as error:
        raise ConfigError(f"{root}: the pattern {pattern!r} is not allowed: {error}") from None


def check_out(out: Path, *, listing: str, file_format: str, command: str) -> None:
    """Refuse a path that cannot become the output folder, before any work is done."""
    if not out.resolve().parent.is_dir():
        raise ConfigError(f"{out}: the folder {out.resolve().parent} does not exist; make it first")
    if out.is_symlink() or (out.exists() and not out.is_dir()):
        raise ConfigError(f"{out}: is a file or a link; give a folder that does not exist yet")
    present = [path.relative_to(out).as_posix() for path in out.rglob("*") if not path.is_dir()] if out.exists() else []
    try:
        document = parse_json(read_document(out / listing))
        ours = {PAGE, listing, *document["files"]} if document["format"] == file_format else set()
    except (OSError, ValueError, KeyError, TypeError):
        ours = set()
    foreign = sorted(set(present) - ours)
    if foreign:
        raise ConfigError(
            f"{out}: holds {foreign[0]}{' and more' if len(foreign) > 1 else ''}, which no run of "
            f"{command} wrote; give another folder"
        )


@contextmanager
def complete_folder(out: Path) -> Iterator[Path]:
    """Write a folder atomically: complete under its name after the block, or absent."""
    out = out.resolve()
    partial = out.with_name(f".{out.name}.partial-{os.getpid()}")
    before = out.with_name(f".{out.name}.before-{os.getpid()}")
    try:
        partial.mkdir()
        yield partial
        if out.exists():
            out.rename(before)
        partial.rename(out)
    except OSError as error:
        raise OutputError(f"{out}: cannot be written: {error}") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        if before.exists() and not out.exists():
            before.rename(out)
        shutil.rmtree(before, ignore_errors=True)
