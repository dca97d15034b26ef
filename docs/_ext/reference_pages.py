"""All pages of docs/reference: command line, configuration, Python."""

from __future__ import annotations

from typing import Any

from api_pages import BESIDE, PACKAGES, api_page, homes
from command_pages import commands_page
from setting_pages import groups, settings_page

from doppelgait.cli.app import app, load_commands
from doppelgait.dataset.shard_files import AXIS_UNITS, FIELDS
from doppelgait.features.extended import list_features


def pages() -> dict[str, str]:
    """File name and text of every page."""
    found = homes()
    texts = {"commands.md": commands_page(app, load_commands())}
    configuration = groups()
    texts |= {f"configuration/{name}.md": settings_page(*group) for name, group in configuration.items()}
    texts |= {f"api/{place}.rst": api_page(place, found) for place in (*PACKAGES, *BESIDE)}
    texts |= {"fields.md": _fields(), "extended.md": _extended()}
    texts["configuration.md"] = _contents(
        "Configuration", CONFIGURATION_WORDS, [f"configuration/{n}" for n in configuration]
    )
    texts["api.md"] = _contents("Python", API_WORDS, [f"api/{place}" for place in (*PACKAGES, *BESIDE)])
    return texts


CONFIGURATION_WORDS = (
    "Every key of every file, made from the models that check them. The unit is in the key; limits are checked, "
    "unknown keys are refused with the line they stand in."
)
API_WORDS = (
    "What `__all__` of each package lists, and nothing else, is public. `import doppelgait as dg` has the packages and "
    "the names of the first page."
)


def _fields() -> str:
    """Arrays that a dataset can keep."""
    cells = [
        (f"`{name}`", ", ".join(facts["dims"]), facts["units"], facts["dtype"], ", ".join(_axes(name, facts)))
        for name, facts in FIELDS.items()
    ]
    rows = [f"| {' | '.join(row)} |" for row in cells]
    return "\n".join(["| array | dims | unit | full precision | axes |", "| --- | --- | --- | --- | --- |", *rows, ""])


def _axes(name: str, facts: dict[str, Any]) -> list[str]:
    return [f"`{name}_{dim}_{AXIS_UNITS[dim]}`" for dim in facts["dims"] if dim in AXIS_UNITS]


def _extended() -> str:
    """Features beside the six."""
    rows = [f"| `extended_{name}` | {unit} | {source} |" for name, unit, source in list_features()]
    return "\n".join(["| column | unit | |", "| --- | --- | --- |", *rows, ""])


def _contents(title: str, words: str, entries: list[str]) -> str:
    return "\n".join([f"# {title}", "", words, "", "```{toctree}", ":maxdepth: 1", "", *entries, "```", ""])
