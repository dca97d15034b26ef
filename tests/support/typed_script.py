"""Script of a user for `mypy`, which checks it with the package (pyproject.toml); it is never run.

``assert_type`` fails where mypy knows another type. A mistake has an ``ignore``, which fails where mypy finds none.
"""

from typing import assert_type

from matplotlib.figure import Figure

import doppelgait as dg
from doppelgait.classify.decide import Decision
from doppelgait.core.rng import Streams
from doppelgait.dataset.example import Example
from doppelgait.dataset.open import Dataset
from doppelgait.motion.motion import Motion
from doppelgait.pipeline.result import TargetList
from doppelgait.radar.parameters import Radar
from doppelgait.radar.recording import Recording

scene = dg.Scene([dg.Target("boulic", label="human")], duration_s=3.0)
recording = dg.simulate(scene, "x4", rng=dg.rng(1))
results = dg.analyze(recording, gate="truth")
assert_type(recording, Recording)
assert_type(results, TargetList)
assert_type(results[0].features.torso_velocity_mps, float | None)
assert_type(dg.Radar.preset("x4"), Radar)
assert_type(dg.Run(scene=scene, radar="x4").streams, Streams)
assert_type(dg.motion.read("walk.c3d"), Motion)
assert_type(dg.open_dataset("walks"), Dataset)
assert_type(dg.open_dataset("walks")["train"], Dataset)
assert_type(dg.open_dataset("walks")["dog-000003"], Example)
assert_type(dg.radar.list_preset_names(), list[str])
assert_type(dg.classify.classify("walk.h5"), list[Decision])
assert_type(dg.viz.signature(results[0].signature), Figure)
assert_type(dg.viz.overview(recording, results[0]), Figure)
dg.simulate(scene, "x4", sed=1)  # type: ignore[call-arg]
dg.simulate(scene, radar=7)  # type: ignore[arg-type]
dg.analyse(recording)  # type: ignore[attr-defined]
dg.Analysis(T_d=0.2)  # type: ignore[call-arg]
dg.viz.signatur(results[0].signature)  # type: ignore[attr-defined]
