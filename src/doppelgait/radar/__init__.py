"""The radar: parameters, link budget, waveforms, impairments, recordings."""

from doppelgait.radar.antenna import Antenna
from doppelgait.radar.link import (
    derived_quantities,
    echo_amplitude_v,
    noise_power_v2,
    path_phase_rad,
    radial_velocity_mps,
    received_power_w,
    scatterer_arrays,
)
from doppelgait.radar.parameters import WAVEFORMS, Radar, Waveform
from doppelgait.radar.presets import preset_names, preset_table
from doppelgait.radar.readers import RADAR_READERS, RADAR_WRITERS, read_recording
from doppelgait.radar.readers.arrays import write_arrays
from doppelgait.radar.readers.sigmf import write_sigmf
from doppelgait.radar.recording import Recording, TargetTruth
from doppelgait.radar.recordings import write_recording
from doppelgait.radar.rf import synthesise_rf
from doppelgait.radar.simulate import add_noise, compress, lowest_prf_hz, synthesise, synthesise_samples
from doppelgait.radar.streams import Stream, open_stream

__all__ = [
    "RADAR_READERS", "RADAR_WRITERS", "WAVEFORMS", "Antenna", "Radar", "Recording", "Stream", "TargetTruth", "Waveform",
    "add_noise", "compress", "derived_quantities", "echo_amplitude_v", "lowest_prf_hz", "noise_power_v2", "open_stream",
    "path_phase_rad", "preset_names", "preset_table", "radial_velocity_mps", "read_recording", "received_power_w",
    "scatterer_arrays", "synthesise", "synthesise_rf", "synthesise_samples", "write_arrays", "write_recording",
    "write_sigmf",
]  # fmt: skip
