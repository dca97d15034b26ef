"""Tracker from scans to tracks."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import AnalysisError
from doppelgait.core.units import FloatArray, exponential
from doppelgait.processing.track import kalman
from doppelgait.processing.track.kalman import Gaussian, Innovation, Model
from doppelgait.processing.track.live import (
    MEASURED,
    MISSED,
    SHARED,
    Detection,
    LiveTrack,
    Scan,
    Step,
    Track,
    Tracker,
    find_box,
    finish_track,
)

LEAST_SPAN_MPS = 2.0
"""Smallest unambiguous velocity span with which the velocity of a walker can be measured."""
NO_VELOCITY_SD_MPS = 3.0
"""Standard deviation of an unknown velocity around 0; it covers the speed of people and pets."""
BOX_MARGIN_M = 0.2
BOX_MARGIN_MPS = 0.3
DUPLICATE_RANGE_M = 0.4
DUPLICATE_VELOCITY_MPS = 0.4


def track(
    scans: Sequence[Scan], settings: Tracker | None = None, *, velocity_span_mps: float | None = None
) -> list[Track]:
    """Track bodies through the detections of a recording.

    The tracker uses a Kalman filter of range and radial velocity per body, joint association, and
    smoothing at the end. It uses only the detections and treats all bodies alike.

    Parameters
    ----------
    scans : sequence of Scan
        Scans in the order of time, about ten per second.
    settings : Tracker, optional
        The defaults of :class:`Tracker`.
    velocity_span_mps : float, optional
        Unambiguous velocity span lambda f_p / 2, above 0. Below about 16 m/s the velocities of fast bodies are folded.
        A track is then started for every unfolded velocity, and the track that agrees with the ranges is kept. Below
        2 m/s velocities are not used. By default velocities are used without unfolding.

    Returns
    -------
    list of Track
        Tracks in the order of their first detection; empty if none was confirmed.

    Raises
    ------
    AnalysisError
        If the times are not ascending, or a detection is not finite.
    """
    options = settings or Tracker()
    times_s = np.array([scan.time_s for scan in scans])
    if not (np.isfinite(times_s).all() and (np.diff(times_s) > 0).all()):
        raise AnalysisError("scans must have ascending, different times; sort them by time_s")
    for scan in scans:
        for d in scan.detections:
            values = (d.range_m, d.velocity_mps, d.range_sd_m, d.velocity_sd_mps)
            if not (all(map(math.isfinite, values)) and d.range_sd_m > 0 and d.velocity_sd_mps > 0):
                raise AnalysisError(
                    f"detection at {scan.time_s:g} s: range {d.range_m:g} m, velocity {d.velocity_mps:g} m/s with "
                    f"standard deviations {d.range_sd_m:g} m and {d.velocity_sd_mps:g} m/s; all must be finite, "
                    "standard deviations above 0 (a radar without range cannot be tracked in range)"
                )
    if velocity_span_mps is not None and velocity_span_mps < LEAST_SPAN_MPS:
        unknown = partial(
            replace,
            velocity_mps=0.0,
            velocity_sd_mps=NO_VELOCITY_SD_MPS,
            velocity_low_mps=-NO_VELOCITY_SD_MPS,
            velocity_high_mps=NO_VELOCITY_SD_MPS,
        )
        scans = [Scan(scan.time_s, tuple(map(unknown, scan.detections))) for scan in scans]
        velocity_span_mps = None
    live: list[LiveTrack] = []
    ended: list[LiveTrack] = []
    family = itertools.count()
    for scan in scans:
        _update_tracks(live, scan, options, velocity_span_mps)
        for new in _start_tracks(live, scan, options, velocity_span_mps):
            number = next(family)
            live += [LiveTrack([step], number) for step in new]
        for one in live:
            hits = sum(step.outcome == MEASURED for step in one.steps[-options.confirm_scans :])
            siblings = [other for other in live if other is not one and other.family == one.family]
            # another unfolded velocity of the same detection that is confirmed or has more hits
            rival = any(other.confirmed_at_s is not None or other.hits > one.hits for other in siblings)
            if one.confirmed_at_s is None and hits >= options.confirm_hits and not rival:
                one.confirmed_at_s = scan.time_s
        over = [one for one in live if _is_over(one, live, scan.time_s, options)]
        ended += over
        live = [one for one in live if one not in over]
    found = [one for one in [*ended, *live] if one.confirmed_at_s is not None]
    lasting = [one for one in found if one.last_own.time_s - one.steps[0].time_s >= options.min_duration_s - 1e-9]
    moving = []
    for smooth in map(finish_track, lasting):
        half_mps = (smooth.velocity_high_mps - smooth.velocity_low_mps) / 2
        stays = np.ptp(smooth.range_m) < options.still_travel_m and np.median(half_mps) < options.still_velocity_mps
        slow = np.median(np.abs(smooth.velocity_mps)) < options.still_speed_mps
        narrow = np.quantile(half_mps, 0.9) < options.still_velocity_mps
        if options.still_travel_m <= 0 or not (stays or (slow and narrow)):  # others are too still for a body
            moving.append(smooth)
    best = sorted(moving, key=lambda track: -int(track.measured.sum()))[: options.max_targets]
    return sorted(best, key=lambda track: track.first_s)


def _update_tracks(live: list[LiveTrack], scan: Scan, options: Tracker, span_mps: float | None) -> None:
    """Predict, associate and update every track, confirmed tracks first."""
    free = list(scan.detections)
    for confirmed in (True, False):
        group = [one for one in live if (one.confirmed_at_s is not None) == confirmed]
        if not group:
            continue
        models = [_choose_model(one, scan.time_s, options) for one in group]
        predictions = [kalman.predict(one.state, model) for one, model in zip(group, models, strict=True)]
        measured = [[_measure(state, d, options, span_mps) for d in free] for state in predictions]
        limit = compute_gate_threshold(options.gate_probability)
        table = [[i.log_likelihood if i.nis <= limit else -math.inf for i in row] for row in measured]
        chosen = associate(
            np.array(table, dtype=float).reshape(len(group), len(free)),
            detection_probability=options.detection_probability,
            gate_probability=options.gate_probability,
            clutter_density=options.clutter_per_m_mps,
            association=options.association if confirmed else "gnn",
        )
        steps = []
        for model, predicted, row, own, weights in zip(models, predictions, measured, *chosen, strict=True):
            mixture = [(kalman.update(predicted, row[d]), weights[d]) for d in np.flatnonzero(weights[:-1])]
            if weights[-1] > 0:
                mixture.append((predicted, weights[-1]))
            state = mixture[0][0] if len(mixture) == 1 else kalman.merge_mixture(*zip(*mixture, strict=True))
            step = Step(scan.time_s, model, predicted, state, SHARED if len(mixture) > 1 else MISSED)
            if own >= 0:  # the best assignment determines the owner of a detection, the weights the update
                d = free[own]
                step = step._replace(outcome=MEASURED, nis=row[own].nis, box=find_box(d), power_v2=d.power_v2)
            steps.append(step)
        if confirmed:
            steps = _update_in_boxes(steps, chosen, free, options, span_mps)
        for one, step in zip(group, steps, strict=True):
            one.add(step, share_s=options.share_s)
        taken = {int(d) for d in chosen.assigned if d >= 0}
        free = [d for n, d in enumerate(free) if n not in taken]


def _measure(
    state: Gaussian, d: Detection, options: Tracker, span_mps: float | None, *, in_box: bool = False
) -> Innovation:
    # at an unknown position in a box: with a standard deviation of half its width
    half_m = (d.range_high_m - d.range_low_m) / 2 if in_box else 0.0
    half_mps = (d.velocity_high_mps - d.velocity_low_mps) / 2 if in_box else 0.0
    return kalman.compute_innovation(
        state,
        range_m=d.range_m,
        velocity_mps=d.velocity_mps,
        range_sd_m=max(d.range_sd_m, options.range_sd_min_m, half_m),
        velocity_sd_mps=max(d.velocity_sd_mps, options.velocity_sd_min_mps, half_mps),
        velocity_span_mps=span_mps,
    )


def _choose_model(one: LiveTrack, time_s: float, options: Tracker) -> Model:
    """Choose constant velocity, or rest for a slow body that is no longer detected."""
    interval_s = time_s - one.steps[-1].time_s
    if one.confirmed_at_s is not None and one.steps[-1].outcome == MISSED and one.is_slow(options):
        return kalman.make_resting_model(
            interval_s,
            time_constant_s=options.rest_time_constant_s,
            velocity_sd_mps=options.rest_velocity_sd_mps,
        )
    return kalman.make_constant_velocity_model(interval_s, acceleration_noise_m2ps3=options.acceleration_noise_m2ps3)


def _update_in_boxes(
    steps: list[Step], chosen: Associations, detections: list[Detection], options: Tracker, span_mps: float | None
) -> list[Step]:
    # a box without owner around one track alone belongs to it: a limb has shifted its centre
    inside = {
        m: [n for n, s in enumerate(steps) if _is_in_box(d, s.predicted, span_mps)] for m, d in enumerate(detections)
    }
    steps = list(steps)
    owners = {int(m): n for n, m in enumerate(chosen.assigned) if m >= 0}
    for m, tracks in sorted(inside.items(), key=lambda item: len(item[1])):
        lost = [n for n in tracks if chosen.assigned[n] < 0 and steps[n].outcome != MEASURED]
        if not lost:
            continue
        if m not in owners and len(tracks) == 1:
            owners[m] = lost[0]
            steps[lost[0]] = _update_in_box(steps[lost[0]], detections[m], options, span_mps, MEASURED)
            chosen.assigned[lost[0]] = m
            continue
        for n in {*lost, *([owners[m]] if m in owners else [])}:
            steps[n] = _update_in_box(steps[n], detections[m], options, span_mps, SHARED if n in lost else MEASURED)
    return steps


def _update_in_box(step: Step, d: Detection, options: Tracker, span_mps: float | None, outcome: str) -> Step:
    measured = _measure(step.predicted, d, options, span_mps, in_box=True)
    state = kalman.update(step.predicted, measured)
    if outcome == SHARED:
        return step._replace(filtered=state, outcome=SHARED)
    return step._replace(
        filtered=state, outcome=MEASURED, nis=measured.nis, box=step.box or find_box(d), power_v2=d.power_v2
    )


def _is_in_box(d: Detection, predicted: Gaussian, span_mps: float | None) -> bool:
    if not d.range_low_m - BOX_MARGIN_M <= predicted.range_m <= d.range_high_m + BOX_MARGIN_M:
        return False
    middle, half = (d.velocity_low_mps + d.velocity_high_mps) / 2, (d.velocity_high_mps - d.velocity_low_mps) / 2
    off = predicted.velocity_mps - middle
    if span_mps is not None:
        off -= span_mps * round(off / span_mps)
    return abs(off) <= half + BOX_MARGIN_MPS


def _start_tracks(live: list[LiveTrack], scan: Scan, options: Tracker, span_mps: float | None) -> list[list[Step]]:
    """Return the first steps of new tracks, from the strongest detections on."""
    ranges_m = [one.state.range_m for one in live]
    new = []
    for d in sorted(scan.detections, key=lambda d: -d.power_v2):
        if any(abs(d.range_m - r) < options.separation_m for r in ranges_m):
            continue
        ranges_m.append(d.range_m)
        range_sd_m = max(d.range_sd_m, options.range_sd_min_m)
        velocity_sd_mps = max(d.velocity_sd_mps, options.velocity_sd_min_mps, options.start_velocity_sd_mps)
        steps = []
        velocities = [d.velocity_mps]
        if span_mps is not None:  # all unfolded velocities up to the fastest
            limit_mps = max(options.fastest_mps, abs(d.velocity_mps))
            zones = math.ceil((options.fastest_mps + abs(d.velocity_mps)) / span_mps)
            unfolded = (d.velocity_mps + zone * span_mps for zone in range(-zones, zones + 1))
            velocities = [velocity_mps for velocity_mps in unfolded if abs(velocity_mps) <= limit_mps]
        for velocity_mps in velocities:
            state = Gaussian(d.range_m, velocity_mps, range_sd_m**2, 0.0, velocity_sd_mps**2)
            stay = Model(0.0, 1.0, 0.0, 0.0, 0.0)
            steps.append(Step(scan.time_s, stay, state, state, MEASURED, box=find_box(d), power_v2=d.power_v2))
        new.append(steps)
    return new


def _is_over(one: LiveTrack, live: list[LiveTrack], time_s: float, options: Tracker) -> bool:
    if one.confirmed_at_s is None:
        recent = one.steps[-options.confirm_scans :]
        misses = sum(step.outcome != MEASURED for step in recent)
        rival = any(o.family == one.family and o.confirmed_at_s is not None for o in live)
        return rival or misses > options.confirm_scans - options.confirm_hits
    limit_s = max(options.rest_s, options.delete_s) if one.is_slow(options) else options.delete_s
    if time_s - one.last_sign_s > limit_s:
        return True
    # another track with more hits has had the same range, velocity and detections for a long time
    if not any(_is_duplicate(one, other) for other in live):
        one.duplicate_since_s = None
        return False
    one.duplicate_since_s = time_s if one.duplicate_since_s is None else one.duplicate_since_s
    return time_s - one.duplicate_since_s >= options.twin_s - 1e-9


def _is_duplicate(one: LiveTrack, other: LiveTrack) -> bool:
    """Return True if ``one`` duplicates ``other``, the older one of two equal tracks."""
    if other is one or other.confirmed_at_s is None or other.steps[-1].time_s != one.steps[-1].time_s:
        return False
    if (other.hits, -other.steps[0].time_s, -other.family) < (one.hits, -one.steps[0].time_s, -one.family):
        return False
    if one.steps[-1].outcome == MEASURED or abs(one.state.range_m - other.state.range_m) >= DUPLICATE_RANGE_M:
        return False
    return abs(one.state.velocity_mps - other.state.velocity_mps) < DUPLICATE_VELOCITY_MPS


MAX_EVENTS = 20_000
"""Largest number of joint events that is enumerated; a cluster with more events uses its best assignment."""


class Associations(NamedTuple):
    """Assignment and association weights of one scan. Shapes: assigned (T,); weights (T, D + 1)."""

    assigned: npt.NDArray[np.int64]
    weights: FloatArray


def compute_gate_threshold(probability: float) -> float:
    """Compute a gate threshold, the chi-square quantile -2 ln(1 - P)."""
    return -2.0 * math.log1p(-probability)


def associate(
    log_likelihood: FloatArray,
    *,
    detection_probability: float,
    gate_probability: float,
    clutter_density: float,
    association: str = "auto",
) -> Associations:
    """Assign the detections of one scan to tracks. Shapes: log_likelihood (T, D)."""
    tracks, detections = log_likelihood.shape
    assigned = np.full(tracks, -1, dtype=np.int64)
    weights = np.zeros((tracks, detections + 1))
    weights[:, -1] = 1.0
    gain = log_likelihood + math.log(detection_probability / clutter_density)  # of a hit, against clutter
    miss = math.log1p(-detection_probability * gate_probability)
    for rows, columns in find_clusters(np.isfinite(gain)):
        part = gain[np.ix_(rows, columns)]
        chosen = find_best_assignment(part, miss)
        assigned[rows] = [columns[c] if c >= 0 else -1 for c in chosen]
        shared = len(rows) > 1
        soft = association == "jpda" or (association == "auto" and shared)
        most_events = float(np.prod(np.isfinite(part).sum(axis=1) + 1.0))
        if soft and most_events <= MAX_EVENTS:
            table = compute_joint_probabilities(part, miss)
        else:
            table = np.zeros((part.shape[0], part.shape[1] + 1))
            table[range(len(chosen)), chosen] = 1.0  # -1 is the last column: none
        weights[np.ix_(rows, [*columns, detections])] = table
    return Associations(assigned, weights)


def find_clusters(in_gate: npt.NDArray[np.bool_]) -> list[tuple[list[int], list[int]]]:
    """Find connected groups of tracks and detections, without lonely tracks."""
    wanted = {t: {d for d, inside in enumerate(row) if inside} for t, row in enumerate(in_gate.tolist())}
    found: list[tuple[list[int], list[int]]] = []
    for track, own in wanted.items():
        if not own:
            continue
        rows, columns, rest = [track], set(own), []
        for group in found:  # every group that shares a detection with this track is merged with it
            if columns.isdisjoint(group[1]):
                rest.append(group)
            else:
                rows, columns = rows + group[0], columns.union(group[1])
        found = [*rest, (sorted(rows), sorted(columns))]
    return sorted(found)


def find_best_assignment(gain: FloatArray, miss: float) -> list[int]:
    """Find the assignment of the largest total gain, -1 for none (Hungarian method)."""
    tracks, detections = gain.shape
    if tracks == 1:
        best = int(gain[0].argmax())
        return [best if gain[0, best] > miss else -1]
    from scipy.optimize import linear_sum_assignment

    forbidden = np.full((tracks, tracks), -np.inf)
    np.fill_diagonal(forbidden, miss)
    padded = np.hstack([gain, forbidden])
    # scipy rejects a matrix in which -inf excludes every assignment; the misses allow one
    _, columns = linear_sum_assignment(padded, maximize=True)
    return [int(c) if c < detections else -1 for c in columns]


def compute_joint_probabilities(gain: FloatArray, miss: float) -> FloatArray:
    """Compute marginal association probabilities over all joint events, (T, D + 1)."""
    # Fortmann, Bar-Shalom and Scheffe 1983: in an event no detection has two tracks
    tracks, detections = gain.shape
    finite = gain[np.isfinite(gain)]
    top = max(float(finite.max()), miss) if finite.size else miss  # avoids overflow
    factors = np.hstack([exponential(gain - top), np.full((tracks, 1), math.exp(miss - top))])
    table = np.zeros((tracks, detections + 1))

    def extend(track: int, taken: tuple[int, ...], weight: float) -> None:
        if track == tracks:
            table[range(tracks), taken] += weight
            return
        for column in np.flatnonzero(factors[track]):
            if column == detections or column not in taken:
                extend(track + 1, (*taken, int(column)), weight * factors[track, column])

    extend(0, (), 1.0)
    return np.asarray(table / table.sum(axis=1, keepdims=True))
