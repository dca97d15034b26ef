"""doppelgait: labelled micro-Doppler radar data of people and dogs.

The data come from motion capture or gait models. Everything here is imported on first use, so that
``import doppelgait`` and ``doppelgait --help`` stay fast.

Labels such as E-18 in docstrings are the equations of docs/theory.md.
"""

from importlib import import_module
from typing import Any

__version__ = "0.3.0"

_LAZY = {
    "motion": "doppelgait.motion",
    "Scene": "doppelgait.scene",
    "Target": "doppelgait.scene",
    "Radar": "doppelgait.radar",
    "Recording": "doppelgait.radar",
    "concat": "doppelgait.radar",
    "simulate": "doppelgait.pipeline",
    "analyze": "doppelgait.pipeline",
    "Analysis": "doppelgait.processing",
    "live": "doppelgait.classify.live",
    "open_dataset": "doppelgait.dataset",
    "Conditions": "doppelgait.pipeline",
    "Gate": "doppelgait.processing",
    "Noise": "doppelgait.pipeline",
    "Result": "doppelgait.pipeline",
    "Run": "doppelgait.pipeline",
    "ConfigError": "doppelgait.core.errors",
    "DoppelgaitError": "doppelgait.core.errors",
    "DoppelgaitWarning": "doppelgait.core.errors",
    "FrozenModel": "doppelgait.core.config",
    "Streams": "doppelgait.core.rng",
    "rng": "doppelgait.core.rng",
    "plugin": "doppelgait.core.plugins",
    "view": "doppelgait.viewer.server",
}
PLUGIN_ROOMS: tuple[str, ...] = (
    "doppelgait.features.feature_set",
    "doppelgait.classify.training",
    "doppelgait.dataset.export",
    "doppelgait.motion.models",
    "doppelgait.motion.paths",
    "doppelgait.motion.readers",
    "doppelgait.radar.impairments",
    "doppelgait.radar.parameters",
    "doppelgait.radar.readers",
    "doppelgait.scene.environment",
    "doppelgait.scene.rcs",
)
"""Modules in which the groups of plug-ins are declared (:mod:`doppelgait.core.plugins`)."""

_SUBPACKAGES = {
    "classify",
    "core",
    "data",
    "dataset",
    "features",
    "motion",
    "pipeline",
    "processing",
    "radar",
    "scene",
    "testing",
    "viewer",
    "viz",
}

__all__ = ["__version__", *sorted(set(_LAZY) | _SUBPACKAGES)]


def __getattr__(name: str) -> Any:
    if name in _SUBPACKAGES:
        return import_module(f"doppelgait.{name}")
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module 'doppelgait' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
