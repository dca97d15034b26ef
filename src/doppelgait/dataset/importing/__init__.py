"""Datasets from the user's own recordings."""

from doppelgait.dataset.importing.config import ImportConfig
from doppelgait.dataset.importing.labels import LabelEntry, read_labels
from doppelgait.dataset.importing.run import ImportReport, import_dataset

__all__ = ["ImportConfig", "ImportReport", "LabelEntry", "import_dataset", "read_labels"]
