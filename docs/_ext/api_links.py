"""References in docstrings: to the page of a public object by any of its names; as plain code to what is internal.

A reference to something that does not exist in the package stays a warning.
"""

from __future__ import annotations

from functools import lru_cache
from importlib import import_module
from typing import Any

from api_pages import homes
from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx


@lru_cache(maxsize=1)
def _homes() -> dict[str, str]:
    return {defined: ".".join(home) for defined, home in homes().items()}


def _object(target: str) -> Any:
    """Find the object of a dotted name; None where there is none."""
    parts = target.split(".")
    for length in range(len(parts), 0, -1):
        try:
            value: Any = import_module(".".join(parts[:length]))
        except ImportError:
            continue
        for part in parts[length:]:
            fields = getattr(value, "model_fields", {}) | getattr(value, "__dataclass_fields__", {})
            value = fields[part] if part in fields else getattr(value, part, None)
        return value
    return None


def _names(target: str, node: pending_xref) -> list[str]:
    """List full names that a name may mean in its module and class."""
    module, owner = node.get("py:module"), node.get("py:class")
    around = [name for name in (f"{module}.{owner}" if owner else None, module) if name]
    return [target, *(f"{place}.{target}" for place in around)]


def resolve(app: Sphinx, env: Any, node: pending_xref, contnode: nodes.Element) -> nodes.Node | None:
    """Resolve what Sphinx could not."""
    if node.get("refdomain") != "py":
        return None
    target = str(node.get("reftarget", ""))
    domain = env.get_domain("py")
    for name in _names(target, node):
        value = _object(name) if name.startswith("doppelgait") else None
        if value is None:
            continue
        defined = f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', '')}"
        home = _homes().get(defined) or _homes().get(name)
        if home in domain.objects:
            entry = domain.objects[home]
            from sphinx.util.nodes import make_refnode

            return make_refnode(app.builder, node["refdoc"], entry.docname, entry.node_id, contnode, home)
        return contnode
    return None if target.startswith("doppelgait") else contnode


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect."""
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
