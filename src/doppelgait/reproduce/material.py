"""What the figures are made from: the report's radar, its movers, their recordings and results, each made once."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any, TypeVar

from doppelgait.pipeline import TargetResult, analyze, simulate
from doppelgait.processing import Analysis
from doppelgait.radar import Radar, Recording
from doppelgait.reproduce import movers
from doppelgait.reproduce.movers import Mover
from doppelgait.scene import Scene, Target
from doppelgait.scene.rcs import RcsSpec

T = TypeVar("T")

RCS_M2 = {"human": 1.0, "dog": 0.2}
"""Total radar cross section by label, the same for every scatterer of a target (the report's Table 3.2, Eq. 3.2)."""
STEEPNESS = 0.4
THRESHOLD = 0.04
"""sigma_w and t_mu of the report's Table 5.2."""
MIN_STRIDES = 2.5
"""Strides that a recorded walk must have to stand for the report's."""
WALKS = ("walk",)
RUNS = ("gallop", "canter", "bound", "transverse_gallop")


class Material:
    """Radar, movers, recordings and results of one run of the reproduction; nothing is made before it is asked for.

    Parameters
    ----------
    seed : int
        Root of what is random in the study of scenarios.
    motion_folder : Path, optional
        Folder with ``human/`` and ``dog/``, whose recordings take the place of models.

    Raises
    ------
    ConfigError
        If the motion folder has neither.
    """

    def __init__(self, *, seed: int = 2018, motion_folder: Path | None = None) -> None:
        if motion_folder is not None:
            movers.check_folder(motion_folder)
        self.seed = seed
        self.motion_folder = motion_folder
        self._made: dict[Hashable, Any] = {}
        self._used: dict[str, None] = {}

    def once(self, key: Hashable, make: Callable[[], T]) -> T:
        """What ``make`` gives, made at the first call with this key."""
        if key not in self._made:
            self._made[key] = make()
        found: T = self._made[key]
        return found

    def begin_entry(self) -> None:
        """Forget what was used so far: the next entry begins."""
        self._used.clear()

    def used(self) -> tuple[str, ...]:
        """What the entry was made from: "model: ..." or "recording: ..." for every mover that it took."""
        return tuple(self._used)

    def use(self, mover: Mover) -> Mover:
        """The mover, noted as one that the present entry is made from."""
        self._used[mover.about] = None
        return mover

    def note(self, text: str) -> None:
        """Say of the present entry what it is made from, where single movers are too many to name."""
        self._used[text] = None

    def people(self) -> list[Mover]:
        """Recorded people of the motion folder, the longest stretch first; models where there are none."""
        return self.once("people", lambda: self._recorded("human") or movers.model_people())

    def dogs(self) -> list[Mover]:
        """Recorded dogs of the motion folder, the longest stretch first; models where there are none."""
        return self.once("dogs", lambda: self._recorded("dog") or movers.model_dogs())

    def _recorded(self, label: str) -> list[Mover]:
        return [] if self.motion_folder is None else movers.recorded(self.motion_folder, label)

    def walker(self, speed_mps: float = movers.CHEN_SPEED_MPS, *, cycles: int = 5) -> Mover:
        """The report's "Chen target model": always a model, in the report too."""
        key = ("walker", speed_mps, cycles)
        return self.use(self.once(key, lambda: movers.chen_walker(speed_mps, cycles=cycles)))

    def walkers(self) -> list[Mover]:
        """People who walk for some strides with known feet, the most points first: the report's had 41."""
        fit = [one for one in self.people() if one.gait in WALKS and _has_feet(one) and one.strides >= MIN_STRIDES]
        return sorted(fit, key=lambda one: (-one.motion.sizes["marker"], -one.seconds)) or self.people()

    def person(self) -> Mover:
        """The recorded walk of the report's chapters 2, 3 and 5: the first of :meth:`walkers`."""
        return self.use(self.walkers()[0])

    def galloping_dog(self) -> Mover:
        """The recorded dog of the report: the longest gallop, canter or bound at hand."""
        return self.use(next((one for one in self.dogs() if one.gait in RUNS), self.dogs()[0]))

    def radar(self, **changes: Any) -> Radar:
        """The radar as the report simulated it (its Table 5.1), with single parameters changed."""
        return Radar.preset("liland2018", **changes)

    def recording(
        self, mover: Mover, *, prf_hz: float = 1000.0, aspect_deg: float = 0.0, range_m: float | None = None,
        duration_s: float | None = None,
    ) -> Recording:  # fmt: skip
        """Noise-free recording of a mover by the report's radar.

        Parameters
        ----------
        mover : Mover
        prf_hz : float
        aspect_deg : float
            psi at the middle of the observation, 0 approaching.
        range_m : float, optional
            Ground range of the body there; by default as near as keeps it 2 m away.
        duration_s : float, optional
            Observation time; the whole motion by default.
        """
        self.use(mover)
        key = ("recording", mover.name, prf_hz, aspect_deg, range_m, duration_s)
        target = Target(
            mover.motion, label=mover.label, rcs=RcsSpec(kind="equal", total_m2=RCS_M2[mover.label]),
            aspect_deg=aspect_deg, range_m=range_m,
        )  # fmt: skip
        return self.once(key, lambda: simulate(Scene([target], duration_s=duration_s), self.radar(prf_hz=prf_hz)))

    def result(self, mover: Mover, *, method: str = "liland2018", cpi_s: float = 0.1, **recording: Any) -> TargetResult:
        """Result of a mover in its truth gate.

        Parameters
        ----------
        mover : Mover
        method : {"liland2018", "standard"}
        cpi_s : float
            T_d.
        **recording
            As for :meth:`recording`.
        """
        seen = self.recording(mover, **recording)
        analysis = Analysis(
            method=method, cpi_s=cpi_s, window_steepness=STEEPNESS, bandwidth_threshold=THRESHOLD,  # type: ignore[arg-type]
        )  # fmt: skip
        key = ("result", id(seen), method, cpi_s)  # the recording is kept, so its id stays its own
        return self.once(key, lambda: analyze(seen, gate="truth", analysis=analysis)[0])


def _has_feet(mover: Mover) -> bool:
    parts = {str(part) for part in mover.motion.coords["part"].values}
    return {"left_foot", "right_foot", "torso"} <= parts
