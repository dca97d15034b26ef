"""``doppelgait radar``: presets, derived quantities, fitted sensor models."""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path
from typing import Annotated, Any

import typer

from doppelgait.cli.analyze import ReaderOptions
from doppelgait.cli.output import (
    AsJson,
    FigureFormat,
    FigureOption,
    check_output,
    explain_reader_options,
    format_number,
    make_folder,
    print_json,
    print_message,
    print_table,
    print_tables,
    print_text,
)
from doppelgait.core.errors import AnalysisError, DoppelgaitWarning


def fit(
    recordings: Annotated[
        list[Path],
        typer.Argument(help="Recordings or folders: an empty room, or several recordings with any content."),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Calibrated preset to write, .toml.")],
    preset: Annotated[str | None, typer.Option(help="Preset for what no file stores.")] = None,
    options: ReaderOptions = None,
    start: Annotated[float | None, typer.Option(help="Start of the used part, s.")] = None,
    stop: Annotated[float | None, typer.Option(help="End of the used part, s.")] = None,
    people_at: Annotated[float | None, typer.Option(help="Median range of people, m; sets the gain.")] = None,
    figures: Annotated[Path | None, typer.Option("--figures", help="Folder to write a figure into.")] = None,
    figure_format: FigureOption = FigureFormat.png,
    as_json: AsJson = False,
) -> None:
    """Fit the noise and faults of a sensor to recordings.
    One recording gives the preset of one sensor, several recordings give distributions.
    """
    from doppelgait.core.config import apply_overrides
    from doppelgait.core.files import open_atomically
    from doppelgait.radar import Radar
    from doppelgait.radar.fit import describe_sensor, fit_sensor, format_preset
    from doppelgait.radar.readers import read_several

    check_output(output, ".toml")
    radar = None if preset is None else Radar.preset(preset)
    with explain_reader_options():
        read, unread = read_several(
            recordings, **({} if preset is None else {"radar": preset}), **apply_overrides({}, options or [])
        )
    if len(read) > 1:
        for name, value in {"--start": start, "--stop": stop, "--figures": figures}.items():
            if value is not None:
                raise typer.BadParameter(f"{name} is allowed with one recording only; leave it out")
    if start is not None or stop is not None:
        first_s, last_s = read[0].slow_time_s[[0, -1]].tolist()
        read = [read[0].between(first_s if start is None else start, last_s + 1.0 if stop is None else stop)]
    kind = fit_sensor(read, radar=radar, people_at_m=people_at)
    with open_atomically(output) as partial:
        partial.write_text(format_preset(kind), encoding="utf-8")
    if figures is not None:
        _plot_room(kind.recordings[0], figures, figure_format)
    values = describe_sensor(kind)
    values["left_out"] = [*unread, *values["left_out"]]
    if as_json:
        print_json({**values, "preset": str(output)})
        return
    used = [
        {"recording": row["recording"], "used for": ", ".join(row["used_for"]) or "nothing"}
        for row in values["recordings"]
    ]
    print_tables([used[:20], [_format_quantity(row, len(used) > 1) for row in values["quantities"]]])
    if len(used) > 20:
        print_message(f"and {len(used) - 20} more recordings")
    for word, key in (("note", "notes"), ("refused", "refused")):
        for name, why in values[key].items():
            print_message(f"{word}: {name}: {why}")
    for why in values["left_out"]:
        print_message(f"left out: {why}")
    print_message(f'preset: {output}; use it as radar.preset = "{output}" in a scene, or in a plan')


def _format_quantity(row: dict[str, Any], with_spread: bool) -> dict[str, str]:
    """Return a quantity as a row to print."""
    cells = {"quantity": row["quantity"], "value": f"{row['value']:.5g}", "+-": f"{row['sd']:.2g}", "unit": row["unit"]}
    if "value_re_unit_db" in row:
        cells["dB re 1 unit"] = format_number(row["value_re_unit_db"], 1)
    if with_spread:
        spread_is_known = row["spread"] is not None
        cells["spread"] = f"{row['spread']:.2g}" if spread_is_known else "-"
        cells["95 %"] = f"{row['low']:.2g} to {row['high']:.2g}" if spread_is_known else "-"
        cells["from"] = str(row["recordings"])
    return cells


def _plot_room(measured: Any, folder: Path, figure_format: FigureFormat) -> None:
    """Write the figure of an empty room."""
    import numpy as np

    from doppelgait import viz
    from doppelgait.core.units import power_to_db
    from doppelgait.viz.ranges import plot_sensor_fit

    room = measured.room
    if room is None:
        raise AnalysisError(f"--figures shows clutter and phase noise: {measured.refused['clutter and phase noise']}")
    make_folder(folder)
    figure = plot_sensor_fit(
        range_m=measured.recording.range_m,
        static_db=power_to_db(np.abs(room.echo_v) ** 2),
        noise_db=power_to_db(room.noise.by_bin_v2),
        knots_m=room.clutter.axis,
        knots_db=room.clutter.level_db,
        time_s=room.time_s,
        phase_rad=np.unwrap(np.angle(room.factor)),
        gain_db=power_to_db(np.abs(room.factor) ** 2),
        title=f"Sensor model fitted from {measured.recording.source or 'a recording'}",
    )
    print_message(f"figure: {viz.save_figure(figure, folder / f'twin-fit.{figure_format}')}")


app = typer.Typer(
    help="Radar presets, sensors fitted to recordings, and formats of recordings.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.command("fit")(fit)


@app.command("compare")
def compare(
    recordings: Annotated[list[Path], typer.Argument(help="Real recordings or folders that were not used in the fit.")],
    models: Annotated[
        list[str],
        typer.Option("--model", help="Sensor model .toml or preset to compare; may be repeated."),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Page of pictures and tables to write: .png, .svg, .pdf.")
    ],
    plan: Annotated[
        str | None, typer.Option("--plan", help="Plan of the same kind of scene; by default an empty room.")
    ] = None,
    options: ReaderOptions = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the simulated recordings.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Compare real recordings with simulated ones.

    A classifier is trained to separate real from simulated recordings and tested on unseen recordings. An AUC of 0.5
    means that they cannot be separated, 1 that they always can. With fewer than four recordings the classifier is
    tested on unseen parts of them, which raises the AUC; the table then has a note. The table also has the distance of
    every statistic. Recordings of fewer than 32 pulses or two bursts are left out.

    Example: doppelgait radar compare other-week/ --model x4 --model my-sensor.toml -o page.png
    """
    from doppelgait import viz
    from doppelgait.classify.domain import (
        compare_recordings,
        comparison_rows,
        plot_recording,
        simulate_like,
        split_windows,
    )
    from doppelgait.core.config import apply_overrides
    from doppelgait.dataset.config import load_plan
    from doppelgait.radar.readers import read_several
    from doppelgait.viz.tables import plot_domains

    check_output(output, ".png", ".svg", ".pdf")
    loaded, folder = (None, None) if plan is None else load_plan(plan)
    with explain_reader_options():
        read, left_out = read_several(recordings, **apply_overrides({}, options or []))
    real = []
    for recording in read:
        try:
            split_windows(recording)
            real.append(recording)
        except AnalysisError as error:
            left_out = [*left_out, str(error)]
    if not real:
        raise AnalysisError("no recording can be compared: " + "; ".join(left_out))
    models = list(dict.fromkeys(models))
    stems = ["real", *(Path(model).stem for model in models)]
    found, pictures = {}, {"real": [plot_recording(one) for one in real[:SHOWN]]}
    for model in models:
        stem = Path(model).stem
        name = stem if stems.count(stem) == 1 else model  # add the folder to distinguish files of the same name
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DoppelgaitWarning)  # the simulated sensor may clip, too
            made = simulate_like(real, model, plan=loaded, folder=folder, seed=seed)
        found[name] = compare_recordings(real, made, seed=seed)
        pictures[name] = [plot_recording(one) for one in made[:SHOWN]]
    rows = comparison_rows(found)
    title = f"{len(real)} real recordings, and as many simulated"
    print_message(f"page: {viz.save_figure(plot_domains(pictures, rows, title=title), output)}")
    for why in left_out:
        print_message(f"left out: {why}")
    if as_json:
        print_json({name: dataclasses.asdict(one) for name, one in found.items()})
    else:
        print_table(rows)
        print_message("distances are in standard deviations, with the AUC of that statistic alone")


SHOWN = 4
"""Number of recordings of each kind on the page."""


@app.command("points")
def points(
    log: Annotated[Path, typer.Argument(help="Log of a TI people-tracking demo: .csv, or .json of its visualizer.")],
    frame_period_s: Annotated[
        float | None,
        typer.Option("--frame-period-s", help="Frame period, s, of a log that has frame numbers but no times."),
    ] = None,
    approaching_positive: Annotated[
        bool, typer.Option("--approaching-positive", help="Set if positive Doppler means an approaching target.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """List a point-cloud log's tracks with speeds.

    Example: doppelgait radar points replay_1.json
    """
    from doppelgait.core.config import convert_to_json
    from doppelgait.radar.point_clouds import collect_tracks, read_points, tabulate_tracks

    found = collect_tracks(read_points(log, frame_period_s=frame_period_s, approaching_positive=approaching_positive))
    rows: list[Any] = tabulate_tracks(found).to_dict("records")
    if as_json:
        print_json(convert_to_json(rows))
        return
    shown = [{key: format_number(value, 2) for key, value in row.items()} for row in rows]
    print_table(shown) if rows else print_text("no track of five frames or more")


@app.command("list")
def list_presets(as_json: AsJson = False) -> None:
    """List the presets.

    Example: doppelgait radar list
    """
    from doppelgait.radar import Radar, list_preset_names

    radars = {name: Radar.preset(name) for name in list_preset_names()}
    if as_json:
        print_json({name: radar.model_dump(mode="json") for name, radar in radars.items()})
        return
    print_table(
        [
            {
                "preset": name,
                "waveform": radar.waveform.kind,
                "carrier": f"{radar.carrier_hz / 1e9:.3f} GHz",
                "PRF": f"{radar.prf_hz:g} Hz",
                "unambiguous": f"+-{radar.unambiguous_velocity_mps:.2f} m/s",
                "resolution": "-" if radar.waveform.kind == "cw" else f"{100 * radar.range_resolution_m:.1f} cm",
                "frame": "-" if radar.waveform.kind == "cw" else f"{radar.range_start_m:g} to {radar.range_stop_m:g} m",
                "": radar.name,
            }
            for name, radar in radars.items()
        ]
    )


@app.command("formats")
def list_formats(as_json: AsJson = False) -> None:
    """List the formats of recordings that can be read.

    The options supply the values that files of a format do not store.

    Example: doppelgait radar formats
    """
    from doppelgait.core.readers import list_options
    from doppelgait.radar.readers import RADAR_READERS

    rows = [
        {"format": r.name, "files": " ".join(r.facts["suffixes"]), "options": " ".join(list_options(r.run))}
        for r in RADAR_READERS.values()
    ]
    print_json(rows) if as_json else print_table(rows)


@app.command("show")
def show(
    preset: Annotated[str, typer.Argument(help="Name of a preset, or a file that ends in .toml.")],
    changes: Annotated[
        list[str] | None, typer.Option("--set", help="Change a parameter, KEY=VALUE; may be repeated.")
    ] = None,
    as_json: AsJson = False,
    as_toml: Annotated[bool, typer.Option("--toml", help="Print a radar file, to be changed and used.")] = False,
) -> None:
    """Show a preset's parameters, derived quantities and effects.

    Examples: doppelgait radar show x4 --set prf_hz=600; doppelgait radar show my-radar.toml

    Example: doppelgait radar show x4 --toml > my-radar.toml
    """
    from doppelgait.core.config import apply_overrides, as_table, write_toml
    from doppelgait.radar import Radar, list_derived_quantities, read_full_preset
    from doppelgait.radar.link import describe_effects

    radar = Radar.preset(preset, **apply_overrides({}, changes or []))
    parameters = radar.model_dump(mode="json")
    table = read_full_preset(preset)
    conditions = {key: table[key] for key in ("environment", "impairments") if key in table}
    if as_toml:
        print_text(write_toml(as_table(radar) | conditions), end="")
        return
    kinds = {str(entry.get("kind")) for entry in conditions.get("impairments", ()) if isinstance(entry, dict)}
    derived, effects = list_derived_quantities(radar), describe_effects(radar, kinds)
    if as_json:
        print_json({"parameters": parameters, "derived": derived, "effects": effects, **conditions})
        return
    print_tables(
        [
            [{"parameter": key, **_format_parameter(key, value)} for key, value in parameters.items()],
            [{"derived": key, **_format_parameter(key, value)} for key, value in derived.items()],
            [{"effect": name, "simulated": value} for name, value in effects.items()],
        ]
    )
    for key, entries in conditions.items():
        listed = [str(entry.get("kind", "?")) if isinstance(entry, dict) else str(entry) for entry in entries]
        print_text(f"\n{key}, in this order: {', '.join(listed)}")


def _format_parameter(key: str, value: Any) -> dict[str, str]:
    from doppelgait.core.keys import unit_of

    if value is None:
        return {"value": "-", "unit": ""}
    if isinstance(value, dict):
        return {"value": ", ".join(f"{k} {v}" for k, v in value.items() if v not in (None, [])), "unit": ""}
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    unit = unit_of(key).replace("²", "^2").replace("°", "deg")  # consoles may be ASCII
    return {"value": text, "unit": "" if isinstance(value, str) else unit}
