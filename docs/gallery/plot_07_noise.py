"""
Noise, and what "SNR" means
===========================

Two ratios are called signal-to-noise ratio here, one before and one after the analysis. Side by side:
"""

import doppelgait as dg
from doppelgait import viz

walk = dg.motion.human_gait(speed_mps=1.3, duration_s=3.0)
scene = dg.Scene(targets=[dg.Target(walk, label="human", range_m=5.0)])
radar = dg.Radar.preset("x4")

# %%
# **Of a frame**: time mean of the strongest range bin's power over the noise power in a bin. It is what ``snr_db``
# asks for and what ``recording.snr_frame_db`` states. Without ``snr_db`` the noise is the receiver's own, from its
# noise figure and bandwidth, and the ratio follows from power, antennas, range and cross section.

print(f"thermal noise: {dg.simulate(scene, radar, rng=dg.rng(0)).snr_frame_db:.1f} dB")

# %%
# **Of the signature**: the strongest Doppler cell of a column over the noise in a cell, as a median over time. It is
# in ``quality["snr_mu_db"]``, measured on the data alone. Adding 100 pulses in phase lifts a steady echo by 20 dB,
# less what the window costs; but the gate adds the noise of all its 31 range bins (15 dB), and a body is not one
# steady echo.

LEVELS_DB = (25, 15, 10, 5, 0, -5)
results = {}
for snr_db in LEVELS_DB:
    recording = dg.simulate(scene, radar, rng=dg.rng(7), snr_db=snr_db)
    results[snr_db] = dg.analyze(recording, gate="truth")[0]
figure = viz.contact_sheet(
    [result.signature for result in results.values()], titles=[f"{snr_db} dB" for snr_db in results],
    db_range=40, doppler_hz=(-100, 300),
)  # fmt: skip

# %%

print("SNR_frame  SNR_mu    v_m         gait frequency   features not determined")
for snr_db, result in results.items():
    features = result.features.as_dict()
    missing = [name for name, value in features.items() if value is None]
    torso, gait = features["torso_velocity_mps"], result.gait_frequency_hz
    print(
        f"{snr_db:4d} dB    {result.quality['snr_mu_db']:5.1f} dB  {'-' if torso is None else f'{torso:.3f} m/s'}   "
        f"{'-' if gait is None else f'{gait:.2f} Hz'}          {', '.join(missing) or '-'}"
    )

# %%
# **What to look at.** The feet's arcs go first, then the arms, and the torso's line last. The harmonics are lost
# early, the rhythm and the torso's velocity hold down to about 0 dB; below that everything is undetermined, and
# nothing is guessed.
