"""Examples a second of one or more worker processes, each with one thread and reused buffers, and their memory."""

from __future__ import annotations

import itertools
import json
import math
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from clock import Timing

from doppelgait.core.worker import WORKER_ENVIRONMENT

HOPS: dict[str, int | None] = {"hop 1": 1, "lossless hop": None}
SLICE_S = 0.5
PATIENCE_S = 120.0
"""How long a worker may take to start."""


def measure_workers(counts: list[int], seconds: float, obvious: Timing) -> list[dict[str, Any]]:
    """One row for every number of workers and hop: rate, its ratio to one obvious NumPy example, memory."""
    rows = []
    for count in counts:
        reports = run_workers(count, seconds)
        for hop in HOPS:
            rate = total_rate([report[hop] for report in reports])
            rows.append(
                {
                    "workers": count,
                    "hop": hop,
                    "per_second": rate,
                    "ratio": {key: rate[key] * obvious[key] for key in rate},
                    "peak_mb": max(report["peak_mb"] for report in reports),
                }
            )
    return rows


def total_rate(counts: list[list[float]]) -> Timing:
    """Examples a second of all workers, in the best slice of time (``min``, as for seconds) and in the median one."""
    slices = [sum(parts) / SLICE_S for parts in zip(*counts, strict=True)]
    return {"min": max(slices), "median": statistics.median(slices)}


def run_workers(count: int, seconds: float) -> list[dict[str, Any]]:
    """Collect reports of ``count`` new processes that work at the same time.

    They are started as a dataset's workers are.
    """
    environment = {**os.environ, **WORKER_ENVIRONMENT}
    command = [sys.executable, "-c", WORKER_PROGRAM, str(Path(__file__).parent), str(seconds)]
    pipe = subprocess.PIPE
    workers = [subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe, text=True) for _ in range(count)]
    try:
        for _ in HOPS:
            for worker in workers:
                worker.stdout.readline()  # it is ready
            for worker in workers:
                worker.stdin.write("go\n")
                worker.stdin.flush()
        return [json.loads(worker.communicate(timeout=PATIENCE_S)[0]) for worker in workers]
    finally:
        for worker in workers:
            worker.kill()


WORKER_PROGRAM = (
    "import sys; from doppelgait.core.worker import prepare_worker; prepare_worker(); "
    "sys.path.insert(0, sys.argv[1]); import workers; workers.work(float(sys.argv[2]))"
)


def work(seconds: float) -> None:
    """Make examples, at both hops for ``seconds`` each, side by side with the other workers; prints the report."""
    from scenario import scenario

    from doppelgait.core.rng import rng
    from doppelgait.pipeline import analyze, simulate

    radar, scene, analysis = scenario()
    report: dict[str, Any] = {}
    settings = {name: analysis.model_copy(update={"hop": hop}) for name, hop in HOPS.items()}

    def make(number: int, settings: Any) -> None:
        analyze(simulate(scene, radar, rng=rng(number), angles=False), gate="truth", analysis=settings)

    for number, each in enumerate([*settings.values()] * 3):
        make(number, each)
    for name, each in settings.items():
        print("ready", flush=True)
        sys.stdin.readline()
        began, ends = time.perf_counter(), [0.0]
        while ends[-1] < seconds:
            make(len(ends), each)
            ends.append(time.perf_counter() - began)
        report[name] = count_slices(ends, seconds)
    print(json.dumps({**report, "peak_mb": peak_memory_mb()}))


def count_slices(ends_s: list[float], seconds: float) -> list[float]:
    """Examples in every slice of time; one that spans two slices counts by its share in each."""
    counts = [0.0] * round(seconds / SLICE_S)
    for begin, end in itertools.pairwise(ends_s):
        for number in range(int(begin / SLICE_S), min(math.ceil(end / SLICE_S), len(counts))):
            shared_s = min(end, (number + 1) * SLICE_S) - max(begin, number * SLICE_S)
            counts[number] += shared_s / (end - begin)
    return counts


def peak_memory_mb() -> float:
    """Largest resident memory of this process so far, MB of 2^20 bytes (Linux; NaN elsewhere)."""
    try:
        with open("/proc/self/status") as status:
            return next(float(line.split()[1]) / 1024 for line in status if line.startswith("VmHWM"))
    except OSError:
        return math.nan
