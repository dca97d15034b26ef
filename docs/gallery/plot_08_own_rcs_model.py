"""
Radar cross sections, built in and your own
===========================================

The share of each body part in the radar cross section determines which parts are strong in a signature.
"""

from typing import Literal

import numpy as np
import xarray as xr
from pydantic import Field

import doppelgait as dg
from doppelgait import FrozenModel, viz
from doppelgait.scene.environment import Setting

walk = dg.motion.human_gait(speed_mps=1.3, duration_s=2.5)
radar = dg.Radar.preset("x4")

# %%
# **Built in.** ``equal`` gives every point the same share, as in the report, and makes the limbs too strong.
# ``body_parts`` weights them. ``surfaces`` (the default for bodies with joints) makes one scatterer per body segment:
# ellipsoids, and limbs as rough tapered cylinders that flash when they stand across the line of sight.


def seen_as(rcs, *effects):
    """Signature of the same walk with another cross section, without noise."""
    scene = dg.Scene(targets=[dg.Target(walk, label="human", range_m=5.0, rcs=rcs)])
    conditions = dg.pipeline.Conditions(environment=effects)
    return dg.analyze(dg.simulate(scene, radar, conditions=conditions), gate="truth")[0]


results = {kind: seen_as(kind) for kind in ("equal", "body_parts", "surfaces")}
figure = viz.contact_sheet(
    [result.signature for result in results.values()], titles=list(results), db_range=40, doppler_hz=(-100, 300)
)

# %%
# **Your own.** Before the radar, a scene is a table: range, radial velocity, direction and cross section of every
# scatterer at every pulse. A function from table to table, with its parameters, becomes an entry of
# ``[[environment]]``. This one adds reflectors to the walker's shoes.


class ShinyShoes(FrozenModel):
    """Feet with reflectors, which return ``gain_db`` more than feet do."""

    kind: Literal["shiny_shoes"] = "shiny_shoes"
    gain_db: float = Field(default=15.0, ge=-60, le=60)


def apply_shiny_shoes(scatterers: xr.Dataset, spec: ShinyShoes, setting: Setting) -> xr.Dataset:
    """Scatterer table with more cross section at the feet."""
    feet = np.isin(scatterers["part"].values, ["left_foot", "right_foot"])
    rcs = scatterers["rcs"]
    gain = np.where(feet, 10 ** (spec.gain_db / 10), 1.0)  # (scatterer,); a model may also vary with slow_time
    return scatterers.assign(rcs=rcs.copy(data=rcs.values * gain))


dg.plugin("environment", parameters=ShinyShoes)(apply_shiny_shoes)

# %%
# ``kind = "shiny_shoes"`` is now allowed in scenes and plans of this process. A package registers it for all processes
# by an entry point (see the how-to). A model that depends on the direction sets ``needs_angles``; the table then has
# ``aspect``, ``azimuth`` and ``elevation``, in radians.

plain = results["body_parts"]
shiny = seen_as("body_parts", {"kind": "shiny_shoes", "gain_db": 15})
figure = viz.contact_sheet(
    [plain.signature, shiny.signature], titles=["body parts", "with shiny shoes"], db_range=40, doppler_hz=(-100, 300)
)

# %%
# **What to look at.** The arcs of the feet become stronger, and so does a line at 0 Hz, because a foot stands still for
# most of a stride. This constant line does not repeat, so the limb-to-torso ratio (repeating over constant power)
# falls. The gait frequency hardly changes: it does not depend on the level of each part.

for name, result in {**results, "shiny shoes": shiny}.items():
    ratio = result.features.as_dict()["limb_torso_ratio"]
    print(f"{name:12s} limb-to-torso ratio {ratio:.2f}, gait frequency {result.gait_frequency_hz:.3f} Hz")
