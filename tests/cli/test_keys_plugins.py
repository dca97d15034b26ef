"""The list of plug-ins."""

import json

import pytest
from typer.testing import CliRunner

from doppelgait.cli.app import app
from doppelgait.core.errors import ConfigError
from doppelgait.core.plugins import list_plugin_groups


def run(*arguments):
    done = CliRunner().invoke(app, ["plugins", *arguments], catch_exceptions=False)
    assert done.exit_code == 0
    return done.stdout


def test_all_plugins_are_listed_with_their_parameters():
    rows = json.loads(run("--json"))
    assert [row["group"] for row in rows] == sorted(row["group"] for row in rows)
    assert {(row["group"], row["name"]) for row in rows} == {
        (group, name) for group, plugins in list_plugin_groups().items() for name in plugins
    }
    (parquet,) = (row for row in rows if row["name"] == "parquet")
    assert parquet == {
        "group": "exporter", "name": "parquet", "package": "doppelgait", "version": "1",
        "parameters": ["rows_per_group"],
    }  # fmt: skip


def test_groups_can_be_chosen():
    lines = run("exporter").splitlines()
    assert lines[0].split() == ["group", "name", "package", "version", "parameters"]
    assert {line.split()[0] for line in lines[1:]} == {"exporter"}
    with pytest.raises(ConfigError, match="plugins sonar: no such group; groups are classifier, environment, exporter"):
        run("sonar")
