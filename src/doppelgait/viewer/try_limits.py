"""Limits in "Try it" that hang on other controls: of the speed on gait and size, of the range on the radar."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, get_args

from doppelgait.core.config import validate
from doppelgait.motion.models.human import HumanConfig
from doppelgait.motion.models.quadruped_gaits import GAITS, GAITS_BY_SPEED, GaitName
from doppelgait.motion.models.quadruped_sizes import BUILDS, froude_speed_mps, hip_height_m
from doppelgait.radar import Radar

BUILD_OF = {"dog": "standard", "cat": "cat"}
"""Build of the animals, by mover."""
SIZE_OF = {"person": "height_m", "dog": "withers_m", "cat": "withers_m"}
COMPANY_M = {"person": 1.75, "dog": 0.5}
"""Size of a second mover."""


@dataclass(frozen=True)
class Limit:
    """Limits ``low`` to ``high`` of a control while other controls have the values ``when``.

    Parameters
    ----------
    when : mapping
        Values by name of a control; all must be so.
    low, high : float, optional
        None where there is no limit.
    size, power : str, float
        Control whose value, to this power, multiplies both; "" for none.
    """

    when: Mapping[str, str]
    low: float | None = None
    high: float | None = None
    size: str = ""
    power: float = 1.0

    def applies(self, values: Mapping[str, Any]) -> bool:
        """Whether the other controls have these values."""
        return all(values.get(name) == value for name, value in self.when.items())


@cache
def speed_limits() -> tuple[Limit, ...]:
    """Limits of the speed in every gait of every mover, and beside a second mover."""
    found = []
    for who, size in SIZE_OF.items():
        for gait, low, high, power in _gaits(who):
            found.append(Limit({"who": who, "gait": gait}, low, high, size, power))
    for kind, size_m in COMPANY_M.items():
        _, low, high, power = next(_gaits(kind))
        found.append(Limit({"company": kind}, low * size_m**power, high * size_m**power))
    return tuple(found)


def _gaits(who: str) -> Iterator[tuple[str, float, float, float]]:
    """Gait, slowest and fastest at a size of 1 m, and the power of the size that they go by; "auto" comes first."""
    if who == "person":
        run = _human_mps("run")
        yield "auto", 0.0, run[1], 0.5
        yield "walk", *_human_mps("walk"), 1.0
        yield "run", *run, 0.5
        return
    hip_m = hip_height_m(BUILDS[BUILD_OF[who]], 1.0)
    slowest, fastest = GAITS[GAITS_BY_SPEED[0]].froude[0], GAITS[GAITS_BY_SPEED[-1]].froude[1]
    yield "auto", froude_speed_mps(slowest, hip_m), froude_speed_mps(fastest, hip_m), 0.5
    for gait in get_args(GaitName):
        low, high, _ = GAITS[gait].froude
        yield gait, froude_speed_mps(low, hip_m), froude_speed_mps(high, hip_m), 0.5


def _human_mps(gait: Literal["walk", "run"]) -> tuple[float, float]:
    allowed_mps = {"walk": 0.5, "run": 3.0}[gait]
    return validate(HumanConfig, {"gait": gait, "speed_mps": allowed_mps, "height_m": 1.0}, where="").speed_range_mps


def seen_m(radar: str) -> tuple[float, float | None]:
    """Nearest and farthest range that a preset sees, m; continuous wave has no farthest."""
    preset = Radar.preset(radar)
    return (0.0, None) if preset.waveform == "cw" else (preset.range_start_m, preset.range_stop_m)


def range_limits(radars: Mapping[str, str]) -> tuple[Limit, ...]:
    """Limits of the range by radar."""
    return tuple(Limit({"radar": name}, *seen_m(name)) for name in radars)
