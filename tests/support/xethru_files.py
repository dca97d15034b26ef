"""XeThru recordings of the vendor's recorder that our writer does not make: chained folders, user headers."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from doppelgait.radar.xethru import TimedRecord, make_records, write_xethru
from doppelgait.radar.xethru.records import META_NAME, Meta, pack_meta, parse_meta


def write_chain(folder: Path, records: Sequence[TimedRecord], *, start_time: datetime, per_folder: int) -> Path:
    """Write so many records into each folder of a chain."""
    root = folder / f"xethru_recording_{start_time:%Y%m%d_%H%M%S}_S"
    for number, first in enumerate(range(0, len(records), per_folder)):
        first_ms = records[first].time_ms
        part = [replace(one, time_ms=one.time_ms - first_ms) for one in records[first : first + per_folder]]
        made = write_xethru(root, part, start_time=start_time + timedelta(milliseconds=first_ms), session_id="S")
        place = made.rename(root / f"{root.name}_{number}")
        if first + per_folder < len(records):
            following = f"../{root.name}_{number + 1}/{META_NAME}"
            (place / META_NAME).write_bytes(pack_meta(replace(read_meta(place), next_meta=following)))
    return root


def read_meta(folder: Path) -> Meta:
    return parse_meta((folder / META_NAME).read_bytes(), where=str(folder))


def add_user_headers(folder: Path, header: bytes) -> None:
    """Put a header in front of the records of every data file."""
    for path in folder.rglob(META_NAME):
        meta = read_meta(path.parent)
        entries = meta.entries.copy()
        for number, name in enumerate(meta.file_names):
            data = path.with_name(name)
            data.write_bytes(header + data.read_bytes())
            first = entries[entries["file"] == number][:1].copy()
            first["data_type"], first["size"] = ~first["data_type"], len(header)
            entries["offset"][entries["file"] == number] += len(header)
            entries = np.concatenate([first, entries])
        path.write_bytes(pack_meta(replace(meta, entries=entries)))


HEAD = {"bin_length_m": 0.05144033, "sample_rate_hz": 2.916e9, "carrier_hz": 7.29e9, "range_start_m": 0.4}


def make_mixed_records() -> list[TimedRecord]:
    """Eight pulses of five bins, with vital signs and texts between them."""
    records = []
    for k in range(8):
        one = make_records("baseband_iq", **HEAD, frame_counter=k + 1, i=np.arange(5) + k, q=np.arange(5))
        records.append(TimedRecord(10 * k, "baseband_iq", one.tobytes()))
        records.append(TimedRecord(10 * k, "vitalsigns", bytes(range(k, k + 9))))
        records.append(TimedRecord(10 * k, "datastring", f"now;{k}\n".encode()))
    return records
