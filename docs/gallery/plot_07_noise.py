"""
Noise, and what "SNR" means
===========================

doppelgait has two signal-to-noise ratios, one before and one after the analysis.
"""

import doppelgait as dg
from doppelgait import viz

walk = dg.motion.human_gait(speed_mps=1.3, duration_s=3.0)
scene = dg.Scene(targets=[dg.Target(walk, label="human", range_m=5.0)])
radar = dg.Radar.preset("x4")

# %%
# **SNR of a frame**: time mean of the strongest range bin's power over the noise power in a bin. ``snr_db`` sets it and
# ``recording.snr_frame_db`` states it. Without ``snr_db`` the noise follows from the receiver's noise figure and
# bandwidth, and the ratio from power, antennas, range and cross section.

print(f"thermal noise: {dg.simulate(scene, radar, rng=dg.rng(0)).snr_frame_db:.1f} dB")

# %%
# **SNR of the signature**: the strongest Doppler cell of a column over the noise in a cell, as a median over time. It
# is in ``quality["snr_mu_db"]``, measured on the data alone. 100 pulses added in phase raise a steady echo by 20 dB,
# minus the loss of the window. The gate adds the noise of its 31 range bins (15 dB), and a body is not one steady echo.

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
# **What to look at.** As the SNR falls, the arcs of the feet disappear first, then the arms, and the torso's line last.
# The harmonics are lost early. The gait frequency and the torso's velocity hold down to about 0 dB. Below that all
# features are undetermined (None).
