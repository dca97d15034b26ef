"""Fit a sensor to its recordings: measurements are pooled, gain and noise figure fitted to them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import TypeVar

import numpy as np

from doppelgait.core.config import validate
from doppelgait.core.errors import AnalysisError
from doppelgait.core.units import db_to_amplitude, power_to_db
from doppelgait.radar.fit.measure import SLOW_CELLS, Line, SensorMeasurement, measure_recording
from doppelgait.radar.fit.room import DB_PER_NEPER, FACTS, MEDIAN_SPREAD, Estimate
from doppelgait.radar.link import echo_amplitude_v, find_noise_slope, noise_power_v2
from doppelgait.radar.parameters import Radar
from doppelgait.radar.recording import Recording

T = TypeVar("T")

MIN_FOR_SPREAD = 3
"""Minimum number of recordings for a spread."""
LEVEL = 0.95
MATTERS = 3.0
"""Minimum distance from 0, in standard deviations, of a fault in the model."""


@dataclass(frozen=True)
class PooledQuantity:
    """A quantity over several recordings.

    Parameters
    ----------
    mean : Estimate
    spread, low, high : float
        Standard deviation between recordings without the measurement error, and its 95 % interval;
        NaN for fewer than three recordings.
    count : int
        Number of recordings.
    """

    mean: Estimate
    spread: float
    low: float
    high: float
    count: int

    @property
    def spread_is_known(self) -> bool:
        """True if recordings differ by more than their uncertainties (level 2.5 %)."""
        return self.count >= MIN_FOR_SPREAD and self.low > 0.0


def pool(estimates: Iterable[Estimate]) -> PooledQuantity:
    r"""Pool estimates of a quantity that differs between recordings.

    Mean and spread :math:`\tau` of :math:`x_k = \mu + \tau u_k + s_k e_k` by Paule and Mandel (J. Res. NBS 87, 1982,
    377): :math:`Q(\tau^2) = \sum_k (x_k - \mu)^2 / (s_k^2 + \tau^2)` equals K - 1; the limits of :math:`\tau` are where
    it equals the quantiles of chi squared (Viechtbauer, Stat. Med. 26, 2007, 37). The uncertainty of the mean is that
    of the weighted mean, or the one from the scatter if that is larger.

    Raises
    ------
    AnalysisError
        If no estimate is finite.
    """
    from scipy.optimize import brentq
    from scipy.stats import chi2

    good = [e for e in estimates if math.isfinite(e.value) and math.isfinite(e.sd)]
    if not good:
        raise AnalysisError("nothing to pool: no recording shows this quantity")
    values, variances = np.array([e.value for e in good]), np.array([max(e.sd, 1e-12) ** 2 for e in good])
    count = len(good)

    def weighted(between: float) -> tuple[float, float, float]:
        weights = 1.0 / (variances + between)
        mean = float(np.sum(weights * values) / np.sum(weights))
        return mean, float(np.sum(weights * (values - mean) ** 2)), float(np.sum(weights))

    def variance_at(target: float) -> float:
        if weighted(0.0)[1] <= target:
            return 0.0
        most = float(np.var(values)) * count + 1e-30
        while weighted(most)[1] > target:
            most *= 10.0
        return float(brentq(lambda between: weighted(between)[1] - target, 0.0, most, xtol=most * 1e-12))

    spread = low = high = math.nan
    if count >= MIN_FOR_SPREAD:
        targets = [count - 1.0, *(float(chi2.ppf((1.0 + side * LEVEL) / 2.0, count - 1)) for side in (1, -1))]
        spread, low, high = (math.sqrt(variance_at(target)) for target in targets)
    mean, scatter, weight = weighted(np.nan_to_num(spread) ** 2)
    sd = math.sqrt(max(scatter / max(count - 1, 1), 1.0) / weight)
    return PooledQuantity(Estimate(mean, sd), spread, low, high, count)


PERSON_M2 = 0.8
"""Radar cross section of a person, from which the gain follows by the level of the echoes."""
PLAUSIBLE_NOISE_FIGURE_DB = (0.0, 30.0)


def rescale_radar(radar: Radar, scale_db: float) -> Radar:
    """Scale echoes, noise and counter step together: the SNR stays."""
    changes = {"receiver_gain_db": radar.receiver_gain_db + scale_db}
    if radar.threshold_step_v is not None:
        changes["threshold_step_v"] = radar.threshold_step_v * float(db_to_amplitude(scale_db))
    return radar.model_copy(update=changes)


def fit_gain(
    radar: Radar,
    same: Sequence[SensorMeasurement],
    pooled: dict[str, PooledQuantity],
    people_at_m: float | None,
    notes: dict[str, str],
    *,
    radar_is_known: bool,
) -> Radar:
    """Return a radar with fitted gain and noise figure; add their spread to ``pooled``."""
    if "noise_level_db" not in pooled:
        return radar
    direct = pooled.get("direct_path_db")
    if direct is not None and not (direct.count == len(same) and direct.spread_is_known):
        direct = None  # the gain of the units is not known
    channels = "noise_iq_gain_db" if is_noise_separate(pooled) else "iq_gain_db"
    quadrature_db = pooled[channels].mean.value if channels in pooled else 0.0
    added_db = DB_PER_NEPER * math.log((1.0 + 10.0 ** (quadrature_db / 10.0)) / 2.0)
    gain_db = 0.0
    echoes = [m.echo_db for m in same if math.isfinite(m.echo_db)]
    if people_at_m is not None and echoes:
        expected_v = float(echo_amplitude_v(radar, range_m=people_at_m, rcs_m2=PERSON_M2))
        gain_db = float(np.median(echoes)) - 20.0 * math.log10(expected_v)

    def figures() -> PooledQuantity:
        values = []
        for one in same:
            if "noise_level_db" not in one.estimates:
                continue
            level = one.estimates["noise_level_db"]
            own, own_db, own_sd = one.recording.radar, 0.0, 0.0
            if radar_is_known:
                own = radar.model_copy(update={"prf_hz": own.prf_hz})
            if direct is not None:
                own_db = one.estimates["direct_path_db"].value - direct.mean.value
                own_sd = one.estimates["direct_path_db"].sd
            own = rescale_radar(own, gain_db)  # units differ in gain, not in a counter's step
            own = own.model_copy(update={"receiver_gain_db": own.receiver_gain_db + own_db})
            slope = find_noise_slope(own)  # E-18, E-18b
            excess_db = level.value - added_db - float(power_to_db(noise_power_v2(own)))
            figure_sd = math.hypot(level.sd / slope, own_sd)
            values.append(Estimate(own.noise_figure_db + excess_db / slope, figure_sd))
        return pool(values)

    figure = figures()
    lowest_db, highest_db = PLAUSIBLE_NOISE_FIGURE_DB
    if people_at_m is None and not lowest_db <= figure.mean.value <= highest_db:
        notes["noise figure"] = (
            f"{figure.mean.value:.1f} dB would be needed: the preset changes the receiver gain instead, that is the "
            "scale of the file against volts"
        )
        plausible_db = max(radar.noise_figure_db, MATTERS * (figure.spread if figure.spread_is_known else 0.0))
        gain_db = (figure.mean.value - plausible_db) * find_noise_slope(radar)
        figure = figures()
    if direct is not None:
        pooled["gain_db"] = direct
        # no level shows the difference between the mean gain of these units and that of their kind
        mean = Estimate(figure.mean.value, math.hypot(figure.mean.sd, direct.mean.sd))
        figure = replace(figure, mean=mean)
    pooled["noise_figure_db"] = figure
    limited_db = min(max(figure.mean.value, 0.0), 100.0)
    fitted = {**rescale_radar(radar, gain_db).model_dump(), "noise_figure_db": limited_db}
    return validate(Radar, fitted, where=f"the radar fitted to {len(same)} recordings; its values should be in V")


def is_noise_separate(pooled: Mapping[str, PooledQuantity]) -> bool:
    """Return True if noise and echo images differ: the noise then arises behind the mixer."""
    for name, least in (("iq_gain_db", 0.5), ("iq_phase_deg", 3.0)):
        if name not in pooled:
            return False
        echo, noise = pooled[name].mean, pooled[f"noise_{name}"].mean
        if abs(echo.value - noise.value) > max(MATTERS * math.hypot(echo.sd, noise.sd), least):
            return True
    return False


SAME = 0.05
"""Maximum relative difference of carrier and bin spacing between recordings of one kind."""
SHAPE_DB = 1.0
"""Minimum deviation, dB, of a noise floor in the model, with three standard deviations."""


@dataclass(frozen=True)
class SensorKind:
    """Sensor of one recording, or distributions of the sensors of one kind.

    Parameters
    ----------
    radar : Radar
        Radar of the longest recording, or the radar that was passed to the fit, with fitted noise and gain.
    recordings : tuple of SensorMeasurement
        Measurements of each recording.
    pooled : dict
        Scalars by the names of ``FACTS``.
    refused, notes : dict
        Reasons, by the names of the quantities that recordings do not show, and warnings by their subject.
    left_out : tuple of str
        Recordings that were not used, with the reasons.
    clutter : tuple of (range_m, Pooled)
        Level at the knots, dB re 1 V.
    doppler : tuple of (frequency_hz, Estimate)
        Noise level relative to the white floor, dB, without the frequencies at which there was motion.
    doppler_step_hz : float
        Spacing of the frequencies.
    range_db : tuple of (range_m, change_db)
        Noise level relative to the mean over all ranges; empty if it is flat.
    correlation : tuple of float or None
        Noise correlation at lags of 1, 2, ... bins, empty for white noise; None if it was not measured.
    lines : tuple of Line
        Doppler lines that at least half of the recordings share, with pooled levels.
    run_length : float
        Mean number of frames lost in a row.
    bits, full_scale_v, clipped : int, float, float
        Bits (0 if unknown) and full scale of the converter (NaN if unknown), share of samples there.
    """

    radar: Radar
    recordings: tuple[SensorMeasurement, ...]
    pooled: dict[str, PooledQuantity]
    refused: dict[str, str]
    notes: dict[str, str]
    left_out: tuple[str, ...]
    clutter: tuple[tuple[float, PooledQuantity], ...]
    doppler: tuple[tuple[float, Estimate], ...]
    doppler_step_hz: float
    range_db: tuple[tuple[float, float], ...]
    correlation: tuple[float, ...] | None
    lines: tuple[Line[PooledQuantity], ...]
    run_length: float
    bits: int
    full_scale_v: float
    clipped: float


def _find_difference(radar: Radar, other: Radar) -> str:
    """Return how two radars differ, or ""; frames of other rates have other noise."""
    if abs(radar.carrier_hz / other.carrier_hz - 1.0) > SAME:
        return f"carrier {radar.carrier_hz / 1e9:.4g} GHz instead of the {other.carrier_hz / 1e9:.4g} GHz"
    if abs(radar.prf_hz / other.prf_hz - 1.0) > SAME:
        return f"{radar.prf_hz:.4g} frames a second instead of the {other.prf_hz:.4g}"
    return ""


def fit_sensor(
    recordings: Recording | Iterable[Recording], *, radar: Radar | None = None, people_at_m: float | None = None
) -> SensorKind:
    """Fit a sensor to one recording, or a sensor kind to several.

    Parameters
    ----------
    recordings : Recording or iterable of Recording
        Unlabelled recordings of empty rooms or daily life, with one carrier and frame rate; others are not used.
    radar : Radar, optional
        Source of the parameters that no recording states: power, antenna gains, pulse. By default
        the radar of the longest recording.
    people_at_m : float, optional
        Median range of the people in the recordings: the receiver gain is set so that 0.8 m^2 at
        this range has the level of the echoes. By default the gain is not changed.

    Raises
    ------
    AnalysisError
        If no recording can be used, or none shows any quantity.
    """
    measured: list[SensorMeasurement] = []
    left_out: list[str] = []
    for number, recording in enumerate([recordings] if isinstance(recordings, Recording) else recordings):
        try:
            measured.append(measure_recording(recording))
        except AnalysisError as error:
            left_out.append(str(error) if recording.source else f"recording {number}: {error}")
    if not measured:
        raise AnalysisError("no recording can be used; " + "; ".join(left_out))
    longest = max(measured, key=lambda one: one.recording.samples.matrix.size).recording
    base = _set_axes(longest.radar if radar is None else radar, longest)
    same = []
    for one in measured:
        difference = _find_difference(one.recording.radar, longest.radar)
        if difference:
            left_out.append(f"{one.recording.source}: {difference} of {longest.source}, the longest recording")
        else:
            same.append(one)
    spaced = [m for m in same if abs(m.recording.radar.bin_spacing_m / longest.radar.bin_spacing_m - 1.0) <= SAME]
    if len(spaced) < len(same):
        left_out.append(
            f"{len(same) - len(spaced)} recordings have other range bins: not used for clutter, correlation and shape"
        )
    pooled = {name: pool(values) for name, values in _collect([m.estimates for m in same]).items()}
    refused, notes = _count_reasons([m.refused for m in same]), _count_reasons([m.notes for m in same])
    if not pooled:
        reasons = "; ".join(f"{name}: {why}" for name, why in refused.items())
        raise AnalysisError(f"{longest.source or 'recording'}: shows no quantity of the sensor; {reasons}")
    base = fit_gain(base, same, pooled, people_at_m, notes, radar_is_known=radar is not None)
    if people_at_m is None and "direct_path_db" not in pooled:
        refused["receiver gain"] = "no level of a known echo; give the range of the people to set it"
    share, length = _pool_drops(same)
    if share is not None:
        pooled["drop_probability"] = share
    pooled = {name: pooled[name] for name in FACTS if name in pooled}
    step_v = min((m.step_v for m in same if math.isfinite(m.step_v)), default=math.nan)
    limits = [m.full_scale_v for m in same if math.isfinite(m.full_scale_v)]
    full_v = float(np.median(limits)) if limits else math.nan
    bits = 0
    if math.isfinite(step_v):
        bits = round(math.log2(2.0 * full_v / step_v)) if limits else 16
        if not limits:
            refused["full scale of the converter"] = "never reached; 16 bits are assumed"
    else:
        refused["converter"] = "the values show no steps"
    doppler, doppler_step_hz = _pool_doppler(same, refused)
    return SensorKind(
        radar=base,
        recordings=tuple(same),
        pooled=pooled,
        refused=refused,
        notes=notes,
        left_out=tuple(left_out),
        clutter=_pool_clutter(spaced),
        doppler=doppler,
        doppler_step_hz=doppler_step_hz,
        range_db=_pool_over_range(spaced),
        correlation=_pool_correlation(spaced),
        lines=_pool_lines(same),
        run_length=length,
        bits=bits,
        full_scale_v=full_v if limits else step_v * 2.0**15,
        clipped=float(np.mean([m.clipped for m in same])),
    )


def _collect(tables: Sequence[Mapping[str, T]]) -> dict[str, list[T]]:
    """Return the values of every key in any of the tables."""
    names = dict.fromkeys(name for table in tables for name in table)
    return {name: [table[name] for table in tables if name in table] for name in names}


def _count_reasons(tables: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return the commonest text of every key, with its recordings."""
    return {
        name: max(texts, key=texts.count)
        + (f" (in {len(texts)} of {len(tables)} recordings)" if len(tables) > 1 else "")
        for name, texts in _collect(tables).items()
    }


def _set_axes(radar: Radar, recording: Recording) -> Radar:
    """Return a radar with a recording's rate and range axis."""
    changes = {"prf_hz": recording.radar.prf_hz}
    if recording.n_range_bins > 1:
        start_m = max(float(recording.range_m[0]), 0.0)
        stop_m = start_m + (recording.n_range_bins - 0.5) * radar.bin_spacing_m
        changes |= {"range_start_m": start_m, "range_stop_m": stop_m}
    return Radar.model_validate({**radar.model_dump(), **changes})


def _pool_drops(same: Sequence[SensorMeasurement]) -> tuple[PooledQuantity | None, float]:
    counted = [m.room.faults for m in same if m.room is not None and "frame drops" not in m.refused]
    if not counted:
        return None, 1.0
    frames = [faults.dropped.size + faults.lost for faults in counted]
    dropped, runs = (sum(values) for values in zip(*((int(f.dropped.sum()), f.runs) for f in counted), strict=True))
    length = dropped / runs if runs else 1.0
    share = (sum(f.faulty for f in counted) + 0.5) / (sum(frames) + 1.0)
    # runs of mean length L scatter 2 L - 1 times as much as single frames; the share is common to
    # all recordings, because that of a recording without dropped frames is not known exactly
    each = share * (1.0 - share) * (2.0 * length - 1.0)
    shares = (Estimate(f.faulty / n, math.sqrt(each / n)) for f, n in zip(counted, frames, strict=True))
    return pool(shares), length


def _pool_clutter(spaced: Sequence[SensorMeasurement]) -> tuple[tuple[float, PooledQuantity], ...]:
    """Pool the clutter at the knots of the longest frame."""
    profiles = [(m.recording.range_m.size, m.room.clutter) for m in spaced if m.room is not None]
    if not profiles:
        return ()
    knots = max(profiles, key=lambda pair: pair[0])[1].axis
    found = []
    for knot in knots.tolist():
        at_knot = [c for _, c in profiles if c.axis[0] - 0.1 <= knot <= c.axis[-1] + 0.1]
        sds = [float(np.interp(knot, c.axis, c.sd_db)) for c in at_knot]
        levels = [float(np.interp(knot, c.axis, c.level_db)) for c in at_knot]
        found.append((knot, pool(map(Estimate, levels, sds))))
    return tuple(found)


def _pool_doppler(
    same: Sequence[SensorMeasurement], refused: dict[str, str]
) -> tuple[tuple[tuple[float, Estimate], ...], float]:
    """Return noise over the floor by Doppler, and cell width, with the fastest one's windows."""
    from scipy.ndimage import binary_dilation

    usable = [m for m in same if "noise_level_db" in m.estimates]
    if not usable:
        return (), math.nan
    axis_hz = max(usable, key=lambda m: m.recording.radar.prf_hz).over_doppler.axis
    step_hz = float(axis_hz[1])
    on_axis = [m for m in usable if m.over_doppler.axis.shape == axis_hz.shape]
    on_axis = [m for m in on_axis if np.allclose(m.over_doppler.axis, axis_hz, rtol=SAME)]
    between_db = np.nan_to_num(pool(m.estimates["noise_level_db"] for m in usable).spread)
    level = np.array([m.over_doppler.level_db - m.estimates["noise_level_db"].value for m in on_axis])
    count = np.isfinite(level).sum(axis=0)
    sd = np.where(np.isfinite(level), [m.over_doppler.sd_db for m in on_axis], np.nan)
    level, sd = (np.where(count > 0, x, 0.0) for x in (level, sd))
    middle, sd = (np.nanmedian(x, axis=0) for x in (level, sd))
    # noise is the same in all recordings except for the spread of the floor; motion is not
    scatter = 1.4826 * np.nanmedian(np.abs(level - middle), axis=0) * (count >= 4)
    missing = (count < len(on_axis) / 2) | (scatter > 1.5 * np.hypot(sd, between_db) + 0.5)
    missing[:2] = False  # subtraction of the window's mean reduces these
    # the window smears motion into neighbouring cells
    shown = ~binary_dilation(missing, iterations=2) & (axis_hz > (SLOW_CELLS + 0.5) * step_hz)
    sd = MEDIAN_SPREAD * np.maximum(scatter, sd) / np.sqrt(np.maximum(count, 1))
    if missing.any():
        first_hz, last_hz = axis_hz[missing][[0, -1]]
        refused["noise over Doppler"] = (
            f"something moved at {first_hz:.3g} to {last_hz:.3g} Hz in too many windows; no more than the white "
            "floor is assumed there"
        )
    columns = (x[shown].tolist() for x in (axis_hz, middle, sd))
    return tuple((f, Estimate(value, error)) for f, value, error in zip(*columns, strict=True)), step_hz


def _pool_over_range(spaced: Sequence[SensorMeasurement]) -> tuple[tuple[float, float], ...]:
    """Return the noise over range, or nothing if it is flat. Bins are averaged in groups."""
    profiles = [m.over_range for m in spaced if m.over_range is not None]
    if not profiles:
        return ()
    range_m = max((profile.axis for profile in profiles), key=len)
    edges = np.linspace(range_m[0], range_m[-1], 9)
    found, bent = [], False
    for low, high in pairwise(edges):
        values = []
        for profile in profiles:
            inside = (profile.axis >= low) & (profile.axis <= high) & np.isfinite(profile.level_db)
            if inside.sum() >= 3:
                sd = MEDIAN_SPREAD * float(np.median(profile.sd_db[inside])) / math.sqrt(inside.sum() / 2.0)
                values.append(Estimate(float(np.median(profile.level_db[inside])), sd))
        if not values:
            continue
        level = pool(values).mean
        found.append((float(low + high) / 2.0, level.value))
        bent |= abs(level.value) > max(SHAPE_DB, 3.0 * level.sd)
    return tuple(found) if bent else ()


def _pool_correlation(spaced: Sequence[SensorMeasurement]) -> tuple[float, ...] | None:
    usable = [m for m in spaced if m.correlation.size]
    if not usable:
        return None
    values: list[float] = []
    for lag in range(1, min(m.correlation.size for m in usable)):
        rho = pool(Estimate(float(m.correlation[lag].real), m.correlation_sd) for m in usable).mean
        if abs(rho.value) <= MATTERS * rho.sd:
            break
        values.append(rho.value)
    return tuple(values)


def _pool_lines(same: Sequence[SensorMeasurement]) -> tuple[Line[PooledQuantity], ...]:
    """Return lines that at least half of the recordings share, and at least two."""
    groups: list[list[Line[Estimate]]] = []
    for line in sorted((line for m in same for line in m.lines), key=lambda line: line.frequency_hz):
        if groups and line.frequency_hz - groups[-1][0].frequency_hz <= 2 * line.half_width_hz:
            groups[-1].append(line)
        else:
            groups.append([line])
    return tuple(
        Line(
            float(np.median([line.frequency_hz for line in group])),
            pool(line.level_db for line in group),
            group[0].half_width_hz,
        )
        for group in groups
        if len(group) >= max(2, len(same) / 2)
    )


MAINS_HZ = (50.0, 60.0)


def find_mains_harmonic(frequency_hz: float, prf_hz: float, half_width_hz: float) -> str:
    """Return the mains harmonic at the frequency of a line, with aliasing, or ""."""
    for mains_hz, multiple, sign in product(MAINS_HZ, range(1, 9), (1.0, -1.0)):
        seen = (sign * multiple * mains_hz + prf_hz / 2.0) % prf_hz - prf_hz / 2.0
        if abs(seen - frequency_hz) <= half_width_hz:
            return f"{multiple} x {mains_hz:g} Hz"
    return ""
