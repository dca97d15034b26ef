"""How bodies are followed from scan to scan."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel

Association = Literal["auto", "gnn", "jpda"]


class Tracker(FrozenModel):
    """Parameters of the tracker; one set for every class, made for people and pets and about ten scans a second.

    Parameters
    ----------
    acceleration_noise_m2ps3 : float
        Spectral density q of the white acceleration of a walking body: 0.5 to 1.
    range_sd_min_m, velocity_sd_min_mps : float
        Lowest standard deviations that a detection is believed to have: limbs sway about the body from scan to scan.
    start_velocity_sd_mps : float
        Lowest standard deviation of a new track's velocity.
    gate_probability : float
        Share of a track's own detections inside its gate.
    detection_probability : float
        Pd of a moving body in one scan.
    clutter_per_m_mps : float
        False detections per scan, metre and m/s.
    association : {"auto", "gnn", "jpda"}
        ``gnn``: the best assignment as a whole (global nearest neighbour). ``jpda``: mean over all joint events,
        weighted by their probability. ``auto``: ``jpda`` where gates of several tracks share a detection, else ``gnn``.
    confirm_hits, confirm_scans : int
        A track is confirmed once it had a detection in so many of so many scans.
    delete_s : float
        A confirmed track without detection for longer ends.
    rest_speed_mps, rest_s : float
        A track whose body was slower when last detected is taken to stand still, where no Doppler betrays it: it is
        held at its place with a growing gate for so long.
    rest_velocity_sd_mps, rest_time_constant_s : float
        How far a resting body may creep: its velocity returns to 0 with this time constant.
    share_s : float
        Longest time that a track lives on inside another body's detection, while the two pass each other.
    separation_m : float
        Nearer than this to a track no other one starts: two bodies so near are one detection.
    twin_s : float
        Two tracks of nearly equal range and velocity that have one detection between them for so long are one body.
    min_duration_s : float
        Shortest time from first to last detection of a track that counts.
    still_travel_m, still_velocity_mps : float
        A track that never moves further in range than the one, with detections no wider in velocity than twice the
        other (median), is no mover and does not count: where somebody stood for half of a recording, the clutter that
        was taken off leaves an echo at all other times. Someone who only breathes goes with it. 0 keeps all.
    still_speed_mps : float
        Nor does one count that is not faster than this (median) and nearly never (a tenth of the time) wider in
        velocity than twice ``still_velocity_mps``: what changes its range has a Doppler shift, but for strong clutter
        before a clock that drifts.
    max_targets : int, optional
        At most so many tracks, those with the most detections; all by default.
    fastest_mps : float
        Highest radial velocity considered where Doppler is ambiguous.
    """

    acceleration_noise_m2ps3: float = Field(default=0.75, gt=0, le=100)
    range_sd_min_m: float = Field(default=0.05, gt=0, le=5)
    velocity_sd_min_mps: float = Field(default=0.15, gt=0, le=5)
    start_velocity_sd_mps: float = Field(default=0.5, ge=0, le=10)
    gate_probability: float = Field(default=0.99, ge=0.5, lt=1)
    detection_probability: float = Field(default=0.9, gt=0, lt=1)
    clutter_per_m_mps: float = Field(default=0.005, gt=0, le=10)
    association: Association = "auto"
    confirm_hits: int = Field(default=4, ge=1, le=50)
    confirm_scans: int = Field(default=6, ge=1, le=50)
    delete_s: float = Field(default=1.2, gt=0, le=60)
    rest_speed_mps: float = Field(default=0.6, ge=0, le=5)
    rest_s: float = Field(default=6.0, ge=0, le=600)
    rest_velocity_sd_mps: float = Field(default=0.3, gt=0, le=5)
    rest_time_constant_s: float = Field(default=0.3, gt=0, le=10)
    share_s: float = Field(default=3.0, ge=0, le=60)
    separation_m: float = Field(default=0.8, ge=0, le=10)
    twin_s: float = Field(default=1.0, gt=0, le=60)
    min_duration_s: float = Field(default=0.8, ge=0, le=60)
    still_travel_m: float = Field(default=0.3, ge=0, le=10)
    still_velocity_mps: float = Field(default=0.6, ge=0, le=10)
    still_speed_mps: float = Field(default=0.1, ge=0, le=10)
    max_targets: int | None = Field(default=None, ge=1, le=100)
    fastest_mps: float = Field(default=8.0, gt=0, le=50)

    @model_validator(mode="after")
    def _hits_fit(self) -> Self:
        if self.confirm_hits > self.confirm_scans:
            raise ValueError(
                f"confirm_hits = {self.confirm_hits} of confirm_scans = {self.confirm_scans} cannot happen; "
                "ask for fewer hits or more scans"
            )
        return self
