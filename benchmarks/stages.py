"""Every stage of scenario S as a call without arguments, and the ratios between them."""

from __future__ import annotations

from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from clock import Timing, Work, combine, measure, ratio, total
from floors import FLOP_PER_TRANSFORM, SGEMM_FLOP, floor_rates, floor_work
from obvious import (
    obvious_noise,
    obvious_signature,
    obvious_synthesis,
    scipy_short_time_fft,
    scipy_spectrogram,
    scipy_spectrogram_by_bin,
)
from scenario import Case, fill_planes, make_radar, new_planes, prepare, scenario

from doppelgait.core.rng import rng
from doppelgait.core.samples import Samples
from doppelgait.dataset import stream_examples
from doppelgait.motion import boulic_walk, human_gait, quadruped_gait, sample_dog, sample_person
from doppelgait.pipeline import analyze, simulate
from doppelgait.pipeline.target import analyze_signature
from doppelgait.processing import Analysis, signature
from doppelgait.radar import Recording, add_noise, synthesise
from doppelgait.scene import assemble

Seconds = dict[str, Timing]

SPECTROGRAM = "SciPy spectrogram, hop 1"
BY_BIN = "SciPy spectrogram bin by bin, hop 1"
SHORT_TIME_FFT = "SciPy ShortTimeFFT, hop 1"
NOISE_V2 = 1e-12
ROOM = "example of a room"
ROOMS_PLAN = Path(__file__).parents[1] / "examples" / "rooms-plan.toml"
N_ROOMS = 6
"""Examples of the plan that a call makes: they differ, so the stage is their mean."""
PERSON, DOG, BOULIC = "motion of a sampled person", "motion of a sampled dog", "motion, Boulic's walk"
N_TARGETS, MOTION_S = 4, 2.5
"""Sampled persons and dogs likewise, and how long they walk: the window of a dataset's example."""


def measure_stages(rounds: int) -> dict[str, Any]:
    """Seconds of all stages, floors and ratios, all of one interleaved run."""
    case = prepare(*scenario())
    full = prepare(make_radar(1), case.scene, case.analysis)
    planes, full_planes = new_planes(case), new_planes(full)
    work = {
        **peer_work(case),
        **synthesis_work(case, full, planes, full_planes),
        **signature_work(case),
        **whole_work(case),
        ROOM: room_work(),
        **motion_work(),
        **floor_work(planes, full_planes),
    }
    seconds = measure(work, rounds)
    for name, count in ((ROOM, N_ROOMS), (PERSON, N_TARGETS), (DOG, N_TARGETS)):
        seconds[name] = combine(lambda s, count=count: s / count, seconds[name])
    n_transforms = sharp_gate(case)[0].size * sharp_gate(case)[1]
    return {
        "seconds": seconds,
        "floors": floor_rates(seconds, planes.nbytes, n_transforms),
        "ratios": stage_ratios(seconds),
        "floor_ratios": floor_ratios(seconds, n_transforms),
        "sizes": {
            "planes": list(planes.shape),
            "planes, full rate": list(full_planes.shape),
            "transforms, hop 1": n_transforms,
        },
    }


def sharp_gate(case: Case) -> tuple[Any, int]:
    """First bin of the gate in every hop-1 column and its number of bins, without fractions at the edges."""
    radar = case.radar
    geometry = {"first_bin_m": radar.range_start_m, "bin_spacing_m": radar.bin_spacing_m}
    return case.gate.whole_bins(case.cut(1).time_s, **geometry)


def peer_work(case: Case) -> dict[str, Work]:
    """Obvious NumPy, and SciPy on a gate of fixed place: the same number of transforms."""
    clean = synthesise(case.table, case.radar).values
    exact = clean.astype(np.complex128)
    (first, n_bins), transform = sharp_gate(case), case.cut(1).transform
    gated = np.ascontiguousarray(clean[:, first[0] : first[0] + n_bins].T)
    window, n_doppler = transform.window, transform.n_doppler_bins
    generator, normals = np.random.default_rng(1), np.empty(2 * clean.size, dtype=np.float32)
    return {
        "obvious: synthesis": lambda: obvious_synthesis(case.table, case.radar, case.amplitude_v),
        "obvious: signature, hop 1": lambda: obvious_signature(exact, first, n_bins, window, n_doppler),
        "obvious: noise": lambda: obvious_noise(clean, NOISE_V2**0.5, generator),
        "NumPy normals alone, float32": lambda: generator.standard_normal(dtype=np.float32, out=normals),
        SPECTROGRAM: lambda: scipy_spectrogram(gated, window, n_doppler),
        BY_BIN: lambda: scipy_spectrogram_by_bin(gated, window, n_doppler),
        SHORT_TIME_FFT: lambda: scipy_short_time_fft(gated, window, n_doppler),
    }


def synthesis_work(case: Case, full: Case, planes: Any, full_planes: Any) -> dict[str, Work]:
    """From motion to the noisy data matrix; the planes are memory that exists."""
    clean = synthesise(case.table, case.radar)
    return {
        "motion -> scatterers": lambda: assemble(case.scene, case.slow_time_s),
        "motion -> scatterers, no angles": lambda: assemble(case.scene, case.slow_time_s, angles=False),
        "synthesis, data matrix": lambda: synthesise(case.table, case.radar),
        "synthesis, planes": lambda: fill_planes(case, planes),
        "synthesis, data matrix, full rate": lambda: synthesise(full.table, full.radar),
        "synthesis, planes, full rate": lambda: fill_planes(full, full_planes),
        "noise, whole matrix": lambda: add_noise(clean, noise_power_v2=NOISE_V2, rng=np.random.default_rng(1)),
    }


def signature_work(case: Case) -> dict[str, Work]:
    """Signature from the data matrix and from planes, and the features of a signature that exists."""
    noisy = add_noise(synthesise(case.table, case.radar), noise_power_v2=NOISE_V2, rng=np.random.default_rng(1))
    parts = np.ascontiguousarray(np.stack([noisy.values.real.T, noisy.values.imag.T]))
    planes = Samples.from_planes(parts, case.slow_time_s.size)
    work: dict[str, Work] = {}
    for name, hop in (("hop 1", 1), ("lossless hop", None)):
        settings, cut = case.analysis.model_copy(update={"hop": hop}), case.cut(hop)
        wavelength_m = case.radar.wavelength_m
        of_matrix = partial(signature, noisy, case.gate, settings, wavelength_m=wavelength_m)
        work |= {
            f"signature, {name}": of_matrix,
            f"signature of planes, {name}": partial(cut.sum_power, planes),
            f"features, {name}": partial(analyze_signature, of_matrix(), case.gate, settings, label=None),
        }
    return work


def whole_work(case: Case) -> dict[str, Work]:
    """Whole examples: simulated with noise and features, and the analysis of a recording."""
    recording = Recording.from_baseband(synthesise(case.table, case.radar), case.radar)
    work: dict[str, Work] = {}
    for name, hop in (("hop 1", 1), ("lossless hop", None)):
        settings = case.analysis.model_copy(update={"hop": hop})
        work |= {
            f"example, {name}": partial(run_example, case, settings),
            f"analysis with features, {name}": partial(analyze, recording, gate=case.gate, analysis=settings),
        }
    return work


def run_example(case: Case, analysis: Analysis) -> None:
    """One example with noise and features."""
    analyze(simulate(case.scene, case.radar, rng=rng(1), angles=False), gate="truth", analysis=analysis)


def room_work() -> Work:
    """Examples with clutter, walls and reflections, as a dataset holds them."""
    examples = stream_examples(ROOMS_PLAN)
    return lambda: list(islice(examples, N_ROOMS))


def motion_work() -> dict[str, Work]:
    """Motions with everything that is sampled of a person and of a dog, and the plain walk beside them."""
    people = [sample_person(np.random.default_rng(seed)).parameters() for seed in range(N_TARGETS)]
    dogs = [sample_dog(np.random.default_rng(seed)).parameters() for seed in range(N_TARGETS)]
    return {
        PERSON: lambda: [human_gait(duration_s=MOTION_S, rng=rng(1), **person) for person in people],
        DOG: lambda: [quadruped_gait(duration_s=MOTION_S, rng=rng(1), **dog) for dog in dogs],
        BOULIC: lambda: boulic_walk(duration_s=MOTION_S),
    }


def stage_ratios(seconds: Seconds) -> dict[str, Timing]:
    """Compute the speed relative to the obvious NumPy or the named peer."""
    whole = total(seconds["obvious: synthesis"], seconds["obvious: signature, hop 1"])
    matrix, planes = seconds["synthesis, data matrix"], seconds["synthesis, planes"]
    hop_1, of_planes = seconds["signature, hop 1"], seconds["signature of planes, hop 1"]
    rows = {
        "synthesis, data matrix": ratio(seconds["obvious: synthesis"], matrix),
        "synthesis, planes": ratio(seconds["obvious: synthesis"], planes),
        "signature, hop 1": ratio(seconds["obvious: signature, hop 1"], hop_1),
        "signature of planes, hop 1": ratio(seconds["obvious: signature, hop 1"], of_planes),
        "synthesis + signature, hop 1": ratio(whole, matrix, hop_1),
        "synthesis + signature, hop 1, planes": ratio(whole, planes, of_planes),
        "synthesis + signature, lossless hop": ratio(whole, matrix, seconds["signature, lossless hop"]),
        "synthesis + signature, lossless hop, planes": ratio(
            whole, planes, seconds["signature of planes, lossless hop"]
        ),
        "example with noise and features, hop 1": ratio(whole, seconds["example, hop 1"]),
        "example with noise and features, lossless hop": ratio(whole, seconds["example, lossless hop"]),
    }
    for peer in (SPECTROGRAM, BY_BIN, SHORT_TIME_FFT):
        rows[f"signature / {peer}"] = ratio(seconds[peer], hop_1)
        rows[f"signature of planes / {peer}"] = ratio(seconds[peer], of_planes)
    rows |= {f"{name} / {BOULIC}": ratio(seconds[BOULIC], seconds[name]) for name in (PERSON, DOG)}
    for peer in ("obvious: noise", "NumPy normals alone, float32"):
        rows[f"noise, whole matrix / {peer}"] = ratio(seconds[peer], seconds["noise, whole matrix"])
    return rows


def floor_ratios(seconds: Seconds, n_transforms: int) -> dict[str, Timing]:
    """Compute the time relative to the floor."""
    full = seconds["floor: write planes, full rate"]
    flop_floor = combine(lambda s: n_transforms * FLOP_PER_TRANSFORM / SGEMM_FLOP * s, seconds["floor: sgemm 1024"])
    return {
        "synthesis, planes / write floor": ratio(seconds["synthesis, planes"], seconds["floor: write planes"]),
        "synthesis, data matrix / write floor": ratio(
            seconds["synthesis, data matrix"], seconds["floor: write planes"]
        ),
        "synthesis, planes, full rate / write floor": ratio(seconds["synthesis, planes, full rate"], full),
        "synthesis, data matrix, full rate / write floor": ratio(seconds["synthesis, data matrix, full rate"], full),
        "signature, hop 1 / flop floor": ratio(seconds["signature, hop 1"], flop_floor),
        "signature of planes, hop 1 / flop floor": ratio(seconds["signature of planes, hop 1"], flop_floor),
    }
