"""Sphinx configuration. Everything is made from the checkout alone: no network, nothing loaded from elsewhere."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / "_ext"))
os.environ.setdefault("MPLBACKEND", "agg")

import doppelgait  # noqa: E402

project = "doppelgait"
author = "The doppelgait developers"
copyright = "the doppelgait developers, Apache-2.0"
version = release = doppelgait.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    "docstrings",
    "equations",
    "api_links",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build", "README.md", "gallery/**", "auto_gallery/**/*.ipynb", 
                    "reference/fields.md", "reference/extended.md"]  # fmt: skip
suppress_warnings = ["config.cache"]
nitpicky = True
nitpick_ignore_regex = [("py:class", r".*<locals>.*")]  # validators inside the type of a field

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist"]
myst_heading_anchors = 4
html_math_renderer = "mathml"
math_eqref_format = "{number}"

autodoc_default_options = {"members": True, "show-inheritance": True, "exclude-members": "model_config"}
autodoc_typehints = "none"  # types and shapes stand in the docstrings
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
python_use_unqualified_type_names = True

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "auto_gallery",
    "filename_pattern": r"\.py$",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "image_scrapers": ("figure_scraper.scrape_figures",),
    "ignore_repr_types": r"matplotlib\.",
    "reset_modules": (),
    "show_signature": False,
    "write_computation_times": False,  # that page loads scripts from elsewhere
    "show_memory": False,
    "remove_config_comments": True,
    "abort_on_example_error": True,
    "min_reported_time": 1,
}

html_theme = "pydata_sphinx_theme"
html_title = f"doppelgait {release}"
html_static_path = ["_static"]
html_css_files = ["doppelgait.css"]
html_show_sourcelink = False
html_sidebars = {"theory": [], "start": [], "concepts": []}  # no pages below them
html_theme_options: dict[str, Any] = {
    "navbar_align": "left",
    "navbar_end": ["theme-switcher"],
    "show_toc_level": 2,
    "header_links_before_dropdown": 6,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}
if os.environ.get("DOPPELGAIT_DOCS_VERSIONS"):  # as docs/publish.py lays them out: SITE/VERSION/ and SITE/versions.json
    html_theme_options["switcher"] = {"json_url": "../versions.json", "version_match": release}
    html_theme_options["check_switcher"] = False
    html_theme_options["navbar_end"] = ["version-switcher", "theme-switcher"]


def write_reference(app: Sphinx, config: Any) -> None:
    """Write the pages that are made from the code, where they changed: docs/reference/."""
    from reference_pages import pages

    for name, text in pages().items():
        place = HERE / "reference" / name
        place.parent.mkdir(parents=True, exist_ok=True)
        if not place.is_file() or place.read_text() != text:
            place.write_text(text)


def link_gallery(app: Sphinx, page: str, source: list[str]) -> None:
    """Lead links to scripts of the gallery, which exist in a clone, to the pages made of them."""
    text = re.sub(r"\]\(((?:\.\./)*)gallery/(plot_\w+)\.py\)", r"](\1auto_gallery/\2.rst)", source[0])
    source[0] = text.replace("](gallery/GALLERY_HEADER.rst)", "](auto_gallery/index.rst)")


def setup(app: Sphinx) -> None:
    """Connect what is made at build time."""
    app.connect("config-inited", write_reference)
    app.connect("source-read", link_gallery)
