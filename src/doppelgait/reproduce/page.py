"""The page: every figure and table beside its number, what the report states and what is measured here."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

from doppelgait import __version__
from doppelgait.reproduce.entry import KINDS, Reading
from doppelgait.reproduce.outcome import Outcome

if TYPE_CHECKING:
    import pandas as pd

SHOWN_ROWS = 30
"""Rows of a table shown on the page; the whole of it is beside the page."""
CLASSES = {"agrees": "yes", "set": "set", "differs": "no", "not stated": "none"}
"""Style of a reading by its kind."""

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #1b1b1b; max-width: 74rem; margin: 1.5rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin: 0 0 .4rem; }
section { border-top: 1px solid #ccc; padding: 1.2rem 0; }
img { max-width: 100%; height: auto; border: 1px solid #e3e3e3; }
table { border-collapse: collapse; margin: .6rem 0; } th, td { padding: .2rem .7rem .2rem 0; text-align: left;
vertical-align: top; border-bottom: 1px solid #eee; } th { font-weight: 600; } td.number { text-align: right;
font-variant-numeric: tabular-nums; white-space: nowrap; }
.wide { overflow-x: auto; } .yes { color: #00693e; } .no { color: #b3001b; font-weight: 600; } .none { color: #666; }
.set { color: #7a5b00; }
.how { color: #555; font-size: .9rem; } .error { color: #b3001b; } nav a { margin-right: .7rem; white-space: nowrap; }
"""


def page(outcomes: Sequence[Outcome], *, recordings: bool) -> str:
    """The whole page as HTML that asks for nothing but the figures beside it.

    Parameters
    ----------
    outcomes : sequence of Outcome
    recordings : bool
        Whether a motion folder was given.
    """
    links = " ".join(f'<a href="#{one.entry.number}">{escape(heading(one.entry.number))}</a>' for one in outcomes)
    return "\n".join([
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>Liland 2018, reproduced</title>\n<style>{STYLE}</style>\n</head>\n<body>",
        "<h1>A radar simulator for generating micro-Doppler datasets (Liland 2018): its figures and tables again</h1>",
        _introduction(outcomes, recordings),
        f"<nav>{links}</nav>",
        *[_section(one) for one in outcomes],
        "</body>\n</html>\n",
    ])  # fmt: skip


def heading(number: str) -> str:
    """Number of an entry for people: "Figure 4.13"."""
    kind, _, rest = number.partition("-")
    return f"{'Figure' if kind == 'fig' else 'Table'} {rest}"


def _introduction(outcomes: Sequence[Outcome], recordings: bool) -> str:
    agree, given, differ, unstated = (sum(one.count_kind(kind) for one in outcomes) for kind in KINDS)
    failed = sum(one.made is None for one in outcomes)
    motion = (
        "People and dogs are real recordings as far as the motion folder has them."
        if recordings
        else "Models stand in for the report's recordings of people and of a dog; --motion-folder brings real ones."
    )
    return (
        f"<p>Made by doppelgait {escape(__version__)} in {sum(one.seconds for one in outcomes):.0f} s: {len(outcomes)} "
        f"figures and tables{f', {failed} of them could not be made' if failed else ''}. {motion} "
        f'Of the numbers read, <span class="yes">{agree} agree</span> with what the report states, '
        f'<span class="no">{differ} differ</span>, <span class="set">{given} were set</span> as the report has them or '
        f"follow from the model that stands in, and for {unstated} it states none. "
        "What a number is compared with, and how closely, comes from the report's text; notes say why some differ. "
        'All numbers are in <a href="readings.json">readings.json</a>.</p>'
    )


def _section(one: Outcome) -> str:
    entry = one.entry
    parts = [
        f'<section id="{entry.number}">\n<h2>{escape(heading(entry.number))}: {escape(entry.title)}</h2>',
        f"<p><b>The report:</b> {escape(entry.stated)}</p>",
    ]
    if one.made is None:
        parts.append(f'<p class="error"><b>Could not be made:</b> {escape(one.error)}</p>')
    else:
        if one.figure_path:
            alternative = f"{heading(entry.number)}: {entry.title}"
            parts.append(f'<img src="{one.figure_path}" alt="{escape(alternative)}" loading="lazy">')
        if one.made.table is not None:
            parts.append(_table(one.made.table, str(one.table_path)))
        parts += [_readings(one.readings), f"<p><b>Judgement:</b> {escape(one.made.judgement)}</p>"]
    sources = "; ".join(one.used) or "no mover"
    parts.append(f'<p class="how">Made from {escape(sources)}, in {one.seconds:.1f} s.</p>')
    parts += [f'<p class="how">Warning while it was made: {escape(remark)}</p>' for remark in one.remarks]
    return "\n".join([*parts, "</section>"])


def _readings(readings: Sequence[Reading]) -> str:
    if not readings:
        return ""
    head = "<tr><th>quantity</th><th>here</th><th>report</th><th>within</th><th></th><th></th></tr>"
    rows = "\n".join(
        f"<tr><td>{escape(one.name)}</td>{_cell(one.ours, one.unit)}{_cell(one.stated, one.unit)}"
        f'{_cell(one.tolerance, one.unit)}<td class="{CLASSES[one.kind]}">{one.kind}</td>'
        f"<td>{escape(one.note)}</td></tr>"
        for one in readings
    )
    return f'<div class="wide"><table>\n{head}\n{rows}\n</table></div>'


def _cell(value: float | None, unit: str) -> str:
    text = "" if value is None else f"{value:.4g}" + ("" if unit == "1" else f" {unit}")
    return f'<td class="number">{escape(text)}</td>'


def _table(table: pd.DataFrame, path: str) -> str:
    shown = table.head(SHOWN_ROWS).to_html(index=False, border=0, float_format=lambda value: f"{value:.4g}", na_rep="")
    more = f"The first {SHOWN_ROWS} of {len(table)} rows; " if len(table) > SHOWN_ROWS else ""
    return f'<div class="wide">{shown}</div><p class="how">{more}<a href="{path}">the table as CSV</a></p>'
