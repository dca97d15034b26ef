"""``doppelgait demo``: a person and a dog in one scene."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from doppelgait.cli.output import FigureFormat, FigureOption, print_message

DEMO_SCENE: dict[str, Any] = {
    "seed": 2018,
    "duration_s": 4.0,
    "radar_position_m": [0.0, 0.0, 1.0],
    "radar": {"preset": "x4"},
    "targets": [
        {
            "label": "human",
            "motion": {"kind": "boulic", "speed_mps": 1.3, "height_m": 1.75},
            "start_position_m": [7.5, 0.6],
            "heading_deg": 180.0,
        },
        {
            "label": "dog",
            "motion": {"kind": "quadruped", "gait": "trot", "speed_mps": 1.6, "withers_m": 0.45},
            "start_position_m": [1.8, -0.8],
            "heading_deg": 0.0,
        },
    ],
}
"""Scene file of the demonstration: an approaching person and a receding dog pass each other."""


def run_demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder for the recording, the results and the figures.")
    ] = Path("demo"),
    figure_format: FigureOption = FigureFormat.png,
) -> None:
    """Simulate a person and a dog, analyse and plot both.

    Example: doppelgait demo -o demo
    """
    from doppelgait.cli.analyze import print_features
    from doppelgait.cli.figures import save_figures
    from doppelgait.core.errors import OutputError
    from doppelgait.pipeline import analyze, parse_run, run_simulation, write_results
    from doppelgait.radar import write_recording

    spec = parse_run(DEMO_SCENE, where="demo")
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"-o {output}: cannot be created: {error}") from None
    recording = run_simulation(spec)
    write_recording(recording, output / "recording.h5")
    results = analyze(recording, gate="truth", analysis=spec.analysis)
    write_results(output / "result.h5", recording, results)
    for path in save_figures(recording, results, spec.analysis, output, figure_format):
        print_message(f"figure: {path}")
    print_features(results)
    print_message(f"recording and results: {output / 'recording.h5'}, {output / 'result.h5'}")
