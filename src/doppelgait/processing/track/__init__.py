"""Tracking of bodies in range and radial velocity."""

from doppelgait.processing.track.live import Track, Tracker
from doppelgait.processing.track.tracker import track

__all__ = ["Track", "Tracker", "track"]
