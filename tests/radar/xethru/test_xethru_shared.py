"""XeThru files of the vendor's recorder and of real radars."""

from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from doppelgait.core.errors import RecordingError
from doppelgait.radar import Radar, xethru
from doppelgait.radar.xethru.records import META_NAME, TYPES_BY_MASK, Meta, pack_meta

pytestmark = pytest.mark.shared

PROFILE = {
    "frame_counter": 9, "bin_length_m": 0.0514403, "sample_rate_hz": 2.916e9, "carrier_hz": 7.29e9,
    "range_start_m": 0.4,
}  # fmt: skip
RF = {**PROFILE, "bin_length_m": 0.0064, "sample_rate_hz": 23.328e9, "frame_rate_hz": 100.0}
BASEBAND = {**RF, "decimation": 8, "correction_bin": 2, "correction_i": 0.1, "correction_q": 0.2}
DATAFLOAT = {"content_id": 0x11, "info": 7, "values": [1, 2, 3, 4]}
IQ = {"i": [1, 2, 3], "q": [4, 5, 6]}
DOCUMENTED: dict[str, dict[str, dict[str, Any]]] = {
    "baseband_ap": {"baseband_ap": {**PROFILE, "amplitude": [1, 2, 3], "phase_rad": [0.1, 0.2, 0.3]}},
    "baseband_iq": {"baseband_iq": {**PROFILE, **IQ}},
    "datafloat": {"datafloat": DATAFLOAT},
    "databyte": {"databyte": DATAFLOAT},
    "radar_rf": {"radar_rf": {**RF, "counts": [1, 2, 3]}},
    "radar_rf_normalized": {"radar_rf_normalized": {**RF, "values": [1, 2, 3]}},
    "radar_baseband_float": {"radar_baseband_float": {**BASEBAND, **IQ}},
    "radar_baseband_q15": {"radar_baseband_q15": {**BASEBAND, "scale": 1e-5, **IQ}},
    "datafloat_file_split": {"datafloat": DATAFLOAT},
    "datafloat_directory_split": {"datafloat": DATAFLOAT},
    "datafloat_user_header": {"datafloat": DATAFLOAT},
    "datafloat_and_baseband_iq": {"datafloat": DATAFLOAT, "baseband_iq": {**PROFILE, **IQ}},
}
"""What the recorder was fed with, by the notes that go with the files."""
COUNTS = {"datafloat_file_split": 7, "datafloat_directory_split": 7, "datafloat_user_header": 3}


REAL = {"x4_baseband_iq_novelda": 2, "x4_datafloat_marcusm111": 8}
"""Recordings of real radars, and the hours of their zones."""
FOLDERS = [*DOCUMENTED, "pulsedoppler_float", "sleep_csv", *REAL]
WHOLE = [name for name in FOLDERS if not name.endswith(("_split", "_user_header"))]


def find(shared: Path, name: str) -> Path:
    return next((shared / "data/radar" / ("" if name in REAL else "x4_golden") / name).glob("xethru_recording_*"))


@pytest.mark.parametrize("name", DOCUMENTED)
def test_golden_values(shared: Path, name: str) -> None:
    recording = xethru.read_xethru(find(shared, name))
    assert xethru.sniff_xethru(find(shared, name))
    assert recording.session_id == "S"
    assert recording.profile_id == 0
    assert set(recording.streams) == set(DOCUMENTED[name])
    for kind, fields in DOCUMENTED[name].items():
        records = recording.streams[kind].records
        assert len(records) == COUNTS.get(name, 3 if "_and_" in name else 2)
        wanted = xethru.make_records(kind, **fields)[0]
        for field in wanted.dtype.names or ():
            np.testing.assert_array_equal(records[field], np.broadcast_to(wanted[field], records[field].shape), field)
        assert np.all(np.abs(np.diff(recording.streams[kind].time_ms) - (40 if "_and_" in name else 20)) <= 2)
    assert recording.user_headers == ({"datafloat": b"HELLOHDR"} if name == "datafloat_user_header" else {})


def test_golden_text_and_matrices(shared: Path) -> None:
    sleep = xethru.read_xethru(find(shared, "sleep_csv")).streams["sleep"]
    assert sleep.lines[0].startswith("TimeStamp;FrameCounter;State")
    assert [line.split(";")[3] for line in sleep.lines[1:]] == ["12.5", "12.5"]
    matrices = xethru.read_xethru(find(shared, "pulsedoppler_float")).streams["pulsedoppler_float"].records
    assert matrices["power"].shape == (3 * 2 * 4, 5)
    assert set(matrices["instance"].tolist()) == {0, 1}
    assert set(matrices["range_index"].tolist()) == {0, 1, 2, 3}


@pytest.mark.parametrize("name", FOLDERS)
def test_meta_files_are_packed_byte_for_byte(shared: Path, name: str) -> None:
    found = {pack_meta(meta) for meta in xethru.read_xethru(find(shared, name)).metas}
    assert found == {path.read_bytes() for path in find(shared, name).rglob(META_NAME)}


def timed_records(folder: Path, meta: Meta) -> list[xethru.TimedRecord]:
    found = []
    for entry in meta.records:
        data = (folder / meta.file_names[entry["file"]]).read_bytes()
        content = data[entry["offset"] : entry["offset"] + entry["size"]]
        found.append(xethru.TimedRecord(int(entry["time_ms"]), TYPES_BY_MASK[int(entry["data_type"])].name, content))
    return found


@pytest.mark.parametrize("name", WHOLE)
def test_the_same_records_are_written_byte_for_byte(shared: Path, tmp_path: Path, name: str) -> None:
    folder, zone = find(shared, name), timezone(timedelta(hours=REAL.get(name, 0)))
    (meta,) = xethru.read_xethru(folder).metas
    start_time = datetime.fromtimestamp(0, zone) + timedelta(milliseconds=meta.start_ms)
    options = {"start_time": start_time, "session_id": meta.session_id, "stop_ms": meta.trailer_ms}
    again = xethru.write_xethru(tmp_path, timed_records(folder, meta), **options)
    wanted = {path.name: path.read_bytes() for path in folder.iterdir()}
    wanted[META_NAME] = pack_meta(replace(meta, duration_ms=meta.trailer_ms, profile_id=0))  # else as the recorder's
    assert again.name == folder.name
    assert {path.name: path.read_bytes() for path in again.iterdir()} == wanted


def test_the_vendors_baseband_recording(shared: Path) -> None:
    recording = xethru.read_xethru_recording(find(shared, "x4_baseband_iq_novelda"))
    assert recording.baseband.shape == (514, 54)
    range_m = recording.baseband.range.values
    assert range_m[0] == pytest.approx(0.334321, abs=1e-6)
    assert range_m[-1] == pytest.approx(3.06, abs=0.005)
    assert recording.radar.prf_hz == pytest.approx(17.0494, rel=2e-4)  # what the driver makes of 17
    assert recording.radar.carrier_hz == 7.29e9
    unit_v = Radar.preset("x4").volts_per_unit or 1.0
    units = recording.baseband.values / unit_v
    static_db = 20 * np.log10(np.abs(units.mean(axis=0)))
    assert static_db[0] == pytest.approx(-30.0, abs=1.0)
    person = (range_m > 0.6) & (range_m < 0.75)
    assert 20 * np.log10(units[:, person].std(axis=0)).max() == pytest.approx(-56.0, abs=2.0)


def test_noise_of_the_vendors_baseband_is_correlated_as_the_chips_taps_foretell(shared: Path) -> None:
    """Far from the person, after five differences in slow time, when the person keeps still."""
    recording = xethru.read_xethru_recording(find(shared, "x4_baseband_iq_novelda"))
    values = np.diff(recording.baseband.values.astype(complex), n=5, axis=0)
    energy = np.sum(np.abs(values[:, :27]) ** 2, axis=1)
    values = values[energy < np.quantile(energy, 0.3), 27:]
    values /= np.sqrt(np.mean(np.abs(values) ** 2, axis=0))
    found = [np.median(np.mean(values[:, lag:] * values[:, :-lag].conj(), axis=0).real) for lag in (1, 2, 3)]
    assert found == pytest.approx(recording.radar.noise_correlation, abs=0.03)


def test_the_raw_recording(shared: Path) -> None:
    folder = find(shared, "x4_datafloat_marcusm111")
    raw: xethru.XethruRecording = xethru.read_xethru(folder)
    records = raw.streams["datafloat"].records
    assert (len(records), records["values"].shape[1]) == (1518, 182)
    assert records["info"][0] == 1
    assert raw.session_id == "test_recording"
    with pytest.raises(RecordingError, match="do not state range_start_m, bin_spacing_m, carrier_hz"):
        xethru.read_xethru_recording(folder)
    frame = {"range_start_m": 0.38576, "bin_spacing_m": 0.05144033, "carrier_hz": 7.29e9}
    recording = xethru.read_xethru_recording(folder, **frame)
    assert recording.baseband.shape == (1518, 91)
    assert recording.baseband.range.values[-1] == pytest.approx(5.0154, abs=1e-3)
    assert 1000 / recording.radar.prf_hz == pytest.approx(58.6, abs=0.1)
    assert recording.radar.prf_hz == pytest.approx(17.0494, rel=5e-4)
    unit_v = Radar.preset("x4").volts_per_unit or 1.0
    static = recording.baseband.values[1200:, -3:] / unit_v
    noise = np.sqrt(np.mean(np.abs(np.diff(static, axis=0)) ** 2) / 2)
    assert 20 * np.log10(noise) == pytest.approx(-97.0, abs=3.0)
