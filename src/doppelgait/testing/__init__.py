"""Contract checks for the plug-ins of other packages.

The physics of a simulator is checked by the package ``doppelgait_conformance``.
"""

from importlib import import_module
from typing import Any

_MODULES = {
    "check_classifier": "results",
    "check_environment": "scene",
    "check_exporter": "results",
    "check_feature": "results",
    "check_impairment": "radar",
    "check_motion_model": "scene",
    "check_motion_reader": "scene",
    "check_path": "scene",
    "check_radar_reader": "radar",
    "check_radar_writer": "radar",
    "check_rcs": "scene",
    "check_waveform": "radar",
}
"""Modules of :mod:`.contracts` with the checks, imported on first use because the checks need all packages."""

__all__ = sorted(_MODULES)


def __dir__() -> list[str]:
    return __all__


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(f"doppelgait.testing.contracts.{_MODULES[name]}"), name)
    raise AttributeError(f"module 'doppelgait.testing' has no attribute {name!r}")
