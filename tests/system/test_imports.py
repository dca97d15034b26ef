"""What importing the package loads, in a process of its own."""

from pathlib import Path

import processes


def test_importing_viz_loads_neither_matplotlib_nor_pyplot() -> None:
    code = (
        "import sys, doppelgait.viz as v; assert 'matplotlib' not in sys.modules; "
        "[getattr(v, name) for name in v.__all__]; assert 'matplotlib.pyplot' not in sys.modules"
    )
    processes.python(code)


def test_simulate_and_analyze_load_no_library_that_they_do_not_use(tmp_path: Path) -> None:
    code = (
        "import sys; from doppelgait.cli.app import app; "
        "app(['simulate', '--motion', 'boulic', '--duration', '2', '-o', 'walk.h5'], standalone_mode=False); "
        "app(['analyze', 'walk.h5', '--gate', 'truth'], standalone_mode=False); "
        "assert 'xarray' in sys.modules; "
        "heavy = {'dask', 'numba', 'matplotlib', 'pyarrow.parquet', 'scipy.signal', 'sklearn', 'torch'}; "
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)"
    )
    processes.python(code, cwd=tmp_path)


def test_a_room_is_simulated_without_dask() -> None:
    """Xarray imports Dask, where it is installed, for variables and selections made in its ordinary way."""
    code = (
        "import sys, doppelgait as dg; from doppelgait.pipeline import Conditions; "
        "from doppelgait.scene.environment import make_effect; "
        "walk, cloth = dg.motion.boulic_walk(duration_s=1.2), dg.motion.curtain(duration_s=1.2); "
        "targets = [dg.Target(walk, label='human'), dg.Target(cloth, label='curtain', background=True)]; "
        "scene = dg.Scene(targets, duration_s=1.0, radar_position_m=(0.0, 0.0, 1.0)); "
        "floor = {'kind': 'ground_bounce'}; wall = {'kind': 'wall', 'material': 'wood', 'thickness_m': 0.02}; "
        "clutter = {'kind': 'static_clutter', 'rcs_per_metre_m2': 0.1}; "
        "phase = {'kind': 'phase_noise', 'white_rad': 0.01}; "
        "conditions = Conditions(environment=[make_effect(floor), make_effect(wall)], impairments=[clutter, phase]); "
        "radar = dg.Radar.preset('x4', antenna={'kind': 'cosine', 'hpbw_azimuth_deg': 65, 'hpbw_elevation_deg': 65}); "
        "recording = dg.simulate(scene, radar, rng=dg.rng(1), conditions=conditions); "
        "dg.analyze(recording, gate='truth'); "
        "assert 'xarray' in sys.modules; assert not {'dask', 'numba'} & set(sys.modules)"
    )
    processes.python(code)
