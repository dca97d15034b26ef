"""Values of a configuration, and how two configurations differ, short enough for a message."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import zip_longest
from typing import Any

SHOWN_LENGTH = 60
"""Characters of a value in a message."""
_TAIL = 20
_ABSENT = object()


def shorten(value: Any) -> str:
    """JSON of a value with the middle left out where it is longer than :data:`SHOWN_LENGTH`."""
    text = json.dumps(value, ensure_ascii=False, default=str)
    if len(text) <= SHOWN_LENGTH:
        return text
    return f"{text[: SHOWN_LENGTH - _TAIL - 3]}...{text[-_TAIL:]}"


def differences(old: Any, new: Any, key: str = "") -> Iterator[str]:
    """Dotted keys whose values differ, each as ``key: old -> new``; ``absent`` where one side has no such key."""
    if isinstance(old, dict) and isinstance(new, dict):
        for name in sorted(set(old) | set(new)):
            yield from differences(old.get(name, _ABSENT), new.get(name, _ABSENT), f"{key}.{name}" if key else name)
    elif isinstance(old, list) and isinstance(new, list):
        for number, (before, after) in enumerate(zip_longest(old, new, fillvalue=_ABSENT)):
            yield from differences(before, after, f"{key}.{number}")
    elif old != new:
        yield f"{key}: {_shown(old)} -> {_shown(new)}"


def _shown(value: Any) -> str:
    return "absent" if value is _ABSENT else shorten(value)
