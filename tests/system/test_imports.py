"""What importing the package loads, and the memory that it needs, in a process of its own."""

import ast
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

import processes
from checkout import ROOT, SUPPORT


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
        "heavy = {'dask', 'matplotlib', 'pandas', 'pyarrow', 'scipy.signal', 'sklearn', 'torch', 'xarray'}; "
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)"
    )
    processes.python(code, cwd=tmp_path)


def test_a_room_is_simulated_and_analysed_without_labels() -> None:
    """Xarray and pandas take as long to import as the simulation; xarray may import Dask."""
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
        "assert not {'xarray', 'pandas', 'dask'} & set(sys.modules); "
        "assert recording.truth[0].scatterers['range'].dims == ('slow_time', 'scatterer'); "
        "assert recording.truth[0].body.dims == ('time', 'marker', 'space'); assert 'dask' not in sys.modules"
    )
    processes.python(code)


@pytest.mark.release
@pytest.mark.skipif(not Path("/proc").exists(), reason="other systems count memory in other units")
def test_a_long_recording_needs_the_memory_of_few_tiles(tmp_path: Path) -> None:
    """A tile has 49 MB. The peak was 660 MB when old tiles were kept while the next were made, and is 450 MB."""
    code = (
        "import sys, doppelgait as dg; walk = dg.Target({'kind': 'boulic', 'speed_mps': 1.0}, "
        "start_position_m=(6, 1.5), heading_deg=90, path={'kind': 'arc', 'radius_m': 2.1, 'turn_deg': 3600}); "
        "dg.simulate(dg.Scene([walk], duration_s=130.0), 'x4', rng=dg.rng(1), path='long.h5'); "
        "assert dg.analyze('long.h5'); "
        # ru_maxrss would include the process that started this one
        "print(int(open('/proc/self/status').read().split('VmHWM:')[1].split()[0]) >> 10)"
    )
    assert int(processes.python(code, cwd=tmp_path).stdout) < 550


def test_lint_checks_the_script_of_a_user() -> None:
    """``typed_script.py`` has uses and mistakes; `make test` runs mypy on it, once for package and script."""
    checked = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["mypy"]
    assert checked["strict"]
    assert {ROOT / name for name in checked["files"]} >= {ROOT / "src" / "doppelgait", SUPPORT / "typed_script.py"}
    assert (ROOT / "src" / "doppelgait" / "py.typed").is_file()  # else a checker of types does not read the package


@pytest.mark.parametrize("package", ["doppelgait", "doppelgait.classify", "doppelgait.viz"])
def test_the_stub_has_the_names_of_the_package(package: str) -> None:
    module = import_module(package)
    stub = ast.parse((ROOT / "src" / Path(*package.split(".")) / "__init__.pyi").read_text(encoding="utf-8"))
    found = {}
    for node in stub.body:
        if isinstance(node, ast.ImportFrom):
            found |= {alias.asname: getattr(import_module(str(node.module)), alias.name) for alias in node.names}
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            found[node.target.id] = getattr(module, node.target.id)
    assert set(found) - {"PLUGIN_ROOMS"} == set(module.__all__)
    for name, value in found.items():  # all modules are imported by now: none of them may take the place of a name
        assert getattr(module, name) is value, name


FIRST_LOOK = """
import threading
from concurrent.futures import ThreadPoolExecutor
from doppelgait.radar import WAVEFORMS, Radar
barrier = threading.Barrier(8)

def look(n):
    barrier.wait(30)
    return len(WAVEFORMS), Radar.preset("x4").waveform.kind

with ThreadPoolExecutor(8) as pool:
    print(sorted(set(pool.map(look, range(8)))))
"""


def test_threads_that_look_first_at_the_same_time_all_find_every_plugin():
    assert processes.python(FIRST_LOOK).stdout.strip() == "[(6, 'impulse')]"


HALF = """
from doppelgait.core.plugins import plugin
plugin("feature", "gaitlab_half", unit="1", source="a test")(lambda observed: 1.0)
import a_module_that_does_not_exist
"""
TAKEN = """
from doppelgait.core.plugins import plugin
plugin("classifier", "six-logistic")(object())
"""
LOOK = """
import warnings
from doppelgait.core.plugins import list_foreign_plugins
with warnings.catch_warnings(record=True) as seen:
    warnings.simplefilter("always")
    from doppelgait.radar import Radar
    Radar.preset("x4")
    from doppelgait.classify.training import CLASSIFIERS
    from doppelgait.features.feature_set import FEATURES
    print(len(seen), list_foreign_plugins(), "gaitlab_half" in FEATURES, CLASSIFIERS["six-logistic"].package)
"""


def install(folder, name, entry):
    """What pip leaves of a package without modules: its entry points."""
    facts = folder / f"{name}-1.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
    (facts / "entry_points.txt").write_text(entry)


def test_a_package_that_fails_or_takes_a_name_is_left_out_whole_with_a_warning(tmp_path):
    for name, text in (("half", HALF), ("taken", TAKEN)):
        (tmp_path / f"{name}_plugins.py").write_text(text)
        install(tmp_path, name, f"[doppelgait.plugins]\n{name} = {name}_plugins\n")
    assert processes.python(LOOK, PYTHONPATH=str(tmp_path)).stdout.strip() == "2 [] False doppelgait"
