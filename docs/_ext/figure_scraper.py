"""Figures of the gallery: those of pyplot, and those of ``doppelgait.viz``, which are found by their type."""

from __future__ import annotations

from typing import Any
from weakref import WeakSet

from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst

DPI = 90
_saved: WeakSet[Figure] = WeakSet()


def scrape_figures(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Save every figure of pyplot, or among the variables, that was not there after the last block.

    Parameters
    ----------
    block, block_vars, gallery_conf
        As sphinx-gallery hands them to an image scraper.

    Returns
    -------
    str
        reStructuredText that shows the figures.
    """
    paths = []
    for value in [*block_vars["example_globals"].values(), *map(plt.figure, plt.get_fignums())]:
        if isinstance(value, Figure) and value not in _saved:
            _saved.add(value)
            path = next(block_vars["image_path_iterator"])
            value.savefig(path, dpi=DPI)
            paths.append(path)
    return str(figure_rst(paths, gallery_conf["src_dir"]))
