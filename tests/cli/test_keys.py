"""The keys of configuration files, as the command and the documentation print them."""

import json
from functools import cache

import pytest
from typer.testing import CliRunner

from doppelgait.cli.app import app
from doppelgait.cli.topics import TOPICS
from doppelgait.core.errors import ConfigError
from doppelgait.core.plugins import list_plugin_groups


@cache
def run(*words: str, command: str = "keys") -> str:
    result = CliRunner().invoke(app, [command, *words], catch_exceptions=False)
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


def test_every_key_of_every_topic_has_its_own_description() -> None:
    topics = [row["topic"] for row in json.loads(run("--json"))]
    tables = [(topic, table) for topic in topics for table in json.loads(run(topic, "--json"))]
    assert len(tables) > 60
    missing, repeated = [], []
    for topic, table in tables:
        texts = {key["key"]: key["description"].strip() for key in table["keys"]}
        place = f"{topic}: {table['table']}"
        missing += [f"{place}: {key}" for key, text in texts.items() if not text]
        repeated += [f"{place}: {key}" for key, text in texts.items() if list(texts.values()).count(text) > 1]
    assert not missing
    assert not repeated


@pytest.mark.parametrize(
    ("topic", "key", "unit"),
    [
        ("motion.vacuum", "turn_deg_per_s", "°/s"), ("Dielectric", "conductivity_s_per_m", "S/m"),
        ("ChirpConfig", "slope_hz_per_s", "Hz/s"), ("impairment.phase_noise", "density_dbc_per_hz", "dBc/Hz"),
        ("impairment.phase_noise", "walk_rad_per_sqrt_min", "rad/√min"), ("Tracker", "clutter_per_m_mps", "1/(m·m/s)"),
        ("Radar", "volts_per_unit", "V"), ("Radar", "prf_hz", "Hz"), ("ArrayFacts", "noise_power_v2", "V²"),
        ("Radar", "name", ""), ("EpisodeSection", "hours_per_day", "h"),
    ],
)  # fmt: skip
def test_a_key_has_the_unit_of_its_whole_ending(topic: str, key: str, unit: str) -> None:
    (table,) = json.loads(run(topic, "--json"))
    assert {one["key"]: one["unit"] for one in table["keys"]}[key] == unit


def test_no_text_of_the_keys_begins_in_the_middle_of_a_sentence() -> None:
    text = "".join(run(row["topic"]) for row in json.loads(run("--json")))
    for fault in ("...\n", "      ...", "its defaults", "Of the ", "\\|"):
        assert [line for line in text.splitlines(keepends=True) if fault in line] == []
    assert 'motion, kind = "human": Walking or running person of human_gait.\n' in text


def test_a_table_with_defaults_is_optional() -> None:
    assert "  split: table SplitSection, optional\n" in run("DatasetSection")
    assert "  gate: track or 2 × number, default track\n" in run("ImportConfig").replace('"', "")


@pytest.mark.parametrize(
    ("topic", "heading", "key"),
    [
        ("dataset.seed", "dataset", "seed"),
        ("motion.human.speed_mps", "motion.human", "speed_mps"),
        ("tracking.detector.pfa", "tracking.detector", "pfa"),
    ],
)
def test_a_key_of_a_table_is_printed_alone(topic: str, heading: str, key: str) -> None:
    lines = run(topic).splitlines()
    assert lines[0].startswith(f"{heading}: ")
    assert lines[1].startswith(f"  {key}: ")
    assert all(line.startswith("      ") for line in lines[2:])


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        ("radra", r"^keys radra: is not a topic; topics are scene, .*motion\.human, and TABLE\.KEY.* dataset\.seed$"),
        ("radar.prf", r"^keys radar\.prf: is not a topic; topics are scene"),
        ("motion.horse", r"^keys motion\.horse: no motion 'horse' with keys; known are boulic, .*human"),
    ],
)
def test_an_unknown_topic_names_those_that_exist(topic: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        run(topic)


def test_all_plugins_are_listed_with_their_parameters() -> None:
    rows = json.loads(run("--json", command="plugins"))
    assert [row["group"] for row in rows] == sorted(row["group"] for row in rows)
    assert {(row["group"], row["name"]) for row in rows} == {
        (group, name) for group, plugins in list_plugin_groups().items() for name in plugins
    }
    (parquet,) = (row for row in rows if row["name"] == "parquet")
    assert parquet == {
        "group": "exporter", "name": "parquet", "package": "doppelgait", "version": "1",
        "parameters": ["rows_per_group"],
    }  # fmt: skip


def test_groups_can_be_chosen() -> None:
    lines = run("exporter", command="plugins").splitlines()
    assert lines[0].split() == ["group", "name", "package", "version", "parameters"]
    assert {line.split()[0] for line in lines[1:]} == {"exporter"}
    with pytest.raises(ConfigError, match="plugins sonar: no such group; groups are classifier, environment, exporter"):
        run("sonar", command="plugins")
