"""``doppelgait radar``: presets and what follows from them."""

from __future__ import annotations

from typing import Annotated

import typer

from doppelgait.cli.output import print_json, print_table

app = typer.Typer(help="Radar presets and their derived quantities.", no_args_is_help=True, rich_markup_mode=None)


@app.command("list")
def list_presets(as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False) -> None:
    """List the presets.

    Example: doppelgait radar list
    """
    from doppelgait.radar import Radar, preset_names

    radars = {name: Radar.preset(name) for name in preset_names()}
    if as_json:
        print_json({name: radar.model_dump(mode="json") for name, radar in radars.items()})
        return
    print_table(
        [
            {
                "preset": name,
                "carrier": f"{radar.carrier_hz / 1e9:.3f} GHz",
                "PRF": f"{radar.prf_hz:g} Hz",
                "unambiguous": f"+-{radar.unambiguous_velocity_mps:.2f} m/s",
                "frame": f"{radar.range_start_m:g} to {radar.range_stop_m:g} m",
                "": radar.name,
            }
            for name, radar in radars.items()
        ]
    )


@app.command("show")
def show(
    preset: Annotated[str, typer.Argument(help="Name of a preset.")],
    changes: Annotated[
        list[str] | None, typer.Option("--set", help="Change a parameter, KEY=VALUE; may be repeated.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Show a preset's parameters and derived quantities.

    Example: doppelgait radar show x4 --set prf_hz=600
    """
    from doppelgait.core.config import apply_overrides
    from doppelgait.radar import Radar

    radar = Radar.preset(preset, **apply_overrides({}, changes or []))
    parameters = radar.model_dump(mode="json")
    if as_json:
        print_json({"parameters": parameters, "derived": radar.derived()})
        return
    print_table([{"parameter": key, "value": "-" if v is None else v} for key, v in parameters.items()])
    print()
    print_table([{"derived": key, "value": f"{v:.6g}"} for key, v in radar.derived().items()])
