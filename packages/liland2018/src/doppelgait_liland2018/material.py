"""Radar, targets, recordings and results behind the figures."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait import ConfigError, DoppelgaitError, DoppelgaitWarning
from doppelgait.motion import Motion
from doppelgait.pipeline import Result, analyze, simulate
from doppelgait.processing import Analysis
from doppelgait.radar import Radar, Recording, synthesise
from doppelgait.scene import RcsSpec, Scene, Target
from doppelgait_liland2018.scenarios import PERSON_M, RCS_M2, GaitName

FOLDERS = {"human": "human", "dog": "dog"}
"""Folder of a motion folder by label, as the plan ``liland2018`` of the dataset builder has them."""
CHEN_SPEED_MPS = 2 * 0.491 * PERSON_M
"""Nominal speed of the walker with the ankle that the report shows at about 300 Hz: two leg lengths a second."""
DOG_WITHERS_M = 0.5
DOG_SPEED_MPS = 3.0
SHOWN_REASONS = 3
UNITS = {"range": "m", "radial_velocity": "m/s", "rcs": "m^2", "path_gain": "1"}
"""Units of the columns of a scatterer table."""


@dataclass(frozen=True)
class NamedMotion:
    """A named motion."""

    name: str
    label: str
    motion: Motion
    real: bool = False

    @property
    def seconds(self) -> float:
        """Duration of the motion."""
        return float(np.ptp(self.motion.time_s))

    @property
    def gait(self) -> str:
        """Gait by model or footfalls, empty if unknown."""
        return str(self.motion.facts.gait)

    @property
    def strides(self) -> float:
        """Gait cycles in the motion, NaN if unknown."""
        return self.seconds * self.motion.facts.stride_frequency_hz

    @property
    def about(self) -> str:
        """Description: recording or model, and its name."""
        return f"{'recording' if self.real else 'model'}: {self.name}"


def make_chen_walker(speed_mps: float = CHEN_SPEED_MPS, *, cycles: int = 5) -> NamedMotion:
    """Make the walker of the published program (Chen 2011)."""
    from doppelgait.motion import boulic_walk

    stride_hz = np.sqrt(speed_mps / (0.491 * PERSON_M)) / 1.346
    motion = boulic_walk(
        speed_mps=speed_mps, height_m=PERSON_M, duration_s=cycles / stride_hz, form="chen2011", rate_hz=500.0
    )
    moved_mps = speed_mps / (0.491 * PERSON_M)
    return NamedMotion(
        f"walker of Boulic and Chen, {PERSON_M} m, {moved_mps:.2f} m/s, {cycles} gait cycles", "human", motion
    )


def make_model_people() -> list[NamedMotion]:
    """Make model walkers and a runner."""
    from doppelgait.motion import human_gait

    found = []
    for speed_mps in (1.3, 0.9, 1.8, 3.0):
        motion = human_gait(speed_mps=speed_mps, height_m=PERSON_M, duration_s=4.0)
        name = "walking" if motion.facts.gait == "walk" else "running"
        found.append(NamedMotion(f"{name} person, {PERSON_M} m, {speed_mps} m/s", "human", motion))
    return found


def make_model_dogs() -> list[NamedMotion]:
    """Make the report's bounding dog, and other gaits."""
    from doppelgait.motion import quadruped_gait

    gaits: tuple[GaitName, ...] = ("bound", "walk", "trot", "gallop")
    found = []
    for gait in gaits:
        speed_mps = DOG_SPEED_MPS if gait == "bound" else None
        motion = quadruped_gait(gait=gait, speed_mps=speed_mps, withers_m=DOG_WITHERS_M, duration_s=2.0)
        speed = f", {speed_mps} m/s" if speed_mps else ""
        found.append(NamedMotion(f"dog, {gait}, {DOG_WITHERS_M} m{speed}", "dog", motion))
    return found


def check_folder(folder: Path) -> None:
    """Check that a motion folder contains people or dogs."""
    if not any((folder / name).is_dir() for name in FOLDERS.values()):
        wanted = " and ".join(f"{name}/" for name in FOLDERS.values())
        raise ConfigError(
            f"--motion-folder {folder}: has no folder {wanted}: put the motion files of people into {folder / 'human'} "
            f"and those of dogs into {folder / 'dog'}; one of them is enough, models stand in for the other"
        )


def read_recorded(folder: Path, label: str) -> list[NamedMotion]:
    """Read a label's straight, steady segments, longest first."""
    from doppelgait.motion import find_segments, read
    from doppelgait.motion.readers import take_part

    root = folder / FOLDERS[label]
    files = sorted(path for path in root.rglob("*") if path.is_file()) if root.is_dir() else []
    found: list[NamedMotion] = []
    refused: dict[str, str] = {}
    for file in files:
        try:
            with warnings.catch_warnings():
                # ignore the warnings of cleaning; the command "motion info" shows them
                warnings.simplefilter("ignore", DoppelgaitWarning)
                motion, name = read(file), file.relative_to(folder).as_posix()
                for number in range(1, len(find_segments(motion)) + 1):
                    segment = take_part(file, motion, segment=number, loop_to_s=None)
                    found.append(NamedMotion(f"{name}, segment {number}", label, segment, real=True))
        except DoppelgaitError as error:
            refused[file.name] = str(error).replace(f"{file}: ", "").partition(";")[0]
    if refused:
        shown = "; ".join(f"{name}: {reason}" for name, reason in list(refused.items())[:SHOWN_REASONS])
        text = f"{root.name}: {len(refused)} of {len(files)} motion files are left out: {shown}"
        warnings.warn(text, DoppelgaitWarning, stacklevel=2)
    return sorted(found, key=lambda body: (-body.seconds, body.name))


def make_point_table(
    radar: Radar, n_frames: int, *, range_m: npt.ArrayLike, velocity_mps: npt.ArrayLike, rcs_m2: npt.ArrayLike = 1.0
) -> xr.Dataset:
    """Make a table of points at constant velocity."""
    time_s = np.arange(n_frames) / radar.prf_hz
    ranges, speeds, sections = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(values, dtype=float)) for values in (range_m, velocity_mps, rcs_m2))
    )
    way_m = (time_s - time_s[-1] / 2)[:, None] * speeds
    values = {
        "range": ranges - way_m,
        "radial_velocity": np.broadcast_to(speeds, way_m.shape),
        "rcs": np.broadcast_to(sections, way_m.shape),
        "path_gain": np.ones_like(way_m),
    }
    dims = ("slow_time", "scatterer")
    return xr.Dataset(
        {name: (dims, array, {"units": UNITS[name]}) for name, array in values.items()},
        coords={
            "slow_time": ("slow_time", time_s, {"units": "s"}),
            "target": ("scatterer", np.arange(ranges.size)),
            "marker": ("scatterer", np.array([f"point {n}" for n in range(ranges.size)])),
            "part": ("scatterer", np.full(ranges.size, "")),
        },
    )


def make_target(body: NamedMotion, **options: Any) -> Target:
    """Make a target with the report's cross section (its Table 3.2), the same for every scatterer (Eq. 3.2)."""
    return Target(body.motion, label=body.label, rcs=RcsSpec(kind="equal", total_m2=RCS_M2[body.label]), **options)


def simulate_slow_time_signal(radar: Radar, table: xr.Dataset, *, range_m: float) -> npt.NDArray[np.complex128]:
    """Simulate the noise-free slow-time signal at a range, V."""
    baseband = synthesise(table, radar)
    return np.asarray(baseband.sel(range=range_m, method="nearest").values, dtype=np.complex128)


T = TypeVar("T")

STEEPNESS = 0.4
THRESHOLD = 0.04
"""sigma_w and t_mu of the report's Table 5.2."""
MIN_STRIDES = 2.5
"""Minimum number of strides of a recorded walk that replaces the report's."""
WALKS = ("walk",)
RUNS = ("gallop", "canter", "bound", "transverse_gallop")


class Material:
    """Radar, targets, recordings and results of one run."""

    def __init__(self, *, seed: int = 2018, motion_folder: Path | None = None) -> None:
        if motion_folder is not None:
            check_folder(motion_folder)
        self.seed = seed
        self.motion_folder = motion_folder
        self._made: dict[Hashable, Any] = {}
        self._used: dict[str, None] = {}

    def compute_once(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return the result of ``make``, computed once per key."""
        if key not in self._made:
            self._made[key] = make()
        found: T = self._made[key]
        return found

    def begin_entry(self) -> None:
        """Begin the next entry and forget sources."""
        self._used.clear()

    def used(self) -> tuple[str, ...]:
        """Return the entry's sources, such as "model: ..."."""
        return tuple(self._used)

    def use(self, body: NamedMotion) -> NamedMotion:
        """Note a target as the entry's source."""
        self._used[body.about] = None
        return body

    def note(self, text: str) -> None:
        """Note the entry's sources as one text."""
        self._used[text] = None

    def people(self) -> list[NamedMotion]:
        """Return recorded people, longest first, or models."""
        return self.compute_once("people", lambda: self._read_recorded("human") or make_model_people())

    def dogs(self) -> list[NamedMotion]:
        """Return recorded dogs, longest first, or models."""
        return self.compute_once("dogs", lambda: self._read_recorded("dog") or make_model_dogs())

    def _read_recorded(self, label: str) -> list[NamedMotion]:
        return [] if self.motion_folder is None else read_recorded(self.motion_folder, label)

    def make_walker(self, speed_mps: float = CHEN_SPEED_MPS, *, cycles: int = 5) -> NamedMotion:
        """Return the report's "Chen target model"."""
        key = ("walker", speed_mps, cycles)
        return self.use(self.compute_once(key, lambda: make_chen_walker(speed_mps, cycles=cycles)))

    def make_walkers(self) -> list[NamedMotion]:
        """Return people walking with known feet."""
        parts = {"left_foot", "right_foot", "torso"}
        fit = [
            one
            for one in self.people()
            if one.gait in WALKS and parts <= set(one.motion.parts) and one.strides >= MIN_STRIDES
        ]
        return sorted(fit, key=lambda one: (-len(one.motion.markers), -one.seconds)) or self.people()

    def person(self) -> NamedMotion:
        """Return the recorded walk of the report."""
        return self.use(self.make_walkers()[0])

    def find_galloping_dog(self) -> NamedMotion:
        """Return the longest gallop, canter or bound."""
        return self.use(next((one for one in self.dogs() if one.gait in RUNS), self.dogs()[0]))

    def radar(self, **changes: Any) -> Radar:
        """Return the report's radar (Table 5.1) with changes."""
        return Radar.preset("liland2018", **changes)

    def recording(
        self,
        body: NamedMotion,
        *,
        prf_hz: float = 1000.0,
        aspect_deg: float = 0.0,
        range_m: float | None = None,
        duration_s: float | None = None,
    ) -> Recording:
        """Simulate a target's noise-free recording."""
        self.use(body)
        key = ("recording", body.name, prf_hz, aspect_deg, range_m, duration_s)
        target = make_target(body, aspect_deg=aspect_deg, range_m=range_m)
        return self.compute_once(
            key, lambda: simulate(Scene([target], duration_s=duration_s), self.radar(prf_hz=prf_hz))
        )

    def result(
        self,
        body: NamedMotion,
        *,
        method: Literal["standard", "liland2018"] = "liland2018",
        cpi_s: float = 0.1,
        **recording: Any,
    ) -> Result:
        """Analyse a target in its true gate."""
        seen = self.recording(body, **recording)
        analysis = Analysis(method=method, cpi_s=cpi_s, window_steepness=STEEPNESS, bandwidth_threshold=THRESHOLD)
        key = ("result", id(seen), method, cpi_s)  # the recording is stored, so that its id stays unique
        return self.compute_once(key, lambda: analyze(seen, gate="truth", analysis=analysis)[0])
