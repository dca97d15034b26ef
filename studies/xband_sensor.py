"""Real X-band images of people and dogs compared with simulations.

    python studies/xband_sensor.py RADAR_DATA/fmcw_xband_manga --page

Question: does the simulated display of a target look like the real one, measured by lines, profiles and levels?

The folder holds `decoded_levels.npz`: the levels of published spectrograms (github.com/AmishaManga/MSc-Micro-
Doppler-Classification), 256 x 624, 0 to 255 for -30 to -10 dB. For every recording a target of the same torso speed and
direction is simulated through the radar, and displayed as the source displays (`studies/xband_measures.py`). From each
recording come its torso speed, its direction and the noise level below the maximum, nothing else. Chosen for all alike,
by what is usual and by looking at the figures: the range (60 m in the middle), sizes of the targets, their radar cross
sections and how these fluctuate, the ground's echo, its sway and its reflection, starting phase 0. Left out are the
images of two people, of the running person (whose Doppler wraps) and the dog that stops on the way. It takes 3 minutes
of one core.

Not shown: this is no held-out evidence. The common parameters were chosen with these eight images in view.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xband_measures as measures
from harness import finish, make_parser, markdown
from xband_measures import FloatArray

from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.core.rng import Streams
from doppelgait.motion import make_motion
from doppelgait.motion.models import boulic_walk, human_gait, quadruped_gait
from doppelgait.motion.motion import Motion
from doppelgait.pipeline import simulate
from doppelgait.pipeline.conditions import Conditions
from doppelgait.radar import Radar, Recording
from doppelgait.scene import Scene, Target
from doppelgait.scene.rcs import RcsSpec

DATA_FILE = "decoded_levels.npz"
SEED = 97
RADAR = Radar.preset("xband-fmcw", carrier_hz=9.7e9, prf_hz=1.0 / measures.PRI_S)
"""1008 samples at 700 kS/s (1.44 ms) every 1.68 ms: unambiguous to 4.6 m/s, as the figures' axis says."""
OBSERVATION_S = measures.N_SWEEPS * measures.PRI_S
RANGE_M = 60.0
RADAR_HEIGHT_M = 1.2
GROUND_RCS_M2 = 0.1
"""Mean radar cross section of the ground in one metre of range."""
GROUND_PER_M = 4
SWAY_S, SWAY_M = 0.15, 0.004
"""Correlation time and mean displacement of the ground's points."""
FIELD = ({"kind": "ground_bounce", "material": "medium_dry_ground", "roughness_m": 0.02},)
SPECKLE: dict[str, Any] = {"fluctuation": "swerling1", "correlation_s": 0.08}
STEP_TIME_SD, STEP_LENGTH_SD, STRIDE_VARIATION = 0.02, 0.03, 0.03

Model = Callable[[float, np.random.Generator], Motion]


def person(speed_mps: float, rng: np.random.Generator) -> Motion:
    """Make a walk with locked feet and natural step variation."""
    return human_gait(
        gait="walk", speed_mps=speed_mps, duration_s=OBSERVATION_S + 1.0, step_time_sd=STEP_TIME_SD,
        step_length_sd=STEP_LENGTH_SD, rng=rng,
    )  # fmt: skip


def boulic(speed_mps: float, rng: np.random.Generator) -> Motion:
    """Make a walk as published, every step the same."""
    del rng
    return boulic_walk(speed_mps=speed_mps, duration_s=OBSERVATION_S + 1.0)


def dog(speed_mps: float, rng: np.random.Generator) -> Motion:
    """Make a walk or trot of a 0.5 m dog. The gait depends on the speed."""
    return quadruped_gait(
        gait="auto", speed_mps=speed_mps, duration_s=OBSERVATION_S + 1.0, stride_variation=STRIDE_VARIATION, rng=rng
    )


BODY = RcsSpec(kind="ellipsoids", occlusion=True, total_m2=0.8, **SPECKLE)
DOG_BODY = RcsSpec(kind="ellipsoids", occlusion=True, total_m2=0.2, **SPECKLE)
DOG_POINTS = RcsSpec(kind="body_parts", total_m2=0.05, **SPECKLE)
"""The total is chosen by the three dogs: points have no aspect, and a dog seen from its end is small."""
MODELS: dict[str, dict[str, tuple[Model, RcsSpec]]] = {
    "human": {"human": (person, BODY), "boulic": (boulic, BODY)},
    "dog": {"dog, ellipsoids": (dog, DOG_BODY), "dog, points": (dog, DOG_POINTS)},
}


@dataclass(frozen=True)
class Pair:
    """One real figure; direction is 1 towards and -1 away."""

    key: str
    label: str
    direction: int

    @property
    def name(self) -> str:
        """Name without the class."""
        return self.key.split("__")[1]


PAIRS = (
    Pair("human__NormalToward", "human", 1),
    Pair("human__NormalAway", "human", -1),
    Pair("human__PocketAway", "human", -1),
    Pair("human__SwingingArmsTowards", "human", 1),
    Pair("human__TowardPaintgun", "human", 1),
    Pair("dog__LinkWalkingToward", "dog", 1),
    Pair("dog__LinkWalkAway2", "dog", -1),
    Pair("dog__LokiWalkingToward", "dog", 1),
)


def ground(length_m: float, rng: np.random.Generator, *, sway_m: float = SWAY_M) -> Motion:
    """Sample ground points that sway in the wind.

    Along the line of sight; Gaussian processes of exponentially distributed size.
    """
    count, rate_hz = round(length_m * GROUND_PER_M), 50.0
    n_frames = round((OBSERVATION_S + 1.0) * rate_hz)
    reach = round(4 * SWAY_S * rate_hz)
    kernel = np.exp(-((np.arange(-reach, reach + 1) / (SWAY_S * rate_hz)) ** 2))
    white = rng.standard_normal((count, n_frames + 2 * reach))
    smooth = np.array([np.convolve(row, kernel, mode="valid") for row in white]) / np.sqrt((kernel**2).sum())
    displaced_m = smooth * sway_m * rng.standard_exponential((count, 1))
    position_m = np.zeros((n_frames, count, 3))
    position_m[:, :, 0] = (rng.uniform(-0.5, 0.5, count) * length_m)[None] + displaced_m.T
    position_m[:, :, 2] = 0.3
    names = [f"tuft{number}" for number in range(count)]
    facts = {"source": "ground", "kind": "ground", "mass_kg": 1.0, "height_m": 0.3}
    return make_motion(position_m, rate_hz=rate_hz, markers=names, parts=[""] * count, facts=facts)


def scene_of(pair: Pair, motion: Motion, rcs: RcsSpec, *, speed_mps: float, rng: np.random.Generator) -> Scene:
    """Make a scene of the target and the ground below it. The target moves on a line through the radar."""
    aspect_deg = 0.0 if pair.direction > 0 else 180.0
    target = Target(motion, label=pair.label, rcs=rcs, range_m=RANGE_M, aspect_deg=aspect_deg)
    length_m = speed_mps * OBSERVATION_S + 8.0
    field = ground(length_m, rng)
    echo = RcsSpec(kind="equal", total_m2=GROUND_RCS_M2 * length_m)
    around = Target(field, rcs=echo, range_m=RANGE_M, background=True)
    position_m = (0.0, 0.0, RADAR_HEIGHT_M)
    return Scene([target, around], radar_position_m=position_m, duration_s=OBSERVATION_S)


def burst_bins(recording: Recording, *, error_m: float = 0.0) -> list[int]:
    """Return the range bin of the body in every burst.

    In the middle of the burst. Or of a place ``error_m`` behind it.
    """
    range_m, track_m = recording.range_m, recording.truth[0].centre_range_m + error_m
    middles = measures.BURST_SWEEPS * np.arange(measures.N_BURSTS) + measures.BURST_SWEEPS // 2
    return [int(np.argmin(np.abs(range_m - track_m[middle]))) for middle in middles]


def simulate_levels(pair: Pair, model: Model, rcs: RcsSpec, *, speed_mps: float, noise_db: float) -> FloatArray:
    """Simulate the displayed levels of a target. With the relative noise of the recording."""
    streams = np.random.default_rng([SEED, PAIRS.index(pair)]).spawn(4)
    scene = scene_of(pair, model(speed_mps, streams[0]), rcs, speed_mps=speed_mps, rng=streams[1])
    noise_streams = Streams(int(streams[2].integers(2**31)))

    def observed(impairments: Sequence[dict[str, Any]] = ()) -> Recording:
        receiver = Conditions(noise={"kind": "none"}, environment=FIELD, impairments=impairments)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DoppelgaitWarning)  # feet and paws alias, as they do in the recordings
            return simulate(scene, RADAR, rng=noise_streams, conditions=receiver, angles=False)

    quiet = observed()
    bins = burst_bins(quiet)
    highest_v2 = measures.pixel_power(measures.stitched(quiet.baseband.values, bins)).max()
    level_db = 10.0 * float(np.log10(highest_v2 / measures.noise_gain())) + noise_db
    noisy = observed([{"kind": "thermal_noise", "level_db": level_db}])
    return measures.displayed_db(measures.pixel_power(measures.stitched(noisy.baseband.values, bins)))


def real_levels(data: Path) -> dict[str, FloatArray]:
    """Read the levels of the real figures, dB."""
    return measures.read_levels(data / DATA_FILE, [pair.key for pair in PAIRS])


def facts_of(level_db: FloatArray) -> list[float]:
    """Measure the facts of an image.

    Torso, share of the trunk's line in percent, envelope, its ratio to the torso, modulation, floor and ceiling shares
    in percent, noise, step at joints.
    """
    torso, envelope = measures.torso_speed_mps(level_db), measures.envelope_mps(level_db)
    floor, ceiling = measures.clipped_shares(level_db)
    return [
        torso, 100 * measures.line_share(level_db), envelope, envelope / torso, measures.modulation_hz(level_db),
        100 * floor, 100 * ceiling, measures.noise_db(level_db), measures.boundary_step_db(level_db),
    ]  # fmt: skip


def distances(one: FloatArray, other: FloatArray) -> list[float]:
    """Return histogram and profile distances of two images.

    Root mean square and correlation of the profiles, without and with the ground.
    """
    return [
        measures.histogram_distance_db(one, other),
        *measures.profile_distance(one, other, ground=False),
        *measures.profile_distance(one, other, ground=True),
    ]


DISTANCES = ("histogram dB", "profile dB", "correlation", "profile dB, all v", "correlation, all v")
FACTS = (
    "torso m/s", "line %", "envelope m/s", "ratio", "modulation Hz", "floor %", "ceiling %", "noise dB", "joints dB",
)  # fmt: skip


def mean_distances(name: str, some: dict[str, FloatArray], others: dict[str, FloatArray]) -> tuple[str, list[float]]:
    """Average the distances of all images from all others. A recording and its own simulation are left out."""
    rows = [distances(a, b) for one, a in some.items() for other, b in others.items() if one != other]
    return f"{name} ({len(rows)})", list(np.mean(rows, axis=0))


def baselines(real: dict[str, FloatArray], simulated: dict[str, FloatArray]) -> list[tuple[str, list[float]]]:
    """Return reference distances within and between the classes."""

    def of(images: dict[str, FloatArray], label: str) -> dict[str, FloatArray]:
        return {pair.key: images[pair.key] for pair in PAIRS if pair.label == label}

    return [
        mean_distances(f"{one[0]} {one[1]}, {other[0]} {other[1]}", of(one[2], one[1]), of(other[2], other[1]))
        for one, other in (
            (("real", "human", real), ("real", "human", real)),
            (("real", "dog", real), ("real", "dog", real)),
            (("real", "human", real), ("real", "dog", real)),
            (("simulated", "human", simulated), ("real", "human", real)),
            (("simulated", "human", simulated), ("real", "dog", real)),
            (("simulated", "dog", simulated), ("real", "dog", real)),
            (("simulated", "dog", simulated), ("real", "human", real)),
        )
    ]


def compare(pair: Pair, own: FloatArray) -> dict[str, FloatArray]:
    """Simulate one recording by all models, the side of the target above."""
    speed_mps, noise_db = measures.torso_speed_mps(own), measures.noise_db(own)
    return {
        name: measures.towards(
            simulate_levels(pair, model, rcs, speed_mps=speed_mps, noise_db=noise_db), direction=pair.direction
        )
        for name, (model, rcs) in MODELS[pair.label].items()
    }


def main() -> None:
    """Simulate, measure and write."""
    options = make_parser(__doc__, data=f"folder with {DATA_FILE}").parse_args()
    levels = real_levels(options.data)
    real = {pair.key: measures.towards(levels[pair.key], direction=pair.direction) for pair in PAIRS}
    simulated = {pair.key: compare(pair, real[pair.key]) for pair in PAIRS}
    first = {key: next(iter(images.values())) for key, images in simulated.items()}
    facts, apart = [], []
    for pair in PAIRS:
        own = real[pair.key]
        images = {"real": own, **simulated[pair.key]}
        facts += [(f"{pair.name}: {name}", *facts_of(image)) for name, image in images.items()]
        apart += [(f"{pair.name}: {name}", *distances(own, image)) for name, image in simulated[pair.key].items()]
    apart += [(name, *values) for name, values in baselines(real, first)]
    sections = {
        "Measures of the images": markdown(("", *FACTS), facts),
        "Distances of real and simulated images": markdown(("", *DISTANCES), apart),
    }
    finish(__file__, __doc__, sections, page=options.page)


if __name__ == "__main__":
    main()
