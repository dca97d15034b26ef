"""Synthetic X-band images of random targets, a training set.

The dataset builder has no place for this display (twenty bursts without their mean, one range bin of each, levels cut
at -30 and -10 dB below the image's own maximum) nor for swaying ground, so that the images are made here, with the
functions of the pipeline. Cheaper than the full sensor model and the same picture: a sweep has 72 samples instead of
1008 (135 m of unambiguous range are enough), the ground is simulated by itself at 100 sweeps/s and interpolated (it
moves at some cm/s), and noise is added to the range bin that is kept. Target and ground are stored, so that noise,
display need no second simulation.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import sim_to_real_inputs as store
import sim_to_real_motions as motions
import xband_gait
import xband_measures as measures
from scipy.interpolate import CubicSpline
from xband_measures import FloatArray

from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.core.rng import Streams
from doppelgait.motion import make_motion
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import travel_speed_mps
from doppelgait.pipeline import simulate
from doppelgait.pipeline.radar_table import Conditions
from doppelgait.pipeline.spectrogram import make_level_gate
from doppelgait.pipeline.target import analyze_signature
from doppelgait.processing.patches import Patch
from doppelgait.radar import Radar, Recording
from doppelgait.scene import Scene, Target
from doppelgait.scene.rcs import RcsSpec

ComplexArray = npt.NDArray[np.complex128]

FULL_RADAR = Radar.preset("xband-fmcw", carrier_hz=9.7e9, prf_hz=1.0 / measures.PRI_S)
"""1008 samples at 700 kS/s (1.44 ms) every 1.68 ms: unambiguous to 4.6 m/s, as the figures' axis says."""
RADAR = FULL_RADAR.model_copy(update={"sample_rate_hz": 50e3})
OBSERVATION_S = measures.N_SWEEPS * measures.PRI_S
GROUND_PER_M = 4
SWAY_S, SWAY_M = 0.15, 0.004
"""Correlation time and mean displacement of the ground's points."""
FIELD = {"kind": "ground_bounce", "material": "medium_dry_ground"}
GROUND_RADAR = RADAR.model_copy(update={"prf_hz": 100.0})
SPEEDS_MPS = (0.6, 4.4)
PATCH = Patch(velocity_mps=measures.EDGE_MPS, n_velocity=64, column_s=1 / 12, n_time=48, range_db=20.0)
"""The figures' own span of velocities and levels; 4 s of it."""


@dataclass(frozen=True)
class Plan:
    """Kinds of targets, equally often, and the seed."""

    kinds: tuple[str, ...] = (*motions.CLASSES, motions.LARGE)
    seed: int = 8


@dataclass(frozen=True)
class Place:
    """Geometry and conditions of a target, from one distribution for all classes."""

    range_m: float
    aspect_deg: float
    height_m: float
    gate_error_m: float
    noise_db: float
    ground_m2: float
    sway_m: float
    reflects: bool
    roughness_m: float


def draw_place(rng: np.random.Generator) -> Place:
    """Sample a place outdoors and its conditions.

    Towards or away within 30 degrees, at 35 to 75 m. Ground and noise of any strength that leaves an image.
    """
    away = 180.0 * bool(rng.random() < 0.5)
    return Place(
        range_m=float(rng.uniform(35, 75)), aspect_deg=float(away + rng.uniform(-30, 30)),
        height_m=float(rng.uniform(0.8, 2.0)), gate_error_m=float(rng.normal(0, 0.5)),
        noise_db=float(rng.uniform(-40, -26)), ground_m2=float(np.exp(rng.uniform(*np.log((0.005, 0.5))))),
        sway_m=float(np.exp(rng.uniform(*np.log((0.001, 0.01))))), reflects=bool(rng.random() < 0.8),
        roughness_m=float(rng.uniform(0, 0.05)),
    )  # fmt: skip


def draw_target(plan: Plan, number: int, rng: np.random.Generator) -> list[Motion]:
    """Sample the target of an example; of a pair, both."""
    label = plan.kinds[number % len(plan.kinds)]
    speed_mps, seconds = motions.draw_speed_mps(rng, *SPEEDS_MPS), OBSERVATION_S + 0.1
    found = []
    for place, one in enumerate(["human", "dog"] if label == "pair" else [label]):
        like_mps = speed_mps if place == 0 else float(np.clip(speed_mps * rng.uniform(0.9, 1.1), *SPEEDS_MPS))
        found.append(motions.make_model_motion(one, like_mps, seconds, rng))
    return found


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


def burst_bins(recording: Recording, *, error_m: float = 0.0) -> list[int]:
    """Return the range bin of the body in every burst.

    In the middle of the burst. Or of a place ``error_m`` behind it.
    """
    range_m, track_m = recording.range_m, recording.truth[0].centre_range_m + error_m
    middles = measures.BURST_SWEEPS * np.arange(measures.N_BURSTS) + measures.BURST_SWEEPS // 2
    return [int(np.argmin(np.abs(range_m - track_m[middle]))) for middle in middles]


def echoes_of(plan: Plan, number: int) -> dict[str, Any]:
    """Simulate the echoes of one example in the kept range bins. Burst by burst, without the means of the bursts."""
    streams = np.random.default_rng([plan.seed, number]).spawn(4)
    place = draw_place(streams[0])
    rcs = motions.draw_rcs(streams[1])
    company, noise_streams = draw_target(plan, number, streams[2]), streams[3].spawn(2)
    speed_mps = float(travel_speed_mps(company[0], first_s=OBSERVATION_S))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)  # feet and paws alias, as they do in the recordings
        signal, bins = _target_echo(company, place, rcs, rng=noise_streams[0])
        ground = _ground_echo(place, bins, speed_mps, noise_streams[1])
    return {
        "mover": signal, "ground": ground, "noise_db": place.noise_db, "label": plan.kinds[number % len(plan.kinds)],
        "group": f"model-{plan.seed}-{number}", "radial_mps": speed_mps * math.cos(math.radians(place.aspect_deg)),
    }  # fmt: skip


def _simulate_quietly(scene: Scene, radar: Radar, rng: np.random.Generator, **conditions: Any) -> Recording:
    """Simulate a scene without noise."""
    quiet = Conditions(noise={"kind": "none"}, **conditions)
    return simulate(scene, radar, rng=Streams(int(rng.integers(2**31))), conditions=quiet, angles=False)


def _target_echo(
    company: list[Motion], place: Place, rcs: RcsSpec, *, rng: np.random.Generator
) -> tuple[ComplexArray, list[int]]:
    field = ({**FIELD, "roughness_m": place.roughness_m},) if place.reflects else ()
    targets = [
        Target(motion, rcs=rcs, range_m=place.range_m + 0.7 * n, aspect_deg=place.aspect_deg)
        for n, motion in enumerate(company)
    ]
    scene = Scene(targets, radar_position_m=(0.0, 0.0, place.height_m), duration_s=OBSERVATION_S)
    recording = _simulate_quietly(scene, RADAR, rng, environment=field)
    bins = burst_bins(recording, error_m=place.gate_error_m)
    return measures.stitched(recording.baseband.values, bins), bins


def _ground_echo(place: Place, bins: list[int], speed_mps: float, rng: np.random.Generator) -> ComplexArray:
    """Simulate the ground echo in the bins of the bursts. On the sweeps of the echo of the target."""
    length_m = speed_mps * OBSERVATION_S + 8.0
    echo = RcsSpec(kind="equal", total_m2=place.ground_m2 * length_m)
    around = Target(ground(length_m, rng, sway_m=place.sway_m), rcs=echo, range_m=place.range_m)
    scene = Scene([around], radar_position_m=(0.0, 0.0, place.height_m), duration_s=OBSERVATION_S)
    recording = _simulate_quietly(scene, GROUND_RADAR, rng)
    sweeps_s = measures.PRI_S * np.arange(measures.N_SWEEPS)
    used = sorted(set(bins))
    smooth = CubicSpline(recording.slow_time_s, recording.baseband.values[:, used])(sweeps_s)
    return measures.stitched(smooth, [used.index(one) for one in bins])


def levels_of(target: ComplexArray, ground: ComplexArray, noise_db: float, number: int) -> FloatArray:
    """Return displayed levels in dB, shape (256, 624).

    Relative to the maximum; the noise is relative to the maximum of the rest.
    """
    signal = target + ground
    noise_v2 = measures.pixel_power(signal).max() / measures.noise_gain() * 10.0 ** (noise_db / 10.0)
    white = np.random.default_rng([99, number]).standard_normal((2, measures.N_SWEEPS)) * np.sqrt(noise_v2 / 2.0)
    noise = measures.stitched((white[0] + 1j * white[1])[:, None], [0] * measures.N_BURSTS)
    return measures.displayed_db(measures.pixel_power(signal + noise))


def inputs_of_levels(images: list[FloatArray], labels: list[str], groups: list[str]) -> store.Inputs:
    """Convert images, real or not, to model inputs. Signature, features by its analysis, image."""
    rows, signatures = [], []
    for image in images:
        mu = xband_gait.displayed_signature(image)
        rows.append(store.row_of(analyze_signature(mu, make_level_gate(mu), xband_gait.ANALYSIS, label=None)))
        signatures.append(mu)
    return store.inputs_of(rows, signatures, PATCH, labels, groups)


def echo_chunk(plan: Plan, numbers: range, out: Path) -> store.Arrays:
    """Load the echoes of some examples, or simulate them."""

    def make() -> store.Arrays:
        found = [echoes_of(plan, number) for number in numbers]
        arrays = {name: np.array([one[name] for one in found]) for name in found[0]}
        return {
            **arrays,
            "mover": arrays["mover"].astype(np.complex64),
            "ground": arrays["ground"].astype(np.complex64),
        }

    name = f"xband-echoes-{store.key_of(plan)}-{numbers.start}-{numbers.stop}.npz"
    return store.kept(out / "cache" / name, make)


def pictures(echo: store.Arrays, numbers: range) -> list[FloatArray]:
    """Return the displayed levels of some echoes."""
    kept = zip(echo["mover"], echo["ground"], echo["noise_db"].tolist(), numbers, strict=True)
    return [levels_of(mover, ground, noise_db, number) for mover, ground, noise_db, number in kept]


def dataset(plan: Plan, count: int, out: Path) -> store.Inputs:
    """Load the model inputs of a plan."""

    def chunk(numbers: range) -> store.Inputs:
        def make() -> store.Inputs:
            echo = echo_chunk(plan, numbers, out)
            return inputs_of_levels(pictures(echo, numbers), echo["label"].tolist(), echo["group"].tolist())

        name = f"xband-inputs-{store.key_of(plan, PATCH)}-{numbers.start}-{numbers.stop}.npz"
        return store.kept_inputs(out / "cache" / name, make)

    return store.joined([chunk(numbers) for numbers in store.chunks(count)])
