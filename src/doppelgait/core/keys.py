"""Keys of parameter models, as the documentation and ``doppelgait keys`` show them."""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from doppelgait.core.documents import parse_toml

TABLES = parse_toml(Path(__file__).with_name("keys.toml").read_text(encoding="utf-8"))
"""Units by suffix, texts of limits, the rewording of Pydantic's messages, and files of no domain."""

KINDS = {float: "number", int: "integer", str: "text", bool: "true, false", dict: "table", Any: "any"}
PARAMETER = re.compile(r"^([A-Za-z_][\w, ]*?)(?: : .*)?$((?:\n[ \t].*)*)", re.MULTILINE)


class Key(NamedTuple):
    """Text about one key of a model."""

    key: str
    type: str
    unit: str
    default: str
    limits: str
    description: str


def list_keys(model: type[BaseModel]) -> list[Key]:
    """List the keys of a model in their order; descriptions are reStructuredText."""
    texts = parameter_words(model)
    return [
        Key(name, _kind(field.annotation), unit_of(name), _default(field), _limits(field), texts.get(name, ""))
        for name, field in model.model_fields.items()
    ]


def unit_of(key: str) -> str:
    """Return the unit of a key, or ``""``."""
    parts, units = key.split("_"), TABLES["units"]
    return next((units[end] for n in range(len(parts)) if (end := "_".join(parts[n:])) in units), "")


def _kind(kind: Any) -> str:
    origin, members = get_origin(kind), [member for member in get_args(kind) if member is not type(None)]
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(_kind(member) for member in members))
    if origin is Literal:
        return ", ".join(f"`{member}`" for member in members)
    if origin in (tuple, list):
        if origin is list or members[-1:] == [Ellipsis]:
            return f"list of {_kind(members[0])}"
        return f"{len(members)} × {_kind(members[0])}"
    if hasattr(kind, "__metadata__"):
        return _kind(get_args(kind)[0])
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return "table" if kind.__name__ == "FrozenModel" else f"table {kind.__name__}"
    return KINDS.get(origin or kind, getattr(kind, "__name__", str(kind)))


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if value is None or value is PydanticUndefined or value in ((), [], {}):
        return ""
    return "its defaults" if isinstance(value, BaseModel) else _value(value)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, str):
        return f'`"{value}"`' if value else ""
    if isinstance(value, float):
        return f"`{value:g}`"
    if isinstance(value, tuple | list):
        return ", ".join(_value(getattr(entry, "name", entry)) for entry in value)
    if isinstance(value, Mapping):
        texts = {key: f'"{entry}"' if isinstance(entry, str) else f"{entry}" for key, entry in value.items()}
        return ", ".join(f"`{key} = {text}`" for key, text in texts.items())
    return f"`{value}`"


def _limits(field: FieldInfo) -> str:
    rules = ((text, getattr(rule, name, None)) for rule in field.metadata for name, text in TABLES["limits"].items())
    limits = ((text, f"{value:g}" if isinstance(value, float) else value) for text, value in rules)
    return ", ".join(text.format(value) for text, value in limits if value is not None)


def parameter_words(model: type[BaseModel]) -> dict[str, str]:
    """Return the description of every key, from the docstrings of a model and of its bases."""
    found: dict[str, str] = {}
    for owner in model.__mro__:
        for name, words in _sections(inspect.cleandoc(owner.__doc__ or "")):
            found[name] = found.get(name) or words
    return {
        "kind": "Kind of the table; it determines which other keys are allowed.",
        **{name: found[name] for name in model.model_fields if found.get(name)},
    }


def expand_docstring(model: type[BaseModel]) -> str | None:
    """Write entries ``name: text`` of a model's docstring as numpydoc."""
    summary, *entries = re.split(r"^(\w+): ", inspect.cleandoc(model.__doc__ or ""), flags=re.MULTILINE)
    texts = dict(zip(entries[::2], entries[1::2], strict=True))
    if not texts or not texts.keys() <= model.model_fields.keys():
        return model.__doc__
    text = f"{summary}Parameters\n----------\n"
    for key in list_keys(model):  # types, limits and defaults come from the fields
        default = f"default {key.default}" if "`" in key.default else key.default
        facts = ", ".join(filter(None, (key.type, key.unit, key.limits, default)))
        text += f"{key.key} : {facts.replace('`', '')}\n    {texts[key.key].strip()}\n" if key.key in texts else ""
    return text


def _sections(docstring: str) -> Iterator[tuple[str, str]]:
    """Yield names and descriptions of a numpydoc section "Parameters"."""
    after = re.split(r"^Parameters\n-+\n", docstring, maxsplit=1, flags=re.MULTILINE)
    section = re.split(r"^\w[\w ]*\n-+$", after[-1], maxsplit=1, flags=re.MULTILINE)[0] if len(after) > 1 else ""
    for names, text in PARAMETER.findall(section):
        yield from ((name.strip(), " ".join(map(str.strip, text.strip().splitlines()))) for name in names.split(","))
