"""Distances from what was learnt against SciPy, their ranks, and models that carry them in their files."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import mahalanobis

from doppelgait.classify.learned import LabelledRows
from doppelgait.classify.model_file import load_model, save_model
from doppelgait.classify.training import LEVELS, SHRINKAGE, learn_novelty, standardise_columns
from export_models import export_model_of, inputs_of


def rows(n, seed):
    """Two classes of correlated features, some of them unknown; negative values, so that no logarithm is taken."""
    rng = np.random.default_rng(seed)
    labels = np.arange(n) % 2
    mixing = np.array([[1.0, 0.95, 0.0], [0.0, 0.1, 0.3], [0.0, 0.0, 0.5]])
    values = rng.normal(size=(n, 3)) @ mixing + labels[:, None] * np.array([4.0, 0.0, -2.0])
    values[rng.random(n) < 0.1, 2] = np.nan
    return LabelledRows(values, labels)


def train_novelty(n_held=300):
    train, held = rows(400, 0), rows(n_held, 1)
    return learn_novelty(train, held), train


def test_it_is_the_mahalanobis_distance_from_the_nearest_class():
    novelty, train = train_novelty()
    columns = standardise_columns(train.values)[-1]
    means = [columns[train.labels == k].mean(axis=0) for k in (0, 1)]
    about = np.concatenate([columns[train.labels == k] - means[k] for k in (0, 1)])
    covariance = (1 - SHRINKAGE) * np.cov(about.T, bias=True) + SHRINKAGE * np.eye(columns.shape[1])
    inverse = np.linalg.inv(covariance)
    expected = [min(mahalanobis(row, mean, inverse) for mean in means) for row in columns[:20]]
    assert novelty.distance(train.values[:20]) == pytest.approx(expected, rel=1e-9)


def test_ranks_are_uniform_for_known_kinds_and_least_for_others():
    novelty, _ = train_novelty()
    ranks = novelty.rank(rows(2000, 2).values)
    for share in (0.02, 0.1, 0.5):
        assert (ranks <= share).mean() == pytest.approx(share, abs=0.05 * share**0.5 + 0.01)
    # each feature lies within the span that was learnt; only together they are impossible
    odd = np.array([[1.0, -1.0, 0.0]])
    assert (odd > np.nanmin(rows(400, 0).values, axis=0)).all()
    assert (odd < np.nanmax(rows(400, 0).values, axis=0)).all()
    assert novelty.rank(odd)[0] < 0.02


def test_many_held_rows_become_quantiles_and_none_keep_nothing_away():
    many, _ = train_novelty(5 * LEVELS)
    assert many.arrays["held"].size == LEVELS
    exact, _ = train_novelty(LEVELS)
    values = rows(200, 3).values
    assert np.allclose(many.rank(values), exact.rank(values), atol=0.07)
    train = rows(40, 0)
    none = learn_novelty(train, LabelledRows(train.values[:0], train.labels[:0]))
    assert (none.rank(np.full((2, 3), 1e6)) == 1).all()


def test_a_file_keeps_it_and_one_without_it_keeps_nothing_away(tmp_path):
    bare = export_model_of("linear")
    values = inputs_of(bare, 30, 0)[0]
    known = LabelledRows(values, np.arange(30) % 2)
    model = replace(bare, novelty=learn_novelty(known, known))
    found = load_model(save_model(model, tmp_path / "model.npz"))
    assert np.array_equal(found.rank(values), model.rank(values))
    assert model.rank(values).std() > 0.1
    assert (load_model(save_model(bare, tmp_path / "old.npz")).rank(1e6 * values) == 1).all()
