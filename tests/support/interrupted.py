"""Commands that are interrupted at random moments: how they end, and whether the same command then completes."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import processes
from dataset_plans import dataset_hash, tiny_plan
from doppelgait.core.config import write_toml
from doppelgait.dataset.build import build_dataset
from doppelgait.dataset.plan import plan_dataset
from doppelgait.pipeline import run_simulation
from doppelgait.radar import write_recording

KINDS = ("processes", "serial", "dask", "import", "evaluate", "verify", "live")
START = (
    "from doppelgait.core.interrupt import restore_signals; restore_signals(); print('begun', flush=True); "
    "from doppelgait.cli import main; main()"
)


@dataclass
class Interrupted:
    """How interrupted commands ended.

    ``statuses`` of those that a signal met at work (0: it came after the last look, the work is complete).
    """

    statuses: Counter[int] = field(default_factory=Counter)
    tracebacks: list[str] = field(default_factory=list)
    resumed: bool = True


@cache
def inputs(kind: str, folder: Path) -> dict[str, str]:
    """Write the plan, the dataset or the recordings for a command."""
    plan = tiny_plan(dataset={"examples_per_class": 12, "shard_size": 3, "seed": 5})
    (folder / "plan.toml").write_text(write_toml(plan.model_dump(mode="json", exclude_none=True)))
    recordings, lines = folder / "recordings", ["file,label,subject"]
    if kind in ("evaluate", "verify") and not (folder / "whole").exists():
        build_dataset(tiny_plan(dataset={"examples_per_class": 30}), folder / "whole", executor="serial")
    elif kind in ("import", "live") and not recordings.exists():
        recordings.mkdir()
        planned = plan_dataset(plan, folder=folder)
        for number in range(12):
            spec = planned.example(2 * number)
            write_recording(run_simulation(spec.run), recordings / f"{number}.h5")
            lines.append(f"{number}.h5,{spec.label},s{number}")
        (folder / "labels.csv").write_text("\n".join(lines) + "\n")
    return {"plan": str(folder / "plan.toml"), "whole": str(folder / "whole"), "recordings": str(recordings)}


def command(kind: str, folder: Path, target: Path) -> list[str]:
    """The command of a kind that writes to a target."""
    known = inputs(kind, folder)
    arguments = {
        "import": ["dataset", "import", known["recordings"], "--labels", str(folder / "labels.csv"), "-o", str(target),
                   "--gate", "2:6"],
        "evaluate": ["evaluate", known["whole"], "-o", str(target)],
        "verify": ["dataset", "verify", known["whole"]],
        "live": ["live", str(Path(known["recordings"]) / "0.h5"), "--log", str(target)],
    }.get(kind, ["dataset", "build", known["plan"], "-o", str(target), "--executor", kind])  # fmt: skip
    workers = ["--workers", "2"] if arguments[1] == "build" else []
    return [sys.executable, "-c", START, *arguments, *workers]


def interrupt_often(kind: str, folder: Path, count: int, *, seed: int) -> Interrupted:
    """Interrupt a command at random moments of its whole time, by Ctrl-C (as a terminal, to the group) and SIGTERM."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
    rng, found, whole_s = random.Random(seed), Interrupted(), 0.0
    for name in ("first", "whole") if count > 10 else ("whole",):  # the first one loads what is not in the memory yet
        with processes.started(command(kind, folder, folder / f"{kind}-{name}"), **pipes) as process:
            process.stdout.readline()
            began = time.monotonic()
            process.communicate(timeout=processes.LIMIT_S)
            whole_s = time.monotonic() - began
    for number in range(count):
        target = folder / f"{kind}-{number}"
        with processes.started(command(kind, folder, target), **pipes) as process:
            process.stdout.readline()
            try:
                process.wait(rng.uniform(0.0, whole_s))
                continue
            except subprocess.TimeoutExpired:
                pass
            try:
                if number % 2:
                    process.terminate()
                else:
                    os.killpg(process.pid, signal.SIGINT)
                complaints = process.communicate(timeout=60.0)[1]
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                complaints = "hung"
            found.statuses[process.returncode] += 1
            if "Traceback" in complaints and kind != "dask":  # Dask's own processes say what they please
                found.tracebacks.append(complaints)
        if kind in ("processes", "serial", "dask", "import") and number < min(20, max(1, count // 2)):
            again = command(kind if kind == "import" else "serial", folder, target)
            done = processes.run(again, capture_output=True, text=True)
            same = kind == "import" or dataset_hash(target) == dataset_hash(folder / f"{kind}-whole")
            found.resumed &= done.returncode == 0 and same and not list(folder.rglob("*.partial"))
        shutil.rmtree(target, ignore_errors=True)
    return found
