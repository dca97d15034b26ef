"""One page of the Python reference per public package: what its ``__all__`` lists."""

from __future__ import annotations

import inspect
from importlib import import_module
from types import ModuleType

from docstrings import escape_bars, words_of_constant

TOP = "doppelgait"
PACKAGES = (
    TOP, "doppelgait.motion", "doppelgait.motion.models", "doppelgait.motion.readers", "doppelgait.scene",
    "doppelgait.scene.environment", "doppelgait.radar", "doppelgait.radar.waveforms", "doppelgait.radar.impairments",
    "doppelgait.radar.fit", "doppelgait.radar.readers", "doppelgait.radar.xethru", "doppelgait.processing",
    "doppelgait.processing.detect", "doppelgait.processing.track", "doppelgait.features", "doppelgait.pipeline",
    "doppelgait.viz", "doppelgait.data", "doppelgait.dataset",
    "doppelgait.dataset.verify", "doppelgait.classify", "doppelgait.testing", "doppelgait_conformance",
)  # fmt: skip
"""Packages whose ``__all__`` is public, in the order of the data."""
BESIDE = (
    "doppelgait.dataset.export", "doppelgait.dataset.importing", "doppelgait.core.errors", "doppelgait.core.units",
    "doppelgait.core.plugins", "doppelgait.core.rng", "doppelgait.features.feature_set", "doppelgait.features.extended",
)  # fmt: skip
"""Modules that users meet without an ``__all__`` of their package: what they define is public."""


def public_names(module: ModuleType) -> list[str]:
    """Public objects of a module; for the top package those that are no packages themselves."""
    listed = getattr(module, "__all__", None)
    if listed is None:
        names = [name for name, value in vars(module).items() if _own(module, name, value)]
        return sorted(names)
    return [name for name in listed if not inspect.ismodule(getattr(module, name)) and name != "__version__"]


def _own(module: ModuleType, name: str, value: object) -> bool:
    return not name.startswith("_") and getattr(value, "__module__", None) == module.__name__ and callable(value)


def homes() -> dict[str, tuple[str, str]]:
    """Where every public object is documented: its defining name -> (module of the page, name there).

    The package with the shortest name has the page, but for the top package, which only lists names of the others.
    """
    found: dict[str, tuple[str, str]] = {}
    for place in (*PACKAGES, *BESIDE):
        module = import_module(place)
        for name in public_names(module):
            key = defined_as(module, name)
            if key not in found or (found[key][0] == TOP and place != TOP):
                found[key] = (place, name)
    return found


def defined_as(module: ModuleType, name: str) -> str:
    """Full name of an object where it is defined; constants, which do not know, where they are listed."""
    value = getattr(module, name)
    if (inspect.isclass(value) or inspect.isfunction(value)) and value.__module__.startswith("doppelgait"):
        return f"{value.__module__}.{value.__qualname__}"
    return f"{module.__name__}.{name}"


def api_page(place: str, found: dict[str, tuple[str, str]]) -> str:
    """Write the page of one package as reStructuredText."""
    module = import_module(place)
    own: list[tuple[str, str]] = []
    others: list[tuple[str, str]] = []
    for name in public_names(module):
        home = found[defined_as(module, name)]
        (own if home[0] == place else others).append((name, ".".join(home)))
    lines = [place, "=" * len(place), "", f".. automodule:: {place}", "   :no-members:", ""]
    if others:
        lines += ["Also here: " + ", ".join(f":py:obj:`~{home}`" for _, home in others) + ".", ""]
    if own:
        lines += [
            ".. list-table::",
            "   :widths: auto",
            "",
            *(line for name, _ in own for line in _listed(module, name)),
            "",
        ]
    for name, _ in own:
        lines += [f".. {_directive(getattr(module, name))}:: {place}.{name}", ""]
    return "\n".join(lines) + "\n"


def _listed(module: ModuleType, name: str) -> list[str]:
    """Row of the list at the top of a page: name and first paragraph."""
    value = getattr(module, name)
    constant = _directive(value) == "autodata"
    words = "\n".join(words_of_constant(name, value)) if constant else value.__doc__
    first = " ".join(inspect.cleandoc(words or "").split("\n\n")[0].split())
    return [f"   * - :py:obj:`{name} <{module.__name__}.{name}>`", f"     - {escape_bars(first)}"]


def _directive(value: object) -> str:
    if not str(getattr(value, "__module__", "")).startswith(TOP):
        return "autodata"  # a name for a type of others, or a table
    if inspect.isclass(value):
        return "autoexception" if issubclass(value, BaseException) else "autoclass"
    return "autofunction" if callable(value) else "autodata"
