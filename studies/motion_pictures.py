"""Model and recorded distributions of every mover side by side: the figures of docs/motion.md.

    python studies/motion_pictures.py ROWS.csv FOLDER

ROWS.csv is what ``motion_comparison.py --out`` writes. One figure of people (held half) and one of animals, of the
movers that are there: a panel a feature, dots are clips, bars their 10, 50 and 90 % quantiles.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

TUNING, HELD = "tuning", "held"
"""Halves of people; those of animals are names of data sets."""
FEWEST_CLIPS = 3
COLOURS = {"recorded": "#444444", "model": "#d95f02"}
LABELS = {
    "forward_envelope": "forward envelope\nrange over V", "backward_envelope": "backward envelope\nrange over V",
    "torso_ripple_gait": "torso ripple\nat f_mu over V", "torso_ripple": "torso ripple\nover V",
    "bandwidth": "B_mu over V", "limb_torso_ratio": "rho", "alternate_steps": "alternate steps\nalike",
    "stance_share": "power of\nstanding feet", "gait_frequency_hz": "f_mu, Hz", "step_length_m": "step length, m",
    "step_time_sd": "sd of step time", "step_length_sd": "sd of step length",
    "time_asymmetry": "left less right, time", "length_asymmetry": "left less right, length",
}  # fmt: skip
LEAST_INCHES, INCHES_A_MOVER, ROW_INCHES = 2.2, 0.65, 1.7
DPI = 80


def draw(rows: pd.DataFrame, movers: list[str]) -> Figure:
    """Draw the distributions of some movers."""
    names = [name for name in LABELS if name in rows and rows[name].notna().any()]
    columns = 4
    lines = -(-len(names) // columns)
    width = columns * max(LEAST_INCHES, INCHES_A_MOVER * len(movers) + 0.5)
    figure = Figure(figsize=(width, ROW_INCHES * lines), dpi=DPI, layout="constrained")
    rng = np.random.default_rng(0)
    for number, name in enumerate(names):
        axes = figure.add_subplot(lines, columns, number + 1)
        axes.set_title(LABELS[name].replace("\n", " "), fontsize=8)
        for place, mover in enumerate(movers):
            for side, (source, colour) in zip((-0.2, 0.2), COLOURS.items(), strict=True):
                chosen = (rows["mover"] == mover) & (rows["source"] == source)
                values = rows.loc[chosen, name].astype(float).dropna().to_numpy()
                if values.size < FEWEST_CLIPS:
                    continue
                x = place + side + rng.uniform(-0.09, 0.09, values.size)
                axes.plot(x, values, ".", color=colour, alpha=0.6, markersize=5, markeredgewidth=0)
                low, middle, high = np.quantile(values, (0.1, 0.5, 0.9))
                axes.vlines(place + side, low, high, color=colour, linewidth=1.2)
                axes.hlines(middle, place + side - 0.16, place + side + 0.16, color=colour, linewidth=2)
        axes.set_xticks(range(len(movers)), movers, fontsize=8)
        axes.set_xlim(-0.5, len(movers) - 0.5)
        axes.tick_params(axis="y", labelsize=7)
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    for source, colour in COLOURS.items():
        figure.axes[0].plot([], [], ".", color=colour, label=source)
    figure.axes[0].legend(fontsize=7, loc="lower left", frameon=False, handletextpad=0.1)
    return figure


def select(rows: pd.DataFrame) -> dict[str, tuple[pd.DataFrame, list[str]]]:
    """Split rows into figures: people who were not used for the curves, and all recorded animals."""
    of_people = rows["half"].isin((TUNING, HELD))
    parts = {"people": rows[of_people & (rows["half"] == HELD)], "animals": rows[~of_people]}
    found = {}
    for title, part in parts.items():
        counts = part[part["source"] == "recorded"]["mover"].value_counts(sort=False)
        movers = [str(mover) for mover, count in counts.items() if count >= FEWEST_CLIPS]
        if movers:
            found[title] = (part, movers)
    return found


def main() -> None:
    """Write one figure a kind of movers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", type=Path)
    parser.add_argument("folder", type=Path)
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    for title, (part, movers) in select(pd.read_csv(arguments.rows)).items():
        file = arguments.folder / f"motion-{title}.png"
        draw(part, movers).savefig(file, metadata={"Software": None})
        print(file)


if __name__ == "__main__":
    main()
