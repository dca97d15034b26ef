"""``doppelgait analyze``: recording -> signature, cadence-velocity diagram and features."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doppelgait.classify.options import WindowOptions, name_flag, takes_options
from doppelgait.cli.output import (
    AsJson,
    FigureFormat,
    FigureOption,
    check_output,
    explain_reader_options,
    format_number,
    print_json,
    print_message,
    print_table,
    print_text,
)
from doppelgait.core.errors import ConfigError

if TYPE_CHECKING:
    from doppelgait.pipeline import Result, Tracking
    from doppelgait.processing import Analysis
    from doppelgait.radar import Recording

OPTION_HELP = "Value that the file does not store, KEY=VALUE, for example carrier_hz=7.29e9; repeatable."

Changes = Annotated[
    list[str] | None,
    typer.Option("--set", help="Change a parameter, for example cpi_s=0.15 or tracking.detector.pfa=1e-4; repeatable."),
]
ReaderOptions = Annotated[list[str] | None, typer.Option("--option", help=OPTION_HELP)]


def make_option(name: str, kind: Any, text: str) -> Any:
    """Return the command-line form of an option."""
    if kind is Any:  # a dataset is named by its folder
        kind = {"gate": str, "day": str | None}.get(name, Path | None)
    return Annotated[kind, typer.Option(*name_flag(name).split(), help=text)]


def takes_windows(*but: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the options of gates and windows, without some."""
    return takes_options(WindowOptions, make_option, but=("analysis", "tracking", *but))


SHOWN_QUALITY = {
    "track_range_m": "m",
    "start_s": "s",
    "stop_s": "s",
    "n_pieces": "1",
    "ground_speed_mps": "m/s",
    "aspect_deg": "deg",
    "breathing_rate_hz": "Hz",
}
"""Diagnostics that the feature table shows, with their units."""


def parse_analysis(table: Mapping[str, Any], changes: Sequence[str] | None) -> tuple[Analysis, Tracking]:
    """Change analysis and tracking parameters by ``--set``."""
    from doppelgait.core.config import apply_overrides, validate
    from doppelgait.pipeline import Tracking
    from doppelgait.processing import Analysis

    changed = apply_overrides(table, changes or [])
    tracking = validate(Tracking, changed.pop("tracking", {}), where="tracking")
    return validate(Analysis, changed, where="analysis"), tracking


def open_recording(path: Path, options: Sequence[str] | None) -> Recording:
    """Read a recording with ``--option``, and print its notes."""
    from doppelgait.core.config import apply_overrides
    from doppelgait.radar import read_recording

    with explain_reader_options():
        recording = read_recording(path, **apply_overrides({}, options or []))
    for note in recording.notes:
        print_message(f"note: {note}")
    return recording


@takes_windows()
def analyze(
    recording: Annotated[Path, typer.Argument(help="Recording: our .h5, XeThru, or any format of 'radar formats'.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Result file to write, .h5.")] = None,
    method: Annotated[
        str, typer.Option("--method", help="Analysis method: standard, or liland2018 for the method of the report.")
    ] = "standard",
    changes: Changes = None,
    options: ReaderOptions = None,
    figures: Annotated[Path | None, typer.Option("--figures", help="Folder to write figures into.")] = None,
    figure_format: FigureOption = FigureFormat.png,
    style: Annotated[str, typer.Option("--style", help="screen, or paper: no titles.")] = "screen",
    dpi: Annotated[float | None, typer.Option(min=20, max=2400, help="Pixels per inch.")] = None,
    only: Annotated[str, typer.Option(help="Text in the names of the wanted figures, for example signature.")] = "",
    cmap: Annotated[str | None, typer.Option(help="Colour map of Matplotlib.")] = None,
    db_range: Annotated[float | None, typer.Option(min=1, max=200, help="Dynamic range of maps, dB.")] = None,
    doppler_hz: Annotated[tuple[float, float] | None, typer.Option(help="Limits of signatures, Hz.")] = None,
    as_json: AsJson = False,
    **windows: Any,
) -> None:
    """Analyse a recording: signature, cadence-velocity diagram, features.

    The six gait features of every target are printed, or all results written with -o. With
    --window-s or --hop-s there is one row per window and target.

    Example: doppelgait analyze walk.h5 -o result.h5 --figures figures

    Example: doppelgait analyze evening.h5 --window-s 4 --hop-s 1
    """
    from doppelgait.pipeline import analyze as run_analysis
    from doppelgait.pipeline import describe_results, write_results
    from doppelgait.processing import Gate

    if output is not None:
        check_output(output, ".h5")
    if figures is None and (only or cmap or db_range or doppler_hz):
        raise ConfigError("--only, --cmap, --db-range, --doppler-hz: need --figures")
    if doppler_hz is not None and not doppler_hz[0] < doppler_hz[1]:
        raise ConfigError(f"--doppler-hz {doppler_hz[0]:g} {doppler_hz[1]:g}: must rise")
    settings, tracking = parse_analysis({"method": method}, changes)
    loaded = open_recording(recording, options)
    choice, chosen = Gate.parse(windows["gate"], where="--gate"), WindowOptions(**windows)
    if chosen.window_s is not None or chosen.hop_s is not None:
        for name, value in (("-o", output), ("--figures", figures)):
            if value is not None:
                raise ConfigError(f"{name}: not allowed with --window-s or --hop-s; use --json to get all values")
        chosen = replace(chosen, gate=choice, analysis=settings, tracking=tracking)
        _analyze_windows(loaded, chosen, as_json=as_json)
        return
    results = run_analysis(loaded, gate=choice, analysis=settings, tracking=tracking)
    if output is not None:
        write_results(output, loaded, results)
    if figures is not None:
        from doppelgait.cli.figures import save_figures

        analysed = (loaded, results, settings.resolved(choice), {"db_range": db_range, "cmap": cmap}, doppler_hz)
        for path in save_figures(*analysed, folder=figures, form=figure_format, only=only, style=style, dpi=dpi):
            print_message(f"figure: {path}")
    if as_json:
        print_json(describe_results(loaded, results))
    else:
        print_features(results)


def _analyze_windows(recording: Recording, chosen: WindowOptions, *, as_json: bool) -> None:
    """Print every window's features, one row per target."""
    from doppelgait.classify.timeline import check_window
    from doppelgait.core.config import convert_to_json
    from doppelgait.dataset.windows import Links, analyze_window, cut_windows

    window_s, hop_s = check_window(chosen.window_s, chosen.hop_s)
    links, rows, documents = Links(), [], []
    for window in cut_windows(recording, window_s, hop_s):
        results = analyze_window(window, chosen.analysis, chosen.tracking, chosen.gate)
        times = {"start_s": window.start_s, "stop_s": window.stop_s}
        for track, result in zip(links.add(window, results), results, strict=True):
            documents.append(convert_to_json({**times, "track": track, **result.to_json(arrays=False)}))
            values = {**result.features.as_dict(), "gait_frequency_hz": result.gait_frequency_hz}
            rows.append(
                {
                    "start (s)": format_number(window.start_s, 2),
                    "stop (s)": format_number(window.stop_s, 2),
                    "track": track,
                    **{name: format_number(value) for name, value in values.items()},
                    "flags": ", ".join(result.flags),
                }
            )
    if as_json:
        print_json({"recording": recording.source, "window_s": window_s, "hop_s": hop_s, "targets": documents})
    else:
        print_table(rows) if rows else print_text("no target found")


def print_features(results: Sequence[Result]) -> None:
    """Print the table of features, one column per target."""
    from doppelgait.core.labels import STEP_LENGTHS
    from doppelgait.features import FEATURE_UNITS
    from doppelgait.pipeline.result import TargetList

    if not results:
        reason = getattr(results, "reason", "")
        print_text(f"no target found: {reason}" if reason else "no target found")
        return
    names = [f"{n}: {r.label or ('target' if r.is_body else r.verdict)}" for n, r in enumerate(results)]
    values = [{**r.shown_features, "gait_frequency_hz": r.gait_frequency_hz, "n_periods": r.n_periods} for r in results]
    units: dict[str, str] = {}
    for key, unit in {**FEATURE_UNITS, "gait_frequency_hz": "Hz", "n_periods": "1"}.items():
        if key == "step_length_m" and any("ground_step_length_m" in v for v in values):
            units["ground_step_length_m"] = "m"
        units[key] = unit

    def cell(result: Result, key: str, value: float | None) -> str:
        return format_number(value) + " ?" * (value is not None and key in result.doubtful)

    rows = [
        {
            "feature": f"{key} ({STEP_LENGTHS[key]})" if key in STEP_LENGTHS else key,
            "unit": unit,
            **{name: cell(r, key, v.get(key)) for name, r, v in zip(names, results, values, strict=True)},
        }
        for key, unit in units.items()
    ]
    rows += [
        {
            "feature": key.replace("pieces", "segments"),  # files have an older name
            "unit": unit,
            **{n: format_number(r.quality.get(key)) for n, r in zip(names, results, strict=True)},
        }
        for key, unit in SHOWN_QUALITY.items()
        if any(r.quality.get(key) is not None for r in results)
    ]
    print_table(rows)
    if any(r.doubtful for r in results):
        print_text("?: low confidence; the value may be a multiple or a fraction of the true value")
    bodies = TargetList(results)
    if any(result.n_bodies != 1 for result in results):
        print_text(f"bodies: {bodies.n_bodies} in {len(results)} targets, {bodies.n_unknown} unknown; see their flags")
    for name, result in zip(names, results, strict=True):
        if result.flags:
            print_text(f"{name} flags: {', '.join(result.flags)}")
