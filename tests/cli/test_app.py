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


def test_a_shell_completes_commands():
    words = {"_DOPPELGAIT_COMPLETE": "complete_bash", "COMP_WORDS": "doppelgait sim", "COMP_CWORD": "1"}
    assert CliRunner().invoke(app_module.app, env=words).output.split() == ["simulate"]


def test_the_demo_says_what_one_sees_and_opens_the_viewer(tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr("doppelgait.cli.view.view", lambda path, gate: opened.append(path))
    monkeypatch.setattr("doppelgait.cli.figures.save_figures", lambda *analysed, **look: [])
    result = CliRunner().invoke(app_module.app, ["demo", "-o", str(tmp_path), "--open"], catch_exceptions=False)
    file = tmp_path / "recording.h5"
    said, who, view = result.stderr.splitlines()[-3:]
    assert "the bright line is the torso" in said
    assert (who, view) == (f"who is who: doppelgait classify {file}", f"in the browser: doppelgait view {file}")
    assert opened == [file]
