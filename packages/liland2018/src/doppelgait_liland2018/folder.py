"""Output folder that is complete under its name, or absent."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from doppelgait import ConfigError, DoppelgaitError

PAGE = "index.html"


class OutputError(DoppelgaitError):
    """Folder that cannot be written."""

    exit_code = 1


def check_out(out: Path, *, listing: str, file_format: str) -> None:
    """Refuse a path that cannot become the output folder."""
    if not out.resolve().parent.is_dir():
        raise ConfigError(f"{out}: the folder {out.resolve().parent} does not exist; make it first")
    if out.exists() and not out.is_dir():
        raise ConfigError(f"{out}: is a file; give a folder that does not exist yet")
    present = [path.relative_to(out).as_posix() for path in out.rglob("*") if not path.is_dir()] if out.exists() else []
    try:
        document = json.loads((out / listing).read_text(encoding="utf-8"))
        ours = {PAGE, listing, *document["files"]} if document["format"] == file_format else set()
    except (OSError, ValueError, KeyError, TypeError):
        ours = set()
    foreign = sorted(set(present) - ours)
    if foreign:
        raise ConfigError(
            f"{out}: holds {foreign[0]}{' and more' if len(foreign) > 1 else ''}, which no run of "
            "reproduce wrote; give another folder"
        )


@contextmanager
def complete_folder(out: Path) -> Iterator[Path]:
    """Write a folder atomically: complete under its name, or absent."""
    out = out.resolve()
    partial = out.with_name(f".{out.name}.partial-{os.getpid()}")
    before = out.with_name(f".{out.name}.before-{os.getpid()}")
    try:
        partial.mkdir()
        yield partial
        if out.exists():
            out.rename(before)
        try:
            partial.rename(out)
        except OSError:
            if before.exists():
                before.rename(out)
            raise
    except OSError as error:
        raise OutputError(f"{out}: cannot be written: {error}") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        if out.exists():
            shutil.rmtree(before, ignore_errors=True)
