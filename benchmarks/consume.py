"""How fast a dataset is read: batches, torch loaders, features, exports, and the index of a large one.

Usage: python benchmarks/consume.py DATASET [--rows 100000] [--examples 200] [--only PART]
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from doppelgait.dataset import Dataset, PlanConfig, open_dataset
from doppelgait.dataset.export import export_dataset
from doppelgait.dataset.stream import stream_examples

ROUNDS = 3
BATCH = 32

LARGE = """
import json, sys, time
import numpy, pandas
from doppelgait.dataset import open_dataset
def clock(call):
    began = time.perf_counter()
    result = call()
    return result, time.perf_counter() - began
def peak_mb():
    text = open("/proc/self/status").read()
    return int(text.partition("VmHWM:")[2].split()[0]) / 1024
before_mb = peak_mb()
dataset, open_s = clock(lambda: open_dataset(sys.argv[1]))
_, six_s = clock(dataset.features)
_, extended_s = clock(lambda: dataset.features("extended"))
part, select_s = clock(lambda: dataset.select("truth_aspect_deg < 30 and label == 'dog'"))
_, id_s = clock(lambda: (dataset.index["id"] == "none").any())
print(json.dumps({"rows": len(dataset), "open_s": open_s, "features_s": six_s, "features_extended_s": extended_s,
    "select_s": select_s, "find_id_s": id_s, "before_mb": before_mb,
    "peak_mb": peak_mb()}))
"""


def rates(read: Callable[[], Iterable[int]]) -> dict[str, float]:
    """Best examples per second of wall and of processor time; ``read`` gives the sizes of its batches."""
    wall, cpu = [], []
    for _ in range(ROUNDS):
        began, used = time.perf_counter(), time.process_time()
        count = sum(read())
        wall.append(count / (time.perf_counter() - began))
        cpu.append(count / (time.process_time() - used))
    return {"per_s": max(wall), "per_cpu_s": max(cpu)}


def batch_sizes(dataset: Dataset, *, shuffle: bool) -> Iterator[int]:
    rng = np.random.default_rng(1) if shuffle else None
    for batch in dataset.batches(["signature"], BATCH, rng, shuffle=shuffle):
        yield len(batch["label"])


def loader_sizes(dataset: Dataset, workers: int) -> Iterator[int]:
    import torch
    from torch.utils.data import DataLoader

    torch.set_num_threads(1)  # else its threads wait for each other in collecting a batch, as workers never do
    loader = DataLoader(dataset.torch(["signature"]), batch_size=BATCH, shuffle=True, num_workers=workers)
    for _, labels in loader:
        yield len(labels)


def plain_sizes(dataset: Dataset) -> Iterator[int]:
    """Read whole shards in order by plain h5py: the floor."""
    import h5py

    for shard in dataset.index["shard"].unique():
        with h5py.File(dataset.directory / "shards" / f"{shard}.h5") as file:
            yield len(file["signature"][:])


def reading(dataset: Dataset) -> dict[str, Any]:
    found = {
        "plain h5py, whole shards in order": rates(lambda: plain_sizes(dataset)),
        "batches in order": rates(lambda: batch_sizes(dataset, shuffle=False)),
        "batches shuffled": rates(lambda: batch_sizes(dataset, shuffle=True)),
        "labelled examples": rates(lambda: (1 for _ in dataset)),
    }
    try:
        import torch  # noqa: F401
    except ImportError:
        return found
    return found | {f"torch, shuffled, {n} workers": rates(lambda n=n: loader_sizes(dataset, n)) for n in (0, 1, 2)}


def large_index(dataset: Dataset, rows: int) -> dict[str, Any]:
    """Measure time and memory of opening a large index in a new process."""
    repeats = -(-rows // len(dataset))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copyfile(dataset.directory / "dataset.json", folder / "dataset.json")
        index = pd.concat([dataset.index] * repeats, ignore_index=True).iloc[:rows]
        index = index.assign(id=[f"{text}-{n}" for n, text in enumerate(index["id"])])
        table = pa.Table.from_pandas(index, preserve_index=False)
        pq.write_table(table.replace_schema_metadata({"dataset": dataset.description["id"]}), folder / "index.parquet")
        run = subprocess.run([sys.executable, "-c", LARGE, name], check=True, capture_output=True, text=True)
        found: dict[str, Any] = json.loads(run.stdout)
        return found | {"index_mb": (folder / "index.parquet").stat().st_size / 1e6}


def exporting(dataset: Dataset) -> dict[str, Any]:
    forms: dict[str, list[str] | None] = {"csv": None, "parquet": ["signature"], "webdataset": ["signature"]}
    try:
        import zarr  # noqa: F401

        forms["zarr"] = ["signature"]
    except ImportError:
        pass
    found = {}
    with tempfile.TemporaryDirectory() as name:
        for form, fields in forms.items():
            began = time.perf_counter()
            report = export_dataset(dataset, Path(name) / form, form=form, fields=fields)
            seconds = time.perf_counter() - began
            found[form] = {"per_s": len(dataset) / seconds, "bytes_per_example": report.bytes / len(dataset)}
    return found


def streaming(dataset: Dataset, count: int) -> dict[str, float]:
    """Simulate on the fly, without a disk.

    The first examples load the kernels.
    """
    examples = iter(stream_examples(PlanConfig.model_validate(dataset.description["config"])))
    for _ in islice(examples, 4):
        pass
    began, used = time.perf_counter(), time.process_time()
    for _ in islice(examples, count):
        pass
    return {"per_s": count / (time.perf_counter() - began), "per_cpu_s": count / (time.process_time() - used)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--rows", type=int, default=100_000)
    parser.add_argument("--examples", type=int, default=200, help="examples of the streaming test")
    parser.add_argument("--only", choices=["reading", "large_index", "exporting", "streaming"])
    options = parser.parse_args()
    dataset = open_dataset(options.dataset)
    began = time.perf_counter()
    dataset.features()
    report: dict[str, Any] = {"examples": len(dataset), "features_s": time.perf_counter() - began}
    parts: dict[str, Callable[[], Any]] = {
        "reading": lambda: reading(dataset),
        "large_index": lambda: large_index(dataset, options.rows),
        "exporting": lambda: exporting(dataset),
        "streaming": lambda: streaming(dataset, options.examples),
    }
    report |= {name: part() for name, part in parts.items() if options.only in (None, name)}
    print(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
