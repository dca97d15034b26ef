"""Type checkers know the names of the package, though they are imported on first use."""

import ast
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

from checkout import ROOT, SUPPORT


def test_lint_checks_the_script_of_a_user() -> None:
    """``typed_script.py`` has uses and mistakes; `make test` runs mypy on it, once for package and script."""
    checked = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["mypy"]
    assert checked["strict"]
    assert {ROOT / name for name in checked["files"]} >= {ROOT / "src" / "doppelgait", SUPPORT / "typed_script.py"}
    assert (ROOT / "src" / "doppelgait" / "py.typed").is_file()  # else a checker of types does not read the package


@pytest.mark.parametrize("package", ["doppelgait", "doppelgait.classify", "doppelgait.viz"])
def test_the_stub_has_the_names_of_the_package(package: str) -> None:
    module = import_module(package)
    stub = ast.parse((ROOT / "src" / Path(*package.split(".")) / "__init__.pyi").read_text(encoding="utf-8"))
    found = {}
    for node in stub.body:
        if isinstance(node, ast.ImportFrom):
            found |= {alias.asname: getattr(import_module(str(node.module)), alias.name) for alias in node.names}
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            found[node.target.id] = getattr(module, node.target.id)
    assert set(found) - {"PLUGIN_ROOMS"} == set(module.__all__)
    for name, value in found.items():  # all modules are imported by now: none of them may take the place of a name
        assert getattr(module, name) is value, name
