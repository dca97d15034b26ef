"""Named plug-ins: a dictionary with a decorator, entry points and an error that lists what exists."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib.metadata import entry_points
from typing import Generic, TypeVar

from doppelgait.core.errors import ConfigError

T = TypeVar("T")


class Registry(Generic[T]):
    """Objects of one kind under unique names, from this package and from entry points of the same group.

    Parameters
    ----------
    group : str
        Entry-point group, for example ``doppelgait.motion_readers``.
    noun : str
        What an entry is, for error messages: "motion reader".
    """

    def __init__(self, group: str, noun: str) -> None:
        self.group = group
        self.noun = noun
        self._items: dict[str, T] = {}
        self._discovered = False

    def register(self, name: str) -> Callable[[T], T]:
        """Decorator that stores an object under ``name``; a name taken already is a :class:`ConfigError`."""

        def store(item: T) -> T:
            self.add(name, item)
            return item

        return store

    def add(self, name: str, item: T) -> None:
        """Store ``item`` under ``name``; a name taken already is a :class:`ConfigError`."""
        if name in self._items:
            raise ConfigError(f"the {self.noun} name {name!r} is registered twice")
        self._items[name] = item

    def __getitem__(self, name: str) -> T:
        self._discover()
        if name not in self._items:
            raise ConfigError(f"unknown {self.noun} {name!r}; known are: {', '.join(sorted(self._items))}")
        return self._items[name]

    def __contains__(self, name: str) -> bool:
        self._discover()
        return name in self._items

    def __iter__(self) -> Iterator[str]:
        self._discover()
        return iter(sorted(self._items))

    def _discover(self) -> None:
        if self._discovered:
            return
        self._discovered = True
        for entry in entry_points(group=self.group):
            self.add(entry.name, entry.load())
