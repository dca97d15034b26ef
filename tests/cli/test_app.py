"""Commands of other packages."""

import pytest
import typer
from typer.testing import CliRunner

from doppelgait.cli import app as app_module
from doppelgait.core.errors import ConfigError


def test_a_command_of_another_package_exists_where_it_is_installed(monkeypatch):
    monkeypatch.setattr(app_module, "load_commands", dict)
    with pytest.raises(ConfigError, match=r"'reproduce' .* pip install packages/liland2018"):
        typer.main.get_command(app_module.app).get_command(None, "reproduce")
    monkeypatch.setattr(app_module, "load_commands", lambda: {"reproduce": lambda folder: print(f"into {folder}")})
    assert CliRunner().invoke(app_module.app, ["reproduce", "here"]).output == "into here\n"
