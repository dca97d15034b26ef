"""Figures of the report of ``evaluate``: lines that can be distinguished."""

from typing import Any

import numpy as np
from matplotlib.colors import to_rgb

from doppelgait.classify.report import plot_reliability, plot_roc
from doppelgait.viz.style import SERIES_COLOURS


def test_the_line_of_95_percent_has_no_colour_of_a_model() -> None:
    def curve(*, baseline: bool) -> dict[str, Any]:
        return {"kind": {"baseline": baseline}, "roc": {"dog": {"auc": 0.9, "false": [0, 1], "true": [0, 1]}}}

    models = {"chance": curve(baseline=True)}
    models |= {f"model {number}": curve(baseline=False) for number in range(len(SERIES_COLOURS))}
    lines = plot_roc({"models": models}, "dog").axes[0].get_lines()
    (mark,) = [line for line in lines if line.get_label() == "95 % detected"]
    for line in lines:
        if line is not mark:
            assert np.linalg.norm(np.subtract(to_rgb(line.get_color()), to_rgb(mark.get_color()))) > 0.4, line
    assert mark.get_linestyle() == ":"


def test_the_legend_of_the_calibration_diagram_states_the_rows_of_a_bin() -> None:
    bins = [{"confidence": 0.6, "accuracy": 0.5, "n": 11}, {"confidence": 0.9, "accuracy": 1.0, "n": 12}]
    model = {"kind": {"baseline": False}, "brier": 0.1, "expected_calibration_error": 0.02, "reliability": bins}
    (axes,) = plot_reliability({"classes": ["dog", "human"], "models": {"m": model}}).axes
    labels = [line.get_label() for line in axes.get_lines()]
    assert labels == ["calibrated", "m: 11 to 12 rows a bin, calibration error 0.020, Brier score 0.100"]
