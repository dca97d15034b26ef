"""Timing errors of frames, and lost frames."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError
from doppelgait.core.plugins import plugin
from doppelgait.core.samples import Samples
from doppelgait.radar.impairments.apply import Times
from doppelgait.radar.parameters import Radar

LARGEST_JITTER = 0.1
"""Maximum ratio of jitter (standard deviation) to pulse interval; two pulses then change order once in 1e12."""


class FrameJitter(FrozenModel):
    """Independent timing errors of the pulses.

    They occur if a host requests each frame.

    The jitter changes the times at which the scene is observed
    (:func:`doppelgait.radar.impairments.shift_pulse_times`), not the samples.

    Parameters
    ----------
    sd_s : float
        Standard deviation of a pulse's time, at most a tenth of the pulse interval.
    """

    kind: Literal["frame_jitter"] = "frame_jitter"
    sd_s: float = Field(default=1e-5, ge=0, le=10)


def add_jitter(times_s: Times, parameters: FrameJitter, radar: Radar, rng: np.random.Generator) -> Times:
    """Add independent normal errors to the pulse times.
    Jitter above the limit raises a :class:`ConfigError`.
    """
    largest_s = LARGEST_JITTER / radar.prf_hz
    if parameters.sd_s > largest_s:
        raise ConfigError(
            f"frame_jitter: sd_s = {parameters.sd_s:g} is not allowed with prf_hz = {radar.prf_hz:g}: pulses could "
            f"change order; the maximum is a tenth of the pulse interval, {largest_s:.3g} s"
        )
    return times_s + rng.normal(0.0, parameters.sd_s, size=times_s.shape)


@plugin("impairment", parameters=FrameJitter, shift_times=add_jitter)
def keep_samples(samples: Samples, parameters: FrameJitter, radar: Radar, rng: np.random.Generator) -> Samples:
    """Return the samples unchanged.
    The jitter is already in the times at which the scene was observed.
    """
    return samples


class DroppedFrames(FrozenModel):
    """Frames lost between sensor and recorder, alone or in bursts.

    The model is a two-state Markov chain (Gilbert 1960): the length of lost runs is geometric with the mean
    ``mean_length``, and the expected share of lost frames is ``probability``.

    Parameters
    ----------
    probability : float, optional
        Share of lost frames, at most mean_length / (1 + mean_length). Set either this or ``frames``.
    frames : list of int, optional
        Numbers of the lost frames, counted from 0.
    mean_length : float
        Mean number of frames lost in a row, 1 or more.
    fill : {"repeat", "zero"}
        Content that the recorder stores instead: the last received frame (at the start, the first received frame), or
        0.
    """

    kind: Literal["dropped_frames"] = "dropped_frames"
    probability: float | None = Field(default=None, ge=0, lt=1)
    frames: tuple[int, ...] | None = Field(default=None, max_length=1_000_000)
    mean_length: float = Field(default=1.0, ge=1, le=1e6)
    fill: Literal["repeat", "zero"] = "repeat"

    @model_validator(mode="after")
    def _check_choice(self) -> DroppedFrames:
        if (self.probability is None) == (self.frames is None):
            raise ValueError("give exactly one of probability and frames")
        if self.frames is not None:
            if self.mean_length != 1:
                raise ValueError("mean_length belongs to probability; a list of frames needs none")
            if self.frames and min(self.frames) < 0:
                raise ValueError(f"frames are counted from 0; {min(self.frames)} is not allowed")
        largest = self.mean_length / (1.0 + self.mean_length)
        if self.probability is not None and self.probability > largest:
            raise ValueError(
                f"probability {self.probability:g} needs longer bursts than mean_length {self.mean_length:g}: at most "
                f"{largest:.4g} can be lost; raise mean_length"
            )
        return self


@plugin("impairment", parameters=DroppedFrames)
def drop_frames(samples: Samples, parameters: DroppedFrames, radar: Radar, rng: np.random.Generator) -> Samples:
    """Fill lost frames as the recorder does.
    A listed frame beyond the end raises a :class:`ConfigError`.
    """
    lost = sample_lost_frames(samples.shape[0], parameters, rng=rng)
    if not lost.any():
        return samples
    if parameters.fill == "zero" or lost.all():
        samples *= (~lost)[:, None]
        return samples
    arrived = np.flatnonzero(~lost)
    missing = np.flatnonzero(lost)
    latest = np.searchsorted(arrived, missing) - 1
    return samples.repeat(missing, arrived[np.maximum(latest, 0)])


def sample_lost_frames(n_frames: int, spec: DroppedFrames, *, rng: np.random.Generator) -> npt.NDArray[np.bool_]:
    """Return a mask of the lost frames of ``n_frames``."""
    lost = np.zeros(n_frames, dtype=bool)
    if spec.frames is not None:
        if spec.frames and max(spec.frames) >= n_frames:
            raise ConfigError(
                f"dropped_frames: frame {max(spec.frames)} is not in a recording of {n_frames} frames, counted from 0; "
                "leave it out of frames"
            )
        lost[list(spec.frames)] = True
        return lost
    if not spec.probability:
        return lost
    begin_chance = spec.probability / ((1.0 - spec.probability) * spec.mean_length)
    state, place = bool(rng.random() < spec.probability), 0
    while place < n_frames:
        run = int(rng.geometric(1.0 / spec.mean_length if state else begin_chance))
        lost[place : place + run] = state
        state, place = not state, place + run
    return lost
