"""An evaluation as a folder: one page with figures and tables, the scores, every answer, and the plan of the data."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from doppelgait.classify.evaluate import Evaluation
from doppelgait.core.own_folder import PAGE, check_out, complete_folder

FORMAT, FORMAT_VERSION = "doppelgait-evaluation", 1
LISTING = "report.json"

STYLE = """body { font-family: sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
table { border-collapse: collapse; margin: 1rem 0; } th, td { padding: .25rem .7rem; text-align: right; }
th { border-bottom: 1px solid #888; } td:first-child, th:first-child { text-align: left; }
tr.baseline { color: #777; } img { max-width: 100%; } figure { margin: 1.5rem 0; } figcaption { color: #444; }
pre { background: #f4f4f4; padding: 1rem; overflow-x: auto; } .note { color: #a00; }"""


def check_folder(folder: Path) -> Path:
    """Folder of a report to be; nothing is made.

    Raises
    ------
    ConfigError
        If the folder above does not exist, it is a file, or it holds anything that is not of an earlier report.
    """
    check_out(folder, listing=LISTING, file_format=FORMAT, command="evaluate")
    return folder


def write_report(found: Evaluation, folder: str | Path) -> list[Path]:
    """Write ``index.html`` with its figures, ``scores.json``, ``answers.csv``, ``plan.json`` and a list of them.

    Parameters
    ----------
    found : Evaluation
    folder : path
        It appears complete or not at all; an older report is replaced.

    Returns
    -------
    list of Path
        The page last.

    Raises
    ------
    ConfigError, OutputError
        If the folder cannot be used; what was there before is untouched.
    """
    from doppelgait.classify.figures import figures_of
    from doppelgait.viz import save_figure

    target, document = check_folder(Path(folder)), found.document
    with complete_folder(target) as partial:
        pictures = []
        for name, words, figure in figures_of(document):
            save_figure(figure, partial / f"{name}.png")
            pictures.append((f"{name}.png", words))
        texts = _texts(found, pictures)
        for name, text in texts.items():
            (partial / name).write_text(text, encoding="utf-8", newline="\n")
    return [target / name for name in [*(name for name, _ in pictures), *texts]]


def _texts(found: Evaluation, pictures: Sequence[tuple[str, str]]) -> dict[str, str]:
    """All files but the figures, by name; the page last."""
    document = found.document
    texts = {
        "scores.json": json.dumps(document, indent=1, allow_nan=False) + "\n",
        "answers.csv": found.answers.to_csv(index=False, lineterminator="\n"),
        "plan.json": json.dumps(document["dataset"]["config"], indent=1, allow_nan=False) + "\n",
    }
    listing = {"format": FORMAT, "format_version": FORMAT_VERSION, "files": sorted([*texts, *dict(pictures)])}
    texts[LISTING] = json.dumps(listing, indent=1) + "\n"
    return {**texts, PAGE: page(document, pictures)}


def page(document: Mapping[str, Any], pictures: Sequence[tuple[str, str]]) -> str:
    """The page as HTML."""
    data, other = document["dataset"], document["test_dataset"]
    tested = ", ".join(f"{count} {name}" for name, count in document["tested"].items())
    rows = []
    for fold in document["folds"]:
        words = {key: f"{fold[key]['n']} of {fold[key]['movers']} movers" for key in ("train", "held", "test")}
        rows.append({"fold": fold["name"], **words})
    parts = [
        f"<h1>{escape(str(data['name']))}: classification</h1>",
        f"<p>Learnt from {_dataset(data)}; tested on {_dataset(other) if other else 'rows of it'}: {escape(tested)}. "
        f"Nobody who is tested was learnt from. doppelgait {escape(document['doppelgait_version'])}, seed "
        f"{document['seed']}.</p>",
        *(f'<p class="note">{escape(note)}</p>' for note in document["notes"]),
        _table(
            [{str(key): text for key, text in row.items()} for row in score_table(document)],
            baselines={n for n, m in document["models"].items() if m["kind"]["baseline"]},
        ),
        "<p>Balanced accuracy with its 95 % interval over movers (bootstrap; exact where there are few movers or no "
        "errors). <i>Decided</i>: rows that the model does not abstain from, and its balanced accuracy among them. "
        "Grey: what a score must be compared with: the most frequent class (chance); the parameters that must not tell "
        "the class (nuisance); the speed alone.</p>",
        *_alarm(document),
        *(
            f'<figure><img src="{escape(name)}" alt="{escape(words)}"><figcaption>{escape(words)}</figcaption></figure>'
            for name, words in pictures
        ),
        *_breakdowns(document),
        "<h2>Who learnt, who was tested</h2>",
        _table(rows),
        *(_plan(part, role) for part, role in ((data, "learnt"), (other, "tested")) if part is not None),
    ]
    head = f"<meta charset='utf-8'><title>{escape(str(data['name']))}: classification</title><style>{STYLE}</style>"
    return f"<!doctype html>\n<html lang='en'><head>{head}</head>\n<body>\n" + "\n".join(parts) + "\n</body></html>\n"


def _plan(facts: Mapping[str, Any], role: str) -> str:
    title = f"<h2>Plan, {role}: {escape(str(facts['name']))}, id {escape(str(facts['id']))}</h2>"
    if facts["config"] is None:
        return f"{title}<p>It has no plan ({escape(facts['origin'])}).</p>"
    return f"{title}<pre>{escape(json.dumps(facts['config'], indent=1))}</pre>"


def _dataset(facts: Mapping[str, Any]) -> str:
    name, identity = escape(str(facts["name"])), escape(str(facts["id"]))
    return f"{name} ({facts['n_rows']} rows, {escape(facts['origin'])}, id {identity})"


def _table(rows: Sequence[Mapping[str, Any]], baselines: Iterable[str] = ()) -> str:
    if not rows:
        return ""
    grey = set(baselines)
    head = "".join(f"<th>{escape(name)}</th>" for name in rows[0])
    lines = [
        f'<tr{" class=baseline" if next(iter(row.values())) in grey else ""}>'
        + "".join(f"<td>{escape(str(value))}</td>" for value in row.values()) + "</tr>"
        for row in rows
    ]  # fmt: skip
    return f"<table><tr>{head}</tr>{''.join(lines)}</table>"


def score_table(document: Mapping[str, Any]) -> list[dict[str, str]]:
    """One row per model, in words: what the page and the command line show."""
    rows = []
    for name, model in document["models"].items():
        found, decided = model["balanced_accuracy"], model["decided"]
        curves = [curve["auc"] for curve in model["roc"].values() if curve["auc"] is not None]
        rows.append({
            "model": name,
            "balanced accuracy": with_interval(found),
            **{f"recall {label}": number(share["value"]) for label, share in model["recall"].items()},
            "AUC": number(sum(curves) / len(curves) if curves else None),
            "Brier": number(model["brier"]),
            "ECE": number(model["expected_calibration_error"]),
            "decided": f"{number(decided['share'], 2)}: {number(decided['balanced_accuracy']['value'])}",
        })  # fmt: skip
    return rows


def alarm_table(document: Mapping[str, Any]) -> list[dict[str, str]]:
    """Who triggers an alarm that detects 95 % of people, by model; empty where there is no such class."""
    rows = []
    for name, model in document["models"].items():
        alarm = model["alarm"]
        for kind, words in (("held", "held rows"), ("curve", "its own curve")):
            if alarm is not None and kind in alarm:
                shares = {label: with_interval(share) for label, share in alarm[kind].items()}
                rows.append({"model": name, "threshold from": words, **shares})
    return rows


def _alarm(document: Mapping[str, Any]) -> list[str]:
    rows = alarm_table(document)
    if not rows:
        return []
    return [
        "<h2>As an alarm</h2><p>Share of every class that triggers where the threshold is set for 95 % of people: by "
        "the rows held back for calibration, as in use, and read off the ROC curve of the tested rows.</p>",
        _table(rows, baselines={n for n, m in document["models"].items() if m["kind"]["baseline"]}),
    ]


def _breakdowns(document: Mapping[str, Any]) -> list[str]:
    # The model that details are shown of: the best, or the first trained where none can be called so.
    trained = [name for name, model in document["models"].items() if not model["kind"]["baseline"]]
    best, parts = str(document["best_on_held_rows"] or trained[0]), []
    for column, models in document["breakdowns"].items():
        rows = [
            {column: entry["value"], "is": entry["label"], "rows": entry["n"], "movers": entry["movers"],
             "share right": f"{number(entry['share_value'])} ({number(entry['low'])} to {number(entry['high'])})"}
            for entry in models[best]
        ]  # fmt: skip
        parts += [f"<h2>{escape(best)} by {escape(column)}</h2>", _table(rows)]
    return parts


def number(value: float | None, digits: int = 3) -> str:
    """A share for people; ``-`` for None."""
    return "-" if value is None else f"{value:.{digits}f}"


def with_interval(found: Mapping[str, Any]) -> str:
    """A share with its interval; why there is none where not all classes are tested."""
    if found["value"] is None and "interval" in found:
        return str(found["interval"])
    return f"{number(found['value'])} ({number(found['low'])} to {number(found['high'])})"
