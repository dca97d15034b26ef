"""Facts of a sensor that the recording of a room shows: static echoes, phase, noise, faulty frames.

Phase and gain are fitted as drift, random walk and jitter. Every fitted value is an :class:`Estimate`.
"""

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
from doppelgait.radar.recording import Recording

DB_PER_NEPER = 10.0 / math.log(10.0)
"""Decibels of a power ratio per unit of its natural logarithm."""


@dataclass(frozen=True)
class Estimate:
    """A fitted value with its uncertainty.

    Parameters
    ----------
    value : float
        Value in the unit of its field or row name.
    sd : float
        Standard uncertainty (one standard deviation) in the same unit; inf if the recording does not show the value.
    """

    value: float
    sd: float

    def scale(self, factor: float) -> Estimate:
        """Return the estimate in another unit."""
        return Estimate(self.value * factor, self.sd * abs(factor))

    def to_db(self, factor: float) -> Estimate:
        """Return the level of a power (``factor`` 10) or of an amplitude (20)."""
        if not self.value > 0:
            return Estimate(-math.inf, math.inf)
        return Estimate(factor * math.log10(self.value), factor / math.log(10.0) * self.sd / self.value)


def take_root(power: float, sd: float) -> Estimate:
    """Return the square root of a variance that may be negative."""
    value = math.sqrt(max(power, 0.0))
    return Estimate(value, math.sqrt(value * value + sd) - value)


ComplexArray = npt.NDArray[np.complex128]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class StaticPart:
    """Rank-one model y = z c + rest of a room: factor (I,), echo_v (N,), rest_v (I, N)."""

    echo_v: ComplexArray
    reference_v: ComplexArray
    factor: ComplexArray
    rest_v: ComplexArray


def fit_static_part(samples_v: ComplexArray, *, bins: Mask | None = None) -> StaticPart:
    """Fit static echo and common factor by least squares, from the largest eigenvalue."""
    from scipy.linalg import eigh

    chosen = np.ones(samples_v.shape[1], dtype=bool) if bins is None else bins
    part = samples_v[:, chosen]
    last = part.shape[1] - 1
    shape = eigh(part.conj().T @ part, subset_by_index=(last, last))[1][:, 0].conj()
    shares = part @ shape.conj()
    turn = np.exp(1j * (np.angle(np.sum(shares)) - np.angle(shares)))  # phases are relative to the mean frame
    echo = np.mean(samples_v * turn[:, None], axis=0)
    reference = np.where(chosen, echo, 0.0)
    return subtract_static(samples_v, echo, reference)


def subtract_static(samples_v: ComplexArray, echo_v: ComplexArray, reference_v: ComplexArray) -> StaticPart:
    """Subtract a static echo times every frame's factor of its reference."""
    energy = _compute_energy(reference_v)
    factor = samples_v @ reference_v.conj() / energy if energy > 0 else np.ones(len(samples_v), dtype=complex)
    return StaticPart(echo_v, reference_v, factor, samples_v - factor[:, None] * echo_v)


def _compute_energy(values_v: ComplexArray) -> float:
    return float(np.sum(np.abs(values_v) ** 2))


def multiply_correlation(values_v: ComplexArray, correlation: ComplexArray) -> ComplexArray:
    """Multiply the Toeplitz matrix of the noise correlation rho_l by a vector."""
    from scipy.linalg import matmul_toeplitz

    column = np.zeros(values_v.size, dtype=complex)
    column[: correlation.size] = correlation[: values_v.size]
    return np.asarray(matmul_toeplitz(column, values_v))


def compute_leverage(static: StaticPart, correlation: ComplexArray) -> FloatArray:
    """Return each bin's noise share lost with the common factor. The result has the shape (N,)."""
    echo, reference = static.echo_v, static.reference_v
    energy = _compute_energy(reference)
    if not energy > 0:
        return np.zeros(echo.size)
    summed = multiply_correlation(reference, correlation)
    whole = float(np.real(np.vdot(reference, summed)))
    share = 2.0 * np.real(echo.conj() * summed) / energy - np.abs(echo) ** 2 * whole / energy**2
    return np.asarray(share, dtype=np.float64)


def compute_factor_variance(static: StaticPart, correlation: ComplexArray, *, noise_power_v2: float) -> float:
    """Return the variance of the common factor by noise, a^H R a sigma^2 / (2 S^2)."""
    reference = static.reference_v
    energy = _compute_energy(reference)
    if not energy > 0:
        return float("inf")
    whole = float(np.real(np.vdot(reference, multiply_correlation(reference, correlation))))
    return whole * noise_power_v2 / (2.0 * energy**2)


SMALLEST_SHARE = 1e-9
"""Minimum variance of a component relative to that of the differences."""
NEAR_BOUND = 1.0
"""Distance from this bound, in natural logarithms, that counts as at the bound."""


@dataclass(frozen=True)
class SeriesFit:
    """Drift, random walk and white jitter of a series. The unit of the series is written as u."""

    drift_per_s: Estimate
    walk_per_root_s: Estimate
    white: Estimate


def fit_series(values: FloatArray, *, time_s: FloatArray, measurement_variance: float = 0.0) -> SeriesFit:
    """Fit drift, random walk and white jitter to a series by restricted likelihood."""
    # the differences have the covariance q dt I + s^2 T, T tridiagonal with 2 and -1
    # (Patterson and Thompson, Biometrika 58, 1971, 545)
    from scipy.fft import dst
    from scipy.optimize import minimize

    steps_s = np.diff(time_s)
    rows = np.arange(1, steps_s.size + 1)
    white_shape = 2.0 - 2.0 * np.cos(np.pi * rows / (steps_s.size + 1))
    differences, ramp = (dst(x, type=1, norm="ortho") for x in (np.diff(values), steps_s))
    scale = float(np.var(np.diff(values)))
    if not scale > 0:
        slope = float((values[-1] - values[0]) / (time_s[-1] - time_s[0]))
        return SeriesFit(Estimate(slope, 0.0), Estimate(0.0, 0.0), Estimate(0.0, 0.0))

    def slope_of(variance: FloatArray) -> float:
        return float(np.sum(ramp * differences / variance) / np.sum(ramp**2 / variance))

    def cost(logarithms: FloatArray) -> float:
        variance = scale * (np.exp(logarithms[0]) + np.exp(logarithms[1]) * white_shape)
        misfit = np.sum(np.log(variance) + (differences - slope_of(variance) * ramp) ** 2 / variance)
        return float(0.5 * (misfit + np.log(np.sum(ramp**2 / variance))))

    bounds = [(np.log(SMALLEST_SHARE), np.log(10.0))] * 2
    starts = (np.log([0.01, 0.5]), np.log([0.9, 0.01]), np.log([1e-6, 0.5]))
    best = min(
        (minimize(cost, start, bounds=bounds, method="L-BFGS-B") for start in starts), key=lambda found: found.fun
    )
    parts = scale * np.where(best.x <= bounds[0][0] + NEAR_BOUND, 0.0, np.exp(best.x))
    variance = scale * (np.exp(best.x[0]) + np.exp(best.x[1]) * white_shape)
    sd_walk, sd_white = _compute_fisher_sd(variance, white_shape)
    # at the upper end of the interval: the uncertainty of a walk that is estimated too low would be too small
    sd_walk, _ = _compute_fisher_sd(variance + sd_walk, white_shape)
    drift = Estimate(slope_of(variance), float(1.0 / np.sqrt(np.sum(ramp**2 / variance))))
    step_s = float(np.mean(steps_s))
    walk = take_root(parts[0] / step_s, sd_walk / step_s)
    return SeriesFit(drift, walk, take_root(float(parts[1]) - measurement_variance, sd_white))


def _compute_fisher_sd(variance: FloatArray, white_shape: FloatArray) -> tuple[float, float]:
    shapes = np.stack([np.ones_like(white_shape), white_shape]) / variance
    spread = np.sqrt(np.diag(np.linalg.inv(0.5 * shapes @ shapes.T)))
    return float(spread[0]), float(spread[1])


MEDIAN_FRAMES = 9
"""Length of the running median, frames; bursts of up to four frames stand out of it."""
FALSE_ALARMS = 1e-3
"""Expected number of noise cells above the threshold in a whole recording."""
BUSY_FRAMES = 0.03
"""Share of frames above the threshold from which a bin has a target."""


@dataclass(frozen=True)
class FrameFaults:
    """Faulty frames of a recording: dropped (I,), of them blank, in runs; and lost ones."""

    dropped: Mask
    blank: int
    runs: int
    lost: int

    @property
    def faulty(self) -> int:
        """Number of faulty frames."""
        return int(self.dropped.sum()) + self.lost


def find_frame_faults(samples_v: ComplexArray, *, slow_time_s: FloatArray) -> FrameFaults:
    """Find dropped frames (zero or an exact repetition) and lost ones (gaps of time)."""
    blank, repeated = mark_dropped(samples_v)
    steps = np.diff(slow_time_s)
    lost = int(np.sum(np.maximum(np.round(steps / np.median(steps)) - 1, 0)))
    return FrameFaults(blank | repeated, int(blank.sum()), count_runs(blank | repeated), lost)


def mark_dropped(samples_v: ComplexArray) -> tuple[Mask, Mask]:
    """Mark the frames that are zero, and those that repeat the frame before."""
    repeated: Mask = np.concatenate([[False], (samples_v[1:] == samples_v[:-1]).all(axis=1)])
    return np.asarray(~samples_v.any(axis=1)), repeated


def count_runs(flags: Mask) -> int:
    """Count the runs of flags."""
    from scipy.ndimage import label

    return int(label(flags)[1])


@dataclass(frozen=True)
class Bursts:
    """Interference in an otherwise good recording. Shapes: frames (I,)."""

    frames: Mask
    level_db: float
    share: float


def find_bursts(rest_v: ComplexArray, *, noise_power_v2: float, quiet: Mask) -> Bursts:
    """Find frames with interference: cells far above the noise after a running median."""
    from scipy.ndimage import median_filter

    nothing = np.zeros(len(rest_v), dtype=bool)
    if not noise_power_v2 > 0 or not quiet.any():
        return Bursts(nothing, math.nan, 0.0)
    rest = rest_v[:, quiet]
    middle = [median_filter(x, size=(MEDIAN_FRAMES, 1), mode="nearest") for x in (rest.real, rest.imag)]
    power = np.abs(rest - middle[0] - 1j * middle[1]) ** 2
    floor = np.maximum(np.median(power, axis=0) / math.log(2.0), noise_power_v2)
    hit: Mask = np.asarray(power > floor * math.log(power.size / FALSE_ALARMS))
    hit[: MEDIAN_FRAMES // 2] = hit[len(hit) - MEDIAN_FRAMES // 2 :] = False
    hit &= hit.mean(axis=0) <= BUSY_FRAMES
    frames: Mask = np.asarray(hit.any(axis=1))
    if not frames.any():
        return Bursts(nothing, math.nan, 0.0)
    level = float(10.0 * np.log10(np.mean(power[hit])))
    return Bursts(frames, level, float(hit[frames].mean()))


def measure_scatter(values: npt.NDArray[Any]) -> float:
    """Return the standard deviation from the median absolute deviation."""
    return 1.4826 * float(np.median(np.abs(values - take_middle(values))))


def take_middle(values: npt.NDArray[Any]) -> complex:
    """Return the median, of real and imaginary part alone."""
    return complex(np.median(values.real), np.median(values.imag))


LAGS = 8
"""Maximum lag of the noise correlation, bins; on-chip filters extend over two or three."""
MAX_LEVERAGE = 0.5
"""Maximum share of a bin's noise in the common factor; bins above it are not used."""
MEDIAN_SPREAD = 1.2533
"""Ratio of the standard deviations of a median and a mean of Gaussian values, sqrt(pi / 2)."""


@dataclass(frozen=True)
class NoiseFloor:
    """Noise of an empty room. Shapes: by_bin_v2 (N,); correlation (L,), which is 0 where it is not significant."""

    power_v2: Estimate
    by_bin_v2: FloatArray
    correlation: ComplexArray
    correlation_sd: float
    independent_bins: float


def estimate_noise_floor(static: StaticPart, quiet: Mask) -> NoiseFloor:
    """Estimate the mean square of the noise, from differences of the residual by frame."""
    from scipy.stats import gamma

    steps = np.diff(static.rest_v, axis=0)
    correlation, correlation_sd = estimate_bin_correlation(steps, 1.5)
    taken = compute_leverage(static, correlation)
    by_bin = np.mean(np.abs(steps) ** 2, axis=0) / 2.0 / np.maximum(1.0 - taken, 1.0 - MAX_LEVERAGE)
    by_bin = np.where((taken > MAX_LEVERAGE) | ~quiet, np.nan, by_bin)
    used = by_bin[np.isfinite(by_bin)]
    weights = np.abs(correlation[1:]) ** 2
    independent = max(used.size / (1.0 + 2.0 * float(np.sum(weights))), 1.0)
    degrees = len(steps) / 1.5  # neighbouring differences share a frame: relative variance 1.5 / n
    middle = float(np.median(used)) / float(gamma.median(degrees) / degrees)
    spread = measure_scatter(used)
    least = float(np.sqrt(1.5 / len(steps))) * middle
    power = Estimate(middle, MEDIAN_SPREAD * max(spread, least) / float(np.sqrt(independent)))
    return NoiseFloor(power, by_bin, correlation, correlation_sd, independent)


def estimate_bin_correlation(rows: ComplexArray, per_row: float) -> tuple[ComplexArray, float]:
    """Estimate the noise correlation by lag and its uncertainty; ``per_row``: rows per independent one."""
    # a median over the bins, 0 from the first insignificant lag on
    unit = rows / np.sqrt(np.maximum(np.mean(np.abs(rows) ** 2, axis=0), 1e-300))
    rho = np.ones(min(LAGS, rows.shape[1] - 1) + 1, dtype=complex)
    for lag in range(1, rho.size):
        rho[lag] = take_middle(np.mean(unit[:, lag:] * unit[:, :-lag].conj(), axis=0))
    chance = 4.0 * math.sqrt(per_row / 1.5 / rows.size)
    rho[next((lag for lag in range(1, rho.size) if abs(rho[lag]) < chance), rho.size) :] = 0.0
    spread = 1.0 + 2.0 * float(np.sum(np.abs(rho[1:]) ** 2))
    return rho, MEDIAN_SPREAD * math.sqrt(per_row / rows.size / 2.0 * spread)


MAX_KNOTS = 20
CELLS_PER_KNOT = 4.0
"""Independent cells per knot, for an uncertainty of about 2 dB."""
KNOT_EXPONENT = 1.5
"""Exponent of the knot spacing; the direct path falls steeply near the radar."""


@dataclass(frozen=True)
class Profile:
    """Level at rising ranges or Doppler frequencies (M,), with its uncertainty."""

    axis: FloatArray
    level_db: FloatArray
    sd_db: FloatArray


def fit_clutter_profile(
    echo_v: ComplexArray, *, range_m: FloatArray, noise_power_v2: float, resolution_m: float
) -> Profile:
    """Fit the likeliest clutter, linear in dB between knots, to static echoes (N,)."""
    spacing = float(np.mean(np.diff(range_m)))
    sigma = resolution_m / (2.0 * math.sqrt(math.log(2.0)))
    per_cell = max(1.0, sigma * math.sqrt(2.0 * math.pi) / spacing)
    count = int(np.clip(len(range_m) / per_cell / CELLS_PER_KNOT, 2, MAX_KNOTS))
    knots = range_m[0] + (range_m[-1] - range_m[0]) * np.linspace(0.0, 1.0, count) ** KNOT_EXPONENT
    power = np.maximum(np.abs(echo_v) ** 2 - noise_power_v2, 0.1 * noise_power_v2)
    basis = np.stack([np.interp(range_m, knots, row) for row in np.eye(count)], axis=1)
    inverse = np.linalg.pinv(basis.T @ basis)
    # Fisher scoring for exponential powers with log mean basis @ logs; steps are limited, the cost is convex
    power = np.maximum(power, np.finfo(float).tiny)
    logs = np.asarray(inverse @ basis.T @ np.log(power), dtype=np.float64) + np.euler_gamma
    for _ in range(200):
        ratio = power * np.exp(-np.clip(basis @ logs, -700.0, 700.0))
        step = np.clip(inverse @ basis.T @ (ratio - 1.0), -1.0, 1.0)
        logs = logs + step
        if np.max(np.abs(step)) < 1e-9:
            break
    sd = DB_PER_NEPER * np.sqrt(np.diag(inverse) * per_cell)
    return Profile(knots, DB_PER_NEPER * logs, sd)


@dataclass(frozen=True)
class Leakage:
    """Strongest static echo nearby, and a constant over range."""

    level_db: Estimate
    constant_v: Estimate


NEAR_M = 1.0
"""Maximum range, m, of a static echo that counts as leakage from transmitter to receiver."""
BINS_PER_CELL = 2.0


def estimate_leakage(echo_v: ComplexArray, *, range_m: FloatArray, noise_power_v2: float) -> Leakage:
    """Estimate direct path and constant of the static echo. Shapes: echo_v (N,); range_m (N,)."""
    near = range_m < NEAR_M
    level = Estimate(-math.inf, math.inf)
    power = float(np.max(np.abs(echo_v[near]), initial=0.0) ** 2)
    if power > 0:
        level = Estimate(DB_PER_NEPER * math.log(power), 2.0 * DB_PER_NEPER * math.sqrt(noise_power_v2 / 2 / power))
    far = echo_v[~near] if (~near).sum() >= 4 else echo_v
    weights = 1.0 / (np.abs(far - take_middle(far)) ** 2 + (float(np.median(np.abs(far) ** 2)) + np.finfo(float).tiny))
    constant = np.sum(weights * far) / np.sum(weights)
    scatter = float(np.sqrt(np.sum(weights**2 * np.abs(far - constant) ** 2) * BINS_PER_CELL) / np.sum(weights))
    return Leakage(level, Estimate(float(abs(constant)), scatter))


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
    """Static echoes (N,), noise, phase and faults of a room; factors of its frames (I,)."""

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
    """Fit static echoes, phase and gain of every frame, and noise, without targets and faulty frames."""
    # y[i, n] = z_i c_n + w[i, n]: static echoes c, a complex factor z per frame (phase and gain), and white noise w
    # (E-18), which neighbouring bins may share
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
        echo = np.mean(samples, axis=0)  # too weak for a common phase: the mean over time alone
        static = subtract_static(samples, echo, np.zeros_like(echo))
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
