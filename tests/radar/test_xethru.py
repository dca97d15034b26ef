"""XeThru records and meta files against layouts packed by hand, names, chains of folders and several files."""

import struct
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from doppelgait.core.errors import DoppelgaitWarning, OutputError, RecordingError
from doppelgait.radar.xethru import TimedRecord, make_records, read_xethru, sniff_xethru, write_xethru
from doppelgait.radar.xethru.records import DATA_TYPES, META_NAME, find_data_type_by_file, pack_meta, parse_records
from xethru_files import add_user_headers, write_chain

START = datetime(2026, 11, 21, 1, 8, 48, 634_000, tzinfo=UTC)
START_MS = 1_795_223_328_634

PROFILE = {"frame_counter": 9, "bin_length_m": 0.5, "sample_rate_hz": 2.0, "carrier_hz": 7.0, "range_start_m": 0.25}
RADAR = {**PROFILE, "frame_rate_hz": 100.0}
BASEBAND = {**RADAR, "decimation": 8, "correction_bin": 2, "correction_i": 0.5, "correction_q": 0.75}
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
    "datafloat": ({"content_id": 17, "info": 7, "values": [1.0, 2.0]}, "<III2f", (17, 7, 2, 1, 2)),
    "databyte": ({"content_id": 17, "info": 7, "values": [1, 2]}, "<III2B", (17, 7, 2, 1, 2)),
    "baseband_iq": ({**PROFILE, "i": [1, 2], "q": [3, 4]}, "<II4f4f", (9, 2, 0.5, 2, 7, 0.25, 1, 2, 3, 4)),
    "baseband_ap": (
        {**PROFILE, "amplitude": [1, 2], "phase_rad": [3, 4]}, "<II4f4f", (9, 2, 0.5, 2, 7, 0.25, 1, 2, 3, 4),
    ),
    "radar_rf": ({**RADAR, "counts": [5, 6]}, "<II5f2I", (9, 2, 0.5, 2, 7, 100, 0.25, 5, 6)),
    "radar_rf_normalized": ({**RADAR, "values": [5, 6]}, "<II5f2f", (9, 2, 0.5, 2, 7, 100, 0.25, 5, 6)),
    "radar_baseband_float": (
        {**BASEBAND, "i": [1, 2], "q": [3, 4]}, "<II5fII2f4f",
        (9, 2, 0.5, 2, 7, 100, 0.25, 8, 2, 0.5, 0.75, 1, 2, 3, 4),
    ),
    "radar_baseband_q15": (
        {**BASEBAND, "scale": 0.125, "i": [1, -2], "q": [3, 4]}, "<II5fII2ff4h",
        (9, 2, 0.5, 2, 7, 100, 0.25, 8, 2, 0.5, 0.75, 0.125, 1, -2, 3, 4),
    ),
    "pulsedoppler_float": (
        {**MATRIX, **RATES, "power": [1, 2]}, "<6I5f2f", (1, 2, 3, 4, 2, 6, 17, 8.5, -4, 0.5, 1.5, 1, 2),
    ),
    "noisemap_byte": (
        {**MATRIX, **STEPS, **RATES, "level": [1, 2]}, "<6I7f2B",
        (1, 2, 3, 4, 2, 6, -100, 0.5, 17, 8.5, -4, 0.5, 1.5, 1, 2),
    ),
}  # fmt: skip


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


def test_names_tell_the_type() -> None:
    assert find_data_type_by_file("xethru_radar_rf_normalized_20261121_010819.dat") is DATA_TYPES["radar_rf_normalized"]
    assert find_data_type_by_file("xethru_radar_rf_20261121_010819.dat") is DATA_TYPES["radar_rf"]
    assert find_data_type_by_file("xethru_sleep_20261121_010818.csv") is DATA_TYPES["sleep"]
    assert find_data_type_by_file(META_NAME) is None


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


def entry(time_ms: int, kind: int, mask: int, size: int, file: int, offset: int, total: int) -> bytes:
    return struct.pack("<IBIIIqq", time_ms, kind, mask, size, file, offset, total)


def meta_by_hand(entries: list[bytes], names: list[str], *, mask: int, total: int, largest: int, stop_ms: int) -> bytes:
    """The documented layout of version 13, written down once more."""
    table = b"".join(entries)
    head = struct.pack(
        "<IIqBIqqIqII", 0xA0B1C2D3, 13, START_MS, 1, stop_ms, total, 91 + len(table), mask, -1, largest, 0
    )
    trailer = struct.pack("<IBI", stop_ms, 3, len(names))
    trailer += b"".join(struct.pack("<I", len(n) + 1) + n.encode() + b"\0" for n in names)
    return head + b"\xcd" * 28 + struct.pack("<I", 2) + b"S\0" + table + trailer


def test_files_are_as_documented_byte_for_byte(tmp_path: Path) -> None:
    folder = write_xethru(tmp_path, some([0, 20]), start_time=START, session_id="S", stop_ms=91)
    assert folder.name == "xethru_recording_20261121_010848_S"
    name = "xethru_datafloat_20261121_010848.dat"
    assert sorted(p.name for p in folder.iterdir()) == [name, META_NAME]
    assert (folder / name).read_bytes() == packet(0) + packet(1)
    rows = [entry(0, 1, 1024, 28, 0, 0, 28), entry(20, 1, 1024, 28, 0, 28, 56), entry(91, 2, 1024, 0, 0, 56, 56)]
    wanted = meta_by_hand(rows, [name], mask=1024, total=56, largest=28, stop_ms=91)
    assert (folder / META_NAME).read_bytes() == wanted


def test_names_show_the_time_of_the_zone_and_the_meta_the_instant(tmp_path: Path) -> None:
    there = START.astimezone(timezone(timedelta(hours=8)))
    folder = write_xethru(tmp_path, some([0]), start_time=there, session_id="S")
    assert folder.name == "xethru_recording_20261121_090848_S"
    assert read_xethru(folder).start_ms == START_MS


def test_two_types_and_a_user_header(tmp_path: Path) -> None:
    iq = make_records("baseband_iq", **PROFILE, i=[1], q=[2]).tobytes()
    rows = [
        entry(5, 1, 0xFFFFFFFF - 1024, 4, 0, 0, 4), entry(5, 1, 1024, 28, 0, 4, 32),
        entry(6, 1, 0xFFFFFFFF - 2, 4, 1, 0, 36), entry(6, 1, 2, 32, 1, 4, 68),
        entry(9, 2, 2, 0, 1, 36, 68), entry(9, 2, 1024, 0, 0, 32, 68),
    ]  # fmt: skip
    names = ["xethru_datafloat_20261121_010848.dat", "xethru_baseband_iq_20261121_010848.dat"]
    wanted = meta_by_hand(rows, names, mask=1026, total=68, largest=32, stop_ms=9)
    (tmp_path / META_NAME).write_bytes(wanted)
    for name, content in zip(names, (packet(0), iq), strict=True):
        (tmp_path / name).write_bytes(b"HEAD" + content)
    back = read_xethru(tmp_path)
    assert pack_meta(back.metas[0]) == wanted
    assert back.user_headers == {"datafloat": b"HEAD", "baseband_iq": b"HEAD"}
    assert back.streams["baseband_iq"].records["q"].tolist() == [[2.0]]
    assert back.streams["datafloat"].time_ms.tolist() == [5]


def test_a_type_in_several_files_is_one_stream(tmp_path: Path) -> None:
    names = ["xethru_datafloat_20261121_010848.dat", "xethru_datafloat_20261121_010848_655ms.dat"]
    rows = [entry(400 * k, 1, 1024, 28, k // 2, 28 * (k % 2), 28 * k + 28) for k in range(4)]
    (tmp_path / META_NAME).write_bytes(meta_by_hand(rows, names, mask=1024, total=112, largest=28, stop_ms=1200))
    for k, name in enumerate(names):
        (tmp_path / name).write_bytes(packet(2 * k) + packet(2 * k + 1))
    stream = read_xethru(tmp_path).streams["datafloat"]
    assert (stream.records["info"].tolist(), stream.time_ms.tolist()) == ([0, 1, 2, 3], [0, 400, 800, 1200])


def test_folders_that_are_chained(tmp_path: Path) -> None:
    folder = write_chain(tmp_path, some([0, 700, 1400, 2100, 2800]), start_time=START, per_folder=2)
    back = read_xethru(folder)
    assert [meta.next_meta for meta in back.metas] == [f"../{folder.name}_{k}/{META_NAME}" for k in (1, 2)] + [""]
    assert [meta.start_ms - START_MS for meta in back.metas] == [0, 1400, 2800]
    assert back.streams["datafloat"].time_ms.tolist() == [0, 700, 1400, 2100, 2800]
    assert back.streams["datafloat"].records["info"].tolist() == [0, 1, 2, 3, 4]
    assert len(read_xethru(folder / f"{folder.name}_1").streams["datafloat"]) == 3


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


def test_text_types_are_read_line_by_line(tmp_path: Path) -> None:
    lines = ["TimeStamp;State\n", "2026-11-21T01:08:18.398+00:00;1\n"]
    records = [TimedRecord(k, "sleep", line.encode()) for k, line in enumerate(lines)]
    stream = read_xethru(write_xethru(tmp_path, records, start_time=START, session_id="S")).streams["sleep"]
    assert stream.lines == ("TimeStamp;State", "2026-11-21T01:08:18.398+00:00;1")
    assert stream.time_ms.tolist() == [0, 1]


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
    assert not sniff_xethru(tmp_path)
    assert not sniff_xethru(tmp_path / "nothing")
