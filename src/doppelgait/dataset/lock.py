"""Lock of a dataset's folder, and folders that appear complete."""

from __future__ import annotations

import ctypes
import glob
import json
import os
import platform
import shutil
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import NamedTuple

from pydantic import Field

from doppelgait.core.config import FrozenModel
from doppelgait.core.documents import parse_json, read_document
from doppelgait.core.errors import ConfigError, DatasetError, OutputError

PATTERN = "build*.lock"
WRITING_SECONDS = 2.0
"""Time, s, that a lock may stay empty between its creation and its first write."""
_held: set[Path] = set()


class Part(NamedTuple):
    """The ``number``-th of ``among`` parts of shards, from 1."""

    number: int
    among: int

    @classmethod
    def parse(cls, text: str) -> Part:
        """Parse a part like ``3/16``."""
        number, _, among = text.partition("/")
        if not (number.isdecimal() and among.isdecimal() and 1 <= int(number) <= int(among)):
            raise ConfigError(
                f"part {text!r}: is not allowed; must be I/N, the number of the part from 1 to N, for example 3/16"
            )
        return cls(int(number), int(among))


class Holder(FrozenModel):
    """Holder of a lock."""

    path: Path
    pid: int = Field(gt=0, lt=1 << 31)
    host: str
    since: str
    part: tuple[int, int] | None
    begun: str

    @property
    def alive(self) -> bool:
        """False if the process has certainly ended, on this host."""
        if self.host != platform.node():
            return True
        if self.pid == os.getpid():
            return self.path in _held
        return _is_running(self.pid) and _read_process_start(self.pid) in ("", self.begun)

    def __str__(self) -> str:
        of = "" if self.part is None else f" (part {self.part[0]}/{self.part[1]})"
        return f"process {self.pid} on {self.host}{of}, since {self.since}"


@contextmanager
def build_lock(directory: Path, part: Part | None = None) -> Iterator[None]:
    """Lock the folder, or part of it, for the block."""
    name = "build.lock" if part is None else f"build-{part.number}-of-{part.among}.lock"
    path = directory.resolve() / name
    _refuse_links(directory)
    since, pid = datetime.now(UTC).isoformat(timespec="seconds"), os.getpid()
    own = {"pid": pid, "host": platform.node(), "since": since, "part": part, "begun": _read_process_start(pid)}
    while True:
        try:
            handle = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644)
            break
        except FileExistsError:
            holder = read_lock(path)
            if holder is not None and holder.alive:
                raise _make_busy_error(path.parent, holder) from None
            path.unlink(missing_ok=True)
    try:
        os.write(handle, json.dumps(own).encode())
    except OSError:
        path.unlink(missing_ok=True)
        raise
    finally:
        os.close(handle)
    _held.add(path)
    try:
        for other in list_running_builds(directory):
            mine = other.path == path and other.pid == os.getpid()
            side_by_side = part is not None and other.part is not None and part.among == other.part[1]
            if not mine and not side_by_side:
                raise _make_busy_error(directory, other)
        yield
    finally:
        _held.discard(path)
        path.unlink(missing_ok=True)


def _refuse_links(directory: Path) -> None:
    # a build writes and deletes in its folder only
    for inner in directory.iterdir():
        with suppress(FileNotFoundError):  # of a part that runs at the same time
            mode, folder = inner.lstat().st_mode, not any(map(inner.match, ("*.partial", PATTERN)))
            if not stat.S_ISREG(mode) and not (folder and stat.S_ISDIR(mode)):
                raise DatasetError(f"{inner}: is a link or no file; delete it, or copy its target here")


def list_running_builds(directory: Path) -> list[Holder]:
    """List active builds in a folder, from their locks."""
    holders = map(read_lock, sorted(directory.glob(PATTERN)))
    return [holder for holder in holders if holder is not None and holder.alive]


def read_lock(path: Path) -> Holder | None:
    """Read the holder of a lock, None if gone or incomplete."""
    end = time.monotonic() + WRITING_SECONDS
    while True:
        try:
            return Holder.model_validate({**parse_json(read_document(path)), "path": path.parent.resolve() / path.name})
        except OSError:  # gone, or no file
            return None
        except (ValueError, TypeError, ConfigError):
            if time.monotonic() > end:
                return None
            time.sleep(0.05)


_numbers = count()


@contextmanager
def write_new_folder(target: Path, noun: str) -> Iterator[Path]:
    """Write a folder that gets its name when complete."""
    start = f"{target.name}.{platform.node()}-"
    for leftover in target.parent.glob(f"{glob.escape(start)}*.partial"):
        pid = leftover.name.removeprefix(start).partition("-")[0]
        if pid.isdecimal() and not _is_running(int(pid)):
            shutil.rmtree(leftover, ignore_errors=True)
    partial = target.with_name(f"{start}{os.getpid()}-{next(_numbers)}.partial")
    try:
        partial.mkdir(parents=True)
        yield partial
        with suppress(OSError):
            target.rmdir()  # an empty one
        if target.exists():
            raise DatasetError(f"{target}: another process has written to it meanwhile; nothing in it was changed")
        partial.rename(target)
    except (OSError, OutputError) as error:
        cause = error.__context__ if isinstance(error, OutputError) else error  # the writer has already named its file
        words = " ".join(str(cause).split())
        raise OutputError(f"{target}: cannot be written: {words}; no partial {noun} remains") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _make_busy_error(directory: Path, holder: Holder) -> DatasetError:
    hint = "" if holder.host == platform.node() else f"; if that process has ended, delete {holder.path}"
    return DatasetError(f"{directory}: is being built by {holder}; wait for it or stop it{hint}")


def _is_running(pid: int) -> bool:
    if os.name == "nt":
        kernel = ctypes.windll.kernel32  # type: ignore[attr-defined,unused-ignore]
        process = kernel.OpenProcess(0x00100000, False, pid)  # the right to wait for it
        gone = not process or kernel.WaitForSingleObject(process, 0) == 0
        if process:
            kernel.CloseHandle(process)
        return not gone
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True


def _read_process_start(pid: int) -> str:
    """Return the start of a process in clock ticks, or ""."""
    with suppress(OSError):
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return "ended" if fields[0] == "Z" else fields[19]
    return ""
