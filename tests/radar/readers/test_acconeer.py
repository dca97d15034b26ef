"""Files of Acconeer's exploration tool, made here with h5py after the vendor's layout."""

from contextlib import nullcontext

import numpy as np
import pytest

from acconeer_file import subsweep, write_a111, write_file
from doppelgait.core.errors import DoppelgaitWarning, RecordingError
from doppelgait.radar.readers import find_formats, read_recording


def test_values_axes_and_times(tmp_path):
    rng = np.random.default_rng(1)
    values = rng.integers(-32768, 32767, (3, 4, 6)) + 1j * rng.integers(-32768, 32767, (3, 4, 6))
    path = write_file(tmp_path / "a.h5", values)
    recording = read_recording(path)
    # the vendor's phase grows with distance: conjugated, approaching is positive
    np.testing.assert_allclose(recording.baseband.values, values.reshape(12, 6).conj() / 32768, rtol=1e-6)
    as_stored = read_recording(path, conjugate=False)
    np.testing.assert_array_equal(as_stored.baseband.values, recording.baseband.values.conj())
    np.testing.assert_allclose(recording.baseband.range.values, 0.5 + 0.06 * np.arange(6))
    np.testing.assert_allclose(recording.radar.range_axis_m(), 0.5 + 0.06 * np.arange(6))
    expected = [0.05 * frame + sweep / 2000.0 for frame in range(3) for sweep in range(4)]
    np.testing.assert_allclose(recording.baseband.slow_time.values, expected, atol=1e-12)
    assert recording.baseband.attrs["burst_pulses"] == 4
    assert recording.radar.prf_hz == 2000.0
    assert recording.radar.carrier_hz == 60.5e9
    assert any("the maximum for these settings, 2000 Hz" in note for note in recording.notes)


FRAMES_S = 0.05 * np.arange(9)
LATE = np.array([0, 1, 2, 3, 5, 6, 7, 8, 9])
CONTINUOUS = {"sweep_rate": 1000.0, "continuous_sweep_mode": True, "frame_rate": None}


@pytest.mark.parametrize(
    ("config", "ticks", "starts_s", "note"),
    [
        (CONTINUOUS, 16_016 * np.arange(9), 0.016 * np.arange(9), "ticks it is 999.001 Hz"),  # by the recorder's clock
        ({"sweep_rate": 2000.0}, 50_000 * LATE, 0.05 * LATE, "recorder's ticks"),
        ({"frame_rate": None}, (2**32 - 120_000 + 50_000 * np.arange(9)) % 2**32, FRAMES_S, "recorder's ticks"),
        ({}, np.zeros(9), FRAMES_S, "ticks are not usable"),
    ],
    ids=["continuous", "late", "the ticks wrap", "no ticks"],
)
def test_times_of_frames(tmp_path, config, ticks, starts_s, note):
    path, is_late = write_file(tmp_path / "a.h5", config=config, ticks=ticks), np.ptp(np.diff(starts_s)) > 0.01
    late = "frames came late or are missing"
    with pytest.warns(DoppelgaitWarning, match=late) if is_late else nullcontext():
        recording = read_recording(path)
    np.testing.assert_allclose(recording.baseband.slow_time.values[::16], starts_s)
    assert ("burst_pulses" in recording.baseband.attrs) is (config is not CONTINUOUS)
    assert any(note in text for text in recording.notes)


def test_subsweeps_follow_one_another(tmp_path):
    subsweeps = [subsweep(num_points=2), subsweep(num_points=3, start_point=400, step_length=40, profile="PROFILE_5")]
    values = np.arange(2 * 3 * 5).reshape(2, 3, 5) * (1 + 0j)
    path = write_file(tmp_path / "a.h5", values, subsweeps=subsweeps)
    second = read_recording(path, subsweep=1)
    np.testing.assert_allclose(second.baseband.values * 32768, values.reshape(6, 5)[:, 2:])
    np.testing.assert_allclose(second.baseband.range.values, [1.0, 1.1, 1.2])
    assert read_recording(path, subsweep=0).baseband.shape == (6, 2)
    with pytest.raises(RecordingError, match=r"2 subsweeps; give subsweep = 0 to 1 \(0: profile 3, 2 points"):
        read_recording(path)
    with pytest.raises(RecordingError, match="subsweep = 2 is not allowed"):
        read_recording(path, subsweep=2)


def test_groups_entries_and_sessions(tmp_path):
    path = write_file(tmp_path / "a.h5", place="group_1/entry_2", sensor="3", root="sessions/session_1")
    assert read_recording(path, session=1, group=1, entry=2).baseband.shape == (144, 6)
    with pytest.raises(RecordingError, match="holds no session_0; there is session_1"):
        read_recording(path)
    with pytest.raises(RecordingError, match="holds no entry_0; there is entry_2"):
        read_recording(path, session=1, group=1)
    for options in ({"group": -1}, {"sweep_rate_hz": 0}, {"full_scale_v": np.nan}):
        with pytest.raises(RecordingError, match="is not allowed; it must be a"):
            read_recording(path, **options)
    older = write_file(tmp_path / "b.h5", root="session")
    assert find_formats(older) == ["acconeer"]
    assert read_recording(older).baseband.shape == (144, 6)


def test_saturation_is_told(tmp_path):
    flags = np.arange(9) < 2
    with pytest.warns(DoppelgaitWarning, match="saturation in 2 of 9 frames"):
        recording = read_recording(write_file(tmp_path / "a.h5", data_saturated=flags, frame_delayed=flags))
    assert any("2 of 9 frames as late" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"generation": "a111"}, "generation 'a111'; only 'a121'"),
        ({"config": {"sweeps_per_frame": 7}}, r"shape \(9, 16, 6\), its configuration says .* \(frames, 7, 6\)"),
        ({"config": {"sweep_rate": 200.0}}, "take longer than from one frame to the next"),
        ({"metadata": {"max_sweep_rate": 0.0}}, "give sweep_rate_hz"),
        ({"metadata": {"base_step_length_m": "x"}}, "base_step_length_m: 'x'"),
        ({"subsweeps": [subsweep(profile="PROFILE_9")]}, "profile: 'PROFILE_9'"),
        ({"sensor": "2"}, "does not name sensor 2"),
        ({"ticks": np.arange(4)}, "4 ticks for 9 frames"),
        ({"values": np.ones((1, 1, 6))}, "a single sweep"),
        ({"ticks": np.zeros(9), "config": {"frame_rate": None}}, "no frame rate is stored"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path, how, message):
    path = write_file(tmp_path / "a.h5", **how)
    with pytest.raises(RecordingError, match=message):
        read_recording(path)


def test_facts_that_are_not_stored(tmp_path):
    none = {"max_sweep_rate": None, "base_step_length_m": None}
    recording = read_recording(write_file(tmp_path / "a.h5", metadata=none), sweep_rate_hz=800.0)
    assert recording.radar.prf_hz == 800.0
    assert recording.baseband.range.values[0] == pytest.approx(0.5)
    assert any("0.0025 m is taken" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("mode", "session"),
    [("iq", {}), ("iq", {"step_length_m": None}), ("sparse", {}), ("sparse", {"sweep_rate": 800.0})],
)
def test_the_older_sensor_is_read(tmp_path, mode, session):
    path = write_a111(tmp_path / "a.h5", mode, session=session)
    assert find_formats(path) == ["acconeer-a111"]
    recording = read_recording(path)
    assert recording.samples.shape == (200, 3)
    assert recording.radar.prf_hz == pytest.approx(100.0)
    np.testing.assert_allclose(recording.range_m, [0.3, 0.36, 0.42])
    assert recording.facts.get("one_output", False) is (mode == "sparse")
    spectrum = np.abs(np.fft.fft(recording.samples.matrix[:, 1]))
    assert spectrum.argmax() in ((200 - 24,) if mode == "iq" else (24, 200 - 24))  # conjugated


def test_sweeps_of_the_older_sensor_are_bursts(tmp_path):
    data = np.random.default_rng(1).integers(30_000, 35_000, (10, 2, 16, 4)).astype(np.uint16)
    path = write_a111(tmp_path / "a.h5", "sparse", data=data, session={"sweep_rate": 4000.0})
    recording = read_recording(path, sensor=1)
    assert recording.facts["burst_pulses"] == 16
    np.testing.assert_allclose(np.diff(recording.slow_time_s)[[0, 15]], [1 / 4000.0, 0.01 - 15 / 4000.0])
    np.testing.assert_allclose(recording.samples.matrix.real, (data[:, 1].reshape(-1, 4) - 2.0**15) / 2**15, atol=1e-7)


@pytest.mark.parametrize(
    ("changes", "options", "said"),
    [
        ({"mode": "envelope"}, {}, "is of the service 'envelope', which has no phase; record IQ or sparse"),
        ({"config": {"update_rate": None}}, {}, "states no update_rate.*give frame_rate_hz"),
        ({"data": np.ones((9, 1))}, {}, r"data of the service iq have the shape \(9, 1\)"),
        ({}, {"sensor": 1}, "sensor = 1 is not allowed; give sensor = 0 to 0"),
        ({"session": {"range_start_m": None}}, {}, "is damaged or not a recording of an A111"),
    ],
)
def test_what_the_older_sensor_does_not_give_is_named(tmp_path, changes, options, said):
    with pytest.raises(RecordingError, match=said):
        read_recording(write_a111(tmp_path / "a.h5", **changes), **options)
