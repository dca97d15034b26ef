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

from doppelgait.core.errors import DoppelgaitError, DoppelgaitWarning
from doppelgait.core.rng import Streams
from doppelgait.motion.loop import loop
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import travel_speed_mps
from doppelgait.pipeline.radar_table import Conditions
from doppelgait.pipeline.simulate import observe_scene
from doppelgait.radar import Radar, Recording
from doppelgait.radar.impairments import apply_impairments
from doppelgait.radar.measured import label_measured
from doppelgait.radar.simulate import synthesise_samples
from doppelgait.scene import Scene, Target
from doppelgait.scene.bodies import find_joints
from doppelgait.scene.rcs import RcsSpec

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
LARGEST_RETIMING = 0.25
"""Recorded people are made faster or slower by at most this share."""


@dataclass(frozen=True)
class Plan:
    """What is simulated: ``recorded`` motion (motion capture) or ``models``, with a seed."""

    motion: str = "recorded"
    seed: int = 24


@lru_cache(maxsize=1)
def recorded_people(mocap: Path) -> tuple[tuple[str, Motion], ...]:
    """Read looped straight segments of recorded people with known joints. Each is a subject and a motion."""
    found: list[tuple[str, Motion]] = []
    for path in sorted(path for path in (mocap / "human").rglob("*") if path.is_file()):
        for motion in stretches(path).values():
            if find_joints(motion)[2] or not motion.facts.height_m > 0:
                continue
            with warnings.catch_warnings(), suppress(DoppelgaitError, ValueError):
                warnings.simplefilter("ignore", DoppelgaitWarning)  # of recordings of less than two strides
                found.append((motions.subject_of(path), loop(motion, duration_s=2.0 * SECONDS, variation=0.0)))
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
        motion = motions.until_possible(lambda: motions.person(speed_mps, 4.0 * lasts_s, rng))
    rest_s, rise_s = rng.uniform(0.0, 0.6), rng.uniform(0.4, 0.8)

    def pace(times_s: FloatArray) -> FloatArray:
        risen = np.clip((times_s - rest_s) / rise_s, 0.0, 1.0)
        return np.asarray(hurry * risen)

    return subject, motions.hurried(motion, lasts_s, pace)


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
    rcs = RcsSpec(kind="surfaces", occlusion=True)
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
