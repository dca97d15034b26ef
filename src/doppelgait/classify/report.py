"""Report of an evaluation: figures, tables and page."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from doppelgait.classify.alarm import format_day, format_episodes
from doppelgait.classify.evaluation import Evaluation
from doppelgait.core.files import PAGE, check_out, complete_folder
from doppelgait.viz.html import format_figure, format_page, format_table
from doppelgait.viz.style import (
    BLUE,
    SERIES_COLOURS,
    SHARE_COLOURS,
    draw_grid,
    label_quantity,
    make_axes,
    make_figure,
    name_axes,
    place_legend,
)

BASELINE_COLOUR = "#888888"
BASELINE_STYLES = {"chance": ":", "nuisance": "--", "speed": "-."}
MOST_FEATURES = 15
ALONE = "the only class present"
HOLLOW: dict[str, Any] = {"marker": "D", "mfc": "none", "ls": ""}  # recalls, which are no balanced accuracies

Document = Mapping[str, Any]

FORMAT, FORMAT_VERSION = "doppelgait-evaluation", 1
LISTING = "report.json"
REPORT = {"listing": LISTING, "file_format": FORMAT, "command": "evaluate"}

SCORES_TEXT = (
    "<p>Balanced accuracy with its 95 % interval over targets (bootstrap; exact for few targets). "
    "<i>Brier</i>: half the sum of squares; <i>ECE</i>: even bins from chance to 1. "
    "<i>Decided</i>: share of rows with a decision, and its balanced accuracy. Grey: baselines: "
    "all classes alike, parameters that must not predict the class, the speed alone.</p>"
)
ADAPTATION_TEXT = (
    "<h2>Adapted to own recordings</h2><p>After so many recordings of each class: mean of 50 draws, "
    "and the range of 80 %, of targets outside the draw; next to it the same targets before.</p>"
)
UNKNOWN_TEXT = (
    "<h2>Kinds outside the training data</h2><p>How well the distance from the training data, and "
    "doubt, separate them from the tested rows (AUC), and the share decided as a class.</p>"
)
ALARM_TEXT = (
    "<h2>As an alarm</h2><p>Share of every class that triggers at the threshold for 95 % of its "
    "class, by held-out rows, as in use, and by the ROC curve of the tested rows.</p>"
)


def make_figures(document: Document) -> Iterator[tuple[str, str, Figure]]:
    """Yield name, caption and figure, one after the other."""
    models = document["models"]
    yield "scores", "Balanced accuracy of every model with its 95 % interval.", score_bars(document)
    words = "Rows by true and by predicted class; the colour is the share of the true class."
    yield "confusion", words, plot_confusion(document)
    for name in next(iter(models.values()))["roc"]:
        words = f"{name} against all others: share detected against share falsely detected."
        yield f"roc-{''.join(c if c.isalnum() else '-' for c in name)}", words, plot_roc(document, name)
    words = (
        "Share of correct rows against confidence; calibrated probabilities lie on the diagonal. The bins of a model "
        "have equal numbers of rows, as far as confidences differ."
    )
    yield "reliability", words, plot_reliability(document)
    if any(model.get("adaptation") for model in models.values()):
        words = "Accuracy by own recordings (band: 80 % of draws), and calibration before and after."
        yield "adaptation", words, plot_adaptation(document)
    for name, condition in document["conditions"].items():
        words = f"Balanced accuracy by {condition['words']}, with 95 % intervals; n: rows. Hollow: recall of {ALONE}."
        yield f"accuracy-{name}", words, plot_condition(document, name)
    for name, model in models.items():
        if model["importance"] and not model["kind"]["baseline"]:
            words = f"{name}: increase of the log loss when a feature is shuffled."
            yield f"importance-{name}", words, plot_importance(name, model["importance"])


def _choose_line_styles(document: Document) -> dict[str, dict[str, Any]]:
    looks: dict[str, dict[str, Any]] = {
        name: {"color": BASELINE_COLOUR, "linestyle": style} for name, style in BASELINE_STYLES.items()
    }
    trained = [name for name, model in document["models"].items() if not model["kind"]["baseline"]]
    colours = zip(trained, cycle(SERIES_COLOURS), strict=False)
    return looks | {name: {"color": colour, "linestyle": "-"} for name, colour in colours}


def _finish(axes: Axes, title: str, x: str, y: str, **legend: Any) -> None:
    draw_grid(axes)
    name_axes(axes, title=title, x=x, y=y)
    place_legend(axes, **legend)


def score_bars(document: Document) -> Figure:
    """Plot the balanced accuracy of every model with its interval."""
    looks, models = _choose_line_styles(document), document["models"]
    figure, axes = make_axes(width_in=8.0, height_in=1.2 + 0.42 * len(models))
    style: dict[str, Any] = {"fmt": "o", "lw": 2.0, "capsize": 4}
    for place, (name, model) in enumerate(reversed(models.items())):
        found, colour = model["balanced_accuracy"], looks[name]["color"]
        if found["value"] is None:
            recalls = _list_recalls(model)
            axes.plot(recalls, [place] * len(recalls), color=colour, ms=6, **HOLLOW)
        else:
            spread = [[found["value"] - found["low"]], [found["high"] - found["value"]]]
            axes.errorbar([found["value"]], [place], xerr=spread, color=colour, **style)
    axes.set_yticks(range(len(models)), labels=list(reversed(models)))
    axes.errorbar([], [], xerr=[], color="black", label="value and 95 % interval", **style)
    axes.axvline(1.0 / len(document["classes"]), color="black", ls=":", lw=1.0, label="chance")
    if any(model["balanced_accuracy"]["value"] is None for model in models.values()):
        axes.plot([], [], color="black", label=f"recall of {ALONE}", **HOLLOW)
    axes.set(xlim=(0.0, 1.02), ylim=(-0.6, len(models) - 0.4))
    _finish(axes, "Balanced accuracy of every model", "balanced accuracy", "")
    return figure


def _list_recalls(found: Mapping[str, Any]) -> list[float]:
    return [share["value"] for share in found["recall"].values() if share["value"] is not None]


def plot_confusion(document: Document) -> Figure:
    """Plot the confusion matrix of every model."""
    models, classes = document["models"], document["classes"]
    across = min(4, len(models))
    down = -(-len(models) // across)
    side = max(2.4, 0.8 * len(classes) + 1.2)
    figure = make_figure(width_in=side * across + 0.8, height_in=side * down)
    panels = list(figure.subplots(down, across, squeeze=False).flat)
    for axes, (name, model) in zip(panels, models.items(), strict=False):
        counts = np.asarray(model["confusion"], dtype=float)
        shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0)
        image = axes.imshow(shares, cmap=SHARE_COLOURS, vmin=0.0, vmax=1.0)
        for row, column in np.ndindex(shares.shape):
            colour = "white" if shares[row, column] > 0.6 else "black"
            axes.text(column, row, f"{counts[row, column]:.0f}", ha="center", va="center", color=colour, fontsize=10)
        axes.set_xticks(range(len(classes)), labels=classes, rotation=30, ha="right", rotation_mode="anchor")
        axes.set_yticks(range(len(classes)), labels=classes)
        name_axes(axes, title=name, x="predicted class", y="true class")
    for axes in panels[len(models) :]:
        axes.set_visible(False)
    figure.colorbar(image, ax=panels, shrink=0.8, aspect=30).set_label("share of the true class", fontsize=9.5)
    return figure


def plot_roc(document: Document, label: str) -> Figure:
    """Plot the ROC curve of every model for one class."""
    looks = _choose_line_styles(document)
    figure, axes = make_axes(width_in=7.0, height_in=6.0)
    for name, model in document["models"].items():
        curve = model["roc"][label]
        if curve["auc"] is not None:
            axes.plot(curve["false"], curve["true"], lw=1.8, label=f"{name}, AUC {curve['auc']:.3f}", **looks[name])
    axes.axhline(0.95, color="black", lw=0.8, ls=":", label="95 % detected")
    axes.set(xlim=(-0.02, 1.02), ylim=(-0.02, 1.03))
    others = "share of the other classes, falsely detected"
    _finish(axes, f"{label} against all other classes", others, f"share of {label}, detected", columns=2)
    return figure


def _plot_reliability(axes: Axes, document: Document, curves: Mapping[str, tuple[Any, Any]], **legend: Any) -> None:
    lowest = 1.0 / len(document["classes"])
    axes.plot([lowest, 1.0], [lowest, 1.0], color="black", ls=":", lw=1.0, label="calibrated")
    for name, (model, look) in curves.items():
        x, y, counts = ([entry[key] for entry in model["reliability"]] for key in ("confidence", "accuracy", "n"))
        rows = f"{min(counts)}" if min(counts) == max(counts) else f"{min(counts)} to {max(counts)}"
        text = f"{name}: {rows} rows a bin, calibration error {model['expected_calibration_error']:.3f}"
        text += f", Brier score {model['brier']:.3f}" if "brier" in model else ""
        axes.plot(x, y, lw=1.4, marker="o", ms=5, label=text, **look)
    _finish(axes, "Calibration", "confidence", "share of correct rows", **legend)


def plot_reliability(document: Document) -> Figure:
    """Plot accuracy against confidence of all models but the baselines."""
    looks, models = _choose_line_styles(document), document["models"].items()
    figure, axes = make_axes(width_in=7.0, height_in=6.0)
    curves = {name: (model, looks[name]) for name, model in models if not model["kind"]["baseline"]}
    _plot_reliability(axes, document, curves, columns=1)
    return figure


def plot_adaptation(document: Document) -> Figure:
    """Plot accuracy against own recordings, and calibration before and after."""
    looks = _choose_line_styles(document)
    figure = make_figure(width_in=12.0, height_in=5.0)
    axes, calibrated = figure.subplots(1, 2)
    shown = {name: model["adaptation"] for name, model in document["models"].items() if model.get("adaptation")}
    for name, points in shown.items():
        keys = ("n", "low", "high", "balanced_accuracy")
        counts, low, high, accuracy = ([point[key] for point in points] for key in keys)
        axes.plot(counts, accuracy, marker="o", label=name, **looks[name])
        axes.fill_between(counts, low, high, color=looks[name]["color"], alpha=0.12, lw=0)
    axes.fill_between([], [], [], color="black", alpha=0.12, lw=0, label="80 % of the draws")
    _finish(axes, "Adaptation", "own recordings of each class", "balanced accuracy", where="panel", columns=2)
    best = document["kept"] if document["kept"] in shown else next(iter(shown))
    ends = zip((shown[best][0], shown[best][-1]), SERIES_COLOURS, strict=False)
    curves = {f"{best}, {point['n']} own recordings": (point, {"color": colour}) for point, colour in ends}
    _plot_reliability(calibrated, document, curves, where="panel", columns=1)
    return figure


def plot_condition(document: Document, condition: str) -> Figure:
    """Plot balanced accuracy in bins of a condition."""
    looks, facts = _choose_line_styles(document), document["conditions"][condition]
    figure, axes = make_axes(width_in=9.0, height_in=5.0)
    for number, (name, bins) in enumerate(facts["models"].items()):
        shift = (bins[0]["to"] - bins[0]["from"]) * ((number + 0.5) / len(facts["models"]) - 0.5) * 0.5
        whole = []
        for entry in bins:
            middle = (entry["from"] + entry["to"]) / 2.0 + shift
            if entry["value"] is None:
                recalls = _list_recalls(entry)
                axes.plot([middle] * len(recalls), recalls, color=looks[name]["color"], ms=6, **HOLLOW)
            else:
                whole.append([middle, *(entry[key] for key in ("value", "low", "high"))])
        x, y, *ends = np.reshape(whole, (-1, 4)).T
        style = {"lw": 1.4, "elinewidth": 0.8, "capsize": 2, "marker": "o", "ms": 4, **looks[name]}
        axes.errorbar(x, y, yerr=np.abs(ends - y), label=name, **style)
    for entry in next(iter(facts["models"].values())):
        axes.text((entry["from"] + entry["to"]) / 2.0, -0.09, f"n = {entry['n']}", fontsize=8, ha="center")
    axes.set_ylim(-0.12, 1.05)
    title = f"Accuracy by {facts['words'].rpartition(' (')[0]}"
    _finish(axes, title, facts["words"], "balanced accuracy", columns=4)
    return figure


def plot_importance(name: str, importance: Mapping[str, float]) -> Figure:
    """Plot the most important features."""
    shown = list(importance.items())[:MOST_FEATURES]
    figure, axes = make_axes(width_in=8.0, height_in=1.2 + 0.28 * len(shown))
    names = [label_quantity(key.removeprefix("extended_")) for key, _ in reversed(shown)]
    axes.barh(names, [value for _, value in reversed(shown)], color=BLUE)
    draw_grid(axes)
    name_axes(axes, title=f"Most important features, {name}", x="increase of the log loss (nat)", y="")
    return figure


def write_report(found: Evaluation, folder: str | Path, *, figure_format: str = "png") -> list[Path]:
    """Write the report of an evaluation to a folder.

    ``index.html`` with its figures, ``scores.json``, ``answers.csv``, ``plan.json`` and a list of
    them.

    Parameters
    ----------
    folder : path
        It appears complete or not at all; an older report is replaced.
    figure_format : {"png", "svg", "pdf"}
        Format of the figures. The page shows PNG; vector files are written next to it.

    Returns
    -------
    list of Path
        The page last.

    Raises
    ------
    ConfigError, OutputError
        If the folder cannot be used; what was there before is untouched.
    """
    from doppelgait.viz import save_figure

    target, document = Path(folder), found.document
    check_out(target, **REPORT)
    with complete_folder(target) as partial:
        pictures, vectors = [], []
        for name, words, figure in make_figures(document):
            save_figure(figure, partial / f"{name}.png")
            pictures.append((f"{name}.png", words))
            if figure_format != "png":
                vectors.append(save_figure(figure, partial / f"{name}.{figure_format}").name)
        texts = {
            "scores.json": json.dumps(document, indent=1, allow_nan=False) + "\n",
            "answers.csv": found.answers.to_csv(index=False, lineterminator="\n"),
            "plan.json": json.dumps(document["dataset"]["config"], indent=1, allow_nan=False) + "\n",
        }
        files = sorted([*texts, *dict(pictures), *vectors])
        listing = {"format": FORMAT, "format_version": FORMAT_VERSION, "files": files}
        texts[LISTING] = json.dumps(listing, indent=1) + "\n"
        texts[PAGE] = make_page(document, pictures)
        for name, text in texts.items():
            (partial / name).write_text(text, encoding="utf-8", newline="\n")
    return [target / name for name in [*(name for name, _ in pictures), *vectors, *texts]]


def make_page(document: Document, pictures: Sequence[tuple[str, str]]) -> str:
    """Format the page as HTML."""
    tested = ", ".join(f"{count} {name}" for name, count in document["tested"].items())
    folds = [
        {"fold": fold["name"]}
        | {key: f"{fold[key]['n']} of {fold[key]['movers']} targets" for key in ("train", "held", "test")}
        for fold in document["folds"]
    ]
    named = filter(None, (document["dataset"], document["test_dataset"]))
    about = [escape("{name} ({n_rows} rows, {origin}, id {id})".format(**facts)) for facts in named]
    title, trained = f"{document['dataset']['name']}: classification", document["folds"][0]["train"]["n"]
    grey = {name for name, model in document["models"].items() if model["kind"]["baseline"]}
    parts = [
        f"<h1>{escape(title)}</h1>",
        f"<p>{'Trained on' if trained else 'Dataset'} {about[0]}; tested on {[*about, 'rows of it'][1]}: "
        f"{escape(tested)}. No tested target is in the split train. "
        f"doppelgait {escape(document['doppelgait_version'])}, seed {document['seed']}.</p>",
        *(f'<p class="note">{escape(note)}</p>' for note in document["notes"]),
    ]
    for words, rows in list_sections(document).items():
        table = format_table(rows, grey=grey)
        parts += [words, table] if words else [table, SCORES_TEXT]
    parts += [format_figure(name, words) for name, words in pictures]
    # Show details of own answers, of the best model, or else of the first trained model.
    best = str(document["own"] or document["kept"] or next(name for name in document["models"] if name not in grey))
    for column, models in document["breakdowns"].items():
        shares = [
            {
                column: entry["value"],
                "is": entry["label"],
                "rows": entry["n"],
                "targets": entry["movers"],
                "share right": format_interval({**entry, "value": entry["share_value"]}),
            }
            for entry in models[best]
        ]
        parts += [f"<h2>{escape(best)} by {escape(column)}</h2>", format_table(shares)]
    parts += ["<h2>Training and test data</h2>", format_table(folds)]
    if document["dataset"]["config"] is not None:
        parts.append('<p>The plan of the first dataset is in <a href="plan.json">plan.json</a>.</p>')
    return format_page(title, parts)


def list_sections(document: Document) -> dict[str, list[dict[str, str]]]:
    """List the tables of an evaluation that have rows, by the text before each."""
    models, sections = document["models"].items(), {"": score_table(document)}
    sources = {"held": "held rows", "curve": "its own curve"}
    sections[ALARM_TEXT] = [
        {"model": name, "threshold from": words}
        | {label: format_interval(share) for label, share in model["alarm"][key].items()}
        for name, model in models
        for key, words in sources.items()
        if key in (model["alarm"] or ())
    ]
    if day := document.get("alarm_day"):
        words = (
            f"<h2>The alarm over a day: {escape(day['day'])}</h2><p>{escape(day['model'])} triggers for "
            f"{escape(day['alarm'])}. False triggers with intervals of 95 % (weighted Poisson counts), over simulated "
            f"episodes, {day['repeats']} of each kind; missed: episodes that should trigger and do not; time from the "
            "start of an episode.</p>"
        )
        sections |= {words: format_day(day), "<p>Triggered recordings:</p>": format_episodes(day)}
    sections[ADAPTATION_TEXT] = [
        {
            "model": name,
            "own recordings of a class": str(point["n"]),
            "balanced accuracy": format_interval({**point, "value": point["balanced_accuracy"]}),
            "same targets before": format_number(point["before"]),
            "targets": f"{point['movers']:.0f}",
            "ECE": format_number(point["expected_calibration_error"]),
        }
        for name, model in models
        for point in model.get("adaptation", [])
    ]
    sections[UNKNOWN_TEXT] = [
        {
            "model": name,
            "kind": label,
            "rows": str(found["n"]),
            "AUC of the distance": format_number(found["auc"]),
            "AUC of doubt": format_number(found["auc_of_probability"]),
        }
        | {f"called {other}": format_number(share) for other, share in found["decided"].items()}
        for name, model in models
        for label, found in model.get("unknown", {}).items()
    ]
    return {words: rows for words, rows in sections.items() if rows}


def score_table(document: Document) -> list[dict[str, str]]:
    """Format a row of scores per model."""
    rows = []
    for name, model in document["models"].items():
        decided = model["decided"]
        areas = [curve["auc"] for curve in model["roc"].values() if curve["auc"] is not None]
        row = {"model": name, "balanced accuracy": format_interval(model["balanced_accuracy"])}
        row |= {f"recall {label}": format_number(share["value"]) for label, share in model["recall"].items()}
        row["AUC"] = format_number(sum(areas) / len(areas) if areas else None)
        row["Brier"] = format_number(model["brier"])
        row["ECE"] = format_number(model["expected_calibration_error"])
        accuracy = format_number(decided["balanced_accuracy"]["value"])
        rows.append(row | {"decided": f"{format_number(decided['share'], 2)}: {accuracy}"})
    return rows


def format_number(value: float | None, digits: int = 3) -> str:
    """Format a share; ``-`` for None."""
    return "-" if value is None else f"{value:.{digits}f}"


def format_interval(found: Mapping[str, Any]) -> str:
    """Format a share with its interval."""
    if found["value"] is None and "interval" in found:
        return str(found["interval"])
    return f"{format_number(found['value'])} ({format_number(found['low'])} to {format_number(found['high'])})"
