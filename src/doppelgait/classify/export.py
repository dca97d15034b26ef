"""Exports of a trained model as folders."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from doppelgait import __version__
from doppelgait.classify import scorer
from doppelgait.classify.c_code import TEXTS, CSettings, Sources, plan_device
from doppelgait.classify.learned import EMPTY, Seen, embed_windows, join_inputs
from doppelgait.classify.model import Model
from doppelgait.classify.model_file import save_model
from doppelgait.core.errors import ConfigError
from doppelgait.core.files import check_out, complete_folder
from doppelgait.processing.patches import N_CELLS, N_COLUMNS, N_SLICES, draw_pictures

FORMS = ("c", "numpy", "onnx")
LISTING, FORMAT = "export.json", "doppelgait-model-export"


class Export(NamedTuple):
    """Written export."""

    folder: Path
    files: tuple[str, ...]
    facts: Mapping[str, Any]


def export_model(model: Model, form: str, folder: str | Path, settings: CSettings | None = None) -> Export:
    """Write a model in a form for other programs.

    Parameters
    ----------
    form : {"c", "numpy", "onnx"}
        ``c``: C99 of a model of tracks, from complex range bins to an alarm.
        ``numpy``: the model file and a scorer that needs NumPy alone. ``onnx``: one graph from
        features and pictures to calibrated probabilities.
    folder : path
        Appears complete or not at all; replaces an earlier export.
    settings : CSettings, optional
        Of the form ``c`` only.

    Raises
    ------
    ConfigError
        If the form is unknown or cannot hold the model, a library for it is missing, the radar is
        not known, or the folder holds anything else.
    OutputError
        If it cannot be written.

    Examples
    --------
    >>> import doppelgait as dg
    >>> dg.classify.export_model(dg.classify.open_model("x4"), "numpy", "scorer").files
    ('model.npz', 'scorer.py')
    """
    out, found = Path(folder), dict[str, Any]()
    if form not in FORMS:
        raise ConfigError(f"--form: form {form!r} is not known; allowed are {', '.join(FORMS)}")
    if form == "onnx" and model.learned.kind == "track":
        raise ConfigError(
            f"--form onnx: {model.facts.name} follows tracks; use --form c or numpy, or export a model of windows"
        )
    if (settings is None) == (form == "c"):
        raise ConfigError(f"--form {form}: --radar and --int8 are for --form c, which needs --radar (x4, or a file)")
    check_out(out, listing=LISTING, file_format=FORMAT, command="doppelgait model export")
    contents: dict[str, bytes] = {}
    if form == "onnx":
        from doppelgait.classify.onnx_graph import build_onnx_model

        contents["model.onnx"] = build_onnx_model(model).SerializeToString()
    elif settings is not None:
        contents, found = _make_c_files(model, settings)
    else:
        contents["scorer.py"] = Path(scorer.__file__).read_bytes()
    if form != "numpy" and model.track is not None:
        left_out = {"onnx": "the model of tracks, which --form c and numpy have", "c": "the model of windows; features"}
        found["left_out"] = left_out[form]
    with complete_folder(out) as partial:
        for name, content in contents.items():
            (partial / name).write_bytes(content)
        if form == "numpy":
            save_model(model, partial / "model.npz")
        files = sorted(path.name for path in partial.iterdir())
        facts = {"format": FORMAT, "form": form, "doppelgait": __version__, "files": files, **found}
        facts["model"] = (model.of_tracks if form == "c" else model).facts.model_dump(mode="json")
        (partial / LISTING).write_text(json.dumps(facts, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    return Export(out, tuple(files), found)


def _make_c_files(model: Model, settings: CSettings) -> tuple[dict[str, bytes], dict[str, Any]]:
    model = model.of_tracks
    sources = Sources(model, plan_device(model, settings), integers=settings.integers)
    rng, memory = np.random.default_rng(0), EMPTY
    words: list[Any] = [np.array([3, settings.n_examples], np.int32)]
    for number in range(settings.n_examples):
        picture = draw_pictures(rng.gamma(0.3, 1.0, (N_SLICES, N_COLUMNS, N_CELLS)), np.ones(N_COLUMNS))[0]
        since_s = 0.5 if number % 8 else -1.0  # eight of a track
        memory = EMPTY if since_s < 0.0 else memory
        seen = np.empty(1, dtype=object)
        seen[0] = Seen(picture[None], 0, 0.0)
        values = join_inputs(np.full((1, len(model.facts.names)), np.nan), seen)
        embedding = embed_windows(sources.network, values)[0]
        memory, answer = scorer.remember(sources.network, memory, embedding, max(since_s, 0.0))
        probability = model.calibration(answer[None]).astype(np.float32)
        words += [np.float32(since_s), picture.transpose(1, 2, 0).astype(np.float32), probability]
    files = {
        "doppelgait_model.h": sources.header().encode(),
        "doppelgait_model.c": sources.source().encode(),
        "selftest.c": (TEXTS / "selftest.c").read_bytes(),
        "golden.bin": b"".join(np.ascontiguousarray(part).tobytes() for part in words),
    }
    return files, {"precision": "int8" if settings.integers else "float32", "flash_table_bytes": sources.flash_bytes}
