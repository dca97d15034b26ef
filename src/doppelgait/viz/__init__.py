"""Figures of labelled arrays, without pyplot.

Every function returns a ``matplotlib.figure.Figure``. A function with the parameter ``ax`` plots on
these axes, by default on those of a new figure. The functions are imported on first use, so that
matplotlib is loaded only for a plot.
"""

from importlib import import_module
from typing import Any

_HOME = {
    "stick_frames": "motion",
    "range_lines": "motion",
    "doppler_lines": "motion",
    "scatterer_doppler": "motion",
    "range_time": "ranges",
    "range_doppler_map": "ranges",
    "signature": "ranges",
    "signature_normalisation": "tables",
    "contact_sheet": "tables",
    "cadence_map": "spectra",
    "cadence_spectrum": "spectra",
    "mean_doppler_spectrum": "spectra",
    "feature_scatter": "tables",
    "feature_matrix": "tables",
    "overview": "objects",
    "save_figure": "style",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"doppelgait.viz.{_HOME[name]}"), name)
    raise AttributeError(f"module 'doppelgait.viz' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
