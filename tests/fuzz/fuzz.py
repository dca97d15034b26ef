"""Fuzz everything that reads files of unknown origin.

    python tests/fuzz/fuzz.py --cases 100000

Every case is a seed of a target with damage. A case is bad when it ends the process, takes more than 15 s of processor
time or 1 GB of memory, raises anything but the package's own errors, or returns nonsense. The cases are divided by the
shares of the targets. The output is a table of a page; bad cases go to the error output and, with ``--keep FOLDER``,
to a folder. ``--first N --cases 1 --target T`` runs one again: the numbers of a target, its seeds and the damage are
the same in every run with the same ``--seed``.
"""

import argparse
import gc
import importlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import traceback
import warnings
import zlib
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "support")]

from processes import LIMIT_S, started  # noqa: E402

MODULES = ("readers", "datasets", "models")
"""Files of this folder with ``TARGETS``; those that are not there are left out."""
SECONDS = 15.0  # the slowest case takes 2 to 6 s, by machine
MEMORY = 1_000_000_000
FAST = Path("/dev/shm")  # a folder in memory: on a disk, the files of a case take as long as reading them


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


def run_meanwhile(run: Any, rng: Any, folder: Path) -> None:
    """Truncate, delete or replace a file at a random one of the calls that reading takes."""
    whole, calls = shutil.copytree(folder, folder.with_name("whole-case")), [0, 0]
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    path, kind = files[rng.integers(len(files))], rng.integers(4)
    rest = path.read_bytes()[: int(path.stat().st_size * rng.random())]
    other = folder.with_name("other")
    other.write_bytes(rest[::-1])
    change = (partial(os.truncate, path, len(rest)), path.unlink, partial(path.rename, path.with_name("moved")),
              partial(os.replace, other, path))[kind]  # fmt: skip

    def count(*_: Any) -> None:
        calls[0] += 1
        if calls[0] == calls[1]:
            sys.setprofile(None)
            change()

    for place in (whole, folder):
        calls[:] = 0, int(rng.integers(1, calls[0] + 1)) if place == folder else 0
        sys.setprofile(count)
        try:
            run(place)
        finally:
            sys.setprofile(None)
            shutil.rmtree(whole, ignore_errors=True)


def fault_of(run: Any, folder: Path, *, refused: bool = False) -> str:
    """What is bad about one case, or ""; with ``refused``, that it is read is bad, too."""
    from doppelgait.core.errors import DoppelgaitError

    before, fault = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, ""
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
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    if grown > MEMORY / 10:
        with suppress(OSError):
            Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    return fault or (f"{grown / 1e6:.0f} MB of memory" if grown > MEMORY else "")


def work(name: str, seed: int, first: int, stop: int, keep: str, *, meanwhile: bool) -> None:
    """Run some cases of a target; print one line of JSON for each bad one, and the number that begins."""
    import numpy as np
    from attacks import ATTACKS, READ
    from mutators import damage_folder
    from readers import TARGETS

    root = Path(tempfile.mkdtemp(prefix="fuzz-", dir=FAST if os.access(FAST, os.W_OK) else None))
    try:
        for each in TARGETS if name == "attacks" else [name]:
            run = find_target(each)
            run.seeds(root / each)
            seeds = sorted((root / each).iterdir())
            for folder in seeds[: 1 if name == "attacks" else None]:
                if fault := fault_of(run.run, folder):  # also: all that is loaded late is loaded now
                    say = {"target": each, "case": -1, "fault": f"seed {folder.name}: {fault}"}
                    print(json.dumps(say), flush=True)
        contents = [
            {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}
            for folder in seeds
        ]
        gc.freeze()
        size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + 2 * MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))
        folder = root / "case"
        for case in range(first, stop):
            folder.mkdir()
            if name == "attacks":
                said = list(ATTACKS)[case]
                run, refused = find_target(ATTACKS[said](folder)).run, said not in READ
                shutil.rmtree(folder / "seeds", ignore_errors=True)
            else:
                rng = np.random.default_rng([seed, zlib.crc32(name.encode()), case])
                for path, content in contents[rng.integers(len(contents))].items():
                    (folder / path.parent).mkdir(parents=True, exist_ok=True)
                    (folder / path).write_bytes(content)
                run, refused = find_target(name).run, False
                said = "" if meanwhile else damage_folder(folder, rng)
                run = partial(run_meanwhile, run, rng) if meanwhile else run
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


def share_cases(names: list[str], first: int, cases: int) -> list[tuple[str, int, int]]:
    """First and last number of the cases of each target, by their shares; there are few attacks, which are all run."""
    from attacks import ATTACKS

    shares = {name: find_target(name).share for name in names if name != "attacks"}
    stops = {name: first - (-cases * share // sum(shares.values())) for name, share in shares.items()}
    return [(name, first, stops.get(name, min(first + cases, len(ATTACKS)))) for name in names]


def fuzz(todo: list[tuple[str, int, int]], seed: int, *further: str) -> list[dict[str, Any]]:
    """Run cases of targets in one process, and in a new one after each case that ended it; return the bad ones."""
    stops = {name: stop for name, _, stop in todo}
    bad: list[dict[str, Any]] = []
    while todo:
        began = None
        command = [sys.executable, __file__, "--work", json.dumps(todo), "--seed", str(seed), *further]
        with started(command, stdout=subprocess.PIPE, text=True) as process:
            for line in process.stdout:
                if line.startswith("{"):
                    bad.append(json.loads(line))
                elif line.strip():
                    began = (line.split()[0], int(line.split()[1]))
            process.wait(timeout=LIMIT_S)
        if process.returncode == 0:
            break
        code = -process.returncode
        why = f"more than {SECONDS:g} s" if code == signal.SIGPROF else f"ended by signal {code}"
        if code < 0:
            raise SystemExit(f"the fuzzer itself failed after {began}")
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
    parser.add_argument("--meanwhile", action="store_true", help="whole files that change while they are read")
    parser.add_argument("--work", default="", help=argparse.SUPPRESS)
    options = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    if options.work:
        for name, first, stop in json.loads(options.work):
            work(name, options.seed, first, stop, options.keep, meanwhile=options.meanwhile)
        return 0
    names = options.target.split(",") if options.target else target_names()[options.meanwhile :]  # no attacks
    todo = share_cases(names, options.first, options.cases)
    print("| target | cases | bad | processor time, s |\n| --- | ---: | ---: | ---: |", flush=True)
    rows: list[list[float]] = []
    for group in [todo] if options.together else [[one] for one in todo]:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        bad = fuzz(group, options.seed, "--keep", options.keep, *["--meanwhile"] * options.meanwhile)
        for one in bad:
            print("  " + json.dumps(one), file=sys.stderr, flush=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        rows.append([sum(stop - first for _, first, stop in group), len(bad), sum(after[:2]) - sum(before[:2])])
        print_row(group[0][0] if len(group) == 1 else "together", rows[-1])
    totals = [sum(column) for column in zip(*rows, strict=True)]
    print_row(f"all {len(todo)}, seed {options.seed}", totals)
    return int(totals[1] > 0)


def print_row(name: str, figures: list[float]) -> None:
    print(f"| {name} | " + " | ".join(f"{figure:,.0f}" for figure in figures) + " |", flush=True)


if __name__ == "__main__":
    sys.exit(main())
