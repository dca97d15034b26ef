"""
Aspect angle
============

A radar sees only the part of a velocity along its line of sight. What is left of a walk seen from the side?
"""

import math

import doppelgait as dg
from doppelgait import viz

walk = dg.motion.human_gait(speed_mps=1.3, duration_s=4.0)
radar = dg.Radar.preset("x4")
ASPECTS_DEG = (0, 30, 60, 75, 90, 180)


def seen_at(aspect_deg: float):
    """Result of the same walk, turned; 0 approaches, 180 goes away."""
    target = dg.Target(walk, label="human", range_m=5.0, aspect_deg=aspect_deg)
    return dg.analyze(dg.simulate(dg.Scene(targets=[target]), radar, rng=dg.rng(0), snr_db=25), gate="truth")[0]


results = {aspect: seen_at(aspect) for aspect in ASPECTS_DEG}
figure = viz.contact_sheet(
    [result.signature for result in results.values()], titles=[f"{aspect} degrees" for aspect in results]
)

# %%
# The torso's Doppler shift goes with the cosine. Beyond some 60 degrees the limbs no longer stand out of it, and the
# strongest repetition may be the sway of the whole stride instead of the step: the result says so with a flag.

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
# **What to look at.** The ground speed and the aspect can still be had, from the curve of range against time: they
# stand in ``quality`` and use nothing but the recording.

for aspect, result in results.items():
    quality = result.quality
    print(f"{aspect:4d} degrees: measured {quality['aspect_deg']:5.1f}, speed {quality['ground_speed_mps']:.2f} m/s")
