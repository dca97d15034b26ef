"""Which gait a mover goes in, how often it steps, and the facts that follow (E-07)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from doppelgait.motion.clean import body_centre
from doppelgait.motion.footfalls import Steps, find_steps, is_quadruped
from doppelgait.motion.motion import Motion, require_motion
from doppelgait.motion.travel import stride_facts

FloatArray = npt.NDArray[np.float64]

NAN = float("nan")

SYMMETRICAL = ("walk", "run", "pace", "trot")
"""Gaits whose half strides mirror each other: a step is half a stride and f_mu = 2 f_stride (E-07)."""
ASYMMETRICAL = ("canter", "gallop", "transverse_gallop", "bound")
"""Gaits without that symmetry: f_mu = f_stride; ``gallop`` is the rotary one."""

HALF_STRIDE = 0.15
"""A pair of limbs lands half a stride apart when its lag is within this of 0.5 ..."""
TOGETHER = 0.06
"""... and at once when it is within this of 0."""
QUARTER = 0.125
"""Half way between the lateral lags of pace (0), walk (0.25) and trot (0.5); also from canter to gallop."""
STEADY = 0.8
"""Shortest mean vector of a lag's phases over the strides; below that the footfalls keep no order."""
LARGEST_SCATTER = 0.15
"""Touchdowns that scatter more than this part of a stride about an even beat give no stride frequency."""
FLIGHT_ACCELERATION_MPS2 = -5.9
"""A body without support falls at 9.81 m/s^2; 60 % of it tells flight from the dip of a brisk walk."""
PAIRS = {
    "lh_lf": ("left_hind", "left_fore"),
    "lh_rh": ("left_hind", "right_hind"),
    "lf_rf": ("left_fore", "right_fore"),
    "l_r": ("left_foot", "right_foot"),
}
"""Lags: from the touchdown of the first foot to that of the second."""


@dataclass(frozen=True)
class GaitFacts:
    """How a mover steps; NaN, ``""`` or empty where it cannot be told.

    Parameters
    ----------
    gait : str
        ``walk`` or ``run`` of a person; ``walk``, ``pace``, ``trot``, ``canter``, ``gallop`` (rotary),
        ``transverse_gallop`` or ``bound`` of a quadruped.
    stride_frequency_hz, step_frequency_hz, gait_frequency_hz : float
        Strides and steps per second and the fundamental of the signature (E-07).
    footfalls : dict
        Touchdown times in s by foot.
    phases : dict
        Lags ``lh_lf``, ``lh_rh``, ``lf_rf`` or ``l_r`` as parts of the stride, 0 to 1.
    duty_factor : float
        Share of the stride for which a foot bears weight, mean over the feet.
    measured_from : str
        ``"footfalls"`` or ``"spectrum"``: where the stride frequency comes from.
    """

    gait: str = ""
    stride_frequency_hz: float = NAN
    step_frequency_hz: float = NAN
    gait_frequency_hz: float = NAN
    footfalls: dict[str, list[float]] = field(default_factory=dict)
    phases: dict[str, float] = field(default_factory=dict)
    duty_factor: float = NAN
    measured_from: str = ""


def measure_gait(motion: Motion) -> GaitFacts:
    """Footfalls, stride frequency, phases and gait of a motion at about constant speed.

    The stride frequency is that of an even beat fitted to the landings of all feet; where there are too few or they
    keep no beat, the peak of the spectrum of the limbs' swing.

    Parameters
    ----------
    motion : Motion
        Motion (time, marker, space) in m, z up; gaps are bridged by straight lines.
    """
    require_motion(motion)
    steps = find_steps(motion)
    footfalls = {foot: [float(t) for t in step.touchdown_s] for foot, step in steps.items()}
    stride_hz, source = _beat([step.overtaken_s for step in steps.values()]), "footfalls"
    if not math.isfinite(stride_hz):
        spectral = stride_facts(motion.position_m, rate_hz=motion.rate_hz)
        stride_hz, source = spectral["stride_hz"] or NAN, "spectrum"
    if not math.isfinite(stride_hz):
        return GaitFacts(footfalls=footfalls)
    phases = {name: _lag(steps[a], steps[b], stride_hz) for name, (a, b) in PAIRS.items() if a in steps and b in steps}
    phases = {name: lag for name, lag in phases.items() if math.isfinite(lag)}
    duties = [step.duty_factor for step in steps.values() if math.isfinite(step.duty_factor)]
    duty = float(np.mean(duties)) if duties else NAN
    gait = name_quadruped_gait(phases) if is_quadruped(motion) else _name_human_gait(motion, phases, duty)
    return GaitFacts(gait, stride_hz, *step_and_gait_frequency_hz(gait, stride_hz), footfalls, phases, duty, source)


def with_gait_facts(motion: Motion) -> Motion:
    """A motion whose facts on gait are filled in by measurement; what it already states stays.

    Fills ``gait``, ``footfalls``, ``stride_frequency_hz``, ``step_frequency_hz`` and ``gait_frequency_hz``, and
    ``report["gait"]`` with phases, duty factor and source. A step frequency is not stated for gallop, canter and bound
    (E-07).

    Parameters
    ----------
    motion : Motion
        Motion (time, marker, space) in m, z up, at about constant speed: take one segment of a mixed recording.
    """
    found = measure_gait(motion)
    known = motion.facts
    gait = known.gait or found.gait
    stated_hz = known.stride_frequency_hz
    stride_hz = stated_hz if math.isfinite(stated_hz) else found.stride_frequency_hz
    step_hz, gait_hz = step_and_gait_frequency_hz(gait, stride_hz)
    facts = replace(
        known,
        gait=gait,
        footfalls=known.footfalls or found.footfalls,
        stride_from=found.measured_from,
        stride_frequency_hz=stride_hz,
        step_frequency_hz=known.step_frequency_hz if math.isfinite(known.step_frequency_hz) else step_hz,
        gait_frequency_hz=known.gait_frequency_hz if math.isfinite(known.gait_frequency_hz) else gait_hz,
    )
    measured = {"phases": found.phases, "duty_factor": found.duty_factor, "stride_from": found.measured_from}
    return replace(motion, facts=facts).with_report(gait=measured)


def step_and_gait_frequency_hz(gait: str, stride_frequency_hz: float) -> tuple[float, float]:
    """Step frequency and fundamental of the signature f_mu of a gait (E-07); NaN where not defined or not known."""
    if gait in SYMMETRICAL:
        return 2 * stride_frequency_hz, 2 * stride_frequency_hz
    return NAN, stride_frequency_hz if gait in ASYMMETRICAL else NAN


def name_quadruped_gait(phases: Mapping[str, float]) -> str:
    """Gait of a quadruped from the lags of its footfalls (after Hildebrand 1965 and 1977).

    Hind pair and fore pair both half a stride apart: symmetrical, and the lag of the fore limb behind the hind limb of
    its side tells pace (0), walk (0.25 or 0.75) and trot (0.5). Neither: hind pair and fore pair each at once is a
    bound; leads on different sides a rotary gallop; on the same side a canter where the leading hind and the trailing
    fore limb land together, else a transverse gallop.

    Parameters
    ----------
    phases : mapping
        ``lh_lf``, ``lh_rh`` and ``lf_rf`` in strides.

    Returns
    -------
    str
        ``""`` where a lag is missing or only one pair is half a stride apart.
    """
    if not {"lh_lf", "lh_rh", "lf_rf"} <= set(phases):
        return ""
    hind, fore, side = (_about_zero(phases[name]) for name in ("lh_rh", "lf_rf", "lh_lf"))
    apart = [abs(abs(lag) - 0.5) <= HALF_STRIDE for lag in (hind, fore)]
    if all(apart):
        # mean of the left and the right side
        return _symmetrical(side + _about_zero(fore - hind) / 2)
    if any(apart):
        return ""
    if max(abs(hind), abs(fore)) <= TOGETHER:
        return "bound"
    if hind * fore < 0:
        return "gallop"
    # the later limb of the hind pair leads, the earlier one of the fore pair trails
    leading_hind = max(hind, 0.0)
    trailing_fore = side + min(fore, 0.0)
    return "canter" if abs(_about_zero(trailing_fore - leading_hind)) < QUARTER else "transverse_gallop"


def _symmetrical(lateral: float) -> str:
    lag = abs(_about_zero(lateral))
    if lag < QUARTER:
        return "pace"
    return "trot" if lag > 0.5 - QUARTER else "walk"


def _name_human_gait(motion: Motion, phases: Mapping[str, float], duty: float) -> str:
    """``run`` where each foot bears weight for less than half of the stride and the body falls freely between them."""
    if "l_r" not in phases or abs(phases["l_r"] - 0.5) > HALF_STRIDE or not math.isfinite(duty):
        return ""
    return "run" if duty < 0.5 and _lowest_acceleration_mps2(motion) < FLIGHT_ACCELERATION_MPS2 else "walk"


def _lowest_acceleration_mps2(motion: Motion) -> float:
    """2nd percentile of the vertical acceleration of the body centre, over spans of 0.1 s."""
    rate = motion.rate_hz
    half = max(1, round(0.05 * rate))
    z = body_centre(motion.position_m)[:, 2]
    if len(z) <= 2 * half:
        return 0.0
    return float(np.percentile((z[2 * half :] - 2 * z[half:-half] + z[: -2 * half]) * (rate / half) ** 2, 2))


def _beat(landings: list[FloatArray]) -> float:
    """Frequency of an even beat through the landings of each foot, in Hz; NaN where there is none."""
    intervals = np.concatenate([np.diff(times) for times in landings] or [np.empty(0)])
    if intervals.size < min(2, len(landings)):
        return NAN
    period = float(np.median(intervals)) if intervals.size else NAN
    several = [times for times in landings if times.size > 1]
    # a missed landing counts as one more stride
    number = [np.concatenate([[0.0], np.cumsum(np.maximum(1, np.round(np.diff(t) / period)))]) for t in several]
    if not number:
        return NAN
    beats = np.concatenate([n - n.mean() for n in number])
    times = np.concatenate([t - t.mean() for t in several])
    fitted = float(beats @ times / (beats @ beats))
    scatter = float(np.sqrt(np.mean((times - fitted * beats) ** 2)))
    return 1.0 / fitted if scatter < LARGEST_SCATTER * fitted else NAN


def _lag(first: Steps, second: Steps, stride_hz: float) -> float:
    """Mean lag from the touchdowns of one foot to those of another, 0 to 1 strides; NaN where it keeps no value."""
    lags = (second.touchdown_s[:, np.newaxis] - first.touchdown_s) * stride_hz
    near = lags[np.abs(lags) < 1]
    vector = complex(np.exp(2j * np.pi * near).mean()) if near.size else 0j
    return (math.atan2(vector.imag, vector.real) / (2 * math.pi)) % 1.0 if abs(vector) >= STEADY else NAN


def _about_zero(lag: float) -> float:
    """The same lag in -0.5 to 0.5."""
    return lag - math.floor(lag + 0.5)
