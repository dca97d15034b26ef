"""What can be set in "Try it": words, units, limits, and what is taken for a start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Literal, get_args

from doppelgait.core.errors import ConfigError
from doppelgait.motion.models.quadruped_gaits import GaitName
from doppelgait.radar.config import preset_names
from doppelgait.viewer.query import number_of
from doppelgait.viewer.try_limits import Limit, range_limits, speed_limits

Value = str | float | int

MOVERS = {
    "person": "person", "dog": "dog", "cat": "cat", "fan": "fan", "curtain": "curtain", "vacuum": "robot vacuum",
}  # fmt: skip
LEGGED = ("person", "dog", "cat")
TOO_SLOW = ("x4-17fps",)
"""Presets for breathing: their frame rate shows no gait."""


@dataclass(frozen=True)
class Control:
    """One control.

    Parameters
    ----------
    name, words, unit, help : str
        Name in a request, and what people read.
    kind : {"number", "whole", "choice"}
    low, high, step, default : float
        Of a number.
    values : mapping
        Words by value, of a choice; the first is the default unless ``default`` says otherwise.
    who : tuple of str
        Movers that have it; all by default.
    by_who : mapping
        Other limits and defaults by mover.
    values_by_who : mapping
        Values that a mover has, where it does not have all.
    limits : tuple of Limit
        What other controls leave of the limits.
    """

    name: str
    words: str
    help: str
    kind: Literal["number", "whole", "choice"] = "number"
    unit: str = ""
    low: float = 0.0
    high: float = 0.0
    step: float = 0.0
    default: Value = ""
    values: Mapping[str, str] = field(default_factory=dict)
    who: tuple[str, ...] = tuple(MOVERS)
    by_who: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    values_by_who: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    limits: tuple[Limit, ...] = ()

    def default_for(self, who: str) -> Value:
        """Default of a mover."""
        return self.by_who.get(who, {}).get("default", self.default)

    def parse(self, text: str, who: str) -> Value:
        """Value of a request.

        Raises
        ------
        ConfigError
            If it is not allowed for this mover.
        """
        if who not in self.who:
            owners = ", ".join(MOVERS[name] for name in self.who)
            raise ConfigError(f"{self.name}: is not for who = {who}; it is for {owners}")
        if self.kind == "choice":
            allowed = self.values_by_who.get(who, tuple(self.values))
            if text not in allowed:
                raise ConfigError(f"{self.name}: {text!r} is not allowed; it must be one of {', '.join(allowed)}")
            return text
        own = self.by_who.get(who, {})
        number = number_of(self.name, text, least=own.get("low", self.low), most=own.get("high", self.high))
        if self.kind == "number":
            return number
        if not number.is_integer():
            raise ConfigError(f"{self.name}: {text!r} is not allowed; it must be a whole number")
        return int(number)


@cache
def all_controls() -> tuple[Control, ...]:
    """All controls in the order of the page; ``who`` comes first."""
    radars = {name: name for name in preset_names() if name not in TOO_SLOW}
    return (*_gait_controls(), *_body_controls(), *_place_controls(radars), *_radar_controls(radars), *_run_controls())


def _gait_controls() -> tuple[Control, ...]:
    """Who moves, how fast and how."""
    gaits = {"auto": "by speed", "run": "run", **{name: name.replace("_", " ") for name in get_args(GaitName)}}
    return (
        Control("who", "who", "What moves in front of the radar.", "choice", default="person", values=MOVERS),
        Control(
            "speed_mps", "speed", "Speed over the floor; the gait sets how slow and how fast it can be.", unit="m/s",
            low=0.3, high=10.0, step=0.05, default=1.2, who=(*LEGGED, "vacuum"),
            limits=speed_limits(),
            by_who={
                "dog": {"default": 2.0, "high": 9.0},
                "cat": {"default": 0.8, "low": 0.2, "high": 6.0},
                "vacuum": {"default": 0.3, "low": 0.05, "high": 1.0},
            },
        ),
        Control(
            "gait", "gait", "How it moves its legs; 'by speed' takes the gait that goes with speed and size.", "choice",
            default="auto", values=gaits, who=LEGGED,
            values_by_who={
                "person": ("auto", "walk", "run"),
                **{animal: ("auto", *get_args(GaitName)) for animal in ("dog", "cat")},
            },
        ),
    )  # fmt: skip


def _body_controls() -> tuple[Control, ...]:
    """What the mover is like, and whether it is alone."""
    return (
        Control(
            "height_m", "stature", "Height of the person: longer legs step more slowly at the same speed.", unit="m",
            low=0.9, high=2.2, step=0.01, default=1.75, who=("person",),
        ),
        Control(
            "withers_m", "withers height", "Height of the animal's shoulders.", unit="m",
            low=0.2, high=0.9, step=0.01, default=0.5, who=("dog", "cat"),
            by_who={"cat": {"default": 0.25, "high": 0.4}},
        ),
        Control(
            "rotation_hz", "rotation", "Turns of the blades per second.", unit="Hz",
            low=0.5, high=25.0, step=0.5, default=3.0, who=("fan",),
        ),
        Control(
            "company", "beside it", "A second mover, one metre to the side, at the same speed.", "choice",
            default="nobody", values={"nobody": "nobody", "person": "a person", "dog": "a dog"}, who=LEGGED,
        ),
    )  # fmt: skip


def _place_controls(radars: Mapping[str, str]) -> tuple[Control, ...]:
    """Where it moves, seen from the radar."""
    return (
        Control(
            "aspect_deg", "aspect", "Direction of travel: 0 towards the radar, 90 across, 180 away.", unit="°",
            low=-180.0, high=180.0, step=1.0, default=0.0,
            by_who={"fan": {"default": 60.0}},  # towards the radar the blades turn across the line of sight
        ),
        Control(
            "range_m", "range", "Distance from the radar in the middle of the time; more where a mover came too near.",
            unit="m", low=1.0, high=15.0, step=0.1, default=4.0, limits=range_limits(radars),
        ),
    )  # fmt: skip


def _radar_controls(radars: Mapping[str, str]) -> tuple[Control, ...]:
    """The radar, its noise and the analysis."""
    return (
        Control(
            "radar", "radar", "Sensor: its carrier sets the Doppler scale, its frame rate the highest speed.", "choice",
            default="x4", values=radars,
        ),
        Control(
            "noise", "noise", "Receiver noise at the SNR below, or none.", "choice",
            default="on", values={"on": "on", "off": "off"},
        ),
        Control(
            "snr_db", "SNR", "Strongest range bin over the noise, mean over time, in one frame.", unit="dB",
            low=-20.0, high=50.0, step=1.0, default=20.0,
        ),
        Control(
            "cpi_s", "interval", "Coherent processing interval: longer gives finer Doppler, and blurs the legs.",
            unit="s", low=0.02, high=0.5, step=0.01, default=0.1,
        ),
    )  # fmt: skip


def _run_controls() -> tuple[Control, ...]:
    """Length and draw."""
    return (
        Control(
            "duration_s", "duration", "How long the radar looks.", unit="s", low=2.0, high=6.0, step=0.5, default=4.0,
        ),
        Control(
            "seed", "seed", "Number of the draw: noise, and how unlike the steps are.", "whole",
            low=0, high=9999, step=1, default=1,
        ),
    )  # fmt: skip
