"""Frozen parameter models and TOML files; one :class:`ConfigError` names all faults."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from tomllib import TOMLDecodeError
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self, TypeVar, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator

from doppelgait.core.documents import parse_json, parse_toml, read_document
from doppelgait.core.errors import ConfigError, list_choices
from doppelgait.core.keys import TABLES, expand_docstring

M = TypeVar("M", bound=BaseModel)
MIN_SIZE, MAX_SIZE = 1e-30, 1e30
"""Sizes of parameters in SI units, the lower one of those above 0: so products are numbers."""
SHOWN_FAULTS, SHOWN_KEY = 8, 60
"""Maximum number of faults in one error message, and of characters shown of each part of a key."""
_TAG = re.compile(r".*[\[({].*|str|int|float|bool|bytes|none|any|dict|list|tuple|set")
"""Names that Pydantic adds to the location of a fault, for the member of a union or the key of a mapping."""
_NAMED_KEY = re.compile(r"(\w+(?:\.\w+)*): ")  # pattern of a key at the start of a message

_FOREIGN = {name for name in dir(BaseModel) if name[0] != "_"} - {"model_dump", "model_fields"}

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass as _Checked
else:

    class _Checked(type(BaseModel)):
        """Metaclass: models raise :class:`ConfigError`; main fields may be passed by position."""

        def __call__(cls, *values: Any, **data: Any) -> Any:
            if len(values) > len(cls.POSITIONAL):
                named = next((name for name in cls.model_fields if name not in cls.POSITIONAL), "name")
                raise TypeError(
                    f"{cls.__name__} takes {len(cls.POSITIONAL)} positional arguments, not {len(values)}: "
                    f"name the parameters, for example {cls.__name__}({named}=...)"
                )
            for name, value in zip(cls.POSITIONAL, values, strict=False):
                if name in data:
                    raise TypeError(f"{cls.__name__} got {name} twice")
                data[name] = value
            try:
                return super().__call__(**data)
            except ValidationError as error:
                raise _make_error(f"{cls.__name__}: ", _find_faults(error, cls, data)) from None

        def __dir__(cls) -> list[str]:  # without what pydantic adds for itself
            return sorted({*super().__dir__(), *cls.model_fields} - _FOREIGN)


def _is_sensible(value: Any, least: float) -> bool:
    if isinstance(value, list | tuple):
        return all(_is_sensible(inner, least) for inner in value)
    return type(value) is not float or not math.isfinite(value) or least <= abs(value or 1) <= MAX_SIZE


class FrozenModel(BaseModel, metaclass=_Checked):
    """Immutable parameters: unknown keys, NaN, infinity and texts as numbers are refused."""

    __str__ = object.__str__  # as repr: not all fields on one line
    POSITIONAL: ClassVar[tuple[str, ...]] = ()  # fields that Python code may pass by position

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    @classmethod
    def __pydantic_init_subclass__(cls, **settings: Any) -> None:
        cls.__doc__ = expand_docstring(cls)

    def replace(self, **changes: Any) -> Self:
        """Return a copy with some fields changed and checked."""
        return type(self)(**{name: getattr(self, name) for name in self.model_fields_set} | changes)

    @classmethod
    def model_validate(cls, obj: Any, **settings: Any) -> Self:
        """Build the model from a mapping; a :class:`ConfigError` names what is not allowed."""
        try:
            return super().model_validate(obj, **settings)
        except ValidationError as error:
            raise _make_error(f"{cls.__name__}: ", _find_faults(error, cls, obj)) from None

    @classmethod
    def model_validate_json(cls, json_data: str | bytes | bytearray, **settings: Any) -> Self:
        """Build the model from JSON text, as :meth:`model_validate` from a mapping."""
        try:
            return super().model_validate_json(json_data, **settings)
        except ValidationError as error:
            raise _make_error(f"{cls.__name__}: ", _find_faults(error, cls, None)) from None

    def __dir__(self) -> list[str]:
        return dir(type(self))

    def __setattr__(self, name: str, value: Any = None) -> None:
        raise ConfigError(f"{type(self).__name__}.{name}: is frozen; make a changed copy with .replace({name}=...)")

    __delattr__ = __setattr__

    @field_validator("*", mode="before")
    @classmethod
    def _refuse_no_sensible_number(cls, value: Any, info: ValidationInfo) -> Any:
        least = MIN_SIZE if any(hasattr(rule, "gt") for rule in cls.model_fields[str(info.field_name)].metadata) else 0
        if not _is_sensible(value, least):
            raise ValueError(f"must be from {least:g} to {MAX_SIZE:g} in size")
        if isinstance(value, str | bool):
            annotation = cls.model_fields[str(info.field_name)].annotation
            if (set(get_args(annotation)) or {annotation}) <= {int, float, type(None)}:
                raise ValueError("must be a number")
        return value


def check_type(value: Any, kinds: type | tuple[type, ...], name: str, remedy: str) -> None:
    """Raise unless an argument has an allowed type."""
    if not isinstance(value, kinds):
        raise ConfigError(f"{name}: {type(value).__name__} is not allowed; {remedy}")


def check_choice(value: object, allowed: Collection[str], name: str) -> None:
    """Raise unless an argument is an allowed name."""
    if value not in [*allowed]:
        raise ConfigError(f"{name}: {value!r} is not allowed; it must be one of {list_choices(allowed, value)}")


def validate(
    model: type[M], data: Mapping[str, Any], *, where: str = "", text: str = "", section: tuple[str, ...] = ()
) -> M:
    """Build ``model`` from ``data``, or report all faults."""
    try:
        return BaseModel.model_validate.__func__(model, dict(data))  # type: ignore[attr-defined,no-any-return]
    except ValidationError as error:
        raise _make_error(f"{where}: " if where else "", _find_faults(error, model, data), text, section) from None


class Fault(NamedTuple):
    """One fault of a table."""

    location: tuple[str | int, ...]
    value: str  # the refused value; empty if the message does not need it
    message: str


class InnerError(ValueError):
    """Error of an inner table; the error of the outer table names its keys in full."""

    def __init__(self, error: ConfigError) -> None:
        super().__init__(str(error))
        self.faults: tuple[Fault, ...] = error.faults


def _make_error(start: str, faults: list[Fault], text: str = "", section: tuple[str, ...] = ()) -> ConfigError:
    said: dict[str, str] = {}
    for fault in faults:
        location = (*section, *fault.location)
        key = ".".join(str(part) if len(str(part)) <= SHOWN_KEY else f"{str(part)[:SHOWN_KEY]}..." for part in location)
        place, message = f"{key}{format_line_note(text, location)}: " if key else "", fault.message
        if fault.location and fault.value:  # otherwise the message of a check across keys names the keys
            place += f"{fault.value} is not allowed: "
        if place in said and said[place] != message:  # one fault for each member of a union
            message = f"{said[place]} or {message.removeprefix('must be ')}"
        said[place] = message
    shown = [place + message for place, message in said.items()]
    more = [f"and {len(shown) - SHOWN_FAULTS} more"] * (len(shown) > SHOWN_FAULTS)
    error = ConfigError(start + "; ".join(shown[:SHOWN_FAULTS] + more))
    error.faults = tuple(faults)
    return error


def _find_faults(error: ValidationError, model: type[BaseModel], data: Any) -> list[Fault]:
    faults: list[Fault] = []
    stated = error.errors()
    for fault in stated:
        at = fault["loc"]
        # a list can be too short because its entries are faulty
        deeper = (other["loc"] for other in stated if len(other["loc"]) > len(at))
        if fault["type"] == "too_short" and any(other[: len(at)] == at for other in deeper):
            continue
        location = _place_in(data, at)
        inner = fault.get("ctx", {}).get("error")
        if isinstance(inner, InnerError) and inner.faults:
            faults += [each._replace(location=(*location, *each.location)) for each in inner.faults]
        else:
            faults.append(_describe(fault, location, model))
    return faults


def _place_in(data: Any, location: Sequence[str | int]) -> tuple[str | int, ...]:
    place: list[str | int] = []
    current = data
    for part in location:
        try:
            current = getattr(current, str(part)) if isinstance(current, BaseModel) else current[part]
        except (TypeError, KeyError, IndexError, AttributeError):  # a missing key, or a name that Pydantic adds
            if isinstance(part, str) and _TAG.fullmatch(part):
                continue
        place.append(part)
    return tuple(place)


def reword_fault(message: str) -> str:
    """Turn a message of Pydantic into one about configuration files."""
    for pattern, words in TABLES["messages"].items():
        message = re.sub(pattern, words, message)
    return message


def _describe(fault: Any, location: tuple[str | int, ...], model: type[BaseModel]) -> Fault:
    if fault["type"] == "extra_forbidden":
        allowed = sorted(_list_fields_at(model, location[:-1]))
        words = f"; allowed are {list_choices(allowed, location[-1])}" if allowed else ""
        return Fault(location, "", "unknown key" + words)
    if fault["type"] == "missing":
        return Fault(location, "", "is required")
    value, message = fault.get("input"), reword_fault(fault["msg"])
    named = _NAMED_KEY.match(message) if fault["type"] == "value_error" else None
    if named and isinstance(value, Mapping) and named[1].split(".")[0] in value:  # from a check across keys
        inner = (int(part) if part.isdigit() else part for part in named[1].split("."))
        return Fault((*location, *inner), "", message[named.end() :])
    if isinstance(value, dict):
        shown = "" if fault["type"] == "value_error" else "this table"
    else:
        shown = repr(value) if len(repr(value)) < 80 else "this value"
    return Fault(location, shown, message)


def _list_fields_at(model: type[BaseModel], location: Sequence[Any]) -> list[str]:
    current: type[BaseModel] | None = model
    for name in location:
        if current is not None and not isinstance(name, int):
            info = current.model_fields.get(name)
            current = None if info is None else _find_model(info.annotation)
    return [] if current is None else list(current.model_fields)


def _find_model(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    inner = map(_find_model, getattr(annotation, "__args__", ()))
    return next(filter(None, inner), None)


def format_line_note(text: str, location: Sequence[str | int]) -> str:
    """Format the line of a dotted TOML key as `` (line 7)``, or ``""``; numbers select tables."""
    rows = [row.split("#")[0] for row in text.splitlines()]
    names = [str(part) for part in location if isinstance(part, str)]
    if not rows or not names:
        return ""
    start = 0
    for depth in range(1, len(names)):
        header = re.compile(r"^\s*\[{1,2}\s*" + r"\s*\.\s*".join(map(re.escape, names[:depth])) + r"\s*\]{1,2}")
        found = [number for number, row in enumerate(rows) if header.match(row)]
        place = list(location).index(names[depth - 1])
        following = location[place + 1] if place + 1 < len(location) else 0
        nth = following if isinstance(following, int) else 0
        start = found[min(nth, len(found) - 1)] if found else start
    key = re.escape(names[-1])
    wanted = re.compile(rf"(^|[{{,])\s*\"?{key}\"?\s*=|^\s*+\[++(?=[^\]]*+\])[^\]]*\b{key}\b")
    order = [*range(start, len(rows)), *range(start)]
    return next((f" (line {number + 1})" for number in order if wanted.search(rows[number])), "")


def read_toml(path: str | Path) -> tuple[dict[str, Any], str]:
    """Read a TOML file; return its table and its text."""
    try:
        text = read_document(path, error=ConfigError).decode()
        return parse_toml(text), text
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: is not TOML: it is a binary file or not UTF-8 text") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise ConfigError(f"{path}: is not TOML: {error}") from None


def apply_overrides(table: Mapping[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """Apply ``KEY=VALUE`` changes with dotted keys to a table (``targets.0.label=dog``)."""
    result: dict[str, Any] = parse_json(json.dumps(table, default=str))
    for override in overrides:
        key, separator, text = override.partition("=")
        if not separator or not key:
            raise ConfigError(f"--set {override}: must be KEY=VALUE, for example radar.prf_hz=900")
        try:
            value = parse_toml(f"value = {text.strip()}")["value"]
        except TOMLDecodeError:
            value = text.strip()
        except ValueError as error:
            raise ConfigError(f"--set {override[:60]}: {error}") from None
        _set_key(result, key.strip(), value, override)
    return result


def _set_key(table: dict[str, Any], key: str, value: Any, override: str) -> None:
    parts = key.split(".")
    node: Any = table
    for part in parts[:-1]:
        if isinstance(node, list):
            if not part.isdigit() or int(part) >= len(node):
                raise ConfigError(f"--set {override}: {part!r} is not an entry of that list (0 to {len(node) - 1})")
            node = node[int(part)]
        elif isinstance(node, dict):
            if isinstance(node.get(part), str):  # the short form of a table: waveform = "lfm"
                node[part] = {"kind": node[part]}
            node = node.setdefault(part, {})
        else:
            raise ConfigError(f"--set {override}: {part!r} is inside a value, not a section")
    if isinstance(node, list) and parts[-1].isdigit() and int(parts[-1]) < len(node):
        node[int(parts[-1])] = value
    elif isinstance(node, dict):
        node[parts[-1]] = value
    else:
        raise ConfigError(f"--set {override}: {key!r} is not a key of the configuration")


def convert_to_json(value: Any) -> Any:
    """Convert a value to plain JSON types; non-finite numbers become None, other objects text."""
    if value is None or type(value) in (str, int, bool):
        return value
    if type(value) is float:
        return value if -math.inf < value < math.inf else None
    if isinstance(value, np.ndarray | np.generic):
        plain = value.tolist()
        return str(plain) if isinstance(plain, np.generic) else convert_to_json(plain)
    if isinstance(value, list | tuple):
        return [convert_to_json(inner) for inner in value]
    if isinstance(value, Mapping):
        return {str(key): inner if type(inner) is str else convert_to_json(inner) for key, inner in value.items()}
    return value if isinstance(value, str | int) else str(value)


def as_table(model: BaseModel) -> dict[str, Any]:
    """Return a model's explicitly set fields and every ``kind``, as types that TOML supports."""
    names = [name for name in type(model).model_fields if name in model.model_fields_set or name == "kind"]
    return {name: _convert_to_plain(value) for name in names if (value := getattr(model, name)) is not None}


def _convert_to_plain(value: Any) -> Any:
    if isinstance(value, BaseModel):
        return as_table(value)
    if isinstance(value, Mapping):
        return {str(key): _convert_to_plain(inner) for key, inner in value.items() if inner is not None}
    return [_convert_to_plain(inner) for inner in value] if isinstance(value, list | tuple) else convert_to_json(value)


def write_toml(table: Mapping[str, Any]) -> str:
    """Format a table of plain values as TOML text."""
    import tomli_w

    return tomli_w.dumps(table)


def format_canonical_json(value: BaseModel | Mapping[str, Any] | Sequence[Any]) -> str:
    """Format parameters as one-line JSON with sorted keys."""
    data = value.model_dump(mode="json") if isinstance(value, BaseModel) else value
    return json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
