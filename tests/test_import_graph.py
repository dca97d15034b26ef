"""No circle of imports in the package, and no functions that depend on the processor.

Every import counts, wherever it stands, and a package's ``__init__`` counts like any module. `make check` holds the
folders apart in the same way (``acyclic_siblings`` in ``pyproject.toml``).
"""

import re
from collections.abc import Iterable, Mapping
from graphlib import CycleError, TopologicalSorter

import grimp
import pytest

from checkout import ROOT

PACKAGE = ROOT / "src" / "doppelgait"


def circle(imports: Mapping[str, Iterable[str]]) -> list[str]:
    """One circle of the graph, from module to module; empty if there is none."""
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


@pytest.fixture(scope="module")
def imports() -> dict[str, set[str]]:
    graph = grimp.build_graph("doppelgait", cache_dir=None)
    found = {module: set(graph.find_modules_directly_imported_by(module)) for module in graph.modules}
    found["doppelgait._core"].discard("doppelgait._core")  # its compiled modules, which are not in the graph
    return found


def test_the_package_has_no_circle(imports: dict[str, set[str]]) -> None:
    assert circle(imports) == []


def test_imports_in_functions_and_for_types_count(imports: dict[str, set[str]]) -> None:
    assert "doppelgait.viewer.app" in imports["doppelgait.viewer.server"]  # in a function
    assert "doppelgait.dataset.plan" in imports["doppelgait.dataset.executors"]  # for types


def test_a_circle_is_found() -> None:
    assert sorted(set(circle({"a": ["b"], "b": ["c"], "c": ["a"], "d": ["a"]}))) == ["a", "b", "c"]
    assert circle({"a": ["b", "c"], "b": ["c"]}) == []


def test_no_module_reaches_another_by_name() -> None:
    """Imports by name are hidden from the layers; plug-ins and lazy packages may."""
    allowed = {"core/plugins.py"}
    modules = [path for path in PACKAGE.rglob("*.py") if path.name != "__init__.py"]
    users = {path.relative_to(PACKAGE).as_posix() for path in modules if "import_module" in path.read_text()}
    assert users == allowed


def test_results_do_not_depend_on_numpys_choice_of_functions() -> None:
    """NumPy's functions of real numbers have other last digits where the processor has AVX-512: use `core/units.py`."""
    name = re.compile(r"np\.((arc\w+|tan|exp2|expm1|log(2|10|1p)?|power|cbrt|angle|i0)\(|exp\((?!-?[\d.]*j))")
    elsewhere = re.compile("^(classify|cli|viewer|viz|testing)/|/(readers|fit|xethru|verify)/|/sound.py")
    paths = [path for path in PACKAGE.rglob("*.py") if not elsewhere.search(path.relative_to(PACKAGE).as_posix())]
    lines = [line for path in paths for line in path.read_text().split("\n") if ">>>" not in line]
    assert [line for line in lines if name.search(line)] == []
