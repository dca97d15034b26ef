"""Examples of datasets, writing them, builds of fresh processes, and one long recording."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from clock import timing

from doppelgait.dataset import load_plan, plan_dataset
from doppelgait.dataset.shard import BuildContext, build_planned
from doppelgait.dataset.shard_files import write_shard

ROOMS = Path(__file__).parents[1] / "examples" / "rooms-plan.toml"
N_EXAMPLES = 24
MAKE_LONG = (
    "import doppelgait as dg, numpy as np; "
    "n = 600 * 1000; i = np.arange(n); r = np.random.default_rng(0); "
    "y = 1e-6 * r.standard_normal((n, 120), dtype=np.float32).view(np.complex64); "
    "y[:, 20:30] += (1e-4 * np.exp(1j * (0.9 * i + 40 * np.sin(2 * np.pi * i / 1000)))).astype(np.complex64)[:, None]; "
    "radar = dg.Radar.preset('x4', prf_hz=1000); axis = radar.range_axis_m()[:60]; "
    "dg.radar.write_recording(dg.Recording(dg.core.samples.Samples(y), radar, i / 1000, axis), PATH)"
)
LONG = (
    "import time, doppelgait as dg; began = time.process_time(); recording = dg.radar.read_recording(PATH); "
    "dg.analyze(recording, gate=tuple(recording.range_m[[20, 30]])); print(time.process_time() - began)"
)


def measure_datasets(rounds: int, *, quick: bool) -> dict[str, Any]:
    """Milliseconds of an example by plan, of writing it, and KiB of its signature."""
    result: dict[str, Any] = {"seconds": {}}
    for name, plan_name in (("home-alarm", "home-alarm"), ("rooms plan", str(ROOMS))):
        config, folder = load_plan(plan_name, overrides=[])
        plan = plan_dataset(config, folder=folder)
        entries = list(plan.examples)[:: max(1, len(plan.examples) // (6 if quick else N_EXAMPLES))]
        context = BuildContext(plan.config, str(plan.folder), ".")
        size = context.batch_size
        batches = [entries[first : first + size] for first in range(0, len(entries), size)]
        rows = [row for batch in batches for made in build_planned(batch, context) for row in made]
        spent = []
        for _ in range(rounds):
            began = time.thread_time()
            for batch in batches:
                build_planned(batch, context)
            spent.append((time.thread_time() - began) / len(entries))
        result["seconds"][f"{name}, made"] = timing(spent)
        with tempfile.TemporaryDirectory() as place:
            path, spent = Path(place) / "shard.h5", []
            for _ in range(rounds + 2):
                began = time.thread_time()
                write_shard(path, "train", [row["id"] for row, _ in rows], [arrays for _, arrays in rows])
                spent.append((time.thread_time() - began) / len(rows))
            result["seconds"][f"{name}, written"] = timing(spent)
            result[f"KiB of a row, {name}"] = path.stat().st_size / 1024 / len(rows)
    return result


def measure_builds(*, quick: bool) -> dict[str, Any]:
    """Wall seconds of builds in fresh processes, processor seconds of a first run, and a long recording."""
    result: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as place:
        for count in (20,) if quick else (20, 400):
            command = [sys.executable, "-c", "from doppelgait.cli.app import main; main()", "dataset", "build"]
            options = ["home-alarm", "-o", f"{place}/{count}", "--set", f"dataset.examples_per_class={count // 2}"]
            began = time.perf_counter()
            subprocess.run([*command, *options, "--workers", "2"], check=True, capture_output=True)
            result[f"dataset build of {count}, 2 workers, wall s"] = time.perf_counter() - began
            shutil.rmtree(f"{place}/{count}")
        if not quick:
            path = f"PATH = {place + '/long.h5'!r}; "
            subprocess.run([sys.executable, "-c", path + MAKE_LONG], check=True)
            done, result["600 s recording, peak MB"] = run_fresh_and_print(path + LONG)
            result["600 s recording, analyze, s"] = float(done)
    return result


def run_fresh_and_print(program: str) -> tuple[str, float]:
    """Return what a program prints, and its peak memory in MB; ``ru_maxrss`` would begin with that of its parent."""
    peak = "print(next(l for l in open('/proc/self/status') if l.startswith('VmHWM')).split()[1])"
    done = subprocess.run([sys.executable, "-c", f"{program}; {peak}"], capture_output=True, text=True, check=True)
    *_, printed, peak_kb = done.stdout.split()
    return printed, float(peak_kb) / 1024
