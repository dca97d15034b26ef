"""Detection of bodies: thresholds, clusters, scans."""

from doppelgait.processing.detect.cfar import ca_factor, os_factor, os_pfa
from doppelgait.processing.detect.config import Detector
from doppelgait.processing.detect.maps import estimate_noise_map, noise_factor
from doppelgait.processing.detect.scans import find_scans

__all__ = ["Detector", "ca_factor", "estimate_noise_map", "find_scans", "noise_factor", "os_factor", "os_pfa"]
