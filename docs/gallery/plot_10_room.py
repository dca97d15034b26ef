"""
A furnished room, without the truth
===================================

The room has static echoes far stronger than the person, a partition, a reflecting floor, a fan and an unsteady clock.
The analysis finds the person without the true position.
"""

# sphinx_gallery_thumbnail_number = 3

import doppelgait as dg
from doppelgait import viz

radar = dg.Radar.preset("x4", antenna={"kind": "cosine", "hpbw_azimuth_deg": 65, "hpbw_elevation_deg": 65})
walk = dg.motion.human_gait(speed_mps=1.2, duration_s=4.0)
person = dg.Target(walk, label="human", range_m=5.0, aspect_deg=20)
fan = dg.Target(
    dg.motion.fan(duration_s=4.0), rcs=dg.scene.RcsSpec(total_m2=0.02), start_position_m=(6.0, 2.0), heading_deg=0,
    background=True,
)  # fmt: skip
scene = dg.Scene(targets=[person, fan], radar_position_m=(0, 0, 1.2), radar_tilt_deg=-5)

# %%
# Environment and impairments are lists of tables, the same as in a scene file.

room = dg.pipeline.Conditions(
    environment=[
        {"kind": "ground_bounce", "material": "concrete"},
        {"kind": "wall", "material": "plasterboard", "thickness_m": 0.0125},
    ],
    impairments=[
        {"kind": "static_clutter", "in_units": True, "levels": [[0.85, -51], [2.0, -60], [4.0, -68], [8.0, -80]]},
        {"kind": "phase_noise", "white_rad": 0.004, "drift_rad_per_min": 0.1},
    ],
)
recording = dg.simulate(scene, radar, rng=dg.rng(5), conditions=room)
figure = viz.range_time(recording.baseband, title="As recorded")

# %%
# The recording shows only the static echoes. With clutter removal (the median of short means) the walker is visible.

cleared = dg.processing.remove_clutter(recording.baseband, dg.Analysis(clutter="median"))
found = dg.analyze(recording, gate="track")
figure = viz.range_time(
    cleared, tracks={f"found {n + 1}": result.gate.limits for n, result in enumerate(found)}, title="Clutter taken off"
)

# %%
# The signature of the first target found. The tracking does not use the truth, not even the number of targets.

figure = viz.signature(found[0].signature, main_line_hz=found[0].main_line_hz)

# %%
# **What to look at.** Compare the tracked features with those of the true gate; only the last column uses the truth.
# The furniture is removed from the picture. A little noise remains below 1 m: the jitter of the clock on the strongest
# echoes.

truth = dg.analyze(recording, gate="truth", analysis=dg.Analysis(clutter="median"))[0]
print(f"targets found: {len(found)}")
for name, value in found[0].features.as_dict().items():
    known = truth.features.as_dict()[name]
    print(f"{name:24s} tracked {value if value is None else round(value, 3)}, true gate {known and round(known, 3)}")
