"""Cost of every impairment, environment effect, antenna and waveform on scenario S."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from clock import Work, measure, ratio
from scenario import Case, prepare, scenario

from doppelgait.radar import Antenna, Radar, synthesise
from doppelgait.radar.antenna import apply_antenna
from doppelgait.radar.impairments import apply_impairments, make_impairment, shift_pulse_times
from doppelgait.scene import assemble
from doppelgait.scene.environment import Setting, apply_environment, make_effect

IMPAIRMENTS: dict[str, dict[str, Any]] = {
    "thermal_noise": {},
    "phase_noise": {},
    "phase_noise, oscillator": {"density_dbc_per_hz": -90.0},
    "frame_jitter": {},
    "dropped_frames": {"probability": 0.01},
    "iq_imbalance": {},
    "dc_leak": {},
    "leakage": {},
    "static_clutter": {"levels": [[1.0, -60.0], [8.0, -90.0]]},
    "adc": {"full_scale_v": 1.0},
    "x4_counts": {"pulses_per_step": 6},
    "interference": {},
}
EFFECTS: dict[str, dict[str, Any]] = {
    "ground_bounce": {},
    "wall_ghost": {"material": "brick", "thickness_m": 0.115, "side_m": 3.0},
    "wall": {"material": "plasterboard", "thickness_m": 0.0125},
    "wall, measured": {"loss_db": 3.0, "delay_m": 0.1},
    "visibility": {"gain_db": [[0.0, -20.0], [2.0, 0.0]]},
}
WAVEFORMS: dict[str, dict[str, Any]] = {
    "rectangular": {"sweep_s": 1e-9},
    "lfm": {"sweep_s": 5e-7, "bandwidth_hz": 1.4e9, "bandwidth_level_db": 10},
    "fmcw, 256 samples": {"sweep_s": 5e-4, "sample_rate_hz": 512e3, "bandwidth_hz": 1.4e9, "decimation": 1},
    "stepped, 256 steps": {"sweep_s": 5e-4, "sample_rate_hz": 512e3, "bandwidth_hz": 1.4e9, "decimation": 1},
    "cw": {"decimation": 1},
}


def measure_conditions(rounds: int) -> dict[str, Any]:
    """Seconds of each, and times the synthesis of the data matrix by the impulse radar."""
    case = prepare(*scenario())
    work: dict[str, Work] = {"synthesis, impulse": lambda: synthesise(case.table, case.radar)}
    work |= impairment_work(case) | effect_work(case) | waveform_work(case)
    seconds = measure(work, rounds)
    base = seconds["synthesis, impulse"]
    return {"seconds": seconds, "ratios": {name: ratio(timing, base) for name, timing in seconds.items()}}


def impairment_work(case: Case) -> dict[str, Work]:
    samples = case.radar.waveform.synthesise_planes(case.table, case.radar).freeze()
    generator = np.random.default_rng(1)
    work: dict[str, Work] = {}
    for name, options in IMPAIRMENTS.items():
        specs = [make_impairment({"kind": name.split(",")[0], **options})]
        act = partial(apply_impairments, samples, specs)
        if name == "frame_jitter":
            act = partial(shift_pulse_times, case.slow_time_s, specs)
        work[f"impairment {name}"] = partial(act, radar=case.radar, rng=generator)
    return work


def effect_work(case: Case) -> dict[str, Work]:
    table = assemble(case.scene, case.slow_time_s)
    setting = Setting(case.radar.wavelength_m, case.scene.radar_position_m)
    beam = Antenna(kind="cosine", hpbw_azimuth_deg=65, hpbw_elevation_deg=65)
    work: dict[str, Work] = {
        f"environment {name}": partial(
            apply_environment, table, [make_effect({"kind": name.split(",")[0], **options})], setting
        )
        for name, options in EFFECTS.items()
    }
    tilt = {"boresight_azimuth_rad": 0.0, "boresight_tilt_rad": math.radians(-10)}
    return work | {"antenna, cosine": partial(apply_antenna, table, beam, **tilt)}


def waveform_work(case: Case) -> dict[str, Work]:
    """Synthesis and compression through the other waveforms, same scatterers and frame."""
    plain = case.radar.model_dump(include={"carrier_hz", "prf_hz", "sample_rate_hz", "decimation", "range_stop_m"})
    radars = {
        name: Radar(**{**plain, **options, "waveform": name.split(",")[0]}) for name, options in WAVEFORMS.items()
    }
    return {f"synthesis, {name}": partial(synthesise, case.table, radar) for name, radar in radars.items()}
