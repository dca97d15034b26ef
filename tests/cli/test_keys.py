"""The keys of configuration files, as the command and the documentation print them."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from doppelgait.cli.app import app
from doppelgait.cli.topics import TOPICS, models_of
from doppelgait.core.errors import ConfigError
from doppelgait.core.keys import list_keys
from doppelgait.core.plugins import list_plugin_groups
from doppelgait.radar import Radar


def run(*words: str) -> str:
    result = CliRunner().invoke(app, ["keys", *words], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


def test_topics_are_listed_with_every_group_that_has_parameters() -> None:
    rows = {row["topic"]: row for row in json.loads(run("--json"))}
    assert list(rows)[: len(TOPICS)] == list(TOPICS)
    for name, members in list_plugin_groups().items():
        if any(member.parameters for member in members.values()):
            assert {"motion_model": "motion"}.get(name, name) in rows
    assert "impairment" in run()


def test_a_key_has_type_unit_limits_default_and_description() -> None:
    text = run("radar")
    for line in (
        "  prf_hz: number, Hz, ≥ 0.001, ≤ 1e+06, required",
        "  range_window: none, hann, hamming, blackman, default ",
    ):
        assert line in text
    assert "Frame rate f_p: slow-time samples per second." in text
    assert "`" not in text


@pytest.mark.parametrize(
    "topic", [*TOPICS, "motion.human", "impairment.phase_noise", "path.arc", "waveform", "Antenna"]
)
def test_every_topic_prints_every_key(topic: str) -> None:
    text = run(topic)
    tables = json.loads(run(topic, "--json"))
    assert tables
    for table in tables:
        assert table["table"] in text
        for key in table["keys"]:
            assert f"  {key['key']}: " in text


def test_the_rows_are_the_fields_of_the_model() -> None:
    keys = {key.key: key for key in list_keys(Radar)}
    assert list(keys) == list(Radar.model_fields)
    assert (keys["tx_power_dbm"].unit, keys["carrier_hz"].default) == ("dBm", "required")
    assert all(model.model_fields for topic in TOPICS for _, model in models_of(topic))


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        ("radra", r"^keys radra: is not a topic; known are scene, motion, .*impairment.*motion\.human$"),
        ("motion.horse", r"^keys motion\.horse: no motion 'horse' with keys; known are boulic, .*human"),
    ],
)
def test_an_unknown_topic_names_those_that_exist(topic: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        run(topic)
