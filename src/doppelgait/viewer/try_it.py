"""Short simulations of one or two targets, for Try it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import cache
from typing import Any, Literal, get_args

from doppelgait.core.config import validate, write_toml
from doppelgait.core.errors import ConfigError, DoppelgaitError
from doppelgait.motion.models.human import HumanConfig
from doppelgait.motion.models.quadruped_gaits import (
    BUILDS,
    GAITS,
    GAITS_BY_SPEED,
    GaitName,
    froude_speed_mps,
    hip_height_m,
)
from doppelgait.pipeline import parse_run, run_simulation
from doppelgait.processing.gate import GateName
from doppelgait.radar import Radar
from doppelgait.radar.presets import list_preset_names
from doppelgait.viewer.run import Run, collect_warnings
from doppelgait.viewer.settings import Settings, parse_number

BUILD_OF = {"dog": "standard", "cat": "cat"}  # body build of the animals, by target
SIZE_OF = {"person": "height_m", "dog": "withers_m", "cat": "withers_m"}
COMPANY_M = {"person": 1.75, "dog": 0.5}  # size of a second target


@dataclass(frozen=True)
class Limit:
    """Limits of a control that depend on other controls."""

    when: Mapping[str, str]
    low: float | None = None
    high: float | None = None
    size: str = ""
    power: float = 1.0


@cache
def list_speed_limits() -> tuple[Limit, ...]:
    """Return the speed limits of every gait of every target."""
    found = []
    for who, size in SIZE_OF.items():
        for gait, low, high, power in _list_gaits(who):
            found.append(Limit({"who": who, "gait": gait}, low, high, size, power))
    for kind, size_m in COMPANY_M.items():
        _, low, high, power = next(_list_gaits(kind))
        found.append(Limit({"company": kind}, low * size_m**power, high * size_m**power))
    return tuple(found)


def _list_gaits(who: str) -> Iterator[tuple[str, float, float, float]]:
    """Yield gaits with their speed limits at 1 m size."""
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
    """Return the nearest and farthest range of a preset, m."""
    preset = Radar.preset(radar)
    return (preset.range_start_m, preset.range_stop_m) if preset.waveform.ranged else (0.0, None)


NEAREST_M = 1.0
"""Smallest distance of a body; nearer, it fills the beam, and passing dominates the SNR."""
BESIDE_M = 1.0  # distance of the paths of two targets
STEP_M = 0.1


def middle_range_m(values: Mapping[str, Any]) -> float:
    """Return the requested range, or the next that is far enough."""
    asked_m, (start_m, stop_m) = float(values["range_m"]), seen_m(str(values["radar"]))
    if stop_m is not None and asked_m > stop_m:
        raise ConfigError(
            f"range_m: {asked_m:g} is not allowed: the radar {values['radar']} covers {start_m:.3g} to {stop_m:.3g} m; "
            "use x4-long or a smaller range"
        )
    allowed_m, steps = max(NEAREST_M, start_m), 0
    while nearest_m(values, asked_m + steps * STEP_M) < allowed_m - 1e-9:
        steps += 1
    return round(asked_m + steps * STEP_M, 4)


def nearest_m(values: Mapping[str, Any], range_m: float) -> float:
    """Return the smallest distance of the paths from the radar, m."""
    half_m = float(values.get("speed_mps", 0.0)) * float(values["duration_s"]) / 2.0
    heading = math.radians(180.0 + float(values["aspect_deg"]))
    sides = [0.0] if values.get("company", "nobody") == "nobody" else [0.0, BESIDE_M]
    found = []
    for side_m in sides:
        along_m, across_m = range_m * math.cos(heading), side_m - range_m * math.sin(heading)
        found.append(math.hypot(max(abs(along_m) - half_m, 0.0), across_m))
    return min(found)


def place_beside(range_m: float, aspect_deg: float) -> dict[str, float]:
    """Place a second target next to the first."""
    heading = math.radians(180.0 + aspect_deg)
    x, y = range_m - BESIDE_M * math.sin(heading), BESIDE_M * math.cos(heading)
    bearing_deg = math.degrees(math.atan2(y, x))
    turned = (aspect_deg - bearing_deg + 180.0) % 360.0 - 180.0
    return {"range_m": round(math.hypot(x, y), 4), "bearing_deg": round(bearing_deg, 3), "aspect_deg": round(turned, 3)}


Value = str | float | int

TARGETS = {
    "person": "person",
    "dog": "dog",
    "cat": "cat",
    "fan": "fan",
    "curtain": "curtain",
    "vacuum": "robot vacuum",
}
LEGGED = ("person", "dog", "cat")
TOO_SLOW = ("x4-17fps",)  # presets for breathing: their frame rate shows no gait


@dataclass(frozen=True)
class Control:
    """Control of the page."""

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
    who: tuple[str, ...] = tuple(TARGETS)
    by_who: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    values_by_who: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    limits: tuple[Limit, ...] = ()

    def get_default(self, who: str) -> Value:
        """Return the default of a target."""
        return self.by_who.get(who, {}).get("default", self.default)

    def parse(self, text: str, who: str) -> Value:
        """Parse the value of a request."""
        if who not in self.who:
            owners = ", ".join(TARGETS[name] for name in self.who)
            raise ConfigError(f"{self.name}: is not available for who = {who}; it is for {owners}")
        if self.kind == "choice":
            allowed = self.values_by_who.get(who, tuple(self.values))
            if text not in allowed:
                raise ConfigError(f"{self.name}: {text!r} is not allowed; it must be one of {', '.join(allowed)}")
            return text
        own = self.by_who.get(who, {})
        number = parse_number(self.name, text, least=own.get("low", self.low), most=own.get("high", self.high))
        if self.kind == "number":
            return number
        if not number.is_integer():
            raise ConfigError(f"{self.name}: {text!r} is not allowed; it must be a whole number")
        return int(number)


@cache
def list_controls() -> tuple[Control, ...]:
    """Return all controls in the order of the page."""
    radars = {name: name for name in list_preset_names() if name not in TOO_SLOW}
    # Target, speed and gait.
    gaits = {"auto": "by speed", "run": "run", **{name: name.replace("_", " ") for name in get_args(GaitName)}}
    return (
        *(
            Control("who", "target", "Target in front of the radar.", "choice", default="person", values=TARGETS),
            Control(
                "speed_mps",
                "speed",
                "Speed over the floor; the gait determines its limits.",
                unit="m/s",
                low=0.3,
                high=10.0,
                step=0.05,
                default=1.2,
                who=(*LEGGED, "vacuum"),
                limits=list_speed_limits(),
                by_who={
                    "dog": {"default": 2.0, "high": 9.0},
                    "cat": {"default": 0.8, "low": 0.2, "high": 6.0},
                    "vacuum": {"default": 0.3, "low": 0.05, "high": 1.0},
                },
            ),
            Control(
                "gait",
                "gait",
                "Gait; 'by speed' selects the gait for speed and size.",
                "choice",
                default="auto",
                values=gaits,
                who=LEGGED,
                values_by_who={
                    "person": ("auto", "walk", "run"),
                    **{animal: ("auto", *get_args(GaitName)) for animal in ("dog", "cat")},
                },
            ),
        ),
        # Size of the target, and second target.
        Control(
            "height_m",
            "stature",
            "Height of the person: longer legs step more slowly at the same speed.",
            unit="m",
            low=0.9,
            high=2.2,
            step=0.01,
            default=1.75,
            who=("person",),
        ),
        Control(
            "withers_m",
            "withers height",
            "Height of the animal's shoulders.",
            unit="m",
            low=0.2,
            high=0.9,
            step=0.01,
            default=0.5,
            who=("dog", "cat"),
            by_who={"cat": {"default": 0.25, "high": 0.4}},
        ),
        Control(
            "rotation_hz",
            "rotation",
            "Turns of the blades per second.",
            unit="Hz",
            low=0.5,
            high=25.0,
            step=0.5,
            default=3.0,
            who=("fan",),
        ),
        Control(
            "company",
            "second target",
            "A second target, one metre to the side, at the same speed.",
            "choice",
            default="nobody",
            values={"nobody": "no one", "person": "a person", "dog": "a dog"},
            who=LEGGED,
        ),
        # Position and direction relative to the radar.
        Control(
            "aspect_deg",
            "aspect",
            "Direction of travel: 0 towards the radar, 90 across, 180 away.",
            unit="°",
            low=-180.0,
            high=180.0,
            step=1.0,
            default=0.0,
            by_who={"fan": {"default": 60.0}},  # towards the radar the blades turn across the line of sight
        ),
        Control(
            "range_m",
            "range",
            "Range in the middle of the time; it is increased if a target would be too near.",
            unit="m",
            low=1.0,
            high=15.0,
            step=0.1,
            default=4.0,
            limits=tuple(Limit({"radar": name}, *seen_m(name)) for name in radars),
        ),
        # The radar, its noise and the analysis.
        Control(
            "radar",
            "radar",
            "Sensor: its carrier sets the Doppler scale, its frame rate the highest speed.",
            "choice",
            default="x4",
            values=radars,
        ),
        Control(
            "noise",
            "noise",
            "Receiver noise at the SNR below, or none.",
            "choice",
            default="on",
            values={"on": "on", "off": "off"},
        ),
        Control(
            "snr_db",
            "SNR",
            "Strongest range bin over the noise, mean over time, in one frame.",
            unit="dB",
            low=-20.0,
            high=50.0,
            step=1.0,
            default=20.0,
        ),
        Control(
            "cpi_s",
            "interval",
            "Coherent processing interval: longer gives finer Doppler, and blurs the legs.",
            unit="s",
            low=0.02,
            high=0.5,
            step=0.01,
            default=0.1,
        ),
        # Duration and random seed.
        Control(
            "duration_s",
            "duration",
            "Duration of the recording.",
            unit="s",
            low=2.0,
            high=6.0,
            step=0.5,
            default=4.0,
        ),
        Control(
            "seed",
            "seed",
            "Random seed of the noise and of the variation of steps.",
            "whole",
            low=0,
            high=9999,
            step=1,
            default=1,
        ),
    )


STEP_TIME_SD, STEP_LENGTH_SD, STRIDE_VARIATION = 0.02, 0.03, 0.02
"""Variation of the steps of healthy adults, and of the strides of an animal."""
LABELS = {"person": "human"}
GATE: GateName = "truth"


def describe_controls() -> list[dict[str, Any]]:
    """Return the controls for the page."""
    return [{**asdict(control), "values": list(control.values.items())} for control in list_controls()]


def parse_controls(parameters: Mapping[str, str]) -> dict[str, Value]:
    """Return the value of every control of the target."""
    first, *others = list_controls()
    unknown = sorted(set(parameters) - {control.name for control in list_controls()})
    if unknown:
        raise ConfigError(f"{unknown[0]}: is not a control of 'Try it'")
    who = str(first.parse(parameters.get("who", str(first.default)), str(first.default)))
    found: dict[str, Value] = {"who": who}
    for control in others:
        if control.name in parameters:
            found[control.name] = control.parse(parameters[control.name], who)
        elif who in control.who:
            found[control.name] = control.get_default(who)
    return found


def make_scene_table(parameters: Mapping[str, str]) -> dict[str, Any]:
    """Return the tables of the controls' scene file."""
    values = parse_controls(parameters)
    who, company = str(values["who"]), str(values.get("company", "nobody"))
    place = {"range_m": middle_range_m(values), "aspect_deg": float(values["aspect_deg"])}
    targets = [{"label": LABELS.get(who, who), **place, "motion": make_motion(who, values)}]
    if company != "nobody":
        size = {SIZE_OF[company]: COMPANY_M[company]}
        motion = make_motion(company, {"speed_mps": values["speed_mps"], "gait": "auto", **size})
        targets.append({"label": LABELS.get(company, company), **place_beside(**place), "motion": motion})
    noise = {"kind": "snr", "snr_db": values["snr_db"]} if values["noise"] == "on" else {"kind": "none"}
    return {
        "seed": values["seed"],
        "duration_s": values["duration_s"],
        "radar": {"preset": values["radar"]},
        "noise": noise,
        "analysis": {"cpi_s": values["cpi_s"]},
        "targets": targets,
    }


MOTIONS: Mapping[str, tuple[dict[str, Value], tuple[str, ...]]] = {
    "person": (
        {"kind": "human", "step_time_sd": STEP_TIME_SD, "step_length_sd": STEP_LENGTH_SD},
        ("gait", "speed_mps", "height_m"),
    ),
    **{
        who: (
            {"kind": "quadruped", "build": build, "stride_variation": STRIDE_VARIATION},
            ("gait", "speed_mps", "withers_m"),
        )
        for who, build in BUILD_OF.items()
    },
    "fan": ({"kind": "fan"}, ("rotation_hz",)),
    "curtain": ({"kind": "curtain"}, ()),
    "vacuum": ({"kind": "vacuum"}, ("speed_mps",)),
}
"""Motion model of every target, and the controls that are its parameters."""


def make_motion(who: str, values: Mapping[str, Value]) -> dict[str, Value]:
    """Return the motion of a target."""
    fixed, names = MOTIONS[who]
    return {**fixed, **{name: values[name] for name in names}}


def run_of(parameters: Mapping[str, str]) -> Run:
    """Simulate the run of the controls."""
    table = make_scene_table(parameters)
    try:
        spec = parse_run(table, where="")
        recording, notes = collect_warnings(lambda: run_simulation(spec))
    except DoppelgaitError as error:
        # Message without positions in a scene file, which the page does not show.
        text = str(error)
        head, mark, rest = text.rpartition("': ")
        text = rest if mark and head.startswith("targets.") else text
        raise ConfigError(re.sub(r"^targets\.\d+\.(motion\.)?", "", text)) from None
    values = parse_controls(parameters)
    asked_m, taken_m = float(values["range_m"]), middle_range_m(values)
    if taken_m != asked_m:
        allowed_m = max(NEAREST_M, seen_m(str(values["radar"]))[0])
        notes.insert(
            0,
            f"range: {taken_m:g} m in the middle of the time instead of {asked_m:g} m, so that no target is nearer to "
            f"the radar than {allowed_m:.3g} m",
        )
    settings = Settings(gate=GATE, analysis=spec.analysis)
    return Run(
        name=f"Try it: {TARGETS[str(values['who'])]}",
        kind="try",
        settings=settings,
        load=lambda: recording,
        notes=tuple(notes),
    )


def answer_scene(run: Run, parameters: Mapping[str, str]) -> dict[str, Any]:
    """Return the answer of ``api/scene``."""
    head = "# doppelgait simulate scene.toml -o recording.h5\n"
    return {"toml": head + write_toml(make_scene_table(parameters)), "notes": list(run.notes)}
