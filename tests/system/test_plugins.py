"""Plug-ins in a process of its own."""

import processes

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


def test_a_package_of_version_0_1_0_is_left_out_with_what_to_do(tmp_path):
    install(tmp_path, "old", "[doppelgait.impairments]\nhum = old_hum:hum\n")
    look = "from doppelgait.core.plugins import list_foreign_plugins; print(list_foreign_plugins())"
    done = processes.python(look, PYTHONPATH=str(tmp_path))
    assert done.stdout.strip() == "[]"
    assert "'hum' (old_hum:hum) is in the entry-point group 'doppelgait.impairments', which is not read" in done.stderr
    assert "doppelgait.plugins" in done.stderr
