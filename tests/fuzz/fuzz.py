"""Fuzz everything that reads files of unknown origin.

    python tests/fuzz/fuzz.py --cases 100000

Every case is a seed of a target with damage. A case is bad when it ends the process, takes more than 15 s of processor
time or 1 GB of memory, raises anything but the package's own errors, or returns nonsense. Bad cases are printed and
kept with ``--keep FOLDER``; ``--first N --cases 1 --target T`` runs one again. The numbers of a target, its seeds and
the damage are the same in every run with the same ``--seed``.
"""

import argparse
import importlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "support")]

from processes import LIMIT_S, started  # noqa: E402

MODULES = ("readers", "datasets", "models")
"""Files of this folder with ``TARGETS``; those that are not there are left out."""
SECONDS = 15.0  # the slowest case takes 2 to 6 s, by machine
MEMORY = 1_000_000_000


def find_target(name: str) -> Any:
    """A target by its name; only the files up to its own are imported."""
    for module in (module for module in MODULES if (HERE / f"{module}.py").is_file()):
        known = importlib.import_module(module).TARGETS
        if name in known:
            return known[name]
    raise SystemExit(f"there is no target {name!r}")


def target_names() -> list[str]:
    """All targets, the findings of earlier rounds first."""
    found = [module for module in MODULES if (HERE / f"{module}.py").is_file()]
    return ["attacks", *(name for module in found for name in importlib.import_module(module).TARGETS)]


def memory_bytes(name: str) -> int:
    """A line of the process's own accounts in bytes; 0 where the system has none."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith(name)), 0)


def reset_peak() -> None:
    """Let the highest use of memory begin anew."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def fault_of(run: Any, folder: Path, *, refused: bool = False) -> str:
    """What is bad about one case, or ""; with ``refused``, that it is read is bad, too."""
    from doppelgait.core.errors import DoppelgaitError

    reset_peak()
    before = memory_bytes("VmRSS")
    fault = ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            run(folder)
        fault = "it is read" if refused else ""
    except DoppelgaitError as error:
        if len(str(error)) > 3000:
            fault = f"an error message of {len(str(error))} characters"
    except AssertionError as error:
        fault = f"nonsense: {error}"
    except BaseException as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        fault = f"{type(error).__name__}: {str(error)[:200]} ({Path(place.filename).name}:{place.lineno})"
    grown = memory_bytes("VmHWM") - before
    return fault or (f"{grown / 1e6:.0f} MB of memory" if grown > MEMORY else "")


def work(name: str, seed: int, first: int, stop: int, keep: str) -> None:
    """Run some cases of a target; print one line of JSON for each bad one, and the number that begins."""
    import numpy as np
    from attacks import ATTACKS, READ
    from mutators import damage_folder

    root = Path(tempfile.mkdtemp(prefix="fuzz-"))
    from readers import TARGETS

    try:
        for each in TARGETS if name == "attacks" else [name]:
            run = find_target(each)
            run.seeds(root / each)
            for folder in sorted((root / each).iterdir())[: 1 if name == "attacks" else None]:
                if fault := fault_of(run.run, folder):  # also: all that is loaded late is loaded now
                    say = {"target": each, "case": -1, "fault": f"seed {folder.name}: {fault}"}
                    print(json.dumps(say), flush=True)
        hard = memory_bytes("VmSize") + 2 * MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (hard, resource.getrlimit(resource.RLIMIT_AS)[1]))
        folder = root / "case"
        for case in range(first, stop):
            if name == "attacks":
                folder.mkdir()
                said = list(ATTACKS)[case]
                run, refused = find_target(ATTACKS[said](folder)).run, said not in READ
                shutil.rmtree(folder / "seeds", ignore_errors=True)
            else:
                rng = np.random.default_rng([seed, zlib.crc32(name.encode()), case])
                seeds = sorted((root / name).iterdir())
                shutil.copytree(seeds[rng.integers(len(seeds))], folder)
                said, run, refused = damage_folder(folder, rng), find_target(name).run, False
            print(name, case, flush=True)
            if keep:
                shutil.copytree(folder, Path(keep) / f"{name}-{case}", dirs_exist_ok=True)
            signal.setitimer(signal.ITIMER_PROF, SECONDS)  # ends the process, whatever it is in
            fault = fault_of(run, folder, refused=refused)
            signal.setitimer(signal.ITIMER_PROF, 0)
            if fault:
                print(json.dumps({"target": name, "case": case, "fault": fault, "file": said}), flush=True)
            elif keep:
                shutil.rmtree(Path(keep) / f"{name}-{case}")
            shutil.rmtree(folder)
    finally:
        shutil.rmtree(root, ignore_errors=True)


def fuzz(names: list[str], seed: int, first: int, cases: int, keep: str) -> list[dict[str, Any]]:
    """Run cases of targets in one process, and in a new one after each case that ended it; return the bad ones."""
    from attacks import ATTACKS

    stops = {name: min(first + cases, len(ATTACKS)) if name == "attacks" else first + cases for name in names}
    todo = [(name, first, stop) for name, stop in stops.items()]
    bad: list[dict[str, Any]] = []
    while todo:
        began = None
        command = [sys.executable, __file__, "--work", json.dumps(todo), "--seed", str(seed), "--keep", keep]
        with started(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            for line in process.stdout:
                if line.startswith("{"):
                    bad.append(json.loads(line))
                elif line.strip():
                    began = (line.split()[0], int(line.split()[1]))
            said = process.stderr.read()
            process.wait(timeout=LIMIT_S)
        if process.returncode == 0:
            break
        code = -process.returncode
        why = f"more than {SECONDS:g} s" if code == signal.SIGPROF else f"ended by signal {code}"
        if code < 0:
            raise SystemExit(f"the fuzzer itself failed after {began}: {said[-2000:]}")
        if began is None:
            bad.append({"target": todo[0][0], "case": -1, "fault": f"{why} at its seeds"})
            todo = todo[1:]
            continue
        bad.append({"target": began[0], "case": began[1], "fault": why})
        at = [name for name, *_ in todo].index(began[0])
        todo = [(began[0], began[1] + 1, stops[began[0]]), *todo[at + 1 :]]
    return bad


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cases", type=int, default=10_000, help="over all targets")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--target", default="", help="names of targets with commas; default: all")
    parser.add_argument("--keep", default="", help="folder for the files of bad cases")
    parser.add_argument("--together", action="store_true", help="all targets in one process, for short runs")
    parser.add_argument("--work", default="", help=argparse.SUPPRESS)
    options = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    if options.work:
        for name, first, stop in json.loads(options.work):
            work(name, options.seed, first, stop, options.keep)
        return 0
    names = options.target.split(",") if options.target else target_names()
    share = -(-options.cases // max(len([name for name in names if name != "attacks"]), 1))
    n_bad, begun = 0, time.time()
    for group in [names] if options.together else [[name] for name in names]:
        before = time.time()
        bad = fuzz(group, options.seed, options.first, share, options.keep)
        print(f"{', '.join(group)}: {share:,} cases each, {len(bad)} bad, {time.time() - before:.0f} s", flush=True)
        for one in bad[:40]:
            print("  " + json.dumps(one), flush=True)
        n_bad += len(bad)
    print(f"{share * len(names):,} cases over {len(names)} targets, {n_bad} bad, {time.time() - begun:.0f} s")
    return int(n_bad > 0)


if __name__ == "__main__":
    sys.exit(main())
