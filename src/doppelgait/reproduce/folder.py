"""The output folder: it appears complete or not at all, and replaces nothing but an earlier one of its kind."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from doppelgait.core.errors import ConfigError, OutputError

FORMAT = "doppelgait-reproduction"
PAGE, READINGS = "index.html", "readings.json"


def check_out(out: Path) -> None:
    """Refuse, before any work is done, a place that cannot become the output folder or holds something else.

    Raises
    ------
    ConfigError
        If the folder above does not exist, ``out`` is a file, or it holds anything that is not of an earlier run.
    """
    if not out.resolve().parent.is_dir():
        raise ConfigError(f"{out}: the folder {out.resolve().parent} does not exist; make it first")
    if out.exists() and not out.is_dir():
        raise ConfigError(f"{out}: is a file; give a folder that does not exist yet")
    foreign = _foreign(out)
    if foreign:
        raise ConfigError(
            f"{out}: holds {foreign[0]}{' and more' if len(foreign) > 1 else ''}, which no run of reproduce wrote; "
            "give another folder"
        )


def _foreign(out: Path) -> list[str]:
    """Files of a folder that are not those that its ``readings.json`` lists."""
    present = [path.relative_to(out).as_posix() for path in out.rglob("*") if not path.is_dir()] if out.exists() else []
    try:
        document = json.loads((out / READINGS).read_text(encoding="utf-8"))
        ours = {PAGE, READINGS, *document["files"]} if document["format"] == FORMAT else set()
    except (OSError, ValueError, KeyError, TypeError):
        ours = set()
    return sorted(set(present) - ours)


@contextmanager
def complete_folder(out: Path) -> Iterator[Path]:
    """Folder to write to; it takes the name ``out`` when the block ends well and is removed if not.

    Raises
    ------
    OutputError
        If a folder or file cannot be written; an earlier ``out`` is then as it was.
    """
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
