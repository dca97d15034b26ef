"""What importing the package loads, in a process of its own."""

import sys

import processes


def test_importing_viz_loads_neither_matplotlib_nor_pyplot() -> None:
    code = (
        "import sys, doppelgait.viz as v; assert 'matplotlib' not in sys.modules; "
        "[getattr(v, name) for name in v.__all__]; assert 'matplotlib.pyplot' not in sys.modules"
    )
    processes.run([sys.executable, "-c", code], check=True)
