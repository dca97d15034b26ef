"""Figures of an evaluation, drawn from its document alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from doppelgait.viz.style import ACCENT, legend_below, name_axes, new_axes, new_figure, quantity_label

MODEL_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#8c564b")
BASELINE_COLOUR = "#888888"
BASELINE_STYLES = {"chance": ":", "nuisance": "--", "speed": "-."}
MOST_FEATURES = 15
ALONE = "a class that is there alone"

Document = Mapping[str, Any]


def figures_of(document: Document) -> Iterator[tuple[str, str, Figure]]:
    """Name, words and figure, one after the other."""
    yield "scores", "Balanced accuracy of every model with its 95 % interval; dotted: chance.", score_bars(document)
    yield "confusion", "Rows by class and by what they were taken for.", confusion_maps(document)
    for name in next(iter(document["models"].values()))["roc"]:
        yield (
            f"roc-{''.join(c if c.isalnum() else '-' for c in name)}",
            f"{name} against all others: detected against falsely detected.",
            roc_curves(document, name),
        )
    yield (
        "reliability",
        "Confidence against the share that is right; on the diagonal probabilities are true.",
        (reliability_curves(document)),
    )
    for condition in document["conditions"]:
        words = document["conditions"][condition]["words"]
        yield (
            f"accuracy-{condition}",
            f"Balanced accuracy against {words}, with 95 % intervals; hollow: recall of {ALONE}.",
            condition_curves(document, condition),
        )
    for name, model in document["models"].items():
        if model["importance"] and not model["kind"]["baseline"]:
            yield (
                f"importance-{name}",
                f"{name}: rise of the log loss where a feature is shuffled.",
                importance_bars(name, model["importance"]),
            )


def _looks(document: Document) -> dict[str, dict[str, Any]]:
    """Colour and line of every model."""
    trained = [name for name, model in document["models"].items() if not model["kind"]["baseline"]]
    looks: dict[str, dict[str, Any]] = {
        name: {"color": BASELINE_COLOUR, "linestyle": style} for name, style in BASELINE_STYLES.items()
    }
    for number, name in enumerate(trained):
        looks[name] = {"color": MODEL_COLOURS[number % len(MODEL_COLOURS)], "linestyle": "-"}
    return looks


def score_bars(document: Document) -> Figure:
    """Balanced accuracy of every model as a dot with its interval."""
    looks, models = _looks(document), document["models"]
    figure, axes = new_axes(width_in=8.0, height_in=1.2 + 0.42 * len(models))
    for place, (name, model) in enumerate(reversed(models.items())):
        found = model["balanced_accuracy"]
        if found["value"] is None:
            _hollow(axes, [(share["value"], place) for share in _known(model["recall"])], looks[name]["color"])
            continue
        axes.plot([found["low"], found["high"]], [place, place], color=looks[name]["color"], lw=2.5)
        axes.plot([found["value"]], [place], "o", color=looks[name]["color"], ms=7)
    axes.set_yticks(range(len(models)), labels=list(reversed(models)))
    axes.axvline(1.0 / len(document["classes"]), color="black", ls=":", lw=1.0)
    axes.set_xlim(0.0, 1.02)
    _grid(axes)
    name_axes(axes, title="Balanced accuracy", x=f"balanced accuracy (hollow: recall of {ALONE})", y="")
    return figure


def _known(recall: Mapping[str, Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    return [share for share in recall.values() if share["value"] is not None]


def _hollow(axes: Axes, points: Sequence[tuple[float, float]], colour: str) -> None:
    """Recalls, which are no balanced accuracy."""
    for x, y in points:
        axes.plot([x], [y], "D", mfc="none", color=colour, ms=6)


def confusion_maps(document: Document) -> Figure:
    """One small table per model: share of each class taken for each class, and the number of rows."""
    models, classes = document["models"], document["classes"]
    across = min(4, len(models))
    down = -(-len(models) // across)
    side = max(2.4, 0.8 * len(classes) + 1.2)
    figure = new_figure(width_in=side * across, height_in=side * down)
    panels = list(figure.subplots(down, across, squeeze=False).flat)
    for axes, (name, model) in zip(panels, models.items(), strict=False):
        counts = np.asarray(model["confusion"], dtype=float)
        shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0)
        axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0)
        for row, column in np.ndindex(shares.shape):
            colour = "white" if shares[row, column] > 0.6 else "black"
            axes.text(column, row, f"{counts[row, column]:.0f}", ha="center", va="center", color=colour, fontsize=10)
        axes.set_xticks(range(len(classes)), labels=classes)
        axes.set_yticks(range(len(classes)), labels=classes)
        name_axes(axes, title=name, x="taken for", y="is")
    for axes in panels[len(models) :]:
        axes.set_visible(False)
    return figure


def roc_curves(document: Document, label: str) -> Figure:
    """Share of the class that is detected against share of the others that is, for every model."""
    looks = _looks(document)
    figure, axes = new_axes(width_in=7.0, height_in=6.0)
    for name, model in document["models"].items():
        curve = model["roc"][label]
        if curve["auc"] is not None:
            axes.plot(curve["false"], curve["true"], lw=1.8, label=f"{name}, AUC {curve['auc']:.3f}", **looks[name])
    axes.axhline(0.95, color=ACCENT, lw=0.8)
    axes.text(1.0, 0.945, "95 % detected", ha="right", va="top", fontsize=8.5, color=ACCENT)
    axes.set(xlim=(-0.01, 1.01), ylim=(-0.01, 1.01))
    _grid(axes)
    name_axes(axes, title=f"{label} against all others", x="share of the others", y=f"share of {label}")
    legend_below(figure, axes, columns=2)
    return figure


def reliability_curves(document: Document) -> Figure:
    """Share right against confidence of all models but the baselines, the size of a dot by its share of the rows."""
    looks = _looks(document)
    figure, axes = new_axes(width_in=7.0, height_in=6.0)
    lowest = 1.0 / len(document["classes"])
    axes.plot([lowest, 1.0], [lowest, 1.0], color="black", ls=":", lw=1.0)
    for name, model in document["models"].items():
        if model["kind"]["baseline"]:
            continue
        bins = model["reliability"]
        x, y = ([entry[key] for entry in bins] for key in ("confidence", "accuracy"))
        text = f"{name}, error {model['expected_calibration_error']:.3f}, Brier {model['brier']:.3f}"
        axes.plot(x, y, lw=1.4, label=text, **looks[name])
        axes.scatter(x, y, s=[20.0 + 200.0 * entry["share"] for entry in bins], color=looks[name]["color"], alpha=0.7)
    _grid(axes)
    name_axes(axes, title="Calibration", x="confidence", y="share that is right")
    legend_below(figure, axes, columns=1)
    return figure


def condition_curves(document: Document, condition: str) -> Figure:
    """Balanced accuracy in every bin of a condition, with intervals, and the number of rows in each."""
    looks, facts = _looks(document), document["conditions"][condition]
    figure, axes = new_axes(width_in=9.0, height_in=5.0)
    count = len(facts["models"])
    for number, (name, bins) in enumerate(facts["models"].items()):
        step = bins[0]["to"] - bins[0]["from"]
        shift = step * (number - (count - 1) / 2.0) * 0.5 / max(count, 1)
        middle = {id(entry): (entry["from"] + entry["to"]) / 2.0 + shift for entry in bins}
        whole = [entry for entry in bins if entry["value"] is not None]
        for entry in bins:
            if entry["value"] is None:
                shares = [(middle[id(entry)], share["value"]) for share in _known(entry["recall"])]
                _hollow(axes, shares, looks[name]["color"])
        x, y = np.array([middle[id(entry)] for entry in whole]), np.array([entry["value"] for entry in whole])
        spread = np.abs(np.array([[entry["low"], entry["high"]] for entry in whole]).reshape(-1, 2).T - y)
        axes.errorbar(x, y, yerr=spread, lw=1.4, elinewidth=0.8, marker="o", ms=4, label=name, **looks[name])
    for entry in next(iter(facts["models"].values())):
        axes.text((entry["from"] + entry["to"]) / 2.0, 0.01, f"n = {entry['n']}", fontsize=8, ha="center", va="bottom")
    axes.set_ylim(0.0, 1.03)
    _grid(axes)
    name_axes(axes, title=f"By {facts['column']}", x=facts["words"], y="balanced accuracy")
    legend_below(figure, axes, columns=4)
    return figure


def importance_bars(name: str, importance: Mapping[str, float]) -> Figure:
    """The features that count most."""
    shown = list(importance.items())[:MOST_FEATURES]
    figure, axes = new_axes(width_in=8.0, height_in=1.2 + 0.28 * len(shown))
    words: Callable[[str], str] = lambda text: quantity_label(text.removeprefix("extended_"))  # noqa: E731
    axes.barh([words(key) for key, _ in reversed(shown)], [value for _, value in reversed(shown)], color="#0072b2")
    _grid(axes)
    name_axes(axes, title=name, x="rise of the log loss (nats)", y="")
    return figure


def _grid(axes: Axes) -> None:
    axes.grid(color="#e0e0e0", lw=0.6)
    axes.set_axisbelow(True)


__all__: Sequence[str] = ["figures_of"]
