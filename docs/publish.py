"""Put a built documentation beside the ones of earlier versions.

    DOPPELGAIT_DOCS_VERSIONS=1 sphinx-build -W --keep-going -b html docs docs/_build/html
    python docs/publish.py docs/_build/html SITE --base /doppelgait/

SITE is the folder that a web server shows under ``--base``. It gets VERSION/, versions.json, which the switcher in the
header of every version reads, and an index.html that leads to the newest release. A version that is there is replaced.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
from pathlib import Path

import doppelgait

FORWARD = (
    '<!doctype html><meta charset="utf-8"><title>doppelgait</title><meta http-equiv="refresh" content="0; url={}/">'
)


def publish(built: Path, site: Path, *, version: str, base: str) -> list[dict[str, object]]:
    """Copy ``built`` to ``site/version`` and write the list of versions; the list comes last.

    Raises
    ------
    SystemExit
        If ``built`` holds no documentation.
    """
    if not (built / "index.html").is_file():
        raise SystemExit(f"{built}: holds no index.html; build the documentation first")
    partial = site / f".{version}.partial"
    shutil.rmtree(partial, ignore_errors=True)
    shutil.copytree(built, partial)
    shutil.rmtree(site / version, ignore_errors=True)
    partial.rename(site / version)
    known = sorted((path.parent.name for path in site.glob("*/index.html")), key=_order, reverse=True)
    newest = next((name for name in known if name.replace(".", "").isdigit()), known[0])
    versions: list[dict[str, object]] = [
        {"version": name, "url": f"{base.rstrip('/')}/{name}/", "preferred": name == newest} for name in known
    ]
    _replace(site / "index.html", FORWARD.format(newest))
    _replace(site / "versions.json", json.dumps(versions, indent=2) + "\n")
    return versions


def _order(version: str) -> tuple[tuple[int, int | str], ...]:
    return tuple((1, int(part)) if part.isdigit() else (0, part) for part in version.split("."))


def _replace(path: Path, text: str) -> None:
    partial = path.with_name(f".{path.name}.partial")
    partial.write_text(text)
    os.replace(partial, path)


def main() -> None:
    """Take the arguments of the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("built", type=Path, help="folder that sphinx-build wrote")
    parser.add_argument("site", type=Path, help="folder of all versions")
    parser.add_argument("--base", default="/", help="path of the site on its host")
    given = parser.parse_args()
    given.site.mkdir(parents=True, exist_ok=True)
    for entry in publish(given.built, given.site, version=doppelgait.__version__, base=given.base):
        print(entry["version"], "(newest)" if entry["preferred"] else "")


if __name__ == "__main__":
    main()
