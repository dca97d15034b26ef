"""Checks that other software can be put through: contracts of plug-ins here, the physics in :mod:`.conformance`."""

from importlib import import_module
from typing import Any

__all__ = [
    "check_classifier",
    "check_environment",
    "check_exporter",
    "check_feature",
    "check_impairment",
    "check_motion_model",
    "check_motion_reader",
    "check_path",
    "check_radar_reader",
    "check_radar_writer",
    "check_rcs",
    "check_waveform",
]


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(import_module("doppelgait.testing.contracts"), name)
    raise AttributeError(f"module 'doppelgait.testing' has no attribute {name!r}")
