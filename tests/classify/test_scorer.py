"""The scorer that needs NumPy alone gives what doppelgait gives."""

import ast
from dataclasses import replace

import numpy as np
import pytest

from doppelgait.classify import scorer
from doppelgait.classify.export import export_model
from doppelgait.classify.model_file import MODEL
from doppelgait.classify.scorer import Scorer
from doppelgait.core.errors import ConfigError
from export_models import KINDS, export_model_of, inputs_of, model_of_tracks


@pytest.mark.parametrize("n_classes", [2, 3])
@pytest.mark.parametrize("kind", [*KINDS, "constant"])
def test_the_exported_scorer_gives_the_probabilities_of_its_model(tmp_path, kind, n_classes):
    model = export_model_of(kind, n_classes)
    features, levels, joined = inputs_of(model, 200, 37)
    made = export_model(model, "numpy", tmp_path / "out")
    found = Scorer(made.folder / "model.npz").probability(features if model.facts.names else None, levels)
    assert np.allclose(found, model.probability(joined), atol=1e-6)


def test_the_exported_scorer_follows_a_track_as_its_model_does(tmp_path):
    track, rows = model_of_tracks()
    model = replace(export_model_of("linear"), track=track)
    made, memory, before_s = export_model(model, "numpy", tmp_path / "out"), None, 0.0
    expected, scorer = track.probability(rows.values), Scorer(made.folder / "model.npz", "track")
    for row, answer in zip(rows.values[3:6], expected[3:6], strict=True):
        pictures, _, stop_s, *_ = row[-1]
        memory, found = scorer.follow(memory, row[:-1].astype(float), pictures / 255.0, stop_s - before_s)
        assert np.allclose(found, answer, atol=1e-6)
        before_s = stop_s
    assert np.allclose(expected[-1], track.calibration(np.log([[0.5, 0.5]])))  # no pictures, no evidence
    assert not np.allclose(expected[4], track.probability(rows.values[4:5]))  # the past counts
    with pytest.raises(ConfigError, match="--form onnx: linear follows tracks"):
        export_model(track, "onnx", tmp_path / "c")
    assert "the model of tracks" in export_model(model, "onnx", tmp_path / "onnx").facts["left_out"]


def test_the_exported_file_imports_nothing_but_numpy(tmp_path):
    made = export_model(export_model_of("linear"), "numpy", tmp_path / "out")
    tree = ast.parse((made.folder / "scorer.py").read_text(encoding="utf-8"))
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert {name.split(".")[0] for name in names} <= {"__future__", "json", "collections", "pathlib", "typing", "numpy"}


def test_decisions_abstain_below_the_threshold(tmp_path):
    made = export_model(export_model_of("linear"), "numpy", tmp_path / "out")
    decide = Scorer(made.folder / "model.npz").decide
    assert decide(np.array([[0.9, 0.1], [0.3, 0.7], [0.1, 0.9]])) == ["a", None, "b"]


def test_a_file_of_a_newer_format_is_refused(tmp_path, monkeypatch):
    made = export_model(export_model_of("linear"), "numpy", tmp_path / "out")
    assert MODEL.version == scorer.NEWEST_FORMAT
    with pytest.raises(ValueError, match="has no model 'track'"):
        Scorer(made.folder / "model.npz", "track")
    monkeypatch.setattr(scorer, "NEWEST_FORMAT", 2)
    with pytest.raises(ValueError, match="up to version 2"):
        Scorer(made.folder / "model.npz")
