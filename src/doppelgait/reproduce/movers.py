"""Who moves in the reproduction: the models that stand in, and the stretches of a folder of real recordings."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from doppelgait.core.errors import ConfigError, DoppelgaitError, DoppelgaitWarning
from doppelgait.core.labels import axis

if TYPE_CHECKING:
    from doppelgait.motion.models.quadruped_gaits import GaitName

FOLDERS = {"human": "human", "dog": "dog"}
"""Folder of a motion folder by label, as the plan ``liland2018`` of the dataset builder has them."""
PERSON_M = 1.8
"""Stature of people in the report."""
CHEN_SPEED_MPS = 2 * 0.491 * PERSON_M
"""Nominal speed of the walker whose ankle the report shows at about 300 Hz: two leg lengths a second."""
DOG_WITHERS_M = 0.5
DOG_SPEED_MPS = 3.0
SHOWN_REASONS = 3


@dataclass(frozen=True)
class Mover:
    """A motion with a name.

    Attributes
    ----------
    name : str
        "walker", or the file and the number of its stretch.
    label : str
        "human" or "dog".
    motion : DataArray (time, marker, space)
        m, z up; travels straight ahead.
    real : bool
        Whether it was recorded; a model otherwise.
    """

    name: str
    label: str
    motion: xr.DataArray
    real: bool = False

    @property
    def seconds(self) -> float:
        """Duration of the motion."""
        return float(np.ptp(axis(self.motion, "time")))

    @property
    def gait(self) -> str:
        """Gait as the model or the measurement of its footfalls says; empty if unknown."""
        return str(self.motion.attrs["gait"])

    @property
    def strides(self) -> float:
        """Gait cycles in the motion, NaN if unknown."""
        return self.seconds * float(self.motion.attrs["stride_frequency_hz"])

    @property
    def about(self) -> str:
        """For people: recording or model, and which."""
        return f"{'recording' if self.real else 'model'}: {self.name}"


def chen_walker(speed_mps: float = CHEN_SPEED_MPS, *, cycles: int = 5) -> Mover:
    """Walker of the published program (Chen 2011) for whole gait cycles, right foot landing first.

    Parameters
    ----------
    speed_mps : float
        Nominal speed V; the published program then goes at V over the leg length, 2.0 m/s for the default.
    cycles : int
    """
    from doppelgait.motion import boulic_walk

    stride_hz = np.sqrt(speed_mps / (0.491 * PERSON_M)) / 1.346
    motion = boulic_walk(
        speed_mps=speed_mps, height_m=PERSON_M, duration_s=cycles / stride_hz, form="chen2011", rate_hz=500.0
    )
    moved_mps = speed_mps / (0.491 * PERSON_M)
    return Mover(f"walker of Boulic and Chen, {PERSON_M} m, {moved_mps:.2f} m/s, {cycles} gait cycles", "human", motion)


def model_people() -> list[Mover]:
    """Walkers and a runner of the jointed model, feet locked to the floor: stand-ins for recorded people."""
    from doppelgait.motion import human_gait

    found = []
    for speed_mps in (1.3, 0.9, 1.8, 3.0):
        motion = human_gait(speed_mps=speed_mps, height_m=PERSON_M, duration_s=4.0)
        name = "walking" if motion.attrs["gait"] == "walk" else "running"
        found.append(Mover(f"{name} person, {PERSON_M} m, {speed_mps} m/s", "human", motion))
    return found


def model_dogs() -> list[Mover]:
    """A bounding dog as the report's, left and right legs together, and one in every other gait."""
    from doppelgait.motion import quadruped_gait

    gaits: tuple[GaitName, ...] = ("bound", "walk", "trot", "gallop")
    found = []
    for gait in gaits:
        speed_mps = DOG_SPEED_MPS if gait == "bound" else None
        motion = quadruped_gait(gait=gait, speed_mps=speed_mps, withers_m=DOG_WITHERS_M, duration_s=2.0)
        speed = f", {speed_mps} m/s" if speed_mps else ""
        found.append(Mover(f"dog, {gait}, {DOG_WITHERS_M} m{speed}", "dog", motion))
    return found


def check_folder(folder: Path) -> None:
    """A :class:`ConfigError` if a motion folder holds neither people nor dogs."""
    if not any((folder / name).is_dir() for name in FOLDERS.values()):
        wanted = " and ".join(f"{name}/" for name in FOLDERS.values())
        raise ConfigError(
            f"--motion-folder {folder}: has no folder {wanted}: put the motion files of people into {folder / 'human'} "
            f"and those of dogs into {folder / 'dog'}; one of them is enough, models stand in for the other"
        )


def recorded(folder: Path, label: str) -> list[Mover]:
    """Every straight stretch at constant velocity of the files of one label, the longest first.

    Parameters
    ----------
    folder : Path
        The motion folder, with a folder per label.
    label : str
        "human" or "dog".

    Warns
    -----
    DoppelgaitWarning
        If files are left out; it says how many and why the first were.
    """
    root = folder / FOLDERS[label]
    files = sorted(path for path in root.rglob("*") if path.is_file()) if root.is_dir() else []
    found: list[Mover] = []
    refused: dict[str, str] = {}
    for file in files:
        try:
            found += _stretches(file, label, file.relative_to(folder).as_posix())
        except DoppelgaitError as error:
            refused[file.name] = str(error).replace(f"{file}: ", "").partition(";")[0]
    if refused:
        shown = "; ".join(f"{name}: {reason}" for name, reason in list(refused.items())[:SHOWN_REASONS])
        text = f"{root.name}: {len(refused)} of {len(files)} motion files are left out: {shown}"
        warnings.warn(text, DoppelgaitWarning, stacklevel=4)
    return sorted(found, key=lambda mover: (-mover.seconds, mover.name))


def _stretches(file: Path, label: str, name: str) -> list[Mover]:
    from doppelgait.motion import find_segments, read
    from doppelgait.motion.gait import with_gait_facts
    from doppelgait.motion.segments import crop

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)  # of cleaning; the command "motion info" says them
        motion = read(file)
        return [
            Mover(f"{name}, stretch {number}", label, with_gait_facts(crop(motion, segment)), real=True)
            for number, segment in enumerate(find_segments(motion), start=1)
        ]
