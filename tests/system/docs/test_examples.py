"""The code in start.md and in the how-tos does what it says: every block of a page, in order, in one empty folder."""

import importlib
import os
import re
import shlex
import shutil
import sys
import tomllib
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import typer.main

import processes
from checkout import ROOT
from doppelgait.classify.alarm import load_day
from doppelgait.cli.app import app
from doppelgait.core import plugins
from doppelgait.core.config import write_toml
from doppelgait.viz import objects  # noqa: F401  registers what plot() draws, for all pages

DOCS = ROOT / "docs"
PAGES = [DOCS / "start.md", *sorted((DOCS / "howto").glob("*.md"))]
BLOCK = re.compile(r"(?:^<!-- (?P<mark>[^\n]*) -->\n)?^```(?P<language>\w+)\n(?P<text>.*?)^```$", re.M | re.S)
NEEDS = re.compile(r"(?<=[:,] )\w+(?=,|$)")
"""Packages of a mark ``needs: torch, lightning``; without them its block is left out."""
SMALLER = {"examples_per_class": "16"}
"""What makes the pages' datasets quick; the pages say how many a reader gets."""


Run = Callable[[str], None]


def blocks_of(page: str) -> list[tuple[str, str, str]]:
    """Mark, language and text of every block of a page."""
    return [(found["mark"] or "", found["language"], found["text"]) for found in BLOCK.finditer(page)]


def commands_of(text: str) -> list[list[str]]:
    """Words of every command of a shell block; comments and ends of lines with a backslash are understood."""
    lines = text.replace("\\\n", " ").splitlines()
    return [words for line in lines if (words := shlex.split(line, comments=True))]


QUICKER = {
    ("dataset", "plan"): ["--pilot", "1"],
    ("dataset", "build"): ["--executor", "serial"],
    ("evaluate",): ["--models", "six-logistic"],
    ("model", "alarm"): ["--day", "short-day.toml"],
}
"""What is added to a command so that it takes seconds, in this process."""


def quick(words: list[str]) -> list[str]:
    """The words of a command with less to do; sheets of signatures are drawn elsewhere among the tests."""
    if words[:2] == ["dataset", "verify"] and "--figures" in words:
        at = words.index("--figures")
        return words[:at] + words[at + 2 :]
    return next(([*words, *more] for start, more in QUICKER.items() if tuple(words[: len(start)]) == start), words)


@pytest.fixture
def run_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, register: Any) -> Run:
    """Use a page's blocks in an empty folder; what they register is forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path / "installed"))
    shutil.copytree(ROOT / "examples", tmp_path / "examples")  # the pages begin in a clone
    day, _ = load_day()
    short = day.model_copy(update={"episodes": tuple(one for one in day.episodes if one.duration_s <= 10)})
    (tmp_path / "short-day.toml").write_text(write_toml(short.model_dump(mode="json", exclude_none=True)))
    monkeypatch.setattr(plugins, "_LOADED", set(plugins._LOADED))
    namespace: dict[str, Any] = {"__name__": "__main__"}

    def use(page: str) -> None:
        for mark, language, text in blocks_of(page):
            if mark.startswith("file: "):
                place = Path(mark.removeprefix("file: "))
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_text(re.sub(r"(examples_per_class = )\d+", rf"\g<1>{SMALLER['examples_per_class']}", text))
            elif mark.startswith("not run: ") or language == "text" or not all(map(find_spec, NEEDS.findall(mark))):
                continue
            elif language == "python":
                exec(compile(text, "block", "exec", dont_inherit=True), namespace)
            elif language == "sh":
                for words in commands_of(text):
                    _run_command(words, tmp_path)
            else:
                pytest.fail(f"a block of {language!r} says neither 'file' nor 'not run':\n{text}")

    return use


def _run_command(words: list[str], folder: Path) -> None:
    if words[:2] == ["pip", "install"]:
        _install(Path(words[-1]), folder / "installed")
    elif words[0] == "doppelgait":
        code = app(quick(words[1:]), standalone_mode=False)
        assert not code, f"{shlex.join(words)}: exit status {code}"
    elif words[0] in ("python", "cc", "./selftest"):
        if words[0] != "python" and shutil.which("cc") is None:
            if os.environ.get("CI") == "true":
                pytest.fail("no C compiler: the page's C code cannot be tried")
            return
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        line = " ".join(words)  # with its pipes
        done = processes.run(["sh", "-c", line], cwd=folder, env=os.environ | {"PATH": path}, timeout=300)
        assert done.returncode == 0, f"{line}: exit status {done.returncode}"
    else:
        pytest.fail(f"{shlex.join(words)}: no command that these tests can run; mark the block 'not run'")


def _install(source: Path, target: Path) -> None:
    """What ``pip install`` leaves of a package that is one module: the module and its entry points."""
    project = tomllib.loads((source / "pyproject.toml").read_text())["project"]
    facts = target / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    groups = project["entry-points"].items()
    lines = [
        f"[{group}]\n" + "".join(f"{name} = {place}\n" for name, place in items.items()) for group, items in groups
    ]
    (facts / "entry_points.txt").write_text("\n".join(lines))
    for module in source.glob("*.py"):
        (target / module.name).write_text(module.read_text())
        sys.modules.pop(module.stem, None)
    if plugins.ENTRY_POINTS in project["entry-points"]:
        importlib.invalidate_caches()
        plugins._load_packages()


@pytest.mark.parametrize(
    "page",  # `make test` runs the commands and the code of one page
    [pytest.param(p, id=p.stem, marks=[pytest.mark.release] * (p.stem != "own-impairment")) for p in PAGES],
)
def test_page_does_what_it_says(page: Path, run_page: Run) -> None:
    run_page(page.read_text())


def _command(words: list[str]) -> tuple[Any, list[str]]:
    """The command of a line and its own words."""
    found: Any = typer.main.get_command(app)
    while words and hasattr(found, "commands") and (inner := found.get_command(None, words[0])):
        found, words = inner, words[1:]
    return found, words


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_and_options_exist(page: Path) -> None:
    shell = [text for _, language, text in blocks_of(page.read_text()) if language == "sh"]
    lines = [words for text in shell for words in commands_of(text)]
    for line in (words for words in lines if words[0] == "doppelgait"):
        command, words = _command(line[1:])
        known = {name for parameter in command.params for name in parameter.opts} | {"--help"}
        unknown = {word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)} - known
        assert not hasattr(command, "commands"), f"{page.name}: {shlex.join(line)}: no such command"
        assert not unknown, f"{page.name}: {shlex.join(line)}: no option {unknown}"
