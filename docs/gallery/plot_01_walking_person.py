"""
A walking person
================

From nothing to a micro-Doppler signature: a gait model, a scene, a radar, an analysis. The other pages change one thing
of this one each.
"""

# sphinx_gallery_thumbnail_number = 4

import doppelgait as dg
from doppelgait import viz

# %%
# **Motion.** Named points of a body over time, in metres, z up. Here 41 points of the walking model of Boulic et al.
# (1990); a motion-capture file would be ``dg.motion.read("walk.c3d")`` and nothing below would change.

walk = dg.motion.boulic_walk(speed_mps=1.2, height_m=1.75, duration_s=4.0)
figure = viz.stick_frames(walk)

# %%
# **Scene and radar.** The person passes the middle of the observation 5 m in front of a radar that hangs 1 m above
# the floor, and walks straight at it. The preset ``x4`` is the Novelda XeThru X4; thermal noise is drawn from the
# generator given.

scene = dg.Scene(targets=[dg.Target(walk, label="human", range_m=5.0)], radar_position_m=(0, 0, 1))
recording = dg.simulate(scene, dg.Radar.preset("x4"), rng=dg.rng(2018))
print(recording.baseband.sizes, recording.baseband.dtype, f"{recording.snr_frame_db:.1f} dB")

# %%
# **Analysis.** A gate of 1.6 m follows the body; inside it a Doppler spectrum is taken every few milliseconds. Here
# the gate comes from the true range (``gate="truth"``); without it the body is detected and tracked.

result = dg.analyze(recording, gate="truth")[0]
figure = viz.range_time(recording.baseband, tracks=result.gate.limits)

# %%
# **The signature.** Over it the true Doppler shift of every point, 2 v/λ. The torso is the strong line near 60 Hz;
# the feet stand still (0 Hz) and swing at up to four times the torso's speed, one after the other.

truth = viz.scatterer_doppler(recording.truth[0].scatterers, wavelength_m=recording.radar.wavelength_m)
figure = viz.signature(result.signature, truth_doppler=truth)

# %%
# **The features.** The repetition of the signature gives the step frequency, and with it the step length.

features = result.features.as_dict()
figure = viz.overview(
    recording.baseband, signature=result.signature, cadence_map=result.cadence_map,
    cadence_spectrum=result.cadence_spectrum, features=features, gate=result.gate.limits,
    main_line_hz=result.main_line_hz, gait_frequency_hz=result.gait_frequency_hz, title="A walking person",
)  # fmt: skip
for name, value in features.items():
    print(f"{name:24s} {value if value is None else round(value, 3)}")

# %%
# **What to look at.** The step frequency found, against the model's own; and that the feet's lines run where the
# signature is bright, late in the walk even to the single arc.

print(f"found {result.gait_frequency_hz:.3f} Hz, true {recording.truth[0].step_frequency_hz:.3f} Hz")
