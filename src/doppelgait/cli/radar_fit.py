"""``doppelgait radar fit``: a sensor twin from a recording of an empty room."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doppelgait.cli.output import check_output, number, print_json, print_table, reader_options, say

if TYPE_CHECKING:
    from doppelgait.radar.fit import TwinFit


def fit(
    empty: Annotated[Path, typer.Argument(help="Recording of an empty room, any format that can be read.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Twin to write, .toml.")],
    preset: Annotated[
        str | None, typer.Option("--preset", help="Preset that tells what the file does not; same as --option radar=.")
    ] = None,
    options: Annotated[
        list[str] | None,
        typer.Option("--option", help="Reader option KEY=VALUE, for example matrix=Data_Matrix_1; may be repeated."),
    ] = None,
    start: Annotated[float | None, typer.Option("--start", help="Use the recording from this time on, s.")] = None,
    stop: Annotated[float | None, typer.Option("--stop", help="Use the recording up to this time, s.")] = None,
    figures: Annotated[Path | None, typer.Option("--figures", help="Folder to draw a figure into.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Fit noise, clutter, phase drift and faults of a sensor and write them as a twin to simulate with.

    Example: doppelgait radar fit empty-room.h5 -o my-x4.toml
    """
    from doppelgait.core.files import atomic_path
    from doppelgait.radar.fit import fit_twin, twin_as_dict, twin_toml
    from doppelgait.radar.readers import read_recording

    check_output(output, ".toml")
    with reader_options():
        recording = read_recording(empty, **_reader_options(options or [], preset))
    found = fit_twin(recording, start_s=start, stop_s=stop)
    with atomic_path(output) as partial:
        partial.write_text(twin_toml(found), encoding="utf-8")
    if figures is not None:
        say(f"figure: {_draw(found, figures)}")
    if as_json:
        print_json({**twin_as_dict(found), "twin": str(output)})
        return
    _print(found)
    say(f'twin: {output}; use it as radar.preset = "{output}" in a scene')


def _reader_options(options: Sequence[str], preset: str | None) -> dict[str, Any]:
    from doppelgait.core.config import apply_overrides
    from doppelgait.core.errors import ConfigError

    for option in options:
        if "=" not in option.lstrip("="):
            raise ConfigError(f"--option {option}: must be KEY=VALUE, for example matrix=Data_Matrix_1")
    return {**({} if preset is None else {"radar": preset}), **apply_overrides({}, options)}


def _print(found: TwinFit) -> None:
    from doppelgait.radar.fit import estimate_rows

    say(f"{found.source or 'recording'}: {found.n_used} of {found.n_frames} frames used, {found.duration_s:.1f} s")
    rows = [(name, f"{e.value:.5g}", f"{e.sd:.2g}", unit) for name, e, unit in estimate_rows(found)]
    print_table([{"estimate": n, "value": v, "+-": sd, "unit": unit} for n, v, sd, unit in rows])
    print()
    unit_db = found.level_of_unit_db
    print_table(
        [
            {
                "clutter at": f"{r:.2f} m",
                "dB re 1 V": number(level, 1),
                "+- dB": number(sd, 1),
                **({} if unit_db is None else {"dB re 1 unit": number(level - unit_db, 1)}),
            }
            for r, level, sd in zip(found.clutter.range_m, found.clutter.level_db, found.clutter.sd_db, strict=True)
        ]
    )
    for flag in found.flags:
        say(f"note: {flag}")


def _draw(found: TwinFit, folder: Path) -> Path:
    import numpy as np

    from doppelgait import viz
    from doppelgait.core.errors import OutputError
    from doppelgait.core.units import power_to_db
    from doppelgait.viz.twin import twin_figure

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made: {error}") from None
    figure = twin_figure(
        range_m=found.range_m,
        static_db=power_to_db(np.abs(found.echo_v) ** 2),
        noise_db=power_to_db(found.noise.by_bin_v2),
        knots_m=found.clutter.range_m,
        knots_db=found.clutter.level_db,
        time_s=found.time_s,
        phase_rad=np.unwrap(np.angle(found.factor)),
        gain_db=power_to_db(np.abs(found.factor) ** 2),
        title=f"Twin fitted from {found.source or 'a recording'}",
    )
    path: Path = viz.save_figure(figure, folder / "twin-fit.png")
    return path
