"""Waveforms: synthesis of receiver samples, and compression to range bins."""

from doppelgait.radar.parameters import WAVEFORMS, Waveform

__all__ = ["WAVEFORMS", "Waveform"]
