"""XeThru files of the vendor's recorder and of real radars."""

from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from doppelgait.core.errors import RecordingError
from doppelgait.radar import Radar
from doppelgait.radar.xethru import (
    TimedRecord,
    XethruRecording,
    make_records,
    read_xethru,
    read_xethru_recording,
    sniff_xethru,
)
from doppelgait.radar.xethru.records import TYPES_BY_MASK
from xethru_recorder import Splitting, record_xethru

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
SPLITTING = {
    "datafloat_file_split": Splitting(file_bytes=56), "datafloat_directory_split": Splitting(folder_bytes=56),
}  # fmt: skip
GOLDEN = [*DOCUMENTED, "pulsedoppler_float", "sleep_csv"]


def golden(shared: Path, name: str) -> Path:
    return next((shared / "data/radar/x4_golden" / name).glob("xethru_recording_*"))


@pytest.mark.parametrize("name", DOCUMENTED)
def test_golden_values(shared: Path, name: str) -> None:
    recording = read_xethru(golden(shared, name))
    assert sniff_xethru(golden(shared, name))
    assert recording.session_id == "S"
    assert recording.profile_id == 0
    assert set(recording.streams) == set(DOCUMENTED[name])
    for kind, fields in DOCUMENTED[name].items():
        records = recording.streams[kind].records
        assert len(records) == COUNTS.get(name, 3 if "_and_" in name else 2)
        wanted = make_records(kind, **fields)[0]
        for field in wanted.dtype.names or ():
            np.testing.assert_array_equal(records[field], np.broadcast_to(wanted[field], records[field].shape), field)
        assert np.all(np.abs(np.diff(recording.streams[kind].time_ms) - (40 if "_and_" in name else 20)) <= 2)
    assert recording.user_headers == ({"datafloat": b"HELLOHDR"} if name == "datafloat_user_header" else {})


def test_golden_text_and_matrices(shared: Path) -> None:
    sleep = read_xethru(golden(shared, "sleep_csv")).streams["sleep"]
    assert sleep.lines[0].startswith("TimeStamp;FrameCounter;State")
    assert [line.split(";")[3] for line in sleep.lines[1:]] == ["12.5", "12.5"]
    matrices = read_xethru(golden(shared, "pulsedoppler_float")).streams["pulsedoppler_float"].records
    assert matrices["power"].shape == (3 * 2 * 4, 5)
    assert set(matrices["instance"].tolist()) == {0, 1}
    assert set(matrices["range_index"].tolist()) == {0, 1, 2, 3}


def written_again(folder: Path, name: str, zone_h: int, into: Path) -> Path:
    """The same records, times, start and session id through our writer."""
    content = read_xethru(folder)
    metas = content.metas
    start_ms = metas[0].start_ms
    places = sorted(path.parent for path in folder.rglob("xethru_recording_meta.dat"))
    header = next(iter(content.user_headers.values()), b"")
    zone = timezone(timedelta(hours=zone_h))
    return record_xethru(
        into,
        [record for place, meta in zip(places, metas, strict=True) for record in timed_records(place, meta, start_ms)],
        start_time=datetime.fromtimestamp(0, zone) + timedelta(milliseconds=start_ms),
        session_id=content.session_id,
        stop_ms=[int(meta.trailer_ms or 0) + meta.start_ms - start_ms for meta in metas],
        duration_ms=metas[-1].duration_ms + metas[-1].start_ms - start_ms,
        profile_id=content.profile_id,
        user_header=header,
        splitting=SPLITTING.get(name, Splitting()),
        rename_lag_ms=1,
    )


def timed_records(place: Path, meta: Any, start_ms: int) -> list[TimedRecord]:
    found = []
    for entry in meta.records:
        kind = TYPES_BY_MASK.get(int(entry["data_type"]))
        if kind is not None:
            data = (place / meta.file_names[entry["file"]]).read_bytes()
            content = data[entry["offset"] : entry["offset"] + entry["size"]]
            found.append(TimedRecord(int(entry["time_ms"]) + meta.start_ms - start_ms, kind.name, content))
    return found


def check_bytes(folder: Path, again: Path) -> None:
    found, wanted = (
        {str(path.relative_to(one.parent)): path.read_bytes() for path in one.rglob("*") if path.is_file()}
        for one in (again, folder)
    )
    assert found == wanted


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_files_byte_for_byte(shared: Path, tmp_path: Path, name: str) -> None:
    check_bytes(golden(shared, name), written_again(golden(shared, name), name, 0, tmp_path))


def novelda(shared: Path) -> Path:
    return next((shared / "data/radar/x4_baseband_iq_novelda").glob("xethru_recording_*"))


def marcus(shared: Path) -> Path:
    return next((shared / "data/radar/x4_datafloat_marcusm111").glob("xethru_recording_*"))


@pytest.mark.parametrize(("folder", "zone_h"), [(novelda, 2), (marcus, 8)])
def test_real_files_byte_for_byte(shared: Path, tmp_path: Path, folder: Any, zone_h: int) -> None:
    check_bytes(folder(shared), written_again(folder(shared), "", zone_h, tmp_path))


def test_the_vendors_baseband_recording(shared: Path) -> None:
    recording = read_xethru_recording(novelda(shared))
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
    recording = read_xethru_recording(novelda(shared))
    values = np.diff(recording.baseband.values.astype(complex), n=5, axis=0)
    energy = np.sum(np.abs(values[:, :27]) ** 2, axis=1)
    values = values[energy < np.quantile(energy, 0.3), 27:]
    values /= np.sqrt(np.mean(np.abs(values) ** 2, axis=0))
    found = [np.median(np.mean(values[:, lag:] * values[:, :-lag].conj(), axis=0).real) for lag in (1, 2, 3)]
    assert found == pytest.approx(recording.radar.noise_correlation, abs=0.03)


def test_the_raw_recording(shared: Path) -> None:
    folder = marcus(shared)
    raw: XethruRecording = read_xethru(folder)
    records = raw.streams["datafloat"].records
    assert (len(records), records["values"].shape[1]) == (1518, 182)
    assert records["info"][0] == 1
    assert raw.session_id == "test_recording"
    with pytest.raises(RecordingError, match="do not state range_start_m, bin_spacing_m, carrier_hz"):
        read_xethru_recording(folder)
    frame = {"range_start_m": 0.38576, "bin_spacing_m": 0.05144033, "carrier_hz": 7.29e9}
    recording = read_xethru_recording(folder, **frame)
    assert recording.baseband.shape == (1518, 91)
    assert recording.baseband.range.values[-1] == pytest.approx(5.0154, abs=1e-3)
    assert 1000 / recording.radar.prf_hz == pytest.approx(58.6, abs=0.1)
    assert recording.radar.prf_hz == pytest.approx(17.0494, rel=5e-4)
    unit_v = Radar.preset("x4").volts_per_unit or 1.0
    static = recording.baseband.values[1200:, -3:] / unit_v
    noise = np.sqrt(np.mean(np.abs(np.diff(static, axis=0)) ** 2) / 2)
    assert 20 * np.log10(noise) == pytest.approx(-97.0, abs=3.0)
    smooth = np.abs(np.diff(recording.baseband.values, axis=1)).mean()
    mixed = read_xethru_recording(folder, iq="interleaved", **frame).baseband.values
    assert smooth < 0.7 * np.abs(np.diff(mixed, axis=1)).mean()
