"""Type checkers know the names of the package, though they are imported on first use."""

from __future__ import annotations

import ast
import re
import sys
from importlib import import_module
from pathlib import Path

import pytest

import processes
from checkout import ROOT

SCRIPT = """\
from typing import reveal_type

import doppelgait as dg

scene = dg.Scene([dg.Target("boulic", label="human")], duration_s=3.0)
recording = dg.simulate(scene, "x4", rng=dg.rng(1))
reveal_type(recording)  # doppelgait.radar.recording.Recording
results = dg.analyze(recording, gate="truth")
reveal_type(results)  # doppelgait.pipeline.result.TargetList
reveal_type(results[0].features.torso_velocity_mps)  # float | None
reveal_type(dg.Radar.preset("x4"))  # doppelgait.radar.parameters.Radar
reveal_type(dg.Run(scene=scene, radar="x4").streams)  # doppelgait.core.rng.Streams
reveal_type(dg.motion.read("walk.c3d"))  # doppelgait.motion.motion.Motion
reveal_type(dg.open_dataset("walks"))  # doppelgait.dataset.open.Dataset
reveal_type(dg.radar.list_preset_names())  # list[str]
reveal_type(dg.classify.classify("walk.h5"))  # list[doppelgait.classify.decide.Decision]
reveal_type(dg.viz.signature(results[0].signature))  # matplotlib.figure.Figure
dg.simulate(scene, "x4", sed=1)  # error: Unexpected keyword argument "sed" for "simulate"
dg.simulate(scene, radar=7)  # error: Argument "radar" to "simulate" has incompatible type "int"
dg.analyse(recording)  # error: Module has no attribute "analyse"
dg.Analysis(T_d=0.2)  # error: Unexpected keyword argument "T_d" for "Analysis"
dg.viz.signatur(results[0].signature)  # error: Module has no attribute "signatur"
"""


@pytest.mark.slow
def test_mypy_checks_the_script_of_a_user(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "cache"), str(script)]
    done = processes.run(command, capture_output=True, text=True, cwd=tmp_path)
    said = dict(re.findall(r'^script\.py:(\d+): (?:note: Revealed type is "|(?=error: ))(.*?)"?$', done.stdout, re.M))
    lines = dict(enumerate(SCRIPT.splitlines(), start=1))
    expected = {number: line.partition("  # ")[2] for number, line in lines.items() if "  # " in line}
    assert sorted(map(int, said)) == sorted(expected), done.stdout + done.stderr
    for number, words in expected.items():
        assert said[str(number)].startswith(words), f"{lines[number]}\n{said[str(number)]}"


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
