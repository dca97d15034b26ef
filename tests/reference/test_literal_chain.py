"""Simulate and analyse against the literal float64 equations, end to end."""

import numpy as np
import pytest

import literal
from doppelgait.core.rng import rng
from doppelgait.motion import boulic_walk
from doppelgait.pipeline import Conditions, analyze, simulate
from doppelgait.pipeline.simulate import observe_scene
from doppelgait.processing import Analysis
from doppelgait.radar import Radar, echo_amplitude_v
from doppelgait.scene import Scene, Target

DURATION_S = 0.4
WALK = boulic_walk(speed_mps=1.3, height_m=1.7, duration_s=1.0)
ROOM = (
    {"kind": "ground_bounce"},
    {"kind": "wall_ghost", "material": "brick", "thickness_m": 0.115, "side_m": 3.0},
    {"kind": "wall", "material": "plasterboard", "thickness_m": 0.0125, "range_m": 1.0},
)
LEAK_V = 3e-7
CASES = {
    "plain": Conditions(),
    "room": Conditions(environment=ROOM),
    "constant": Conditions(impairments=({"kind": "dc_leak", "level_db": 20 * np.log10(LEAK_V), "phase_deg": 0.0,
                                         "walk_per_sqrt_min": 0.0},)),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("clutter", ["none", "mean"])
def test_signature_of_the_chain_is_that_of_the_literal_equations(case, clutter):
    """E-13b, E-14, E-18, E-23 to E-27 from the scatterers that reach the receiver; noise-free."""
    radar = Radar.preset("x4", range_start_m=3.0, range_stop_m=7.0)
    scene = Scene([Target(WALK, label="human", range_m=5.0)], duration_s=DURATION_S)
    conditions = CASES[case]
    recording = simulate(scene, radar, rng=rng(1), conditions=conditions, snr_db=float("inf"), angles=False)
    analysis = Analysis(clutter=clutter, gate_edges="sharp", hop=32)
    (found,) = analyze(recording, gate="truth", analysis=analysis)

    times_s = np.arange(round(DURATION_S * radar.prf_hz)) / radar.prf_hz
    table, _ = observe_scene(scene, radar, times_s, conditions, angles=False, streams=rng(1))
    range_m = table["range"]
    gain = table["path_gain"]
    amplitude_v = echo_amplitude_v(radar, range_m=range_m, rcs_m2=table["rcs"], path_gain=gain)
    turns = 2 * table["radial_velocity"] / radar.wavelength_m * radar.integration_share / radar.prf_hz
    amplitude_v = amplitude_v * np.sinc(turns)  # E-13b
    phase_rad = table["path_phase"] if "path_phase" in table else np.zeros_like(range_m)
    axis_m = radar.range_start_m + radar.bin_spacing_m * np.arange(radar.n_range_bins)
    y = literal.baseband(
        range_m, amplitude_v * np.exp(1j * phase_rad), axis_m, sigma_s=radar.sigma_s, wavelength_m=radar.wavelength_m,
        theta_rad=radar.transmit_phase_rad,
    )  # fmt: skip
    y += LEAK_V if case == "constant" else 0.0
    y -= y.mean(axis=0) if clutter == "mean" else 0.0
    mu = found.signature
    n_pulses, n_bins = mu.attrs["cpi_pulses"], mu.sizes["doppler"]
    centres = np.rint(mu.coords["time"].values * radar.prf_hz).astype(int)
    centre_m = np.interp(mu.coords["time"].values, times_s, recording.truth[0].centre_range_m)
    span_m = analysis.gate_span_m
    first = np.ceil((centre_m - span_m / 2 - axis_m[0]) / radar.bin_spacing_m).astype(int)
    n_gate = int(span_m // radar.bin_spacing_m) + 1
    window = literal.window(n_pulses, analysis.window_steepness)
    expected = literal.signature(y, centres, first, n_gate, window, n_bins)
    error = np.linalg.norm(mu.values - expected) / np.linalg.norm(expected)
    assert error < 2e-5
