"""Small plans for the tests of building, and what a folder must be like whatever happened to its build."""

import hashlib
import json
from functools import partial

from doppelgait.core.config import validate
from doppelgait.core.files import hash_file
from doppelgait.dataset.build import build_dataset, read_dataset_status
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.finish import LOG, LOG_SUM
from shared_work import made_once


def tiny_plan(**changes):
    """24 examples of 1 s in 8 shards."""
    table = {
        "dataset": {
            "name": "tiny",
            "examples_per_class": 12,
            "shard_size": 3,
            "fractions": {"train": 0.5, "test": 0.5},
        },
        "classes": [
            {"label": "human", "motion": {"kind": "boulic", "speed_mps": {"uniform": [0.9, 1.4]}}},
            {"label": "dog", "motion": {"kind": "quadruped", "gait": "trot"}},
        ],
        "scene": {"duration_s": 1.0},
        "target": {"range_m": {"uniform": [4, 5]}, "rcs": {"total_m2": 0.5}},
        "noise": {"kind": "snr", "snr_db": {"uniform": [10, 20]}},
    }
    dataset = {**table["dataset"], **changes.pop("dataset", {})}
    return validate(PlanConfig, {**table, "dataset": dataset, **changes}, where="plan")


def mini_plan(**changes):
    """4 examples of 1 s in 2 shards."""
    return tiny_plan(dataset={"examples_per_class": 2, "shard_size": 2}, **changes)


def dataset_hash(folder):
    """Hash of every byte of a dataset but its log, which holds times, and the hash of the log."""
    digest = hashlib.sha256()
    for path in sorted(path for path in folder.rglob("*") if path.is_file() and path.name not in (LOG, LOG_SUM)):
        digest.update(f"{path.relative_to(folder)}\n{hash_file(path)}\n".encode())
    return digest.hexdigest()


def put_index(folder, index):
    """Write an index that says which dataset it is of, as a table of pandas does not."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    identity = json.loads((folder / "dataset.json").read_text())["id"]
    table = pa.Table.from_pandas(index, preserve_index=False).replace_schema_metadata({"dataset": identity})
    pq.write_table(table, folder / "index.parquet")


def check_whole(folder, expected_hash):
    """Everything is there, nothing else is, and it is what it should be."""
    status = read_dataset_status(folder)
    assert [*status.shards.values()] == 8 * ["done"]
    assert (status.n_examples, status.n_planned, status.n_failed, status.complete) == (24, 24, 0, True)
    assert (status.running, status.removed) == ((), ())
    assert not list(folder.rglob("*.partial"))
    assert not list(folder.glob("*.lock"))
    assert dataset_hash(folder) == expected_hash


def whole_dataset(tmp_path_factory):
    """Folder of the tiny dataset as one process builds it; nobody changes it."""
    return made_once(tmp_path_factory, "dataset-whole", partial(build_dataset, tiny_plan(), executor="serial"))
