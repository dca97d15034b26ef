"""Plug-ins: functions or objects with frozen parameters and a decorator.

A package adds plug-ins in a module that uses the decorator and that is an entry point of the group
``doppelgait.plugins``. Every group of plug-ins is a :class:`Group` in the subpackage that uses it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import import_module
from importlib.metadata import entry_points, packages_distributions, version
from pathlib import Path
from threading import RLock
from typing import Annotated, Any, Generic, TypeVar

from pydantic import BeforeValidator, SerializeAsAny

from doppelgait.core.config import FrozenModel, InnerError, validate
from doppelgait.core.documents import stat_regular
from doppelgait.core.errors import ConfigError, list_choices, warn_caller

T = TypeVar("T")

ENTRY_POINTS = "doppelgait.plugins"
"""Entry-point group of other packages. Each entry names a module that registers plug-ins when it is imported."""

GROUP_NAMES = (
    "classifier",
    "environment",
    "exporter",
    "feature",
    "impairment",
    "motion_model",
    "motion_reader",
    "path",
    "radar_reader",
    "radar_writer",
    "rcs",
    "waveform",
)
"""Names of doppelgait's groups, available before the subpackages that declare them are imported."""
DRAWING = "drawing"  # group of the pictures of objects; no configuration names it
NAMING_KEYS = ("kind", "gate", "format")
"""Keys of a configuration with one or several names of plug-ins, in addition to the names of the groups."""
CHOICES = ("choice", "cycle")
HEAD_BYTES = 4096  # number of bytes by which a reader recognises its files


@dataclass(frozen=True)
class Plugin(Generic[T]):
    """Plug-in of one group: what the group calls, a model of its parameters and further facts."""

    group: str
    name: str
    run: T
    parameters: type[FrozenModel] | None = None
    version: str = "1"
    package: str = "doppelgait"
    facts: Mapping[str, Any] = field(default_factory=dict)
    module: str = ""

    @property
    def identity(self) -> dict[str, str]:
        """Name, version and package release of a plug-in, for the identity of a dataset."""
        releases = packages_distributions().get(self.package, [])
        release = version(releases[0]) if releases else ""
        return {name: getattr(self, name) for name in ("group", "name", "version", "package")} | {"release": release}


_REGISTERED: dict[str, dict[str, Plugin[Any]]] = {}
_GROUPS: dict[str, Group[Any]] = {}
_LOADED: set[str] = set()
_LOADING = RLock()


def plugin(
    group: str,
    name: str | None = None,
    *,
    parameters: type[FrozenModel] | None = None,
    version: str = "1",
    **facts: Any,
) -> Callable[[T], T]:
    """Register a function, class or object as plug-in.

    If the same module registers a name again, for example in a notebook cell that runs twice, the
    later plug-in replaces the earlier one.

    Parameters
    ----------
    group : str
        ``impairment``, ``waveform``, ``feature``, ...: a key of :func:`list_plugin_groups`.
    name : str, optional
        Name of the plug-in. The default is the default value of the field ``kind`` of ``parameters``.
    parameters : type of FrozenModel, optional
        Frozen model of the plug-in's parameters. A decorated class that is such a model is its own ``parameters``.
    version : str
        Version of the results: change it when the same parameters give other numbers. It is part of
        the identity of a dataset.
    **facts
        Further information that the group requires; see the group.

    Raises
    ------
    ConfigError
        If the group is unknown, the name is missing or taken by another module, or the group refuses a fact.

    Examples
    --------
    >>> import doppelgait as dg
    >>> @dg.plugin("feature", "peak_power_v2", unit="V^2", source="own definition")
    ... def measure_peak_power_v2(observation):
    ...     return float(observation.strongest_v2.max())
    >>> dg.features.FEATURES["peak_power_v2"].facts["unit"]
    'V^2'
    """
    module = str(sys._getframe(1).f_globals.get("__name__", ""))
    if group not in (*GROUP_NAMES, *_GROUPS, DRAWING):
        known_groups = ", ".join(sorted({*GROUP_NAMES, *_GROUPS}))
        raise ConfigError(f"unknown group of plug-ins {group!r}; known are: {known_groups}")

    def register(item: T) -> T:
        model = parameters
        if model is None and isinstance(item, type) and issubclass(item, FrozenModel):
            model = item
        if not (issubclass(model, FrozenModel) if model else group != "motion_model"):
            raise ConfigError(f"plugin({group!r}): needs parameters=, a doppelgait.FrozenModel")
        key = name
        if key is None and model is not None and "kind" in model.model_fields:
            key = model.model_fields["kind"].default
        if not isinstance(key, str) or not key:
            raise ConfigError(f"plugin({group!r}): needs a name, or parameters with a field `kind` that has a default")
        known = _REGISTERED.setdefault(group, {})
        if key in known and known[key].module != module:
            raise ConfigError(
                f"the {group.replace('_', ' ')} {key!r} is registered twice: by {known[key].module} and by {module}"
            )
        made = Plugin(group, key, item, model, version, module.partition(".")[0], facts, module)
        if group in _GROUPS:  # otherwise it is checked on the group's first use
            _GROUPS[group].check(made)
        known[key] = made
        return item

    return register


class Group(Generic[T]):
    """Plug-ins of one kind by name; ``check`` raises :class:`ConfigError` for unusable facts."""

    def __init__(
        self,
        name: str,
        built_in: Sequence[str] = (),
        *,
        noun: str | None = None,
        check: Callable[[Plugin[Any]], None] = lambda plugin: None,
        listed: bool = True,
    ) -> None:
        self.name = name
        self.check = check
        self.noun = noun or name.replace("_", " ")
        self._built_in = tuple(built_in)
        self._complete = False
        if listed:
            _GROUPS[name] = self

    def _load_plugins(self) -> dict[str, Plugin[T]]:
        known = _REGISTERED.setdefault(self.name, {})
        if not self._complete:
            # Several threads may do this at once: importing twice is harmless, and Python's import
            # lock makes each thread wait until a module is complete. A module that reads its group
            # during its import gets the plug-ins that are registered by then.
            for module in self._built_in:
                import_module(module)
            _load_packages()
            for item in list(known.values()):
                self.check(item)
            self._complete = True
        return known

    def __getitem__(self, name: str) -> Plugin[T]:
        found = self._load_plugins()
        if name not in self:
            raise ConfigError(f"unknown {self.noun} {name!r}; known are: {list_choices(sorted(found), name)}")
        return found[name]

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and name in self._load_plugins()

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(self._load_plugins()))

    def __len__(self) -> int:
        return len(self._load_plugins())

    def values(self) -> list[Plugin[T]]:
        """Return all plug-ins in the order of their names."""
        return [self[name] for name in self]

    def of(self, parameters: FrozenModel) -> Plugin[T]:
        """Return the plug-in of a parameter model, by its field ``kind``."""
        found = self[str(getattr(parameters, "kind", None))]
        if found.parameters is None or not isinstance(parameters, found.parameters):
            raise ConfigError(f"{self.noun} {found.name!r} takes {found.parameters}, not {type(parameters).__name__}")
        return found

    def parse(self, value: Any) -> FrozenModel:
        """Parse a table with ``kind``, or check a model; raise :class:`ConfigError` otherwise."""
        if isinstance(value, FrozenModel):
            self.of(value)
            return value
        table = {"kind": value} if isinstance(value, str) else value
        kind = table.get("kind") if isinstance(table, Mapping) else None
        if not isinstance(kind, str) or kind not in self:
            raise ConfigError(f"{self.noun} kind {kind!r} is not allowed: known are {list_choices(self, kind)}")
        model = self[kind].parameters
        if model is None:
            raise ConfigError(f"{self.noun} {kind!r} has no parameters")
        return validate(model, table, where=f"{self.noun} kind {kind!r}")

    def field(self) -> Any:
        """Build the field type for this group's tables or models."""

        def parse(value: Any) -> Any:
            try:
                return self.parse(value)
            except ConfigError as error:
                raise InnerError(error) from None

        return Annotated[SerializeAsAny[FrozenModel], BeforeValidator(parse)]


def list_plugin_groups() -> dict[str, Group[Any]]:
    """Return all groups of plug-ins by name."""
    from doppelgait import PLUGIN_ROOMS

    for module in PLUGIN_ROOMS:
        import_module(module)
    return dict(sorted(_GROUPS.items()))


def list_foreign_plugins() -> list[Plugin[Any]]:
    """List the plug-ins that are not part of doppelgait."""
    _load_packages()
    found = [item for known in _REGISTERED.values() for item in known.values()]
    return sorted((item for item in found if item.package != "doppelgait"), key=lambda p: (p.group, p.name))


def identify_plugins(tables: Any, files: Mapping[str, Sequence[Path]] | None = None) -> list[dict[str, Any]]:
    """Identify the plug-ins of other packages that a configuration names, readers that take a file, and features."""
    foreign = list_foreign_plugins()
    names: dict[str, set[str]] = {}

    def collect(value: Any, key: str) -> None:
        if isinstance(value, Mapping):
            for name, inner in value.items():
                collect(inner, name if name in naming else key if name in CHOICES else "")
        elif isinstance(value, list | tuple):
            for inner in value:
                collect(inner, key)
        elif isinstance(value, str) and key:
            names.setdefault(key, set()).add(value)

    naming = {*NAMING_KEYS, *_REGISTERED}
    if foreign:
        collect(tables, "")
    found = []
    for item in foreign:
        named = set().union(*(names.get(key, set()) for key in (*NAMING_KEYS, item.group)))
        used = item.group == "feature" or item.name in named
        for path in (files or {}).get(item.group, ()):
            with suppress(OSError):
                used = used or bool(item.facts["sniff"](path, read_head(path)))
        if used:
            fields = {} if item.parameters is None else item.parameters.model_fields
            defaults = {name: repr(field.default) for name, field in fields.items()}
            found.append({**item.identity, "parameters": defaults})
    return found


def read_head(path: Path) -> bytes:
    """Read the first bytes of a file; none of a folder and of a name without a file."""
    if path.is_dir() or not path.exists() or not stat_regular(path).st_size:
        return b""
    with path.open("rb") as handle:
        return handle.read(HEAD_BYTES)


def _load_packages() -> None:
    """Import the plug-in modules of installed packages, once; a failed import causes a warning."""
    with _LOADING:
        new = [entry for entry in entry_points(group=ENTRY_POINTS) if entry.value not in _LOADED]
        if not new:
            return
        _LOADED.update(entry.value for entry in new)
        for group in list_plugin_groups().values():  # first, so that no other package can use doppelgait's names
            for module in group._built_in:
                import_module(module)
        for entry in new:
            before = {name: dict(known) for name, known in _REGISTERED.items()}
            try:
                entry.load()
            except Exception as error:
                for name, known in _REGISTERED.items():
                    for added in known.keys() - before.get(name, {}).keys():
                        del known[added]
                warn_caller(f"plug-ins of {entry.name!r} ({entry.value}) cannot be loaded and are left out: {error}")
