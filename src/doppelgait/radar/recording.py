"""A radar recording: baseband, the radar, and (simulated ones only) the truth about every target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.config import canonical_json
from doppelgait.core.labels import BASEBAND, axis, check_signal
from doppelgait.core.units import velocity_to_doppler_hz
from doppelgait.radar.config import Radar

NAN = float("nan")


@dataclass(frozen=True)
class TargetTruth:
    """What a simulation knows about one target.

    Parameters
    ----------
    label : str
        Class, ``""`` when none was given.
    scatterers : Dataset (slow_time, scatterer)
        Its rows of the scatterer table: range, radial velocity, aspect, radar cross section.
    centre_range_m, centre_velocity_mps, centre_aspect_rad : ndarray, shape (I,)
        Body centre: range, radial velocity (positive approaching), aspect angle psi.
    ground_speed_mps : float
        Mean speed over ground during the observation.
    gait, subject, motion : str
        Gait, person or animal, and the motion's source, where known.
    height_m : float
        Stature or withers height, NaN when unknown.
    stride_frequency_hz, step_frequency_hz, gait_frequency_hz : float
        Means over the observation, NaN when unknown (E-07).
    body : DataArray (time, marker, space), optional
        Where the points of the body are, to be drawn: at most 60 positions a second, in the frame of the scene, whose
        floor is at z = 0.
    """

    label: str
    scatterers: xr.Dataset
    centre_range_m: npt.NDArray[np.float64]
    centre_velocity_mps: npt.NDArray[np.float64]
    centre_aspect_rad: npt.NDArray[np.float64]
    ground_speed_mps: float = NAN
    gait: str = ""
    subject: str = ""
    motion: str = ""
    height_m: float = NAN
    stride_frequency_hz: float = NAN
    step_frequency_hz: float = NAN
    gait_frequency_hz: float = NAN
    body: xr.DataArray | None = None

    def doppler_hz(self, wavelength_m: float) -> npt.NDArray[np.float64]:
        """True Doppler shift of every scatterer, shape (I, L): 2 v_r / lambda (E-05)."""
        values = velocity_to_doppler_hz(self.scatterers["radial_velocity"].values, wavelength_m)
        return np.asarray(values, dtype=np.float64)


@dataclass(frozen=True)
class Recording:
    """One recording.

    Parameters
    ----------
    baseband : DataArray (slow_time, range)
        complex64, V.
    radar : Radar
    truth : sequence of TargetTruth
        Empty for measured recordings.
    noise_power_v2 : float
        Mean square of the receiver noise that was added; NaN when unknown.
    snr_frame_db : float
        Measured on separately kept signal and noise; inf without noise, NaN when unknown.
    seed : int, optional
        Seed of the run that made it.
    source : str
        File name, or how it was made.
    notes : sequence of str
        What its file does not tell and was therefore assumed or taken from options; empty for simulated recordings.
    radar_position_m : (float, float, float), optional
        Place of the radar in the frame of the scene; None for measured recordings.
    radar_azimuth_deg, radar_tilt_deg : float
        Where its antenna looks: from +x towards +y, and up from the horizontal.
    """

    baseband: xr.DataArray
    radar: Radar
    truth: Sequence[TargetTruth] = ()
    noise_power_v2: float = NAN
    snr_frame_db: float = NAN
    seed: int | None = None
    source: str = ""
    notes: Sequence[str] = ()
    radar_position_m: tuple[float, float, float] | None = None
    radar_azimuth_deg: float = 0.0
    radar_tilt_deg: float = 0.0

    def __post_init__(self) -> None:
        check_signal(self.baseband, BASEBAND)
        object.__setattr__(self, "truth", tuple(self.truth))
        object.__setattr__(self, "notes", tuple(self.notes))

    @property
    def observation_s(self) -> float:
        """Time from the first pulse to the end of the last, T_o, pauses between bursts and all."""
        times_s = axis(self.baseband, "slow_time")
        return float(times_s[-1] - times_s[0]) + 1.0 / self.radar.prf_hz


def baseband_facts(radar: Radar) -> dict[str, str | float]:
    """What a baseband array says of the radar that made it: all of it as JSON, and how its window joins range bins."""
    from doppelgait.radar.waveforms import waveform_of

    share = waveform_of(radar).independent_bins(radar)
    return {"radar": canonical_json(radar), **({"independent_bin_share": share} if share < 1.0 else {})}


def further_facts(baseband: xr.DataArray) -> dict[str, str | int | float]:
    """Facts on the baseband that have no place of their own in a file, for example the pulses of a burst."""
    facts = {name: value.item() if isinstance(value, np.generic) else value for name, value in baseband.attrs.items()}
    return {k: v for k, v in facts.items() if k not in ("units", "radar") and isinstance(v, str | int | float)}
