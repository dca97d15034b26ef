"""Examples simulated while they are used, against the built dataset."""

from itertools import islice

import numpy as np
import pytest

from doppelgait.core.errors import AnalysisError, ConfigError, DatasetError, DoppelgaitWarning
from doppelgait.dataset import plan_dataset, shard
from doppelgait.dataset.stream import MAX_FAILURES, stream_examples
from tiny_dataset import TROT, mixed_plan, tiny_plan

PLAN = tiny_plan(fields=["signature"])


def same(one, other):
    return one.id == other.id and all(np.array_equal(one.arrays[k].values, other.arrays[k].values) for k in one.arrays)


def ids(examples, count):
    return [example.id for example in islice(examples, count)]


@pytest.fixture
def light(monkeypatch):
    """Names of the examples alone: nothing is simulated. Returns the sizes of the batches."""
    sizes = []

    def rows_only(specs, fields, folder, *, gate):
        sizes.append(len(specs))
        more = {"prf_hz": 1000.0, "carrier_hz": 1e10}
        return [[({"id": spec.id, "label": spec.label, "subject": spec.rows[0].subject, **more}, {})] for spec in specs]

    monkeypatch.setattr(shard, "build_examples", rows_only)
    return sizes


@pytest.mark.parametrize(("name", "plan"), [("dataset", tiny_plan()), ("mixed", mixed_plan())])
def test_planned_numbers_give_the_built_examples(request, name, plan):
    dataset = request.getfixturevalue(name)
    places = {"shard", "row", "shard_sha256", "split", "group"}
    for example in islice(stream_examples(plan, start=0), len(dataset)):
        kept = dataset[example.id]
        assert set(example.arrays) == set(kept.arrays)
        planned = kept.specification.model_copy(update={"split": "", "group": ""})
        assert example.specification == planned
        for name, array in example.arrays.items():
            assert array.dtype == kept.arrays[name].dtype
            assert array.identical(kept.arrays[name])
        for name, value in example.row.items():
            assert name in places or value == kept.row[name] or (value in (None, "") and kept.row[name] in (None, ""))


def test_goes_on_beyond_the_plan_with_the_classes_in_turn(light):
    assert ids(stream_examples(PLAN, start=10), 6) == [
        "dog-000004", "dog-000005", "human-000006", "dog-000006", "human-000007", "dog-000007",
    ]  # fmt: skip
    assert light == [1, 2, 4]  # the first example does not wait for others


def test_starts_behind_the_plan_and_anew_each_time(light):
    planned = {example.id for example in plan_dataset(PLAN).examples}
    assert ids(stream_examples(PLAN), 2) == ["human-000006", "dog-000006"]
    assert not planned & set(ids(stream_examples(PLAN), 50))
    examples = stream_examples(plan_dataset(PLAN), start=3)
    assert ids(examples, 5) == ids(examples, 5) == ids(stream_examples(PLAN, start=3), 5)


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_workers_share_the_stream(light, count):
    serial = ids(stream_examples(PLAN, start=2), 30)
    shares = [ids(stream_examples(PLAN, start=2, worker=(k, count)), 30 // count) for k in range(count)]
    assert [shares[n % count][n // count] for n in range(30)] == serial
    parts = [stream_examples(PLAN, start=2, worker=(k, 2)).part(j, count) for k in range(2) for j in range(count)]
    assert sorted(name for part in parts for name in ids(part, 3)) == sorted(serial[: 6 * count])


def test_arrays_do_not_depend_on_the_worker_and_a_seed_makes_another_stream():
    serial = list(islice(stream_examples(PLAN), 4))
    for k in range(2):
        share = list(islice(stream_examples(PLAN, worker=(k, 2)), 2))
        assert all(same(a, b) for a, b in zip(share, serial[k::2], strict=True))
    one, two = (next(iter(stream_examples(PLAN, seed=seed))) for seed in (1, 2))
    assert one.id == two.id
    assert not same(one, two)
    assert same(one, next(iter(stream_examples(tiny_plan(fields=["signature"], seed=1)))))


def test_failed_examples_are_left_out_with_a_warning(light, monkeypatch):
    works = shard.build_examples

    def sometimes(specs, *arguments, **options):
        if any(spec.run.example % 3 == 0 for spec in specs):
            raise AnalysisError("the target is nowhere")
        return works(specs, *arguments, **options)

    monkeypatch.setattr(shard, "build_examples", sometimes)
    with pytest.warns(DoppelgaitWarning) as caught:
        found = ids(stream_examples(PLAN), 4)
    assert [str(w.message) for w in caught] == [
        f"example number {n} failed: the target is nowhere; left out" for n in (12, 15)
    ]
    assert found == ["dog-000006", "human-000007", "human-000008", "dog-000008"]


def test_a_plan_that_always_fails_ends_the_stream(monkeypatch):
    def never(*arguments, **options):
        raise AnalysisError("the target is nowhere")

    monkeypatch.setattr(shard, "build_examples", never)
    with (
        pytest.warns(DoppelgaitWarning) as caught,
        pytest.raises(DatasetError, match=f"{MAX_FAILURES} examples in a row failed, the last is number 21: the"),
    ):
        next(iter(stream_examples(PLAN)))
    assert len(caught) == MAX_FAILURES - 1


def test_value_that_is_not_allowed_ends_the_stream():
    plan = PLAN.model_copy(update={"target": {"range_m": -3.0}})
    with pytest.raises(ConfigError, match=r"human-000006: .*range_m"):
        next(iter(stream_examples(plan)))


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"worker": (2, 2)}, DatasetError, r"worker: \(2, 2\) is not allowed"),
        ({"worker": (0, 0)}, DatasetError, r"worker: \(0, 0\) is not allowed"),
        ({"start": -1}, DatasetError, "start: -1 is not allowed"),
        ({"seed": -1}, ConfigError, "seed: -1 is not allowed"),
    ],
)
def test_wrong_requests(options, error, message):
    with pytest.raises(error, match=message):
        stream_examples(PLAN, **options)


def test_class_numbers_and_labels_without_a_class():
    examples = stream_examples(PLAN.model_copy(update={"companions": [{"label": "cat", "motion": TROT}]}))
    assert [examples.class_number(label) for label in ("human", "dog")] == [0, 1]
    with pytest.raises(DatasetError, match="'cat' is the label of a companion and no class"):
        examples.class_number("cat")
