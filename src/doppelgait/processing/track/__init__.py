"""Tracking of bodies in range and radial velocity."""

from doppelgait.processing.track.live import Track, Tracker
from doppelgait.processing.track.split import split_tracks
from doppelgait.processing.track.tracker import track

__all__ = ["Track", "Tracker", "split_tracks", "track"]
