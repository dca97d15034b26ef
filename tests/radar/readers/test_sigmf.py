"""SigMF pairs, our own and foreign ones, against the specification's rules and the sigmf package where it is there."""

import json
import tarfile
from contextlib import nullcontext

import numpy as np
import pytest

from doppelgait.core.errors import DoppelgaitWarning, OutputError, RecordingError
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.radar import Radar, read_recording
from doppelgait.radar.readers import find_formats
from doppelgait.radar.readers.sigmf import write_sigmf
from doppelgait.radar.recording import Recording, TargetTruth

RADAR = Radar(
    carrier_hz=7.29e9, prf_hz=500.0, sample_rate_hz=2.9e9, range_start_m=1.0, range_stop_m=1.4, bandwidth_hz=1.4e9
)
BURSTS_S = (0.1 * np.arange(4)[:, None] + np.arange(10) / 500.0).ravel()
TURN = np.exp(0.3j * np.arange(400)).astype(np.complex64)


def make_recording(slow_time_s=None, truth=(), **attrs):
    rng = np.random.default_rng(0)
    range_m = RADAR.range_axis_m() + 0.003  # the axis counts, not what the radar's parameters say
    times = 0.25 + np.arange(40) / 500.0 if slow_time_s is None else slow_time_s
    values = rng.normal(size=(times.size, range_m.size)) + 1j * rng.normal(size=(times.size, range_m.size))
    baseband = make_array(BASEBAND, values.astype(np.complex64), {"slow_time": times, "range": range_m}, attrs)
    return Recording.from_baseband(
        baseband, RADAR, truth=truth, noise_power_v2=2.5e-9, seed=7, source="made", notes=("assumed x",)
    )


def foreign(folder, values, *captures, datatype="cf32_le", rate_hz=1000.0, frequency=24e9, **changes):
    """A pair of another program's; ``values`` as they stand in the file."""
    (folder / "other.sigmf-data").write_bytes(values.tobytes())
    common = {"core:datatype": datatype, "core:version": "1.0.0", "core:sample_rate": rate_hz, **changes}
    meta = {
        "global": {key: value for key, value in common.items() if value is not None},
        "captures": [{"core:frequency": frequency, **capture} for capture in captures or [{"core:sample_start": 0}]],
        "annotations": [{"core:sample_start": 0, "core:label": "walk"}],
    }
    (folder / "other.sigmf-meta").write_text(json.dumps(meta))
    return folder / "other.sigmf-meta"


def read_meta(folder):
    return json.loads((folder / "walk.sigmf-meta").read_text())


@pytest.mark.parametrize("name", ["walk", "walk.sigmf-data"])
@pytest.mark.parametrize("facts", [{}, {"slow_time_s": BURSTS_S, "burst_pulses": 10}])
def test_round_trip(tmp_path, name, facts):
    recording = make_recording(**facts)
    recording.baseband.attrs |= {"lost_frame_share": 0.02, "epoch_s": 1.7e9}
    write_sigmf(recording, tmp_path / name)
    rows = [capture["core:sample_start"] // recording.n_range_bins for capture in read_meta(tmp_path)["captures"]]
    assert rows == ([0, 10, 20, 30] if facts else [0])  # pauses are captures
    for ending in ("sigmf-meta", "sigmf-data"):
        path = tmp_path / f"walk.{ending}"
        assert find_formats(path) == ["sigmf"]
        again = read_recording(path)
        assert np.array_equal(again.baseband.values, recording.baseband.values)
        assert np.array_equal(again.baseband.range.values, recording.baseband.range.values)
        np.testing.assert_allclose(again.baseband.slow_time.values, recording.baseband.slow_time.values, atol=1e-12)
        assert again.baseband.attrs == recording.baseband.attrs
        assert again.radar == recording.radar
        assert (again.noise_power_v2, again.seed) == (2.5e-9, 7)
        assert np.isnan(again.snr_frame_db)
        assert again.notes[0] == "assumed x"


def test_the_sigmf_package_takes_them(tmp_path):
    sigmf = pytest.importorskip("sigmf")
    recording = make_recording(slow_time_s=BURSTS_S, burst_pulses=10)
    for datatype in ("cf32_le", "ci16_le"):
        write_sigmf(recording, tmp_path / datatype, datatype=datatype)
        theirs = sigmf.fromfile(str(tmp_path / f"{datatype}.sigmf-meta"))  # checks the checksum
        theirs.validate()
        samples = theirs.read_samples().reshape(recording.baseband.shape)
        scale = theirs.get_global_info()["doppelgait:scale_v"]
        if datatype == "ci16_le":  # it gives integers as fractions of 2^15
            np.testing.assert_allclose(samples * 2**15 * scale, recording.baseband.values, atol=scale)
        else:
            assert np.array_equal(samples, recording.baseband.values)
        assert len(theirs.get_captures()) == 4


def test_sixteen_bit(tmp_path):
    recording = make_recording()
    write_sigmf(recording, tmp_path / "walk", datatype="ci16_le")
    flat = recording.baseband.values.ravel()
    largest = max(np.abs(flat.real).max(), np.abs(flat.imag).max())
    assert (tmp_path / "walk.sigmf-data").stat().st_size == 4 * flat.size
    again = read_recording(tmp_path / "walk.sigmf-meta").baseband.values.ravel()
    np.testing.assert_allclose(again, flat, atol=largest / 32767)
    with pytest.raises(RecordingError, match="datatype = 'cf64'"):
        write_sigmf(recording, tmp_path / "walk", datatype="cf64")


def test_labels_are_kept_and_the_truth_is_not(tmp_path):
    nothing = np.zeros(40)
    truth = [TargetTruth(label, None, nothing, nothing, nothing, gait="trot") for label in ("human", "dog")]
    write_sigmf(make_recording(truth=truth), tmp_path / "walk")
    annotations = read_meta(tmp_path)["annotations"]
    assert [one["core:label"] for one in annotations] == ["human", "dog"]
    assert annotations[0]["core:sample_count"] == make_recording().baseband.size
    again = read_recording(tmp_path / "walk.sigmf-meta")
    assert again.truth == ()
    assert "annotated: human, dog" in again.notes
    assert any("truth" in note for note in again.notes)


@pytest.mark.parametrize(
    ("datatype", "dtype", "unit"),
    [
        ("cf32_le", "<f4", 1.0),
        ("ci16_le", "<i2", 2.0**-15),
        ("cu8", "u1", 2.0**-7),
        ("ci32_le", "<i4", 2.0**-31),
    ],
)
@pytest.mark.parametrize("channel", [None, 1])
def test_foreign_samples(tmp_path, datatype, dtype, unit, channel):
    pairs = np.random.default_rng(1).integers(-100, 100, (30, 2, 2))
    stored = (pairs + 128 * (datatype == "cu8"))[:, slice(2) if channel else 0]
    path = foreign(tmp_path, stored.astype(dtype), datatype=datatype, **({"core:num_channels": 2} if channel else {}))
    recording = read_recording(path, channel=channel)
    i, q = pairs[:, channel or 0].T
    np.testing.assert_allclose(recording.baseband.values[:, 0], (i + 1j * q) * unit, rtol=1e-6)
    np.testing.assert_allclose(recording.baseband.slow_time.values, np.arange(30) / 1000.0)
    assert recording.radar.waveform.kind == "cw"
    assert recording.radar.carrier_hz == 24e9
    assert "annotated: walk" in recording.notes
    assert any(f"one unit of the samples is {unit} V" in note for note in recording.notes)


def test_options_of_foreign_files(tmp_path):
    pairs = np.arange(60, dtype="<f4").reshape(30, 2)
    flat = pairs[:, 0] + 1j * pairs[:, 1]
    path, facts = foreign(tmp_path, pairs, rate_hz=None), {"samples_per_pulse": 5, "bin_spacing_m": 0.1}
    recording = read_recording(
        path, prf_hz=200.0, range_start_m=2.0, carrier_hz=7e9, conjugate=True, scale_v=0.5, **facts
    )
    np.testing.assert_allclose(recording.baseband.values, 0.5 * flat.reshape(6, 5).conj())
    np.testing.assert_allclose(recording.baseband.range.values, [2.0, 2.1, 2.2, 2.3, 2.4])
    np.testing.assert_allclose(recording.radar.range_axis_m(), [2.0, 2.1, 2.2, 2.3, 2.4])
    assert recording.radar.range_resolution_m == pytest.approx(0.1)
    assert (recording.radar.carrier_hz, recording.radar.prf_hz) == (7e9, 200.0)
    rated = foreign(tmp_path, pairs, rate_hz=1000.0)
    assert read_recording(rated, **facts).radar.prf_hz == 200.0
    with pytest.warns(DoppelgaitWarning, match="the last pulse has 2 of 7 samples and is left out"):
        assert read_recording(rated, **facts | {"samples_per_pulse": 7}).baseband.shape == (4, 7)
    (tmp_path / "other.toml").write_text("carrier_hz = 9e9\n")  # as of plain arrays
    assert read_recording(rated, **facts).radar.carrier_hz == 9e9


def test_a_checksum_guards_the_samples(tmp_path):
    write_sigmf(make_recording(), tmp_path / "walk")
    data = tmp_path / "walk.sigmf-data"
    data.write_bytes(data.read_bytes()[:-20])
    with pytest.raises(RecordingError, match="core:sha512"):
        read_recording(data)
    with pytest.warns(DoppelgaitWarning, match="5 of 8"), pytest.warns(DoppelgaitWarning, match="is not whole"):
        assert read_recording(data, ignore_checksum=True).n_pulses == 39


@pytest.mark.parametrize(
    ("second", "options", "gap_s"),
    [
        ({"core:datetime": "2026-03-01T00:00:05.3Z"}, {}, 5.0),
        ({"core:datetime": "2026-03-01T00:00:05.3Z"}, {"prf_hz": 1000.0}, 5.0),
        ({"core:datetime": "2026-03-01T02:00:05.3+02:00"}, {}, 5.0),
        ({"core:datetime": "2026-03-01T00:00:01Z"}, {}, 0.0),  # to a second: nothing is known of a gap
        ({"core:global_index": 1200 + 2300, "core:datetime": "2026-03-01T00:00:01Z"}, {}, 2.0),
        ({}, {}, 0.0),
    ],
)
def test_a_gap_between_captures_is_a_gap_in_time(tmp_path, second, options, gap_s):
    first = {"core:sample_start": 0, "core:datetime": "2026-03-01T00:00:00.0Z", "core:global_index": 1200}
    undated = {"core:sample_start": 100, "core:global_index": 1300}
    path = foreign(tmp_path, TURN, first, undated, {"core:sample_start": 300, **second})
    with pytest.warns(DoppelgaitWarning, match="1 pause") if gap_s else nullcontext():
        recording = read_recording(path, **options)
    wanted_s = np.arange(400) / 1000.0 + gap_s * (np.arange(400) >= 300)
    np.testing.assert_allclose(recording.slow_time_s, wanted_s, atol=1e-4)


@pytest.mark.parametrize("order", ["le", "be"])
def test_two_real_channels_are_i_and_q_on_request_and_one_has_no_direction(tmp_path, order):
    pairs = np.round(np.stack([TURN.real, TURN.imag], axis=-1) * 2**14).astype({"le": "<i2", "be": ">i2"}[order])
    path = foreign(tmp_path, pairs, datatype=f"ri16_{order}", **{"core:num_channels": 2})
    both, single = read_recording(path, channels="iq"), read_recording(path, channel=0)
    np.testing.assert_allclose(both.samples.matrix[:, 0], TURN / 2, atol=1e-4)
    np.testing.assert_allclose(single.samples.matrix[:, 0], TURN.real / 2, atol=1e-4)
    rows = read_recording(path, channel=0, samples_per_pulse=2, bin_spacing_m=0.1)  # two real numbers are no pair
    np.testing.assert_allclose(rows.samples.matrix, TURN.real.reshape(-1, 2) / 2, atol=1e-4)
    assert [one.facts.get("one_output", False) for one in (both, single, rows)] == [False, True, True]


def test_an_archive_is_read_and_only_its_two_files(tmp_path):
    wanted = read_recording(foreign(tmp_path, TURN))
    with tarfile.open(tmp_path / "a.sigmf", "w") as archive:
        archive.add(tmp_path / "other.sigmf-data", "walk/other.sigmf-data")
        archive.add(tmp_path / "other.sigmf-meta", "walk/other.sigmf-meta")
    assert find_formats(tmp_path / "a.sigmf") == ["sigmf"]
    assert np.array_equal(read_recording(tmp_path / "a.sigmf").baseband.values, wanted.baseband.values)
    with tarfile.open(tmp_path / "link.sigmf", "w") as archive:
        archive.add(tmp_path / "other.sigmf-meta", "other.sigmf-meta")
        link = tarfile.TarInfo("other.sigmf-data")
        link.type, link.linkname = tarfile.SYMTYPE, str(tmp_path / "other.sigmf-data")
        archive.addfile(link)
    (tmp_path / "half.sigmf").write_bytes((tmp_path / "a.sigmf").read_bytes()[:700])
    for name, message in (("link", r"holds no other\.sigmf-data"), ("half", r"half\.sigmf")):
        with pytest.raises(RecordingError, match=message):
            read_recording(tmp_path / f"{name}.sigmf")


def test_bytes_of_other_formats_around_the_samples_are_left_out(tmp_path):
    content = TURN.tobytes()
    noise = np.frombuffer(b"head" + content[:1600] + b"middle12" + content[1600:] + b"end", np.uint8)
    heads = ({"core:sample_start": 0, "core:header_bytes": 4}, {"core:sample_start": 200, "core:header_bytes": 8})
    path = foreign(tmp_path, noise, *heads, **{"core:trailing_bytes": 3})
    assert np.array_equal(read_recording(path).samples.matrix[:, 0], TURN)


@pytest.mark.parametrize(
    ("changes", "options", "message"),
    [
        ({"datatype": "rf32_le", "core:num_channels": 2}, {}, "holds 2 channels; give channel = 0 to 1; or"),
        ({"datatype": "cx9"}, {}, "core:datatype is 'cx9'"),
        ({"core:version": "0.0.2"}, {}, "is SigMF 0.0.2; only 1.x"),
        ({"rate_hz": None}, {}, "prf_hz is stated nowhere: no core:sample_rate"),
        ({"rate_hz": 20e6}, {}, "samples within pulses. Give samples_per_pulse"),
        ({"rate_hz": -1}, {}, "core:sample_rate is -1"),
        ({}, {"samples_per_pulse": 5}, "bin_spacing_m is stated nowhere: SigMF states no range axis"),
        ({"frequency": None}, {}, "carrier_hz is stated nowhere"),
        ({"core:num_channels": 0}, {}, "core:num_channels is 0"),
        ({"core:dataset": "../x.bin"}, {}, "must be the name of a file in the same folder"),
        ({"core:dataset": "x.bin"}, {}, r"x\.bin: no such file; it holds the samples of other\.sigmf-meta"),
        ({"core:trailing_bytes": -4}, {}, "core:trailing_bytes are damaged"),
        ({"values": np.array([1, np.nan] * 10, "<f4")}, {}, "NaN"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path, changes, options, message):
    path = foreign(tmp_path, **{"values": np.ones(20, dtype="<f4"), **changes})
    with pytest.raises(RecordingError, match=message):
        read_recording(path, **options)


def test_carriers_that_change_are_named(tmp_path):
    later = {"core:sample_start": 200, "core:frequency": 25e9}
    with pytest.raises(RecordingError, match=r"several carriers \(2\.4e\+10, 2\.5e\+10 Hz\)"):
        read_recording(foreign(tmp_path, TURN, {"core:sample_start": 0}, later))


def test_damaged_metadata_and_options_of_own_files(tmp_path):
    for text in ("[1]", "{", "[" * 100_000):
        (tmp_path / "other.sigmf-meta").write_text(text)
        with pytest.raises(RecordingError, match="damaged or no SigMF"):
            read_recording(tmp_path / "other.sigmf-meta", format="sigmf")
    with pytest.raises(RecordingError, match="no such file; a SigMF recording is a pair"):
        read_recording(tmp_path / "none.sigmf-data", format="sigmf")
    write_sigmf(make_recording(), tmp_path / "walk")
    with pytest.raises(RecordingError, match="states its own axes; leave out prf_hz"):
        read_recording(tmp_path / "walk.sigmf-meta", prf_hz=3.0)
    with pytest.raises(OutputError):
        write_sigmf(make_recording(), tmp_path / "no" / "walk")
