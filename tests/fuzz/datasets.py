"""Plans, datasets and shards with damage."""

import json
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from readers import Target, main_file

import tiny_dataset
from doppelgait.core.config import validate, write_toml
from doppelgait.core.documents import parse_json
from doppelgait.core.errors import DoppelgaitError
from doppelgait.core.files import hash_file
from doppelgait.dataset.build import build_dataset, read_dataset_status
from doppelgait.dataset.config import PlanConfig, load_plan
from doppelgait.dataset.finish import compute_dataset_id
from doppelgait.dataset.open import Dataset, open_dataset
from doppelgait.dataset.plan import plan_dataset
from doppelgait.dataset.shard_files import ShardFiles
from doppelgait.dataset.verify import verify_dataset

MOST_EXAMPLES = 2000
"""A plan of more is right, takes its time, and is left out."""


def _plan_tables() -> list[dict[str, Any]]:
    tables = [
        load_plan(name)[0].model_dump(mode="json", exclude_none=True) for name in ("home-alarm", "home-alarm-wide")
    ]
    for table in tables:
        table["dataset"]["examples_per_class"] = 4
    small = tiny_dataset.mixed_plan().model_dump(mode="json", exclude_none=True)
    rooms = {
        **tiny_dataset.tiny_plan().model_dump(mode="json", exclude_none=True),
        "environment": [{"choice": [{"kind": "ground_bounce", "material": "concrete"}, {}]}],
        "background": [
            {"motion": {"kind": "curtain"}, "start_position_m": [3, 1], "heading_deg": {"uniform": [0, 90]}}
        ],
        "radar": {"preset": {"choice": ["x4", "ti-60"]}},
        "noise": {"kind": "snr", "snr_db": {"normal": [10, 2]}},
    }
    return [*tables, small, rooms, *_hostile(rooms)]


HOSTILE: tuple[Any, ...] = (
    {"choice": 3}, {"choice": []}, {"choice": {}}, {"cycle": 1}, {"uniform": [-1e308, 1e308]}, {"uniform": [2, 1]},
    {"uniform": "ab"}, {"log_uniform": [0, 1]}, {"log_uniform": [1e-320, 1e308]}, {"normal": [1e308, 1e308]},
    {"normal": [0, -1]}, {"uniform": [None, 1]}, {"choice": [{"choice": [{"uniform": [0, 10**39]}]}]}, 3, "x", [[]], {},
)  # fmt: skip


def _hostile(table: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Plans with such a value at one place each."""
    for number, value in enumerate(HOSTILE):
        for section in ("dataset", "classes", "scene", "target", "radar", "noise", "environment", "background"):
            inner = table[section]
            if isinstance(inner, list):
                inner = [{**inner[0], list(inner[0])[number % len(inner[0])]: value}, *inner[1:]]
            else:
                inner = {**inner, list(inner)[number % len(inner)]: value}
            yield {**table, section: inner}


def plan_seeds(folder: Path) -> None:
    """Plans as text and as tables."""
    for number, table in enumerate(_plan_tables()):
        for ending in ("toml", "json") if number < 4 else ("json",):
            text = write_toml(table) if ending == "toml" else json.dumps(table)
            place = folder / f"{number}-{ending}"
            place.mkdir(parents=True)
            (place / f"plan.{ending}").write_text(text)


def run_plan(folder: Path) -> None:
    """Check a plan, plan its examples and draw some of them."""
    path = main_file(folder, "")
    if path.suffix == ".toml":
        config, _ = load_plan(path)
    else:
        try:
            table = parse_json(path.read_bytes())
        except (OSError, ValueError):
            return
        if not isinstance(table, dict):
            return
        config = validate(PlanConfig, table, where="plan")
    if sum(config.count_class_examples(section) for section in config.classes) > MOST_EXAMPLES:
        return
    planned = plan_dataset(config, folder=folder)
    compute_dataset_id(planned.config, folder)
    for number in {0, len(planned.examples) // 2, len(planned.examples) - 1}:
        planned.example(number)


SEEDS: dict[str, str] = {}
"""Hash of every file of the dataset without damage."""


def dataset_seeds(folder: Path) -> None:
    """Write one built dataset of four examples."""
    plan = tiny_dataset.tiny_plan(examples_per_class=2, fields=["signature", "cadence_map"])
    build_dataset(plan, folder / "0", executor="serial")
    SEEDS.update(_hashes(folder / "0"))


def _hashes(folder: Path) -> dict[str, str]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): hash_file(path) for path in files}


def run_dataset(folder: Path) -> None:
    """Report, verify and read a dataset; damage that ``verify`` does not find is nonsense."""
    changed, passed = True, False
    with suppress(OSError):  # of a file that is gone meanwhile
        changed = _hashes(folder) != SEEDS
    with suppress(DoppelgaitError):
        passed = verify_dataset(folder, share=0.0, rng=np.random.default_rng(1)).passed
    assert not (passed and changed), "verify found nothing"
    with suppress(DoppelgaitError):
        read_dataset_status(folder)
    dataset = open_dataset(folder)
    dataset.select("label == 'dog'")
    with suppress(DoppelgaitError):
        dataset.features()
    _read_all(dataset)


def _read_all(dataset: Dataset) -> None:
    for number in range(len(dataset)):
        try:
            example = dataset.example(number)
            for array in example.arrays.values():
                assert array.ndim == len(array.dims)
        except DoppelgaitError:
            pass
    dataset.files.close()


WHOLE: list[Dataset] = []


def shard_seeds(folder: Path) -> None:
    """Write one shard of a dataset that stays whole."""
    whole = folder.parent / "whole"
    dataset_seeds(whole)
    WHOLE[:] = [open_dataset(whole / "0")]
    for number in (0, 1):
        place = folder / str(number)
        place.mkdir(parents=True)
        path = sorted((whole / "0" / "shards").glob("*.h5"))[number]
        (place / path.name).write_bytes(path.read_bytes())


def run_shard(folder: Path) -> None:
    """Read all examples of a shard."""
    path, (whole,) = main_file(folder, ""), WHOLE
    rows = whole.index[whole.index["shard"] == path.stem].reset_index(drop=True)
    _read_all(Dataset(folder, whole.description, rows, ShardFiles(folder, whole.description["id"])))


TARGETS = {
    "plan": Target(plan_seeds, run_plan, 60),
    "dataset": Target(dataset_seeds, run_dataset, 4),
    "shard": Target(shard_seeds, run_shard, 16),
}
