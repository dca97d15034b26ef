"""XeThru records, names and chains of folders; files of the recorder are in ``test_xethru_shared.py``."""

import struct
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from doppelgait.core.errors import DoppelgaitWarning, OutputError, RecordingError
from doppelgait.radar.xethru import TimedRecord, make_records, read_xethru, sniff_xethru, write_xethru
from doppelgait.radar.xethru.records import DATA_TYPES, META_NAME, parse_records
from xethru_files import add_user_headers

START = datetime(2026, 11, 21, 1, 8, 48, 634_000, tzinfo=UTC)
MATRIX = {"frame_counter": 1, "matrix_counter": 2, "range_index": 3, "range_bins": 4, "instance": 6}
RATES = {
    "frame_rate_hz": 17.0,
    "frame_rate_decimated_hz": 8.5,
    "frequency_start_hz": -4.0,
    "frequency_step_hz": 0.5,
    "range_m": 1.5,
}
STEPS = {"level_start_db": -100.0, "level_step_db": 0.5}
LAYOUTS = {
    "pulsedoppler_float": (
        {**MATRIX, **RATES, "power": [1, 2]}, "<6I5f2f", (1, 2, 3, 4, 2, 6, 17, 8.5, -4, 0.5, 1.5, 1, 2),
    ),
    "noisemap_byte": (
        {**MATRIX, **STEPS, **RATES, "level": [1, 2]}, "<6I7f2B",
        (1, 2, 3, 4, 2, 6, -100, 0.5, 17, 8.5, -4, 0.5, 1.5, 1, 2),
    ),
}  # fmt: skip
"""Layouts of which the recorder's own files hold no record with all fields."""


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_record_has_the_documented_layout(name: str) -> None:
    fields, layout, numbers = LAYOUTS[name]
    content = make_records(name, **fields).tobytes()
    assert content == struct.pack(layout, *numbers)
    blocks, used = parse_records(content * 3, DATA_TYPES[name])
    assert used == 3 * len(content)
    assert [len(block) for block in blocks] == [3]


def test_wrong_fields_are_named() -> None:
    with pytest.raises(RecordingError, match="wrong are colour, info"):
        make_records("datafloat", content_id=0, colour=3, values=[1.0])


@pytest.mark.timeout(60)
def test_records_of_changing_size_are_cut_in_linear_time() -> None:
    sizes = np.tile([1, 3, 3, 0], 5000)
    content = b"".join(struct.pack(f"<III{n}f", 0, k, n, *range(n)) for k, n in enumerate(sizes))
    blocks, used = parse_records(content, DATA_TYPES["datafloat"])
    assert used == len(content)
    assert np.array_equal(np.concatenate([block["info"] for block in blocks]), np.arange(sizes.size))
    assert np.array_equal(np.concatenate([block["count"] for block in blocks]), sizes)


def packet(info: int, n: int = 4) -> bytes:
    return struct.pack(f"<III{n}f", 0, info, n, *range(n))


def some(times_ms: list[int], name: str = "datafloat") -> list[TimedRecord]:
    return [TimedRecord(t, name, packet(k)) for k, t in enumerate(times_ms)]


def test_open_files_are_called_so(tmp_path: Path) -> None:
    def while_writing() -> Iterator[TimedRecord]:
        yield from some([0])
        open_ones = [p.name for p in tmp_path.glob("*/*")]
        assert len(open_ones) == 1
        assert open_ones[0].endswith(".writing")
        yield TimedRecord(1, "datafloat", packet(1))

    write_xethru(tmp_path, while_writing(), start_time=START, session_id="S")


@pytest.mark.parametrize(
    ("times", "changes", "message"),
    [
        *(([0], {"session_id": session_id}, "session_id") for session_id in ("", "a/b", "..", "a\0", "x" * 101)),
        ([0], {"start_time": datetime(2026, 1, 1)}, "time zone"),
        ([], {}, "needs one record"),
        ([9, 5], {}, "time 5 ms; allowed are 9"),
    ],
)
def test_nothing_is_left_of_a_recording_that_cannot_be(
    tmp_path: Path, times: list[int], changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(RecordingError, match=message):
        write_xethru(tmp_path, some(times), **{"start_time": START, "session_id": "S", **changes})
    assert list(tmp_path.iterdir()) == []


def test_folders_that_exist_or_cannot_be_made_are_refused(tmp_path: Path) -> None:
    write_xethru(tmp_path, some([9]), start_time=START, session_id="S")
    (tmp_path / "file").write_text("")
    for folder, message in ((tmp_path, "exists already"), (tmp_path / "file", "cannot be written")):
        with pytest.raises(OutputError, match=message):
            write_xethru(folder, some([9]), start_time=START, session_id="S")


def test_types_without_known_layout_come_as_bytes(tmp_path: Path) -> None:
    records = [TimedRecord(k, "vitalsigns", bytes([k]) * (k + 3)) for k in range(3)]
    folder = write_xethru(tmp_path, records, start_time=START, session_id="S")
    add_user_headers(folder, b"HI")
    assert read_xethru(folder).streams["vitalsigns"].raw == (b"\0" * 3, b"\1" * 4, b"\2" * 5)
    data = next(folder.glob("*vital*"))
    data.write_bytes(data.read_bytes()[:-1])
    with pytest.warns(DoppelgaitWarning, match="2 records of 3 read"):
        assert len(read_xethru(folder).streams["vitalsigns"]) == 2


def test_a_data_file_alone_is_read_without_times(tmp_path: Path) -> None:
    folder = write_xethru(tmp_path, some([0, 20]), start_time=START, session_id="S")
    data = next(folder.glob("*datafloat*"))
    assert read_xethru(data).streams["datafloat"].time_ms.tolist() == [0, 20]
    (folder / META_NAME).unlink()
    for path in (data, folder):
        with pytest.warns(DoppelgaitWarning, match="without the times"):
            alone = read_xethru(path)
        assert alone.streams["datafloat"].records["info"].tolist() == [0, 1]
        assert alone.start_ms is None
        assert alone.session_id == ""


def test_sniffing(tmp_path: Path) -> None:
    folder = write_xethru(tmp_path, some([0, 20]), start_time=START, session_id="S")
    data = next(folder.glob("*datafloat*"))
    assert all(map(sniff_xethru, (folder, folder / META_NAME, data)))
    (folder / META_NAME).rename(tmp_path / "renamed.bin")
    assert sniff_xethru(tmp_path / "renamed.bin")
    assert sniff_xethru(data)
    data.write_bytes(struct.pack("<III", 0, 0, 4_000_000_000))
    assert not sniff_xethru(data)
    (tmp_path / "other.dat").write_bytes(packet(0))
    assert not sniff_xethru(tmp_path / "other.dat")
