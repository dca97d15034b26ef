"""Synthetic 24 GHz recordings of random targets.

Bursts of 128 samples at 3000 S/s, one every 200 ms, as the real ones.

The dataset builder makes unbroken frames; here only the pulses of the bursts are simulated, with the functions of the
pipeline, and become a recording like one that was read from files: everything after that is the analysis of both.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import sim_to_real_inputs as store
import sim_to_real_movers as movers
from xband_measures import FloatArray

from doppelgait.classify.patches import Patch
from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.core.labels import axis
from doppelgait.core.rng import Streams
from doppelgait.pipeline import Result, analyze
from doppelgait.pipeline.conditions import Conditions
from doppelgait.pipeline.simulate import observe_scene
from doppelgait.processing import Analysis
from doppelgait.radar import Radar, Recording
from doppelgait.radar.impairments import apply_impairments
from doppelgait.radar.measured import label_measured
from doppelgait.radar.simulate import noisy, synthesise_samples
from doppelgait.scene import Scene, Target

BURSTS, PULSES, RATE_HZ, PERIOD_S = 15, 128, 3000.0, 0.2
ANTENNA = {"kind": "cosine", "hpbw_azimuth_deg": 80, "hpbw_elevation_deg": 30}
"""Of the module's patch array; assumed."""
RADAR = Radar.preset("infineon-24", antenna=ANTENNA)
SECONDS = BURSTS * PERIOD_S
TIMES_S = (PERIOD_S * np.arange(BURSTS)[:, None] + np.arange(PULSES) / RATE_HZ).ravel()
SPEEDS_MPS = (0.4, 3.0)
CRAWLS_BELOW_MPS, CRAWLING_SHARE = 0.75, 0.3
TYPICAL_M2 = 0.3
ANALYSIS = Analysis()
PATCH = Patch(n_velocity=64, column_s=PERIOD_S, n_time=16, range_db=30.0)
PROFILE = np.linspace(-1.0, 3.0, 17)
"""Edges of the Doppler profile in units of the torso's velocity."""
PROFILE_DB = -30.0


@dataclass(frozen=True)
class Plan:
    """Switches of the simulation; each left out is an ablation.

    Parameters
    ----------
    motion : str
        ``models`` or ``recorded`` (motion capture).
    gait_variation : bool
        Sizes, gaits, unevenness and changes of speed.
    rcs_random, speckle, bounce : bool
    image : bool
        I/Q imbalance.
    clipping : bool
        Else the converter is never full.
    noise : bool
    dense : bool
        Bodies of points all along the bones. Off in the protocol's plan; put in after its scores were known.
    seed : int
    """

    motion: str = "models"
    gait_variation: bool = True
    rcs_random: bool = True
    speckle: bool = True
    bounce: bool = True
    image: bool = True
    clipping: bool = True
    noise: bool = True
    dense: bool = False
    seed: int = 24


@dataclass(frozen=True)
class Place:
    """Geometry and conditions of a target, from one distribution for all classes."""

    closest_m: float
    away: bool
    turn_deg: float
    height_m: float
    peak: float
    noise_db: float
    gain_db: float
    phase_deg: float
    offset_db: float
    reflects: bool


def draw_place(rng: np.random.Generator) -> Place:
    """Sample a place in a room and its conditions.

    Within 35 degrees of the line of sight.

    The strongest echo is 5 % to 300 % of the range of the converter.
    """
    return Place(
        closest_m=float(rng.uniform(0.5, 2.5)), away=bool(rng.random() < 0.3), turn_deg=float(rng.uniform(-35, 35)),
        height_m=float(rng.uniform(0.5, 1.4)), peak=float(np.exp(rng.uniform(*np.log((0.05, 3.0))))),
        noise_db=float(rng.uniform(-66, -42)), gain_db=float(rng.uniform(-4, 4)),
        phase_deg=float(rng.uniform(-35, 35)), offset_db=float(rng.uniform(-50, -10)),
        reflects=bool(rng.random() < 0.7),
    )  # fmt: skip


def draw_mover(plan: Plan, number: int, rng: np.random.Generator, mocap: Path | None) -> movers.Mover:
    """Sample the target of an example; half of them start from rest."""
    seconds, label = SECONDS + 0.1, movers.CLASSES[number % 2]
    pace = movers.drifting(rng, seconds, most=0.4 if plan.gait_variation else 0.0, starts=plan.gait_variation)
    speed_mps, crawls = movers.draw_speed_mps(rng, *SPEEDS_MPS), rng.random() < CRAWLING_SHARE
    if plan.motion == "recorded":
        if mocap is None:
            raise SystemExit("motion capture is asked for: give its folder, --mocap FOLDER")
        found = movers.recorded_mover(movers.recorded_stretches(mocap, seconds)[label], rng)
    elif label == "human" and crawls and speed_mps < CRAWLS_BELOW_MPS and plan.gait_variation:
        crawl = movers.until_possible(lambda: movers.crawler(speed_mps, movers.SPARE * seconds, rng))
        found = movers.Mover(crawl, label)
    else:
        found = movers.model_mover(label, speed_mps, seconds, rng, varied=plan.gait_variation)
    motion = movers.hurried(found.motion, seconds, pace)
    motion = movers.fleshed(motion, rng) if plan.dense else motion
    return movers.Mover(motion, label, found.subject or f"model-{number}")


def range_m(motion: Any, place: Place) -> float:
    """Return the mid-time range that gives the wanted shortest distance."""
    way_m = np.abs(motion.position_m[:, :, :2].mean(axis=1) - motion.position_m[0, :, :2].mean(axis=0)).max(axis=1)
    last, middle = round(SECONDS * movers.RATE_HZ), round(SECONDS / 2 * movers.RATE_HZ)
    return place.closest_m + float(way_m[middle] - way_m[0] if place.away else way_m[last] - way_m[middle])


def recording_of(plan: Plan, number: int, mocap: Path | None = None) -> tuple[Recording, movers.Mover]:
    """Simulate a recording; plan and number determine everything random."""
    streams = np.random.default_rng([plan.seed, number]).spawn(4)
    place = draw_place(streams[0])
    rcs = movers.draw_rcs(streams[1], random=plan.rcs_random, speckle=plan.speckle, total_m2=TYPICAL_M2)
    mover = draw_mover(plan, number, streams[2], mocap)
    rcs = rcs.model_copy(update={"kind": "auto", "occlusion": False}) if plan.dense else movers.fitting_rcs(rcs, mover)
    aspect_deg = (180.0 if place.away else 0.0) + place.turn_deg
    target = Target(mover.motion, rcs=rcs, range_m=range_m(mover.motion, place), aspect_deg=aspect_deg)
    scene = Scene([target], radar_position_m=(0.0, 0.0, place.height_m), duration_s=SECONDS)
    floor = ({"kind": "ground_bounce", "material": "concrete"},) if plan.bounce and place.reflects else ()
    drawn = streams[3].spawn(3)
    table, _ = observe_scene(
        scene,
        RADAR,
        TIMES_S,
        Conditions(environment=floor),
        angles=False,
        streams=Streams(int(drawn[0].integers(2**31))),
    )
    samples = _convert(plan, place, synthesise_samples(table, RADAR), drawn[1], drawn[2])
    recording = label_measured(
        Path("synthetic"), samples, radar=RADAR, slow_time_s=TIMES_S, range_m=np.array([5.0]),
        attrs={"burst_pulses": PULSES},
    )  # fmt: skip
    return recording, mover


def _convert(plan: Plan, place: Place, samples: Any, noise: np.random.Generator, rng: np.random.Generator) -> Any:
    """Pass samples through the receiver and its 1 V converter.

    Gain, noise, image, offset, 12 bits.
    """
    peak = place.peak if plan.clipping else min(place.peak, 0.6)
    samples = samples * np.complex64(peak / np.abs(samples).max())
    if plan.noise:
        samples = noisy(samples, noise_power_v2=10.0 ** (place.noise_db / 10.0), rng=noise)
    faults: list[dict[str, Any]] = [{"kind": "dc_leak", "level_db": place.offset_db}]
    if plan.image:
        faults.insert(0, {"kind": "iq_imbalance", "gain_db": place.gain_db, "phase_deg": place.phase_deg})
    faults.append({"kind": "adc", "bits": 12, "full_scale_v": 1.0})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)  # it clips on purpose
        return apply_impairments(samples, Conditions(impairments=faults).impairments, radar=RADAR, rng=rng).matrix


def features_of(result: Result) -> dict[str, float]:
    """Return six and extended features and the Doppler profile.

    The profile is relative to the velocity of the torso.
    """
    profile = profile_db(result)
    return {**store.row_of(result), **{f"profile_{place:+.2f}": value for place, value in profile.items()}}


def profile_db(result: Result) -> Mapping[float, float]:
    """Return energy by velocity over that of the torso, dB, 16 bins.

    Relative to the strongest bin; every burst has the same weight.
    """
    middles = (PROFILE[:-1] + PROFILE[1:]) / 2.0
    torso_mps = result.features.torso_velocity_mps
    if not torso_mps:
        return dict.fromkeys(middles.tolist(), float("nan"))
    mu = result.signature
    columns = mu.values / np.maximum(mu.values.sum(axis=1, keepdims=True), 1e-30)
    share, place = columns.mean(axis=0), np.asarray(axis(mu, "velocity")) / torso_mps
    order = np.argsort(place)
    edges = np.interp(PROFILE, place[order], np.cumsum(share[order]))
    energy: FloatArray = np.maximum(np.diff(edges), 1e-12)
    level_db = np.maximum(10.0 * np.log10(energy / energy.max()), PROFILE_DB)
    return dict(zip(middles.tolist(), level_db.tolist(), strict=True))


def analysed(recording: Recording) -> Result:
    """Analyze one recording, synthetic or real.

    The gate holds its one range bin.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)
        return analyze(recording, gate=(0.0, 1.0), analysis=ANALYSIS)[0]


def inputs_of_results(results: list[Result], labels: list[str], groups: list[str]) -> store.Inputs:
    """Convert analyses to model inputs."""
    rows = [features_of(result) for result in results]
    return store.inputs_of(rows, [result.signature for result in results], PATCH, labels, groups)


def dataset(plan: Plan, count: int, out: Path, *, mocap: Path | None = None) -> store.Inputs:
    """Load or make the model inputs of a plan.

    They are kept in the ``cache`` of the folder.
    """

    def chunk(numbers: range) -> store.Inputs:
        def make() -> store.Inputs:
            found = [recording_of(plan, number, mocap) for number in numbers]
            results = [analysed(recording) for recording, _ in found]
            movers_of = [mover for _, mover in found]
            return inputs_of_results(results, [m.label for m in movers_of], [m.subject for m in movers_of])

        name = f"cw-{store.key_of(plan, PATCH, ANTENNA, PROFILE.tolist())}-{numbers.start}-{numbers.stop}.npz"
        return store.kept_inputs(out / "cache" / name, make)

    return store.joined([chunk(numbers) for numbers in store.chunks(count)])
