"""Plug-ins in a process of its own."""

from __future__ import annotations

import os
import sys

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
    done = processes.run([sys.executable, "-c", FIRST_LOOK], capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == "[(6, 'impulse')]", done.stderr


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


def test_a_package_that_fails_or_takes_a_name_is_left_out_whole_with_a_warning(tmp_path):
    for name, text in (("half", HALF), ("taken", TAKEN)):
        (tmp_path / f"{name}_plugins.py").write_text(text)
        (tmp_path / f"{name}-1.dist-info").mkdir()
        (tmp_path / f"{name}-1.dist-info" / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
        entry = f"[doppelgait.plugins]\n{name} = {name}_plugins\n"
        (tmp_path / f"{name}-1.dist-info" / "entry_points.txt").write_text(entry)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])}
    done = processes.run([sys.executable, "-c", LOOK], capture_output=True, text=True, timeout=120, env=environment)
    assert done.stdout.strip() == "2 [] False doppelgait", done.stderr


def test_a_package_of_version_0_1_0_is_left_out_with_what_to_do(tmp_path):
    (tmp_path / "old-1.dist-info").mkdir()
    (tmp_path / "old-1.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: old\nVersion: 1\n")
    (tmp_path / "old-1.dist-info" / "entry_points.txt").write_text("[doppelgait.impairments]\nhum = old_hum:hum\n")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])}
    look = "from doppelgait.core.plugins import list_foreign_plugins; print(list_foreign_plugins())"
    done = processes.run([sys.executable, "-c", look], capture_output=True, text=True, timeout=120, env=environment)
    assert done.stdout.strip() == "[]"
    assert "'hum' (old_hum:hum) is in the entry-point group 'doppelgait.impairments', which is not read" in done.stderr
    assert "doppelgait.plugins" in done.stderr
