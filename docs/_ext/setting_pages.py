"""Every key of every configuration file as tables, from the models that check these files."""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

UNITS = {
    "m2ps3": "m²/s³", "mps2": "m/s²", "mps": "m/s", "dbm": "dBm", "dbi": "dBi", "db": "dB", "hz": "Hz", "deg": "°",
    "rad": "rad", "kg": "kg", "m2": "m²", "m": "m", "s": "s", "v": "V", "bytes": "B", "ms": "ms",
}  # fmt: skip
"""Unit by the last part of a key."""

KINDS = {float: "number", int: "integer", str: "text", bool: "true, false", dict: "table", Any: "any"}
LIMITS = {
    "ge": "≥\u00a0{}", "gt": ">\u00a0{}", "le": "≤\u00a0{}", "lt": "<\u00a0{}",
    "min_length": "length\u00a0≥\u00a0{}", "max_length": "length\u00a0≤\u00a0{}", "pattern": "matches `{}`",
}  # fmt: skip
"""How the rules of pydantic are said."""
PARAMETER = re.compile(r"^([A-Za-z_][\w, ]*?)(?: : .*)?$")

Group = tuple[str, str, list[tuple[str, type[BaseModel]]]]
"""Title, words, and the tables of a page: heading and model."""


def groups() -> dict[str, Group]:
    """List the pages: keys that a user may write, by file."""
    return {
        "scene": ("Scene file", SCENE_WORDS, _scene_models()),
        "motion": ("Motion models and paths", MOTION_WORDS, _motion_models()),
        "radar": ("Radar", RADAR_WORDS, _radar_models()),
        "surroundings": ("Environment and impairments", LIST_WORDS, _list_models()),
        "analysis": ("Analysis and tracking", ANALYSIS_WORDS, _analysis_models()),
        "plan": ("Dataset plan and import", PLAN_WORDS, _plan_models()),
        "files": ("Facts beside files", FILE_WORDS, _file_models()),
    }


SCENE_WORDS = (
    "A scene file is TOML: the keys of `Scene` and `seed` at its top, the tables `[radar]`, `[noise]` and "
    "`[analysis]`, and the lists `[[targets]]`, `[[environment]]` and `[[impairments]]`. `prf_hz = 'auto'` and "
    "`preset` may stand in `[radar]`."
)
MOTION_WORDS = (
    "`motion = { kind = 'NAME', ... }` of a target takes the keys of that model; `kind = 'file'` takes `path` and the "
    "arguments of {py:func}`doppelgait.motion.read`. `path = { kind = 'NAME', ... }` takes those of a path."
)
RADAR_WORDS = "`[radar]`: all of these, or `preset = 'NAME'` and what differs from it."
LIST_WORDS = (
    "Entries of `[[environment]]` and `[[impairments]]`; each names its `kind` and acts in the order of the list."
)
ANALYSIS_WORDS = (
    "`[analysis]` of a scene file or plan, `--set KEY=VALUE` of `doppelgait analyze`; what belongs to `--gate track` "
    "has the prefix `tracking.`, for example `--set tracking.detector.pfa=1e-4`."
)
PLAN_WORDS = (
    "A plan is TOML. Every value of its tables `scene`, `target`, `radar`, `noise`, `analysis` and of its lists may be "
    "a distribution ([datasets](../../datasets.md)); keys there are those of a scene file. The arguments of `dataset "
    "import` are last."
)
FILE_WORDS = (
    "The TOML file beside an `.npz` or `.npy` recording (each key is also an `--option`), beside the `.bin` of a "
    "DCA1000, and `picture.toml` of pictures of spectrograms."
)


def _get(place: str) -> Any:
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


def _models(*places: str) -> list[tuple[str, type[BaseModel]]]:
    return [(place.partition(":")[2], _get(place)) for place in places]


def _radar_models() -> list[tuple[str, type[BaseModel]]]:
    waveforms = _get("doppelgait.radar:WAVEFORMS").values()
    own = [plugin for plugin in waveforms if set(plugin.parameters.model_fields) != {"kind"}]
    models = _models("doppelgait.radar.parameters:Radar", "doppelgait.radar.antenna:Antenna")
    return [*models, *((f'waveform, kind = "{plugin.name}"', plugin.parameters) for plugin in own)]


def _scene_models() -> list[tuple[str, type[BaseModel]]]:
    shared = _get("doppelgait.scene.rcs:RcsSpec")
    own = [plugin for plugin in _get("doppelgait.scene.rcs:RCS").values() if plugin.parameters is not shared]
    models = _models("doppelgait.scene.scene:Scene", "doppelgait.scene.scene:Target")
    models += [("RcsSpec", shared), *((f'rcs, kind = "{plugin.name}"', plugin.parameters) for plugin in own)]
    return [*models, *_models("doppelgait.motion.vary:Variation", "doppelgait.pipeline.conditions:Noise")]


def _motion_models() -> list[tuple[str, type[BaseModel]]]:
    models, paths = _get("doppelgait.motion.models:MOTION_MODELS"), _get("doppelgait.motion.paths:PATHS")
    found = [(f'motion, kind = "{name}"', models[name].parameters) for name in models]
    found += [(f'path, kind = "{name}"', paths[name].parameters) for name in paths]
    return [*found, *_models("doppelgait.motion.paths:StopSpec")]


def _list_models() -> list[tuple[str, type[BaseModel]]]:
    effects, impairments = (
        _get("doppelgait.scene.environment:ENVIRONMENT"),
        _get("doppelgait.radar.impairments:IMPAIRMENTS"),
    )
    found = [(f'environment, kind = "{name}"', effects[name].parameters) for name in effects]
    found += _models("doppelgait.scene.environment:Dielectric")
    return found + [(f'impairments, kind = "{name}"', impairments[name].parameters) for name in impairments]


def _analysis_models() -> list[tuple[str, type[BaseModel]]]:
    return _models(
        "doppelgait.processing:Analysis",
        "doppelgait.pipeline:Tracking",
        "doppelgait.processing.detect.config:Detector",
        "doppelgait.processing.track.live:Tracker",
        "doppelgait.processing.pieces:PieceSettings",
        "doppelgait.processing.breathing:BreathingSettings",
    )


def _plan_models() -> list[tuple[str, type[BaseModel]]]:
    config = "doppelgait.dataset.config"
    return _models(
        f"{config}:PlanConfig", f"{config}:DatasetSection", f"{config}:FieldSpec", f"{config}:SplitSection",
        f"{config}:ClassSection", f"{config}:SourceSection", "doppelgait.dataset.motions:FolderMotion",
        "doppelgait.motion.hybrid:Hybrid",
        "doppelgait.dataset.config:ImportConfig", "doppelgait.classify.alarm:Day",
        "doppelgait.classify.alarm:EpisodeSection",
    )  # fmt: skip


def _file_models() -> list[tuple[str, type[BaseModel]]]:
    return _models(
        "doppelgait.radar.readers.array_facts:ArrayFacts", "doppelgait.radar.readers.ti_config:ChirpConfig",
        "doppelgait.pipeline.pictures:PictureSettings",
    )  # fmt: skip


def settings_page(title: str, words: str, models: list[tuple[str, type[BaseModel]]]) -> str:
    """Markdown of one page."""
    lines = [f"# {title}", "", words, ""]
    for heading, model in models:
        lines += [f"## {heading}", "", _summary(model), "", "| key | type | unit | default | limits | |",
                  "| --- | --- | --- | --- | --- | --- |"]  # fmt: skip
        texts = parameter_words(model)
        lines += [_row(name, field, texts.get(name, "")) for name, field in model.model_fields.items()]
        lines.append("")
    return "\n".join(lines) + "\n"


def _summary(model: type[BaseModel]) -> str:
    return _markdown(inspect.cleandoc(model.__doc__ or "").split("\n\n")[0])


def _row(name: str, field: FieldInfo, words: str) -> str:
    cells = [f"`{name}`", _kind(field.annotation), UNITS.get(name.rpartition("_")[2], ""), _default(field),
             _limits(field), _markdown(words)]  # fmt: skip
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _kind(kind: Any) -> str:
    """Put a type into words."""
    origin, members = get_origin(kind), [member for member in get_args(kind) if member is not type(None)]
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(_kind(member) for member in members))
    if origin is Literal:
        return ", ".join(f"`{member}`" for member in members)
    if origin in (tuple, list):
        if origin is list or members[-1:] == [Ellipsis]:
            return f"list of {_kind(members[0])}"
        return f"{len(members)} × {_kind(members[0])}"
    if origin is dict:
        return "table"
    if hasattr(kind, "__metadata__"):
        return _kind(get_args(kind)[0])
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return "table" if kind.__name__ == "FrozenModel" else f"table {kind.__name__}"
    return KINDS.get(kind, getattr(kind, "__name__", str(kind)))


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if value is None or value is PydanticUndefined or value in ((), [], {}):
        return ""
    return "its defaults" if isinstance(value, BaseModel) else _value(value)


def _value(value: Any) -> str:
    """As TOML would have it, near enough."""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, str):
        return f'`"{value}"`' if value else ""
    if isinstance(value, float):
        return f"`{value:g}`"
    if isinstance(value, tuple | list):
        return ", ".join(_value(getattr(entry, "name", entry)) for entry in value)
    if isinstance(value, Mapping):
        return ", ".join(f"`{key} = {json_like(entry)}`" for key, entry in value.items())
    return f"`{value}`"


def json_like(value: Any) -> str:
    """Write a value inside a table."""
    return f'"{value}"' if isinstance(value, str) else f"{value}"


def _limits(field: FieldInfo) -> str:
    """Bounds of a number, of a list or of the numbers in a list."""
    found = []
    for rule in field.metadata:
        for name, words in LIMITS.items():
            value = getattr(rule, name, None)
            if value is not None:
                found.append(words.format(f"{value:g}" if isinstance(value, float) else value))
    return ", ".join(found)


def parameter_words(model: type[BaseModel]) -> dict[str, str]:
    """Words for every key: from the docstring of the model, of its bases, or of what it says it has parameters of."""
    found: dict[str, str] = {}
    for owner in model.__mro__:
        if owner.__module__.partition(".")[0] in ("pydantic", "builtins"):
            continue
        text = inspect.cleandoc(owner.__doc__ or "")
        for each in (text, _referred(text, owner.__module__)):
            for name, words in _sections(each):
                found[name] = found.get(name) or words
    return {"kind": "Names this entry.", **{name: found[name] for name in model.model_fields if found.get(name)}}


def _referred(text: str, module: str) -> str:
    """Docstring of the class or function that a model takes the parameters of; empty where it names none."""
    named = re.search(r"(?:see|Parameters of) :(?:class|func):`~?([\w.]+)`", text)
    if named is None:
        return ""
    place, _, name = named.group(1).rpartition(".")
    return inspect.getdoc(getattr(import_module(place or module), name)) or ""


def _sections(docstring: str) -> Iterator[tuple[str, str]]:
    """Names and words of the section "Parameters" of a numpydoc docstring."""
    after = re.split(r"^Parameters\n-+\n", docstring, maxsplit=1, flags=re.MULTILINE)
    if len(after) < 2:
        return
    names: list[str] = []
    words: list[str] = []
    section = re.split(r"^\w[\w ]*\n-+$", after[1], maxsplit=1, flags=re.MULTILINE)[0]
    for line in [*section.split("\n"), ""]:
        if line.startswith((" ", "\t")):
            words.append(line.strip())
            continue
        yield from ((name, " ".join(words)) for name in names)
        head = PARAMETER.match(line)
        names, words = ([name.strip() for name in head.group(1).split(",")], []) if head else ([], [])


def _markdown(text: str) -> str:
    """Turn reStructuredText of docstrings into Markdown."""
    text = re.sub(r":(\w+):`~?([^`]*)`", r"{py:\1}`\2`", " ".join(text.split()))
    text = re.sub(r"\{py:math\}`([^`]*)`", r"$\1$", text)
    return text.replace("``", "`")
