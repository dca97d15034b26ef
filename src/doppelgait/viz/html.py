"""HTML pages of reports: tables, figures and the frame of a page."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from html import escape
from typing import Any

STYLE = """body { font-family: sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
body { overflow-wrap: anywhere; } .wide, figure, pre { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; } th, td { padding: .25rem .7rem; text-align: right; background: #fff; }
th { border-bottom: 1px solid #888; overflow-wrap: normal; } td { white-space: nowrap; }
td:first-child, th:first-child { text-align: left; position: sticky; left: 0; } tr.baseline { color: #777; }
img { max-width: 100%; min-width: 34rem; } figcaption { color: #444; position: sticky; left: 0; }
pre { background: #f4f4f4; padding: 1rem; } .note { color: #a00; }"""
"""Wide tables, figures and plans scroll in their own boxes, so that the page fits a telephone."""


def format_page(title: str, parts: Sequence[str], *, style: str = STYLE) -> str:
    """Format a page of parts that are HTML."""
    head = "<meta charset='utf-8'><meta name='viewport' content='width=device-width'>"
    head += f"<title>{escape(title)}</title><style>{style}</style>"
    return f"<!doctype html>\n<html lang='en'><head>{head}</head>\n<body>\n" + "\n".join(parts) + "\n</body></html>\n"


def format_table(rows: Sequence[Mapping[str, Any]], *, grey: Collection[str] = ()) -> str:
    """Format rows as a table, grey where the first cell is named."""
    if not rows:
        return ""
    head = "".join(f"<th>{escape(name)}</th>" for name in rows[0])
    cells = ["".join(f"<td>{escape(str(value))}</td>" for value in row.values()) for row in rows]
    marks = [" class=baseline" if next(iter(row.values())) in grey else "" for row in rows]
    lines = [f"<tr{mark}>{row}</tr>" for mark, row in zip(marks, cells, strict=True)]
    return f'<div class="wide" tabindex="0"><table><tr>{head}</tr>{"".join(lines)}</table></div>'


def format_figure(name: str, caption: str) -> str:
    """Format a picture next to the page, with its caption."""
    words = escape(caption)
    return f'<figure><img src="{escape(name)}" alt="{words}"><figcaption>{words}</figcaption></figure>'
