"""Check built documentation without a network: every link inside leads somewhere, nothing is loaded from elsewhere.

python docs/check_links.py docs/_build/html              # exit status 1 and a list where something is wrong
python docs/check_links.py docs/_build/html --external   # also lists the links that lead outside, not followed
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LOADED = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src"}
"""Attributes that a browser fetches by itself, by element."""


class Page(HTMLParser):
    """Identifiers, links and loaded files of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: set[str] = set()
        self.loaded: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep what a start tag tells."""
        values = {name: value for name, value in attrs if value}
        self.ids |= {values[name] for name in ("id", "name") if name in values}
        if tag == "a" and "href" in values:
            self.links.add(values["href"])
        if tag in LOADED and LOADED[tag] in values and values.get("rel") != "canonical":
            self.loaded.add(values[LOADED[tag]])


def faults(folder: Path, pages: dict[Path, Page]) -> Iterator[str]:
    """Report faults, one line each."""
    for path, page in pages.items():
        shown = path.relative_to(folder)
        for link in sorted(page.links | page.loaded):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                if link in page.loaded and parts.scheme != "data":
                    yield f"{shown}: loads {link}"
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not target.exists():
                yield f"{shown}: {link}: no such file"
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].ids:
                yield f"{shown}: {link}: no such place in that page"


def check(folder: Path) -> tuple[list[str], dict[Path, Page]]:
    """Faults and pages of a built documentation."""
    folder = folder.resolve()
    pages = {path: Page(path.read_text()) for path in sorted(folder.rglob("*.html")) if "_static" not in path.parts}
    return list(faults(folder, pages)), pages


def main() -> None:
    """Take the arguments of the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("built", type=Path, help="folder that sphinx-build wrote")
    parser.add_argument("--external", action="store_true", help="list the links that lead outside")
    given = parser.parse_args()
    wrong, pages = check(given.built)
    links = {link for page in pages.values() for link in page.links}
    outside = sorted(link for link in links if urlsplit(link).scheme in ("http", "https"))
    if given.external:
        print("\n".join(outside))
    print(f"{len(pages)} pages, {sum(len(page.links) for page in pages.values())} links, {len(outside)} lead outside")
    if wrong or not pages:
        sys.exit("\n".join(wrong) or f"{given.built}: holds no pages")


if __name__ == "__main__":
    main()
