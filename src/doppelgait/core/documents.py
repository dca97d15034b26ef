"""JSON and TOML of unknown origin, with short errors.

The parsers of the standard library raise other errors for deep nesting and long integers, and some text that they
accept breaks the code that uses it: a table deeper than that code can recurse, integers that no number type holds,
half characters that cannot be written again.
"""

from __future__ import annotations

import json
import re
import tomllib
from typing import Any

from doppelgait.core.cost import describe_excess_memory, limit_bytes

MAX_DEPTH = 64
"""Lists and tables inside each other; our own files have 10 at most."""
MAX_DIGITS = 40
"""Digits of an integer: seeds have up to 128 bits."""
_LONG_KEY = re.compile(rf"""(?<![\w"'.-])(?:[\w"'-]+\s*\.\s*){{{MAX_DEPTH}}}""")
"""A dotted TOML key, the parsing of which takes time with the cube of its parts."""
_HALF_CHARACTER = re.compile(r"\\u[dD][89a-fA-F]")


def parse_json(text: str | bytes) -> Any:
    """Parse JSON text of unknown origin.

    Parameters
    ----------
    text : str or bytes
        Bytes are UTF-8, with or without a byte-order mark.

    Raises
    ------
    ValueError
        If it is no JSON (``json.JSONDecodeError``) or UTF-8, is nested deeper than 64 levels, has an integer of more
        than 40 digits, text with half a character, or takes too much memory.
    """
    text = text.decode("utf-8-sig") if isinstance(text, bytes) else text
    # what Python makes of values, lists, tables and texts, and the text itself
    n_bytes = len(text) + 32 * text.count(",") + 88 * text.count("[") + 240 * text.count("{") + 28 * text.count('"')
    if n_bytes > limit_bytes(len(text)):
        raise ValueError(describe_excess_memory(n_bytes, len(text), "it"))
    try:
        value = json.loads(text, parse_int=_parse_integer)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    _check_depth(value)
    if _HALF_CHARACTER.search(text):
        try:
            json.dumps(value, ensure_ascii=False).encode()
        except UnicodeEncodeError as error:
            half = str(error.object)[error.start]
            raise ValueError(f"it has half a character, \\u{ord(half):x} without its other half") from None
    return value


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML text of unknown origin.

    Raises
    ------
    ValueError
        If it is no TOML (``tomllib.TOMLDecodeError``), is nested deeper than 64 levels, or has an integer of more than
        40 digits.
    """
    if _LONG_KEY.search(text):
        raise ValueError(_TOO_DEEP)
    try:
        value = tomllib.loads(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:  # of int() for a number of more digits than it takes
        raise ValueError(_TOO_LONG) from None
    _check_depth(value, integers=True)
    return value


_TOO_DEEP = f"it is nested deeper than {MAX_DEPTH} levels"
_TOO_LONG = f"it has an integer of more than {MAX_DIGITS} digits"


def _parse_integer(digits: str) -> int:
    if len(digits.lstrip("-")) > MAX_DIGITS:
        raise ValueError(_TOO_LONG)
    return int(digits)


def _check_depth(value: Any, *, integers: bool = False) -> None:
    """Refuse deep nesting, and long integers if wanted."""
    level = [value]
    for _ in range(MAX_DEPTH + 1):
        inside = [one for one in level if type(one) in (dict, list)]
        if integers and any(type(one) is int and abs(one) >= 10**MAX_DIGITS for one in level):
            raise ValueError(_TOO_LONG)
        if not inside:
            return
        kinds = None if integers else (dict, list)  # of JSON only what can hold more
        level = [
            item
            for one in inside
            for item in (one.values() if type(one) is dict else one)
            if kinds is None or type(item) in kinds
        ]
    raise ValueError(_TOO_DEEP)
