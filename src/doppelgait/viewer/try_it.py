"""A few seconds of one mover or two before a radar, simulated as the controls of "Try it" say."""

from __future__ import annotations

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
    MOVERS,
    SIZE_OF,
    Value,
    all_controls,
    beside,
    middle_range_m,
    moved_note,
)

STEP_TIME_SD, STEP_LENGTH_SD, STRIDE_VARIATION = 0.02, 0.03, 0.02
"""How unlike the steps of healthy adults are, and the strides of an animal."""
LABELS = {"person": "human"}
GATE: GateName = "truth"


def controls() -> list[dict[str, Any]]:
    """The controls, as the page gets them: fields of :class:`doppelgait.viewer.try_controls.Control`."""
    return [{**asdict(control), "values": list(control.values.items())} for control in all_controls()]


def chosen(parameters: Mapping[str, str]) -> dict[str, Value]:
    """Value of every control that the mover has: of the request, else its default.

    Raises
    ------
    ConfigError
        If a value is not allowed, or a parameter is no control.
    """
    first, *others = all_controls()
    unknown = sorted(set(parameters) - {control.name for control in all_controls()})
    if unknown:
        raise ConfigError(f"{unknown[0]}: is no control of 'Try it'")
    who = str(first.parse(parameters.get("who", str(first.default)), str(first.default)))
    found: dict[str, Value] = {"who": who}
    for control in others:
        if control.name in parameters:
            found[control.name] = control.parse(parameters[control.name], who)
        elif who in control.who:
            found[control.name] = control.default_for(who)
    return found


def scene_table(parameters: Mapping[str, str]) -> dict[str, Any]:
    """Tables of the scene file that the controls mean; see :func:`doppelgait.pipeline.parse_run`.

    Raises
    ------
    ConfigError
        As :func:`chosen`.
    """
    values = chosen(parameters)
    noise = {"kind": "snr", "snr_db": values["snr_db"]} if values["noise"] == "on" else {"kind": "none"}
    return {
        "seed": values["seed"],
        "duration_s": values["duration_s"],
        "radar": {"preset": values["radar"]},
        "noise": noise,
        "analysis": {"cpi_s": values["cpi_s"]},
        "targets": _targets(values),
    }


def _targets(values: Mapping[str, Value]) -> list[dict[str, Any]]:
    range_m, aspect_deg = middle_range_m(values), float(values["aspect_deg"])
    who = str(values["who"])
    first = {"label": _label(who), "range_m": range_m, "aspect_deg": aspect_deg, "motion": MOTIONS[who](values)}
    company = values.get("company", "nobody")
    if company == "nobody":
        return [first]
    kind = str(company)
    motion = MOTIONS[kind]({"speed_mps": values["speed_mps"], "gait": "auto", SIZE_OF[kind]: COMPANY_M[kind]})
    return [first, {"label": _label(kind), **beside(range_m, aspect_deg), "motion": motion}]


def _label(who: str) -> str:
    return LABELS.get(who, who)


def _person(values: Mapping[str, Value]) -> dict[str, Value]:
    given = {name: values[name] for name in ("gait", "speed_mps", "height_m")}
    return {"kind": "human", **given, "step_time_sd": STEP_TIME_SD, "step_length_sd": STEP_LENGTH_SD}


def _animal(who: str) -> Callable[[Mapping[str, Value]], dict[str, Value]]:
    def motion(values: Mapping[str, Value]) -> dict[str, Value]:
        given = {name: values[name] for name in ("gait", "speed_mps", "withers_m")}
        return {"kind": "quadruped", "build": BUILD_OF[who], **given, "stride_variation": STRIDE_VARIATION}

    return motion


MOTIONS: Mapping[str, Callable[[Mapping[str, Value]], dict[str, Value]]] = {
    "person": _person,
    "dog": _animal("dog"),
    "cat": _animal("cat"),
    "fan": lambda values: {"kind": "fan", "rotation_hz": values["rotation_hz"]},
    "curtain": lambda values: {"kind": "curtain"},
    "vacuum": lambda values: {"kind": "vacuum", "speed_mps": values["speed_mps"]},
}
"""Motion model of every mover, and its parameters."""


def run_of(parameters: Mapping[str, str]) -> Run:
    """The run that the controls mean, simulated; its targets are analysed when they are asked for.

    Parameters
    ----------
    parameters : mapping
        Values by the name of a control, as text; defaults where they are left out. Warnings of the simulation
        (aliasing, a target that leaves the frame) become notes of the run, as does a range that had to be another.

    Raises
    ------
    ConfigError
        In one sentence, if a value is not allowed, or values do not go together.
    """
    table = scene_table(parameters)
    try:
        spec = parse_run(table, where="")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", DoppelgaitWarning)
            recording = run_simulation(spec)
    except DoppelgaitError as error:
        # Message without the places in a scene file that the page does not show.
        text = str(error)
        head, mark, rest = text.rpartition("': ")
        raise ConfigError(rest if mark and head.startswith("targets.") else text) from None
    notes = dict.fromkeys(str(one.message) for one in caught if issubclass(one.category, DoppelgaitWarning))
    values = chosen(parameters)
    settings = Settings(gate=GATE, analysis=spec.analysis)
    return Run(
        name=f"Try it: {MOVERS[str(values['who'])]}", kind="try", settings=settings, load=lambda: recording,
        notes=(*moved_note(values), *notes),
    )  # fmt: skip


def scene_answer(run: Run, parameters: Mapping[str, str]) -> dict[str, Any]:
    """Answer of ``api/scene``: the scene as a file for ``doppelgait simulate``, and what there is to note."""
    return {"toml": scene_toml(scene_table(parameters)), "notes": list(run.notes)}


def scene_toml(table: Mapping[str, Any]) -> str:
    """Text of a scene file: values first, then sections, then one section per target."""
    plain = {key: value for key, value in table.items() if not isinstance(value, dict | list)}
    lines = ["# doppelgait simulate scene.toml -o recording.h5", *_rows(plain)]
    for name, section in table.items():
        if isinstance(section, dict):
            lines += ["", f"[{name}]", *_rows(section)]
    for target in table["targets"]:
        lines += ["", "[[targets]]", *_rows(target)]
    return "\n".join(lines) + "\n"


def _rows(section: Mapping[str, Any]) -> list[str]:
    return [f"{key} = {_value(value)}" for key, value in section.items()]


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(_rows(value)) + " }"
    return f'"{value}"' if isinstance(value, str) else repr(value)
