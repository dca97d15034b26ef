"""
A walking person
================

A notebook, executed: a gait model, a scene, a radar and an analysis give a micro-Doppler signature. Each of the other
pages changes one thing of this page.
"""

# sphinx_gallery_thumbnail_number = 4

import doppelgait as dg
from doppelgait import viz

# %%
# **Motion.** A motion is named points of a body over time, in metres, z up. This one is a person whose joints, arms and
# trunk move as measured ones do. A motion-capture file is read by ``dg.motion.read("walk.c3d")``; the rest is the same.

walk = dg.motion.human_gait(speed_mps=1.2, height_m=1.75, duration_s=4.0)
figure = viz.stick_frames(walk)

# %%
# **Scene and radar.** The person walks straight towards a radar 1 m above the floor, and is 5 m away in the middle of
# the observation. The preset ``x4`` is the Novelda XeThru X4.

scene = dg.Scene(targets=[dg.Target(walk, label="human", range_m=5.0)], radar_position_m=(0, 0, 1))
scene.plot()

# %%
# **Simulation.** Thermal noise is drawn from ``rng``. As the last line of a cell, an object shows values and a picture.

recording = dg.simulate(scene, "x4", rng=dg.rng(2018))
recording

# %%
# **Analysis.** A gate of 1.6 m follows the body. Inside it a Doppler spectrum is computed every few milliseconds. Here
# the gate uses the true range (``gate="truth"``); by default the body is detected and tracked.

result = dg.analyze(recording, gate="truth")[0]
figure = viz.range_time(recording.baseband, tracks=result.gate.limits)

# %%
# **The signature**, with the true Doppler shift of every point, 2 v/λ. The torso is the strong line near 60 Hz. The
# feet stand still (0 Hz) and then swing, one after the other, at up to four times the torso's speed.

truth = viz.scatterer_doppler(recording.truth[0].scatterers, wavelength_m=recording.radar.wavelength_m)
figure = viz.signature(result.signature, truth_doppler=truth)

# %%
# **The features.** The signature repeats with the step frequency. Speed over step frequency is the step length.

result

# %%
# **What to look at.** Compare the measured step frequency with the true one. The lines of the feet follow the bright
# arcs of the signature.

print(f"found {result.gait_frequency_hz:.3f} Hz, true {recording.truth[0].step_frequency_hz:.3f} Hz")
