"""One example without its data matrix: only the range bins that the gates need, in reused buffers.

Gives the same bytes as :func:`doppelgait.pipeline.simulate` followed by :func:`doppelgait.pipeline.analyze` with the
truth gate, in a fraction of the time. Datasets that do not keep the baseband are built this way; an
example with impairments, an environment or another waveform takes the steps one by one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from threading import local

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.rng import Streams
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.pipeline.analyze import Result, analyze, analyze_signature, flag_overlaps
from doppelgait.pipeline.echoes import Conditions, Noise, received
from doppelgait.pipeline.simulate import pulse_times_s, simulate, target_truth
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.signature import cut_out, signature_of_planes
from doppelgait.radar.parameters import Radar
from doppelgait.radar.recording import TargetTruth
from doppelgait.radar.simulate import noise_level_v2, scatterer_arrays, snr_frame_db, warn_of_limits
from doppelgait.scene import Scene

Float32Array = npt.NDArray[np.float32]

LANES = 32
"""Planes are a multiple of this many pulses long, as the synthesis kernel writes them."""

_buffers = local()


@dataclass(frozen=True)
class FusedExample:
    """Results and truth of one example whose data matrix was never made.

    Parameters
    ----------
    results : sequence of Result
        One per target.
    truth : sequence of TargetTruth
    n_pulses : int
    noise_power_v2, snr_frame_db : float
        As in :class:`doppelgait.radar.Recording`.
    """

    results: Sequence[Result]
    truth: Sequence[TargetTruth]
    n_pulses: int
    noise_power_v2: float
    snr_frame_db: float


def can_fuse(scene: Scene, radar: Radar, analysis: Analysis, conditions: Conditions) -> bool:
    """Whether the fused path makes this example: plain echoes of targets, whose samples are range bins, as they are."""
    background = len(scene.observed_targets) < len(scene.targets)
    plain = radar.waveform.kind == "impulse" and analysis.clutter == "none"
    return plain and not (conditions.environment or conditions.impairments or background)


def run_steps(
    scene: Scene, radar: Radar, analysis: Analysis, *, gate_error_m: float, rng: Streams, conditions: Conditions
) -> FusedExample:
    """Simulate a scene and analyse every target in its truth gate, one step after the other.

    Parameters as for :func:`doppelgait.pipeline.simulate`.
    """
    recording = simulate(scene, radar, rng=rng, conditions=conditions, angles=False)
    results = analyze(recording, gate="truth", analysis=analysis, gate_error_m=gate_error_m)
    n_pulses = recording.n_pulses
    return FusedExample(results, recording.truth, n_pulses, recording.noise_power_v2, recording.snr_frame_db)


def run_fused(
    scene: Scene,
    radar: Radar,
    analysis: Analysis,
    *,
    rng: Streams | None = None,
    noise: Noise | None = None,
    snr_db: float | None = None,
    gate_error_m: float = 0.0,
) -> FusedExample:
    """Simulate a scene and analyse every target in its truth gate.

    Parameters and errors as for :func:`doppelgait.pipeline.simulate` and :func:`doppelgait.pipeline.analyze`.
    """
    if snr_db is None and noise is not None and noise.kind == "snr":
        snr_db = noise.snr_db
    noiseless = rng is None or (snr_db is None and noise is not None and noise.kind == "none")
    slow_time_s = pulse_times_s(scene, radar, rng=rng, snr_db=snr_db)
    scatterers, tracks = received(scene, radar, slow_time_s, Conditions(), angles=False, streams=rng)
    warn_of_limits(scatterers, radar)
    plane_re, plane_im = _planes(radar.n_range_bins, slow_time_s.size)
    signal_v2 = _synthesise(scatterers, radar, plane_re, plane_im)
    noise_v2 = 0.0 if noiseless else noise_level_v2(radar, signal_v2, snr_db)
    truth = [target_truth(scene, number, scatterers, track) for number, track in enumerate(tracks)]
    gates = [
        Gate.from_truth(t, slow_time_s, analysis, wavelength_m=radar.wavelength_m, error_m=gate_error_m) for t in truth
    ]
    range_m = radar.range_axis_m()
    cuts = [cut_out(gate, slow_time_s, range_m, analysis) for gate in gates]
    if rng is not None and noise_v2 > 0:
        _add_noise(plane_re, plane_im, [cut.needed_pulses() for cut in cuts], rng.generator("noise"), noise_v2=noise_v2)
    results = []
    for cut, target in zip(cuts, truth, strict=True):
        mu = signature_of_planes(plane_re, plane_im, 0, cut, wavelength_m=radar.wavelength_m)
        results.append(analyze_signature(mu, cut.gate, analysis, label=target.label or None))
    return FusedExample(flag_overlaps(results), truth, slow_time_s.size, noise_v2, snr_frame_db(signal_v2, noise_v2))


def _planes(n_bins: int, n_pulses: int) -> tuple[Float32Array, Float32Array]:
    """Two planes of at least this size, the same memory for the next example of this thread."""
    shape = (2, n_bins, -(-n_pulses // LANES) * LANES)
    if getattr(_buffers, "planes", np.empty(0)).shape != shape:
        _buffers.planes = np.empty(shape, dtype=np.float32)
    return _buffers.planes[0], _buffers.planes[1]


def _synthesise(scatterers: xr.Dataset, radar: Radar, plane_re: Float32Array, plane_im: Float32Array) -> float:
    """Write all echoes into the planes; returns the signal level of SNR_frame, V^2."""
    from doppelgait.core.kernels.planes import strongest_power
    from doppelgait.core.kernels.synthesis import echo_planes

    range_m, amplitude_v = scatterer_arrays(scatterers, radar)
    lowest, highest = echo_planes(
        range_m, amplitude_v, radar.range_start_m, radar.bin_spacing_m, radar.sigma_s * SPEED_OF_LIGHT_MPS / 2.0,
        radar.wavelength_m, radar.transmit_phase_rad, 0, 0, plane_re, plane_im,
    )  # fmt: skip
    strongest = np.empty(range_m.shape[0], dtype=np.float32)
    strongest_power(plane_re[lowest:highest], plane_im[lowest:highest], strongest)
    return float(strongest.mean(dtype=np.float64))


def _add_noise(
    plane_re: Float32Array,
    plane_im: Float32Array,
    spans: list[npt.NDArray[np.int64]],
    rng: np.random.Generator,
    *,
    noise_v2: float,
) -> None:
    """Add receiver noise to the pulses of every range bin that some gate needs, once."""
    from doppelgait.core.kernels.noise import copy_noise_spans, draw_key

    needed = np.stack([np.min([s[:, 0] for s in spans], axis=0), np.max([s[:, 1] for s in spans], axis=0)], axis=1)
    copy_noise_spans(plane_re, plane_im, needed, 0, draw_key(rng), math.sqrt(noise_v2), plane_re, plane_im)
