"""ONNX graphs give what the models give, in onnxruntime."""

import json
import sys
from importlib.util import find_spec

import numpy as np
import pytest

from doppelgait.classify.onnx_graph import build_onnx_model, round_threshold
from doppelgait.core.errors import ConfigError
from export_models import KINDS, export_model_of, inputs_of, network_of, pictures_of, require


@pytest.fixture
def run():
    require(find_spec("onnx") and find_spec("onnxruntime"), "onnx and onnxruntime: pip install 'doppelgait[export]'")
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1

    def run(model, features, levels):
        session = onnxruntime.InferenceSession(
            build_onnx_model(model).SerializeToString(), options, providers=["CPUExecutionProvider"]
        )
        named = {"features": features.astype(np.float32)}
        if network_of(model) is not None:
            named["pictures"] = pictures_of(model, levels)
        return session.run(["probability"], {item.name: named[item.name] for item in session.get_inputs()})[0]

    return run


@pytest.mark.parametrize("n_classes", [2, 3])
@pytest.mark.parametrize("kind", [*KINDS, "constant"])
def test_a_graph_gives_the_probabilities_of_its_model(run, kind, n_classes):
    model = export_model_of(kind, n_classes)
    features, levels, joined = inputs_of(model, 200, 37)
    expected = model.probability(joined)
    assert kind == "constant" or expected.std(axis=0).min() > 0.05
    assert np.abs(run(model, features, levels) - expected).max() < 1e-5


def test_thresholds_are_rounded_so_that_every_float32_goes_its_way():
    rng = np.random.default_rng(0)
    near = rng.normal(0, 1, 2000).astype(np.float32)
    threshold = near.astype(np.float64) * (1 + rng.choice([-1e-9, 0.0, 1e-9], 2000))
    assert ((near <= round_threshold(threshold)) == (near.astype(np.float64) <= threshold)).all()
    assert round_threshold(np.array([np.inf]))[0] == np.inf


def test_a_graph_holds_the_facts_of_its_model():
    require(find_spec("onnx"), "onnx: pip install 'doppelgait[export]'")
    made = build_onnx_model(export_model_of("ensemble"))
    facts = json.loads(made.metadata_props[0].value)
    assert facts["classes"] == ["a", "b"]
    assert facts["abstain_below"] == 0.8


def test_without_onnx_one_error_gives_the_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(ConfigError, match=r"pip install 'doppelgait\[export\]'"):
        build_onnx_model(export_model_of("linear"))
