"""Train, score, save and apply classifiers of datasets.

Nothing here is imported before it is used.
"""

from importlib import import_module
from typing import Any

_HOME = {
    "CSettings": ".c_code",
    "Decision": ".decide",
    "Evaluation": ".evaluation",
    "Model": ".model",
    "Patch": "..processing.patches",
    "TrackDecision": ".timeline",
    "classify": ".decide",
    "classify_over_time": ".timeline",
    "evaluate": ".evaluation",
    "export_model": ".export",
    "find_shipped_model": ".model_file",
    "levels": "..processing.patches",
    "load_model": ".model_file",
    "read_model_cards": ".model_file",
    "open_model": ".model_file",
    "patch": "..processing.patches",
    "save_model": ".model_file",
    "load_shipped_model": ".model_file",
    "join_decisions": ".timeline",
    "write_report": ".report",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(_HOME[name], "doppelgait.classify"), name)
    raise AttributeError(f"module 'doppelgait.classify' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
