"""Rules of this suite: every test has its place, none waits without a limit, none measures time.

Also that no docstring of the package says a sentence twice.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from checkout import ROOT

TESTS = ROOT / "tests"
PACKAGE = ROOT / "src" / "doppelgait"
FREE = {"system", "browser", "reference", "property", "fuzz", "support", "native"}
FILES = sorted(TESTS.rglob("*.py"))
STARTS = {"run", "Popen", "call", "check_call", "check_output"}
WAITS = {"wait", "communicate", "join", "get", "recv", "result", "acquire"}
CLOCKS = {"time", "monotonic", "perf_counter", "process_time", "thread_time"}


def counterpart(path: Path) -> Path | None:
    """What of the package a test file is about: a module, or a folder as a whole, by the longest name that is there.

    ``motion/readers/test_c3d_shared.py`` tests ``motion/readers/c3d.py``; ``radar/test_radar.py`` tests ``radar/``.
    """
    room = PACKAGE / path.parent.relative_to(TESTS)
    words = path.stem.removeprefix("test_").split("_")
    for count in range(len(words), 0, -1):
        name = "_".join(words[:count])
        for found in (room / f"{name}.py", room / name):
            if found.exists():
                return found
        if name == room.name and room.is_dir():
            return room
    return None


def test_every_test_file_has_a_counterpart_in_the_package() -> None:
    mirrored = [path for path in TESTS.rglob("test_*.py") if path.parent != TESTS]
    mirrored = [path for path in mirrored if path.relative_to(TESTS).parts[0] not in FREE]
    assert len(mirrored) > 80
    lost = [str(path.relative_to(ROOT)) for path in mirrored if counterpart(path) is None]
    assert lost == [], "rename them after the module that they test, or move them to tests/system"


@pytest.mark.parametrize(
    ("path", "found"),
    [
        ("motion/readers/test_c3d_shared.py", "motion/readers/c3d.py"),
        ("radar/test_radar.py", "radar"),
        ("radar/test_radar_limits.py", "radar"),
        ("radar/test_nothing.py", None),
        ("nowhere/test_radar.py", None),
    ],
)
def test_the_rule_finds_what_it_should(path: str, found: str | None) -> None:
    place = counterpart(TESTS / path)
    assert (place and str(place.relative_to(PACKAGE))) == found


def test_the_files_that_are_begun_first_exist() -> None:
    named = re.findall(r'"((?:system|browser)/[^"]+\.py)"', (TESTS / "conftest.py").read_text(encoding="utf-8"))
    assert len(named) > 10
    assert [name for name in named if not (TESTS / name).is_file()] == []


def calls(tree: ast.AST) -> Iterator[tuple[str, str, ast.Call]]:
    """Names of all calls: what is called, and of what."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            match node.func:
                case ast.Attribute(value=ast.Name(id=owner), attr=name):
                    yield owner, name, node
                case ast.Attribute(attr=name) | ast.Name(id=name):
                    yield "", name, node


def endless(tree: ast.AST) -> list[str]:
    """Calls that may wait for ever, and processes that Ctrl-C may not reach."""
    found = []
    for owner, name, node in calls(tree):
        given = {keyword.arg for keyword in node.keywords}
        if owner == "subprocess" and name in STARTS:
            found.append(f"line {node.lineno}: subprocess.{name}; use processes.run or processes.started")
        elif isinstance(node.func, ast.Attribute) and name in WAITS and not node.args and not given & {"timeout", None}:
            found.append(f"line {node.lineno}: {name}() has no limit")
        elif name == "urlopen" and "timeout" not in given:
            found.append(f"line {node.lineno}: urlopen has no timeout")
    return found


def timed(tree: ast.AST) -> list[str]:
    """Assertions that a clock is read in, or a difference of readings."""
    clocks = {
        target.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign) and any(o == "time" and n in CLOCKS for o, n, _ in calls(node.value))
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    return [
        f"line {node.lineno}: a timed assertion"
        for node in ast.walk(tree)
        if isinstance(node, ast.Assert)
        and any(isinstance(leaf, ast.BinOp) and isinstance(leaf.op, ast.Sub) for leaf in ast.walk(node.test))
        and (
            any(owner == "time" and name in CLOCKS for owner, name, _ in calls(node.test))
            or any(isinstance(leaf, ast.Name) and leaf.id in clocks for leaf in ast.walk(node.test))
        )
    ]


def test_nothing_waits_without_a_limit_and_no_assertion_is_timed() -> None:
    faults = {}
    for path in FILES:
        text = path.read_text(encoding="utf-8")
        tree, starts = ast.parse(text), path.name in ("processes.py", "test_interrupt.py")  # on purpose
        lines = [] if starts else endless(tree)
        faults[str(path.relative_to(TESTS))] = lines + (timed(tree) if re.search(r"\btime\b", text) else [])
    assert len(faults) > 200
    assert {path: lines for path, lines in faults.items() if lines} == {}


WAITING = """
subprocess.run(x)
process.wait()
thread.join()
queue.get()
urlopen(u)
", ".join(x)
process.wait(3)
queue.get(timeout=1)
"""
TIMED = """
began = time.monotonic()
assert time.monotonic() - began < 2
assert began
assert now - began < 1
"""


def repeats(tree: ast.AST) -> list[str]:
    """Sentences that occur twice in a docstring, of three words or more, up to its first numpydoc section."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (text := ast.get_docstring(node)):
            prose = re.split(r"\n\w[\w ]*\n-{3,}\n", text)[0]
            sentences = [
                " ".join(sentence.split()).rstrip(".")
                for paragraph in re.split(r"\n\s*\n", prose)
                for sentence in re.split(r"(?<=\.)\s+", paragraph)
            ]
            twice = {one for one in sentences if sentences.count(one) > 1 and len(one.split()) >= 3}
            found += [f"{getattr(node, 'name', 'module')}: {one}" for one in sorted(twice)]
    return found


def test_no_docstring_repeats_a_sentence() -> None:
    found = {
        str(path.relative_to(PACKAGE)): twice
        for path in sorted(PACKAGE.rglob("*.py"))
        if (twice := repeats(ast.parse(path.read_text(encoding="utf-8"))))
    }
    assert found == {}, "delete one of the two"


REPEATED = '''
def first():
    """Do it.

    The times of facts
    stay.

    The times of facts stay.
    """

def second():
    """Do it.

    The times of facts stay.

    Parameters
    ----------
    one : int
        The times of facts stay.
    """
'''


def test_the_rules_find_what_they_should() -> None:
    assert repeats(ast.parse(REPEATED)) == ["first: The times of facts stay"]
    assert [line.partition(":")[0] for line in endless(ast.parse(WAITING))] == [f"line {n}" for n in (2, 3, 4, 5, 6)]
    assert [line.partition(":")[0] for line in timed(ast.parse(TIMED))] == ["line 3", "line 5"]
