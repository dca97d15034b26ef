"""Reasons for the page, which does not learn where on this computer things lie."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from doppelgait.viewer.source import Opened


def without_places(text: str, opened: Opened | None) -> str:
    """Text with the folders of what is open, and the working folder, by their last name.

    Parameters
    ----------
    text : str
    opened : Opened or None
    """
    browser = None if opened is None else opened.browser
    return without_folders(text, *(() if browser is None else browser.folders))


def without_folders(text: str, *folders: Path) -> str:
    """Text with some folders, as given or in full, and the working folder by their last name.

    Parameters
    ----------
    text : str
    *folders : Path
    """
    forms = {str(form): folder.resolve().name for folder in (*folders, Path()) for form in (folder, folder.resolve())}
    for form in sorted(forms, key=len, reverse=True):  # a folder before those around it
        if len(form) > 1:  # neither "." nor "/"
            text = text.replace(form, forms[form])
    return text
