"""Recordings to XeThru files and back, and files whose records say little."""

import struct
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from doppelgait.core.errors import DoppelgaitWarning, RecordingError
from doppelgait.radar import Radar, Recording, xethru
from doppelgait.radar.simulate import label_baseband
from doppelgait.radar.xethru.convert import derive_frame_numbers

START = datetime(2026, 11, 21, 1, 8, 48, tzinfo=UTC)
VPU = 0.375


@pytest.fixture(scope="module")
def preset(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A sensor whose unit is 0.375 V."""
    path = tmp_path_factory.mktemp("preset") / "sensor.toml"
    path.write_text(
        "carrier_hz = 7.29e9\nsample_rate_hz = 23.328e9\ndecimation = 8\nprf_hz = 500\nrange_start_m = 0.4\n"
        f"range_stop_m = 3.0\nbandwidth_hz = 1.4e9\nvolts_per_unit = {VPU}\n"
    )
    return str(path)


def simulated(preset: str, *, prf_hz: float = 500.0, n_pulses: int = 200) -> Recording:
    """A point that comes nearer by 0.5 m/s from 1.8 m, by the closed form, and a little noise."""
    radar = Radar.preset(preset, prf_hz=prf_hz)
    time_s, range_m = np.arange(n_pulses) / prf_hz, radar.range_axis_m()
    at_m = 1.8 - 0.5 * time_s[:, None]
    values = 1e-3 * np.exp(-0.5 * ((range_m - at_m) / 0.1) ** 2 - 4j * np.pi * at_m / radar.wavelength_m)
    rng = np.random.default_rng(3)
    values = values + 1e-5 * (rng.normal(size=values.shape) + 1j * rng.normal(size=values.shape))
    return Recording.from_baseband(label_baseband(values.astype(np.complex64), time_s, radar), radar)


def there_and_back(recording: Recording, folder: Path, preset: str, name: str, **options: Any) -> Recording:
    made = xethru.write_xethru_recording(recording, folder, data_type=name, start_time=START, session_id="S")
    if name == "datafloat":
        options |= {"range_start_m": 0.4, "bin_spacing_m": recording.radar.bin_spacing_m, "carrier_hz": 7.29e9}
    return xethru.read_xethru_recording(made, radar=preset, **options)


FLOATS = ["baseband_iq", "radar_baseband_float", "datafloat", "baseband_ap"]


@pytest.mark.parametrize("name", FLOATS)
def test_floats_come_back_as_they_were(tmp_path: Path, preset: str, name: str) -> None:
    recording = simulated(preset)
    back = there_and_back(recording, tmp_path, preset, name)
    tolerance = 4e-7 if name == "baseband_ap" else 1.3e-7
    error = np.abs(back.baseband.values - recording.baseband.values)
    assert np.all(error <= tolerance * np.abs(recording.baseband.values))
    assert np.abs(back.baseband.range.values - recording.baseband.range.values).max() < 1e-6
    assert np.abs(back.baseband.slow_time.values - recording.baseband.slow_time.values).max() < 1e-9
    assert back.radar.prf_hz == pytest.approx(500.0, rel=1e-12)
    assert back.radar.carrier_hz == 7.29e9
    assert back.radar.n_range_bins == recording.radar.n_range_bins


def test_q15_is_right_to_half_a_step(tmp_path: Path, preset: str) -> None:
    recording = simulated(preset)
    back = there_and_back(recording, tmp_path, preset, "radar_baseband_q15")
    wanted = recording.baseband.values
    step = np.maximum(np.abs(wanted.real), np.abs(wanted.imag)).max(axis=1, keepdims=True) / 32767
    error = back.baseband.values - wanted
    assert np.all(np.abs(error.real) <= 0.505 * step)
    assert np.all(np.abs(error.imag) <= 0.505 * step)
    assert np.abs(error.real).max() > 0.4 * step.min()


@pytest.mark.parametrize("name", ["radar_rf_normalized", "radar_rf"])
def test_rf_comes_back_but_for_the_filter(tmp_path: Path, preset: str, name: str) -> None:
    recording = simulated(preset)
    steps = {"counts_per_unit": 1024.0 * 1e6} if name == "radar_rf" else {}
    made = xethru.write_xethru_recording(recording, tmp_path, data_type=name, start_time=START, session_id="S", **steps)
    back = xethru.read_xethru_recording(made, radar=preset, **steps)
    at_m = 1.8 - 0.5 * recording.baseband.slow_time.values[:, None]
    distance_m = back.baseband.range.values - at_m
    wanted = 1e-3 * np.exp(-0.5 * (distance_m / 0.1) ** 2 - 4j * np.pi * at_m / recording.radar.wavelength_m)
    near = np.abs(distance_m) < 0.15
    assert np.abs(back.baseband.values - wanted)[near].max() < 0.1e-3
    empty = (np.abs(distance_m) > 0.7).all(axis=0)
    assert np.abs(back.baseband.values.mean(axis=0)[empty]).max() < 5e-6  # nothing stands still there
    assert back.radar.prf_hz == pytest.approx(500.0)


def test_the_conjugate_on_request(tmp_path: Path, preset: str) -> None:
    recording = simulated(preset)
    plain = there_and_back(recording, tmp_path, preset, "baseband_iq")
    turned = there_and_back(recording, tmp_path / "b", preset, "baseband_iq", conjugate=True)
    assert np.array_equal(turned.baseband.values, plain.baseband.values.conj())
    made = xethru.write_xethru_recording(recording, tmp_path / "c", start_time=START, session_id="S", conjugate=True)
    again = xethru.read_xethru_recording(made, radar=preset, conjugate=True)
    assert np.array_equal(again.baseband.values, plain.baseband.values)


def test_counters_over_their_end_and_such_that_tell_nothing() -> None:
    assert derive_frame_numbers(np.array([2**32 - 2, 2**32 - 1, 1, 2, 5], dtype=np.uint32)).tolist() == [0, 1, 3, 4, 7]
    assert derive_frame_numbers(np.array([9, 9, 9], dtype=np.uint32)).tolist() == [0, 1, 2]
    assert derive_frame_numbers(np.array([5, 1, 2], dtype=np.uint32)).tolist() == [0, 1, 2]


def floats(folder: Path, values: Any, *, counters: Any = None, times_ms: Any = None) -> Path:
    counters = np.arange(1, len(values) + 1) if counters is None else counters
    times = 10 * np.arange(len(values)) if times_ms is None else times_ms
    records = xethru.make_records("datafloat", content_id=0, info=counters, values=values)
    timed = [xethru.TimedRecord(int(t), "datafloat", r.tobytes()) for t, r in zip(times, records, strict=True)]
    return xethru.write_xethru(folder, timed, start_time=START, session_id="S")


FRAME = {"range_start_m": 0.4, "bin_spacing_m": 0.05144033, "carrier_hz": 7.29e9}


def test_lost_frames_are_counted(tmp_path: Path) -> None:
    path = floats(tmp_path, np.ones((6, 4)), counters=[1, 2, 5, 6, 7, 9], times_ms=[0, 10, 40, 50, 60, 80])
    with pytest.warns(DoppelgaitWarning, match="3 of 9 pulses are missing at 2 places"):
        recording = xethru.read_xethru_recording(path, **FRAME)
    assert recording.radar.prf_hz == pytest.approx(100.0)
    assert recording.baseband.slow_time.values == pytest.approx(0.01 * np.arange(9))


def test_the_order_of_i_and_q(tmp_path: Path) -> None:
    path = floats(tmp_path, np.tile([1.0, 2.0, 3.0, 4.0], (3, 1)))
    unit_v = Radar.preset("x4").volts_per_unit or 1.0
    separate = xethru.read_xethru_recording(path, **FRAME).baseband.values[0] / unit_v
    assert separate == pytest.approx([1 + 3j, 2 + 4j])
    in_turn = xethru.read_xethru_recording(path, iq="interleaved", **FRAME).baseband.values[0] / unit_v
    assert in_turn == pytest.approx([1 + 2j, 3 + 4j])


def test_what_the_records_do_not_tell_must_be_given(tmp_path: Path) -> None:
    path = floats(tmp_path, np.ones((3, 4)), times_ms=[7, 7, 7])
    with pytest.raises(RecordingError, match=r"range_start_m, bin_spacing_m, carrier_hz, prf_hz; set .*0\.05144033"):
        xethru.read_xethru_recording(path)
    with pytest.raises(RecordingError, match=r"do not state prf_hz; set prf_hz \(17 in"):
        xethru.read_xethru_recording(path, **FRAME)
    recording = xethru.read_xethru_recording(path, prf_hz=25.0, **FRAME)
    assert recording.radar.prf_hz == 25.0
    assert recording.baseband.range.values == pytest.approx([0.4, 0.4 + 0.05144033])


def test_rf_floats(tmp_path: Path) -> None:
    n = np.arange(200)
    frames = np.tile(np.cos(2 * np.pi * 7.29 / 23.328 * n), (4, 1))
    recording = xethru.read_xethru_recording(
        floats(tmp_path, frames), kind="rf", **{**FRAME, "bin_spacing_m": 1.5e8 / 23.328e9}
    )
    assert recording.baseband.sizes == {"slow_time": 4, "range": (200 - 27) // 8 + 1}
    unit_v = Radar.preset("x4").volts_per_unit or 1.0
    assert np.abs(recording.baseband.values) == pytest.approx(0.7817 * unit_v, rel=2e-3)  # the chip's gain


def test_a_frame_that_starts_behind_the_radar(tmp_path: Path) -> None:
    recording = xethru.read_xethru_recording(floats(tmp_path, np.ones((3, 40))), **{**FRAME, "range_start_m": -0.437})
    assert recording.baseband.range.values[0] == -0.437
    assert recording.radar.range_start_m == 0.0
    assert recording.radar.n_range_bins == 20


def test_settings_that_change_are_refused(tmp_path: Path) -> None:
    head = {"bin_length_m": 0.05, "sample_rate_hz": 2.9e9, "carrier_hz": 7.29e9}
    records = [
        xethru.make_records(
            "baseband_iq", **head, frame_counter=k, range_start_m=0.4 if k < 3 else 0.6, i=[1, 2], q=[3, 4]
        )
        for k in range(1, 5)
    ]
    timed = [xethru.TimedRecord(10 * k, "baseband_iq", record.tobytes()) for k, record in enumerate(records)]
    path = xethru.write_xethru(tmp_path, timed, start_time=START, session_id="S")
    with pytest.raises(RecordingError, match=r"range_start_m changes from 0\.4 to 0\.6 at record 3 of 4"):
        xethru.read_xethru_recording(path)


def test_records_of_several_sizes_are_refused(tmp_path: Path) -> None:
    timed = [xethru.TimedRecord(k, "datafloat", struct.pack(f"<III{k}f", 0, k, k, *range(k))) for k in (2, 4)]
    path = xethru.write_xethru(tmp_path, timed, start_time=START, session_id="S")
    with pytest.raises(RecordingError, match="differ in size"):
        xethru.read_xethru_recording(path, **FRAME)


def test_several_types_and_none(tmp_path: Path) -> None:
    one = xethru.make_records("datafloat", content_id=0, info=1, values=[1, 2]).tobytes()
    iq = xethru.make_records(
        "baseband_iq", frame_counter=1, bin_length_m=0.05, sample_rate_hz=2.9e9, carrier_hz=7.29e9, range_start_m=0.4,
        i=[1], q=[2],
    ).tobytes()  # fmt: skip
    both = [xethru.TimedRecord(k, n, c) for k in (0, 10) for n, c in (("datafloat", one), ("baseband_iq", iq))]
    path = xethru.write_xethru(tmp_path, both, start_time=START, session_id="S")
    with pytest.raises(RecordingError, match="holds datafloat, baseband_iq; name one: data_type='datafloat'"):
        xethru.read_xethru_recording(path)
    assert xethru.read_xethru_recording(path, data_type="baseband_iq").baseband.shape == (2, 1)
    with pytest.raises(RecordingError, match="data_type = 'radar_rf' is not allowed"):
        xethru.read_xethru_recording(path, data_type="radar_rf")
    text = xethru.write_xethru(tmp_path, [xethru.TimedRecord(0, "sleep", b"a;b\n")], start_time=START, session_id="T")
    with pytest.raises(RecordingError, match="none of them gives a baseband"):
        xethru.read_xethru_recording(text)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"iq": "mixed"}, "'separate' or 'interleaved'"),
        ({"kind": "raw"}, "'baseband' or 'rf'"),
        ({"conjugate": 2}, "true or false"),
        ({"prf_hz": -1.0}, "prf_hz = -1.0"),
        ({"bin_spacing_m": float("nan")}, "bin_spacing_m = nan"),
        ({"radar": "nothing"}, "unknown radar preset"),
        ({"kind": "rf"}, "below half the sampling rate"),
        ({"kind": "rf", "bin_spacing_m": 0.00643004}, "shorter than"),
        ({"kind": "rf", "bin_spacing_m": 0.00643004, "filter": "box"}, "'hamming' and 'chip'"),
    ],
)
def test_options_that_are_not_allowed(tmp_path: Path, options: dict[str, Any], message: str) -> None:
    path = floats(tmp_path, np.ones((3, 4)))
    with pytest.raises(RecordingError, match=message) as caught:
        xethru.read_xethru_recording(path, **{**FRAME, **options})
    assert str(path) in str(caught.value)


def test_what_cannot_be_written(tmp_path: Path, preset: str) -> None:
    recording = simulated(preset, n_pulses=4)
    for name, message in (("databyte", "writable are"), ("radar_rf", "counts_per_unit")):
        with pytest.raises(RecordingError, match=message):
            xethru.write_xethru_recording(recording, tmp_path, data_type=name, start_time=START, session_id="S")
    bent = recording.baseband.assign_coords(range=recording.baseband.range.values**1.01)
    with pytest.raises(RecordingError, match="not uniform"):
        xethru.write_xethru_recording(
            Recording.from_baseband(bent, recording.radar), tmp_path, start_time=START, session_id="S"
        )
    loud = Recording.from_baseband((1e3 * recording.baseband).assign_attrs(units="V"), recording.radar)
    with pytest.warns(DoppelgaitWarning, match="clipped"):
        xethru.write_xethru_recording(
            loud, tmp_path, data_type="radar_rf", counts_per_unit=1e6, start_time=START, session_id="S"
        )
