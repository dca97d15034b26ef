"""What stands in packages/ uses names of doppelgait that an ``__init__`` exports, and no others."""

import ast
from importlib import import_module

import pytest

from checkout import ROOT

FILES = sorted((ROOT / "packages").rglob("*.py"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(ROOT / "packages").as_posix())
def test_only_exported_names_are_imported(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            assert not [name.name for name in node.names if name.name.startswith("doppelgait.")]
        elif isinstance(node, ast.ImportFrom) and f"{node.module}.".startswith("doppelgait."):
            assert {name.name for name in node.names} <= set(import_module(str(node.module)).__all__), node.module
