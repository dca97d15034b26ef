"""Simulated people who set off towards a 24 GHz continuous-wave module.

Bursts of 128 samples at 3000 S/s, one every 200 ms, as the real ones. Only the pulses of the bursts are simulated, with
the functions of the pipeline, and become a recording like one that was read from files.
"""

from __future__ import annotations

import warnings
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import sim_to_real_motions as motions
from gait_frequency import stretches
from xband_measures import FloatArray

from doppelgait.core.errors import ConfigError, DoppelgaitError, DoppelgaitWarning
from doppelgait.core.plugins import plugin
from doppelgait.core.rng import Streams
from doppelgait.motion.loop import loop
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import travel_speed_mps
from doppelgait.motion.skeleton import BOULIC_PARTS
from doppelgait.pipeline.conditions import Conditions
from doppelgait.pipeline.simulate import observe_scene
from doppelgait.radar import Radar, Recording
from doppelgait.radar.impairments import apply_impairments
from doppelgait.radar.measured import label_measured
from doppelgait.radar.simulate import synthesise_samples
from doppelgait.scene import Scene, Target
from doppelgait.scene.bodies import Ellipsoids, find_body, find_own_points
from doppelgait.scene.rcs import RcsSpec, total_rcs_m2
from doppelgait.scene.scatterers import View

BURSTS, PULSES, RATE_HZ, PERIOD_S = 15, 128, 3000.0, 0.2
SECONDS = BURSTS * PERIOD_S
TIMES_S = (PERIOD_S * np.arange(BURSTS)[:, None] + np.arange(PULSES) / RATE_HZ).ravel()
FULL_SCALE_V = 0.5
WIDE = {"kind": "cosine", "hpbw_azimuth_deg": 30, "hpbw_elevation_deg": 80}
"""The long axis of the module's patches lies level; assumed, as the read-me files do not tell how it stood."""
MOTIONS = {"creep": (3.2, 0.7, 1.0), "walk": (4.0, 1.0, 1.3), "stride": (5.0, 1.4, 1.8), "run": (7.0, 2.1, 2.6)}
"""Start of the read-me files, m, and speeds of the development half, m/s (upper quartile of the bursts' lines)."""
NEAREST_M = 0.7
LEVEL_DB, LEVEL_SD_DB = -19.0, 3.0
"""Of full scale, without the mean, in the first burst at full speed; development half."""
LEVEL_AT_S = 0.8
NOISE_DB = ((100.0, -40.5), (400.0, -41.3), (700.0, -43.7), (1000.0, -44.3), (1300.0, -45.0), (1500.0, -46.0))
"""Frequency, Hz, and density, dB of full scale over the band; first bursts, at rest, of the development half."""
IQ = {"kind": "iq_imbalance", "gain_db": 5.55, "phase_deg": 14.2}
IQ_OF_ALL = {"kind": "iq_imbalance", "gain_db": -2.26, "phase_deg": 21.7}
DC = {"kind": "dc_leak", "level_db": -36.0, "phase_deg": -46.8}
"""Fitted to the development half by ``doppelgait.radar.fit``; the second imbalance is behind the noise."""
POINTS = 400
"""Of a body's surface; twice as many change no figure by 1 dB."""
LARGEST_RETIMING = 0.25
"""Recorded people are made faster or slower by at most this share."""
JOINTS: tuple[dict[str, str], ...] = (
    {"base": "root", "neck": "thorax", "head": "head", "shoulder": "{s}clavicle", "elbow": "{s}humerus",
     "hand": "{s}wrist", "hip": "{s}hipjoint", "knee": "{s}femur", "ankle": "{s}tibia", "toe": "{s}toes"},
    {"base": "Hips", "neck": "Neck", "head": "Head", "shoulder": "UpperArm_{S}", "elbow": "LowerArm_{S}",
     "hand": "Hand_{S}", "hip": "UpperLeg_{S}", "knee": "LowerLeg_{S}", "ankle": "Foot_{S}", "toe": "Toes_{S}"},
    {"base": "Hips", "neck": "Neck1", "head": "Head_End", "shoulder": "{Side}Arm", "elbow": "{Side}ForeArm",
     "hand": "{Side}Hand", "hip": "{Side}UpLeg", "knee": "{Side}Leg", "ankle": "{Side}Foot", "toe": "{Side}ToeBase"},
)  # fmt: skip
"""Joints of the skeletons of ASF/AMC, Bandai-Namco and CMU BVH files."""


@dataclass(frozen=True)
class Plan:
    """What is simulated: ``recorded`` motion (motion capture) or ``models``, with a seed."""

    motion: str = "recorded"
    seed: int = 24


def joints_of(motion: Motion) -> Motion | None:
    """Return the joints of a recorded person, or None."""
    try:
        find_body(motion.markers, "")
        return motion
    except ConfigError:
        number = {name: n for n, name in enumerate(motion.markers)}
    for joints in JOINTS:
        found = []
        for joint in BOULIC_PARTS:
            side, _, name = joint.rpartition("_")
            text = joints[name].format(s=side[:1], S=side[:1].upper(), Side=side.capitalize())
            found.append(number.get(text, -1))
        if min(found) >= 0:
            return motion.with_points(motion.position_m[:, found], list(BOULIC_PARTS), list(BOULIC_PARTS.values()))
    return None


@lru_cache(maxsize=1)
def recorded_people(mocap: Path) -> tuple[tuple[str, Motion], ...]:
    """Read looped straight segments of recorded people with known joints. Each is a subject and a motion."""
    found: list[tuple[str, Motion]] = []
    for path in sorted(path for path in (mocap / "human").rglob("*") if path.is_file()):
        for motion in stretches(path).values():
            joints = joints_of(motion)
            if joints is None or not joints.facts.height_m > 0:
                continue
            with warnings.catch_warnings(), suppress(DoppelgaitError, ValueError):
                warnings.simplefilter("ignore", DoppelgaitWarning)  # of recordings of less than two strides
                found.append((motions.subject_of(path), loop(joints, duration_s=2.0 * SECONDS, variation=0.0)))
    return tuple(found)


def draw_person(plan: Plan, kind: str, rng: np.random.Generator, mocap: Path | None) -> tuple[str, Motion]:
    """Sample a person who sets off; return subject and motion. ``kind`` is one of the read-me's motions."""
    _, low_mps, high_mps = MOTIONS[kind]
    speed_mps = float(rng.uniform(low_mps, high_mps))
    lasts_s, hurry = SECONDS + 0.1, 1.0
    if plan.motion == "recorded":
        if mocap is None:
            raise SystemExit("motion capture is asked for: give its folder, --mocap FOLDER")
        gait = "run" if kind == "run" else "walk"
        fitting = []
        for subject, motion in recorded_people(mocap):
            hurry = speed_mps / float(travel_speed_mps(motion))
            if motion.facts.gait == gait and abs(np.log(hurry)) < LARGEST_RETIMING:
                fitting.append((subject, motion, hurry))
        subject, motion, hurry = fitting[int(rng.integers(len(fitting)))]
    else:
        subject = "model"
        motion = motions.until_possible(lambda: motions.person(speed_mps, 4.0 * lasts_s, rng, varied=True))
    rest_s, rise_s = rng.uniform(0.0, 0.6), rng.uniform(0.4, 0.8)

    def pace(times_s: FloatArray) -> FloatArray:
        risen = np.clip((times_s - rest_s) / rise_s, 0.0, 1.0)
        return np.asarray(hurry * risen)

    return subject, motions.hurried(motion, lasts_s, pace)


def area_points(semi_axes_m: FloatArray, count: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Sample points of ellipsoids, uniform by area."""
    unit = rng.normal(size=(100 * count, 3))
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    segment = rng.integers(len(semi_axes_m), size=len(unit))
    axes = semi_axes_m[segment]
    stretch = axes.prod(axis=1) * np.linalg.norm(unit / axes, axis=1)
    chosen = rng.choice(len(unit), size=count, replace=False, p=stretch / stretch.sum())
    return unit[chosen], segment[chosen]


def _axes(body: Ellipsoids, up: FloatArray, sideways: FloatArray) -> FloatArray:
    """Return the axes across, upright and along of ellipsoids.

    The result has the shape (I, S, 3, 3). Ellipsoids of revolution turn with the trunk, or stay level where they are
    themselves sideways.
    """
    along = body.along
    level = np.abs((along * sideways[:, None]).sum(axis=-1)).mean(axis=0) > 0.7
    reference = np.where(level[None, :, None], up[:, None], sideways[:, None])
    across = np.where(np.abs(body.across).sum(axis=-1, keepdims=True) > 0, body.across, reference)
    across = across - (across * along).sum(axis=-1, keepdims=True) * along
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    return np.stack([across, np.cross(along, across), along], axis=-2)


@plugin("rcs", "surface", parameters=RcsSpec)
def scatter_surface(view: View, spec: RcsSpec) -> tuple[Motion, FloatArray]:
    """Use points by area over the skin of the body.

    They move with their bones. Every point stands for an equal area that reflects diffusely (Lambert): its cross
    section goes with the squared cosine between its normal and the radar, and is nothing on the far side.
    """
    skeleton, body = view.skeleton, view.frames
    unit, segment = area_points(skeleton.semi_axes_m, POINTS, np.random.default_rng(0))
    number = {name: n for n, name in enumerate(skeleton.joints.markers)}
    joints_m = skeleton.joints.position_m
    sideways = joints_m[:, number["left_hip"]] - joints_m[:, number["right_hip"]]
    sideways /= np.linalg.norm(sideways, axis=1)[:, None]
    axes = _axes(body, np.broadcast_to([0.0, 0.0, 1.0], sideways.shape), sideways)[:, segment]
    semi_m = skeleton.semi_axes_m[segment]
    points_m = body.centre_m[:, segment] + np.einsum("tpkx,pk->tpx", axes, unit * semi_m)
    outside = find_own_points(points_m, body).sum(axis=1) < 2  # what lies inside another segment is no skin
    normal = np.einsum("tpkx,pk->tpx", axes, unit / semi_m)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    to_radar = view.radar_position_m - points_m
    to_radar /= np.linalg.norm(to_radar, axis=-1, keepdims=True)
    facing = np.maximum((normal * to_radar).sum(axis=-1), 0.0)[:, outside] ** 2
    names = [f"point{n}" for n in range(int(outside.sum()))]
    parts = [skeleton.segments[n].part for n in segment[outside]]
    place = view.time_s * view.motion.rate_hz
    frame = np.minimum(place.astype(int), len(facing) - 2)
    share = (place - frame)[:, None]
    rcs_m2 = (1.0 - share) * facing[frame] + share * facing[frame + 1]
    rcs_m2 *= total_rcs_m2(spec, view.motion.facts.mass_kg) / facing.sum(axis=1).mean()
    return skeleton.joints.with_points(points_m[:, outside], names, parts), rcs_m2


def recording_of(plan: Plan, number: int, mocap: Path | None = None) -> tuple[Recording, str, str]:
    """Simulate a recording; plan and number determine everything random."""
    streams = np.random.default_rng([plan.seed, number]).spawn(4)
    kind = list(MOTIONS)[number % len(MOTIONS)]
    subject, motion = draw_person(plan, kind, streams[0], mocap)
    rng = streams[1]
    centre_m = motion.position_m[:, :, :2].mean(axis=1)
    way_m = np.linalg.norm(centre_m - centre_m[0], axis=1)[: round(SECONDS * motions.RATE_HZ) + 1]
    end_m = float(way_m[-1])
    start_m = max(MOTIONS[kind][0], end_m + NEAREST_M)
    rcs = RcsSpec(kind="surface", occlusion=True)
    target = Target(motion, rcs=rcs, range_m=start_m - float(way_m[way_m.size // 2]), aspect_deg=rng.uniform(-15, 15))
    scene = Scene([target], radar_position_m=(0.0, 0.0, rng.uniform(0.7, 1.3)), duration_s=SECONDS)
    radar = Radar.preset("infineon-24", antenna=WIDE)
    floor = Conditions(environment=({"kind": "ground_bounce", "material": "concrete"},))
    seed = Streams(int(streams[2].integers(2**31)))
    table, _ = observe_scene(scene, radar, TIMES_S, floor, angles=False, streams=seed)
    samples = synthesise_samples(table, radar)
    volts = 20.0 * np.log10(FULL_SCALE_V)
    noise = {"kind": "coloured_noise", "levels": [(hz, level + volts) for hz, level in NOISE_DB]}
    adc = {"kind": "adc", "bits": 12, "full_scale_v": FULL_SCALE_V}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)  # it clips on purpose
        mixed = _impaired(samples, [IQ], radar, streams[3])
        first = round(LEVEL_AT_S / PERIOD_S) * PULSES
        level_v = FULL_SCALE_V * 10.0 ** (rng.normal(LEVEL_DB, LEVEL_SD_DB) / 20.0)
        mixed = mixed * np.complex64(level_v / mixed[first : first + PULSES].std())
        made = _impaired(mixed, [noise, IQ_OF_ALL, DC, adc], radar, streams[3])
    recording = label_measured(
        Path("synthetic"), made, radar=radar, slow_time_s=TIMES_S, range_m=np.array([5.0]),
        attrs={"burst_pulses": PULSES},
    )  # fmt: skip
    return replace(recording, source=f"simulated {number}"), kind, subject


def _impaired(samples: Any, faults: list[dict[str, Any]], radar: Radar, rng: np.random.Generator) -> Any:
    return apply_impairments(samples, Conditions(impairments=faults).impairments, radar=radar, rng=rng).matrix
