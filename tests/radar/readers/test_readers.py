"""Recordings of other programs: how a reader is picked, X4 frames in MATLAB files, plain arrays, damaged files."""

import io
import warnings
import zipfile
from dataclasses import replace
from functools import partial

import h5py
import numpy as np
import pytest
import xarray as xr
from scipy.io import loadmat, savemat, whosmat
from scipy.signal import firwin

from doppelgait.core.errors import DoppelgaitWarning, OutputError, RecordingError
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.radar import Radar, Recording, TargetTruth, read_recording, write_recording
from doppelgait.radar.readers import RADAR_READERS, list_writers
from doppelgait.radar.readers.arrays import write_arrays
from doppelgait.radar.readers.matlab import list_variables

BIN_M = 0.00643004
"""RF bin of the X4, with its driver's speed of light."""
CARRIER_HZ = 7.29e9
RF_RATE_HZ = 3e8 / (2 * BIN_M)


def random_baseband(shape, seed=1):
    rng = np.random.default_rng(seed)
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)


def measured(shape=(20, 8), **facts):
    radar = Radar.preset("x4", prf_hz=25, range_start_m=0.5, range_stop_m=0.5 + shape[1] * 0.0514)
    coords = {"slow_time": np.arange(shape[0]) / 25.0, "range": 0.45 + 0.05144 * np.arange(shape[1])}
    baseband = make_array(BASEBAND, random_baseband(shape), coords, {"radar": "{}"})
    return Recording.from_baseband(baseband, radar, source="x", **facts)


def test_a_file_of_results_is_named_as_such(tmp_path):
    with h5py.File(tmp_path / "gait.h5", "w") as file:
        file.attrs.update(format="doppelgait-result", format_version=1)
    with pytest.raises(RecordingError, match=r"gait\.h5: .*holds results of doppelgait analyze, not a recording"):
        read_recording(tmp_path / "gait.h5")


def test_a_folder_without_a_name_is_refused_like_any_other(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for place in (".", "/"):
        with pytest.raises(RecordingError, match=r"not a recording"):
            read_recording(place)


def test_two_readers_for_one_file_are_an_error_and_format_settles_it(tmp_path, register):
    write_recording(measured(), tmp_path / "a.h5")
    own = RADAR_READERS["doppelgait"]
    register("radar_reader", "other", **own.facts)(own.run)
    with pytest.raises(RecordingError, match=r"could be doppelgait .*or other.*format='doppelgait'"):
        read_recording(tmp_path / "a.h5")
    assert read_recording(tmp_path / "a.h5", format="other").source == "a.h5"


def test_a_wrong_format_or_option_is_refused_with_what_is_allowed(tmp_path):
    assert set(list_writers()) == {"", ".dgf", ".h5", ".npz", ".sigmf-meta"}
    write_arrays(measured(), tmp_path / "a.npz")
    with pytest.raises(RecordingError, match=r"format = 'wave' is not known; known are: .*arrays"):
        read_recording(tmp_path / "a.npz", format="wave")
    with pytest.raises(RecordingError, match=r"the arrays reader has no option prf; allowed are radar, prf_hz"):
        read_recording(tmp_path / "a.npz", prf=3)
    with pytest.raises(RecordingError, match=r"a\.npz"):
        read_recording(tmp_path / "a.npz", format="doppelgait")
    with pytest.raises(RecordingError, match="no such file"):
        read_recording(tmp_path / "b" / "c.npz", format="arrays")


def test_our_own_file_keeps_notes_further_facts_and_the_phase_of_a_path(tmp_path):
    recording = measured(notes=["carrier_hz = 7.29e9: not in the file", "µ"])
    further = {"burst_pulses": 128, "gap_s": 0.15, "sensor": "A"}
    names = ("range", "radial_velocity", "rcs", "path_gain", "path_phase", "aspect")
    draws = {name: np.random.default_rng(n).uniform(size=(20, 2)) for n, name in enumerate(names)}
    values = {name: (("slow_time", "scatterer"), draws[name]) for name in names}
    coords = {
        "slow_time": recording.baseband["slow_time"].values,
        "target": ("scatterer", [0, 0]),
        "marker": ("scatterer", ["a", "b"]),
        "part": ("scatterer", ["torso", "head"]),
    }
    truth = TargetTruth("human", xr.Dataset(values, coords), *(np.zeros(20),) * 3)
    recording = replace(recording, truth=[truth])
    recording.baseband.attrs.update(further)
    write_recording(recording, tmp_path / "a.h5")
    again = read_recording(tmp_path / "a.h5")
    assert again.notes == recording.notes
    assert {key: again.baseband.attrs[key] for key in further} == further
    assert isinstance(again.baseband.attrs["burst_pulses"], int)
    for name in names:
        np.testing.assert_array_equal(again.truth[0].scatterers[name], draws[name])


def rf_frames(range_m, *, n_bins=400, start_m=0.7, amplitude=1.0):
    """Samples of ``a g(t - t0) cos(2 pi f_c (t - t0))`` for one target, E-16 written out; t counts with c = 3e8."""
    time_s = 2 * (start_m + BIN_M * np.arange(n_bins)) / 3e8
    delay_s = 2 * np.asarray(range_m)[:, None] / 3e8
    envelope = np.exp(-0.5 * ((time_s - delay_s) / 0.35e-9) ** 2)
    return amplitude * envelope * np.cos(2 * np.pi * CARRIER_HZ * (time_s - delay_s))


def matlab_content(frames, *, start_m=0.7, **changes):
    content = {
        "Data_Matrix": frames,
        "actual_fps": 25.0,
        "bin_length": BIN_M,
        "frame_start": start_m,
        "range_axis": start_m + BIN_M * np.arange(frames.shape[1]),
        "subject": "no one",
    }
    return {key: value for key, value in {**content, **changes}.items() if value is not None}


@pytest.fixture
def moving_target(tmp_path):
    """1 unit strong at 1.5 m, approaching at 0.1 m/s, 40 frames at 25 Hz."""
    range_m = 1.5 - 0.1 * np.arange(40) / 25.0
    savemat(tmp_path / "rf.mat", matlab_content(rf_frames(range_m)))
    return tmp_path / "rf.mat", range_m


def test_an_approaching_target_in_rf_frames_has_its_range_strength_and_positive_doppler(moving_target):
    path, range_m = moving_target
    recording = read_recording(path)
    baseband, axis_m = recording.baseband.values, recording.baseband["range"].values
    scale_v = recording.radar.volts_per_unit or 1.0
    np.testing.assert_allclose(np.diff(axis_m), 8 * BIN_M)
    peak = np.abs(baseband).argmax(axis=1)
    assert np.abs(axis_m[peak] - range_m).max() <= 4 * BIN_M * 1.01  # half a bin
    at_peak = np.abs(baseband).max() / scale_v
    taps = firwin(27, 1 / 16, window="hamming", fs=1.0)  # an envelope as short as the filter loses a little
    through = (taps * np.exp(-0.5 * (np.arange(-13, 14) / RF_RATE_HZ / 0.35e-9) ** 2)).sum()
    assert at_peak == pytest.approx(0.7817 * through, rel=0.03)  # in the unit of the chip, whose gain that is
    column = baseband[:, np.bincount(peak).argmax()]
    slope_hz = np.polyfit(np.arange(40) / 25.0, np.unwrap(np.angle(column)), 1)[0] / (2 * np.pi)
    assert slope_hz == pytest.approx(2 * 0.1 * CARRIER_HZ / 3e8, rel=0.02)
    # E-18: every bin of an echo has the phase -4 pi R / lambda; far from the peak other things show
    turned = baseband / np.exp(-4j * np.pi * range_m * CARRIER_HZ / 3e8)[:, None]
    assert np.abs(np.angle(turned[np.abs(baseband) > 0.1 * np.abs(baseband).max()])).max() < 0.01


def test_an_echo_has_the_same_volts_with_either_filter_and_the_radar_the_noise_of_that_one(tmp_path):
    path = tmp_path / "wave.mat"
    n = np.arange(400)
    savemat(path, {"Data_Matrix": np.tile(np.cos(2 * np.pi * 5 / 16 * n), (3, 1)), "actual_fps": 25.0,
                   "bin_length": BIN_M, "frame_start": 0.7})  # fmt: skip
    host, chip = (read_recording(path, filter=filter) for filter in ("hamming", "chip"))
    level_v = np.abs(host.baseband.values).mean()
    assert level_v == pytest.approx(np.abs(chip.baseband.values).mean(), rel=3e-3)
    # 1 unit of RF is 1024 steps of the threshold
    assert level_v == pytest.approx(1024 * Radar.preset("x4").threshold_step_v, rel=3e-3)
    assert chip.radar.noise_bandwidth_hz == Radar.preset("x4").noise_bandwidth_hz
    taps = firwin(27, 1 / 16, window="hamming", fs=1.0)
    assert host.radar.noise_bandwidth_hz == pytest.approx(23.328e9 * np.sum(taps**2) / np.sum(taps) ** 2, rel=1e-3)
    lags = [np.sum(taps[shift:] * taps[:-shift]) / np.sum(taps**2) for shift in (8, 16, 24)]
    np.testing.assert_allclose(host.radar.noise_correlation, lags, atol=1e-6)


def test_options_win_over_the_facts_of_a_matlab_recording(moving_target):
    recording = read_recording(moving_target[0])
    assert recording.baseband["range"].values[0] == pytest.approx(0.7 + 13 * BIN_M)  # centre of 27 taps
    assert recording.n_range_bins == recording.radar.n_range_bins == (400 - 27) // 8 + 1
    assert any("carrier_hz = 7.29e+09" in note for note in recording.notes)
    other = read_recording(moving_target[0], carrier_hz=8.748e9, prf_hz=50, range_start_m=1.0, radar="liland2018")
    assert other.radar.carrier_hz == 8.748e9
    assert other.baseband["slow_time"].values[1] == pytest.approx(0.02)
    assert other.baseband["range"].values[0] == pytest.approx(1.0 + 13 * BIN_M)


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("dtype", ["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "c16"])
def test_matrices_of_every_number_class_read_as_scipy_reads_them(tmp_path, dtype, packed):
    values = (np.arange(-6, 15).reshape(3, 7) * 11).astype("f8").astype(dtype, casting="unsafe")
    values = values * (1 - 2j) if dtype == "c16" else values
    content = {"a": values, "some_longer_name": values[:, :2], "text": "abc", "s": {"x": 1.0}, "one": 4.0}
    savemat(tmp_path / "m.mat", content, do_compression=packed, oned_as="row")
    found = list_variables(tmp_path / "m.mat", max_bytes=1 << 20)
    assert {name: one.shape for name, one in found.items()} == {
        name: shape for name, shape, _ in whosmat(tmp_path / "m.mat") if name != "text"
    } | {"text": (1, 3)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        wanted = loadmat(tmp_path / "m.mat")
    for name in ("a", "some_longer_name", "one"):
        again = found[name].load()
        np.testing.assert_array_equal(again, wanted[name])
        assert again.dtype == wanted[name].dtype


TURN = np.exp(2j * np.pi * 0.1 * np.arange(60))


def write_v73(path, content):
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in content.items():
            stored = np.atleast_2d(value).T  # MATLAB stores columns first
            if stored.dtype.kind == "c":
                stored = np.ascontiguousarray(stored).view([("real", "f8"), ("imag", "f8")])
            file[name] = stored
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Thu Jan  1 00:00:00 2026 HDF5 schema 1.00 .")


@pytest.mark.parametrize("write", [savemat, partial(savemat, format="4"), write_v73], ids=["5", "4", "7.3"])
@pytest.mark.parametrize(
    ("content", "options", "prf_hz", "n_bins"),
    [
        ({"data": TURN, "Fs": 200.0, "fc": 24e9}, {}, 200.0, 1),
        ({"I": TURN.real, "Q": TURN.imag, "fs": 200.0}, {"carrier_hz": 24e9}, 200.0, 1),
        ({"x": TURN, "t": 5.0 + np.arange(60) / 80.0, "fs": 200.0, "fc": 24e9}, {}, 80.0, 1),
        ({"x": TURN, "fs": 200.0, "prf": 100.0, "fc": 24e9}, {"prf_hz": 50.0}, 50.0, 1),
        ({"m": np.outer(TURN, [1, 2, 3]), "fs": 2e6, "prf": 90.0, "fc": 24e9, "range": [1.0, 1.5, 2.0]}, {}, 90.0, 3),
        (
            {"m": np.outer([1, 2, 3], TURN), "prf": 90.0, "fc": 24e9},
            {"time_first": False, "range_start_m": 1.0, "bin_spacing_m": 0.5},
            90.0,
            3,
        ),
    ],
)
def test_complex_samples_of_a_matlab_file(tmp_path, write, content, options, prf_hz, n_bins):
    write(tmp_path / "a.mat", content)
    recording = read_recording(tmp_path / "a.mat", **options)
    assert recording.samples.shape == (60, n_bins)
    assert recording.radar.prf_hz == pytest.approx(prf_hz)
    assert recording.radar.carrier_hz == 24e9
    np.testing.assert_allclose(recording.range_m, 1.0 + 0.5 * np.arange(n_bins) if n_bins > 1 else [0.0])
    np.testing.assert_allclose(recording.samples.matrix, np.outer(TURN, np.arange(n_bins) + 1), atol=1e-5)


def test_a_packed_matrix_that_takes_too_much_memory_is_refused(tmp_path, monkeypatch):
    savemat(tmp_path / "rf.mat", matlab_content(np.zeros((900, 400))), do_compression=True)
    monkeypatch.setenv("DOPPELGAIT_READ_LIMIT_MB", "1")
    with pytest.raises(RecordingError, match=r"rf\.mat: its values would take 6 MB of memory"):
        read_recording(tmp_path / "rf.mat")


def test_one_of_several_matrices_is_picked_by_name(tmp_path):
    frames = rf_frames([1.5, 1.5])
    content = matlab_content(frames, Data_Matrix=None, Data_Matrix_1=frames, Data_Matrix_2=2 * frames)
    savemat(tmp_path / "two.mat", content)
    with pytest.raises(RecordingError, match=r"holds Data_Matrix_1 and Data_Matrix_2; give matrix='Data_Matrix_1'"):
        read_recording(tmp_path / "two.mat")
    first, second = (read_recording(tmp_path / "two.mat", matrix=f"Data_Matrix_{n}").baseband.values for n in (1, 2))
    np.testing.assert_allclose(second, 2 * first, rtol=1e-6, atol=1e-30)
    with pytest.raises(RecordingError, match=r"has no matrix 'x'; it holds .*Data_Matrix_1"):
        read_recording(tmp_path / "two.mat", matrix="x")


FRAMES = rf_frames([1.5, 1.5])


@pytest.mark.parametrize(
    ("changes", "options", "said"),
    [
        ({"Data_Matrix": None, "other": 1.0}, {}, r"has no Data_Matrix.*; it holds .*other"),
        ({"actual_fps": None}, {}, r"has no actual_fps; give it: prf_hz=\.\.\."),
        ({"actual_fps": [1.0, 2.0]}, {}, r"actual_fps has 2 values"),
        ({"range_axis": None, "frame_start": None}, {}, r"or frame_start; give it: range_start_m=\.\.\."),
        ({"range_axis": np.arange(7.0)}, {}, r"range_axis has 7 values that are not the ranges of 400 bins"),
        ({"range_axis": 2 * BIN_M * np.arange(400.0)}, {}, r"are not the ranges of 400 bins, 0\.00643004 m apart"),
        ({"Data_Matrix": FRAMES + 0j}, {}, r"carrier_hz.* stated nowhere"),
        ({"Data_Matrix": FRAMES[:1]}, {}, r"holds 1 pulses of 400 range bins"),
        ({"Data_Matrix": np.where(np.arange(400) == 7, np.nan, FRAMES)}, {}, r"2 of 800 values are NaN.*bin 7"),
        ({"baseband": 1.0}, {}, r"baseband = 1"),
        ({}, {"carrier_hz": 12e9}, r"carrier_hz 1\.2e\+10 is not allowed"),
        ({}, {"radar": "x5"}, r"unknown radar preset 'x5'"),
        # facts of samples at baseband are taken only where there is one
        ({"x": TURN, "y": TURN, "fs": 200.0}, {}, r"not one complex variable; it holds .*give matrix='x'"),
        ({"x": TURN, "fs": 200.0, "prf": 100.0, "fc": 24e9}, {}, "prf_hz is stated nowhere"),
        ({"m": np.outer(TURN, [1, 2]), "fs": 2e6, "fc": 24e9}, {}, "prf_hz, range_start_m, bin_spacing_m are stated"),
    ],
)
def test_what_a_matlab_file_lacks_or_says_wrong_is_named(tmp_path, changes, options, said):
    is_baseband = "x" in changes or "m" in changes
    savemat(tmp_path / "rf.mat", changes if is_baseband else matlab_content(FRAMES, **changes))
    with pytest.raises(RecordingError, match=said):
        read_recording(tmp_path / "rf.mat", **options)


FACTS = "prf_hz = 100\ncarrier_hz = 24e9\nrange_start_m = 0.2\nbin_spacing_m = 0.04\n"
VALUES = np.round(random_baseband((12, 5)) * 100).astype(np.complex64)


def layouts():
    pairs = np.stack([VALUES.real, VALUES.imag], axis=-1)
    return {
        "complex": ({"baseband": VALUES}, ""),
        "only array": ({"anything": VALUES.astype(np.complex128)}, ""),
        "i and q": ({"i": VALUES.real, "q": VALUES.imag}, ""),
        "last axis": ({"baseband": pairs.astype(np.int32)}, ""),
        "columns": ({"baseband": VALUES.T}, "time_first = false\n"),
        "conjugate": ({"baseband": VALUES.conj()}, "conjugate = true\n"),
        "scaled": ({"baseband": VALUES * 8}, "scale_v = 0.125\n"),
        "by name": ({"a": VALUES, "b": 2 * VALUES}, 'key = "a"\n'),
        "big endian": ({"baseband": VALUES.astype(">c8")}, ""),
    }


@pytest.mark.parametrize("name", layouts())
def test_every_layout_of_an_array_is_the_same_recording(tmp_path, name):
    arrays, further = layouts()[name]
    np.savez(tmp_path / "a.npz", **arrays)
    (tmp_path / "a.toml").write_text(FACTS + further)
    recording = read_recording(tmp_path / "a.npz")
    np.testing.assert_array_equal(recording.baseband.values, VALUES)
    np.testing.assert_allclose(recording.baseband["slow_time"], np.arange(12) / 100)
    np.testing.assert_allclose(recording.baseband["range"], 0.2 + 0.04 * np.arange(5))
    assert (recording.radar.carrier_hz, recording.radar.prf_hz) == (24e9, 100)
    assert recording.radar.range_axis_m() == pytest.approx(recording.baseband["range"].values)
    assert recording.radar.range_resolution_m == pytest.approx(0.04)
    assert any("radar: not stated" in note for note in recording.notes)


def test_options_need_no_toml_file_and_win_over_one(tmp_path):
    np.save(tmp_path / "a.npy", VALUES)
    told = {"prf_hz": 50, "carrier_hz": 60e9, "range_start_m": -0.1, "bin_spacing_m": 0.02}
    recording = read_recording(tmp_path / "a.npy", **told)
    np.testing.assert_allclose(recording.baseband["range"], -0.1 + 0.02 * np.arange(5))
    (tmp_path / "a.toml").write_text(FACTS + "conjugate = true\n")
    other = read_recording(tmp_path / "a.npy", prf_hz=200, conjugate=False)
    assert (other.radar.prf_hz, other.radar.carrier_hz) == (200, 24e9)
    np.testing.assert_array_equal(other.baseband.values, VALUES)


def test_a_preset_tells_what_the_file_does_not(tmp_path):
    np.save(tmp_path / "a.npy", VALUES)
    recording = read_recording(tmp_path / "a.npy", radar="x4")
    x4 = Radar.preset("x4")
    assert (recording.radar.carrier_hz, recording.radar.n_range_bins) == (x4.carrier_hz, 5)
    np.testing.assert_allclose(recording.baseband["range"], x4.range_axis_m()[:5])
    (tmp_path / "a.toml").write_text('range_start_m = 0.4\n[radar]\npreset = "x4"\nprf_hz = 17\n')
    told = read_recording(tmp_path / "a.npy")
    assert told.radar.prf_hz == 17
    assert told.baseband["slow_time"].values[1] == pytest.approx(1 / 17)
    np.testing.assert_allclose(told.baseband["range"], 0.4 + x4.bin_spacing_m * np.arange(5))
    np.savez(tmp_path / "b.npz", baseband=VALUES, time_s=np.arange(12) / 100)
    assert "not read: time_s; times of pulses are named slow_time_s" in str(
        read_recording(tmp_path / "b.npz", radar="x4").notes
    )


def test_a_continuous_wave_preset_takes_one_range_bin(tmp_path):
    np.save(tmp_path / "a.npy", VALUES)
    np.save(tmp_path / "b.npy", VALUES[:, 0])
    with pytest.raises(RecordingError, match=r"has 5 range bins, but .* is a continuous wave with one"):
        read_recording(tmp_path / "a.npy", radar="xband-cw")
    assert read_recording(tmp_path / "b.npy", radar="xband-cw").radar.waveform.kind == "cw"


def test_axes_in_the_file_are_taken_as_they_are(tmp_path):
    bursts_s = np.concatenate([0.2 * n + np.arange(4) / 3000 for n in range(3)])
    range_m = np.array([0.1, 0.2, 0.31, 0.4, 0.5])
    np.savez(tmp_path / "a.npz", baseband=VALUES, slow_time_s=bursts_s, range_m=range_m)
    with pytest.warns(DoppelgaitWarning, match="its times show 3 bursts of 4 pulses at 3000 Hz"):
        recording = read_recording(tmp_path / "a.npz", carrier_hz=24e9)
    np.testing.assert_array_equal(recording.baseband["slow_time"], bursts_s)
    np.testing.assert_array_equal(recording.baseband["range"], range_m)
    assert recording.radar.prf_hz == pytest.approx(3000)
    for wrong_s in (bursts_s[::-1], [*bursts_s[:-1], 1e30], [*bursts_s[:-2], 1e308, 0.6]):
        np.savez(tmp_path / "b.npz", baseband=VALUES, slow_time_s=wrong_s, range_m=range_m)
        with pytest.raises(RecordingError, match="all equal, falling or too large"):
            read_recording(tmp_path / "b.npz", carrier_hz=24e9, prf_hz=3000)
    np.savez(tmp_path / "c.npz", baseband=VALUES, range_m=range_m[:4])
    with pytest.raises(RecordingError, match=r"range_m is float64 of shape \(4,\); it must be 5 real numbers"):
        read_recording(tmp_path / "c.npz", carrier_hz=24e9, prf_hz=3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("prf_hz = 100\n", r"a\.npy: range_start_m, bin_spacing_m are stated nowhere.*a\.toml"),
        ("prf = 100\n", r"a\.toml: prf \(line 1\): unknown key; allowed are .*prf_hz"),
        ("\nprf_hz = -4\n", r"a\.toml: prf_hz \(line 2\): -4 is not allowed"),
        ("prf_hz = \n", r"a\.toml: is not TOML"),
        ('[radar]\npreset = "x5"\n', r"unknown radar preset 'x5'"),
        ('[radar]\npreset = "x4"\ncarrier = 3\n', r"radar: carrier: unknown key"),
        (FACTS + "[attributes]\nburst_pulses = 'x'\n", "burst_pulses = 'x' is not allowed; it must be a whole"),
    ],
)
def test_faults_of_the_toml_file_are_named_with_their_line(tmp_path, text, said):
    np.save(tmp_path / "a.npy", VALUES)
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(RecordingError, match=said):
        read_recording(tmp_path / "a.npy", carrier_hz=24e9)


WITH_FAULTS = np.where((np.arange(12)[:, None] == 3) & (np.arange(5) >= 2), np.nan, VALUES)


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"baseband": WITH_FAULTS}, r"3 of 60 values are NaN.*pulse 3, range bin 2 "),
        ({"baseband": VALUES.astype(complex) * 1e300}, r"60 of 60 values are NaN, infinite or above 3\.4e38"),
        ({"baseband": VALUES.real}, r"holds real values of shape \(12, 5\).*I and Q along a last axis of 2"),
        ({"baseband": VALUES[:1]}, r"holds 1 pulses of 5 range bins"),
        ({"baseband": VALUES[:, :0]}, r"holds 12 pulses of 0 range bins"),
        ({"baseband": np.array(["a"] * 4)}, r"holds <U1 values"),
        ({"a": VALUES, "b": VALUES}, r"has no array 'baseband'.*it holds a, b: key='NAME'"),
        ({"i": VALUES.real, "q": VALUES.imag[:3]}, r"i is float32 of shape \(12, 5\) and q float32 of shape \(3, 5\)"),
    ],
)
def test_arrays_that_are_no_baseband_are_refused(tmp_path, arrays, said):
    np.savez(tmp_path / "a.npz", **arrays)
    (tmp_path / "a.toml").write_text(FACTS)
    with pytest.raises(RecordingError, match=said):
        read_recording(tmp_path / "a.npz")


def header_only(shape):
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<c8", "fortran_order": False, "shape": shape})
    return stream.getvalue()


def test_a_header_that_promises_more_than_there_is_takes_no_memory(tmp_path):
    (tmp_path / "a.toml").write_text(FACTS)
    for shape, said in (((10**6, 10**6), "would take 8,000,000 MB"), ((10**4, 10**3), "should hold 80000000")):
        (tmp_path / "a.npy").write_bytes(header_only(shape))
        with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
            archive.writestr("baseband.npy", header_only(shape))
        for name in ("a.npy", "a.npz"):
            with pytest.raises(RecordingError, match=said):
                read_recording(tmp_path / name)


def test_objects_are_never_unpickled(tmp_path):
    class Bomb:
        def __reduce__(self):
            return (open, (str(tmp_path / "exploded"), "w"))

    np.save(tmp_path / "a.npy", np.array([Bomb()], dtype=object), allow_pickle=True)
    (tmp_path / "a.toml").write_text(FACTS)
    with pytest.raises(RecordingError, match="never unpickled"):
        read_recording(tmp_path / "a.npy")
    assert not (tmp_path / "exploded").exists()


def test_written_arrays_read_back_identically(tmp_path):
    recording = measured(notes=['a note with "quotes", ümlaut, a\ttab and \x7f'], noise_power_v2=1e-13, seed=7)
    recording.baseband.attrs.update(burst_pulses=4, sensor='the "left" one')
    write_arrays(recording, tmp_path / "a.npz")
    again = read_recording(tmp_path / "a.npz")
    np.testing.assert_array_equal(again.baseband.values, recording.baseband.values)
    for name in ("slow_time", "range"):
        np.testing.assert_array_equal(again.baseband[name].values, recording.baseband[name].values)
    assert again.radar == recording.radar
    assert (again.notes, again.noise_power_v2, again.seed) == (recording.notes, 1e-13, 7)
    assert np.isnan(again.snr_frame_db)
    assert {k: again.baseband.attrs[k] for k in ("burst_pulses", "sensor")} == {
        "burst_pulses": 4, "sensor": 'the "left" one'
    }  # fmt: skip
    write_arrays(replace(recording, snr_frame_db=np.inf), tmp_path / "a.npz")  # replaces its own
    assert read_recording(tmp_path / "a.npz").snr_frame_db == np.inf
    with np.load(tmp_path / "a.npz") as plain:
        assert plain["baseband"].dtype == np.complex64


def test_a_foreign_toml_file_is_never_overwritten(tmp_path):
    (tmp_path / "scene.toml").write_text("[[targets]]\n")
    with pytest.raises(OutputError, match=r"scene\.toml: exists and is not a description of arrays"):
        write_arrays(measured(), tmp_path / "scene.npz")
    assert (tmp_path / "scene.toml").read_text() == "[[targets]]\n"
    with pytest.raises(OutputError, match=r"must end in \.npz"):
        write_arrays(measured(), tmp_path / "a.h5")
    with pytest.raises(OutputError, match="cannot be written"):
        write_arrays(measured(), tmp_path / "no" / "a.npz")
    assert [entry.name for entry in tmp_path.iterdir()] == ["scene.toml"]
