"""The ratchet: sizes that only fall (``tests/size.toml``). Who adds lines pays for them in the same change.

``python tests/test_size.py`` prints today's table; ``--lower`` writes every figure that fell into ``size.toml``.
"""

import ast
import io
import re
import sys
import tokenize
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
ROOT = TESTS.parent
PACKAGE = ROOT / "src" / "doppelgait"
SOURCES = (".py", ".js", ".css", ".html", ".c", ".h", ".cpp", ".hpp")
SLACK = {"lines": 100, "modules": 5, "words": 100, "style": 50, "comments": 200}
"""A figure this far below its budget asks for a lower budget."""


def list_sources(folder: Path, *endings: str) -> list[Path]:
    return [path for path in folder.rglob("*") if path.suffix in endings and path.is_file()]


def count_lines(paths: list[Path]) -> int:
    return sum(path.read_text(encoding="utf-8").count("\n") for path in paths)


def count_words(text: str) -> int:
    return len(text.split())


def usage_pages() -> Iterator[Path]:
    """Pages of `docs` and `docs/howto`; theory and glossary are read in parts."""
    for path in sorted([*(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / "howto").glob("*.md")]):
        if path.stem not in ("theory", "glossary"):
            yield path


def list_public_names() -> set[str]:
    """Names that an ``__init__`` of the package exports or defines lazily."""
    return {
        word
        for path in PACKAGE.rglob("__init__.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) in ("__all__", "_HOME", "_LAZY")
        for word in re.findall(r"'(\w+)'", ast.unparse(node.value))
    }


def count_internal_docstrings(path: Path, public: set[str]) -> int:
    """Lines of docstrings of what nothing exports; tables of keys, commands and plug-ins are public without one."""
    lines = 0

    def visit(node: ast.AST, inside: bool) -> None:
        nonlocal lines
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                heads = [*map(ast.unparse, child.decorator_list), *map(ast.unparse, getattr(child, "bases", []))]
                shown = any(re.search(r"plugin|command|callback|(Model|Config|Parameters)\b", head) for head in heads)
                shown |= path.name == "scorer.py"  # copied to users, next to their model
                exported = shown or child.name in public or (inside and not child.name.startswith("_"))
                if ast.get_docstring(child) and not exported:
                    text = child.body[0]
                    lines += (text.end_lineno or 0) - text.lineno + 1
                visit(child, exported and isinstance(child, ast.ClassDef))

    visit(ast.parse(path.read_text(encoding="utf-8")), inside=False)
    return lines


def count_comments(text: str) -> int:
    """Comments that explain; switches of tools are none."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    comments = [token.string for token in tokens if token.type == tokenize.COMMENT]
    return sum(not re.match(r"#\s*(fmt|type|noqa|pragma)", comment) for comment in comments)


@cache
def measure() -> dict[str, dict[str, int]]:
    """Measure every figure of ``size.toml``."""
    rooms = sorted(path.parent for path in PACKAGE.glob("*/__init__.py"))
    lines = {room.name: count_lines(list_sources(room, ".py")) for room in rooms}
    lines["package"] = count_lines(list_sources(PACKAGE, ".py"))
    lines["viewer static"] = count_lines(list_sources(PACKAGE / "viewer" / "static", *SOURCES))
    native = [path for name in ("src", "native") for path in list_sources(ROOT / name, ".c", ".h", ".cpp", ".hpp")]
    lines["native"] = count_lines(native)
    lines |= {name: count_lines(list_sources(ROOT / name, ".py")) for name in ("studies", "tools", "benchmarks")}
    beside = list_sources(ROOT / "packages", *SOURCES)
    tests = [path for path in beside if "tests" in path.relative_to(ROOT).parts]
    lines["tests"] = count_lines([*list_sources(TESTS, ".py"), *tests])
    lines["packages"] = count_lines([path for path in beside if path not in tests])
    lines["docs code"] = count_lines(
        [
            *(ROOT / "docs").glob("*.py"),
            *list_sources(ROOT / "docs/_ext", ".py"),
            *list_sources(ROOT / "docs/gallery", ".py"),
        ]
    )
    modules = {room.name: len(list_sources(room, ".py")) for room in rooms}
    modules["package"] = len(list_sources(PACKAGE, ".py"))
    news = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1]
    words = {page.relative_to(ROOT).as_posix(): count_words(page.read_text(encoding="utf-8")) for page in usage_pages()}
    words = {page: max(count, 2500) for page, count in words.items()} | {"newest release": max(count_words(news), 900)}
    words = {page: count for page, count in words.items() if page == "newest release" or count > 2500}
    code = [path.read_text(encoding="utf-8") for path in list_sources(PACKAGE, ".py")]
    public = list_public_names()
    commands = re.findall(r"\.command\(.*?\)\(\w+\.(\w+)\)", "\n".join(code))  # their docstrings are the help
    commands += re.findall(r"\.(\w+)", " ".join(re.findall(r"for command in \((.*)\):", "\n".join(code))))
    commands += re.findall(r"\.(\w+)", " ".join(re.findall(r"for command in \((.*)\):", "\n".join(code))))
    style = {
        "fmt skips": sum(text.count("# fmt: skip") for text in code),
        "lines over 100 characters per 10 000": round(
            1e4 * sum(len(line) > 100 for text in code for line in text.split("\n")) / lines["package"]
        ),
        "docstring lines that nothing exports": sum(
            count_internal_docstrings(path, public | set(commands)) for path in list_sources(PACKAGE, ".py")
        ),
        "exported names": len(public),
        "lines per comment": round(lines["package"] / sum(count_comments(text) for text in code)),
    }
    return {"lines": lines, "modules": modules, "words": words, "style": style}


BUDGETS = tomllib.loads((TESTS / "size.toml").read_text(encoding="utf-8")) if (TESTS / "size.toml").exists() else {}


@pytest.mark.parametrize("kind", ["lines", "modules", "words", "style"])
def test_sizes_only_fall(kind: str) -> None:
    measured, budget = measure()[kind], BUDGETS[kind]
    above = {name: (count, budget.get(name)) for name, count in measured.items() if count > budget.get(name, -1)}
    assert not above, "above the budget (now, budget): remove as much as you add, in the same package"
    below = {
        name: (measured.get(name, 0), most)
        for name, most in budget.items()
        if measured.get(name, 0) <= most - SLACK[kind]
    }
    assert not below, "lower the budget: python tests/test_size.py --lower"


def write(table: dict[str, dict[str, int]]) -> str:
    return "\n".join(
        f"[{kind}]\n" + "".join(f'"{name}" = {count}\n' for name, count in figures.items())
        for kind, figures in table.items()
    )


if __name__ == "__main__":
    found = measure()
    if "--lower" in sys.argv:
        lowered = {
            kind: {n: min(c + 30 * ("per 10" in n), BUDGETS.get(kind, {}).get(n, c)) for n, c in figures.items()}
            for kind, figures in found.items()
        }
        (TESTS / "size.toml").write_text(write(lowered), encoding="utf-8")
    print(write(found))
