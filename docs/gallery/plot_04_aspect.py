"""
Aspect angle
============

A radar measures only the velocity along its line of sight. This page shows one walk from six directions.
"""

import math

import doppelgait as dg
from doppelgait import viz

walk = dg.motion.human_gait(speed_mps=1.3, duration_s=4.0)
radar = dg.Radar.preset("x4")
ASPECTS_DEG = (0, 30, 60, 75, 90, 180)


def seen_at(aspect_deg: float):
    """Result of the same walk, turned; 0 approaches, 180 recedes."""
    target = dg.Target(walk, label="human", range_m=5.0, aspect_deg=aspect_deg)
    return dg.analyze(dg.simulate(dg.Scene(targets=[target]), radar, rng=dg.rng(0), snr_db=25), gate="truth")[0]


results = {aspect: seen_at(aspect) for aspect in ASPECTS_DEG}
figure = viz.contact_sheet(
    [result.signature for result in results.values()], titles=[f"{aspect} degrees" for aspect in results]
)

# %%
# The torso's Doppler shift is proportional to the cosine of the aspect angle. Beyond about 60 degrees the limbs overlap
# with the torso, and the strongest repetition may be the sway of the whole stride instead of the step. A flag marks
# such results.

print("aspect  torso velocity  cosine law   gait frequency  flags")
for aspect, result in results.items():
    features = result.features.as_dict()
    torso, gait = features["torso_velocity_mps"], result.gait_frequency_hz
    print(
        f"{aspect:4d}    {'-' if torso is None else f'{torso:5.2f} m/s'}      "
        f"{1.3 * math.cos(math.radians(aspect)):5.2f} m/s   {'-' if gait is None else f'{gait:.2f} Hz'}"
        f"         {', '.join(flag for flag in result.flags if flag.startswith(('low', 'gait'))) or '-'}"
    )

# %%
# **What to look at.** Ground speed and aspect are still measured, from the curve of range against time. They are in
# ``quality`` and use only the recording. None is too uncertain: more than 10 degrees or 10 %.

for aspect, result in results.items():
    quality = result.quality
    print(f"{aspect:4d} degrees: aspect {quality['aspect_deg']}, speed {quality['ground_speed_mps']} m/s")
