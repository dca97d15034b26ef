"""Batches of examples, each as if it were made alone; stored arrays: precision, hops and what comes back."""

import json
from typing import Literal

import h5py
import numpy as np
import pytest

from checkout import ROOT
from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError, DatasetError, warn_caller
from doppelgait.dataset.config import FieldSpec, load_plan
from doppelgait.dataset.example import label_arrays
from doppelgait.dataset.finish import read_description, read_records, tally
from doppelgait.dataset.plan import plan_dataset
from doppelgait.dataset.shard import BuildContext, build_planned
from doppelgait.dataset.shard_files import DB_FLOOR, ShardFiles, decode, describe_fields, encode
from doppelgait.motion.models.boulic import boulic_walk


def make_all(plan, size):
    """Return rows, bytes of arrays and failures of a plan's examples, made some at a time."""
    context = BuildContext(plan.config, str(plan.folder), ".")
    made = [data for n in range(0, len(plan.examples), size) for data in context.make(plan.examples[n : n + size])]
    return [(data.rows, [{k: v.tobytes() for k, v in a.items()} for a in data.arrays], data.failures) for data in made]


@pytest.mark.parametrize("name", ["home-alarm", str(ROOT / "examples" / "rooms-plan.toml")])
def test_bytes_do_not_depend_on_the_batch(name):
    config, folder = load_plan(name, overrides=["dataset.examples_per_class=7"])
    plan = plan_dataset(config, folder=folder)
    alone = make_all(plan, 1)
    assert not any(failures for _, _, failures in alone)
    assert make_all(plan, 4) == make_all(plan, 16) == alone


def test_a_batch_is_bounded_by_its_time_and_its_bytes():
    long, large = ["scene.duration_s={uniform=[10,30]}"], ["radar={preset='ti-77'}", "analysis.parts=true"]
    for size, changes in ((16, []), (3, long), (8, large), (9, ['dataset.fields=["baseband"]'])):
        assert BuildContext(load_plan("home-alarm", overrides=changes)[0], ".").batch_size == size


class Moody(FrozenModel):
    kind: Literal["moody"] = "moody"
    mood: str = "calm"


def test_warnings_and_faults_are_those_of_their_example(register):
    @register("motion_model", parameters=Moody)
    def walk_moodily(parameters: Moody, duration_s: float, rng: np.random.Generator | None):
        if parameters.mood == "angry":
            raise ConfigError("mood: is too bad to walk")
        if parameters.mood == "sour":
            warn_caller("sour_mood: walks all the same")
        return boulic_walk(duration_s=duration_s)

    moods = ["calm", "calm", "sour", "calm", "angry", "calm"]
    config, folder = load_plan("home-alarm", overrides=["dataset.examples_per_class=6"])
    section = config.classes[0].model_copy(update={"motion": {"kind": "moody", "mood": {"cycle": moods}}})
    plan = plan_dataset(config.model_copy(update={"classes": (section,)}), folder=folder)
    made = make_all(plan, 6)
    assert [[row["warnings"] for row in rows] for rows, _, _ in made] == [[""], [""], ["sour_mood"], [""], [], [""]]
    assert [len(failures) for _, _, failures in made] == [0, 0, 0, 0, 1, 0]
    assert "mood: is too bad to walk" in made[4][2][0]["reason"]
    assert make_all(plan, 4) == make_all(plan, 1) == made  # the first four without the fault


def test_a_row_is_made_without_labels(monkeypatch):
    config, folder = load_plan("home-alarm", overrides=["dataset.examples_per_class=12"])
    plan = plan_dataset(config, folder=folder)
    monkeypatch.setattr("doppelgait.core.labels.make_array", None)
    (((_, arrays),),) = build_planned([plan.examples[0]], BuildContext(plan.config, str(plan.folder), ""))
    assert arrays["signature"].size


@pytest.mark.parametrize("level", [1e-16, 1e-13, 1e-6, 1.0])
def test_half_precision_is_within_what_is_promised_and_the_default_of_signatures(level):
    values = (level * np.random.default_rng(1).chisquare(2, (400, 64))).astype(np.float32)
    spec = FieldSpec(name="signature")
    stored = encode(values, spec)
    assert stored.nbytes * 2 == values.nbytes
    back = decode(stored, describe_fields([spec])["signature"])
    error = np.abs(back / values - 1)
    assert error.max() < 0.015
    assert back.dtype == np.float32


@pytest.mark.parametrize(
    ("spec", "values", "stored"),
    [
        ({"name": "signature", "dtype": "full"}, [[0.1, 1 / 3]], [[np.float32(0.1), np.float32(1 / 3)]]),
        ({"name": "cadence_map", "dtype": "half"}, [[0.0, 1.0]], [[DB_FLOOR, 0.0]]),  # silence stays silence
        ({"name": "signature", "dtype": "full", "hop": 3}, [[0.0], [1.0], [2.0], [3.0]], [[0.0], [3.0]]),
    ],
)
def test_what_is_stored_comes_back_in_full_precision_every_nth_column(spec, values, stored):
    field = FieldSpec(**spec)
    encoded = encode(np.array(values, dtype=np.float32), field)
    assert encoded.tolist() == stored
    facts = describe_fields([field])[field.name]
    assert (facts["scale"], facts["hop"]) == ("db" if field.is_half else "linear", field.hop)
    assert decode(encoded, facts).tolist() == np.array(values, dtype=np.float32)[:: field.hop].tolist()


def test_a_file_instead_of_the_folder_is_told(tmp_path):
    path = tmp_path / "walk.h5"
    path.write_bytes(b"")
    with pytest.raises(DatasetError, match=r"walk\.h5: is a file; name the folder of a dataset$"):
        read_description(path)


@pytest.mark.parametrize(
    "values",
    [np.zeros(7), np.zeros((2, 3, 4)), np.zeros((2, 3), dtype="S3"), np.array(3.0)],
    ids=["1", "3", "text", "0"],
)
def test_an_array_with_other_axes_than_its_field_is_one_error(values):
    facts = {
        "signature": {"dims": ["time", "doppler"], "units": "V^2", "dtype": "float32", "scale": "linear", "hop": 1}
    }
    stored = {"signature": values}
    with pytest.raises(DatasetError, match=r"x-1: signature has \d axes of .* in its shard, not \['time', 'doppler'\]"):
        label_arrays(facts, {"id": "x-1", "prf_hz": 1000.0}, stored.get, carrier_hz=7e9)


def test_an_array_that_fills_the_memory_is_not_read(tmp_path):
    (tmp_path / "shards").mkdir()
    with h5py.File(tmp_path / "shards" / "train-00000-of-00001.h5", "w") as file:
        file.create_dataset("signature", (1, 100_000, 200_000), "f4", chunks=(1, 50, 50))
    with pytest.raises(DatasetError, match="would take 128,000 MB of memory"):
        ShardFiles(tmp_path / "shards").read("train-00000-of-00001", "signature", 0)


@pytest.mark.parametrize(
    "change",
    [{"shard": None}, {"bytes": []}, {"failures": {}}, {"sha256": 3}]
    + [{"rows": [row]} for row in ({}, {"label": ["a"]}, {"label": "a", "scene_id": [1]})]
    + [{"failures": [{key: 1}]} for key in ("id", "reason")],
)
def test_a_damaged_record_is_one_error(tmp_path, change):
    record = {"shard": "a", "sha256": "b", "bytes": 1, "failures": [], "rows": [{"label": "human"}]}
    (tmp_path / "shards").mkdir()
    place = tmp_path / "shards" / "train-00000-of-00001.json"
    place.write_text(json.dumps(record))
    assert tally(read_records(tmp_path, [place.stem])).rows == 1
    place.write_text(json.dumps({**record, **change}))
    with pytest.raises(DatasetError, match=f"train-00000-of-00001.json: {next(iter(change))} is missing or damaged"):
        tally(read_records(tmp_path, [place.stem]))
