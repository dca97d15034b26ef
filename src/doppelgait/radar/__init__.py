"""The radar: parameters, link budget, echo synthesis, noise, recordings."""

from doppelgait.radar.config import Radar, preset_names
from doppelgait.radar.link import echo_amplitude_v, noise_power_v2, received_power_w
from doppelgait.radar.recording import Recording, TargetTruth
from doppelgait.radar.recordings import read_recording, write_recording
from doppelgait.radar.rf import synthesise_rf
from doppelgait.radar.simulate import add_noise, lowest_prf_hz, synthesise

__all__ = [
    "Radar", "Recording", "TargetTruth", "add_noise", "echo_amplitude_v", "lowest_prf_hz", "noise_power_v2",
    "preset_names", "read_recording", "received_power_w", "synthesise", "synthesise_rf", "write_recording",
]  # fmt: skip
