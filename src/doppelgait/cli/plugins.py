"""``doppelgait plugins``: groups of plug-ins and their members."""

from __future__ import annotations

from typing import Annotated

import typer

from doppelgait.cli.output import print_json, print_table


def plugins(
    group: Annotated[
        list[str] | None, typer.Argument(help="Groups to list, for example impairment; by default all.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """List all plug-ins with their parameters."""
    from doppelgait.core.errors import ConfigError
    from doppelgait.core.plugins import list_plugin_groups

    groups = list_plugin_groups()
    for name in group or []:
        if name not in groups:
            raise ConfigError(f"plugins {name}: no such group; groups are {', '.join(groups)}")
    rows = [
        {
            "group": item.group,
            "name": item.name,
            "package": item.package,
            "version": item.version,
            "parameters": [] if item.parameters is None else [p for p in item.parameters.model_fields if p != "kind"],
        }
        for name in group or groups
        for item in groups[name].values()
    ]
    if as_json:
        print_json(rows)
    else:
        print_table([{**row, "parameters": " ".join(row["parameters"])} for row in rows])
