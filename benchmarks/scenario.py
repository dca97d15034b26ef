"""Scenario S and its relatives: scene, radar, analysis, and what the stages start from.

Scenario S: 41 scatterers of a walking person, 5 s at 1000 Hz, X4 decimated to 187 bins, M = 101, K = 128, gate 1.0 m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from doppelgait._core import native
from doppelgait.core.frames import SlowTime
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.motion import make_motion
from doppelgait.motion.models import boulic_walk
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.signature import GatedTransform, make_gated_transform
from doppelgait.radar import Radar
from doppelgait.radar.link import compute_scatterer_arrays
from doppelgait.radar.waveforms.pulses import ROW_MULTIPLE
from doppelgait.scene import Scene, Target, assemble, compute_body_track, place

N_SCATTERERS = 41
DURATION_S = 5.0
SPEED_MPS = 1.2
RANGE_STOP_M = 9.6
N_MARKERS = 17
"""Points of the walker's own; further scatterers lie half-way between two of them."""


@dataclass(frozen=True)
class Case:
    """One scenario with everything that stages before the measured one would give."""

    radar: Radar
    scene: Scene
    analysis: Analysis
    slow_time_s: Any
    table: xr.Dataset
    gate: xr.Dataset
    range_m: Any
    amplitude_v: Any

    def cut(self, hop: int | None) -> GatedTransform:
        """Gate and transform at a hop; None is the lossless one."""
        settings = self.analysis.model_copy(update={"hop": hop})
        return make_gated_transform(self.gate, SlowTime(self.slow_time_s), self.radar.range_axis_m(), settings)


def walking_scene(n_scatterers: int, duration_s: float, speed_mps: float) -> Scene:
    """Make a person of ``n_scatterers`` points who walks towards the radar."""
    walk = boulic_walk(speed_mps=speed_mps, height_m=1.75, duration_s=duration_s)
    pairs = [(a, b) for a in range(N_MARKERS) for b in range(a + 1, N_MARKERS)][: n_scatterers - N_MARKERS]
    between = [(walk.position_m[:, a] + walk.position_m[:, b]) / 2 for a, b in pairs]
    dense = make_motion(
        np.concatenate([walk.position_m, *(points[:, None] for points in between)], axis=1),
        rate_hz=walk.rate_hz,
        markers=[f"m{n}" for n in range(n_scatterers)],
        parts=[""] * n_scatterers,
        facts={"mass_kg": 70.0},
    )
    return Scene([Target(dense, label="human")], duration_s=duration_s)


def scenario() -> tuple[Radar, Scene, Analysis]:
    """Radar, scene and analysis of scenario S."""
    scene = walking_scene(N_SCATTERERS, DURATION_S, SPEED_MPS)
    return make_radar(8), scene, Analysis(doppler_bins=128, hop=1, gate_span_m=1.0)


def make_radar(decimation: int) -> Radar:
    """Make the X4 with every ``decimation``-th sample of 23.328 GS/s.

    The chip itself keeps every eighth.
    """
    return Radar.preset("x4", range_stop_m=RANGE_STOP_M, decimation=decimation)


def prepare(radar: Radar, scene: Scene, analysis: Analysis) -> Case:
    """Scatterer table and truth gate of a scenario."""
    placed = place(scene)
    slow_time_s = np.arange(round(placed.observation_s * radar.prf_hz)) / radar.prf_hz
    table = assemble(placed, slow_time_s, angles=False)
    track_m = compute_body_track(placed.targets[0], scene, slow_time_s).range_m
    gate = Gate.around(slow_time_s, track_m, span_m=analysis.gate_span_m, source="given")
    return Case(radar, scene, analysis, slow_time_s, table, gate, *compute_scatterer_arrays(table, radar))


def new_planes(case: Case) -> Any:
    """Real and imaginary planes of a case, (2, bins, pulses rounded up), touched once."""
    n_pulses = math.ceil(case.slow_time_s.size / ROW_MULTIPLE) * ROW_MULTIPLE
    return np.zeros((2, case.radar.n_range_bins, n_pulses), dtype=np.float32)


def fill_planes(case: Case, planes: Any) -> None:
    """Synthesis into planes that exist."""
    native.echo_planes(case.range_m, case.amplitude_v, *_geometry(case.radar), planes[0], planes[1], None)


def _geometry(radar: Radar) -> tuple[float, float, float, float, float]:
    sigma_m = radar.sigma_s * SPEED_OF_LIGHT_MPS / 2.0
    return radar.range_start_m, radar.bin_spacing_m, sigma_m, radar.wavelength_m, radar.transmit_phase_rad
