"""The run of the reproduction: which entries, what is written, what the page says, and what is refused."""

import json
import math
import re
from pathlib import Path

import pandas as pd
import pytest
import typer
from typer.testing import CliRunner

from doppelgait import ConfigError, DoppelgaitError, DoppelgaitWarning
from doppelgait_liland2018 import run as module
from doppelgait_liland2018.command import reproduce as command
from doppelgait_liland2018.entry import (
    KINDS,
    Entry,
    EntryResult,
    Reading,
    collect_entries,
    format_judgement,
    pick,
    place_of,
    summarise_readings,
)
from doppelgait_liland2018.folder import OutputError
from doppelgait_liland2018.material import Material
from doppelgait_liland2018.run import reproduce
from doppelgait_liland2018.style import make_axes

REPORT = [
    *("2.6", "2.12", "2.13", "2.14", "2.15", "2.16", "2.18", "2.19", "2.20"),
    *("3.4", "3.5", "3.8", "3.9", "3.10", "3.11", "3.12", "3.13", "3.14", "3.15"),
]
"""Figures of chapters 2 and 3 that a system can make; the others are drawings of other authors or block diagrams."""


def _draw(material):
    figure, axes = make_axes()
    axes.plot([0, 1], [0, 1])
    readings = [
        Reading("peak", 1.0, "Hz", 1.05, 0.1, "<b>close</b>"),
        Reading("width", 3.0, "m", 1.0, 0.5),
        Reading("lost", math.nan, "s", 1.0, 0.5),
        Reading("free", 2.0, "1"),
        Reading("chosen", 4.0, "1", 4.0, fixed=True),
    ]
    table = pd.DataFrame({"n": range(40), "x": [0.5] * 40})
    return EntryResult(figure, readings, "Differs & is <said>.", table)


def _fail(material):
    raise DoppelgaitError("no such gait here")


def _warn(material):
    import warnings

    warnings.warn("the target leaves the frame", DoppelgaitWarning, stacklevel=1)
    material.use(material.make_walker())
    return EntryResult(None, [], "Nothing to see.")


FEW = (
    Entry("fig-9.1", "A drawing <of> things", "It says & shows.", _draw),
    Entry("fig-9.2", "Cannot be made", "It says so.", _fail),
    Entry("table-9.1", "A table", "Rows.", _warn),
)


@pytest.fixture
def few(monkeypatch):
    monkeypatch.setattr(module, "collect_entries", lambda: FEW)


def test_a_number_agrees_within_its_tolerance():
    assert Reading("a", 1.0, "Hz", 1.1, 0.1 + 1e-12).agrees is True
    assert Reading("a", 1.0, "Hz", 1.11, 0.1).agrees is False
    assert Reading("a", 1.0, "Hz", 1.0).agrees is True
    assert Reading("a", 1.0 + 1e-9, "Hz", 1.0).agrees is False
    assert Reading("a", math.nan, "Hz", 1.0, 0.1).agrees is False
    assert Reading("a", 1.0, "Hz").agrees is None


def test_what_was_set_as_stated_is_no_agreement():
    chosen, missed = (Reading("n", ours, "1", 17.0, fixed=True) for ours in (17.0, 16.0))
    free, good, bad = Reading("f", 1.0, "1"), Reading("g", 1.0, "1", 1.0), Reading("b", 1.0, "1", 2.0)
    assert [one.kind for one in (good, chosen, bad, free)] == list(KINDS)
    assert chosen.agrees is None
    assert (missed.kind, missed.agrees) == ("differs", False)  # set, and yet not as stated: a fault
    assert [summarise_readings(some) for some in ([good, chosen, free], [chosen, free], [free], [])] == [
        "Agrees", "Set as stated", "Not compared", "Not compared",
    ]  # fmt: skip
    verdicts = [summarise_readings(some) for some in ([good, bad], [chosen, bad], [bad])]
    assert verdicts == ["Differs in part", "Differs", "Differs"]
    assert format_judgement([good, bad], "it is so.") == "Differs in: b. it is so."


def test_every_figure_of_chapters_2_and_3_is_there_once_and_in_order():
    numbers = [entry.number for entry in collect_entries()]
    assert len(set(numbers)) == len(numbers)
    assert numbers == sorted(numbers, key=place_of)
    assert [n for n in numbers if re.match(r"fig-[23]\.", n)] == [f"fig-{n}" for n in REPORT]
    assert {"table-3.2", "table-3.3"} <= set(numbers)
    assert all(entry.title and entry.stated for entry in collect_entries())


def test_an_unknown_number_names_the_nearest():
    assert [entry.number for entry in pick(FEW, ["table-9.1", "fig-9.1"])] == ["fig-9.1", "table-9.1"]
    with pytest.raises(ConfigError, match=r"--only fig-9\.3: is not among the 3 .*nearest are fig-9\.[12]"):
        pick(FEW, ["fig-9.3"])


def test_a_run_writes_page_numbers_figures_and_tables(few, tmp_path):
    done = []
    outcomes = reproduce(tmp_path / "out", progress=lambda n, total: done.append((n, total)))
    assert done == [(1, 3), (2, 3), (3, 3)]
    assert [one.entry.number for one in outcomes] == ["fig-9.1", "fig-9.2", "table-9.1"]
    written = sorted(p.relative_to(tmp_path / "out").as_posix() for p in (tmp_path / "out").rglob("*") if p.is_file())
    assert written == ["figures/fig-9.1.png", "index.html", "readings.json", "tables/fig-9.1.csv"]
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert len(pd.read_csv(tmp_path / "out/tables/fig-9.1.csv")) == 40
    document = json.loads((tmp_path / "out/readings.json").read_text())
    first, second, third = document["entries"]
    assert [reading["agrees"] for reading in first["readings"]] == [True, False, False, None, None]
    assert [reading["kind"] for reading in first["readings"]][-2:] == ["not stated", "set"]
    assert [reading["given"] for reading in first["readings"]] == [False] * 4 + [True]
    assert first["readings"][2]["ours"] is None
    assert first["figure"] == "figures/fig-9.1.png"
    assert second["error"] == "no such gait here"
    assert not second["made"]
    assert third["remarks"] == ["the target leaves the frame"]
    assert third["made_from"][0].startswith("model: walker of Boulic and Chen")


def test_the_page_shows_each_number_beside_what_is_stated_and_asks_nothing_of_the_network(few, tmp_path):
    reproduce(tmp_path / "out")
    text = (tmp_path / "out/index.html").read_text()
    assert re.findall(r'src="([^"]*)"', text) == ["figures/fig-9.1.png"]
    links = ["readings.json", "#fig-9.1", "#fig-9.2", "#table-9.1", "tables/fig-9.1.csv"]
    assert re.findall(r'href="([^"]*)"', text) == links
    assert "//" not in re.sub(r"<!doctype html>", "", text)
    assert "Figure 9.1: A drawing &lt;of&gt; things" in text
    assert "&lt;b&gt;close&lt;/b&gt;" in text
    assert "Differs &amp; is &lt;said&gt;." in text
    row = next(line for line in text.splitlines() if "<td>peak</td>" in line)
    cells = ["peak", "1 Hz", "1.05 Hz", "0.1 Hz", "agrees", "&lt;b&gt;close&lt;/b&gt;"]
    assert re.findall(r">([^<>]*)</td>", row) == cells
    counts = ("1 agree<", "2 differ<", "1 were set<", "for 1 it states none", "1 of them could not be made")
    for words in (*counts, "no such gait here", "the target leaves the frame", "The first 30 of 40 rows"):
        assert words in text


def test_an_earlier_run_is_replaced_and_nothing_else(few, tmp_path):
    out = tmp_path / "out"
    assert [one.entry.number for one in reproduce(out, only=["table-9.1"])] == ["table-9.1"]
    assert not list((out / "figures").iterdir())
    reproduce(out, only=["table-9.1", "fig-9.1"])
    assert (out / "figures/fig-9.1.png").exists()
    reproduce(out)
    (out / "notes.txt").write_text("mine")
    with pytest.raises(ConfigError, match=r"out: holds notes\.txt, which no run of reproduce wrote"):
        reproduce(out)
    assert (out / "notes.txt").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_vector_files_are_next_to_the_figures_of_the_page(few, tmp_path):
    out = tmp_path / "out"
    app = typer.Typer()
    app.command()(command)
    words = [str(out), "--only", "fig-9.1", "--quiet"]
    assert CliRunner().invoke(app, [*words, "--format", "svg"]).exit_code == 0
    assert sorted(path.name for path in (out / "figures").iterdir()) == ["fig-9.1.png", "fig-9.1.svg"]
    assert 'src="figures/fig-9.1.png"' in (out / "index.html").read_text()
    assert CliRunner().invoke(app, words).exit_code == 0  # replaces the earlier page with its vector files
    assert [path.name for path in (out / "figures").iterdir()] == ["fig-9.1.png"]


def test_a_part_does_not_replace_a_full_page(few, tmp_path):
    out = tmp_path / "out"
    reproduce(out)
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    with pytest.raises(ConfigError, match=r"--only would replace the page in .*out, and its 2 other figures"):
        reproduce(out, only=["table-9.1"])
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before


def test_places_that_hold_something_else_are_refused(few, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("x")
    with pytest.raises(ConfigError, match=r"file: is a file; give a folder"):
        reproduce(tmp_path / "file")
    with pytest.raises(ConfigError, match=r"the folder .*nowhere does not exist; make it first"):
        reproduce(tmp_path / "nowhere/out")
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "index.html").write_text("my own page")
    with pytest.raises(ConfigError, match=r"mine: holds index\.html"):
        reproduce(mine)
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    assert reproduce(Path())
    assert (tmp_path / "empty/index.html").exists()


def test_a_run_that_breaks_off_leaves_the_earlier_one_as_it_was(few, tmp_path, monkeypatch):
    out = tmp_path / "out"
    reproduce(out)
    before = (out / "index.html").read_bytes()

    def broken(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module, "format_page", broken)
    with pytest.raises(OutputError, match=r"out: cannot be written: .*No space left"):
        reproduce(out)
    assert (out / "index.html").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_fault_of_the_program_is_no_outcome(tmp_path, monkeypatch):
    def wrong(material):
        raise ZeroDivisionError

    monkeypatch.setattr(module, "collect_entries", lambda: (Entry("fig-9.1", "t", "s", wrong),))
    with pytest.raises(ZeroDivisionError):
        reproduce(tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_a_motion_folder_without_people_and_dogs_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"--motion-folder .*: has no folder human/ and dog/"):
        Material(motion_folder=tmp_path)


def test_a_folder_of_one_kind_leaves_the_other_to_models(tmp_path):
    from doppelgait.motion import human_gait

    (tmp_path / "human").mkdir()
    walk = human_gait(speed_mps=1.2, duration_s=4.0)
    frame = pd.DataFrame({"time_s": walk.time_s})
    for name, values in zip(walk.positions.marker.values, walk.position_m.transpose(1, 0, 2), strict=True):
        frame[[f"{name}_{axis}_m" for axis in "xyz"]] = values
    frame.to_csv(tmp_path / "human/walk.csv", index=False)
    (tmp_path / "human/notes.txt").write_text("not a motion")
    material = Material(motion_folder=tmp_path)
    with pytest.warns(DoppelgaitWarning, match=r"human: 1 of 2 motion files are left out: notes\.txt"):
        person = material.person()
    assert person.about == "recording: human/walk.csv, segment 1"
    assert person.real
    assert not material.find_galloping_dog().real
    assert material.used() == ("recording: human/walk.csv, segment 1", "model: dog, bound, 0.5 m, 3.0 m/s")


def test_material_is_made_once_and_says_for_every_entry_what_it_used():
    material = Material()
    walker = material.make_walker(cycles=1)
    first = material.result(walker, prf_hz=1000.0)
    material.begin_entry()
    assert material.used() == ()
    assert material.result(walker) is first
    assert material.result(walker, method="standard") is not first
    assert material.recording(walker) is material.recording(walker, prf_hz=1000.0)
    assert material.used() == (walker.about,)


def test_the_command_prints_a_table_and_fails_where_an_entry_could_not_be_made(few, tmp_path):
    app = typer.Typer()
    app.command()(command)
    good = CliRunner().invoke(app, [str(tmp_path / "out"), "--only", "table-9.1", "--quiet"])
    assert good.exit_code == 0, good.output
    assert re.search(r"table-9\.1 +0 +0 +0 +0 +\d+\.\d +A table", good.output)
    bad = CliRunner().invoke(app, [str(tmp_path / "out"), "--quiet"])
    assert bad.exit_code == 1
    assert re.search(r"fig-9\.2 +0 +0 +0 +0 +\d+\.\d +NOT MADE: no such gait here", bad.output)
    assert re.search(r"fig-9\.1 +1 +1 +2 +1 ", bad.output)
    assert "error: fig-9.2 could not be reproduced" in bad.output
