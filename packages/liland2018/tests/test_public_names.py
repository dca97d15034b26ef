"""What stands in packages/ uses names of doppelgait that an ``__init__`` exports, and no others."""

import ast
from importlib import import_module

import pytest

from checkout import ROOT

FILES = sorted((ROOT / "packages").rglob("*.py"))


def list_imports(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((name.name, None) for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from ((node.module, name.name) for name in node.names)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_only_exported_names_are_imported(path):
    found = [(module, name) for module, name in list_imports(path) if f"{module}.".startswith("doppelgait.")]
    assert [one for one in found if one[1] not in import_module(one[0]).__all__] == []


def test_every_module_is_looked_at():
    assert len(FILES) > 20
