"""Values of the X-band images read by eye or by another program.

Read from plain images of velocity against time (a column every 13.44 ms), before any feature was run on them, but by
one who had seen the values measured before: these are no blind readings.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Image:
    """One real spectrogram and its known values."""

    key: str
    eye_mps: float
    eye_hz: float | None
    eye_limb_mps: float | None
    sure: str
    read: str
    until_s: float | None = None
    from_mps: float | None = None

    @property
    def label(self) -> str:
        """Class of the target."""
        return self.key.split("__")[0]


IMAGES = (
    Image("human__NormalToward", 1.20, 1.70, 2.5, "clear", "12 swings of the torso line, 1.30 to 8.30 s"),
    Image("human__NormalAway", -1.17, 1.77, 3.2, "clear", "13 dips of the torso line, 0.80 to 8.20 s"),
    Image("human__PocketAway", -1.37, 1.91, 3.0, "clear", "15 dips of the torso line, 0.30 to 8.15 s"),
    Image("human__SwingingArmsTowards", 1.25, 1.48, 2.8, "clear", "12 spikes, 0.35 to 8.45 s"),
    Image("human__TowardPaintgun", 1.35, 1.75, 2.8, "clear", "14 spikes, 0.27 to 8.27 s"),
    Image("human__twopeoplewalkingtoward", 1.10, None, 3.2, "poor", "two rhythms over each other"),
    Image("human__RunningTowards", 4.6, 3.07, 8.0, "clear", "24 spikes, 0.33 to 8.15 s", from_mps=-0.6),
    Image("dog__LinkWalkingToward", 1.15, 3.0, 2.2, "poor", "3 spikes, 7.1 to 8.1 s; no rhythm before"),
    Image("dog__LinkWalkAway2", -2.65, 4.25, 3.8, "fair", "10 blobs, 6.12 to 8.45 s; strides 2.12 Hz"),
    Image("dog__LinkWalkingToward2", 2.5, 4.1, 3.0, "fair", "6 blobs, 0.50 to 1.97 s; brakes from 4.8 s", until_s=4.8),
    Image("dog__LokiWalkingToward", 3.2, 2.45, 4.3, "poor", "3 to 4 lobes, 6.05 to 7.65 s"),
    Image("horse__horseWalkingaway", -0.95, 1.38, 3.6, "fair", "10 spikes, 0.62 to 7.85 s"),
    Image("horse__SeunWalking2", 1.10, 1.5, 3.8, "poor", "5 spikes, 1.33 to 4.70 s"),
    Image("horse__HorseWalkingToward", 1.00, 1.45, 3.3, "fair", "3 spikes, 6.12 to 8.17 s; 2 before"),
    Image("cow__CowAway", -1.00, 1.69, 3.5, "clear", "12 spikes, 0.87 to 7.97 s"),
    Image("cow__cowstoward1", 0.80, None, 2.7, "poor", "spikes of more than one cow"),
)
