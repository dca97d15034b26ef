"""The environment of worker processes."""

import os

import processes
from doppelgait.core.worker import WORKER_ENVIRONMENT, mark_workers


def test_the_callers_environment_is_as_before(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    monkeypatch.delenv("MALLOC_TRIM_THRESHOLD_", raising=False)
    with mark_workers():
        assert {name: os.environ[name] for name in WORKER_ENVIRONMENT} == WORKER_ENVIRONMENT
    assert os.environ["OMP_NUM_THREADS"] == "8"
    assert "MALLOC_TRIM_THRESHOLD_" not in os.environ


def test_a_prepared_process_works_without_arrow():
    program = (
        "from doppelgait.core.worker import prepare_worker; prepare_worker(); import pandas, sys; "
        "assert sys.modules['pyarrow'] is None; assert len(pandas.DataFrame({'a': [1, 2]})) == 2"
    )
    processes.python(program)
