"""Speed of every stage of one scenario against the obvious NumPy of the equations, in one interleaved run.

Scenario S: 41 scatterers of a walking person, 5 s at 1000 Hz, X4 decimated to 187 bins, M = 101, K = 128, gate 1.0 m.
"Obvious NumPy": float64, one scatterer at a time, a loop over frames that transforms the gated bins, the same K.

    python benchmarks/chain.py [--rounds 5] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from doppelgait.core.rng import rng
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.motion.models import boulic_walk
from doppelgait.motion.schema import make_motion
from doppelgait.pipeline import analyze
from doppelgait.pipeline.fused import run_fused
from doppelgait.processing import Analysis, gate_bins, make_gate, plan_transform, signature
from doppelgait.radar import Radar, Recording, add_noise, synthesise
from doppelgait.scene import Scene, Target, assemble, body_track

N_SCATTERERS = 41
DURATION_S = 5.0


def scenario() -> tuple[Radar, Scene, Analysis]:
    """Radar, scene and analysis of scenario S: points between the walker's own make up 41 scatterers."""
    radar = Radar.preset("x4", range_stop_m=9.6)
    walk = boulic_walk(speed_mps=1.2, height_m=1.75, duration_s=DURATION_S)
    pairs = [(a, b) for a in range(17) for b in range(a + 1, 17)][: N_SCATTERERS - 17]
    between = np.stack([(walk.values[:, a] + walk.values[:, b]) / 2 for a, b in pairs], axis=1)
    dense = make_motion(
        np.concatenate([walk.values, between], axis=1),
        rate_hz=walk.attrs["rate_hz"],
        markers=[f"m{n}" for n in range(N_SCATTERERS)],
        parts=[""] * N_SCATTERERS,
        facts={"mass_kg": 70.0},
    )
    scene = Scene([Target(dense, label="human")], duration_s=DURATION_S)
    return radar, scene, Analysis(doppler_bins=128, hop=1, gate_span_m=1.0)


def obvious_synthesis(table: xr.Dataset, radar: Radar, amplitude_v: Any) -> Any:
    """E-18, one scatterer at a time."""
    axis = radar.range_axis_m()
    sigma_m = SPEED_OF_LIGHT_MPS * radar.sigma_s / 2
    out = np.zeros((table.sizes["slow_time"], axis.size), dtype=np.complex128)
    for scatterer in range(table.sizes["scatterer"]):
        range_m = table["range"].values[:, scatterer]
        pulse = np.exp(-0.5 * ((axis[None, :] - range_m[:, None]) / sigma_m) ** 2)
        phase = np.exp(-4j * np.pi * range_m / radar.wavelength_m)
        out += (amplitude_v[:, scatterer] * phase)[:, None] * pulse
    return out


def obvious_signature(baseband: Any, first_bin: Any, n_bins: int, window: Any, n_doppler: int) -> Any:
    """E-24 and E-27, a loop over columns."""
    out = np.empty((first_bin.size, n_doppler))
    for j in range(first_bin.size):
        gated = baseband[j : j + window.size, first_bin[j] : first_bin[j] + n_bins]
        spectrum = np.fft.fft(gated * window[:, None], n_doppler, axis=0)
        out[j] = np.fft.fftshift((np.abs(spectrum) ** 2).sum(axis=1))
    return out


def obvious_spectrogram(baseband: Any, first_bin: Any, n_bins: int, window: Any) -> Any:
    """The same number of transforms by SciPy's spectrogram: a gate of fixed place, summed over bins."""
    from scipy.signal import spectrogram

    gated = np.ascontiguousarray(baseband[:, first_bin[0] : first_bin[0] + n_bins].T)
    power = spectrogram(
        gated, window=window.astype(np.float32), nperseg=window.size, noverlap=window.size - 1, nfft=128,
        detrend=False, return_onesided=False, mode="psd",
    )[2]  # fmt: skip
    return power.sum(axis=0)


def measure(stages: dict[str, Callable[[], Any]], rounds: int) -> dict[str, float]:
    """Median seconds of every stage over interleaved rounds, after one warm-up."""
    seconds: dict[str, list[float]] = {name: [] for name in stages}
    for number in range(rounds + 1):
        for name, work in stages.items():
            began = time.perf_counter()
            work()
            if number:
                seconds[name].append(time.perf_counter() - began)
    return {name: statistics.median(values) for name, values in seconds.items()}


def make_stages() -> dict[str, Callable[[], Any]]:
    """Every stage as a call without arguments, on data prepared here."""
    from doppelgait.radar.simulate import scatterer_arrays

    radar, scene, analysis = scenario()
    times = np.arange(int(DURATION_S * radar.prf_hz)) / radar.prf_hz
    table = assemble(scene, times)
    amplitude_v = scatterer_arrays(table, radar)[1]
    clean = synthesise(table, radar)
    exact = clean.values.astype(np.complex128)
    track_m = body_track(scene.targets[0], scene, times).range_m
    gate = make_gate(times, track_m, span_m=analysis.gate_span_m, source="given")
    transform = plan_transform(analysis, n_pulses=times.size, prf_hz=radar.prf_hz)
    centres = transform.centre_pulses()
    first, n_bins = gate_bins(gate, times[centres], first_bin_m=radar.range_start_m, bin_spacing_m=radar.bin_spacing_m)
    recording = Recording(clean, radar)
    lossless = analysis.model_copy(update={"hop": None})
    return {
        "obvious: synthesis": lambda: obvious_synthesis(table, radar, amplitude_v),
        "obvious: signature, hop 1": lambda: obvious_signature(exact, first, n_bins, transform.window, 128),
        "motion -> scatterers": lambda: assemble(scene, times),
        "synthesis": lambda: synthesise(table, radar),
        "noise": lambda: add_noise(clean, noise_power_v2=1e-12, rng=rng(1)),
        "signature, hop 1": lambda: signature(clean, gate, analysis, wavelength_m=radar.wavelength_m),
        "signature, lossless hop": lambda: signature(clean, gate, lossless, wavelength_m=radar.wavelength_m),
        "scipy spectrogram of the gate, hop 1": lambda: obvious_spectrogram(
            clean.values, first, n_bins, transform.window
        ),
        "fused example, hop 1": lambda: run_fused(scene, radar, analysis, rng=rng(1)),
        "fused example, lossless hop": lambda: run_fused(scene, radar, lossless, rng=rng(1)),
        "analysis with features, hop 1": lambda: analyze(recording, gate=gate, analysis=analysis),
        "analysis with features, lossless hop": lambda: analyze(recording, gate=gate, analysis=lossless),
    }


MEMORY_PROGRAMS = {
    "imports alone": "import doppelgait.pipeline, doppelgait.motion.models, numba, scipy.fft, scipy.interpolate",
    "one scenario, simulated and analysed": (
        "import doppelgait as dg; from doppelgait.processing import Analysis; "
        "walk = dg.motion.boulic_walk(duration_s=5.0); scene = dg.Scene([dg.Target(walk, label='human')]); "
        "recording = dg.simulate(scene, dg.Radar.preset('x4'), rng=dg.rng(1)); "
        "dg.analyze(recording, gate='truth', analysis=Analysis(hop=1))"
    ),
}
"""Programs whose peak memory is measured, each in a process of its own."""


def fresh_process_mb(program: str) -> float:
    """Peak resident memory of a program in a fresh process, MB (Linux)."""
    report = f"{program}; print([l for l in open('/proc/self/status') if l.startswith('VmHWM')][0].split()[1])"
    done = subprocess.run([sys.executable, "-c", report], capture_output=True, text=True, check=True)
    return float(done.stdout) / 1024


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", help="also write the figures to this file")
    arguments = parser.parse_args()
    seconds = measure(make_stages(), arguments.rounds)
    print(f"{'stage':40s} {'median ms':>10s}")
    for name, value in seconds.items():
        print(f"{name:40s} {1e3 * value:10.2f}")
    obvious = seconds["obvious: synthesis"] + seconds["obvious: signature, hop 1"]
    ratios = {
        "synthesis": seconds["obvious: synthesis"] / seconds["synthesis"],
        "signature, hop 1": seconds["obvious: signature, hop 1"] / seconds["signature, hop 1"],
        "signature, hop 1, against SciPy": seconds["scipy spectrogram of the gate, hop 1"]
        / seconds["signature, hop 1"],
        "synthesis + signature, hop 1": obvious / (seconds["synthesis"] + seconds["signature, hop 1"]),
        "synthesis + signature, lossless hop": obvious / (seconds["synthesis"] + seconds["signature, lossless hop"]),
    }
    print()
    for name, ratio in ratios.items():
        print(f"{name:40s} {ratio:9.1f}x")
    memory_mb = {name: fresh_process_mb(work) for name, work in MEMORY_PROGRAMS.items()}
    for name in ("fused example, hop 1", "fused example, lossless hop"):
        print(f"{name + ', one process':40s} {1 / seconds[name]:9.0f} per second")
    for name, megabytes in memory_mb.items():
        print(f"{'peak memory, ' + name:40s} {megabytes:9.0f} MB")
    if arguments.json:
        document = {
            "machine": platform.machine(),
            "seconds": seconds,
            "ratios": ratios,
            "peak_mb": memory_mb,
        }
        with open(arguments.json, "w") as handle:
            json.dump(document, handle, indent=2)


if __name__ == "__main__":
    main()
