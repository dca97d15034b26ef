"""Figures of model and recorded distributions of every target, side by side.

``motion_comparison.py --pictures`` draws them: one of people (held half) and one of animals, a panel a feature. Dots
are clips, bars their 10, 50 and 90 % quantiles, of three clips or more. Misread clips are not drawn.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from motion_comparison import HORSE, is_misread

from doppelgait.viz.style import BLUE, VERMILLION

TUNING, HELD = "tuning", "held"
"""Halves of people; those of animals are names of data sets."""
GROUPS = {HELD: "people", "MANN": "tuning dog", "Tencent": "held-out dog", HORSE: "horse"}
FEWEST_CLIPS = 3
COLOURS = {"recorded": BLUE, "model": VERMILLION}
LABELS = {
    "forward_envelope": "forward envelope, range / speed", "backward_envelope": "backward envelope, range / speed",
    "torso_ripple_gait": "torso ripple at gait freq. / speed", "torso_ripple": "torso ripple / speed",
    "bandwidth": "Doppler bandwidth / speed", "limb_torso_ratio": "limb-torso ratio",
    "alternate_steps": "autocorrelation, alternate steps", "stance_share": "power of standing feet (share)",
    "gait_frequency_hz": "gait frequency (Hz)", "step_length_m": "step length (m)",
    "duty_factor": "duty factor (of the motion)",
    "step_time_sd": "step time, relative sd", "step_length_sd": "step length, relative sd",
    "time_asymmetry": "step time, left minus right", "length_asymmetry": "step length, left minus right",
}  # fmt: skip
"""Speeds are over the mean speed of the body; differences of steps over the mean of the steps."""
LIMITS = {"alternate_steps": (-1.0, 2.0)}
"""Axes that a few clips would stretch; what lies beyond is counted in the panel."""
WIDTH_INCHES, ROW_INCHES, DPI = 9.6, 2.3, 100
WIDE = 4
"""Targets from which a figure has two columns, not three."""


def draw(rows: pd.DataFrame, targets: list[tuple[str, str]]) -> Figure:
    """Draw the distributions of some targets, each a half and a gait."""
    names = [name for name in LABELS if name in rows and rows[name].notna().any()]
    columns = 2 if len(targets) >= WIDE else 3
    lines = -(-len(names) // columns)
    figure = Figure(figsize=(WIDTH_INCHES, ROW_INCHES * lines), dpi=DPI, layout="constrained")
    rng = np.random.default_rng(0)
    for number, name in enumerate(names):
        axes = figure.add_subplot(lines, columns, number + 1)
        axes.set_title(LABELS[name], fontsize=12)
        for place, (half, target) in enumerate(targets):
            for side, (source, colour) in zip((-0.2, 0.2), COLOURS.items(), strict=True):
                chosen = (rows["mover"] == target) & (rows["half"] == half) & (rows["source"] == source)
                values = rows.loc[chosen, name].astype(float).dropna().to_numpy()
                x = place + side + rng.uniform(-0.09, 0.09, values.size)
                lowest, highest = LIMITS.get(name, (-np.inf, np.inf))
                dots = np.where((values >= lowest) & (values <= highest), values, np.nan)
                axes.plot(x, dots, ".", color=colour, alpha=0.6, markersize=6, markeredgewidth=0)
                if values.size < FEWEST_CLIPS:
                    continue
                low, middle, high = np.quantile(values, (0.1, 0.5, 0.9))
                axes.vlines(place + side, low, high, color=colour, linewidth=1.4)
                axes.hlines(middle, place + side - 0.16, place + side + 0.16, color=colour, linewidth=2.4)
        shown = [target.removeprefix(f"{HORSE} ").replace("/", "/\n") for _, target in targets]
        axes.set_xticks(range(len(targets)), shown, fontsize=11)
        axes.set_xlim(-0.5, len(targets) - 0.5)
        axes.tick_params(axis="y", labelsize=10)
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
        if name in LIMITS:
            low, high = LIMITS[name]
            axes.set_ylim(low, high)
            if beyond := int((~rows[name].astype(float).dropna().between(low, high)).sum()):
                axes.text(0.98, 0.04, f"{beyond} beyond the axis", transform=axes.transAxes, ha="right", fontsize=10)
        _name_groups(axes, [half for half, _ in targets])
    for source, colour in COLOURS.items():
        figure.axes[0].plot([], [], ".", color=colour, label=source, markersize=10)
    figure.legend(fontsize=12, loc="outside upper center", ncols=2, frameon=False, handletextpad=0.1)
    return figure


def _name_groups(axes: Axes, halves: list[str]) -> None:
    """Part the targets of different groups by lines and name the groups."""
    edges = [0, *(k for k, (a, b) in enumerate(pairwise(halves), 1) if a != b), len(halves)]
    if len(edges) == 2:
        return
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.16 * (high - low))
    for first, last in pairwise(edges):
        middle = (first + last - 1) / 2
        axes.text(middle, high + 0.04 * (high - low), GROUPS[halves[first]], ha="center", fontsize=10)
        if last < len(halves):
            axes.axvline(last - 0.5, color="#bbbbbb", linewidth=0.8)


def select(rows: pd.DataFrame) -> dict[str, tuple[pd.DataFrame, list[tuple[str, str]]]]:
    """Split rows into figures: people who were not used for the curves, and all recorded animals."""
    rows = rows[~is_misread(rows)]
    of_people = rows["half"].isin((TUNING, HELD))
    parts = {"people": rows[of_people & (rows["half"] == HELD)], "animals": rows[~of_people]}
    found = {}
    for title, part in parts.items():
        kinds = part[["half", "mover"]].drop_duplicates().itertuples(index=False)
        targets = sorted(((kind.half, kind.mover) for kind in kinds), key=lambda kind: list(GROUPS).index(kind[0]))
        if targets:
            found[title] = (part, targets)
    return found


def draw_all(rows: pd.DataFrame, folder: Path) -> None:
    """Write one figure a kind of targets."""
    folder.mkdir(parents=True, exist_ok=True)
    for title, (part, targets) in select(rows).items():
        draw(part, targets).savefig(folder / f"motion-{title}.png", metadata={"Software": None})
