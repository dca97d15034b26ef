"""The radar: parameters, link budget, waveforms, impairments, recordings."""

from doppelgait.radar.antenna import Antenna
from doppelgait.radar.link import (
    compute_scatterer_arrays,
    echo_amplitude_v,
    list_derived_quantities,
    noise_power_v2,
    path_phase_rad,
    radial_velocity_mps,
    received_power_w,
)
from doppelgait.radar.parameters import WAVEFORMS, Radar, Waveform
from doppelgait.radar.presets import list_preset_names, read_full_preset
from doppelgait.radar.readers import RADAR_READERS, RADAR_WRITERS, read_recording
from doppelgait.radar.readers.arrays import write_arrays
from doppelgait.radar.readers.sigmf import write_sigmf
from doppelgait.radar.recording import Recording, TargetTruth, concat
from doppelgait.radar.recordings import write_recording
from doppelgait.radar.simulate import (
    add_noise,
    compress,
    lowest_prf_hz,
    synthesise,
    synthesise_rf,
    synthesise_samples,
)
from doppelgait.radar.streams import Stream, open_stream

__all__ = [
    "RADAR_READERS",
    "RADAR_WRITERS",
    "WAVEFORMS",
    "Antenna",
    "Radar",
    "Recording",
    "Stream",
    "TargetTruth",
    "Waveform",
    "add_noise",
    "compress",
    "compute_scatterer_arrays",
    "concat",
    "echo_amplitude_v",
    "list_derived_quantities",
    "list_preset_names",
    "lowest_prf_hz",
    "noise_power_v2",
    "open_stream",
    "path_phase_rad",
    "radial_velocity_mps",
    "read_full_preset",
    "read_recording",
    "received_power_w",
    "synthesise",
    "synthesise_rf",
    "synthesise_samples",
    "write_arrays",
    "write_recording",
    "write_sigmf",
]
