"""HTML pages of reports: tables, figures and the frame of a page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

STYLE = """body { font-family: sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
table { border-collapse: collapse; margin: 1rem 0; } th, td { padding: .25rem .7rem; text-align: right; }
th { border-bottom: 1px solid #888; } td:first-child, th:first-child { text-align: left; }
tr.baseline { color: #777; } img { max-width: 100%; } figure { margin: 1.5rem 0; } figcaption { color: #444; }
pre { background: #f4f4f4; padding: 1rem; overflow-x: auto; } .note { color: #a00; }"""


def format_page(title: str, parts: Sequence[str], *, style: str = STYLE) -> str:
    """Format a page of parts that are HTML."""
    head = f"<meta charset='utf-8'><title>{escape(title)}</title><style>{style}</style>"
    return f"<!doctype html>\n<html lang='en'><head>{head}</head>\n<body>\n" + "\n".join(parts) + "\n</body></html>\n"


def format_table(rows: Sequence[Mapping[str, Any]], *, grey: Iterable[str] = ()) -> str:
    """Format rows as a table, grey where the first cell is named."""
    if not rows:
        return ""
    baselines = set(grey)
    head = "".join(f"<th>{escape(name)}</th>" for name in rows[0])
    lines = [
        f"<tr{' class=baseline' if next(iter(row.values())) in baselines else ''}>"
        + "".join(f"<td>{escape(str(value))}</td>" for value in row.values())
        + "</tr>"
        for row in rows
    ]
    return f"<table><tr>{head}</tr>{''.join(lines)}</table>"


def format_figure(name: str, caption: str) -> str:
    """Format a picture next to the page, with its caption."""
    words = escape(caption)
    return f'<figure><img src="{escape(name)}" alt="{words}"><figcaption>{words}</figcaption></figure>'
