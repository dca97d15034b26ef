"""
Person or dog: six features
===========================

A person and a dog have the same speed, radar cross section and position. Which features still separate them?
"""

import numpy as np
import pandas as pd

import doppelgait as dg
from doppelgait import viz

radar = dg.Radar.preset("x4", prf_hz=1300)
rng = np.random.default_rng(3)


def look(motion, label: str, *, snr_db: float = 20.0, example: int = 0):
    """Result of one target that approaches at 5 m."""
    target = dg.Target(motion, label=label, range_m=5.0, rcs=dg.scene.RcsSpec(total_m2=0.5))
    recording = dg.simulate(dg.Scene(targets=[target]), radar, rng=dg.Streams(3, example), snr_db=snr_db)
    return dg.analyze(recording, gate="truth")[0]


# %%
# A person and a dog at 1.3 m/s. The dog's legs are shorter: it takes more steps, and its paws swing less far.

person = look(dg.motion.human_gait(speed_mps=1.3, duration_s=2.5), "human")
dog = look(dg.motion.quadruped_gait(gait="trot", speed_mps=1.3, withers_m=0.5, duration_s=2.5), "dog")
figure = viz.contact_sheet([person.signature, dog.signature], titles=["person", "dog"])

# %%
# The cadence-velocity diagram shows how often each Doppler shift repeats.

figure = viz.cadence_map(person.cadence_map, gait_frequency_hz=person.gait_frequency_hz, title="Person")

# %%

figure = viz.cadence_map(dog.cadence_map, gait_frequency_hz=dog.gait_frequency_hz, title="Dog")

# %%
# Twenty of each, with random sizes and speeds.

rows = []
for _ in range(20):
    walker = dg.motion.human_gait(speed_mps=rng.uniform(0.6, 1.9), height_m=rng.normal(1.7, 0.1), duration_s=2.5)
    trotter = dg.motion.quadruped_gait(
        gait="auto", froude=rng.uniform(0.1, 1.5), withers_m=rng.uniform(0.25, 0.65), duration_s=2.5
    )
    for motion, label in ((walker, "human"), (trotter, "dog")):
        rows.append({"label": label, **look(motion, label, example=len(rows)).features.as_dict()})
table = pd.DataFrame(rows).astype({name: float for name in person.features.as_dict()})
figure = viz.feature_matrix(table)

# %%
# Two of the features.

figure = viz.feature_scatter(table, x="torso_velocity_mps", y="step_length_m")

# %%
# **What to look at.** Speed alone (horizontal) separates the classes poorly. At equal speed the dog's step is shorter.
# A feature that could not be determined is NaN and is counted in the legend.

print(
    table.groupby("label")[["step_length_m", "doppler_bandwidth_hz", "harmonic_ratio_2"]]
    .agg(["count", "median"])
    .round(2)
)
