"""
A feature of your own
=====================

doppelgait computes the six features and 27 extended ones. To add a feature, write a function and state its unit and
source.
"""

# sphinx_gallery_thumbnail_number = 2

import numpy as np
import pandas as pd

import doppelgait as dg
from doppelgait import viz
from doppelgait.features import Observation

# %%
# The function takes one target's processed signature (:class:`doppelgait.features.observed.Observation`), with the
# quantities that several features share. It is called only where everything that it ``needs`` is known. None means
# undetermined. This feature is the share of the time in which a limb is faster than twice the torso.


@dg.plugin(
    "feature", "quick_time_share", unit="1", source="ours: time with quick limbs", needs=("direction", "envelope")
)
def quick_time_share(observed: Observation) -> float | None:
    """Share of the columns with a forward envelope beyond twice the torso's velocity."""
    torso_mps = abs(float(observed.line_mps.mean()))
    return float(np.mean(observed.forward_mps > torso_mps))  # envelope, relative to the torso's line


# %%
# Every analysis now computes the feature. Every dataset stores it (column ``extended_quick_time_share``), and the
# classifiers ``extended-*`` use it.

rng = np.random.default_rng(4)
radar = dg.Radar.preset("x4", prf_hz=1300)
rows = []
for _ in range(25):
    person = dg.motion.human_gait(speed_mps=rng.uniform(0.8, 1.8), duration_s=2.5)
    dog = dg.motion.quadruped_gait(gait="auto", froude=rng.uniform(0.2, 1.2), withers_m=0.5, duration_s=2.5)
    for motion, label in ((person, "human"), (dog, "dog")):
        scene = dg.Scene(targets=[dg.Target(motion, label=label, range_m=5.0)])
        result = dg.analyze(dg.simulate(scene, radar, rng=dg.Streams(4, len(rows)), snr_db=20), gate="truth")[0]
        rows.append({"label": label, **result.features.as_dict(), **result.extended})
table = pd.DataFrame(rows)
figure = viz.feature_scatter(table, x="torso_velocity_mps", y="quick_time_share", title="Time with quick limbs")

# %%
# **What to look at.** Does the new feature separate the classes better than the existing ones? It does not;
# ``limb_share`` does (but its separation depends on the radar cross sections that the models assume). Most new features
# are not worth keeping.

figure = viz.feature_matrix(table, features=["quick_time_share", "limb_share", "far_limb_share"])
print(table.groupby("label")["quick_time_share"].describe()[["count", "mean", "std"]].round(3))
