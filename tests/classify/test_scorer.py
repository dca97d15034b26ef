"""The scorer that needs NumPy alone gives what doppelgait gives."""

import ast
from dataclasses import replace

import numpy as np
import pytest

from doppelgait.classify import scorer
from doppelgait.classify.export.write import export_model
from doppelgait.classify.learned import Constant
from doppelgait.classify.model_file import MODEL
from doppelgait.classify.scorer import Scorer
from doppelgait.core.errors import ConfigError
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.core.units import doppler_to_velocity_mps
from doppelgait.processing import Analysis, Gate, patches, signature
from doppelgait.processing.patches import Patch
from export_models import KINDS, export_model_of, inputs_of, model_of_tracks


@pytest.mark.parametrize("n_classes", [2, 3])
@pytest.mark.parametrize("kind", KINDS)
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
        pictures, _, stop_s, _ = row[-1]
        memory, found = scorer.follow(memory, row[:-1].astype(float), pictures / 255.0, stop_s - before_s)
        assert np.allclose(found, answer, atol=1e-6)
        before_s = stop_s
    assert np.allclose(expected[-1], track.calibration(np.log([[0.5, 0.5]])))  # no pictures, no evidence
    assert not np.allclose(expected[4], track.probability(rows.values[4:5]))  # the past counts
    with pytest.raises(ConfigError, match="--form c: linear follows tracks"):
        export_model(track, "c", tmp_path / "c")
    assert "the model of tracks" in export_model(model, "onnx", tmp_path / "onnx").facts["left_out"]


def test_a_share_that_is_constant(tmp_path):
    model = replace(export_model_of("linear"), learned=Constant(np.log([0.2, 0.8])))
    made = export_model(model, "numpy", tmp_path / "out")
    features, _, joined = inputs_of(model, 5, 0)
    assert np.allclose(Scorer(made.folder / "model.npz").probability(features), model.probability(joined))


def test_the_exported_file_imports_nothing_but_numpy(tmp_path):
    made = export_model(export_model_of("linear"), "numpy", tmp_path / "out")
    tree = ast.parse((made.folder / "scorer.py").read_text(encoding="utf-8"))
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert {name.split(".")[0] for name in names} <= {"__future__", "json", "collections", "pathlib", "typing", "numpy"}


@pytest.mark.parametrize(("prf_hz", "n_time", "velocity_mps"), [(500.0, 64, 6.4), (211.0, 16, 9.0), (90.0, 128, 1.0)])
def test_signature_and_levels_are_those_of_the_package(prf_hz, n_time, velocity_mps):
    rng, patch = np.random.default_rng(3), Patch(n_time=n_time, velocity_mps=velocity_mps)
    n = round(prf_hz * 2.3)
    samples = rng.normal(size=(n, 3, 2)) @ [1, 1j] + 20 * np.exp(1j * np.cumsum(rng.normal(0.3, 0.4, n)))[:, None]
    baseband = make_array(
        BASEBAND, samples.astype(np.complex64),
        {"slow_time": np.arange(n) / prf_hz, "range": np.array([1.0, 1.1, 1.2])}, {},
    )  # fmt: skip
    expected = signature(baseband, Gate.fixed(0.9, 1.3, time_s=np.array([0.0, 9.0])), Analysis(), wavelength_m=0.041)
    power, column_s, doppler_hz = scorer.signature(samples, prf_hz=prf_hz)
    assert np.allclose(power, expected.values, rtol=1e-3, atol=1e-5 * power.max())
    assert np.allclose(doppler_hz, expected["doppler"])
    assert np.allclose(column_s, np.diff(expected["time"]))
    velocity = doppler_to_velocity_mps(doppler_hz, 0.041)
    found = scorer.levels(power, patch.model_dump(), column_s=column_s, velocity_mps=velocity)
    assert np.allclose(found, patches.levels(expected, patch), atol=1e-4)


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
