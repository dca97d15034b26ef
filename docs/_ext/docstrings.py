"""What reStructuredText must not see in our docstrings, and words for constants, which have none of their own."""

from __future__ import annotations

import inspect
import re
import sys
from typing import Any

from sphinx.application import Sphinx
from sphinx.errors import PycodeError
from sphinx.pycode import ModuleAnalyzer

QUOTED = re.compile(r"(``.*?``|:\w+:`[^`]*`|`[^`]*`)")


def clean(app: Sphinx, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Escape the bars of magnitudes; give a constant the words below its assignment."""
    if what == "data":
        lines[:] = words_of_constant(name.rpartition(".")[2], value)
    in_math = False
    for number, line in enumerate(lines):
        in_math = line.startswith(".. math::") or (in_math and (not line.strip() or line.startswith(" ")))
        if not in_math:
            lines[number] = escape_bars(line)


def escape_bars(line: str) -> str:
    """``|x|`` would be a substitution."""
    parts = QUOTED.split(line)
    return "".join(part if number % 2 else part.replace("|", r"\|") for number, part in enumerate(parts))


def words_of_constant(name: str, value: Any) -> list[str]:
    """Find the string below an assignment, in any module of the package."""
    for module in [module for key, module in sys.modules.items() if key.startswith("doppelgait")]:
        if vars(module).get(name) is not value or inspect.ismodule(value):
            continue
        try:
            analyzer = ModuleAnalyzer.for_module(module.__name__)
            analyzer.analyze()
        except PycodeError:
            continue
        if ("", name) in analyzer.attr_docs:
            return list(analyzer.attr_docs["", name])
    return [""]


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect before napoleon, which works on the same lines."""
    app.connect("autodoc-process-docstring", clean, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
