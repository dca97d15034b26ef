"""New targets from recorded clips.

A clip is changed in speed, size and stride, or two clips are blended. Distances between points are
restored. A result in which feet slide or joints bend too far is refused.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from numbers import Real
from typing import Annotated, Any, NoReturn, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, field_validator, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import MotionError
from doppelgait.core.units import FloatArray, arccosine
from doppelgait.motion.gait import STANCE_SPEED, find_feet, is_quadruped, step_and_gait_frequency_hz
from doppelgait.motion.loop import Cycle, fit_cycle, require_gait, weigh_feet
from doppelgait.motion.motion import GRAVITY_MPS2, Motion, make_motion, require_motion
from doppelgait.motion.retime import travel_heading_rad, travel_speed_mps
from doppelgait.motion.skeleton import (
    LEG_SHARE,
    find_bones,
    find_rigid_pairs,
    measure_pair_lengths,
    restore_lengths,
    strip_subject,
)

IntArray = npt.NDArray[np.int32]


@dataclass(frozen=True)
class SpeedLaw:
    """Power law of stride length against dimensionless speed V / sqrt(g l)."""

    exponent: float
    spread: float
    speed: tuple[float, float]


WALK = SpeedLaw(0.63, 0.11, (0.17, 0.60))
"""Law from 36 shared recordings of walking people (tuning half); exponent +-0.05."""
RUN = SpeedLaw(0.74, 0.08, (0.43, 1.32))
"""Law from five shared recordings of runners, exponent +-0.10; spread and range from all 14."""
QUADRUPED = SpeedLaw(0.60, 0.07, (0.20, 2.4))
"""Law L/h = c Fr^0.3 of the models of dogs (measured exponents: ``docs/howto/hybrids.md``). The spread is
the largest of pace, walk and trot, the speeds those of 76 shared segments of dogs, rounded."""
FACTOR = (0.8, 1.25)
"""Allowed factors on speed and size (assumed)."""
SPREADS = 1.0
"""Largest deviation of the stride length from the law, in standard deviations."""

ROUNDED = 1e-5
"""Tolerance of the limits of a factor, since messages and plans round."""
RIDGE, STEPS = 0.02, 6
"""Ridge and number of steps of the restoration of lengths, which is more exact than in a loop."""
LIKE = 0.7
"""Minimum normalised correlation of the limbs of two clips in the same phase of the stride."""
PHASES = 60
CLIP_OVERLAP = 0.4
"""Share of a stride by which a blended clip exceeds its whole strides, so that it can be looped."""
COMMON = 0.75
"""Minimum share of common points of two clips. All body parts must be common."""

Factor = Annotated[float, Field(ge=FACTOR[0], le=FACTOR[1])]


class Hybrid(FrozenModel):
    """Changes of a recorded clip: speed, size, stride and blend.

    It is a table of a scene or a plan. ``other`` and ``share`` must be set together.

    speed_factor: Factor of the dimensionless speed V / sqrt(g l) (:func:`retarget`).
    size_factor: Factor of all lengths; times change by its square root.
    stride_factor: Factor of the stride length at equal speed.
    other: Second recording, ``{ kind = "file", path = "...", segment = 1 }``.
    share: Part of the second recording.
    """

    speed_factor: Factor = 1.0
    size_factor: Factor = 1.0
    stride_factor: Factor = 1.0
    other: dict[str, Any] | None = None
    share: float = Field(default=0.0, ge=0.0, le=1.0)

    @field_validator("other")
    @classmethod
    def _check_other(cls, value: dict[str, Any] | None) -> dict[str, Any] | None:
        if value is not None and (value.get("kind") != "file" or {"hybrid", "loop_to_s"} & set(value)):
            raise ValueError('must be an unchanged recording: { kind = "file", path = "...", segment = 1 }')
        return value

    @model_validator(mode="after")
    def _check_pair(self) -> Self:
        if (self.other is None) if self.share else (self.other is not None and "share" not in self.model_fields_set):
            present, lacking = ("share", "other") if self.other is None else ("other", "share")
            raise ValueError(
                f'{present} without {lacking} is not allowed: a blend needs both, other = {{ kind = "file", path = '
                '"..." } and share = 0.4; to retarget only, leave both out'
            )
        return self


def make_hybrid(motion: Motion, hybrid: Hybrid, read_other: Callable[[Mapping[str, Any]], Motion]) -> Motion:
    """Blend and retarget a clip as specified by a table."""
    known = _require_gait(motion)
    sources = [known]
    if hybrid.other is not None:
        known, sources = _blend(known, read_other(hybrid.other), hybrid.share)
    return _retarget(known, sources, hybrid.speed_factor, hybrid.size_factor, hybrid.stride_factor)


def retarget(
    motion: Motion, *, speed_factor: float = 1.0, size_factor: float = 1.0, stride_factor: float = 1.0
) -> Motion:
    r"""Change speed, size or stride of a recorded gait.

    .. math:: V' = V\,v\,\sqrt{b}, \qquad L' = L\,b\,v^{a}\,s, \qquad T' = T\,\sqrt{b}\,s\,v^{a-1}

    with a = 0.63 (walk of people), 0.74 (run), 0.60 (animals). A foot on the ground stays in place,
    and the distances between the points of the body are restored.

    Parameters
    ----------
    motion : Motion
        Motion without gaps: at least one stride of straight gait.
    speed_factor : float
        v, 0.8 to 1.25: factor of V / sqrt(g l), which must stay within that of recordings.
    size_factor : float
        b, 0.8 to 1.25: factor of all lengths. Times change by its square root (dynamic similarity).
    stride_factor : float
        s, deviation of the stride length from the law at equal speed, up to one standard deviation
        of recordings: 0.90 to 1.12 (walk of people), 0.92 to 1.08 (run), 0.93 to 1.07 (animals).

    Returns
    -------
    Motion
        The same points and frames, with scaled frame rate, height, frequencies and footfalls.
        ``report["hybrid"]`` holds factors, largest change of a length and slide of the feet.

    Raises
    ------
    MotionError
        If a factor or the speed is outside its limits, or feet slide or joints bend too far.

    Examples
    --------
    >>> import doppelgait as dg
    >>> walk = dg.motion.boulic_walk(speed_mps=1.2, duration_s=3.0)
    >>> taller = dg.motion.retarget(walk, size_factor=1.1)
    >>> round(taller.facts.height_m / walk.facts.height_m, 3), taller.duration_s > walk.duration_s
    (1.1, True)
    """
    known = _require_gait(motion)
    return _retarget(known, [known], speed_factor, size_factor, stride_factor)


def _retarget(
    known: Motion, sources: Sequence[Motion], speed_factor: float, size_factor: float, stride_factor: float
) -> Motion:
    """Retarget a motion and keep the joint angles of its sources."""
    law = find_speed_law(known)
    factors = {"speed_factor": speed_factor, "size_factor": size_factor, "stride_factor": stride_factor}
    limits = FACTOR, FACTOR, find_stride_limits(law)
    for (name, value), (low, high) in zip(factors.items(), limits, strict=True):
        if not (_is_number(value) and low - ROUNDED <= value <= high + ROUNDED):
            raise MotionError(
                f"{known.label}: {name} = {value!r} is not allowed: must be a number from {low:.3g} to {high:.3g}, "
                "the range of recordings; use a more similar recording"
            )
    now = compute_dimensionless_speed(known)
    low, high = find_speed_limits(known)
    if not low - ROUNDED <= speed_factor <= high + ROUNDED:
        raise MotionError(
            f"{known.label}: speed_factor = {speed_factor:g} is not allowed: the {known.facts.gait} would have the "
            f"dimensionless speed {now * speed_factor:.2f}, but recordings have {law.speed[0]:g} to {law.speed[1]:g}; "
            f"allowed are {low:.3g} to {high:.3g}"
        )
    longer = speed_factor**law.exponent * stride_factor
    slower = math.sqrt(size_factor) * stride_factor * speed_factor ** (law.exponent - 1.0)
    position = np.asarray(known.position_m, dtype=np.float64)
    wanted_pairs = find_rigid_pairs(position)
    heading = travel_heading_rad(known)
    ahead = np.array([math.cos(heading), math.sin(heading), 0.0])
    forward = position @ ahead
    # each point moves `longer` times as far about its mean place in the body over whole strides
    stride = known.rate_hz / known.facts.stride_frequency_hz
    whole = max(1, round(math.floor((known.n_frames - 1) / stride) * stride))
    speed = (forward[-1] - forward[0]).mean() / (known.n_frames - 1)
    place = (forward - speed * np.arange(known.n_frames)[:, np.newaxis])[:whole].mean(axis=0)
    lengthened = position + ((longer - 1.0) * (forward - place))[..., np.newaxis] * ahead
    anchor = np.array([*lengthened[0].mean(axis=0)[:2], 0.0])
    scaled = anchor + size_factor * (lengthened - anchor)
    wanted = size_factor * measure_pair_lengths(position, wanted_pairs)
    restored = restore_lengths(scaled, wanted_pairs, wanted, weigh_feet(known), ridge=RIDGE, steps=STEPS)
    times = known.time_s
    facts = replace(
        known.facts.with_frequencies(lambda hz: hz / slower),
        height_m=known.facts.height_m * size_factor,
        mass_kg=known.facts.mass_kg * size_factor**3,
        footfalls={foot: [(t - times[0]) * slower for t in due] for foot, due in known.facts.footfalls.items()},
    )
    made = known.remake(restored, facts, rate_hz=known.rate_hz / slower)
    return check_hybrid(made, sources, wanted_pairs, wanted, scaled, factors)


def blend(first: Motion, second: Motion, *, share: float) -> Motion:
    """Blend two clips of one gait.

    Both become endless cycles, as in ``loop``. The second gets the heading and size of the first,
    and the phase in which it differs least. Positions, stride times and distances are averaged.

    Parameters
    ----------
    first, second : Motion
        Motions without gaps: straight gait of one kind and species, 1.2 strides or more, with the
        same markers or joints; at most a quarter of the points may be in only one of them.
    share : float
        Weight of the second motion, 0 to 1.

    Returns
    -------
    Motion
        Whole strides and a fraction of one, at the frame rate and heading of the first, with the
        common points. Source, subject and licence name both. ``report["hybrid"]`` holds share,
        phase, ratio of sizes, correlation, largest change of a distance and slide of the feet.

    Raises
    ------
    MotionError
        If species, gait or points differ, one is more than 1.56 times as fast, the motions of the
        limbs differ too much, or feet slide or joints bend too far in the result.

    Examples
    --------
    >>> import doppelgait as dg
    >>> slow, fast = (dg.motion.boulic_walk(speed_mps=v, duration_s=3.0) for v in (1.1, 1.3))
    >>> between = dg.motion.blend(slow, fast, share=0.5)
    >>> slow.facts.stride_frequency_hz < between.facts.stride_frequency_hz < fast.facts.stride_frequency_hz
    True
    """
    return _blend(first, second, share)[0]


def _blend(first: Motion, second: Motion, share: float) -> tuple[Motion, list[Motion]]:
    """Blend two clips; also return them with shared points."""
    if not (_is_number(share) and 0.0 <= share <= 1.0):
        raise MotionError(f"share: {share!r} is not allowed: must be a number from 0 to 1")
    one, other = _require_gait(first), _require_gait(second)
    points, parts, markers = _find_common_points(one, other)
    kinds = [(motion.facts.species, motion.facts.gait) for motion in (one, other)]
    if kinds[0] != kinds[1] or not kinds[0][1]:
        shown = [" ".join(filter(None, kind)) or "unknown" for kind in kinds]
        _refuse_blend(one, other, f"the gait is {shown[0]} and {shown[1]}; take two clips of one known gait")
    (one, cycle, _), (other, second_cycle, _) = fit_cycle(one), fit_cycle(other)
    chosen = [np.asarray(m.position_m[:, own], dtype=np.float64) for m, own in zip((one, other), points, strict=True)]
    bones = find_bones(chosen[0])
    sizes = [float(np.median(measure_pair_lengths(position, bones), axis=0).sum()) for position in chosen]
    ratio = sizes[0] / sizes[1]
    speeds = [float(np.hypot(*c.advance[:2])) / c.seam.lag * c.rate_hz for c in (cycle, second_cycle)]
    faster = speeds[1] * math.sqrt(ratio) / speeds[0]
    low, high = FACTOR[0] ** 2, FACTOR[1] ** 2  # the blend then differs from both by at most the factors of retargeting
    if not low <= faster <= high:
        why = f"at equal size the second is {faster:.2f} times as fast; allowed are {low:.2g} to {high:.2g}"
        _refuse_blend(one, other, f"{why}; retarget one of them first")
    scales = (1.0, ratio)
    cycles = [_find_body_cycle(*each) for each in zip((cycle, second_cycle), points, scales, strict=True)]
    # align the mean strides at their maximum correlation, by shifts finer than the phases
    means = [mean for mean, _ in cycles]
    offset = (means[0].mean(axis=(0, 1)) - means[1].mean(axis=(0, 1))) * (1.0, 1.0, 0.0)
    swings = [mean - mean.mean(axis=0) for mean in means]
    spectra = [np.fft.rfft(swing.reshape(PHASES, -1), axis=0) for swing in swings]
    product = (spectra[0].conj() * spectra[1]).sum(axis=1)
    by_shift = np.fft.irfft(product, 16 * PHASES) * 16 / np.sqrt(np.prod([(swing**2).sum() for swing in swings]))
    best = int(np.argmax(by_shift))
    shift, likeness = (best / by_shift.size + 0.5) % 1.0 - 0.5, float(by_shift[best])
    if likeness < LIKE:
        why = f"the normalised correlation of their limbs is only {likeness:.2f} ({LIKE:g} is needed)"
        _refuse_blend(one, other, f"{why}, for example because the other leg leads")
    periods = [c.seam.lag / c.seam.strides / c.rate_hz for c in (cycle, second_cycle)]
    period_s = (1.0 - share) * periods[0] + share * periods[1] * math.sqrt(ratio)
    strides = max(cycle.seam.strides, second_cycle.seam.strides) + CLIP_OVERLAP
    count = math.ceil(strides * period_s * one.rate_hz) + 1
    phase = np.arange(count) / one.rate_hz / period_s
    here, there = cycles[0][1](phase), cycles[1][1](phase + shift) + offset
    there = there - shift * _stride_m(second_cycle) * ratio * np.array([1.0, 0.0, 0.0])
    pairs = find_rigid_pairs(chosen[0])
    wanted = (1.0 - share) * measure_pair_lengths(here, pairs) + share * measure_pair_lengths(there, pairs)
    mixed = (1.0 - share) * here + share * there
    own, further = one.facts, other.facts
    step_hz, gait_hz = step_and_gait_frequency_hz(own.gait, 1.0 / period_s)
    facts = replace(
        own,
        source=_join_marks(own.source, further.source),
        subject=_join_marks(own.subject, further.subject),
        licence=_join_marks(own.licence, further.licence, " AND ") if own.licence and further.licence else "",
        height_m=(1.0 - share) * own.height_m + share * (ratio * further.height_m),
        stride_frequency_hz=1.0 / period_s,
        step_frequency_hz=step_hz,
        gait_frequency_hz=gait_hz,
        footfalls={},
        path=None,
    )
    made = make_motion(mixed, rate_hz=one.rate_hz, markers=markers, parts=parts, facts=facts)
    restored = restore_lengths(mixed, pairs, wanted, weigh_feet(made), ridge=RIDGE, steps=STEPS)
    turned = _turn(restored, math.atan2(cycle.advance[1], cycle.advance[0]))
    result = made.with_positions(turned).with_report(first=dict(one.report), second=dict(other.report))
    entries = {"first": own.source, "second": further.source, "share": share, "phase": shift}
    entries |= {"size_ratio": ratio, "likeness": likeness}
    both = [m.with_points(position, markers, parts) for m, position in zip((one, other), chosen, strict=True)]
    return check_hybrid(result, both, pairs, wanted, mixed, entries), both


def find_speed_law(motion: Motion) -> SpeedLaw:
    """Return the law of speed and stride of a gait."""
    if is_quadruped(motion):
        return QUADRUPED
    return RUN if motion.facts.gait == "run" else WALK


def compute_dimensionless_speed(motion: Motion) -> float:
    """Return V / sqrt(g l), NaN for unknown height."""
    length_m = motion.facts.height_m * (1.0 if is_quadruped(motion) else LEG_SHARE)
    return travel_speed_mps(motion) / math.sqrt(GRAVITY_MPS2 * length_m) if length_m > 0 else math.nan


def find_speed_limits(motion: Motion) -> tuple[float, float]:
    """Return the allowed range of ``speed_factor``, which contains 1."""
    now, law = compute_dimensionless_speed(motion), find_speed_law(motion)
    if not now > 0:
        return FACTOR
    return min(1.0, max(FACTOR[0], law.speed[0] / now)), max(1.0, min(FACTOR[1], law.speed[1] / now))


def find_stride_limits(law: SpeedLaw) -> tuple[float, float]:
    """Return the allowed range of ``stride_factor``."""
    return math.exp(-SPREADS * law.spread), math.exp(SPREADS * law.spread)


def _require_gait(motion: Motion) -> Motion:
    """Return a motion with gait facts and a whole stride."""
    known = require_gait(require_motion(motion), "retargeted or blended")
    if not motion.n_frames - 1 >= motion.rate_hz / known.facts.stride_frequency_hz:
        raise MotionError(
            f"{motion.label}: shows no whole stride, so it cannot be retargeted or blended; give a longer part in "
            "which the body walks, or state the stride: motion.with_facts(stride_frequency_hz=...)"
        )
    return known


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _refuse_blend(one: Motion, other: Motion, why: str) -> NoReturn:
    raise MotionError(f"{one.label} and {other.label}: cannot be blended: {why}")


def _find_common_points(one: Motion, other: Motion) -> tuple[tuple[list[int], list[int]], list[str], list[str]]:
    """Find the points that two motions share: numbers in both, parts and names."""
    names = [[strip_subject(marker).upper() for marker in motion.markers] for motion in (one, other)]
    shared = [name for name in names[0] if name in names[1]]
    numbers = ([names[0].index(name) for name in shared], [names[1].index(name) for name in shared])
    parts = [one.parts[n] for n in numbers[0]]
    lacking = (set(one.parts) | set(other.parts)) - set(parts) - {""}
    if len(shared) < COMMON * max(map(len, names)) or lacking:
        none_of = f", none of {', '.join(sorted(lacking))}" if lacking else ""
        why = f"they share {len(shared)} of {len(names[0])} and {len(names[1])} points{none_of}"
        _refuse_blend(one, other, f"{why}; take two recordings with the same markers or joints")
    return numbers, parts, [one.markers[n] for n in numbers[0]]


def _stride_m(cycle: Cycle) -> float:
    return float(np.hypot(*cycle.advance[:2])) / cycle.seam.strides


def _turn(position: FloatArray, angle_rad: float) -> FloatArray:
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    x, y = position[..., 0], position[..., 1]
    return np.stack([x * cos - y * sin, x * sin + y * cos, position[..., 2]], axis=-1)


def _find_body_cycle(cycle: Cycle, points: list[int], scale: float) -> tuple[FloatArray, Any]:
    """Return mean stride, without its advance, and cycle of phases in strides, facing +x."""
    stride, angle = cycle.seam.lag / cycle.seam.strides, -math.atan2(cycle.advance[1], cycle.advance[0])

    def at(phase: FloatArray) -> FloatArray:
        return scale * _turn(cycle.at(phase * stride, points), angle)

    phase = np.arange(PHASES * cycle.seam.strides) / PHASES
    swing = at(phase) - np.multiply.outer(phase * _stride_m(cycle) * scale, np.array([1.0, 0.0, 0.0]))[:, np.newaxis]
    return swing.reshape(cycle.seam.strides, PHASES, len(points), 3).mean(axis=0), at


def _join_marks(one: str, other: str, mark: str = " + ") -> str:
    return mark.join(dict.fromkeys(filter(None, (one, other))))


FREE_PARTS = ("head", "neck", "tail", "left_hand", "right_hand")
"""Parts without limits of their joints: heads turned left and right blend to a straight neck."""

LONGER, LONGER_M = 0.005, 1e-3
"""Largest error of the distance between two points: the relative or the absolute one."""
JERKS = 1.5
"""Factor of the restoration of lengths on accelerations, above which a leg snaps straight."""
SLIDES = 0.02
"""Allowed increase of the feet's sliding over the body's speed: the maximum of shared loops."""
BENDS_DEG = 14.0
"""Angle by which a joint may bend further than recorded: two standard deviations of its limits between
recordings of one gait and skeleton (7 degrees: root mean square over nine sets, 4 to 11)."""


def measure_foot_slide(motion: Motion) -> float:
    """Measure the speed of the slowest point of a standing foot, over the body's."""
    rate, speed_mps = motion.rate_hz, travel_speed_mps(motion)
    found = []
    for points in find_feet(motion).values():
        velocity = np.gradient(motion.position_m[:, points, :2], 1.0 / rate, axis=0)
        slowest = np.linalg.norm(velocity, axis=2).min(axis=1)
        found.append(slowest[slowest < STANCE_SPEED * speed_mps] / speed_mps)
    every = np.concatenate(found) if found else np.empty(0)
    return float(every.mean()) if every.size else math.nan


def check_hybrid(
    made: Motion,
    sources: Sequence[Motion],
    pairs: IntArray,
    wanted: FloatArray,
    loose: FloatArray,
    entries: Mapping[str, Any],
) -> Motion:
    """Check lengths, feet and joints of a hybrid, and report them."""
    # loose holds the positions before the lengths were restored
    position = made.position_m

    def refuse(why: str) -> None:
        raise MotionError(f"{made.label}: cannot be made: {why}; change less")

    error = np.abs(measure_pair_lengths(position, pairs) - wanted)
    beyond_m = error - np.maximum(LONGER_M, LONGER * wanted)
    worst = np.unravel_index(int(np.argmax(beyond_m)), error.shape)
    if beyond_m[worst] > 0:
        names = " and ".join(made.markers[n] for n in pairs[worst[1]])
        refuse(f"{names} would be {1e3 * error[worst]:.1f} mm nearer or further than in the recording")
    jerks = [float(np.abs(np.diff(values, n=2, axis=0)).max()) for values in (position, loose)]
    if jerks[0] > JERKS * jerks[1]:
        much = f"{jerks[0] / jerks[1]:.1f} times as much; allowed are {JERKS:g}"
        refuse(f"to keep its lengths the body would accelerate {much}")
    slides, recorded = measure_foot_slide(made), [measure_foot_slide(source) for source in sources]
    before = max(filter(math.isfinite, recorded), default=math.nan)
    if math.isfinite(before) and not math.isfinite(slides):
        refuse("no foot would rest on the ground, as feet do in the recordings")
    if slides > before + SLIDES:
        allowed = f"{before:.3f} in the recordings; allowed are {SLIDES:g} more"
        refuse(f"feet on the ground slide at {slides:.3f} of the speed, {allowed}")
    free = [n for n, part in enumerate(made.parts) if part in FREE_PARTS]
    joints = _find_joints(pairs, sources[0].position_m)
    joints = joints[~np.isin(joints, free).any(axis=1)]
    angles = []  # of the joints over time, (T, J), degrees
    for motion in (made, *sources):
        arms = [motion.position_m[:, joints[:, end]] - motion.position_m[:, joints[:, 1]] for end in (0, 2)]
        lengths = np.maximum(np.linalg.norm(arms[0], axis=2) * np.linalg.norm(arms[1], axis=2), 1e-12)
        angles.append(np.degrees(arccosine(np.clip((arms[0] * arms[1]).sum(axis=2) / lengths, -1.0, 1.0))))
    further = 0.0
    if joints.size:
        low = np.min([angle.min(axis=0) for angle in angles[1:]], axis=0) - angles[0].min(axis=0)
        high = angles[0].max(axis=0) - np.max([angle.max(axis=0) for angle in angles[1:]], axis=0)
        beyond = np.maximum(low, high)
        further = max(0.0, float(beyond.max()))
        if further > BENDS_DEG:
            at = made.markers[joints[int(np.argmax(beyond)), 1]]
            far = f"{further:.0f} degrees further than in the recordings; allowed are {BENDS_DEG:g}"
            refuse(f"the joint at {at} would bend {far}")
    report = {
        **made.report.get("hybrid", {}),
        **entries,
        "length_error_m": float(error.max()),
        "foot_slide": slides,
        "foot_slide_recorded": before,
        "bends_further_deg": further,
    }
    if not math.isfinite(slides):
        report["note"] = "no foot is seen to rest on the ground: whether feet slide was not checked"
    return made.with_report(hybrid=report)


def _find_joints(pairs: IntArray, position: FloatArray) -> IntArray:
    """Find the joints of a body, shape (J, 3)."""
    # a joint is three points a, b, c with bones a-b and b-c that are not in one rigid segment
    rigid = {(a, b) for a, b in pairs.tolist()}
    by_end: dict[int, list[int]] = {}
    for a, b in find_bones(position).tolist():
        by_end.setdefault(a, []).append(b)
        by_end.setdefault(b, []).append(a)
    pairs_of_bones = ((m, *ends) for m in sorted(by_end) for ends in combinations(sorted(by_end[m]), 2))
    joints = [(a, middle, c) for middle, a, c in pairs_of_bones if (a, c) not in rigid]
    return np.array(joints, dtype=np.int32).reshape(-1, 3)
