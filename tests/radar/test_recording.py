"""Parts of a recording, and what no recording can be."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from doppelgait.core.errors import ConfigError, RecordingError
from doppelgait.core.rng import rng
from doppelgait.motion import generate
from doppelgait.pipeline import simulate
from doppelgait.radar import Radar, Recording, concat, read_recording, write_recording
from doppelgait.scene import Scene, Target


@pytest.fixture(scope="module")
def walk() -> Recording:
    motion = generate("human", duration_s=3.0)
    return simulate(Scene(targets=[Target(motion=motion)]), Radar.preset("x4", prf_hz=500.0), rng=rng(1))


def test_a_part_has_the_pulses_from_start_to_just_before_stop_and_their_truth(walk):
    part = walk.between(0.5, 1.25)
    np.testing.assert_array_equal(part.slow_time_s, np.arange(250, 625) / 500.0)
    np.testing.assert_array_equal(part.baseband.values, walk.baseband.values[250:625])
    assert part.radar == walk.radar
    assert part.noise_power_v2 == walk.noise_power_v2
    assert np.isnan(part.snr_frame_db)
    assert np.isfinite(walk.snr_frame_db)
    truth, whole = part.truth[0], walk.truth[0]
    np.testing.assert_array_equal(truth.centre_range_m, whole.centre_range_m[250:625])
    np.testing.assert_array_equal(truth.scatterers["range"].values, whole.scatterers["range"].values[250:625])
    assert truth.label == whole.label
    assert truth.ground_speed_mps == whole.ground_speed_mps
    times_s = truth.body["time"].values
    assert times_s.min() >= 0.5
    assert times_s.max() < 1.25
    assert times_s.size == round(0.75 * 500 / 9)


def test_bursts_stay_whole(walk):
    bursts = walk.with_baseband(walk.baseband.assign_attrs(burst_pulses=100), truth=())
    np.testing.assert_array_equal(bursts.between(0.1, 0.95).slow_time_s, np.arange(100, 400) / 500.0)
    assert bursts.between(0.0, 9.0).n_pulses == walk.n_pulses
    with pytest.raises(ConfigError, match=r"between 0\.1 and 0\.3 s are 0 pulses"):
        bursts.between(0.1, 0.3)


@pytest.mark.parametrize(
    ("start_s", "stop_s", "said"),
    [
        *((start_s, 1.0, "the times must rise, for example 2 and 6 s") for start_s in (2.0, 1.0, float("nan"))),
        (5.0, 6.0, r"between 5 and 6 s are 0 pulses, .* 1500 from 0 to 2\.998 s"),
    ],
)
def test_times_must_rise_and_lie_in_the_recording(walk, start_s, stop_s, said):
    with pytest.raises(ConfigError, match=said):
        walk.between(start_s, stop_s)


def rewritten(path, walk, change):
    """The recording in a file, changed there."""
    write_recording(walk.between(0.0, 0.2), path)
    with h5py.File(path, "r+") as file:
        change(file)
    return path


def put(key, place, value):
    def change(file):
        values = file[key][()]
        values.reshape(-1)[place] = value
        file[key][...] = values

    return change


NUMBERS = [
    "slow_time_s",
    "range_m",
    *(f"truth/0/{n}" for n in ("range_m", "centre_range_m", "body_time_s", "body_position_m")),
]


def retyped(key, code):
    return lambda file: (file.move(key, "old"), file.__setitem__(key, file["old"][()].astype(code)))


def attribute(key, value):
    return lambda file: file.attrs.__setitem__(key, value)


def times_by(factor):
    def change(file):
        file["slow_time_s"][...] = file["slow_time_s"][()] * factor

    return change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (put("baseband", 7, np.nan), "1 of 18800 values are NaN, infinite"),
        (put("slow_time_s", 5, 0.0), r"slow_time_s\[5\] is 0, .* it must rise, and the one before is 0.008"),
        (put("slow_time_s", 5, np.nan), r"slow_time_s\[5\] is nan"),
        (put("range_m", -1, 1e30), r"range_m\[\d+\] is 1e\+30, .* allowed are -1000 to 1e\+06"),
        (put("range_m", 0, 99.0), r"range_m\[1\] is .* must rise, and the one before is 99"),
        (times_by(10.0), r"prf_hz is 500, .* the pulses are 0\.02 s apart, which is 50 Hz"),
        (attribute("noise_power_v2", -1e-9), "noise_power_v2 is -1e-09, .* 0 or more"),
        (attribute("radar_tilt_deg", np.nan), "the pose of the radar is"),
        (attribute("radar_position_m", [1.0, 2.0]), "is damaged or not a doppelgait recording"),
        (attribute("radar_position_m", "here"), "is damaged or not a doppelgait recording"),
        (put("truth/0/centre_range_m", 3, np.nan), "centre_range_m of truth 0 is not finite or too large"),
        *((attribute("radar", text), "") for text in ("not JSON", "[1, 2]", "12", "{}", 3.5)),
        *((attribute("format_version", version), "") for version in (99, "new")),
        *((lambda file, key=key: file.__delitem__(key), "") for key in ("baseband", "range_m", "truth/0/range_m")),
        (lambda file: file.attrs.__delitem__("format_version"), ""),
        (lambda file: (file.__delitem__("range_m"), file.__setitem__("range_m", np.arange(3.0))), ""),
        (lambda file: (file.__delitem__("baseband"), file.create_group("baseband")), ""),
        (lambda file: (file.__delitem__("baseband"), file.__setitem__("baseband", np.zeros(5, np.complex64))), ""),
        *(
            (retyped(key, code), f".* {key.rpartition('/')[2]} holds .*must be real")
            for key in NUMBERS
            for code in ("f2", "c8", "S")
        ),
        (lambda file: (file.__delitem__("slow_time_s"), file.__setitem__("slow_time_s", "text")), ""),
        (lambda file: (file.__delitem__("truth"), file.__setitem__("truth", 3)), ""),
        (lambda file: file["truth"].create_group("first"), ""),
        (lambda file: file["truth/0"].attrs.__delitem__("label"), ""),
        *((lambda file, part=part: file["truth/0"].attrs.__setitem__("part", part), "") for part in ("no JSON", "3")),
        (lambda file: file["truth/0"].attrs.__setitem__("height_m", [1.0, 2.0]), ""),
    ],
)
def test_a_file_of_what_no_radar_can_have_is_refused_with_its_key(tmp_path, walk, change, said):
    path = rewritten(tmp_path / "a.h5", walk, change)
    with pytest.raises(RecordingError, match=rf"a\.h5: {said}"):
        read_recording(path)


@pytest.mark.parametrize(
    "change",
    [
        times_by(0.96),
        put("range_m", 0, -900.0),
        attribute("noise_power_v2", 0.0),
        put("truth/0/centre_aspect_rad", 3, np.nan),  # a body that stands still
        attribute("noise_power_v2", np.nan),
    ],
)
def test_what_some_radar_can_have_is_read(tmp_path, walk, change):
    assert read_recording(rewritten(tmp_path / "a.h5", walk, change)).n_pulses == 100


IQ = np.exp(2j * np.pi * 0.15 * np.arange(300)).astype(np.complex64)


@pytest.mark.parametrize(
    ("values", "options", "shape", "prf_hz"),
    [
        (IQ, {"prf_hz": 500.0, "carrier_hz": 24e9}, (300, 1), 500.0),
        (np.stack([IQ.real, IQ.imag], axis=-1), {"prf_hz": 500.0, "carrier_hz": 24e9}, (300, 1), 500.0),
        (IQ[:, None] * [1, 2], {"radar": "x4", "prf_hz": 500.0}, (300, 2), 500.0),
        (IQ[:, None] * [1, 2], {"radar": Radar.preset("x4"), "range_m": [1.0, 1.2]}, (300, 2), 1000.0),
        (IQ, {"carrier_hz": 24e9, "slow_time_s": 9.0 + np.arange(300) / 80.0}, (300, 1), 80.0),
        (IQ.real, {"prf_hz": 500.0, "carrier_hz": 24e9}, (300, 1), 500.0),
    ],
)
def test_a_recording_of_a_plain_array(values, options, shape, prf_hz):
    recording = Recording.from_array(values, **options)
    assert recording.samples.shape == shape
    assert recording.radar.prf_hz == pytest.approx(prf_hz)
    real = values.ndim == 1 and values.dtype.kind == "f"
    np.testing.assert_allclose(recording.samples.matrix[:, 0], IQ.real if real else IQ, atol=1e-6)
    assert recording.facts.get("one_output", False) is real


@pytest.mark.parametrize(
    ("values", "options", "said"),
    [
        (IQ, {"prf_hz": 500.0}, r"array: carrier_hz is stated nowhere; give carrier_hz=... "),
        (IQ.reshape(3, 10, 10), {"prf_hz": 500.0, "carrier_hz": 24e9}, r"has the shape \(3, 10, 10\)"),
        (IQ, {"prf": 500.0, "carrier_hz": 24e9}, "prf: unknown key; allowed are .*prf_hz"),
        (IQ, {"radar": "xband-cw", "carrier_hz": 24e9}, "array: carrier_hz = 2.4e.10 is that of another radar than xb"),
    ],
)
def test_what_a_plain_array_lacks_is_named(values, options, said):
    with pytest.raises(RecordingError, match=said):
        Recording.from_array(values, **options)


def test_recordings_are_joined_with_the_pause_between_them():
    first = Recording.from_array(IQ, prf_hz=500.0, carrier_hz=24e9)
    late = Recording.from_array(IQ, slow_time_s=2.0 + np.arange(300) / 500.0, carrier_hz=24e9)
    late = replace(late, radar=first.radar)
    joined = concat([first, late])
    np.testing.assert_allclose(joined.slow_time_s, [*first.slow_time_s, *late.slow_time_s])
    np.testing.assert_array_equal(joined.samples.matrix[300:, 0], IQ)
    np.testing.assert_allclose(np.diff(concat([late, first], gap_s=0.5).slow_time_s)[299], 0.5 + 1 / 500.0)
    np.testing.assert_allclose(np.diff(concat([first, first], gap_s=0).slow_time_s), 1 / 500.0)


@pytest.mark.parametrize(
    ("change", "options", "said"),
    [
        ({}, {}, "begins at 0 s, but the one before ends at 0.598 s; give gap_s"),
        ({}, {"gap_s": -1.0}, "gap_s = -1.0 is not allowed"),
        ({"range_m": np.array([3.0])}, {"gap_s": 0.0}, "has other ranges"),
        ({"radar": Radar.preset("xband-cw")}, {"gap_s": 0.0}, "is of another radar"),
    ],
)
def test_what_cannot_be_joined_is_named(change, options, said):
    first = Recording.from_array(IQ, prf_hz=500.0, carrier_hz=24e9)
    with pytest.raises(RecordingError, match=said):
        concat([first, replace(first, **change)], **options)


def test_other_samples_do_not_keep_the_truth_of_more_pulses(walk):
    half = walk.baseband.isel(slow_time=slice(0, 100))
    with pytest.raises(RecordingError, match=r"have 100 pulses, but the truth has 1500.*truth=\(\)"):
        walk.with_baseband(half)
    assert walk.with_baseband(half, truth=()).n_pulses == 100
