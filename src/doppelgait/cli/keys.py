"""``doppelgait keys``, ``plugins`` and ``fetch``: what can be configured, by which plug-ins, and what to begin with."""

from __future__ import annotations

import re
import textwrap
from typing import Annotated, Any

import typer

from doppelgait.cli.output import AsJson, print_json, print_message, print_table, print_text
from doppelgait.core.errors import ConfigError, list_choices


def keys(
    topic: Annotated[
        str | None,
        typer.Argument(help="Topic such as radar, GROUP.NAME such as motion.human, or TABLE.KEY such as dataset.seed."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Print the keys of configuration files.

    Without a topic, the topics are listed.

    Example: doppelgait keys motion.human

    Example: doppelgait keys radar.prf_hz
    """
    from doppelgait.cli.topics import TOPICS, models_of
    from doppelgait.core.keys import Key
    from doppelgait.core.keys import list_keys as list_all

    if topic is None:
        rows = [
            {
                "topic": name,
                "what": title,  # of a heading such as 'motion, kind = "human"' the name alone
                "tables": ", ".join(
                    heading.partition('kind = "')[2].rstrip('"') or heading for heading, _ in models_of(name)
                ),
            }
            for name, title in TOPICS.items()
        ]
        rows += [
            {"topic": name, "what": "plug-ins: GROUP.NAME", "tables": ", ".join(members)}
            for name, members in _groups().items()
            if name not in TOPICS
        ]
        print_json(rows) if as_json else print_table(rows)
        return
    found, only = _find(topic)

    def list_keys(model: Any) -> list[Key]:
        return [Key(*map(_words, key)) for key in list_all(model) if only in ("", key.key)]

    if as_json:
        print_json([{"table": name, "keys": [key._asdict() for key in list_keys(model)]} for name, model in found])
        return
    for number, (name, model) in enumerate(found):
        if number:
            print()
        print(f"{name}: " + _words((model.__doc__ or "").split("\n\n")[0]))
        for key in list_keys(model):
            default = DEFAULTS.get(key.default, f"default {key.default}")
            facts = [key.type, key.unit, key.limits, default]
            print(f"  {key.key}: {', '.join(filter(None, facts))}")
            print(textwrap.fill(key.description, 110, initial_indent="      ", subsequent_indent="      "))


DEFAULTS = {"": "", "required": "required", "its defaults": "optional"}
"""Texts for people of the defaults that are no values."""


def _groups() -> dict[str, list[str]]:
    from doppelgait.core.plugins import list_plugin_groups

    found = {
        group: [p.name for p in members.values() if p.parameters] for group, members in list_plugin_groups().items()
    }
    return {SHORT.get(group, group): names for group, names in found.items() if names}


SHORT = {"motion_model": "motion"}
"""Names of plug-in groups in a scene file, where they differ from the group."""


def _find(topic: str) -> tuple[list[tuple[str, Any]], str]:
    """Find the tables of a topic, and the key of TABLE.KEY."""
    try:
        return _find_tables(topic), ""
    except ConfigError as unknown:
        table, _, key = topic.rpartition(".")
        try:
            found = [(name, model) for name, model in _find_tables(table) if key in model.model_fields]
        except ConfigError:
            raise unknown from None
        if not found:
            raise unknown
        return found, key


def _find_tables(topic: str) -> list[tuple[str, Any]]:
    from doppelgait.cli.topics import TABLES, TOPICS, models_of
    from doppelgait.core.plugins import list_plugin_groups

    if topic in TOPICS or topic in TABLES:
        return models_of(topic)
    groups = {SHORT.get(name, name): group for name, group in list_plugin_groups().items()}
    group, _, name = topic.partition(".")
    known = _groups()
    if group in known:
        if name and name not in known[group]:
            listed = list_choices(known[group], name)
            raise ConfigError(f"keys {topic}: no {group} {name!r} with keys; known are {listed}")
        return [(f"{group}.{one}", groups[group][one].parameters) for one in known[group] if name in ("", one)]
    heading = next((found for t in TOPICS for found in models_of(t) if found[0].lower() == topic.lower()), None)
    if heading is None:
        raise ConfigError(
            f"keys {topic}: is not a topic; topics are {', '.join([*TOPICS, *(g for g in known if g not in TOPICS)])}, "
            "GROUP.NAME, for example motion.human, and TABLE.KEY, for example dataset.seed"
        )
    return [heading]


def _words(text: str) -> str:
    """Return text of a docstring without its markup."""
    text = re.sub(r":\w+:`~?([^`]*)`", r"\1", " ".join(text.split()))
    return text.replace("`", "").replace("\u00a0", " ")


def plugins(
    group: Annotated[
        list[str] | None, typer.Argument(help="Groups to list, for example impairment; by default all.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List all plug-ins with their parameters."""
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
    shown = [{**row, "parameters": " ".join(row["parameters"])} for row in rows]
    print_json(rows) if as_json else print_table(shown)


def fetch(
    name: Annotated[str | None, typer.Argument(help="Name of a recording; without it all are listed.")] = None,
    as_json: AsJson = False,
) -> None:
    """Download a public recording, and print its path.

    The licence is printed first. Without a name, the recordings are listed.

    Example: doppelgait fetch dog-walk
    """
    from doppelgait import data

    rows = data.list_recordings().to_dict("records")
    if name is not None:
        print_text(str(data.fetch(name)))
        print_message(next(f"read with {row['read']}" for row in rows if row["name"] == name))
    elif as_json:
        print_json(rows)
    else:
        print_table([{key: row[key] for key in ("name", "what", "bytes", "licence")} for row in rows])
