"""JSON and TOML of unknown origin: one ValueError in one line for whatever the standard library trips over."""

import json
import random
import re
import tomllib
from contextlib import suppress
from pathlib import Path

import pytest

from checkout import ROOT
from doppelgait.core.config import apply_overrides, read_toml
from doppelgait.core.documents import MAX_DEPTH, MAX_DIGITS, parse_json, parse_toml
from doppelgait.core.errors import ConfigError

DEEP = {
    "open lists": (parse_json, "[" * 50_000),
    "lists": (parse_json, "[" * 900 + "]" * 900),
    "objects": (parse_json, '{"a":' * 100 + "1" + "}" * 100),
    "open TOML lists": (parse_toml, "a = " + "[" * 5000),
    "TOML lists": (parse_toml, "a = " + "[" * 100 + "]" * 100),
    "tables": (parse_toml, "a = " + "{a = " * 100 + "1" + "}" * 100),
    "dotted key": (parse_toml, ".".join(["a"] * 100_000) + " = 1"),
    "dotted header": (parse_toml, "[" + ' . "b" . '.join(["a"] * 100_000) + "]"),
}


@pytest.mark.parametrize("name", DEEP)
def test_deep_text_is_a_value_error(name: str) -> None:
    parse, text = DEEP[name]
    with pytest.raises(ValueError, match="deeper than 64 levels"):
        parse(text)


@pytest.mark.parametrize("digits", ["1" * 41, "-" + "1" * 41, "9" * 5000])
def test_integers_that_no_number_holds_are_refused(digits: str) -> None:
    with pytest.raises(ValueError, match="more than 40 digits"):
        parse_json(f'{{"seed": {digits}}}')
    with pytest.raises(ValueError, match="more than 40 digits"):
        parse_toml(f"seed = {digits}")
    with pytest.raises(ValueError, match="more than 40 digits"):
        parse_toml("seeds = [1, {b = 0x" + "f" * 40 + "}]")


def test_what_is_allowed_stays_as_it_was() -> None:
    nested = "[" * MAX_DEPTH + "1" + "]" * MAX_DEPTH
    assert parse_json(nested) == json.loads(nested)
    assert parse_toml("a = " + nested[1:-1]) == tomllib.loads("a = " + nested[1:-1])
    assert parse_json("9" * MAX_DIGITS) == int("9" * MAX_DIGITS)
    assert parse_json('"\\ud83d\\ude00 \\u00e9"') == "\U0001f600 \u00e9"
    assert parse_json(b'\xef\xbb\xbf{"a": 1}') == {"a": 1}
    text = "a.b.c = [0.1, 0.2, " + ", ".join(["0.25"] * 200) + "]\nb = '...'  # " + "." * 200 + "\n"
    assert parse_toml(text) == tomllib.loads(text)


def test_half_a_character_is_refused() -> None:
    with pytest.raises(ValueError, match=r"lone surrogate \(half a character\), \\ud800"):
        parse_json('{"notes": ["a", "\\ud800"]}')


def test_random_text_raises_nothing_else() -> None:
    rng = random.Random(3)
    fragments = [*'{}[]:,=.a1"\n', '"a"', "9" * 50, "1e999", "null", "\\ud800", "'''"]
    for _ in range(3000):
        text = "".join(rng.choices(fragments, k=rng.randrange(1, 30)))
        for parse in (parse_json, parse_toml):
            with suppress(ValueError):
                parse(text)


def test_a_users_file_gives_one_error_that_names_it(tmp_path: Path) -> None:
    file = tmp_path / "plan.toml"
    for text in ("a = " + "[" * 5000, "a = " + "1" * 5000, "a = 0x" + "f" * 5000):
        file.write_text(text)
        with pytest.raises(ConfigError, match=r"plan\.toml: is not TOML: it (is nested|has an integer)"):
            read_toml(file)
        with pytest.raises(ConfigError, match=r"--set a=.*: it (is nested|has an integer)"):
            apply_overrides({}, [text.replace(" ", "")])


def test_only_the_module_of_documents_parses_json_and_toml() -> None:
    """Text that the package wrote into itself is free: shipped models, object code."""
    free = {"core/documents.py", "classify/model_file.py", "classify/scorer.py"}
    package = ROOT / "src" / "doppelgait"
    found = {
        str(path.relative_to(package))
        for path in package.rglob("*.py")
        if path.parent.name not in ("dataset", "verify", "classify")
        and re.search(r"\b(json|tomllib)\.loads?\(", path.read_text(encoding="utf-8"))
    }
    assert found - free == set(), "use parse_json and parse_toml of core/documents.py"
