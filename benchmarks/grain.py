"""Size and grain of the package, counted over its syntax trees: modules, lines, functions that are called once.

``python benchmarks/grain.py [FOLDER] [--list]``: FOLDER is the package, by default ``src/doppelgait``; that of an older
checkout gives the figures to compare with. ``--list`` names what is counted.

A function is private when its name starts with one underscore, and called once when its own module names it once, to
call it. Functions that are handed on (validators, plug-ins, callbacks) do not count. An import line is a line of an
import statement that stands in a module.
"""

from __future__ import annotations

import argparse
import ast
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass
class Module:
    """What one file holds."""

    name: str
    room: str
    lines: int
    import_lines: int
    functions: list[tuple[str, int, bool]] = field(default_factory=list)
    """Name, line and whether a decorator stands before it."""
    used: Counter[str] = field(default_factory=Counter)
    called: Counter[str] = field(default_factory=Counter)
    imports: set[str] = field(default_factory=set)
    is_package: bool = False


def read_module(path: Path, package: Path) -> Module:
    """Read a file and count what is in it."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    parts = [package.name, *path.relative_to(package).with_suffix("").parts]
    is_package = parts[-1] == "__init__"
    parts = parts[:-1] if is_package else parts
    room = parts[1] if len(parts) > 1 else "."
    module = Module(".".join(parts), room, text.count("\n"), 0, is_package=is_package)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            module.import_lines += (node.end_lineno or node.lineno) - node.lineno + 1
            module.imports |= set(imported_names(node, module))
        elif isinstance(node, FUNCTIONS):
            module.functions.append((node.name, node.lineno, bool(node.decorator_list)))
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
            module.called[node.func.id if isinstance(node.func, ast.Name) else node.func.attr] += 1
        elif isinstance(node, ast.Name):
            module.used[node.id] += 1
        elif isinstance(node, ast.Attribute):
            module.used[node.attr] += 1
    return module


def imported_names(node: ast.Import | ast.ImportFrom, module: Module) -> Iterator[str]:
    """Yield every dotted name that an import statement may mean."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
        return
    base = node.module or ""
    if node.level:
        here = module.name.split(".")
        up = len(here) - node.level + module.is_package
        base = ".".join([*here[:up], *([base] if base else [])])
    yield base
    yield from (f"{base}.{alias.name}" for alias in node.names)


def count(package: Path) -> tuple[list[Module], list[str], list[str]]:
    """Return all modules, the private functions called once and the modules with one importer."""
    modules = [read_module(path, package) for path in sorted(package.rglob("*.py"))]
    once = [
        f"{module.name}:{line} {name}"
        for module in modules
        for name, line, decorated in module.functions
        if name.startswith("_")
        and not name.startswith("__")
        and not decorated
        and module.used[name] == module.called[name] == 1
    ]
    known = {module.name for module in modules}
    importers: dict[str, set[str]] = defaultdict(set)
    for module in modules:
        for name in module.imports & known - {module.name}:
            importers[name].add(module.name)
    packages = {module.name for module in modules if module.is_package}
    single = [f"{name} <- {min(importers[name])}" for name in sorted(known - packages) if len(importers[name]) == 1]
    return modules, once, single


def main() -> None:
    """Print the figures of all rooms and of the whole."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("package", nargs="?", type=Path, default=Path(__file__).parents[1] / "src" / "doppelgait")
    parser.add_argument("--list", action="store_true", help="name what is counted")
    arguments = parser.parse_args()
    modules, once, single = count(arguments.package.resolve())
    heads = ("modules", "lines", "functions", "once", "share", "1 importer", "imports")
    print(f"{'room':<12}" + "".join(f"{head:>11}" for head in heads))
    rooms = [*sorted({module.room for module in modules}), "all"]
    for room in rooms:
        own = [module for module in modules if room in (module.room, "all")]
        names = {module.name for module in own}
        functions = sum(len(module.functions) for module in own)
        called_once = sum(line.partition(":")[0] in names for line in once)
        alone = sum(line.partition(" ")[0] in names for line in single)
        lines = sum(module.lines for module in own)
        imports = sum(module.import_lines for module in own)
        print(
            f"{room:<12}{len(own):>11}{lines:>11}{functions:>11}{called_once:>11}"
            f"{called_once / max(functions, 1):>11.1%}{alone:>11}{imports / max(lines, 1):>11.1%}"
        )
    if arguments.list:
        print("\nPrivate functions called once:", *once, sep="\n  ")
        print("\nModules with one importer:", *single, sep="\n  ")


if __name__ == "__main__":
    main()
