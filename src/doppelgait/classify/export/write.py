"""Exports of a trained model as folders."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from doppelgait import __version__
from doppelgait.classify.export import scorer
from doppelgait.classify.model import Model
from doppelgait.classify.model_file import save_model
from doppelgait.core.errors import ConfigError
from doppelgait.core.own_folder import check_out, complete_folder

FORMS = ("numpy", "onnx")
LISTING, FORMAT = "export.json", "doppelgait-model-export"


@dataclass(frozen=True)
class Export:
    """Written export.

    Parameters
    ----------
    folder : Path
    files : tuple of str
    """

    folder: Path
    files: tuple[str, ...]


def export_model(model: Model, form: str, folder: str | Path) -> Export:
    """Write a model in a form for other programs.

    Parameters
    ----------
    model : Model
    form : {"numpy", "onnx"}
        ``numpy``: the model file and a scorer that needs NumPy alone. ``onnx``: one graph from features and pictures to
        calibrated probabilities (:func:`doppelgait.classify.export.onnx_graph.onnx_model`).
    folder : path
        Appears complete or not at all; replaces an earlier export.

    Returns
    -------
    Export

    Raises
    ------
    ConfigError
        If the form is unknown, a library for it is missing, or the folder holds anything else.
    OutputError
        If it cannot be written.
    """
    out = Path(folder)
    if form not in FORMS:
        raise ConfigError(f"--form: form {form!r} is not known; allowed are {', '.join(FORMS)}")
    check_out(out, listing=LISTING, file_format=FORMAT, command="doppelgait model export")
    contents: dict[str, bytes] = {}
    if form == "onnx":
        from doppelgait.classify.export.onnx_graph import onnx_model

        contents["model.onnx"] = onnx_model(model).SerializeToString()
    else:
        contents["scorer.py"] = Path(scorer.__file__).read_bytes()
    with complete_folder(out) as partial:
        for name, content in contents.items():
            (partial / name).write_bytes(content)
        if form == "numpy":
            save_model(model, partial / "model.npz")
        files = sorted(path.name for path in partial.iterdir())
        facts: dict[str, Any] = {
            "format": FORMAT, "form": form, "doppelgait": __version__, "files": files,
            "model": model.facts.model_dump(mode="json"),
        }  # fmt: skip
        (partial / LISTING).write_text(json.dumps(facts, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    return Export(out, tuple(files))
