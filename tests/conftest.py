"""Fixtures, the order of the tests, and the rules of both tiers."""

import gc
import os
import platform
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import h5py  # noqa: F401  asks the system for the processor with a process, once, when it is imported
import pytest
import scipy.linalg  # noqa: F401  brings the second BLAS, which only then can be limited
from threadpoolctl import threadpool_limits

from checkout import SHARED
from doppelgait.core import interrupt, plugins

PROCESS_ROOMS = ("system", "browser", "fuzz")
PROCESS_EVENTS = frozenset({"subprocess.Popen", "os.fork", "os.posix_spawn", "os.system"})

gc.set_threshold(20_000)  # at every 700 new objects it takes a tenth of the suite's time, in imports above all
plugins.packages_distributions = cache(plugins.packages_distributions)  # reads the names of all installed packages
platform.processor()  # kept by Python: importing h5py asks for it, by a process that some tests may not start

TESTS = Path(__file__).parent
LONGEST = (
    "system/docs/test_site.py",
    "system/docs/test_examples.py",
    "system/dataset/test_verify.py",
    "browser/test_run_page.py",
    "browser/test_run_tools.py",
    "system/dataset/test_faults.py",
    "system/classify/test_classify.py",
    "system/dataset/test_executors.py",
    "system/dataset/test_scenes.py",
    "system/test_packaging.py",
    "system/test_interrupt.py",
    "system/dataset/test_crash.py",
    "browser/test_try_page.py",
    "browser/test_dataset_page.py",
)
"""Files of a quarter of a minute and more, by their time: begun first, so that no worker ends long after the others."""


@pytest.hookimpl(tryfirst=True)  # before pytest leaves out what is marked
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: _rank(item.path))
    for item in items:
        if item.path.parent == TESTS / "system" / "studies" and item.path.stem != "test_imports":
            item.add_marker(pytest.mark.release)
    _order_shared(items)


def _rank(path: Path) -> tuple[int, str]:
    name = path.relative_to(TESTS).as_posix() if path.is_relative_to(TESTS) else path.as_posix()
    if name in LONGEST:
        return LONGEST.index(name), name
    return len(LONGEST) + (not name.startswith("system/")), name


def _order_shared(items: list[pytest.Item]) -> None:
    """Tests of the shared data skip without it; in CI they fail."""
    if SHARED.is_dir():
        return
    reason = "the shared test data is not beside this checkout (../shared)"
    for item in items:
        if item.get_closest_marker("shared"):
            if os.environ.get("CI", "").lower() == "true":
                item.add_marker(pytest.mark.usefixtures("_shared_data_required"))
            else:
                item.add_marker(pytest.mark.skip(reason=reason))


def pytest_collection_finish(session: pytest.Session) -> None:
    """What is collected lives to the end: the garbage collector need not look through it again and again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def _forget_signals() -> Iterator[None]:
    """Commands answer a signal with status 130, also one that an earlier test of this process sent to itself."""
    yield
    interrupt.Stop.came = False


@pytest.fixture
def register(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Register plug-ins for one test."""
    for group in plugins.list_plugin_groups().values():
        len(group)  # built-in ones first
    monkeypatch.setattr(plugins, "_REGISTERED", {group: dict(items) for group, items in plugins._REGISTERED.items()})
    return plugins.plugin


@pytest.fixture
def _shared_data_required() -> None:
    pytest.fail("CI needs the shared test data beside the checkout (../shared)")


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of the shared test data; only tests marked ``shared`` may ask for it."""
    return SHARED


def pytest_configure(config: pytest.Config) -> None:
    """Let matrix products use one thread, here and in new processes: the threads of small ones wait for each other."""
    sys.addaudithook(_refuse_processes)
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    threadpool_limits(1)


class _Now:
    """What holds while a test runs in this process."""

    room: str | None = None
    """Folder of the test; None between tests."""


def pytest_runtest_logstart(nodeid: str, location: object) -> None:
    _Now.room = nodeid.removeprefix("tests/").partition("/")[0]


def pytest_runtest_logfinish(nodeid: str, location: object) -> None:
    _Now.room = None


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print the attacks that tests count, as a table of a page."""
    reports = terminalreporter.stats.get("passed", ())
    rows = [row for report in reports for name, row in report.user_properties if name == "attack"]
    for row in [("attack", "count", "outcome"), ("---", "---:", "---"), *rows] if rows else []:
        terminalreporter.write_line(f"| {' | '.join(map(str, row))} |")


def _refuse_processes(event: str, arguments: object) -> None:
    """Tests of `make check` start no process."""
    if event in PROCESS_EVENTS and _Now.room not in (None, *PROCESS_ROOMS):
        raise AssertionError(f"{event}: only tests in {', '.join(PROCESS_ROOMS)} may start processes")
