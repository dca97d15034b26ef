"""Measure a sensor in one recording: from the upper half of the Doppler band where it has only
noise, and from low quantiles elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import AnalysisError
from doppelgait.core.samples import Samples
from doppelgait.core.units import FloatArray, db_to_power, power_to_db
from doppelgait.radar.fit.room import (
    DB_PER_NEPER,
    FACTS,
    MAX_LEVERAGE,
    MAX_PHASE_VARIANCE,
    MEDIAN_SPREAD,
    MIN_BINS,
    MIN_FRAMES,
    ComplexArray,
    Estimate,
    Mask,
    Profile,
    Room,
    compute_factor_variance,
    compute_leverage,
    estimate_bin_correlation,
    fit_room,
    fit_static_part,
    list_notes,
    list_room_estimates,
    mark_dropped,
    measure_scatter,
    take_middle,
)
from doppelgait.radar.recording import Recording

Chosen = npt.NDArray[np.intp]

WINDOW = 64
"""Pulses of a window of a continuous recording; of a recording of bursts, each is a window."""
MIN_WINDOWS = 4
MAX_GROUPS = 16
"""Maximum number of groups of windows that the jackknife leaves out."""
MIN_PULSES = 8
QUANTILE = 0.25
"""Share of windows that are assumed to have no motion at a range and Doppler."""
WHITE_RATIO = 1.5
"""Minimum ratio of upper to lower power quartile, relative to noise (4.82), of cells that contain more than noise."""
QUARTILE_RATIO = math.log(4.0) / math.log(4.0 / 3.0)
"""Ratio of the quartiles of noise power."""
HANN_SHARE = 2.0
"""Number of Doppler cells per independent one; the Hann window correlates the noise of neighbouring cells."""
SLOW_CELLS = 3
"""Number of Doppler cells around 0 over which the window smears a static echo."""
LINE_SIGMAS, LINE_DB = 5.0, 3.0
"""Minimum excess of a line over its neighbours, in standard deviations and in dB."""
COHERENT = 0.4
"""Minimum share of its power that a line keeps if the whole recording is one window."""
MOVING_DB = 15.0
"""Minimum power over the noise, dB, of motion in a window that is used for the I/Q image."""
ONE_WAY = 0.5
"""Minimum difference of approaching and receding power in such a window over their sum (5 dB)."""


L = TypeVar("L")


@dataclass(frozen=True)
class Line(Generic[L]):
    """Doppler line shared by all ranges and most windows, or by recordings."""

    frequency_hz: float
    level_db: L
    half_width_hz: float


@dataclass(frozen=True)
class SensorMeasurement:
    """Sensor properties measured in one recording.

    Parameters
    ----------
    recording : Recording
    estimates : dict
        Scalars by the names of ``FACTS``, each with its uncertainty.
    refused, notes : dict
        Reasons, by the names of the quantities that the recording does not show, and warnings by their subject.
    room : Room or None
        Static echoes with their phase, noise, interference and faulty frames; None for few bins or frames.
    over_doppler : Profile
        Noise density over the absolute Doppler frequency, as the level of white noise, dB re 1 V;
        NaN where there was motion in too many windows.
    over_range : Profile or None
        Noise per bin relative to the mean over all bins, dB; None for fewer than eight bins.
    correlation, correlation_sd : ndarray, shape (L,), float
        Noise correlation at a lag of l bins, with its uncertainty; empty if refused.
    lines : tuple of Line
    full_scale_v, step_v, clipped : float
        Full scale and step of the converter (NaN if not visible), share of samples at full scale.
    echo_db : float
        Level of moving echoes, dB re 1 V: the median over the windows of the strongest bin; NaN without motion.
    """

    recording: Recording
    estimates: dict[str, Estimate]
    refused: dict[str, str]
    notes: dict[str, str]
    room: Room | None
    over_doppler: Profile
    over_range: Profile | None
    correlation: ComplexArray
    correlation_sd: float
    lines: tuple[Line[Estimate], ...]
    full_scale_v: float = math.nan
    step_v: float = math.nan
    clipped: float = 0.0
    echo_db: float = math.nan

    @property
    def uses(self) -> tuple[str, ...]:
        """Quantities for which the recording was used."""
        shown = {
            "noise": "noise_level_db" in self.estimates,
            "clutter": self.room is not None,
            "phase noise": "white_rad" in self.estimates,
            "frame drops": "frame drops" not in self.refused,
            "I/Q image, from what moved": "iq_gain_db" in self.estimates,
            "something moved: those ranges left out": self.room is not None and bool(self.room.moving),
        }
        return tuple(name for name, is_used in shown.items() if is_used)


def measure_recording(recording: Recording) -> SensorMeasurement:
    """Measure the sensor in one recording, with or without targets.

    Parameters
    ----------
    recording : Recording
        At least 4 windows of at least 8 pulses, with any number of range bins, in bursts or continuous.

    Raises
    ------
    AnalysisError
        If the recording is shorter, all zero, or has values that are not finite.
    """
    samples = np.asarray(recording.samples.matrix, dtype=np.complex128)
    n_pulses, n_bins = samples.shape
    burst = recording.facts.get("burst_pulses")
    short = max(1 << int(math.log2(max(n_pulses / MIN_WINDOWS / 2, 1))), MIN_PULSES)
    window = int(burst) if burst else min(WINDOW, short)
    if window < MIN_PULSES or n_pulses < MIN_WINDOWS * window or not samples.any():
        raise AnalysisError(
            f"{recording.source}: {n_pulses} pulses{f' in bursts of {window}' if burst else ''} are too few to measure "
            f"the sensor, or all are zero: at least {MIN_WINDOWS} windows of {MIN_PULSES} pulses are needed"
        )
    if not np.isfinite(samples).all():
        raise AnalysisError(f"{recording.source}: has values that are not finite; use a part without them")
    step_v, full_scale_v, at_limit = find_converter(samples)
    estimates: dict[str, Estimate] = {}
    refused: dict[str, str] = {}
    room = _fit_room(recording, refused)
    blank, repeated = mark_dropped(samples)
    bad = blank | (repeated & (n_bins >= MIN_BINS)) | at_limit.any(axis=1)
    rest, taken = _remove_common_phase(samples, bad)
    windows = _split_windows(rest, window)
    good = ~_split_windows(bad, window).any(axis=1)
    if good.sum() < MIN_WINDOWS:  # clipped nearly everywhere: a biased estimate, with this reason
        refused["noise"] = f"fewer than {MIN_WINDOWS} windows without clipped, blank or repeated samples"
        good = np.ones(len(windows), dtype=bool)
    f_hz, power, spectrum = compute_windowed_power(windows[good], recording.radar.prf_hz)
    power = power / np.maximum(1.0 - taken, 1.0 - MAX_LEVERAGE)
    upper = np.abs(f_hz) >= recording.radar.prf_hz / 4.0
    quiet = _find_quiet_windows(power, upper)
    over_range = None
    correlation, correlation_sd = np.empty(0, dtype=complex), math.nan
    echo_db = math.nan
    if quiet.sum() < MIN_WINDOWS:
        refused.setdefault("noise", "in the upper half of the Doppler band something moved nearly all of the time")
    if "noise" in refused:
        refused["I/Q image"] = "the noise is not known"
    else:
        calm = power[quiet][:, upper]
        (noise,) = _estimate_by_jackknife(
            lambda chosen: (power_to_db(_measure_bin_levels(calm[chosen])[0]),), int(quiet.sum())
        )
        estimates["noise_level_db"] = noise
        estimates |= _estimate_channel_noise(spectrum[quiet], f_hz, upper)
        if n_bins >= MIN_BINS:
            change_db = power_to_db(_measure_bin_levels(calm)[1]) - noise.value
            change_db[taken > MAX_LEVERAGE] = np.nan  # the common phase was estimated from these bins
            sd_db = DB_PER_NEPER * math.sqrt(HANN_SHARE / (calm.shape[0] * calm.shape[1])) * 1.5
            over_range = Profile(recording.range_m, change_db, np.full(n_bins, sd_db))
            cells = spectrum[quiet][:, upper]  # one far above the others contains an echo
            cells = np.where(np.abs(cells) > 4.0 * np.median(np.abs(cells), axis=(0, 1)), 0.0, cells)
            correlation, correlation_sd = estimate_bin_correlation(cells.reshape(-1, cells.shape[2]), HANN_SHARE)
        else:
            refused["noise over range"] = refused["noise correlation"] = f"{n_bins} range bins; {MIN_BINS} are needed"
        level_v2 = float(db_to_power(noise.value))
        fast = np.abs(f_hz) > SLOW_CELLS * recording.radar.prf_hz / window
        moving = power[:, fast].sum(axis=1) / window
        strongest_db = power_to_db(np.maximum(moving.max(axis=1), level_v2))
        if (busy := strongest_db > power_to_db(level_v2) + MOVING_DB).sum() >= MIN_WINDOWS:
            every = compute_windowed_power(windows, recording.radar.prf_hz)[1]
            echo_db = float(power_to_db(np.median((every[:, fast].sum(axis=1) / window).max(axis=1))))
            estimates |= _estimate_image(spectrum[busy], moving[busy], f_hz, refused)
        else:
            refused["I/Q image"] = "nothing moved fast and strongly enough to show an image"
    if n_bins < MIN_BINS:
        estimates |= _estimate_constant(_split_windows(samples, window).reshape(len(windows), -1), step_v)
    if room is not None:
        estimates |= list_room_estimates(room, recording, refused)
        if "iq_gain_db" in estimates:  # an image changes the phase rate, depending on the phase of the static echo
            gain = 10.0 ** (estimates["iq_gain_db"].value / 20.0)
            turn = gain * np.exp(1j * np.radians(estimates["iq_phase_deg"].value))
            share = math.sqrt(2.0) * float(abs((1.0 - turn.conjugate()) / (1.0 + turn)))
            for name in {"white_rad", "walk_rad_per_sqrt_min"} & set(estimates):
                phase = estimates[name]
                estimates[name] = Estimate(phase.value, math.hypot(phase.sd, share * phase.value))
        # frame differences use all of the Doppler band, at the ranges where nothing moves: they
        # have a quarter of the windows' error; in bursts they use one pulse of each only
        if not (burst or room.is_busy or at_limit.any(axis=1).mean() > 0.5):
            refused.pop("noise", None)
            refused.pop("noise correlation", None)
            estimates["noise_level_db"] = room.noise.power_v2.to_db(10.0)
            correlation, correlation_sd = room.noise.correlation, room.noise.correlation_sd
    if burst or room is None:
        refused["frame drops"] = "comes in bursts" if burst else "single frames cannot be distinguished"
    return SensorMeasurement(
        recording=recording,
        estimates={name: estimates[name] for name in FACTS if name in estimates},
        refused=refused,
        notes=list_notes(room, recording),
        room=room,
        over_doppler=_measure_over_doppler(f_hz, power),
        over_range=over_range,
        correlation=correlation,
        correlation_sd=correlation_sd,
        lines=_find_lines(rest, bad, recording, window),
        full_scale_v=full_scale_v,
        step_v=step_v,
        clipped=float(at_limit.mean()),
        echo_db=echo_db,
    )


def _split_windows(values: npt.NDArray[Any], window: int) -> npt.NDArray[Any]:
    """Return values (pulse, ...) as (window, pulse, ...), without the last incomplete window."""
    count = len(values) // window
    return values[: count * window].reshape(count, window, *values.shape[1:])


def compute_windowed_power(part: ComplexArray, prf_hz: float) -> tuple[FloatArray, FloatArray, ComplexArray]:
    """Return Doppler axis, power and spectrum of centred windows; white noise keeps its power."""
    length = part.shape[1]
    shape = np.hanning(length + 2)[1:-1]
    mean = np.tensordot(shape / shape.sum(), part, axes=(0, 1))[:, None]
    spectrum = np.fft.fft((part - mean) * shape[:, None], axis=1) / math.sqrt(float(np.sum(shape**2)))
    power: FloatArray = np.abs(spectrum) ** 2
    return np.asarray(np.fft.fftfreq(length, 1.0 / prf_hz)), power, spectrum


def find_converter(samples: ComplexArray) -> tuple[float, float, Mask]:
    """Return a converter's step, full scale and clipping, from values on a lattice."""
    parts = np.concatenate([samples.real.ravel(), samples.imag.ravel()])
    found, counts = np.unique(parts, return_counts=True)
    unclipped = np.zeros(samples.shape, dtype=bool)
    if found.size < 3 or found.size > parts.size / 2:
        return math.nan, math.nan, unclipped
    gaps = np.diff(found)
    step_v = float(gaps[gaps > 1e-6 * np.abs(found).max()].min())
    if np.abs(gaps / step_v - np.round(gaps / step_v)).max() > 0.02 or found[-1] / step_v > 2**24:
        return math.nan, math.nan, unclipped
    inner = max(float(np.median(counts)), 1.0)
    ends = [counts[:2].sum() > 20 * inner, counts[-2:].sum() > 20 * inner]  # the ends of I and Q may differ by one step
    if not all(ends) or found[0] >= 0 or found[-1] <= 0:
        return step_v, math.nan, unclipped
    full_v = float(max(-found[0], found[-1]))
    limit = full_v - 1.5 * step_v
    return step_v, full_v, np.asarray((np.abs(samples.real) >= limit) | (np.abs(samples.imag) >= limit))


def _fit_room(recording: Recording, refused: dict[str, str]) -> Room | None:
    """Fit the room of continuous frames, or of the first of every burst."""
    if burst := int(recording.facts.get("burst_pulses", 0)):
        time_s, first = recording.slow_time_s[::burst], Samples(recording.samples.matrix[::burst])
        radar = recording.radar.model_copy(update={"prf_hz": 1.0 / float(np.median(np.diff(time_s)))})
        recording = Recording(first, radar, time_s, recording.range_m, source=recording.source)
    try:
        return fit_room(recording)
    except AnalysisError as error:
        refused["clutter and phase noise"] = str(error)
        return None


def _remove_common_phase(samples: ComplexArray, bad: Mask) -> tuple[ComplexArray, FloatArray]:
    """Subtract static echoes times one factor per frame, if they are strong enough."""
    nothing = np.zeros(samples.shape[1])
    if samples.shape[1] < MIN_BINS or (~bad).sum() < MIN_FRAMES:
        return samples, nothing
    static = fit_static_part(samples[~bad])
    noise = float(np.median(np.abs(np.diff(static.rest_v, axis=0)) ** 2)) / math.log(2.0) / 2.0
    white = np.ones(1, dtype=complex)
    if compute_factor_variance(static, white, noise_power_v2=noise) > MAX_PHASE_VARIANCE:
        return samples, nothing
    rest = np.zeros_like(samples)
    rest[~bad] = static.rest_v
    return rest, compute_leverage(static, white)


def _find_quiet_windows(power: FloatArray, upper: Mask) -> Mask:
    """Return the windows with noise alone in the upper half-band, by the spread of their powers."""
    cells = power[:, upper]
    low, high = np.quantile(cells, (0.25, 0.75), axis=1)
    ratio = high / np.maximum(low, np.finfo(float).tiny) / QUARTILE_RATIO
    # few cells scatter: the limit is that of noise plus twice the spread, 2.6 / sqrt(independent cells)
    limit = WHITE_RATIO + 2.6 * math.sqrt(HANN_SHARE / upper.sum())
    return np.asarray(np.median(ratio, axis=1) < limit)


def compute_quantile_ratio(count: int) -> float:
    """Return the median ratio of noise powers' quantile to their mean."""
    # the share of exponential powers below an order statistic is beta distributed: 9 % more for 18 powers than for many
    from scipy.stats import beta

    order = QUANTILE * (count - 1)
    return -math.log1p(-float(beta.median(order + 1.0, count - order)))


def _measure_bin_levels(cells: FloatArray) -> tuple[float, FloatArray]:
    """Return the noise power, overall and of every bin, from low quantiles of quiet cells."""
    by_bin = np.quantile(cells.reshape(-1, cells.shape[2]), QUANTILE, axis=0)
    by_bin = by_bin / compute_quantile_ratio(cells.shape[0] * cells.shape[1])
    return float(np.median(by_bin)), by_bin


def _estimate_by_jackknife(estimate: Callable[[Chosen], tuple[float, ...]], count: int) -> list[Estimate]:
    """Return estimates with their jackknife uncertainty, by groups of consecutive windows."""
    groups = np.array_split(np.arange(count), min(MAX_GROUPS, count))
    left_out = np.array([estimate(np.setdiff1d(np.arange(count), group)) for group in groups]).T.copy()
    squares = (left_out - left_out.mean(axis=1, keepdims=True)) ** 2
    sds = np.sqrt((len(groups) - 1) / len(groups) * squares.sum(axis=1))
    return [Estimate(float(x), float(sd)) for x, sd in zip(estimate(np.arange(count)), sds, strict=True)]


def _measure_over_doppler(f_hz: FloatArray, power: FloatArray) -> Profile:
    """Return the noise level over the absolute frequency. It is NaN where there was motion."""
    size_hz = np.unique(np.abs(f_hz))
    level, sd = np.full(size_hz.size, np.nan), np.full(size_hz.size, np.nan)
    for place, frequency in enumerate(size_hz[2:], start=2):  # subtraction of the window's mean reduces the first
        cells = power[:, np.abs(f_hz) == frequency].reshape(-1, power.shape[2])
        low, high = np.quantile(cells, (0.25, 0.75), axis=0)
        limit = QUARTILE_RATIO * (WHITE_RATIO + 4.0 / math.sqrt(len(cells)))
        calm = high / np.maximum(low, np.finfo(float).tiny) < limit
        signs = [side for side in (frequency, -frequency) if side in f_hz]
        sides = [np.quantile(power[:, f_hz == side], 0.25, axis=0)[0] for side in signs]
        if len(sides) == 2:  # noise has equal power at both signs of Doppler, motion does not
            apart = np.abs(np.log(np.maximum(sides[0], 1e-300) / np.maximum(sides[1], 1e-300)))
            calm &= apart < 4.0 * 2.0 * math.sqrt(2.0 / len(power))
        if calm.mean() < 0.5 or (power.shape[2] < MIN_BINS and not calm.all()):
            continue
        level[place] = power_to_db(np.median(low[calm]) / compute_quantile_ratio(len(cells)))
        sd[place] = 2.0 * DB_PER_NEPER * math.sqrt(1.0 / (len(cells) * calm.sum()))
    return Profile(size_hz, level, sd)


def _find_lines(rest: ComplexArray, bad: Mask, recording: Recording, window: int) -> tuple[Line[Estimate], ...]:
    """Find lines in Doppler: cells over their neighbours in most windows and bins."""
    n_pulses, n_bins = rest.shape
    if not recording.facts.get("burst_pulses"):
        window = max(window, 1 << int(math.log2(max(n_pulses / 8, 1))))
    count = n_pulses // window
    good = ~_split_windows(bad, window).any(axis=1)
    if good.sum() < MIN_WINDOWS:
        return ()
    part = _split_windows(rest, window)[good]
    f_hz, power, _ = compute_windowed_power(part, recording.radar.prf_hz)
    low = np.quantile(power.reshape(-1, window, n_bins).transpose(1, 0, 2).reshape(window, -1), QUANTILE, axis=1)
    low /= compute_quantile_ratio(len(power) * n_bins)
    around = np.concatenate([np.arange(-6, -1), np.arange(2, 7)])
    floor = np.median(low[(np.arange(window)[:, None] + around) % window], axis=1)
    # the chip's filter correlates bins, and a target makes neighbours unequal: only a third of the cells counts
    needed = 1.0 + LINE_SIGMAS * 2.0 / math.sqrt(part.shape[0] * max(n_bins / 3.0, 1.0))
    stands = low > floor * max(needed, float(db_to_power(LINE_DB)))
    stands &= np.minimum(np.arange(window), window - np.arange(window)) > SLOW_CELLS
    # a line with noise scatters no more than noise; motion is stronger in some windows and bins
    lower, upper = np.quantile(power.transpose(1, 0, 2).reshape(window, -1), (0.25, 0.75), axis=1)
    stands &= upper < lower * WHITE_RATIO * QUARTILE_RATIO
    stands &= (low >= np.roll(low, 1)) & (low > np.roll(low, -1))
    gain = float(np.sum(np.hanning(window + 2)[1:-1]) ** 2 / np.sum(np.hanning(window + 2)[1:-1] ** 2))
    whole = None
    if not recording.facts.get("burst_pulses"):
        whole_hz, whole, _ = compute_windowed_power(rest[None, : count * window], recording.radar.prf_hz)
    found = []
    for place in np.flatnonzero(stands):
        logs = np.log(low[[place - 1, place, (place + 1) % window]])
        shift = float(0.5 * (logs[0] - logs[2]) / (logs[0] - 2 * logs[1] + logs[2]))
        middle = power[:, place].ravel()
        top = float(np.exp(-0.25 * (logs[0] - logs[2]) * shift))  # maximum between two cells
        peak = max(float(np.median(middle)) - floor[place], 0.1 * floor[place]) * top
        level = Estimate(
            float(power_to_db(peak / gain)), DB_PER_NEPER * float(np.std(np.log(middle))) / math.sqrt(len(part))
        )
        step_hz = recording.radar.prf_hz / window
        if whole is not None:  # a clock is coherent over the whole recording, a body at a steady speed is not
            near = np.abs(whole_hz - f_hz[place]) <= step_hz
            if np.median(whole[0, near], axis=1).max() < COHERENT * peak * count:
                continue
        found.append(Line(float(f_hz[place]) + shift * step_hz, level, 0.25 * step_hz))
    return tuple(found)


def _estimate_image(
    spectrum: ComplexArray, moving: FloatArray, f_hz: FloatArray, refused: dict[str, str]
) -> dict[str, Estimate]:
    r"""Estimate the quadrature channel's errors from moving echoes."""
    if f_hz.size < WINDOW / 2:
        refused["I/Q image"] = f"windows of {f_hz.size} pulses are too short for the direction of motion"
        return {}
    best = np.argmax(moving, axis=1)
    part = spectrum[np.arange(len(spectrum)), :, best]
    slow = np.abs(f_hz) <= SLOW_CELLS * (f_hz[1] - f_hz[0])
    part = np.where(slow, 0.0, part)
    mirrored = np.roll(part[:, ::-1], 1, axis=1)
    square = np.sum(part * mirrored, axis=1)
    whole = np.sum(np.abs(part) ** 2, axis=1)
    # phase noise gives a static echo equal sidebands, which are not circular: only motion in one direction counts
    one_way = np.abs(np.sum(np.abs(part) ** 2 * np.sign(f_hz), axis=1)) > ONE_WAY * whole
    if one_way.sum() < MIN_WINDOWS:
        refused["I/Q image"] = "no motion in one direction was fast and strong enough to show an image"
        return {}
    ratio = (square / whole)[one_way]
    gain, phase = _estimate_by_jackknife(lambda chosen: convert_ratio(take_middle(ratio[chosen])), len(ratio))
    # the jackknife of a median is inaccurate: the minimum is the scatter of the windows
    least = MEDIAN_SPREAD * measure_scatter(ratio) / math.sqrt(2.0 * len(ratio))
    if least > 0.2:
        refused["I/Q image"] = "the phase of the motion changed too little to show an image"
        return {}
    return {
        "iq_gain_db": Estimate(gain.value, max(gain.sd, 2.0 * DB_PER_NEPER * least)),
        "iq_phase_deg": Estimate(phase.value, max(phase.sd, math.degrees(least))),
    }


def convert_ratio(ratio: complex) -> tuple[float, float]:
    """Return gain (dB) and phase error (deg) of Q."""
    # from E y^2 / E |y|^2 = (1 - g^2 + 2 j g sin phi) / (1 + g^2) behind the channels
    in_phase, quadrature = (1.0 + ratio.real) / 2.0, (1.0 - ratio.real) / 2.0
    sine = ratio.imag / 2.0 / math.sqrt(max(in_phase * quadrature, 1e-12))
    gain_db = float(power_to_db(max(quadrature, 1e-9) / max(in_phase, 1e-9)))
    return gain_db, math.degrees(math.asin(min(max(sine, -1.0), 1.0)))


def _estimate_channel_noise(spectrum: ComplexArray, f_hz: FloatArray, upper: Mask) -> dict[str, Estimate]:
    """Estimate gain and phase of Q for noise alone, that of amplifiers behind the mixer."""
    both = upper & (f_hz != f_hz.min())  # half the pulse rate has no opposite frequency
    mirrored = np.roll(spectrum[:, ::-1], 1, axis=1)
    square = np.sum((spectrum * mirrored)[:, both], axis=(1, 2))
    whole = np.sum(np.abs(spectrum[:, both]) ** 2, axis=(1, 2))
    # every window has the same weight, because windows of high power may contain part of an echo
    ratio = square / whole
    gain, phase = _estimate_by_jackknife(lambda chosen: convert_ratio(complex(np.mean(ratio[chosen]))), len(ratio))
    return {"noise_iq_gain_db": gain, "noise_iq_phase_deg": phase}


def _estimate_constant(windows: ComplexArray, step_v: float) -> dict[str, Estimate]:
    """Estimate the constant of a radar with few bins. It is the median of I and the median of Q."""

    def take_middles(chosen: Chosen) -> tuple[float, float]:
        middle = take_middle(windows[chosen])
        return middle.real, middle.imag

    in_phase, quadrature = _estimate_by_jackknife(take_middles, len(windows))
    sd = math.hypot(math.hypot(in_phase.sd, quadrature.sd) / math.sqrt(2.0), np.nan_to_num(step_v) / math.sqrt(12.0))
    return {"dc_i_v": Estimate(in_phase.value, sd), "dc_q_v": Estimate(quadrature.value, sd)}
