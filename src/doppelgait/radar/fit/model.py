"""Sensor models fitted to recordings of an empty room.

Every number has an uncertainty; flags are warnings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import AnalysisError
from doppelgait.core.units import FloatArray, db_to_amplitude, db_to_power, power_to_db
from doppelgait.radar.fit.room import (
    DB_PER_NEPER,
    Bursts,
    ClutterProfile,
    Estimate,
    FrameFaults,
    Leakage,
    NoiseFloor,
    SeriesFit,
    StaticPart,
    compute_factor_variance,
    estimate_leakage,
    estimate_noise_floor,
    find_bursts,
    find_frame_faults,
    fit_clutter_profile,
    fit_series,
    fit_static_part,
    split_still_part,
)
from doppelgait.radar.link import find_noise_slope, noise_power_v2
from doppelgait.radar.parameters import Radar
from doppelgait.radar.recording import Recording

ComplexArray = npt.NDArray[np.complex128]
Mask = npt.NDArray[np.bool_]

MIN_FRAMES = 32
MIN_BINS = 8
MOVING_DB = 4.0
"""Minimum slow-time variance over the noise floor, dB, of a bin with a target; static rooms stay within 1.5 dB."""
MOVING_BINS = 3
"""Minimum number of neighbouring bins with this variance."""
MAX_PHASE_VARIANCE = 0.05
"""Maximum phase variance, rad^2 per frame; above it the static echoes are too weak for a common phase."""


@dataclass(frozen=True)
class MovingInterval:
    """A range interval with motion."""

    start_m: float
    stop_m: float
    excess_db: float


@dataclass(frozen=True)
class SensorFit:
    """Sensor model fitted to an empty room.

    Parameters
    ----------
    source : str
        File the recording came from.
    radar : Radar
        Radar of the recording; its noise figure and gain are assumed.
    range_m : ndarray, shape (N,)
        Range of the bins.
    n_frames, n_used : int
        Number of frames, and of frames without dropped ones and interference.
    duration_s : float
    noise : NoiseFloor
        Noise per bin and frame.
    noise_level_db : Estimate
        Noise level, dB re 1 V.
    noise_figure_db : Estimate
        Noise figure that gives this level with the radar's bandwidth, gain and averages (E-18).
    receiver_gain_db : Estimate
        Receiver gain that gives this level with the radar's noise figure.
    echo_v : ndarray, shape (N,)
        Static echo per bin, V.
    clutter : ClutterProfile
        Mean level of the static echo over range.
    leakage : Leakage
        Direct path and constant.
    time_s, factor : ndarray, shape (n_used,)
        Times of the frames used and their common factor: phase and gain relative to the static echo.
    phase, gain : SeriesFit or None
        Common phase, rad, and gain, dB; None if static echoes are too weak to show them.
    faults : FrameFaults
        Dropped frames.
    bursts : Bursts
        Interference.
    moving : tuple of MovingInterval
        Empty for an empty room.
    flags : tuple of str
        Warnings about the numbers.
    """

    source: str
    radar: Radar
    range_m: FloatArray
    n_frames: int
    n_used: int
    duration_s: float
    noise: NoiseFloor
    noise_level_db: Estimate
    noise_figure_db: Estimate
    receiver_gain_db: Estimate
    echo_v: ComplexArray
    clutter: ClutterProfile
    leakage: Leakage
    time_s: FloatArray
    factor: ComplexArray
    phase: SeriesFit | None
    gain: SeriesFit | None
    faults: FrameFaults
    bursts: Bursts
    moving: tuple[MovingInterval, ...]
    flags: tuple[str, ...]

    @property
    def level_of_unit_db(self) -> float | None:
        """Level of one file unit, dB re 1 V. It is None if the radar does not state it."""
        unit = self.radar.volts_per_unit
        return None if unit is None else 20.0 * math.log10(unit)

    @property
    def is_busy(self) -> bool:
        """True with targets in a third of the ranges: the median over bins is not the noise."""
        busy_m = sum(m.stop_m - m.start_m for m in self.moving)
        return bool(busy_m > BUSY_SHARE * (self.range_m[-1] - self.range_m[0]))


def fit_sensor(recording: Recording, *, start_s: float | None = None, stop_s: float | None = None) -> SensorFit:
    """Fit a sensor model to an empty-room recording.

    The model has noise, clutter, phase drift and faults.

    The model is y[i, n] = z_i c_n + w[i, n]: static echoes c times one complex factor z per frame (its angle is the
    phase of the frame, its modulus the gain) plus white Gaussian noise (E-18), which may be correlated between
    neighbouring bins. Targets, interference and dropped frames are detected first and excluded.

    Parameters
    ----------
    recording : Recording
        At least 32 frames of at least 8 range bins; nothing should move.
    start_s, stop_s : float, optional
        Use only this part of the recording, s of its time axis.

    Returns
    -------
    SensorFit

    Raises
    ------
    AnalysisError
        If the recording is too short, has too few range bins, contains values that are not finite, or only zeros.
    """
    time_s, range_m = recording.slow_time_s, recording.range_m
    if "burst_pulses" in recording.facts:
        raise AnalysisError(
            f"{recording.source}: is a recording in bursts, and the pauses would count as lost frames; a model is "
            "fitted to continuous recordings only: record without pauses"
        )
    chosen = np.ones(time_s.size, dtype=bool)
    chosen &= time_s >= (-np.inf if start_s is None else start_s)
    chosen &= time_s <= (np.inf if stop_s is None else stop_s)
    samples = np.asarray(recording.samples.matrix[chosen], dtype=np.complex128)
    if samples.shape[0] < MIN_FRAMES or samples.shape[1] < MIN_BINS:
        raise AnalysisError(
            f"{_name(recording)}: {samples.shape[0]} frames of {samples.shape[1]} range bins are too few to fit a "
            f"model: at least {MIN_FRAMES} frames (some hundred are better) and {MIN_BINS} bins are needed"
        )
    if not np.isfinite(samples).all():
        raise AnalysisError(f"{_name(recording)}: has values that are not finite; exclude them with start_s, stop_s")
    if not samples.any():
        raise AnalysisError(f"{_name(recording)}: every sample is zero; was the radar recording?")
    time_s, range_m = np.asarray(time_s[chosen], dtype=np.float64), np.asarray(range_m, dtype=np.float64)
    faults = find_frame_faults(samples, slow_time_s=time_s)
    good = ~faults.dropped
    if int(good.sum()) < MIN_FRAMES:
        raise AnalysisError(
            f"{_name(recording)}: only {int(good.sum())} of {len(samples)} frames are neither zero nor a copy of the "
            f"previous one; at least {MIN_FRAMES} are needed: record longer, or check the recorder"
        )
    hit, noise, static, moving = _separate(samples[good], range_m)
    used = np.flatnonzero(good)[~hit.frames]
    # phase (rad) and gain (dB) of the frames as drift, walk and jitter
    variance = compute_factor_variance(static, noise.correlation, noise_power_v2=noise.power_v2.value)
    phase, gain = None, None
    if variance <= MAX_PHASE_VARIANCE:
        phase = fit_series(np.unwrap(np.angle(static.factor)), time_s=time_s[used], measurement_variance=variance)
        db = 2.0 * DB_PER_NEPER
        gain_db = db * np.log(np.abs(static.factor))
        gain = fit_series(gain_db, time_s=time_s[used], measurement_variance=db**2 * variance)
    left_v2 = noise.power_v2.value / used.size
    level = noise.power_v2.to_db(10.0)
    figure = find_noise_figure(recording.radar, level)
    excess_db = figure.value - recording.radar.noise_figure_db
    clutter = fit_clutter_profile(
        static.echo_v, range_m=range_m, noise_power_v2=left_v2, resolution_m=recording.radar.range_resolution_m
    )
    fit = SensorFit(
        source=recording.source,
        radar=recording.radar,
        range_m=range_m,
        n_frames=len(samples),
        n_used=used.size,
        duration_s=float(time_s[-1] - time_s[0]),
        noise=noise,
        noise_level_db=level,
        noise_figure_db=figure,
        receiver_gain_db=Estimate(recording.radar.receiver_gain_db + excess_db, figure.sd),
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
        flags=(),
    )
    return replace(fit, flags=list_flags(fit))


def _name(recording: Recording) -> str:
    return recording.source or "recording"


def _separate(
    samples: ComplexArray, range_m: FloatArray
) -> tuple[Bursts, NoiseFloor, StaticPart, tuple[MovingInterval, ...]]:
    """Separate interference, noise, static part and targets; each hides the others at first."""
    quiet = np.ones(range_m.size, dtype=bool)
    kept = np.ones(len(samples), dtype=bool)
    for _ in range(2):
        static, noise = _fit_static_and_noise(samples[kept], range_m, quiet)
        quiet = _remove_targets(static.rest_v, noise, range_m)[0]
        energy = float(np.sum(np.abs(static.reference_v) ** 2))
        factor = samples @ static.reference_v.conj() / energy if energy > 0 else np.ones(len(samples), dtype=complex)
        everything = samples - factor[:, None] * static.echo_v
        hit = find_bursts(everything, noise_power_v2=noise.power_v2.value, quiet=quiet)
        kept = ~hit.frames if int((~hit.frames).sum()) >= MIN_FRAMES else kept
    static, noise = _fit_static_and_noise(samples[kept], range_m, quiet)
    if not np.array_equal(kept, ~hit.frames):  # too few frames would remain: all are used
        hit = replace(hit, frames=~kept)
    return hit, noise, static, _remove_targets(static.rest_v, noise, range_m)[1]


def _fit_static_and_noise(samples: ComplexArray, range_m: FloatArray, quiet: Mask) -> tuple[StaticPart, NoiseFloor]:
    static = fit_static_part(samples, bins=quiet if quiet.sum() >= MIN_BINS else None)
    noise = estimate_noise_floor(static, range_m=range_m)
    variance = compute_factor_variance(static, noise.correlation, noise_power_v2=noise.power_v2.value)
    if variance > MAX_PHASE_VARIANCE:
        static = split_still_part(samples)
        noise = estimate_noise_floor(static, range_m=range_m)
    return static, noise


def _remove_targets(
    rest: ComplexArray, noise: NoiseFloor, range_m: FloatArray
) -> tuple[Mask, tuple[MovingInterval, ...]]:
    """Return bins without targets, and the targets by range."""
    excess = np.mean(np.abs(rest) ** 2, axis=0) / max(noise.power_v2.value, np.finfo(float).tiny)
    busy = excess > float(db_to_power(MOVING_DB))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], busy.astype(int), [0]])))
    moving = []
    for first, stop in zip(edges[::2], edges[1::2], strict=True):
        if stop - first >= MOVING_BINS:
            largest_db = float(power_to_db(excess[first:stop].max()))
            moving.append(MovingInterval(float(range_m[first]), float(range_m[stop - 1]), largest_db))
        else:
            busy[first:stop] = False
    return ~busy, tuple(moving)


BUSY_SHARE = 1.0 / 3.0
PLAUSIBLE_NOISE_FIGURE_DB = (0.0, 30.0)
SHORT_S = 10.0


def find_noise_figure(radar: Radar, level_db: Estimate) -> Estimate:
    """Return the noise figure for a measured level (E-18, E-18b)."""
    slope = find_noise_slope(radar)
    return Estimate(radar.noise_figure_db + _find_excess_db(radar, level_db) / slope, level_db.sd / slope)


def _find_excess_db(radar: Radar, level_db: Estimate) -> float:
    return level_db.value - DB_PER_NEPER * math.log(noise_power_v2(radar))


def rescale_radar(radar: Radar, scale_db: float) -> Radar:
    """Scale a radar's echoes, noise and counter step together, so that the SNR does not change."""
    changes = {"receiver_gain_db": radar.receiver_gain_db + scale_db}
    if radar.threshold_step_v is not None:
        changes["threshold_step_v"] = radar.threshold_step_v * float(db_to_amplitude(scale_db))
    return radar.model_copy(update=changes)


def choose_noise_change(fit: SensorFit, base: Radar) -> dict[str, Any]:
    """Return a plausible noise figure, or a scale."""
    radar = base.model_copy(update={"prf_hz": fit.radar.prf_hz})
    figure_db = find_noise_figure(radar, fit.noise_level_db).value
    if is_plausible(figure_db):
        return {"noise_figure_db": figure_db}
    scaled = rescale_radar(radar, _find_excess_db(radar, fit.noise_level_db))
    return {key: getattr(scaled, key) for key in ("receiver_gain_db", "threshold_step_v")}


def is_plausible(figure_db: float) -> bool:
    """Return whether a receiver can have this noise figure."""
    low_db, high_db = PLAUSIBLE_NOISE_FIGURE_DB
    return low_db <= figure_db <= high_db


def list_flags(fit: SensorFit) -> tuple[str, ...]:
    """Return warnings about odd numbers."""
    flags = []
    if fit.moving:
        where = ", ".join(f"{m.start_m:.2f} to {m.stop_m:.2f} m ({m.excess_db:.0f} dB)" for m in fit.moving)
        flags.append(f"the room was not empty: slow-time variance over the noise at {where}; those bins were left out")
        if fit.is_busy:
            flags.append("targets in more than a third of the frame: noise, phase and clutter cannot be trusted")
    if not fit.noise.flat:
        flags.append(f"the noise is not flat in range: {fit.noise.slope_db_per_m.value:+.2f} dB/m")
    if not is_plausible(fit.noise_figure_db.value):
        flags.append(
            f"a noise figure of {fit.noise_figure_db.value:.1f} dB would be needed: the preset changes the receiver "
            "gain instead, that is the scale of the file against volts"
        )
    if fit.radar.volts_per_unit is None:
        flags.append("the radar does not state the volts per unit of the file; the values are assumed to be in V")
    if fit.phase is None:
        flags.append("static echoes are too weak to show phase and gain of a frame; these are left out")
    if fit.faults.dropped.any() or fit.faults.lost:
        flags.append(f"{int(fit.faults.dropped.sum())} frames repeated or blank, {fit.faults.lost} missing in time")
    if fit.bursts.frames.any():
        flags.append(f"interference in {int(fit.bursts.frames.sum())} frames, left out")
    if fit.duration_s < SHORT_S:
        flags.append(f"only {fit.duration_s:.1f} s: drift and random walk are poorly known; a minute or more is better")
    return tuple(flags)


def estimate_rows(fit: SensorFit) -> list[tuple[str, Estimate, str]]:
    """Return name, estimate and unit of every fitted scalar. They are in the order to print."""
    level, unit_db = fit.noise_level_db, fit.level_of_unit_db
    rows = [("noise level", level, "dB re 1 V")]
    if unit_db is not None:
        rows.append(("noise level, sensor's unit", Estimate(level.value - unit_db, level.sd), "dB re 1 unit"))
    rows += [
        ("noise slope over range", fit.noise.slope_db_per_m, "dB/m"),
        ("equivalent noise figure", fit.noise_figure_db, "dB"),
        ("or receiver gain", fit.receiver_gain_db, "dB"),
    ]
    if not math.isnan(fit.leakage.range_m):
        rows.append((f"strongest echo within 1 m, at {fit.leakage.range_m:.2f} m", fit.leakage.level_db, "dB re 1 V"))
    rows.append(("constant over range", fit.leakage.constant_v, "V"))
    if fit.phase is not None and fit.gain is not None:
        minutely = fit.phase.per_minute()
        rows += [
            ("phase drift", minutely["drift_rad_per_min"], "rad/min"),
            ("phase random walk", minutely["walk_rad_per_sqrt_min"], "rad/sqrt(min)"),
            ("phase jitter, white", fit.phase.white, "rad"),
            ("as clock jitter", fit.phase.white.scale(1e12 / (2 * math.pi * fit.radar.carrier_hz)), "ps"),
            ("gain drift", fit.gain.drift_per_s.scale(60.0), "dB/min"),
            ("gain jitter, white", fit.gain.white, "dB"),
        ]
    rows.append(("dropped frames", fit.faults.probability.scale(100.0), "%"))
    return rows


def sensor_as_dict(fit: SensorFit) -> dict[str, Any]:
    """Return a fit as JSON values. Unknown values are None."""
    unit_db = fit.level_of_unit_db
    return {
        "source": fit.source,
        "radar": fit.radar.model_dump(mode="json"),
        "frames": fit.n_frames,
        "frames_used": fit.n_used,
        "duration_s": fit.duration_s,
        "estimates": [
            {"name": name, "value": _keep_finite(e.value), "sd": _keep_finite(e.sd), "unit": unit}
            for name, e, unit in estimate_rows(fit)
        ],
        "noise_is_flat": fit.noise.flat,
        "noise_independent_bins": fit.noise.independent_bins,
        "clutter": [
            {
                "range_m": r,
                "level_db": level,
                "sd_db": sd,
                "level_re_unit_db": None if unit_db is None else level - unit_db,
            }
            for r, level, sd in zip(
                *(x.tolist() for x in (fit.clutter.range_m, fit.clutter.level_db, fit.clutter.sd_db)), strict=True
            )
        ],
        "interference_frames": fit.bursts.frames.nonzero()[0].tolist(),
        "movers": [{"start_m": m.start_m, "stop_m": m.stop_m, "excess_db": m.excess_db} for m in fit.moving],
        "flags": list(fit.flags),
    }


def _keep_finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
