"""How the time of a stage grows with scatterers, observation time, range bins and gate width.

The walk is slower than in scenario S, so that 10 s of it stay within the frame.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from clock import Timing, Work, measure
from scenario import DURATION_S, N_SCATTERERS, fill_planes, make_radar, new_planes, prepare, walking_scene

from doppelgait.core.samples import Samples
from doppelgait.processing import Analysis
from doppelgait.radar import add_noise, synthesise

SPEED_MPS = 0.6
STAGES = ("synthesis, planes", "synthesis, matrix", "signature, hop 1", "noise, matrix")
AXES: dict[str, tuple[Any, ...]] = {
    "scatterers": (17, 41, 70, 140),
    "seconds": (2.5, 5.0, 10.0),
    "range bins": (8, 4, 2, 1),
    "gate, m": (0.5, 1.0, 2.0, 4.0),
}
"""What varies, and its values; range bins are given as the decimation."""
QUICK_AXES: dict[str, tuple[Any, ...]] = {
    "scatterers": (17, 70),
    "seconds": (2.5, 5.0),
    "range bins": (8, 4),
    "gate, m": (1.0, 2.0),
}
GROWS = {
    "scatterers": STAGES[:2],
    "seconds": STAGES,
    "range bins": STAGES,
    "gate, m": STAGES[2:3],
}
"""Stages whose time should follow; that of the others should not."""


def measure_growth(axes: dict[str, tuple[Any, ...]], rounds: int) -> list[dict[str, Any]]:
    """One row for every axis, value and stage: size, least and median seconds, and seconds per unit of size."""
    work: dict[tuple[str, Any, str], Work] = {}
    sizes: dict[tuple[str, Any], float] = {}
    for axis, values in axes.items():
        for value in values:
            sizes[axis, value], stages = make_case(axis, value)
            work |= {(axis, value, stage): call for stage, call in stages.items()}
    names = {" ".join(map(str, key)): key for key in work}
    seconds = measure({name: work[key] for name, key in names.items()}, rounds)
    return [make_row(names[name], sizes[names[name][:2]], seconds[name]) for name in names]


def make_row(key: tuple[str, Any, str], size: float, seconds: Timing) -> dict[str, Any]:
    """One measured point."""
    axis, value, stage = key
    per_unit = {kind: second / size for kind, second in seconds.items()} if stage in GROWS[axis] else None
    return {"axis": axis, "value": value, "size": size, "stage": stage, "seconds": seconds, "per_unit": per_unit}


def make_case(axis: str, value: Any) -> tuple[float, dict[str, Work]]:
    """Return the size of a case along its axis, and its stages.

    What does not vary is as in scenario S.
    """
    n_scatterers = value if axis == "scatterers" else N_SCATTERERS
    scene = walking_scene(n_scatterers, value if axis == "seconds" else DURATION_S, SPEED_MPS)
    radar = make_radar(value if axis == "range bins" else 8)
    analysis = Analysis(doppler_bins=128, hop=1, gate_span_m=value if axis == "gate, m" else 1.0)
    case = prepare(radar, scene, analysis)
    planes, clean, cut = new_planes(case), synthesise(case.table, radar), case.cut(1)
    fill_planes(case, planes)
    samples = Samples.from_planes(planes, case.slow_time_s.size)
    stages = {
        "synthesis, planes": lambda: fill_planes(case, planes),
        "synthesis, matrix": lambda: synthesise(case.table, radar),
        "signature, hop 1": lambda: cut.sum_power(samples),
        "noise, matrix": lambda: add_noise(clean, noise_power_v2=1e-12, rng=np.random.default_rng(1)),
    }
    return float(radar.n_range_bins if axis == "range bins" else value), stages
