"""``doppelgait motion``: inspect motion recordings and convert them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from doppelgait.cli.output import AsJson, check_output, print_json, print_message, print_table

app = typer.Typer(help="Inspect motion recordings and convert them.", no_args_is_help=True, rich_markup_mode=None)

WIDEST_CELL = 90

Start = Annotated[float | None, typer.Option("--start", help="Start of the used part of the file, s.")]
Stop = Annotated[float | None, typer.Option("--stop", help="End of the used part of the file, s.")]
Options = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Reader option KEY=VALUE, such as units=mm, up_axis=y, rate_hz=200, subject=Jim, segment=2, loop_to_s=5.",
    ),
]


@app.command("info")
def info(
    file: Annotated[Path, typer.Argument(help="Motion recording.")],
    start: Start = None,
    stop: Stop = None,
    options: Options = None,
    as_json: AsJson = False,
) -> None:
    """Print facts about a motion recording, before and after cleaning.

    The facts are rate, units, axes, points, gaps, height, speed, stride, and the straight segments at constant speed.

    Example: doppelgait motion info 07_01.c3d
    """
    from doppelgait.core.config import apply_overrides
    from doppelgait.motion.describe import describe_recording

    facts = describe_recording(file, **{"start_s": start, "stop_s": stop, **apply_overrides({}, options or [])})
    if as_json:
        print_json(facts)
        return
    cleaned = facts.pop("cleaned")
    segments = facts.pop("segments")
    if "refused" in cleaned:
        print_message(f"warning: cannot be used as a target: {cleaned['refused']}")
    names = [*facts, *(key for key in cleaned if key not in facts and key != "refused")]
    print_table(
        [
            {"fact": n, "in the file": _format_value(facts.get(n)), "cleaned": _format_value(cleaned.get(n))}
            for n in names
        ]
    )
    print_message(f"straight segments at constant velocity: {len(segments) or 'none'}")
    columns = ("start_s", "stop_s", "mean_speed_mps", "heading_deg", "lateral_m", "gait", "stride_frequency_hz")
    if segments:
        rows = [{name: _format_value(segment[name]) for name in columns} for segment in segments]
        print_table([{"segment": str(number), **row} for number, row in enumerate(rows, start=1)])


def _format_value(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list):
        return ", ".join(map(str, value)) if len(value) <= 12 else f"{len(value)} of them"
    if isinstance(value, dict):
        listed = "; ".join(f"{key}: {_format_value(inner)}" for key, inner in value.items()) or "-"
        return listed if len(listed) <= WIDEST_CELL else f"{listed[:WIDEST_CELL]}... (all with --json)"
    return "-" if value in (None, "") else str(value)


@app.command("convert")
def convert(
    file: Annotated[Path, typer.Argument(help="Motion recording.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Table to write, .csv.")],
    start: Start = None,
    stop: Stop = None,
    options: Options = None,
) -> None:
    """Write the cleaned motion as a CSV table.

    The columns are time_s, then x, y, z in m of every point.

    Example: doppelgait motion convert 07_01.c3d -o walk.csv
    """
    import pandas as pd

    from doppelgait.core.config import apply_overrides
    from doppelgait.core.files import open_atomically
    from doppelgait.motion.readers import read

    check_output(output, ".csv")
    motion = read(file, **{"start_s": start, "stop_s": stop, **apply_overrides({}, options or [])})
    names = [f"{marker}_{axis}_m" for marker in motion.markers for axis in "xyz"]
    table = pd.DataFrame(motion.position_m.reshape(motion.n_frames, -1), columns=names)
    table.insert(0, "time_s", motion.time_s)
    with open_atomically(output) as partial:
        table.to_csv(partial, index=False, float_format="%.9g")
    print_message(f"{output}: {len(table)} frames of {len(motion.markers)} points")
