"""Detection without truth: boxes, misses, false detections, weakest body.

    python studies/detection.py [--quick] [--method noise_map os_cfar ca_cfar]

People and dogs walk, trot, gallop and turn round before an X4 (1 kHz). Static clutter 20 dB above their mean echo is
added and taken off again by the detector. SNR_mu is the median over time of the strongest Doppler cell of the
noise-free signature (gate of 1 m about the body) over the mean noise of a cell of it. The true box of a scan holds
every scatterer of the body during its processing interval. Prints tables in markdown.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.rng import rng
from doppelgait.motion.models import quadruped_gait
from doppelgait.motion.models.human import human_gait
from doppelgait.pipeline import simulate
from doppelgait.pipeline.conditions import Conditions
from doppelgait.processing import Analysis, Gate, signature
from doppelgait.processing.detect import Detector, find_scans
from doppelgait.processing.detect.config import Threshold
from doppelgait.processing.detections import Detection, Scan
from doppelgait.radar import Radar, add_noise
from doppelgait.radar.recording import Recording
from doppelgait.scene import Scene, Target

FloatArray = npt.NDArray[np.float64]

RADAR = Radar.preset("x4")
SEED = 6
OBSERVATION_S = 5.0
CLUTTER_OVER_ECHO_DB = 20.0
NEAR_M = 0.8
"""A detection farther than this from the true box in range is no detection of the body."""
LEVELS_DB = (30.0, 20.0, 10.0)
SWEEP_DB = tuple(np.arange(14.0, -3.0, -1.0))


@dataclass(frozen=True)
class Observation:
    """One noise-free recording.

    Parameters
    ----------
    label : str
        Kind of target in the tables.
    recording : Recording
        Noise-free, without clutter.
    signature_v2 : float
        Median over time of the strongest cell of its signature.
    cell_noise : float
        Noise of a cell of it over the variance of the noise.
    """

    label: str
    recording: Recording
    signature_v2: float
    cell_noise: float

    def noise_v2(self, snr_mu_db: float) -> float:
        """Return the noise variance for an SNR_mu of the target."""
        return self.signature_v2 / self.cell_noise / float(10.0 ** (snr_mu_db / 10.0))


def observe_all(*, quick: bool) -> Iterator[Observation]:
    """Make targets: people and dogs, head-on, at 45 degrees, turning round."""
    for aspect_deg in (0.0,) if quick else (0.0, 45.0):
        for speed_mps in (1.2,) if quick else (0.8, 1.2, 1.6):
            motion = human_gait(gait="walk", speed_mps=speed_mps, duration_s=OBSERVATION_S)
            yield observe("person walks", Target(motion, aspect_deg=aspect_deg, range_m=6.0))
        for gait, froude in (("trot", 0.7),) if quick else (("walk", 0.2), ("trot", 0.7), ("canter", 1.6)):
            motion = quadruped_gait(gait=gait, froude=froude, withers_m=0.5, duration_s=OBSERVATION_S)
            yield observe(f"dog {gait}s", Target(motion, aspect_deg=aspect_deg, range_m=6.0))
    for speed_mps in (1.2,) if quick else (0.8, 1.2, 1.6):
        motion = human_gait(gait="walk", speed_mps=speed_mps, duration_s=OBSERVATION_S)
        path = {"kind": "turn_around", "out_m": 1.2 * speed_mps, "radius_m": 0.4}
        yield observe("person turns", Target(motion, path=path, start_position_m=(6.0, 0.5), heading_deg=180.0))


def observe(label: str, target: Target) -> Observation:
    """Simulate one target without noise; return the level of its signature."""
    recording = simulate(Scene([target], duration_s=OBSERVATION_S), RADAR, angles=False)
    gate = Gate.around(recording.slow_time_s, recording.truth[0].centre_range_m, span_m=1.0, source="truth")
    mu = signature(recording.baseband, gate, Analysis(), wavelength_m=RADAR.wavelength_m)
    n_bins = float(mu.attrs["n_gate_bins"]) / recording.independent_bin_share  # the attribute counts independent bins
    cell_noise = float(mu.attrs["window_energy"]) * n_bins
    return Observation(label, recording, float(np.median(mu.values.max(axis=1))), cell_noise)


def spoilt(observation: Observation, snr_mu_db: float, generator: np.random.Generator) -> xr.DataArray:
    """Add noise of a level and static clutter to a baseband."""
    noisy = add_noise(observation.recording.baseband, noise_power_v2=observation.noise_v2(snr_mu_db), rng=generator)
    values = observation.recording.baseband.values
    echo_v2 = float((np.abs(values) ** 2).max(axis=1).mean()) * 10.0 ** (CLUTTER_OVER_ECHO_DB / 10.0)
    real, imaginary = generator.standard_normal((2, values.shape[1])) * np.sqrt(echo_v2 / 2.0)
    return noisy.copy(data=(noisy.values + real + 1j * imaginary).astype(np.complex64))


def true_boxes(recording: Recording, times_s: FloatArray, cpi_s: float) -> tuple[FloatArray, FloatArray]:
    """Return range and velocity limits per processing interval, (J, 2) each.

    Of all scatterers.
    """
    pulses = recording.slow_time_s
    table = recording.truth[0].scatterers
    first = np.searchsorted(pulses, times_s - cpi_s / 2.0)
    stop = np.searchsorted(pulses, times_s + cpi_s / 2.0)
    boxes = [
        [(part.min(), part.max()) for part in (table[name].values[i:j] for i, j in zip(first, stop, strict=True))]
        for name in ("range", "radial_velocity")
    ]
    return np.array(boxes[0]), np.array(boxes[1])


def overlap(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Return the lengths of intersection and union of two intervals."""
    common = max(0.0, min(one[1], other[1]) - max(one[0], other[0]))
    return common, (one[1] - one[0]) + (other[1] - other[0]) - common


@dataclass(frozen=True)
class Score:
    """One scan: IoU in range, Doppler and both, errors, further detections."""

    iou: tuple[float, float, float]
    range_error_m: float
    velocity_error_mps: float
    range_sd_m: float
    velocity_sd_mps: float
    found: bool
    extra: int


NOTHING = Score((np.nan,) * 3, np.nan, np.nan, np.nan, np.nan, found=False, extra=0)


def score_scans(observation: Observation, scans: list[Scan]) -> list[Score]:
    """Compare the scans of a recording with the truth.

    Scans in which the body is wholly in the frame.
    """
    times_s = np.array([scan.time_s for scan in scans])
    ranges_m, velocities_mps = true_boxes(observation.recording, times_s, 0.1)
    pulses, truth = observation.recording.slow_time_s, observation.recording.truth[0]
    centre_m = np.interp(times_s, pulses, truth.centre_range_m)
    centre_mps = np.interp(times_s, pulses, truth.centre_velocity_mps)
    frame_m = observation.recording.range_m[[0, -1]]
    return [
        score_scan(scan, ranges_m[n], velocities_mps[n], centre_m[n], centre_mps[n])
        for n, scan in enumerate(scans)
        if frame_m[0] <= ranges_m[n, 0] and ranges_m[n, 1] <= frame_m[1]
    ]


def score_scan(scan: Scan, range_m: FloatArray, velocity_mps: FloatArray, centre_m: float, centre_mps: float) -> Score:
    """Compare the strongest detection near the body with its true box."""
    near = [d for d in scan.detections if d.range_low_m < range_m[1] + NEAR_M and d.range_high_m > range_m[0] - NEAR_M]
    if not near:
        return replace(NOTHING, extra=len(scan.detections))
    best = max(near, key=lambda d: d.power_v2)
    return Score(
        iou=box_iou(best, tuple(range_m), tuple(velocity_mps)),
        range_error_m=best.range_m - centre_m,
        velocity_error_mps=best.velocity_mps - centre_mps,
        range_sd_m=best.range_sd_m,
        velocity_sd_mps=best.velocity_sd_mps,
        found=True,
        extra=len(scan.detections) - 1,
    )


def box_iou(
    detection: Detection, range_m: tuple[float, ...], velocity_mps: tuple[float, ...]
) -> tuple[float, float, float]:
    """Return the IoU in range, in Doppler and of the boxes."""
    along_range = overlap((detection.range_low_m, detection.range_high_m), (range_m[0], range_m[1]))
    along_doppler = overlap(
        (detection.velocity_low_mps, detection.velocity_high_mps), (velocity_mps[0], velocity_mps[1])
    )
    common = along_range[0] * along_doppler[0]
    areas = (detection.range_high_m - detection.range_low_m) * (
        detection.velocity_high_mps - detection.velocity_low_mps
    ) + (range_m[1] - range_m[0]) * (velocity_mps[1] - velocity_mps[0])
    return along_range[0] / along_range[1], along_doppler[0] / along_doppler[1], common / (areas - common)


def summary(scores: list[Score]) -> str:
    """Return the cells of a row of the table of boxes."""
    iou = np.nanmean([s.iou for s in scores], axis=0) if any(s.found for s in scores) else np.full(3, np.nan)
    range_m = np.array([s.range_error_m for s in scores if s.found])
    speed_mps = np.array([s.velocity_error_mps for s in scores if s.found])
    nees = np.mean([((s.range_error_m - range_m.mean()) / s.range_sd_m) ** 2 for s in scores if s.found])
    nees_v = np.mean([(s.velocity_error_mps / s.velocity_sd_mps) ** 2 for s in scores if s.found])
    return (
        f"{iou[0]:.2f} / {iou[1]:.2f} / {iou[2]:.2f} | {100 * np.mean([not s.found for s in scores]):.1f} | "
        f"{np.mean([s.extra for s in scores]):.3f} | {spread(range_m, 3)} | {spread(speed_mps, 2)} | {nees:.2f} | "
        f"{nees_v:.2f} | {len(scores)}"
    )


def spread(values: FloatArray, digits: int) -> str:
    """Format mean and standard deviation."""
    return f"{values.mean():.{digits}f} +- {values.std():.{digits}f}" if values.size else "-"


def print_boxes(observations: list[Observation], methods: list[Threshold]) -> None:
    """Tabulate IoU, misses, further detections and errors.

    By method, kind and level.
    """
    print("| method | target | SNR_mu dB | IoU range / Doppler / both | misses % | extra per scan |", end="")
    print(" range error m | velocity error m/s | range NEES (bias taken off) | velocity NEES | scans |")
    print("|---" * 11 + "|")
    for method in methods:
        for label in sorted({m.label for m in observations}):
            for level_db in LEVELS_DB:
                scores = [
                    score
                    for n, observation in enumerate(observations)
                    if observation.label == label
                    for score in score_scans(
                        observation, found_in(spoilt(observation, level_db, np.random.default_rng(SEED + n)), method)
                    )
                ]
                print(f"| {method} | {label} | {level_db:.0f} | {summary(scores)} |")


def found_in(baseband: xr.DataArray, method: Threshold) -> list[Scan]:
    """Detect with the default detector and a method."""
    return find_scans(baseband, Detector(method=method), wavelength_m=RADAR.wavelength_m)


def print_weakest(observations: list[Observation], methods: list[Threshold]) -> None:
    """Return the SNR_mu above which 90 % of scans detect the target."""
    print("\n| method | target | lowest SNR_mu dB for 90 % of scans | SNR_frame dB there |")
    print("|---" * 4 + "|")
    for method in methods:
        for label in sorted({m.label for m in observations}):
            chosen = [m for m in observations if m.label == label]
            lowest = float("nan")
            for level_db in SWEEP_DB:
                scores = [
                    s for n, m in enumerate(chosen)
                    for s in score_scans(m, found_in(spoilt(m, level_db, np.random.default_rng(SEED + n)), method))
                ]  # fmt: skip
                if np.mean([s.found for s in scores]) < 0.9:
                    break
                lowest = level_db
            print(f"| {method} | {label} | {lowest:.0f} | {frame_level_db(chosen, lowest):.1f} |")


def frame_level_db(chosen: list[Observation], snr_mu_db: float) -> float:
    """Return the median SNR_frame of targets at an SNR_mu."""
    levels = [
        10.0 * np.log10((np.abs(m.recording.baseband.values) ** 2).max(axis=1).mean() / m.noise_v2(snr_mu_db))
        for m in chosen
    ]
    return float(np.median(levels))


LEAKAGE = {"kind": "leakage"}
CLUTTER = {"kind": "static_clutter", "rcs_per_metre_m2": 0.1}
PHASE = {"kind": "phase_noise", "white_rad": 0.004}
DRIFT = {"kind": "phase_noise", "white_rad": 0.004, "drift_rad_per_min": 1.0, "walk_rad_per_sqrt_min": 0.5}
JITTER = {"kind": "frame_jitter", "sd_s": 1e-5}
DROPPED = {"kind": "dropped_frames", "probability": 0.001}
CONDITIONS: dict[str, list[dict[str, object]]] = {
    "noise": [],
    "noise and static clutter": [CLUTTER],
    "leakage and clutter with phase noise of 4 mrad": [LEAKAGE, CLUTTER, PHASE],
    "the same, phase drift 1 rad/min and random walk 0.5 rad in a minute": [LEAKAGE, CLUTTER, DRIFT],
    "the same as the third, frame jitter of 10 us and 0.1 % of the frames dropped": [
        LEAKAGE, CLUTTER, PHASE, JITTER, DROPPED,
    ],
}  # fmt: skip
"""Rooms without a body; thermal noise of the X4 in all of them."""


def empty_room(impairments: list[dict[str, object]], seconds: float, seed: int) -> Recording:
    """Simulate an empty scene.

    A body behind the frame has no echo in the bins of the radar.
    """
    away = human_gait(gait="walk", speed_mps=0.8, duration_s=seconds)
    scene = Scene([Target(away, range_m=400.0)], duration_s=seconds)
    return simulate(scene, RADAR, rng=rng(seed), conditions=Conditions(impairments=impairments), angles=False)


def print_false(methods: list[Threshold], seconds: float) -> None:
    """Count false detections per minute, and repeated ones.

    Repeated: within 0.3 m of one in the scan before.
    """
    print("\n| method | room without a body | detections per minute | in the same place as in the scan before |")
    print("|---" * 4 + "|")
    for name, impairments in CONDITIONS.items():
        baseband = empty_room(impairments, seconds, SEED).baseband
        for method in methods:
            scans = found_in(baseband, method)
            count = sum(len(scan.detections) for scan in scans)
            again = sum(
                any(abs(d.range_m - e.range_m) < 0.3 for e in before.detections)
                for before, scan in pairwise(scans)
                for d in scan.detections
            )
            print(f"| {method} | {name} | {60 * count / seconds:.1f} | {60 * again / seconds:.1f} |")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="three targets, 10 s of empty rooms")
    parser.add_argument("--method", nargs="+", default=["noise_map", "os_cfar", "ca_cfar"])
    arguments = parser.parse_args()
    observations = list(observe_all(quick=arguments.quick))
    print_boxes(observations, arguments.method)
    print_weakest(observations, arguments.method)
    print_false(arguments.method, 10.0 if arguments.quick else 60.0)


if __name__ == "__main__":
    main()
