"""Without torch everything but training a network works, and one line says what to install."""

import sys

import numpy as np
import pytest

from doppelgait.classify import network
from doppelgait.classify.evaluation import evaluate
from doppelgait.classify.learned import LabelledRows
from doppelgait.core.errors import DatasetError


@pytest.fixture
def _no_torch(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.setattr(network, "is_torch_installed", lambda: False)


@pytest.mark.usefixtures("_no_torch")
def test_all_others_run_and_the_line_says_what_to_do(dataset):
    document = evaluate(dataset).document
    assert "signature-network" not in document["models"]
    assert "extended-boosting" in document["models"]
    assert any("pip install 'doppelgait[torch]'" in note for note in document["notes"])
    with pytest.raises(DatasetError, match="pip install 'doppelgait"):
        evaluate(dataset, models=["signature-network"])
    with pytest.raises(DatasetError, match="pip install 'doppelgait"):
        network.train_network(LabelledRows(np.empty(0, dtype=object), np.empty(0, int)), None, n_classes=2, seed=0)
