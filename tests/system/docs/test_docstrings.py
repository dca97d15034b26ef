"""Docstrings: first clauses are short and say what a thing does, and their examples run."""

import ast
import doctest
import importlib
import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import sklearn.ensemble  # noqa: F401  brings OpenMP, which only then can be limited
from threadpoolctl import threadpool_limits

from checkout import ROOT

ROOM = "doppelgait"
PACKAGE = ROOT / "src" / "doppelgait"
MODULES = sorted(PACKAGE.rglob("*.py"))
WITH_EXAMPLES = [path for path in MODULES if ">>> " in path.read_text()]
MOST_WORDS = 12
STEPS = "choose_line_order count_independent_bins count_independent_columns crop_to_frame detrend_order"
WITHOUT_EXAMPLE = {
    "doppelgait": {"FrozenModel"},  # the base of parameters, shown in pages
    "doppelgait.classify": {"levels"},  # shown in a page; needs torch, an optional package
    "doppelgait.pipeline": {"choose_lowest_prf", "describe_results", "parse_radar", "parse_run"},  # for commands
    "doppelgait.processing": {*STEPS.split(), "gaussian_window", "get_burst_pulses", "needs_alignment"},
}
"""Exported names that no example shows: steps of what others show; no other name joins them."""
ERRORS = {"ConfigError", "DoppelgaitError", "DoppelgaitWarning"}
SHOWS_NOTHING = re.compile(r"(is (not )?None|\.ndim|\.dims|__name__|^isinstance\(.*\)|> 0|== \S+\.shape)$")
"""An example that ends with one of these shows that something was returned, and no value of it."""

Documented = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def first_lines(path: Path) -> Iterator[tuple[str, str]]:
    """Name and first line of every docstring of a module."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, Documented) and (docstring := ast.get_docstring(node)):
            yield getattr(node, "name", path.stem), re.split(r"[.,;:] | \(", docstring.splitlines()[0])[0]


def name_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT / "src").with_suffix("").parts).removesuffix(".__init__")


def test_first_lines_are_short() -> None:
    found = [(name_of(path), *line) for path in MODULES for line in first_lines(path)]
    assert len(found) > 3000
    assert not [line for line in found if len(line[-1].split()) > MOST_WORDS]
    assert not [line for line in found if re.match(r"(What|Whether|How)\b", line[-1])]


def test_exported_names_are_in_examples() -> None:
    examples = "".join(re.findall(r"(?m)^ *(?:>>>|\.\.\.) .*", "".join(path.read_text() for path in WITH_EXAMPLES)))
    for room in (ROOM, *(f"{ROOM}.{path.parent.name}" for path in PACKAGE.glob("*/__init__.py"))):
        module = importlib.import_module(room)
        exported = {name: getattr(module, name) for name in getattr(module, "__all__", ())}
        typed = inspect.isclass if room == ROOM else inspect.isfunction  # classes of other packages are seldom typed
        shown = {name for name, one in exported.items() if typed(one) or inspect.isfunction(one)}
        bare = {name for name in shown - ERRORS if ">>> " not in (exported[name].__doc__ or "")}
        without = {name for name in bare if not re.search(rf"\b{name}\b", examples)}
        assert without == WITHOUT_EXAMPLE.get(room, set()), room


def test_examples_show_values() -> None:
    parser, weak = doctest.DocTestParser(), []
    for path in WITH_EXAMPLES:
        for node in ast.walk(ast.parse(path.read_text())):
            examples = parser.get_examples(ast.get_docstring(node) or "") if isinstance(node, Documented) else []
            weak += [(name_of(path), one.source) for one in examples if SHOWS_NOTHING.search(one.source.strip())]
    assert not weak


@pytest.mark.usefixtures("register")  # which removes the plug-ins that an example registers
@pytest.mark.parametrize("path", WITH_EXAMPLES, ids=name_of)
def test_examples_run(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    module = importlib.import_module(name_of(path))
    with threadpool_limits(1):  # on busy processors threads of boosting wait for each other
        result = doctest.testmod(module, globs={})  # an example imports what it uses
    assert result.attempted > 0
    assert result.failed == 0
