"""Recordings of files and folders: what was named must be read, what was found may be left out with a line."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from command import run
from doppelgait.core.errors import RecordingError
from doppelgait.radar import Radar, Recording, read_recording, write_recording
from doppelgait.radar.readers import find_recordings, read_several
from doppelgait.radar.simulate import label_baseband

CW = Radar(waveform="cw", carrier_hz=24e9, prf_hz=400.0, range_stop_m=10.0)


@pytest.fixture
def week(tmp_path: Path) -> Path:
    """Two recordings, one with two matrices, notes, an empty file and one of something else."""
    folder = tmp_path / "week"
    (folder / "monday").mkdir(parents=True)
    rng = np.random.default_rng(0)
    values = rng.normal(size=(400, 1)) + 1j * rng.normal(size=(400, 1))
    one = Recording.from_baseband(label_baseband(values.astype(np.complex64), np.arange(400) / 400.0, CW), CW)
    write_recording(one, folder / "a.h5")
    write_recording(one, folder / "monday" / "b.h5")
    frames = {f"Data_Matrix_{n}": rng.normal(size=(50, 200)) for n in (1, 2)}
    facts = {"actual_fps": 25.0, "bin_length": 0.0064308, "frame_start": 0.5}
    savemat(folder / "two.mat", {**frames, **facts})
    (folder / "notes.txt").write_text("rain", encoding="utf-8")
    (folder / "gone.h5").write_bytes(b"")
    (folder / "damaged.mat").write_bytes((folder / "two.mat").read_bytes()[:300])
    return folder


def test_a_folder_gives_every_recording_of_every_file(week: Path) -> None:
    found, left_out = read_several([week])
    matrices = [f"two.mat (matrix=Data_Matrix_{number})" for number in (1, 2)]
    assert [Path(r.source).name for r in found] == ["a.h5", "b.h5", *matrices]
    for number in (1, 2):
        alone = read_recording(week / "two.mat", matrix=f"Data_Matrix_{number}")
        assert np.array_equal(found[1 + number].samples.matrix, alone.samples.matrix)
    assert len(left_out) == 2
    assert "damaged.mat" in left_out[0]
    assert "gone.h5: is empty" in left_out[1]
    (chosen,), _ = read_several([week / "two.mat"], matrix="Data_Matrix_2")
    assert np.array_equal(chosen.samples.matrix, found[3].samples.matrix)


def test_what_was_named_must_be_read(week: Path) -> None:
    for name, said in {
        "none.h5": "no such file",
        "gone.h5": "is empty",
        "notes.txt": "no known recording format",
    }.items():
        with pytest.raises(RecordingError, match=rf"{name}: .*{said}"):
            read_several([week / "a.h5", week / name])
        out = week / "my.toml"
        with pytest.raises(RecordingError):
            run("radar", "fit", week / "a.h5", week / name, "-o", out)
        assert not out.exists()
    with pytest.raises(RecordingError, match="has the option matrx"):
        read_several([week], matrx="Data_Matrix_1")
    (week / "only").mkdir()
    with pytest.raises(RecordingError, match=r"no recording can be read: .*only"):
        read_several([week / "only"])


def test_two_files_of_one_recording_are_one(tmp_path: Path) -> None:
    for part in ("RE", "IM"):
        (tmp_path / f"walk_{part}.txt").write_text("2048\n2049\n" * 50, encoding="utf-8")
    pair = [tmp_path / "walk_IM.txt", tmp_path / "walk_RE.txt"]
    assert list(find_recordings(pair)) == [(pair[1], True)]
    assert list(find_recordings([tmp_path])) == [(pair[1], False)]
