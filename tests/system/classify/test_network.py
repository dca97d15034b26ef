"""The network: its plain form against torch, the same twice, early stopping; skipped where torch is not installed."""

import numpy as np
import pytest

from doppelgait.classify.data import collect_inputs, collect_rows
from doppelgait.classify.learned import LabelledRows
from doppelgait.classify.model_file import load_model, save_model
from doppelgait.processing.patches import Patch

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'doppelgait[torch]'")

from doppelgait.classify import network as nets  # noqa: E402
from doppelgait.classify.decide import TargetInputs, decide  # noqa: E402
from doppelgait.classify.evaluation import evaluate  # noqa: E402
from doppelgait.testing import check_classifier  # noqa: E402

SPEC = Patch(n_velocity=16, n_time=16)
QUICK = nets.Training(most_epochs=8, patience=8, batch_size=8)


def a_part(n, *, seed, columns=20):
    """Class 1 has a bright row far from the middle, class 0 near it, on either side; one row has no signature."""
    rng = np.random.default_rng(seed)
    labels = np.arange(n) % 2
    values = np.empty(n, dtype=object)
    for number in range(n - 1):
        picture = 0.1 * rng.random((16, columns))
        offset = (6 if labels[number] else 1) * (1 if rng.random() < 0.5 else -1)
        picture[8 + offset] += 0.7
        values[number] = picture.astype(np.float32)
    return LabelledRows(values, labels.astype(np.int64))


@pytest.fixture(scope="module")
def trained():
    return nets.train_network(a_part(48, seed=0), a_part(16, seed=1), n_classes=2, seed=3, spec=SPEC, settings=QUICK)


def test_it_learns_and_says_nothing_without_a_signature(trained):
    part = a_part(60, seed=2, columns=31)
    found = np.exp(trained.log_probability(part.values))
    assert np.allclose(found.sum(axis=1), 1)
    assert (found.argmax(axis=1) == part.labels)[:-1].mean() > 0.95
    assert found[-1] == pytest.approx([0.5, 0.5])


def test_mirrored_signatures_get_the_same_answer(trained):
    part = a_part(10, seed=4)
    mirrored = part.values.copy()
    for number in range(9):
        mirrored[number] = mirrored[number][::-1]
    assert np.allclose(trained.log_probability(part.values), trained.log_probability(mirrored))


def test_plain_form_answers_as_torch_does():
    torch.manual_seed(0)
    model = nets.build_model(torch, 3, 0.3)
    pictures = torch.rand(5, 1, 32, 48) * torch.linspace(-3, 3, 5).reshape(5, 1, 1, 1)  # not all alike
    for _ in range(60):  # running means of the batch normalisation that are not those it starts with
        model(torch.rand(16, 1, 32, 48) * 3 - 1)
    with torch.no_grad():
        model[2].weight[:] = torch.linspace(-1, 1, 8)  # a negative scale, too
        model[-1].weight *= 20.0  # classes far apart
    model.eval()
    with torch.no_grad():
        expected = torch.log_softmax(model(pictures), dim=1).numpy()
    found = nets.scorer.of_pictures(nets._read_model(model.state_dict(), SPEC).arrays, pictures[:, 0].numpy())
    assert np.ptp(expected, axis=0).max() > 0.1
    assert np.allclose(found, expected, atol=1e-4)


def test_same_seed_same_network_and_nothing_of_torch_is_left_changed(trained):
    torch.manual_seed(99)  # what others did with torch before does not count
    threads, state = torch.get_num_threads(), torch.random.get_rng_state()
    again = nets.train_network(a_part(48, seed=0), a_part(16, seed=1), n_classes=2, seed=3, spec=SPEC, settings=QUICK)
    for one, two in zip(trained.kernels, again.kernels, strict=True):
        assert np.array_equal(one, two)
    assert torch.get_num_threads() == threads
    assert torch.equal(torch.random.get_rng_state(), state)
    other = nets.train_network(a_part(48, seed=0), a_part(16, seed=1), n_classes=2, seed=4, spec=SPEC, settings=QUICK)
    assert not np.array_equal(trained.kernels[0], other.kernels[0])


def test_it_stops_when_the_held_rows_are_told_no_better():
    """Held labels are the wrong way round: learning can only make their loss worse."""
    part, held = a_part(48, seed=0), a_part(16, seed=1)
    calls = []
    settings = nets.Training(most_epochs=40, patience=3, batch_size=8)
    original = nets._compute_held_loss
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(nets, "_compute_held_loss", lambda *args: calls.append(1) or original(*args))
        nets.train_network(
            part, LabelledRows(held.values, 1 - held.labels), n_classes=2, seed=0, spec=SPEC, settings=settings
        )
    assert len(calls) < 20


def test_variations():
    rng = np.random.default_rng(0)
    whole = np.zeros((16, 40), dtype=np.float32)
    whole[12] = np.linspace(0.2, 0.8, 40)
    values = np.empty(200, dtype=object)
    values[:] = [whole] * 200
    still = nets.Training(gain_db=0, noise_db=0, stretch=1, flip=False)
    plain = nets.augment(values, rng, SPEC, still)
    starts = [int(np.abs(whole[12] - p[12, 0]).argmin()) for p in plain]
    assert set(starts) == set(range(25))
    assert all(np.allclose(p, whole[:, s : s + 16], atol=1e-6) for p, s in zip(plain, starts, strict=True))
    flipped = nets.augment(values, rng, SPEC, still.model_copy(update={"flip": True}))
    assert 60 < sum(p[3].max() > 0 for p in flipped) < 140
    louder = nets.augment(values, rng, SPEC, still.model_copy(update={"gain_db": 3.0}))
    change = [float((p[12] - plain_row).mean()) for p in louder for plain_row in [whole[12, 12:28]]]
    assert np.std(change) > 0
    assert not louder[:, :12].any()
    noisy = nets.augment(values, rng, SPEC, still.model_copy(update={"noise_db": 10.0}))
    assert noisy[:, :10].max() > 0
    assert noisy[:, 12].mean() < plain[:, 12].mean()  # a raised floor is the new zero
    assert noisy.min() >= 0
    assert noisy.max() <= 1


def test_on_a_built_dataset_kept_and_used_without_torch(dataset, tmp_path):
    found = evaluate(dataset, models=["signature-network"])
    model = found.models["signature-network"]
    again = load_model(save_model(model, tmp_path / "n.npz"))
    levels = collect_inputs(collect_rows(dataset), "signature").values
    assert all(part.shape == (64, part.shape[1]) and part.max() > 0.2 for part in levels)
    assert np.array_equal(again.probability(levels), model.probability(levels))
    signature = dataset.example(0).signature
    decision = decide(TargetInputs({}, signature), again, 0)
    assert list(decision.probabilities.values()) == pytest.approx(again.probability(levels[:1])[0])


def test_the_network_keeps_the_contract_of_classifiers():
    check_classifier("signature-network")


def test_stretched_images_hold_the_same_at_other_velocities():
    """A ramp over velocity: at v stands what was at v / factor; beyond the last row there is nothing."""
    v = np.arange(16) - 7.5
    ramp = np.tile((v / 16 + 0.5)[:, None], (1, 4)).astype(np.float32)
    wide, narrow, same = nets.stretch_pictures(np.stack([ramp] * 3), np.array([2.0, 0.8, 1.0]))
    assert np.allclose(wide[:, 0], v / 2 / 16 + 0.5, atol=1e-6)
    inside = np.abs(v / 0.8) <= 7.5
    assert np.allclose(narrow[inside, 0], v[inside] / 0.8 / 16 + 0.5, atol=1e-6)
    assert not narrow[~inside].any()
    assert np.array_equal(same, ramp)


def test_the_variation_widens_from_nothing():
    values = a_part(9, seed=0, columns=16).values[:8]
    calm = nets.Training(flip=False)
    plain = nets.augment(values, np.random.default_rng(0), SPEC, calm, 0.0)
    assert np.allclose(plain, np.stack(list(values)), atol=1e-6)
    apart = [
        np.abs(nets.augment(values, np.random.default_rng(0), SPEC, calm, width) - plain).mean()
        for width in (0.1, 0.5, 1.0)
    ]
    assert 0 < apart[0] < apart[1] < apart[2]
