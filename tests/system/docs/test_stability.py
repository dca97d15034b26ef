"""What docs/stability.md promises is there; run as a script with an index.parquet, it prints ``stable_names.txt``."""

import importlib
import inspect
import re
import sys

import pandas as pd
import pytest
import typer
from pydantic import BaseModel

import doppelgait
from checkout import ROOT
from doppelgait.classify import model_file, report
from doppelgait.cli.app import app
from doppelgait.dataset import Dataset, finish
from doppelgait.pipeline import result_files
from doppelgait.radar import recordings
from doppelgait_liland2018 import run

PAGE = (ROOT / "docs" / "stability.md").read_text() if (ROOT / "docs").is_dir() else ""
LIST = ROOT / "tests" / "support" / "stable_names.txt"
VERSIONS = {
    "`schema_version`": finish.SCHEMA_VERSION,
    "`data_version`": finish.DATA_VERSION,
    **{f"`{kind.format}`": kind.version for kind in (recordings.RECORDING, result_files.RESULT, model_file.MODEL)},
    f"`{report.FORMAT}`": report.FORMAT_VERSION,
    f"`{run.FORMAT}`": run.FORMAT_VERSION,
}

pytestmark = pytest.mark.skipif(not PAGE, reason="the documentation is not part of a wheel")


def python_names():
    """Top-level names, parameters of the functions and public attributes of the classes."""
    objects = {name: getattr(doppelgait, name) for name in doppelgait.__all__} | {"dataset.Dataset": Dataset}
    for name, one in objects.items():
        yield f"python {name}"
        if inspect.isfunction(one):
            yield from (f"python {name} {parameter}" for parameter in inspect.signature(one).parameters)
        elif inspect.isclass(one):
            inner = {*dir(one), *getattr(one, "__dataclass_fields__", ()), *getattr(one, "model_fields", ())}
            foreign = set(dir(BaseModel)) if issubclass(one, BaseModel) else set()
            yield from (f"python {name}.{found}" for found in inner - foreign if not re.match("_|[A-Z]+$", found))


def commands(command=None, path=""):
    """Commands with their options and arguments."""
    command = command or typer.main.get_command(app)
    for name in command.list_commands(None) if hasattr(command, "commands") else ():
        yield from commands(command.get_command(None, name), f"{path} {name}".strip())
    if not hasattr(command, "commands"):
        yield f"command {path}"
        options = {option for one in command.params for option in (*one.opts, *one.secondary_opts)}
        yield from (f"command {path} {option}" for option in options - {"--help", "-h"})


def names(columns):
    """All stable names of this version."""
    return {*python_names(), *commands(), *(f"column {name}" for name in columns)}


def rows(title):
    """Cells of the table of a section, without its head."""
    section = PAGE.partition(f"\n## {title}\n")[2].partition("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines if not line.startswith("| ---")]


def test_no_stable_name_is_gone(dataset):
    listed = set(LIST.read_text().splitlines())
    assert len(listed) > 400
    gone = sorted(listed - names(dataset.index.columns))
    assert gone == [], "write the rename into docs/stability.md and CHANGELOG.md, then take these lines off the list"


def test_the_page_lists_the_names_and_commands_that_are_there():
    table = {row[0]: re.findall(r"`([\w.]+)`", row[1]) for row in rows("Names and commands") if row[0]}
    for kind in ("functions", "values", "packages"):
        assert table[kind]
        assert set(table[kind]) <= set(doppelgait.__all__)
    found = {line.removeprefix("command ") for line in commands() if "-" not in line}
    assert set(table["commands"]) <= found
    assert {f"dataset {name}" for name in table["commands of `dataset`"]} <= found
    of_rooms = rows("Names and commands")[-1][1].split(";")
    for room, listed in zip(("motion", "radar", "model"), of_rooms, strict=True):
        assert {f"{room} {name}" for name in re.findall(r"`(\w+)`", listed)} <= found


def test_the_page_names_the_versions_of_all_formats():
    found = {key: int(row[1]) for row in rows("File formats")[1:] for key in VERSIONS if key.strip("`") in row[0]}
    assert found == VERSIONS


def test_new_names_of_renames_exist():
    new = [name for row in rows("Renames since 0.1.0")[1:] for name in re.findall(r"doppelgait((?:\.\w+)+)", row[1])]
    assert len(new) > 20
    for name in set(new) - {".plugins"}:  # a group of entry points
        found, path = doppelgait, "doppelgait"
        for part in name.strip(".").split("."):
            path = f"{path}.{part}"
            found = getattr(found, part) if hasattr(found, part) else importlib.import_module(path)


def test_versions_agree():
    citation = (ROOT / "CITATION.cff").read_text()
    assert re.search(r"^version: (\S+)$", citation, re.MULTILINE)[1] == doppelgait.__version__
    for name in ("references.md", "_static/references.bib"):
        assert f"Version {doppelgait.__version__}" in (ROOT / "docs" / name).read_text()


if __name__ == "__main__":
    print(*sorted(names(pd.read_parquet(sys.argv[1]).columns)), sep="\n")
