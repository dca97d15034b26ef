"""One run of the reproduction and its page."""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path

from doppelgait import ConfigError, DoppelgaitError, DoppelgaitWarning, __version__
from doppelgait.viz import save_figure
from doppelgait_liland2018.entry import KINDS, Outcome, collect_entries, pick
from doppelgait_liland2018.folder import PAGE, check_out, complete_folder
from doppelgait_liland2018.material import Material

SHOWN_ROWS = 30
"""Rows of a table shown on the page; the whole table is a file next to the page."""
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


def format_page(outcomes: Sequence[Outcome], *, recordings: bool) -> str:
    """Format the page as HTML."""
    links = " ".join(
        f'<a href="#{one.entry.number}">{escape(format_heading(one.entry.number))}</a>' for one in outcomes
    )
    return "\n".join(
        [
            '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>Liland 2018, reproduced</title>\n<style>{STYLE}</style>\n</head>\n<body>",
            "<h1>A radar simulator for generating micro-Doppler datasets (Liland 2018): figures and tables</h1>",
            _format_introduction(outcomes, recordings),
            f"<nav>{links}</nav>",
            *[_format_section(one) for one in outcomes],
            "</body>\n</html>\n",
        ]
    )


def format_heading(number: str) -> str:
    """Format the number of an entry: "Figure 4.13"."""
    kind, _, rest = number.partition("-")
    return f"{'Figure' if kind == 'fig' else 'Table'} {rest}"


def _format_introduction(outcomes: Sequence[Outcome], recordings: bool) -> str:
    agree, fixed, differ, unstated = (sum(one.count_kind(kind) for one in outcomes) for kind in KINDS)
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
        f'<span class="no">{differ} differ</span>, <span class="set">{fixed} were set</span> as the report has them or '
        f"follow from the model that stands in, and for {unstated} it states none. "
        "What a number is compared with, and how closely, comes from the report's text; notes say why some differ. "
        'All numbers are in <a href="readings.json">readings.json</a>.</p>'
    )


def _format_section(one: Outcome) -> str:
    entry = one.entry
    parts = [
        f'<section id="{entry.number}">\n<h2>{escape(format_heading(entry.number))}: {escape(entry.title)}</h2>',
        f"<p><b>The report:</b> {escape(entry.stated)}</p>",
    ]
    if one.made is None:
        parts.append(f'<p class="error"><b>Could not be made:</b> {escape(one.error)}</p>')
    else:
        if one.figure_path:
            alternative = f"{format_heading(entry.number)}: {entry.title}"
            parts.append(f'<img src="{one.figure_path}" alt="{escape(alternative)}" loading="lazy">')
        if one.made.table is not None:
            path = str(one.table_path)
            shown = one.made.table.head(SHOWN_ROWS).to_html(
                index=False, border=0, float_format=lambda value: f"{value:.4g}", na_rep=""
            )
            more = f"The first {SHOWN_ROWS} of {len(one.made.table)} rows; " if len(one.made.table) > SHOWN_ROWS else ""
            parts.append(
                f'<div class="wide">{shown}</div><p class="how">{more}<a href="{path}">the table as CSV</a></p>'
            )
        rows = "\n".join(
            f"<tr><td>{escape(read.name)}</td>{_number_cell(read.ours, read.unit)}"
            f"{_number_cell(read.stated, read.unit)}{_number_cell(read.tolerance, read.unit)}"
            f'<td class="{CLASSES[read.kind]}">{read.kind}</td>'
            f"<td>{escape(read.note)}</td></tr>"
            for read in one.readings
        )
        head = "<tr><th>quantity</th><th>here</th><th>report</th><th>within</th><th></th><th></th></tr>"
        parts.append(f'<div class="wide"><table>\n{head}\n{rows}\n</table></div>' if rows else "")
        parts.append(f"<p><b>Judgement:</b> {escape(one.made.judgement)}</p>")
    sources = "; ".join(one.used) or "no target"
    parts.append(f'<p class="how">Made from {escape(sources)}, in {one.seconds:.1f} s.</p>')
    parts += [f'<p class="how">Warning while it was made: {escape(remark)}</p>' for remark in one.remarks]
    return "\n".join([*parts, "</section>"])


def _number_cell(value: float | None, unit: str) -> str:
    text = "" if value is None else f"{value:.4g}" + ("" if unit == "1" else f" {unit}")
    return f'<td class="number">{escape(text)}</td>'


FORMAT, FORMAT_VERSION = "doppelgait-reproduction", 1
READINGS = "readings.json"


def _keep_other_entries(out: Path, numbers: set[str]) -> None:
    """Refuse to replace a page that has other entries, too."""
    earlier = out / READINGS
    if not earlier.is_file():
        return
    others = [one["number"] for one in json.loads(earlier.read_bytes())["entries"] if one["number"] not in numbers]
    if others:
        raise ConfigError(
            f"--only would replace the page in {out}, and its {len(others)} other figures and tables would be lost; "
            "give another folder, or leave --only out"
        )


def reproduce(
    out: Path,
    *,
    only: Sequence[str] = (),
    motion_folder: Path | None = None,
    seed: int = 2018,
    figure_format: str = "png",
    progress: Callable[[int, int], None] | None = None,
) -> list[Outcome]:
    """Make the report's figures, tables and judgements."""
    check_out(out, listing=READINGS, file_format=FORMAT)
    entries = pick(collect_entries(), only)
    _keep_other_entries(out, {entry.number for entry in entries})
    material = Material(seed=seed, motion_folder=motion_folder)
    outcomes: list[Outcome] = []
    vectors: list[str] = []
    with complete_folder(out) as folder:
        for name in ("figures", "tables"):
            (folder / name).mkdir()
        for number, entry in enumerate(entries, start=1):
            # Make an entry and write its figure and table; an error of its motion is reported, not raised.
            began = time.perf_counter()
            made, error = None, ""
            material.begin_entry()
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", DoppelgaitWarning)
                try:
                    made = entry.make(material)
                except DoppelgaitError as fault:
                    error = str(fault)
            # Our own warnings become remarks, each once; others are issued again.
            for one in caught:
                if not issubclass(one.category, DoppelgaitWarning):
                    warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
            outcome = Outcome(
                entry,
                made,
                material.used(),
                list(dict.fromkeys(str(one.message) for one in caught if issubclass(one.category, DoppelgaitWarning))),
                error=error,
            )
            if made is not None:
                if made.figure is not None and outcome.figure_path:
                    path = save_figure(made.figure, folder / outcome.figure_path)
                    if figure_format != "png":
                        vector = save_figure(made.figure, path.with_suffix(f".{figure_format}"))
                        vectors.append(vector.relative_to(folder).as_posix())
                if made.table is not None and outcome.table_path:
                    made.table.to_csv(folder / outcome.table_path, index=False)
            outcomes.append(replace(outcome, seconds=time.perf_counter() - began))
            if progress is not None:
                progress(number, len(entries))
        document = {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "doppelgait": __version__,
            "seed": seed,
            "recordings": motion_folder is not None,
            "entries": [outcome.as_dict() for outcome in outcomes],
            "files": sorted(
                [*vectors, *(path for one in outcomes for path in (one.figure_path, one.table_path) if path)]
            ),
        }
        text = json.dumps(document, indent=2, allow_nan=False)
        (folder / READINGS).write_text(text + "\n", encoding="utf-8")
        (folder / PAGE).write_text(format_page(outcomes, recordings=motion_folder is not None), encoding="utf-8")
    return outcomes
