"""
A feature of your own
=====================

Beside the six, 26 features come with the package. One more is a function, a unit and the place it comes from.
"""

# sphinx_gallery_thumbnail_number = 2

import numpy as np
import pandas as pd

import doppelgait as dg
from doppelgait import viz
from doppelgait.features import Observed

# %%
# The function gets one target's processed signature (:class:`doppelgait.features.observed.Observed`), with what
# several features share already made. It is called only where what it ``needs`` is known; None means undetermined.
# This one: for which share of the time is something quicker than twice the torso?


@dg.plugin(
    "feature", "quick_time_share", unit="1", source="ours: time with quick limbs", needs=("direction", "envelope")
)
def quick_time_share(observed: Observed) -> float | None:
    """Share of the columns whose leading envelope is beyond twice the torso's velocity."""
    torso_mps = abs(float(observed.line_mps.mean()))
    return float(np.mean(observed.forward_mps > torso_mps))  # envelope, relative to the torso's line


# %%
# It is now computed with every analysis, is stored in every dataset (column ``extended_quick_time_share``) and is
# seen by the classifiers ``extended-*``.

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
# **What to look at.** Whether it tells the classes apart better than what is there already. Drawn beside its rivals:
# it does not, ``limb_share`` does (whose distance rests on the radar cross sections that the models assume). So this
# one may go again, as most features do.

figure = viz.feature_matrix(table, features=["quick_time_share", "limb_share", "far_limb_share"])
print(table.groupby("label")["quick_time_share"].describe()[["count", "mean", "std"]].round(3))
