from typing import Any, Literal

import pytest

from doppelgait.core import plugins
from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError
from doppelgait.core.plugins import Group, plugin


class Offset(FrozenModel):
    kind: Literal["offset"] = "offset"
    level_v: float = 1.0


@pytest.fixture
def group(monkeypatch: pytest.MonkeyPatch) -> Group[Any]:
    """A group of its own with one plug-in with parameters and one without."""
    monkeypatch.setitem(plugins._REGISTERED, "demo_effect", {})
    monkeypatch.setattr(plugins, "_GROUPS", dict(plugins._GROUPS))
    made: Group[Any] = Group("demo_effect")

    @plugin("demo_effect", parameters=Offset, version="3")
    def add_offset(value: float, parameters: Offset) -> float:
        return value + parameters.level_v

    plugin("demo_effect", "plain", unit="m")(abs)
    return made


def test_a_plugin_is_found_by_name_with_its_parameters_and_facts(group: Group[Any]) -> None:
    assert list(group) == ["offset", "plain"]
    found = group["offset"]
    assert found.run(1.0, Offset(level_v=2.0)) == 3.0
    assert (found.parameters, found.version, found.package) == (Offset, "3", "tests")
    assert group["plain"].facts == {"unit": "m"}
    assert group.of(Offset()) is found


def test_a_name_is_registered_once_and_always_given(group: Group[Any]) -> None:
    text = r"demo effect 'plain' is registered twice: by .*test_plugins and by mylab\.effects"
    with pytest.raises(ConfigError, match=text):
        exec('plugin("demo_effect", "plain")(abs)', {"__name__": "mylab.effects", "plugin": plugin})
    assert group["plain"].module == __name__
    with pytest.raises(ConfigError, match="needs a name"):
        plugin("demo_effect")(abs)
    with pytest.raises(ConfigError, match=r"plugin\('motion_model'\): needs parameters=, a doppelgait\.FrozenModel"):
        plugin("motion_model", "x")(abs)
    assert "x" not in plugins._REGISTERED.get("motion_model", {})


def test_the_same_module_replaces_its_own_plugin(group: Group[Any]) -> None:
    plugin("demo_effect", "plain", unit="s")(round)
    assert (group["plain"].run, group["plain"].facts) == (round, {"unit": "s"})


def test_an_unknown_group_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"group of plug-ins 'impairmnt'; known are: classifier, .*impairment, "):
        plugin("impairmnt", parameters=Offset)(abs)
    assert "impairmnt" not in plugins._REGISTERED
    assert tuple(plugins.list_plugin_groups()) == plugins.GROUP_NAMES


def test_a_group_refuses_facts_at_registration_or_when_first_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    def check(item: plugins.Plugin[Any]) -> None:
        if "unit" not in item.facts:
            raise ConfigError(f"{item.name}: has no unit")

    monkeypatch.setitem(plugins._REGISTERED, "late_effect", {})
    monkeypatch.setattr(plugins, "_GROUPS", dict(plugins._GROUPS))
    monkeypatch.setattr(plugins, "GROUP_NAMES", (*plugins.GROUP_NAMES, "late_effect"))
    plugin("late_effect", "early")(abs)
    late: Group[Any] = Group("late_effect", check=check)
    with pytest.raises(ConfigError, match="early: has no unit"):
        len(late)
    plugin("late_effect", "early", unit="m")(abs)
    with pytest.raises(ConfigError, match="other: has no unit"):
        plugin("late_effect", "other")(abs)
    assert list(late) == ["early"]


def test_tables_names_and_models_are_parsed(group: Group[Any]) -> None:
    assert group.parse({"kind": "offset", "level_v": 2}) == Offset(level_v=2.0)
    assert group.parse("offset") == Offset()
    assert group.parse(Offset(level_v=4.0)) == Offset(level_v=4.0)
    for wrong in ({"kind": "offse"}, {}, None, 3):
        with pytest.raises(ConfigError, match=r"is not allowed: known are offset, plain"):
            group.parse(wrong)
    with pytest.raises(ConfigError, match="level: unknown key; allowed are kind, level_v"):
        group.parse({"kind": "offset", "level": 2})
    with pytest.raises(ConfigError, match="unknown demo effect 'x'; known are: offset, plain"):
        group["x"]
