"""Short simulations of one or two targets, for Try it."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

from doppelgait.core.errors import ConfigError, DoppelgaitError, DoppelgaitWarning
from doppelgait.pipeline import parse_run, run_simulation
from doppelgait.processing.gate import GateName
from doppelgait.viewer.run import Run
from doppelgait.viewer.settings import Settings
from doppelgait.viewer.try_controls import (
    BUILD_OF,
    COMPANY_M,
    SIZE_OF,
    TARGETS,
    Value,
    format_moved_note,
    list_controls,
    middle_range_m,
    place_beside,
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
    targets = [{"label": LABELS.get(who, who), **place, "motion": MOTIONS[who](values)}]
    if company != "nobody":
        size = {SIZE_OF[company]: COMPANY_M[company]}
        motion = MOTIONS[company]({"speed_mps": values["speed_mps"], "gait": "auto", **size})
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


def _make_person(values: Mapping[str, Value]) -> dict[str, Value]:
    shared = {name: values[name] for name in ("gait", "speed_mps", "height_m")}
    return {"kind": "human", **shared, "step_time_sd": STEP_TIME_SD, "step_length_sd": STEP_LENGTH_SD}


def _make_animal(who: str) -> Callable[[Mapping[str, Value]], dict[str, Value]]:
    def motion(values: Mapping[str, Value]) -> dict[str, Value]:
        shared = {name: values[name] for name in ("gait", "speed_mps", "withers_m")}
        return {"kind": "quadruped", "build": BUILD_OF[who], **shared, "stride_variation": STRIDE_VARIATION}

    return motion


MOTIONS: Mapping[str, Callable[[Mapping[str, Value]], dict[str, Value]]] = {
    "person": _make_person,
    "dog": _make_animal("dog"),
    "cat": _make_animal("cat"),
    "fan": lambda values: {"kind": "fan", "rotation_hz": values["rotation_hz"]},
    "curtain": lambda values: {"kind": "curtain"},
    "vacuum": lambda values: {"kind": "vacuum", "speed_mps": values["speed_mps"]},
}
"""Motion model of every target, and its parameters."""


def run_of(parameters: Mapping[str, str]) -> Run:
    """Simulate the run of the controls."""
    table = make_scene_table(parameters)
    try:
        spec = parse_run(table, where="")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", DoppelgaitWarning)
            recording = run_simulation(spec)
    except DoppelgaitError as error:
        # Message without positions in a scene file, which the page does not show.
        text = str(error)
        head, mark, rest = text.rpartition("': ")
        text = rest if mark and head.startswith("targets.") else text
        raise ConfigError(re.sub(r"^targets\.\d+\.(motion\.)?", "", text)) from None
    notes = dict.fromkeys(str(one.message) for one in caught if issubclass(one.category, DoppelgaitWarning))
    values = parse_controls(parameters)
    settings = Settings(gate=GATE, analysis=spec.analysis)
    return Run(
        name=f"Try it: {TARGETS[str(values['who'])]}",
        kind="try",
        settings=settings,
        load=lambda: recording,
        notes=(*format_moved_note(values), *notes),
    )


def answer_scene(run: Run, parameters: Mapping[str, str]) -> dict[str, Any]:
    """Return the answer of ``api/scene``."""
    return {"toml": format_scene_toml(make_scene_table(parameters)), "notes": list(run.notes)}


def format_scene_toml(table: Mapping[str, Any]) -> str:
    """Format a scene file as TOML."""
    plain = {key: value for key, value in table.items() if not isinstance(value, dict | list)}
    lines = ["# doppelgait simulate scene.toml -o recording.h5", *_rows(plain)]
    for name, section in table.items():
        if isinstance(section, dict):
            lines += ["", f"[{name}]", *_rows(section)]
    for target in table["targets"]:
        lines += ["", "[[targets]]", *_rows(target)]
    return "\n".join(lines) + "\n"


def _rows(section: Mapping[str, Any]) -> list[str]:
    lines = []
    for key, value in section.items():
        if isinstance(value, dict):
            text = "{ " + ", ".join(_rows(value)) + " }"
        else:
            text = f'"{value}"' if isinstance(value, str) else repr(value)
        lines.append(f"{key} = {text}")
    return lines
