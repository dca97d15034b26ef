"""Report of an evaluation: figures, tables and page."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from html import escape
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
CONFIDENCE_LABEL, CORRECT_LABEL = "confidence", "share of correct rows"
ALONE = "the only class present"

Document = Mapping[str, Any]


def make_figures(document: Document) -> Iterator[tuple[str, str, Figure]]:
    """Yield name, caption and figure, one after the other."""
    yield "scores", "Balanced accuracy of every model with its 95 % interval.", score_bars(document)
    words = "Number of rows by true and by predicted class; the colour is the share of the true class."
    yield "confusion", words, plot_confusion(document)
    for name in next(iter(document["models"].values()))["roc"]:
        file_name = "".join(c if c.isalnum() else "-" for c in name)
        words = f"{name} against all others: share detected against share falsely detected."
        yield f"roc-{file_name}", words, plot_roc(document, name)
    words = (
        "Share of correct rows against confidence; calibrated probabilities lie on the diagonal. The larger the dot, "
        "the more rows."
    )
    yield "reliability", words, plot_reliability(document)
    if any(model.get("adaptation") for model in document["models"].values()):
        words = "Accuracy by own recordings (band: 80 % of the draws), and calibration before and after."
        yield "adaptation", words, plot_adaptation(document)
    for condition in document["conditions"]:
        quantity = document["conditions"][condition]["words"]
        words = f"Balanced accuracy by {quantity}, with 95 % intervals; n: rows. Hollow: recall of {ALONE}."
        yield f"accuracy-{condition}", words, plot_condition(document, condition)
    for name, model in document["models"].items():
        if model["importance"] and not model["kind"]["baseline"]:
            words = f"{name}: increase of the log loss when a feature is shuffled."
            yield f"importance-{name}", words, plot_importance(name, model["importance"])


def _choose_line_styles(document: Document) -> dict[str, dict[str, Any]]:
    trained = [name for name, model in document["models"].items() if not model["kind"]["baseline"]]
    looks: dict[str, dict[str, Any]] = {
        name: {"color": BASELINE_COLOUR, "linestyle": style} for name, style in BASELINE_STYLES.items()
    }
    for number, name in enumerate(trained):
        looks[name] = {"color": SERIES_COLOURS[number % len(SERIES_COLOURS)], "linestyle": "-"}
    return looks


def score_bars(document: Document) -> Figure:
    """Plot the balanced accuracy of every model with its interval."""
    looks, models = _choose_line_styles(document), document["models"]
    figure, axes = make_axes(width_in=8.0, height_in=1.2 + 0.42 * len(models))
    for place, (name, model) in enumerate(reversed(models.items())):
        found = model["balanced_accuracy"]
        if found["value"] is None:
            _plot_hollow(
                axes, [(share["value"], place) for share in _select_known_shares(model["recall"])], looks[name]["color"]
            )
            continue
        spread = [[found["value"] - found["low"]], [found["high"] - found["value"]]]
        axes.errorbar([found["value"]], [place], xerr=spread, fmt="o", color=looks[name]["color"], lw=2.0, capsize=4)
    axes.set_yticks(range(len(models)), labels=list(reversed(models)))
    axes.errorbar([], [], xerr=[], fmt="o", color="black", lw=2.0, capsize=4, label="value and 95 % interval")
    axes.axvline(1.0 / len(document["classes"]), color="black", ls=":", lw=1.0, label="chance")
    if any(model["balanced_accuracy"]["value"] is None for model in models.values()):
        axes.plot([], [], "D", mfc="none", color="black", label=f"recall of {ALONE}")
    axes.set(xlim=(0.0, 1.02), ylim=(-0.6, len(models) - 0.4))
    draw_grid(axes)
    name_axes(axes, title="Balanced accuracy of every model", x="balanced accuracy", y="")
    place_legend(axes)
    return figure


def _select_known_shares(recall: Mapping[str, Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    return [share for share in recall.values() if share["value"] is not None]


def _plot_hollow(axes: Axes, points: Sequence[tuple[float, float]], colour: str) -> None:
    """Plot recalls as hollow markers, because they are not balanced accuracies."""
    for x, y in points:
        axes.plot([x], [y], "D", mfc="none", color=colour, ms=6)


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
    draw_grid(axes)
    name_axes(
        axes,
        title=f"{label} against all other classes",
        x="share of the other classes, falsely detected",
        y=f"share of {label}, detected",
    )
    place_legend(axes, columns=2)
    return figure


def plot_reliability(document: Document) -> Figure:
    """Plot accuracy against confidence of all models but the baselines."""
    looks = _choose_line_styles(document)
    figure, axes = make_axes(width_in=7.0, height_in=6.0)
    lowest = 1.0 / len(document["classes"])
    axes.plot([lowest, 1.0], [lowest, 1.0], color="black", ls=":", lw=1.0, label="calibrated")
    for name, model in document["models"].items():
        if model["kind"]["baseline"]:
            continue
        bins = model["reliability"]
        x, y = ([entry[key] for entry in bins] for key in ("confidence", "accuracy"))
        error, brier = model["expected_calibration_error"], model["brier"]
        text = f"{name}: calibration error {error:.3f}, Brier score {brier:.3f}"
        axes.plot(x, y, lw=1.4, label=text, **looks[name])
        axes.scatter(x, y, s=[20.0 + 200.0 * entry["share"] for entry in bins], color=looks[name]["color"], alpha=0.7)
    draw_grid(axes)
    name_axes(axes, title="Calibration", x=CONFIDENCE_LABEL, y=CORRECT_LABEL)
    place_legend(axes, columns=1)
    return figure


def plot_adaptation(document: Document) -> Figure:
    """Plot accuracy against own recordings, and calibration before and after."""
    looks = _choose_line_styles(document)
    figure = make_figure(width_in=12.0, height_in=5.0)
    axes, calibrated = figure.subplots(1, 2)
    shown = {name: model["adaptation"] for name, model in document["models"].items() if model.get("adaptation")}
    for name, points in shown.items():
        counts, low, high = (np.array([point[key] for point in points]) for key in ("n", "low", "high"))
        axes.plot(counts, [point["balanced_accuracy"] for point in points], marker="o", label=name, **looks[name])
        axes.fill_between(counts, low, high, color=looks[name]["color"], alpha=0.12, lw=0)
        axes.plot(counts, [point["unlabelled"] for point in points], color=looks[name]["color"], ls=":")
    axes.plot([], [], color="black", ls=":", label="without labels")
    best = document["kept"] if document["kept"] in shown else next(iter(shown))
    lowest = 1.0 / len(document["classes"])
    calibrated.plot([lowest, 1.0], [lowest, 1.0], color="black", ls=":", lw=1.0, label="calibrated")
    for point, colour in zip((shown[best][0], shown[best][-1]), SERIES_COLOURS, strict=False):
        x, y = ([entry[key] for entry in point["reliability"]] for key in ("confidence", "accuracy"))
        error = point["expected_calibration_error"]
        calibrated.plot(
            x, y, marker="o", color=colour, label=f"{point['n']} own recordings: calibration error {error:.3f}"
        )
    axes.fill_between([], [], [], color="black", alpha=0.12, lw=0, label="80 % of the draws")
    name_axes(axes, title="Adaptation", x="own recordings of each class", y="balanced accuracy")
    name_axes(calibrated, title=f"Calibration of {best}", x=CONFIDENCE_LABEL, y=CORRECT_LABEL)
    for panel in (axes, calibrated):
        draw_grid(panel)
        place_legend(panel, "panel", columns=2)
    return figure


def plot_condition(document: Document, condition: str) -> Figure:
    """Plot balanced accuracy in bins of a condition."""
    looks, facts = _choose_line_styles(document), document["conditions"][condition]
    figure, axes = make_axes(width_in=9.0, height_in=5.0)
    count = len(facts["models"])
    for number, (name, bins) in enumerate(facts["models"].items()):
        step = bins[0]["to"] - bins[0]["from"]
        shift = step * (number - (count - 1) / 2.0) * 0.5 / max(count, 1)
        middle = {id(entry): (entry["from"] + entry["to"]) / 2.0 + shift for entry in bins}
        whole = [entry for entry in bins if entry["value"] is not None]
        for entry in bins:
            if entry["value"] is None:
                shares = [(middle[id(entry)], share["value"]) for share in _select_known_shares(entry["recall"])]
                _plot_hollow(axes, shares, looks[name]["color"])
        x, y = np.array([middle[id(entry)] for entry in whole]), np.array([entry["value"] for entry in whole])
        spread = np.abs(np.array([[entry["low"], entry["high"]] for entry in whole]).reshape(-1, 2).T - y)
        axes.errorbar(x, y, yerr=spread, lw=1.4, elinewidth=0.8, capsize=2, marker="o", ms=4, label=name, **looks[name])
    for entry in next(iter(facts["models"].values())):
        axes.text((entry["from"] + entry["to"]) / 2.0, -0.09, f"n = {entry['n']}", fontsize=8, ha="center")
    axes.set_ylim(-0.12, 1.05)
    draw_grid(axes)
    name_axes(axes, title=f"Accuracy by {facts['words'].rpartition(' (')[0]}", x=facts["words"], y="balanced accuracy")
    place_legend(axes, columns=4)
    return figure


def plot_importance(name: str, importance: Mapping[str, float]) -> Figure:
    """Plot the most important features."""
    shown = list(importance.items())[:MOST_FEATURES]
    figure, axes = make_axes(width_in=8.0, height_in=1.2 + 0.28 * len(shown))
    words: Callable[[str], str] = lambda text: label_quantity(text.removeprefix("extended_"))  # noqa: E731
    axes.barh([words(key) for key, _ in reversed(shown)], [value for _, value in reversed(shown)], color=BLUE)
    draw_grid(axes)
    name_axes(axes, title=f"Most important features, {name}", x="increase of the log loss (nat)", y="")
    return figure


FORMAT, FORMAT_VERSION = "doppelgait-evaluation", 1
LISTING = "report.json"

ADAPTATION_TEXT = (
    "<h2>Adapted to own recordings</h2><p>Balanced accuracy and expected calibration error on targets of which no "
    "recording was used, after so many recordings of each class were: mean of 50 draws, 80 % of them lie within the "
    "range. The scored targets depend on the count: compare with the score of the same targets before. Without "
    "labels: the same recordings without their classes, assuming that "
    "the classes are as frequent as each other among them. A saved model is adapted to all of them.</p>"
)
UNKNOWN_TEXT = (
    "<h2>Kinds outside the training data</h2><p>Kinds outside the training data, for which no class is correct: how "
    "well the distance from these data, and the lack of certainty, separate them from the tested rows (area under the "
    "ROC curve, 0.5: not at all), and the share with a decision for a class.</p>"
)
ALARM_TEXT = (
    "<h2>As an alarm</h2><p>Share of every class that triggers where the threshold is set for 95 % of its class: by "
    "the rows held back for calibration, as in use, and read off the ROC curve of the tested rows.</p>"
)


def check_folder(folder: Path) -> Path:
    """Check the folder of a report without creating anything."""
    check_out(folder, listing=LISTING, file_format=FORMAT, command="evaluate")
    return folder


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

    See Also
    --------
    evaluate : train and score the models.

    Examples
    --------
    >>> import doppelgait as dg
    >>> plan, folder = dg.dataset.load_plan("home-alarm", overrides=["dataset.examples_per_class=8"])
    >>> report = dg.dataset.build_dataset(plan, "tiny", executor="serial")
    >>> found = dg.classify.evaluate(dg.open_dataset("tiny"), models=["six-logistic"])
    >>> dg.classify.write_report(found, "report")[-1].name
    'index.html'
    """
    from doppelgait.viz import save_figure

    target, document = check_folder(Path(folder)), found.document
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
        listing = {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "files": sorted([*texts, *dict(pictures), *vectors]),
        }
        texts[LISTING] = json.dumps(listing, indent=1) + "\n"
        texts[PAGE] = make_page(document, pictures)
        for name, text in texts.items():
            (partial / name).write_text(text, encoding="utf-8", newline="\n")
    return [target / name for name in [*(name for name, _ in pictures), *vectors, *texts]]


def make_page(document: Mapping[str, Any], pictures: Sequence[tuple[str, str]]) -> str:
    """Format the page as HTML."""
    data, other = document["dataset"], document["test_dataset"]
    tested = ", ".join(f"{count} {name}" for name, count in document["tested"].items())
    rows = []
    for fold in document["folds"]:
        words = {key: f"{fold[key]['n']} of {fold[key]['movers']} targets" for key in ("train", "held", "test")}
        rows.append({"fold": fold["name"], **words})
    plans = []
    for facts, role in ((data, "trained on"), (other, "tested on")):
        if facts is not None:
            name, identity = escape(str(facts["name"])), escape(str(facts["id"]))
            plans.append(f"<h2>Plan, {role}: {name}, id {identity}</h2>")
            if facts["config"] is None:
                plans[-1] += f"<p>It has no plan ({escape(facts['origin'])}).</p>"
            else:
                plans[-1] += f"<pre>{escape(json.dumps(facts['config'], indent=1))}</pre>"
    # Show details of the best model, or of the first trained model if no model is the best.
    trained = [name for name, model in document["models"].items() if not model["kind"]["baseline"]]
    best, details = str(document["kept"] or trained[0]), []
    for column, models in document["breakdowns"].items():
        shares = [
            {
                column: entry["value"],
                "is": entry["label"],
                "rows": entry["n"],
                "targets": entry["movers"],
                "share right": f"{format_number(entry['share_value'])} ({format_number(entry['low'])} to "
                f"{format_number(entry['high'])})",
            }
            for entry in models[best]
        ]
        details += [f"<h2>{escape(best)} by {escape(column)}</h2>", format_table(shares)]
    baselines = {name for name, model in document["models"].items() if model["kind"]["baseline"]}
    alarms, own = format_alarm_table(document), format_adaptation_table(document)
    strangers = format_unknown_table(document)
    parts = [
        f"<h1>{escape(str(data['name']))}: classification</h1>",
        f"<p>Trained on {_describe(data)}; tested on {_describe(other) if other else 'rows of it'}: {escape(tested)}. "
        f"No tested target is in the training data. doppelgait {escape(document['doppelgait_version'])}, seed "
        f"{document['seed']}.</p>",
        *(f'<p class="note">{escape(note)}</p>' for note in document["notes"]),
        format_table(
            [{str(key): text for key, text in row.items()} for row in score_table(document)],
            grey=baselines,
        ),
        "<p>Balanced accuracy with its 95 % interval over targets (bootstrap; exact where there are few targets or no "
        "errors). <i>Decided</i>: rows that the model does not abstain from, and its balanced accuracy among them. "
        "Grey: baselines: the most frequent class (chance); the parameters that must not "
        "predict the class (nuisance); the speed alone.</p>",
        *([ALARM_TEXT, format_table(alarms, grey=baselines)] if alarms else []),
        *_format_day_parts(document),
        *([ADAPTATION_TEXT, format_table(own)] if own else []),
        *([UNKNOWN_TEXT, format_table(strangers)] if strangers else []),
        *(format_figure(name, words) for name, words in pictures),
        *details,
        "<h2>Training and test data</h2>",
        format_table(rows),
        *plans,
    ]
    return format_page(f"{data['name']}: classification", parts)


def _format_day_parts(document: Mapping[str, Any]) -> list[str]:
    """Format the alarm over a day; empty without one."""
    found = document.get("alarm_day")
    if found is None:
        return []
    words = (
        f"<h2>The alarm over a day: {escape(found['day'])}</h2><p>{escape(found['model'])} triggers for "
        f"{escape(found['alarm'])}. False triggers with intervals of 95 % (weighted Poisson counts), over simulated "
        f"episodes, {found['repeats']} of each kind; missed: episodes that should trigger and do not; time from the "
        "start of an episode.</p>"
    )
    return [words, format_table(format_day(found)), format_table(format_episodes(found))]


def _describe(facts: Mapping[str, Any]) -> str:
    name, identity = escape(str(facts["name"])), escape(str(facts["id"]))
    return f"{name} ({facts['n_rows']} rows, {escape(facts['origin'])}, id {identity})"


def list_tables(document: Mapping[str, Any]) -> list[list[dict[str, str]]]:
    """List the tables of an evaluation for a terminal."""
    day = document.get("alarm_day")
    tables = [
        score_table(document),
        format_alarm_table(document),
        format_adaptation_table(document),
        format_unknown_table(document),
        *([] if day is None else [format_day(day), format_episodes(day)]),
    ]
    return [rows for rows in tables if rows]


def score_table(document: Mapping[str, Any]) -> list[dict[str, str]]:
    """Format a row of scores per model."""
    rows = []
    for name, model in document["models"].items():
        found, decided = model["balanced_accuracy"], model["decided"]
        curves = [curve["auc"] for curve in model["roc"].values() if curve["auc"] is not None]
        rows.append(
            {
                "model": name,
                "balanced accuracy": format_interval(found),
                **({"over seeds": _format_over_seeds(model.get("seeds"))} if document.get("n_seeds", 1) > 1 else {}),
                **{f"recall {label}": format_number(share["value"]) for label, share in model["recall"].items()},
                "AUC": format_number(sum(curves) / len(curves) if curves else None),
                "Brier": format_number(model["brier"]),
                "ECE": format_number(model["expected_calibration_error"]),
                "decided": ": ".join(
                    [format_number(decided["share"], 2), format_number(decided["balanced_accuracy"]["value"])]
                ),
            }
        )
    return rows


def _format_over_seeds(values: Sequence[float | None] | None) -> str:
    known = [value for value in values or () if value is not None]
    if len(set(known)) == 1 < len(known):
        return f"{known[0]:.3f} (no draw in it)"
    return f"{np.mean(known):.3f} ({min(known):.3f} to {max(known):.3f})" if known else "-"


def format_alarm_table(document: Mapping[str, Any]) -> list[dict[str, str]]:
    """Format the alarm rates of every class, by model."""
    rows = []
    for name, model in document["models"].items():
        alarm = model["alarm"]
        for kind, words in (("held", "held rows"), ("curve", "its own curve")):
            if alarm is not None and kind in alarm:
                shares = {label: format_interval(share) for label, share in alarm[kind].items()}
                rows.append({"model": name, "threshold from": words, **shares})
    return rows


def format_adaptation_table(document: Mapping[str, Any]) -> list[dict[str, str]]:
    """Format scores by number of own recordings; empty without any."""
    rows = []
    for name, model in document["models"].items():
        for point in model.get("adaptation", []):
            span = f"{format_number(point['low'])} to {format_number(point['high'])}"
            rows.append(
                {
                    "model": name,
                    "own recordings of a class": str(point["n"]),
                    "balanced accuracy": f"{format_number(point['balanced_accuracy'])} ({span})",
                    "same targets before": format_number(point["before"]),
                    "without labels": format_number(point["unlabelled"]),
                    "targets": f"{point['movers']:.0f}",
                    "ECE": format_number(point["expected_calibration_error"]),
                }
            )
    return rows


def format_unknown_table(document: Mapping[str, Any]) -> list[dict[str, str]]:
    """Format the abstention from unknown kinds; empty without any."""
    rows = []
    for name, model in document["models"].items():
        for label, found in model.get("unknown", {}).items():
            called = {f"called {other}": format_number(share) for other, share in found["decided"].items()}
            areas = {
                "AUC of the distance": format_number(found["auc"]),
                "AUC of doubt": format_number(found["auc_of_probability"]),
            }
            rows.append({"model": name, "kind": label, "rows": str(found["n"]), **areas, **called})
    return rows


def format_number(value: float | None, digits: int = 3) -> str:
    """Format a share; ``-`` for None."""
    return "-" if value is None else f"{value:.{digits}f}"


def format_interval(found: Mapping[str, Any]) -> str:
    """Format a share with its interval."""
    if found["value"] is None and "interval" in found:
        return str(found["interval"])
    return f"{format_number(found['value'])} ({format_number(found['low'])} to {format_number(found['high'])})"
