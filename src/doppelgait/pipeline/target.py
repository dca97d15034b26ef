"""Analysis of a target, from gate to features."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from doppelgait import features as feature_layer
from doppelgait import processing
from doppelgait.core.frames import Frames
from doppelgait.core.labels import OTHER_SIDES, SIGNATURE, Signal
from doppelgait.core.lazy import xr
from doppelgait.core.units import FloatArray
from doppelgait.features import Extraction, Observation, liland2018
from doppelgait.features.extended import measure_extended
from doppelgait.features.ground_motion import HIDDEN_COSINE, GroundMotion, estimate_ground_motion
from doppelgait.features.observed import share_extended, share_set_f
from doppelgait.features.uncertainty import estimate_uncertainties, flag_uncertain_features
from doppelgait.pipeline.result import LateArrays, Result, read_signal
from doppelgait.processing import Analysis, Gate, main_line
from doppelgait.processing.cadence import CadenceParts
from doppelgait.processing.parts import PARTS, locate_parts
from doppelgait.processing.receiver import read_flags
from doppelgait.processing.signature import compute_signature

ALIGNED = "aligned"  # attribute of a cadence map: its Doppler is relative to the main line (E-29)
SHARED = "other_bodies_share"  # share of the time that is left out because of other bodies
MAX_SHARED = 1.0 / 3.0  # with more, features of the rest may differ from those of the whole
GROUND_QUALITY = ("ground_speed_mps", "aspect_deg", "ground_step_length_m")
OPPOSITE_MPS = 0.5
"""Lowest speed of a torso; limbs of a person who walks the other way do not stay above it."""
STANDING_MPS = 0.3  # highest speed of feet on the ground, with the blur of the window
MIN_COUNTED_S = 2.0  # shortest time without other bodies that is analysed alone
MAX_TOGETHER = 8  # targets that are measured together: more leave the cache of the processor


class Gated(NamedTuple):
    """Signature of the target in a gate, and what its analysis needs."""

    signature: Signal
    gate: Gate
    analysis: Analysis
    label: str | None
    frames: Frames | None = None  # without clutter, for the parts of the body alone


class Target(NamedTuple):
    """Target with its columns inside the frame, and their share of the gate."""

    gated: Gated
    usable: Signal
    gate_share: float


def compute_gated(clean: Frames, wavelength_m: float, gate: Gate, analysis: Analysis, label: str | None) -> Gated:
    """Compute the signature in a gate of frames without clutter."""
    clean = gate.crop(clean) if gate.source == "truth" else clean  # a body that comes or goes: while it is there
    mu = compute_signature(clean, gate, analysis, wavelength_m=wavelength_m)
    return Gated(mu, gate, analysis, label, clean if analysis.parts else None)


def analyze_gated(clean: Frames, wavelength_m: float, gate: Gate, analysis: Analysis) -> Result:
    """Analyse the target in a gate of frames without clutter."""
    return analyze_targets([compute_gated(clean, wavelength_m, gate, analysis, None)])[0]


def mark_other_bodies(target: Gated, others: Sequence[Gate]) -> Gated:
    """Mark what other bodies occupy while they share range, if enough columns remain."""
    mu, gate = target.signature, target.gate
    times_s = mu.axis("time")
    own_mps, sides = gate.approach_mps(times_s), np.zeros(times_s.size, dtype=np.int8)
    for other in others:
        # limbs of a body that advances stay on the side of its torso
        other_mps = other.approach_mps(times_s)
        apart = (own_mps * other_mps < 0) & (np.minimum(np.abs(own_mps), np.abs(other_mps)) >= OPPOSITE_MPS)
        side = np.where(apart, np.where(other_mps > 0, 2, 1), 3)
        sides |= np.where(gate.shares(other, times_s), side, 0).astype(np.int8)
    counted_s = float((sides < 3).mean() * np.ptp(times_s))
    if not sides.any() or counted_s < MIN_COUNTED_S or target.analysis.method == "liland2018":
        return target
    return target._replace(signature=replace(mu, coords={**mu.coords, OTHER_SIDES: (("time",), sides, {"units": "1"})}))


def _clear_other_sides(mu: Signal, floor_v2: float) -> Signal:
    # what other bodies occupy is replaced by the noise floor
    sides, velocity_mps = mu.axis(OTHER_SIDES)[:, np.newaxis], mu.axis("velocity")
    receding, approaching = velocity_mps < STANDING_MPS, velocity_mps > -STANDING_MPS  # with standing feet
    cleared = ((sides & 1) > 0) & receding | ((sides & 2) > 0) & approaching
    below_v2 = np.nextafter(mu.values.dtype.type(floor_v2), mu.values.dtype.type(0))  # nothing is above the floor
    return mu.replace(np.where(cleared, below_v2, mu.values))


def _add_parts(result: Result, target: Gated, clean: Frames) -> Result:
    """Add the powers of torso, legs and limbs (E-40)."""
    mask, reason = None, "recorded_in_bursts"
    clean = clean.find_bursts()
    if clean.slow_time.burst_pulses is None:
        mask, reason = locate_parts(clean, read_signal(result, "signature"), target.gate, target.analysis)
    if mask is None:
        return replace(result, flags=(*result.flags, f"parts:{reason}"))
    power = mask.power_v2(clean, target.analysis, wavelength_m=target.signature.attrs["wavelength_m"])
    energy = power.values.sum(axis=(1, 2), dtype=np.float64)
    shares = {f"{name}_energy_share": float(share) for name, share in zip(PARTS, energy / energy.sum(), strict=True)}
    arrays = LateArrays(result.arrays, part_power=power)
    return replace(result, quality={**result.quality, **shares}, arrays=arrays)


def analyze_signature(mu: Signal | xr.DataArray, gate: Gate, analysis: Analysis, *, label: str | None) -> Result:
    """Analyse one target's signature."""
    return analyze_targets([Gated(Signal.of(mu, SIGNATURE), gate, analysis, label)])[0]


def analyze_targets(gated: Sequence[Gated]) -> list[Result]:
    """Analyse targets, also of several recordings; those with equal axes are measured together."""
    # The result of a target does not depend on the others, to the last bit. The first faulty
    # signature raises.
    targets, alike = [], defaultdict(list)
    for n, one in enumerate(gated):
        mu, analysis = one.signature, one.analysis
        usable, share = processing.crop_to_frame(mu if analysis.method == "liland2018" else processing.decimate(mu))
        targets.append(Target(one, usable, share))
        # signatures with equal axes are arrays of equal shape
        facts = (usable.attrs[name] for name in ("wavelength_m", "prf_hz", "hop", "cpi_pulses"))
        axes = usable.axis("time").tobytes(), usable.axis("doppler").tobytes(), usable.counted.tobytes()
        alike[analysis.method, analysis.extended, *facts, *axes].append(n)
    found: dict[int, Result] = {}
    for numbers in alike.values():
        for first in range(0, len(numbers), MAX_TOGETHER):
            tile = numbers[first : first + MAX_TOGETHER]
            found |= zip(tile, _analyze_alike([targets[n] for n in tile]), strict=True)
    return [found[n] if one.frames is None else _add_parts(found[n], one, one.frames) for n, one in enumerate(gated)]


def _analyze_alike(targets: Sequence[Target]) -> list[Result]:
    analysis = targets[0].gated.analysis
    if analysis.method == "liland2018":
        return [_make_result(target, None, None) for target in targets]
    observed = observe_alike([target.usable for target in targets], [target.gated.analysis for target in targets])
    deviations: Sequence[dict[str, float | None] | None] = [None] * len(targets)
    if analysis.extended:
        share_extended(observed)
        deviations = estimate_uncertainties(observed)
    return [_make_result(*facts) for facts in zip(targets, observed, deviations, strict=True)]


def _make_result(target: Target, observed: Observation | None, deviations: dict[str, float | None] | None) -> Result:
    """Make the result of a target; without an observation it is analysed as in the report."""
    (mu, gate, analysis, label, _), usable, share = target
    shown = usable if usable is mu else processing.crop_to_frame(mu)[0]
    thinned = usable.attrs["hop"] != mu.attrs["hop"]
    further: dict[str, Any] = {}
    over_time: dict[str, Any] = {}
    if observed is None:
        # the report: columns over their maximum, mean removed, plain transform, sum over Doppler
        normalised = processing.normalise(shown, 0.0, mode="max")
        rows = processing.detrend(normalised, order=0)
        cadence_map = processing.cadence_map(rows, padded=False, tapered=False)
        spectrum = processing.cadence_spectrum(cadence_map, power=False)
        mean = processing.mean_doppler_spectrum(normalised)
        extraction = liland2018.extract(
            mean,
            usable.axis("doppler"),
            spectrum,
            wavelength_m=float(usable.attrs["wavelength_m"]),
            threshold=analysis.bandwidth_threshold,
        )
        line_hz = np.full(usable.sizes["time"], extraction.torso_doppler_hz)
        late = LateArrays(
            normalised_signature=normalised,
            cadence_map=cadence_map,
            cadence_spectrum=spectrum,
            mean_doppler_spectrum=mean,
        )
    else:
        extraction, line_hz = observed.extraction, observed.main_line_hz
        # kept is the signature alone: a long recording has hundreds of segments
        renew = partial(processing.normalise, observed.signature, observed.floor_v2, mode=analysis.normalisation)
        order = processing.detrend_order(observed.observation_s)
        late = LateArrays(
            normalised_signature=renew,
            cadence_map=partial(_draw_cadence_map, renew, observed.drift_hz, order),
            cadence_spectrum=observed.spectrum,
            mean_doppler_spectrum=lambda: processing.mean_doppler_spectrum(renew()),
        )
        if deviations is not None:
            follow = partial(_follow_torso, observed.signature, observed.floor_v2, line_hz, shown.axis("time"))
            over_time["torso_velocity_mps"] = follow
            further["extended"] = measure_extended(observed)
    sd = deviations or {}
    motion, ground_sd, flags = _measure_ground_motion(usable, gate, extraction, sd)
    further["standard_deviation"] = {**sd, **ground_sd}
    if share < 1.0:
        flags.append("gate_leaves_frame")
    shared = {SHARED: 1.0 - float(usable.counted.mean())} if OTHER_SIDES in usable.coords else {}
    if thinned:
        times_s = usable.axis("time")
        slope = (line_hz[-1] - line_hz[0]) / (times_s[-1] - times_s[0])
        line_hz = np.asarray(line_hz[0] + slope * (shown.axis("time") - times_s[0]))
    return Result(
        analysis=analysis,
        label=label,
        gate_source=gate.source,
        gate_limits=gate,
        features=extraction.features,
        gait_frequency_hz=extraction.gait_frequency_hz,
        torso_doppler_hz=extraction.torso_doppler_hz,
        n_periods=extraction.n_periods,
        quality={**extraction.quality, **motion, "gate_inside_frame": share, **shared},
        flags=tuple(flags),
        arrays=LateArrays(late, signature=shown, main_line_hz=line_hz, **over_time),
        **further,
    )


def _follow_torso(mu: Signal, floor_v2: float, line_hz: FloatArray, times_s: FloatArray) -> FloatArray:
    return np.interp(times_s, mu.axis("time"), main_line.torso_velocity_mps(mu, floor_v2, line_hz))


def _draw_cadence_map(renew: Callable[[], Signal], drift_hz: FloatArray | None, order: int) -> Signal:
    rows = renew() if drift_hz is None else processing.align(renew(), drift_hz)
    drawn = processing.cadence_map(processing.detrend(rows, order=order))
    drawn.attrs[ALIGNED] = drift_hz is not None
    return drawn


def _measure_ground_motion(
    mu: Signal, gate: Gate, extraction: Extraction, deviations: Mapping[str, float | None]
) -> tuple[dict[str, Any], dict[str, float | None], list[str]]:
    """Measure ground speed and aspect, their deviations and flags (E-34b)."""
    centre_m = mu.axis("centre_range")
    follows = centre_m.max() > centre_m.min()  # a fixed gate does not follow a target
    motion = (
        estimate_ground_motion(mu.axis("time"), centre_m, range_sd_m=gate.range_sd_m) if follows else GroundMotion()
    )
    step_m = step_sd_m = None
    frequency_hz, frequency_sd_hz = extraction.gait_frequency_hz, deviations.get("gait_frequency_hz")
    if motion.ground_speed_mps is not None and frequency_hz is not None and "speed" not in motion.uncertain:
        step_m = motion.ground_speed_mps / frequency_hz
        if motion.ground_speed_sd_mps is not None and frequency_sd_hz is not None:
            step_sd_m = math.hypot(motion.ground_speed_sd_mps, step_m * frequency_sd_hz) / frequency_hz
    flags = [*read_flags(mu.attrs), *extraction.flags, *flag_uncertain_features(extraction, deviations)]
    if motion.reason == "path_is_not_straight":
        flags.append(f"ground_speed,aspect:{motion.reason}")
    flags += motion.uncertain.values()
    cosine = 1.0 if motion.aspect_deg is None else abs(math.cos(math.radians(motion.aspect_deg)))
    if motion.side_probability > 0.5 and extraction.gait_frequency_hz is not None:
        # lateral sway, with the period of the stride, can be stronger than the steps (E-33)
        flags.append("aspect_beyond_53_deg:gait_frequency_may_be_the_stride")
        if "low_confidence" not in flags:
            flags.append("low_confidence")
    if cosine < HIDDEN_COSINE:
        flags.append("aspect_beyond_75_deg:gait_is_hidden")
    values = (motion.ground_speed_mps, motion.aspect_deg, step_m)
    ground_sd_mps = None if motion.ground_speed_mps is None else motion.ground_speed_sd_mps
    sd = (ground_sd_mps, None if motion.aspect_deg is None else motion.aspect_sd_deg, step_sd_m)
    return dict(zip(GROUND_QUALITY, values, strict=True)), dict(zip(GROUND_QUALITY, sd, strict=True)), flags


def observe(usable: Signal | xr.DataArray, analysis: Analysis) -> Observation:
    """Compute the observation of a signature for features (E-28 to E-38)."""
    return observe_alike([Signal.of(usable, SIGNATURE)], [analysis])[0]


def observe_alike(signatures: Sequence[Signal], analyses: Sequence[Analysis]) -> list[Observation]:
    """Compute the observations of signatures with equal axes (E-28 to E-38)."""
    observations = [_prepare(mu, analysis) for mu, analysis in zip(signatures, analyses, strict=True)]
    share_set_f(observations)
    for observed, analysis in zip(observations, analyses, strict=True):
        observed.extraction = feature_layer.extract(
            observed,
            bandwidth_threshold=analysis.bandwidth_threshold,
            cpi_s=analysis.cpi_s,
            window_steepness=analysis.window_steepness,
        )
    return observations


def _prepare(mu: Signal, analysis: Analysis) -> Observation:
    """Compute what is measured before the features of the set F."""
    mu = mu.replace(mu.values)  # its number of bins is replaced by that of independent ones
    floor_v2 = processing.noise_floor_v2(mu)
    mu.attrs["n_gate_bins"] = processing.count_independent_bins(mu, floor_v2)
    if OTHER_SIDES in mu.coords:
        mu = _clear_other_sides(mu, floor_v2)
    normalised = processing.normalise(mu, floor_v2, mode=analysis.normalisation)
    seconds = processing.observation_s(mu)
    strongest_v2, peaks_hz = main_line.find_column_peaks(mu)  # used several times
    fit = partial(main_line.fit_line, peaks_hz, main_line.bin_width_hz(mu), mu.counted)
    straight = fit(order=1, tapered=True)
    track_mps, bend_mps, agreed = None, 0.0, True
    centre_m = mu.axis("centre_range")
    if centre_m.max() > centre_m.min():  # a fixed gate does not follow a target
        track = main_line.track_velocity(mu.axis("time"), centre_m)
        track_mps, bend_mps = track.mean_mps, track.bend_mps
        track_hz = 2.0 * track.line_mps / float(mu.attrs["wavelength_m"])
        straight, agreed = main_line.choose_velocity(mu, floor_v2, strongest_v2, straight, track_hz)
    aligned, drift_hz = normalised, None
    if main_line.has_drift(fit(order=1)):
        drift_hz = fit(order=processing.choose_line_order(seconds))
        aligned = processing.align(normalised, drift_hz)
    parts = CadenceParts(aligned, processing.detrend_order(seconds))
    return Observation(
        signature=mu,
        floor_v2=floor_v2,
        strongest_v2=strongest_v2,
        peaks_hz=peaks_hz,
        main_line_hz=straight,
        make_excess=partial(_make_excess, mu, floor_v2, drift_hz),
        aligned=aligned,
        cadence_parts=parts,
        spectrum=parts.spectrum(),
        observation_s=seconds,
        n_independent=processing.count_independent_columns(mu) * float(mu.counted.mean()),
        track_mps=track_mps,
        bend_mps=bend_mps,
        agreed=agreed,
        drift_hz=drift_hz,
    )


def _make_excess(mu: Signal, floor_v2: float, drift_hz: FloatArray | None) -> Signal:
    excess = mu.replace(mu.values - mu.values.dtype.type(floor_v2))
    return excess if drift_hz is None else processing.align(excess, drift_hz)
