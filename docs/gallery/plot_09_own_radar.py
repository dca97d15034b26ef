"""
One walk, three radars
======================

An impulse radar at 7.3 GHz, an FMCW radar at 24 GHz and a radar of your own see one walk. Only the scale differs.
"""

import doppelgait as dg
from doppelgait import viz

walk = dg.motion.human_gait(speed_mps=1.2, duration_s=3.0)
scene = dg.Scene(targets=[dg.Target(walk, label="human", range_m=5.0)], radar_position_m=(0, 0, 1))

# %%
# A radar is a preset with some parameters changed, or has all parameters of your own. Impossible combinations raise an
# error that names the parameter.

radars = {
    "X4, 7.29 GHz, pulses": dg.Radar.preset("x4"),
    "24 GHz, FMCW": dg.Radar.preset("ancortek-24", prf_hz=2000, sweep_s=0.45e-3, range_stop_m=10),
    "my own, 10 GHz, FMCW": dg.Radar(
        name="my own", waveform="fmcw", carrier_hz=10e9, bandwidth_hz=750e6, sweep_s=250e-6, sample_rate_hz=1e6,
        prf_hz=1500, range_stop_m=12, tx_power_dbm=10, tx_gain_dbi=12, rx_gain_dbi=12, noise_figure_db=8,
    ),
}  # fmt: skip
for name, radar in radars.items():
    print(
        f"{name:22s} wavelength {1000 * radar.wavelength_m:5.1f} mm, to {radar.unambiguous_velocity_mps:5.2f}"
        f" m/s, range resolution {100 * radar.range_resolution_m:5.1f} cm, {radar.n_range_bins} bins"
    )

# %%
# The same scene with each radar.

recordings = {name: dg.simulate(scene, radar, rng=dg.rng(0), snr_db=25) for name, radar in radars.items()}
results = {name: dg.analyze(recording, gate="truth")[0] for name, recording in recordings.items()}
figure = viz.signature(results["X4, 7.29 GHz, pulses"].signature, title="X4, 7.29 GHz")

# %%

figure = viz.signature(results["24 GHz, FMCW"].signature, title="FMCW, 24 GHz")

# %%

figure = viz.signature(results["my own, 10 GHz, FMCW"].signature, title="My own, 10 GHz")

# %%
# **What to look at.** On the right axis, velocity, the pictures are the same. The left axis, Doppler, scales with the
# carrier. Features in m/s and m agree. The bandwidth in Hz does not: convert it to m/s before you compare radars.

for name, result in results.items():
    features = result.features.as_dict()
    span_mps = features["doppler_bandwidth_hz"] * radars[name].wavelength_m / 2
    print(
        f"{name:22s} v_m {features['torso_velocity_mps']:.3f} m/s, step {features['step_length_m']:.3f} m, bandwidth "
        f"{features['doppler_bandwidth_hz']:5.0f} Hz = {span_mps:.2f} m/s"
    )
