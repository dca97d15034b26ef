"""
A dog's gaits
=============

Walk, pace, trot, canter and gallop of one dog, each at its usual speed.
"""

# sphinx_gallery_thumbnail_number = 3

import doppelgait as dg
from doppelgait import viz

# %%
# The model moves the legs by the phases and duty factors of the gait. Speeds are set by the Froude number v²/(g h), so
# the same numbers fit a terrier and a wolfhound.

FROUDE = {"walk": 0.25, "pace": 0.6, "trot": 0.9, "canter": 1.6, "gallop": 2.2}
radar = dg.Radar.preset("x4", prf_hz=1600)  # a galloping paw would alias at 1000 Hz


def seen(gait: str, froude: float):
    """Recording and result of one dog that approaches."""
    motion = dg.motion.quadruped_gait(gait=gait, froude=froude, withers_m=0.45, duration_s=2.5)
    scene = dg.Scene(targets=[dg.Target(motion, label="dog", range_m=5.0)], radar_position_m=(0, 0, 1))
    recording = dg.simulate(scene, radar, rng=dg.rng(1), snr_db=25)
    return recording, dg.analyze(recording, gate="truth")[0]


dogs = {gait: seen(gait, froude) for gait, froude in FROUDE.items()}

# %%
# Two gaits of the same animal, from the side. In a trot the diagonal legs swing together. In a gallop both hind legs
# swing, then both fore legs, and the trunk pitches.

figure = viz.stick_frames(dg.motion.quadruped_gait(gait="trot", froude=0.9, withers_m=0.45), title="Trot")

# %%

figure = viz.stick_frames(dg.motion.quadruped_gait(gait="gallop", froude=2.2, withers_m=0.45), title="Gallop")

# %%
# All signatures on one scale.

figure = viz.contact_sheet(
    [result.signature for _, result in dogs.values()],
    titles=[f"{gait}, {r.truth[0].ground_speed_mps:.1f} m/s" for gait, (r, _) in dogs.items()],
)

# %%
# A symmetric gait (walk, pace, trot) looks the same after half a stride, so its signature repeats twice a stride.
# Canter and gallop repeat once. ``gait_frequency_hz`` is the repetition rate of the signature.

print("gait      speed   found   true    stride  step or stride length")
for gait, (recording, result) in dogs.items():
    truth, features = recording.truth[0], result.features.as_dict()
    print(
        f"{gait:8s} {truth.ground_speed_mps:5.2f} m/s {result.gait_frequency_hz:5.2f}   {truth.gait_frequency_hz:5.2f}"
        f"   {truth.stride_frequency_hz:5.2f} Hz  {features['step_length_m']:.2f} m"
    )

# %%
# **What to look at.** The bright line is the trunk. Its velocity oscillates twice a stride in walk and trot, once in
# canter and gallop. The gait frequency counts these periods: compare ``found`` with ``stride``. The paws are weak (a
# hundredth of the power) and fast.
