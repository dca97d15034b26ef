"""Scene + radar -> recording."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr

from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError
from doppelgait.core.units import duration_to_pulses, slow_time_axis_s
from doppelgait.motion.retime import travel_speed_mps
from doppelgait.radar.config import Radar
from doppelgait.radar.recording import Recording, TargetTruth
from doppelgait.radar.simulate import (
    add_noise,
    frame_power_v2,
    lowest_prf_hz,
    receiver_noise_v2,
    synthesise,
    warn_of_limits,
)
from doppelgait.scene import Scene, Target, assemble, body_track
from doppelgait.scene.target import scaled_motion

PROBE_RATE_HZ = 500.0
"""Rate at which a scene's speeds are looked up for the lowest frame rate."""


def simulate(
    scene: Scene,
    radar: Radar,
    *,
    rng: np.random.Generator | None = None,
    snr_db: float | None = None,
    angles: bool = True,
) -> Recording:
    """Simulate what a radar records of a scene, with the truth.

    Parameters
    ----------
    scene : Scene
    radar : Radar
    rng : numpy.random.Generator, optional
        Source of the receiver noise. Without it the recording is noise-free.
    snr_db : float, optional
        Wanted SNR_frame: time mean of the strongest bin's power over the noise power, in dB; ``inf`` for no noise.
        By default the noise is the radar's thermal noise (E-18).
    angles : bool
        Whether the truth holds every scatterer's aspect angle; without, the simulation is quicker.

    Returns
    -------
    Recording

    Raises
    ------
    ConfigError
        If ``snr_db`` is given without ``rng``.

    Warns
    -----
    DoppelgaitWarning
        If a scatterer aliases in Doppler or leaves the frame.
    """
    if snr_db is not None and rng is None and not math.isinf(snr_db):
        raise ConfigError(f"snr_db = {snr_db} asks for noise, which needs rng: pass rng=doppelgait.rng(SEED)")
    slow_time_s = slow_time_axis_s(duration_to_pulses(scene.observation_s, radar.prf_hz), radar.prf_hz)
    if slow_time_s.size < 2:
        raise ConfigError(
            f"{scene.observation_s} s at prf_hz = {radar.prf_hz:g} is less than two frames; observe longer"
        )
    scatterers = assemble(scene, slow_time_s, angles=angles)
    warn_of_limits(scatterers, radar)
    clean = synthesise(scatterers, radar)
    noise_v2 = receiver_noise_v2(clean, radar, snr_db) if rng is not None else 0.0
    noisy = add_noise(clean, noise_power_v2=noise_v2, rng=rng) if rng is not None and noise_v2 > 0 else clean
    return Recording(
        baseband=noisy,
        radar=radar,
        truth=[target_truth(t, n, scene, scatterers) for n, t in enumerate(scene.targets)],
        noise_power_v2=noise_v2,
        snr_frame_db=10 * math.log10(frame_power_v2(clean) / noise_v2) if noise_v2 > 0 else math.inf,
        source="simulation",
    )


def target_truth(target: Target, number: int, scene: Scene, scatterers: xr.Dataset) -> TargetTruth:
    """Truth of one target of a scene, from the same geometry that the radar sees."""
    rows = scatterers.isel(scatterer=np.flatnonzero(scatterers.coords["target"].values == number))
    slow_time_s = scatterers.coords["slow_time"].values
    centre = body_track(target, scene, slow_time_s)
    motion = scaled_motion(target)
    observed = motion.isel(time=motion.coords["time"].values <= motion.coords["time"].values[0] + scene.observation_s)
    facts = motion.attrs
    return TargetTruth(
        label=target.label,
        scatterers=rows,
        centre_range_m=centre.range_m,
        centre_velocity_mps=centre.radial_velocity_mps,
        centre_aspect_rad=centre.aspect_rad,
        ground_speed_mps=travel_speed_mps(observed),
        gait=facts["gait"],
        subject=facts["subject"],
        motion=facts["source"],
        height_m=facts["height_m"],
        stride_frequency_hz=facts["stride_frequency_hz"],
        step_frequency_hz=facts["step_frequency_hz"],
        gait_frequency_hz=facts["gait_frequency_hz"],
    )


def with_lowest_prf(scene: Scene, radar: Radar, *, cpi_s: float) -> Radar:
    """The radar at the lowest frame rate at which nothing in this scene aliases (E-06).

    Only for reproducing the report: chosen per recording, the frame rate tells the speed.
    """
    probe_s = slow_time_axis_s(duration_to_pulses(scene.observation_s, PROBE_RATE_HZ), PROBE_RATE_HZ)
    prf_hz = lowest_prf_hz(assemble(scene, probe_s, angles=False), radar, cpi_s)
    return validate(Radar, {**radar.model_dump(), "prf_hz": prf_hz}, where="radar")
