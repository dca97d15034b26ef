"""What importing the package loads, in a process of its own."""

import sys
from pathlib import Path

import processes


def test_importing_viz_loads_neither_matplotlib_nor_pyplot() -> None:
    code = (
        "import sys, doppelgait.viz as v; assert 'matplotlib' not in sys.modules; "
        "[getattr(v, name) for name in v.__all__]; assert 'matplotlib.pyplot' not in sys.modules"
    )
    processes.run([sys.executable, "-c", code], check=True)


def test_simulate_and_analyze_load_no_library_that_they_do_not_use(tmp_path: Path) -> None:
    code = (
        "import sys; from doppelgait.cli.app import app; "
        "app(['simulate', '--motion', 'boulic', '--duration', '2', '-o', 'walk.h5'], standalone_mode=False); "
        "app(['analyze', 'walk.h5', '--gate', 'truth'], standalone_mode=False); "
        "assert 'xarray' in sys.modules; "
        "heavy = {'dask', 'numba', 'matplotlib', 'pyarrow.parquet', 'scipy.signal', 'sklearn', 'torch'}; "
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)"
    )
    processes.run([sys.executable, "-c", code], check=True, cwd=tmp_path)
