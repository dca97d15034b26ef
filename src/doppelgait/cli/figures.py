"""Figures of a recording and its results for commands."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from matplotlib.figure import Figure

from doppelgait import viz
from doppelgait.cli.output import make_folder, print_message
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.pipeline import Result
from doppelgait.processing import Analysis, range_doppler
from doppelgait.processing.clutter import clean_frames
from doppelgait.radar import Recording


def save_figures(*analysed: Any, folder: Path, form: str = "png", only: str = "", **look: Any) -> Iterator[Path]:
    """Write the figures with a text in their names into a folder."""
    figures = dict(make_figures(*analysed))
    if not (chosen := [name for name in figures if only in name]):
        raise ConfigError(f"--only {only}: no figure has this in its name; there are {', '.join(figures)}")
    make_folder(folder)
    for name in chosen:
        yield viz.save_figure(figures[name], folder / f"{name}.{form}", **look)


def make_figures(
    recording: Recording,
    results: Sequence[Result],
    analysis: Analysis,
    look: Mapping[str, Any] = MappingProxyType({}),
    doppler_hz: Any = None,
) -> Iterator[tuple[str, Figure]]:
    """Plot every figure; the look is that of maps, the limits are those of signatures."""
    recording = recording.with_frames(clean_frames(recording.frames, analysis))
    names = [
        result.label or "target" if len(results) == 1 else f"{number}: {result.label or 'target'}"
        for number, result in enumerate(results)
    ]
    gates = {name: result.gate.limits for name, result in zip(names, results, strict=True)}
    ranged = recording.n_range_bins > 1
    yield "range-time" if ranged else "level-time", viz.range_time(recording.baseband, tracks=gates, **look)
    wavelength_m = recording.radar.wavelength_m
    as_reported = analysis.method == "liland2018"
    for number, result in enumerate(results):
        prefix = f"{number}-{result.label or 'target'}".replace(" ", "-")
        yield (
            f"{prefix}-overview",
            viz.overview(recording, result, title=names[number], doppler_hz=doppler_hz, **look),
        )
        middle = result.signature.sizes["time"] // 2
        try:
            cube = next(iter(range_doppler(recording.baseband, analysis, wavelength_m=wavelength_m, columns=[middle])))
        except AnalysisError as error:  # a still person is found by breathing, at frame rates too low for Doppler
            print_message(f"note: no figure {prefix}-range-doppler: {error}")
        else:
            if ranged:
                power = cube.isel(time=0)
                yield f"{prefix}-range-doppler", viz.range_doppler_map(power, gate=result.gate.limits, **look)
        yield f"{prefix}-signature", viz.signature(result.signature, doppler_hz=doppler_hz, **look)
        arrays = {"normalised": result.normalised_signature, "doppler_hz": doppler_hz}
        pair = viz.signature_normalisation(result.signature, **arrays)
        yield f"{prefix}-signature-normalised", pair
        ratios, f_mu_hz = (result.features.harmonic_ratio_2, result.features.harmonic_ratio_3), result.gait_frequency_hz
        harmonics_hz = [] if f_mu_hz is None else [None if ratio is None else ratio * f_mu_hz for ratio in ratios]
        marks: dict[str, Any] = {"gait_frequency_hz": f_mu_hz, "harmonics_hz": harmonics_hz}
        marks["doubtful"] = "gait_frequency_hz" in result.doubtful
        yield f"{prefix}-cadence-velocity", viz.cadence_map(result.cadence_map, **marks, **look)
        spectrum = viz.cadence_spectrum(result.cadence_spectrum, amplitude=as_reported, **marks)
        yield f"{prefix}-cadence-spectrum", spectrum
        yield (
            f"{prefix}-mean-doppler",
            viz.mean_doppler_spectrum(
                result.mean_doppler_spectrum,
                doppler_hz=result.signature.coords["doppler"].values,
                wavelength_m=wavelength_m,
                torso_doppler_hz=result.torso_doppler_hz,
                bandwidth_hz=result.features.doppler_bandwidth_hz,
                threshold=analysis.bandwidth_threshold if as_reported else None,
            ),
        )
        if result.gate.source == "truth" and number < len(recording.truth):
            scatterers = recording.truth[number].scatterers
            yield f"{prefix}-truth-range", viz.range_lines(scatterers)
            yield f"{prefix}-truth-doppler", viz.doppler_lines(scatterers, wavelength_m=wavelength_m)
            truth = viz.scatterer_doppler(scatterers, wavelength_m=wavelength_m)
            lines = {"truth_doppler": truth, "main_line_hz": result.main_line_hz, "doppler_hz": doppler_hz}
            yield f"{prefix}-signature-truth", viz.signature(result.signature, **lines, **look)
