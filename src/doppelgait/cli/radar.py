"""``doppelgait radar``: presets and what follows from them."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from doppelgait.cli.output import print_json, print_table
from doppelgait.cli.radar_fit import fit

app = typer.Typer(
    help="Radar presets, twins fitted to a sensor, and formats of recordings.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.command("fit")(fit)

UNITS = {
    "hz_per_s": "Hz/s", "per_unit": "V/unit", "mps": "m/s", "dbm": "dBm", "dbi": "dBi", "dbv": "dBV", "hz": "Hz",
    "rad": "rad", "v2": "V^2", "db": "dB", "m": "m", "s": "s",
}  # fmt: skip
"""Unit by the end of a name; the first that fits counts."""


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
def list_formats(as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False) -> None:
    """List the formats of recordings that are read, and the options for what their files do not tell.

    Example: doppelgait radar formats
    """
    import inspect

    from doppelgait.radar.readers import RECORDING_READERS

    rows = []
    for name in RECORDING_READERS:
        entry = RECORDING_READERS[name]
        parameters = inspect.signature(entry.reader()).parameters.values()
        options = [p.name for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY]
        rows.append({"format": name, "files": " ".join(entry.suffixes), "options": " ".join(options)})
    if as_json:
        print_json(rows)
    else:
        print_table(rows)


@app.command("show")
def show(
    preset: Annotated[str, typer.Argument(help="Name of a preset, or a file that ends in .toml.")],
    changes: Annotated[
        list[str] | None, typer.Option("--set", help="Change a parameter, KEY=VALUE; may be repeated.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Show parameters and derived quantities of a preset or of a file with a radar's parameters.

    Examples: doppelgait radar show x4 --set prf_hz=600; doppelgait radar show my-radar.toml
    """
    from doppelgait.core.config import apply_overrides
    from doppelgait.radar import Radar, derived_quantities, preset_table

    radar = Radar.preset(preset, **apply_overrides({}, changes or []))
    parameters = radar.model_dump(mode="json")
    table = preset_table(preset)
    beside = {key: table[key] for key in ("environment", "impairments") if key in table}
    if as_json:
        print_json({"parameters": parameters, "derived": derived_quantities(radar), **beside})
        return
    print_table([{"parameter": key, **_shown(key, value)} for key, value in parameters.items()])
    print()
    print_table([{"derived": key, **_shown(key, value)} for key, value in derived_quantities(radar).items()])
    for key, entries in beside.items():
        print(f"\n{key}, in this order: {', '.join(_kind(entry) for entry in entries)}")


def _shown(key: str, value: Any) -> dict[str, str]:
    """Value and unit of a parameter, the unit taken from its name."""
    if value is None:
        return {"value": "-", "unit": ""}
    if isinstance(value, dict):
        return {"value": ", ".join(f"{k} {v}" for k, v in value.items() if v not in (None, [])), "unit": ""}
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    unit = next((unit for end, unit in UNITS.items() if key == end or key.endswith(f"_{end}")), "")
    return {"value": text, "unit": "" if isinstance(value, str) else unit}


def _kind(entry: Any) -> str:
    return str(entry.get("kind", "?")) if isinstance(entry, dict) else str(entry)
