"""Damaged XeThru files: a good result, what is left of it with a warning, or our own error; never anything else."""

import shutil
import struct
import tracemalloc
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from doppelgait.core.errors import DoppelgaitWarning, RecordingError
from doppelgait.radar.xethru import TimedRecord, make_records, read_xethru, read_xethru_recording, write_xethru
from doppelgait.radar.xethru.records import META_NAME
from xethru_files import HEAD, add_user_headers, make_mixed_records, write_chain

START = datetime(2026, 11, 21, 1, 8, 48, tzinfo=UTC)


def good(folder: Path, *, per_folder: int | None = None) -> Path:
    records = make_mixed_records()
    if per_folder:
        made = write_chain(folder, records, start_time=START, per_folder=per_folder)
    else:
        made = write_xethru(folder, records, start_time=START, session_id="S")
    add_user_headers(made, b"HI")
    return made


def test_a_record_of_absurd_length_ends_the_file(tmp_path: Path) -> None:
    folder = good(tmp_path)
    data = next(folder.glob("*baseband_iq*"))
    content = bytearray(data.read_bytes())
    struct.pack_into("<I", content, 2 + 3 * 64 + 4, 4_000_000_000)
    data.write_bytes(content)
    tracemalloc.start()
    with pytest.warns(DoppelgaitWarning, match="3 records of 8 read"):
        assert len(read_xethru_recording(folder).baseband) == 3
    assert tracemalloc.get_traced_memory()[1] < 30e6
    tracemalloc.stop()


def at(offset: int, layout: str, value: Any) -> Any:
    def change(content: bytearray) -> bytes:
        struct.pack_into(layout, content, offset, value)
        return bytes(content)

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: b"", "is empty"),
        (lambda content: bytes(content[:50]), "cut off"),
        (lambda content: bytes(content[:-3]), "does not end there with a zero"),
        (at(0, "<I", 7), "is no meta file"),
        (at(4, "<I", 1), "version 1; read are 12 to 14"),
        (at(29, "<q", 91), "is no trailer"),
        (at(41, "<q", 10**9), "a name should be at byte"),
        (at(85, "<I", 4_000_000_000), "its table should end"),
        (at(91 + 4, "<B", 9), "kind 9"),
        (at(91 + 13, "<I", 5), "data file 5"),
        (at(91 + 17, "<q", -5), "offset -5"),
    ],
)
def test_a_damaged_meta_file_is_refused_with_the_reason(tmp_path: Path, change: Any, message: str) -> None:
    folder = good(tmp_path)
    meta = folder / META_NAME
    meta.write_bytes(change(bytearray(meta.read_bytes())))
    with pytest.raises(RecordingError, match=message) as caught:
        read_xethru(folder)
    assert META_NAME in str(caught.value)
    data = next(folder.glob("*baseband_iq*"))
    with pytest.warns(DoppelgaitWarning), pytest.raises(RecordingError):  # its user header is no record
        read_xethru(data)


def test_versions_12_to_14_are_read(tmp_path: Path) -> None:
    meta = good(tmp_path) / META_NAME
    for version in (12, 14):
        meta.write_bytes(at(4, "<I", version)(bytearray(meta.read_bytes())))
        assert read_xethru(meta).metas[0].version == version


def test_a_lone_data_file_is_read_though_its_meta_is_damaged(tmp_path: Path) -> None:
    one = make_records("baseband_iq", **HEAD, frame_counter=1, i=[1], q=[2]).tobytes()
    timed = [TimedRecord(k, "baseband_iq", one) for k in (0, 10)]
    folder = write_xethru(tmp_path, timed, start_time=START, session_id="S")
    (folder / META_NAME).write_bytes(b"broken")
    with pytest.warns(DoppelgaitWarning, match="without the times of its records: .*is no meta file"):
        assert read_xethru_recording(next(folder.glob("*iq*")), prf_hz=100.0).baseband.shape == (2, 1)


def test_missing_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no such file"):
        read_xethru(tmp_path / "nothing")
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordingError, match="no such file"):
        read_xethru(tmp_path / "empty")
    folder = good(tmp_path)
    next(folder.glob("*vital*")).unlink()
    with pytest.raises(RecordingError, match=r"xethru_vitalsigns_\d+_\d+\.dat: there is no such data file"):
        read_xethru(folder)


def test_an_empty_data_file(tmp_path: Path) -> None:
    folder = good(tmp_path)
    data = next(folder.glob("*baseband_iq*"))
    data.write_bytes(b"")
    with pytest.warns(DoppelgaitWarning, match="0 records of 8"), pytest.raises(RecordingError, match="holds"):
        read_xethru_recording(folder)
    (folder / META_NAME).unlink()
    with pytest.raises(RecordingError, match="is empty"):
        read_xethru(data)


def test_a_chain_that_bites_its_tail_or_leaves_is_refused(tmp_path: Path) -> None:
    folder = good(tmp_path, per_folder=9)
    parts = sorted(folder.iterdir())
    assert len(parts) == 3
    last = parts[1] / META_NAME
    content = last.read_bytes()
    last.write_bytes(content.replace(b"_S_2/xethru", b"_S_0/xethru"))
    with pytest.raises(RecordingError, match="which came before"):
        read_xethru(folder)
    last.write_bytes(content.replace(b"../xethru_recording_2", b"../../../../../../../"))
    with pytest.raises(RecordingError, match="only a folder next to its own"):
        read_xethru(folder)
    last.write_bytes(content)
    shutil.rmtree(parts[2])
    with pytest.raises(RecordingError, match="continues there"):
        read_xethru(folder)


def test_a_data_file_elsewhere_is_refused(tmp_path: Path) -> None:
    meta = good(tmp_path) / META_NAME
    content = meta.read_bytes()
    meta.write_bytes(content.replace(b"xethru_baseband_iq_", b"../thru_baseband_iq"))
    with pytest.raises(RecordingError, match="only a file in the folder of the meta file"):
        read_xethru(meta)


@pytest.mark.parametrize("mask", [5, 1024])
def test_a_data_file_of_an_unknown_type_or_of_two_is_refused(tmp_path: Path, mask: int) -> None:
    meta = good(tmp_path) / META_NAME
    meta.write_bytes(at(91 + 5, "<I", mask)(bytearray(meta.read_bytes())))
    with pytest.raises(RecordingError, match="one known type is allowed, the one of its name"):
        read_xethru(meta)
