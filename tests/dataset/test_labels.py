"""Labels and subjects from the names of files."""

import pytest

from doppelgait.core.errors import ConfigError, DoppelgaitWarning
from doppelgait.dataset.labels import find_recordings, label_entries, list_recording_files, read_names, relabel


def touch(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("")


def triples(entries):
    return [(entry.recording, entry.label, entry.subject) for entry in entries]


def test_folders_and_parts_of_names(tmp_path):
    touch(tmp_path, "Boxing/anna_1.png", "Boxing/ben_x_2.png", "army marching/anna_1.png", "note.txt")
    assert triples(read_names(tmp_path, "{label}/{subject}_*.png")) == [
        ("Boxing/anna_1.png", "Boxing", "anna"),
        ("Boxing/ben_x_2.png", "Boxing", "ben"),
        ("army marching/anna_1.png", "army marching", "anna"),
    ]
    touch(tmp_path, "a/b/2024/run-anna.bin", "run-ben.bin")
    found = read_names(tmp_path, "**/{label}-{subject}.bin")
    assert triples(found) == [("a/b/2024/run-anna.bin", "run", "anna"), ("run-ben.bin", "run", "ben")]


def test_files_that_do_not_fit_are_named(tmp_path):
    touch(tmp_path, "1P36A01R01.dat", "notes.dat")
    with pytest.warns(DoppelgaitWarning, match=r"1 files do not fit .*notes\.dat"):
        assert len(read_names(tmp_path, "glasgow")) == 1


@pytest.mark.parametrize(
    ("names", "files", "message"),
    [
        ("glasgow", ["7P36A07R01.dat"], r"7P36A07R01.dat \('7'\): is no label; allowed are 1 \(walking\), 2 \(sitting"),
        ("glasgow", ["a.dat"], r"no file fits .*1 files end in '.dat', the first is a.dat"),
        ("glasgow", ["a.txt"], r"no file fits .*none ends in '.dat'"),
        ("glasgov", [], r"'glasgov' is not allowed: it has no \{label\}; known are glasgow"),
        ("{label}/{who}.png", [], r"\{who\} must be one of label, subject, session"),
        ("{label}/{label}.png", [], r"\{label\} must be one of"),
        ("{label}/*.png", ["caf\u00e9/1.png"], r"is no label; allowed are letters"),
    ],
)
def test_what_is_refused(tmp_path, names, files, message):
    touch(tmp_path, *files)
    with pytest.raises(ConfigError, match=message):
        read_names(tmp_path, names)
    with pytest.raises(ConfigError, match="no such folder"):
        read_names(tmp_path / "none", names)


def test_labels_become_classes(tmp_path):
    touch(tmp_path, "1P36A01R01.dat", "6P36A06R01.dat", "2P36A02R01.dat", "3P36A03R01.dat")
    entries = read_names(tmp_path, "glasgow")
    assert [entry.label for entry in relabel(entries, [])] == ["walking", "sitting down", "standing up", "falling"]
    assert triples(relabel(entries, ["walking=human", "*="])) == [("1P36A01R01.dat", "human", "36")]
    assert [one.label for one in relabel(entries, ["s*=chair", "falling= "])] == ["walking", "chair", "chair"]
    for wrong, message in (
        ("walking", "must be LABEL=CLASS"),
        ("=human", "must be LABEL=CLASS"),
        ("walking=a/b", "must be LABEL=CLASS"),
        ("running=human", "fits no label; the labels are walking, sitting down, standing up, falling"),
        ("*=", "leaves out every recording"),
    ):
        with pytest.raises(ConfigError, match=message):
            relabel(entries, [wrong])


def test_labels_of_a_file_or_of_names(tmp_path):
    touch(tmp_path, "1P36A01R01.dat")
    table = tmp_path / "labels.csv"
    table.write_text("file,label\n1P36A01R01.dat,human\n")
    assert label_entries(tmp_path, table, None, [], gate="track") == table
    assert triples(label_entries(tmp_path, table, None, ["human=person"], gate="track")) == [
        ("1P36A01R01.dat", "person", "")
    ]
    for labels, names in ((table, "glasgow"), (None, None)):
        with pytest.raises(ConfigError, match="set --labels, or set --names"):
            label_entries(tmp_path, labels, names, [], gate="track")


def test_settings_are_no_recordings(tmp_path):
    touch(tmp_path, "a/1.png", "a/picture.toml", "a/2.png", "a/2.toml", "b/1.bin", "b/1.json", "b/chirps.cfg")
    assert find_recordings(tmp_path, "a/*") == ["a/1.png", "a/2.png"]
    assert find_recordings(tmp_path, "*/*") == ["a/1.png", "a/2.png", "b/1.bin"]
    assert [path.name for path in list_recording_files(tmp_path / "a" / "1.png")] == ["1.png", "picture.toml"]
    assert [path.name for path in list_recording_files(tmp_path / "a" / "2.png")] == ["2.png", "2.toml"]
    assert [path.name for path in list_recording_files(tmp_path / "b" / "1.bin")] == ["1.bin", "1.json"]
    (tmp_path / "b" / "1.json").unlink()
    assert [path.name for path in list_recording_files(tmp_path / "b" / "1.bin")] == ["1.bin", "chirps.cfg"]
    with pytest.raises(ConfigError, match=r"'b/chirps\.cfg': is a settings file, not a recording"):
        find_recordings(tmp_path, "b/chirps.cfg")
