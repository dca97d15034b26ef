"""
Pulse rate and aliasing
=======================

A radar with f frames a second cannot separate a Doppler shift of f/2 + x from one of -f/2 + x.
"""

import warnings

import doppelgait as dg
from doppelgait import viz
from doppelgait.core.errors import DoppelgaitWarning

walk = dg.motion.boulic_walk(speed_mps=1.4, height_m=1.75, duration_s=3.0)
scene = dg.Scene(targets=[dg.Target(walk, label="human", range_m=5.0)])

# %%
# The largest radial speed without aliasing is λ f/4. At 7.29 GHz that is 10.3 m/s with 1000 frames a second; the foot
# of this walker swings at 6 m/s.

for prf_hz in (1000, 500, 250):
    print(f"{prf_hz} Hz: +-{dg.Radar.preset('x4', prf_hz=prf_hz).unambiguous_velocity_mps:.2f} m/s")

# %%
# The simulator does what the radar would do, and warns of aliasing.


def seen_with(prf_hz: float):
    """Recording and result at a pulse rate; warnings are printed."""
    radar = dg.Radar.preset("x4", prf_hz=prf_hz)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DoppelgaitWarning)
        recording = dg.simulate(scene, radar, rng=dg.rng(0), snr_db=25)
    for warning in caught:
        print(f"{prf_hz} Hz: {warning.message}")
    return recording, dg.analyze(recording, gate="truth")[0]


good, enough = seen_with(1000)
figure = viz.signature(enough.signature, doppler_hz=(-250, 500), title="1000 frames a second")

# %%
# With 250 frames a second the feet leave the band at +125 Hz and reappear at -125 Hz, like a receding target. The
# lines are the true Doppler shifts.

poor, folded = seen_with(250)
truth = viz.scatterer_doppler(poor.truth[0].scatterers, wavelength_m=poor.radar.wavelength_m)
figure = viz.signature(folded.signature, truth_doppler=truth, doppler_hz=(-125, 125), title="250 frames a second")

# %%
# **What to look at.** The torso's velocity changes by 3 %, because it is inside the band. The bandwidth is wrong, and a
# flag marks it.

for prf_hz, result in ((1000, enough), (250, folded)):
    features = result.features.as_dict()
    print(prf_hz, "Hz:", features["torso_velocity_mps"], features["doppler_bandwidth_hz"], result.flags)
