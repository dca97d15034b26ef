"""Facts of a sensor, and those that the recording of a room shows: static echoes, phase, noise, faulty frames."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.config import read_toml
from doppelgait.core.errors import AnalysisError
from doppelgait.core.units import FloatArray, db_to_power, power_to_db
from doppelgait.radar.fit.room import (
    DB_PER_NEPER,
    NEAR_M,
    Bursts,
    Estimate,
    FrameFaults,
    Leakage,
    NoiseFloor,
    Profile,
    SeriesFit,
    StaticPart,
    compute_factor_variance,
    count_runs,
    estimate_leakage,
    estimate_noise_floor,
    find_bursts,
    find_frame_faults,
    fit_clutter_profile,
    fit_series,
    fit_static_part,
    split_still_part,
    subtract_static,
)
from doppelgait.radar.recording import Recording

ComplexArray = npt.NDArray[np.complex128]
Mask = npt.NDArray[np.bool_]

MIN_FRAMES = 32
MIN_BINS = 8
MOVING_DB = 4.0
"""Minimum slow-time variance over the noise floor, dB, of a bin with a target; static rooms stay within 1.5 dB."""
BODY_M = 0.5
"""Distance from a moving interval in which cells far above the noise may be parts of the body."""
MOVING_BINS = 3
"""Minimum number of neighbouring bins with this variance."""
BUSY_SHARE = 1.0 / 3.0
"""Share of the ranges with targets from which the median over bins is not the noise."""
MAX_DRIFT_RAD_PER_S = 1000.0 / 60.0
"""Limit of the impairment: what turns faster is the phase of a body."""
MAX_PHASE_VARIANCE = 0.05
"""Maximum phase variance, rad^2 per frame; above it the static echoes are too weak for a common phase."""


SHORT_S = 10.0
"""Duration below which drift and random walk are inaccurate."""


@dataclass(frozen=True)
class Fact:
    """Scalar of a sensor, a row of ``facts.toml``; by default with four significant digits."""

    label: str
    unit: str
    sets: str = ""
    take: str = ""
    scale: float = 1.0
    digits: int | None = None
    lowest: float | None = None
    highest: float = math.inf
    significant: bool = False


VOLT_DB = "dB re 1 V"
FACTS = {name: Fact(**row) for name, row in read_toml(Path(__file__).with_name("facts.toml"))[0].items()}


@dataclass(frozen=True)
class MovingInterval:
    """A range interval with motion."""

    start_m: float
    stop_m: float
    excess_db: float


@dataclass(frozen=True)
class Room:
    """Static echoes, noise, phase and faults of a room.
    Shapes: echo_v (N,); time_s and factor of the frames that are used (I,).
    """

    noise: NoiseFloor
    echo_v: ComplexArray
    clutter: Profile
    leakage: Leakage
    time_s: FloatArray
    factor: ComplexArray
    phase: SeriesFit | None
    gain: SeriesFit | None
    faults: FrameFaults
    bursts: Bursts
    moving: tuple[MovingInterval, ...]
    is_busy: bool


def fit_room(recording: Recording) -> Room:
    """Fit static echoes, noise, phase and faults to a room.
    The model is y[i, n] = z_i c_n + w[i, n]: static echoes c times one complex factor z per frame (its angle is the
    phase of the frame, its modulus the gain) plus white Gaussian noise (E-18), which may be correlated between
    neighbouring bins. Targets, interference and dropped frames are detected first and excluded.
    """
    time_s, range_m = (np.asarray(x, dtype=np.float64) for x in (recording.slow_time_s, recording.range_m))
    samples = np.asarray(recording.samples.matrix, dtype=np.complex128)
    if range_m.size < MIN_BINS:
        raise AnalysisError(f"{range_m.size} range bins; {MIN_BINS} are needed")
    if time_s.size < MIN_FRAMES:
        raise AnalysisError(f"{time_s.size} frames; {MIN_FRAMES} are needed")
    faults = find_frame_faults(samples, slow_time_s=time_s)
    good = ~faults.dropped
    if int(good.sum()) < MIN_FRAMES:
        raise AnalysisError(
            f"only {int(good.sum())} of {len(samples)} frames are neither zero nor a copy of the previous one; at "
            f"least {MIN_FRAMES} are needed: record longer, or check the recorder"
        )
    hit, noise, static, moving = _separate(samples[good], range_m)
    used = np.flatnonzero(good)[~hit.frames]
    # phase (rad) and gain (dB) of the frames as drift, walk and jitter
    variance = compute_factor_variance(static, noise.correlation, noise_power_v2=noise.power_v2.value)
    phase, gain = None, None
    busy_m = sum(m.stop_m - m.start_m for m in moving)
    is_busy = bool(busy_m > BUSY_SHARE * (range_m[-1] - range_m[0]))
    if variance <= MAX_PHASE_VARIANCE and not is_busy:
        phase = fit_series(np.unwrap(np.angle(static.factor)), time_s=time_s[used], measurement_variance=variance)
        db = 2.0 * DB_PER_NEPER
        gain_db = db * np.log(np.abs(static.factor))
        gain = fit_series(gain_db, time_s=time_s[used], measurement_variance=db**2 * variance)
        if abs(phase.drift_per_s.value) > MAX_DRIFT_RAD_PER_S:
            phase = gain = None
    left_v2 = noise.power_v2.value / used.size
    clutter = fit_clutter_profile(
        static.echo_v, range_m=range_m, noise_power_v2=left_v2, resolution_m=recording.radar.range_resolution_m
    )
    return Room(
        noise=noise,
        echo_v=static.echo_v,
        clutter=clutter,
        leakage=estimate_leakage(static.echo_v, range_m=range_m, noise_power_v2=left_v2),
        time_s=time_s[used],
        factor=static.factor,
        phase=phase,
        gain=gain,
        faults=faults,
        bursts=hit,
        moving=moving,
        is_busy=is_busy,
    )


def _separate(
    samples: ComplexArray, range_m: FloatArray
) -> tuple[Bursts, NoiseFloor, StaticPart, tuple[MovingInterval, ...]]:
    """Separate interference, noise, static part and targets; each hides the others at first."""
    from scipy.ndimage import binary_dilation

    quiet = away = np.ones(range_m.size, dtype=bool)
    kept = np.ones(len(samples), dtype=bool)
    # limbs and multipath of a body stand out for some frames, too
    margin = max(round(BODY_M / float(np.median(np.diff(range_m)))), 1)
    for number in range(3):
        static, noise = _fit_static_and_noise(samples[kept], quiet)
        if number:  # interference would be motion in the first pass
            quiet = _remove_targets(static.rest_v, noise, range_m)[0]
            away = ~binary_dilation(~quiet, iterations=margin)
        everything = subtract_static(samples, static.echo_v, static.reference_v)
        hit = find_bursts(everything.rest_v, noise_power_v2=noise.power_v2.value, quiet=away)
        kept = ~hit.frames if int((~hit.frames).sum()) >= MIN_FRAMES else kept
    static, noise = _fit_static_and_noise(samples[kept], quiet)
    if not np.array_equal(kept, ~hit.frames):  # too few frames would remain: all are used
        hit = replace(hit, frames=~kept)
    return hit, noise, static, _remove_targets(static.rest_v, noise, range_m)[1]


def _fit_static_and_noise(samples: ComplexArray, quiet: Mask) -> tuple[StaticPart, NoiseFloor]:
    quiet = quiet if quiet.sum() >= MIN_BINS else np.ones_like(quiet)
    static = fit_static_part(samples, bins=quiet)
    noise = estimate_noise_floor(static, quiet)
    variance = compute_factor_variance(static, noise.correlation, noise_power_v2=noise.power_v2.value)
    if variance > MAX_PHASE_VARIANCE:
        static = split_still_part(samples)
        noise = estimate_noise_floor(static, quiet)
    return static, noise


def _remove_targets(
    rest: ComplexArray, noise: NoiseFloor, range_m: FloatArray
) -> tuple[Mask, tuple[MovingInterval, ...]]:
    """Return bins without targets, and the targets by range."""
    from scipy.ndimage import find_objects, label

    excess = np.mean(np.abs(rest) ** 2, axis=0) / max(noise.power_v2.value, np.finfo(float).tiny)
    busy = excess > float(db_to_power(MOVING_DB))
    moving = []
    for (run,) in find_objects(label(busy)[0]):
        if run.stop - run.start >= MOVING_BINS:
            largest_db = float(power_to_db(excess[run].max()))
            moving.append(MovingInterval(float(range_m[run.start]), float(range_m[run.stop - 1]), largest_db))
        else:
            busy[run] = False
    return ~busy, tuple(moving)


def list_room_estimates(room: Room, recording: Recording, refused: dict[str, str]) -> dict[str, Estimate]:
    """Return the values of a room that are shown, by name."""
    values: dict[str, Estimate] = {}
    for name, fact in FACTS.items():
        value: Any = room if fact.take else None
        for attribute in fact.take.split(".") if fact.take else ():
            value = getattr(value, attribute, None)
        if value is not None and math.isfinite(value.value) and math.isfinite(value.sd):
            values[name] = value.scale(fact.scale)
    if "white_rad" in values:
        values["clock_jitter_ps"] = values["white_rad"].scale(1e12 / (2.0 * math.pi * recording.radar.carrier_hz))
    else:
        refused["phase noise"] = (
            "something moved in more than a third of the ranges"
            if room.is_busy
            else "static echoes are too weak to show phase and gain of a frame, or weaker than something that moves"
        )
    constant = room.leakage.constant_v
    if constant.value > 3.0 * constant.sd:
        values["dc_level_db"] = constant.to_db(20.0)
    else:
        refused["constant (direct current)"] = "not distinguished from static echoes"
    direct, range_m = room.leakage.level_db, recording.range_m
    if math.isfinite(direct.value) and range_m[0] < NEAR_M / 2.0 and (range_m > 2.0 * NEAR_M).sum() >= MIN_BINS:
        room_db = float(power_to_db(np.mean(np.abs(room.echo_v[range_m > NEAR_M]) ** 2)))
        # a static echo of that level at random phase under the direct path
        blur_db = 2.0 * DB_PER_NEPER * math.sqrt(float(db_to_power(room_db - direct.value)) / 2.0)
        if blur_db < 2.0:
            values["direct_path_db"] = Estimate(direct.value, math.hypot(direct.sd, blur_db))
    if "direct_path_db" not in values:
        refused["gain"] = "no direct path well over the clutter in the frame"
    hit, runs, whole_s = room.bursts, count_runs(room.bursts.frames), float(np.ptp(recording.slow_time_s))
    if not room.is_busy and "burst_pulses" not in recording.facts:
        values["burst_rate_hz"] = Estimate(runs / whole_s, math.sqrt(max(runs, 1)) / whole_s)
    if "burst_rate_hz" in values and runs:
        length, rate_hz = hit.frames.sum() / runs, recording.radar.prf_hz
        # a burst across two frames hits both
        values["burst_duration_s"] = Estimate(max(length - 1.0, 1e-3) / rate_hz, length / math.sqrt(runs) / rate_hz)
        values["burst_level_db"] = Estimate(hit.level_db, DB_PER_NEPER / math.sqrt(runs))
        values["burst_share"] = Estimate(hit.share, hit.share / math.sqrt(runs))
    return values


def list_notes(room: Room | None, recording: Recording) -> dict[str, str]:
    """Return warnings about the numbers, by subject."""
    notes = {}
    if recording.radar.volts_per_unit is None:
        notes["volts"] = "the radar does not state the volts per unit of the file; the values are assumed to be in V"
    if recording.observation_s < SHORT_S:
        notes["duration"] = f"only {recording.observation_s:.1f} s: drift and random walk need a minute or more"
    if room is not None and room.moving:
        where = ", ".join(f"{m.start_m:.2f} to {m.stop_m:.2f} m ({m.excess_db:.0f} dB)" for m in room.moving)
        notes["motion"] = f"the room was not empty: slow-time variance over the noise at {where}; left out"
        if room.is_busy:
            notes["motion"] += "; in more than a third of the ranges, so that clutter and constant cannot be trusted"
    return notes
