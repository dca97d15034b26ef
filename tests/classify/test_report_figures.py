"""Figures of the report of ``evaluate``: lines that can be distinguished."""

from typing import Any

import numpy as np
from matplotlib.colors import to_rgb

from doppelgait.classify.report import plot_roc
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
