"""The Doppler signal as sound: sign, pitch, summation over the gate, levels, files."""

import json
import re

import numpy as np
import pytest
from scipy.io import wavfile

from command import run
from doppelgait.core.errors import AnalysisError, ConfigError, DoppelgaitError
from doppelgait.core.frames import Frames
from doppelgait.core.labels import BASEBAND, make_array, read_axis
from doppelgait.pipeline import parse_run, run_simulation
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.sound import compute_doppler_signal, lengthen, make_doppler_sound, plan_sound
from doppelgait.radar import write_recording

RATE_HZ = 2000.0


def tone(hz, *, rate_hz=RATE_HZ, duration_s=2.0):
    return np.exp(2j * np.pi * hz * np.arange(round(duration_s * rate_hz)) / rate_hz).astype(np.complex64)


def peak_hz(signal, rate_hz):
    spectrum = np.abs(np.fft.fft(signal * np.hanning(signal.size), 1 << 19))
    return np.fft.fftfreq(spectrum.size, 1 / rate_hz)[spectrum.argmax()]


def recording_of(values, prf_hz=1000.0, *, range_m=None):
    values = np.asarray(values, dtype=np.complex64)
    values = values[:, None] if values.ndim == 1 else values
    bins_m = np.arange(values.shape[1]) * 0.05 + 2.0 if range_m is None else range_m
    return make_array(BASEBAND, values, {"slow_time": np.arange(values.shape[0]) / prf_hz, "range": bins_m})


def whole(baseband):
    return Gate.fixed(-1e6, 1e6, time_s=read_axis(baseband, "slow_time"))


def moving_echo(*, ramp_rad, speed_mps=1.0, wavelength_m=0.0411, prf_hz=1000.0):
    """One Gaussian echo that goes through 40 bins of 5 cm; each bin turned by ``ramp_rad`` against the one before."""
    bins = np.arange(40)
    at = 30.0 - speed_mps * np.arange(1000) / prf_hz / 0.05
    envelope = np.exp(-0.5 * ((bins - at[:, None]) / 1.2) ** 2)
    phase = -4 * np.pi * (at * 0.05)[:, None] / wavelength_m + ramp_rad * (bins - 30)
    return recording_of(envelope * np.exp(1j * phase), prf_hz), 2 * speed_mps / wavelength_m


class TestStretched:
    @pytest.mark.parametrize("factor", [4.0, 2.7, 0.5, 30.0])
    @pytest.mark.parametrize("hz", [58.3, -211.7, 3.4])
    def test_a_tone_keeps_frequency_and_level_and_gets_its_length(self, hz, factor):
        made = lengthen(tone(hz), factor, window_samples=200)
        edge = round(200 * max(factor, 1.0))  # the window is half empty at the ends
        inner = made[edge:-edge]
        assert made.size == round(4000 * factor)
        assert peak_hz(inner, RATE_HZ) == pytest.approx(hz, rel=0.01, abs=0.05)
        assert np.abs(inner).std() < 0.02
        assert np.abs(inner).mean() == pytest.approx(1.0, abs=0.03)

    def test_a_chirp_through_zero_is_followed_and_makes_no_clicks(self):
        times_s = np.arange(6000) / RATE_HZ
        swept = np.exp(2j * np.pi * (-200 * times_s + 100 * times_s**2))  # -200 to 400 Hz in 3 s
        made = lengthen(swept, 4.0, window_samples=200)
        step_rad = np.angle(made[1:] * made[:-1].conj())
        wanted_hz = -200 + 200 * (np.arange(step_rad.size) + 0.5) / 8000
        inner = slice(800, -800)
        errors_hz = (step_rad * RATE_HZ / (2 * np.pi) - wanted_hz)[inner]
        assert np.abs(errors_hz).max() < 0.01 * 400
        assert abs(errors_hz.mean()) < 0.4  # 2 ms of the sweep
        assert np.abs(np.diff(step_rad))[inner].max() < 0.01  # a click is a jump of the phase ...
        assert np.abs(np.diff(np.abs(made)))[inner].max() < 0.01  # ... or of the level

    def test_what_happens_at_a_time_stays_at_that_time(self):
        made = lengthen(np.where(np.arange(4000) < 2600, 0, tone(80.0)), 4.0, window_samples=200)
        assert np.flatnonzero(np.abs(made) > 0.5)[0] / made.size == pytest.approx(0.65, abs=50 / 4000)


class TestSignal:
    @pytest.mark.parametrize("ramp_rad", [0.0, np.pi, -0.7])
    def test_an_echo_that_goes_from_bin_to_bin_is_one_steady_tone(self, ramp_rad):
        baseband, doppler_hz = moving_echo(ramp_rad=ramp_rad)
        for gate in (whole(baseband), Gate.around(whole(baseband).time_s, [3.5, 2.5], span_m=1.2)):
            heard = compute_doppler_signal(Frames.of(baseband), gate)
            assert np.abs(heard) == pytest.approx(1.2 * np.sqrt(2 * np.pi), rel=1e-3)  # the area of the envelope
            assert peak_hz(heard, 1000.0) == pytest.approx(doppler_hz, abs=0.2)

    def test_what_stands_still_is_taken_off_as_asked(self):
        baseband, doppler_hz = moving_echo(ramp_rad=0.0)
        still = baseband.copy(data=baseband.values + np.complex64(5.0))
        assert abs(compute_doppler_signal(Frames.of(still), whole(still)).mean()) > 100
        clean = compute_doppler_signal(Frames.of(still), whole(still), Analysis(clutter="mean"))
        assert abs(clean.mean()) < 1e-3
        assert peak_hz(clean, 1000.0) == pytest.approx(doppler_hz, abs=0.2)

    def test_before_and_after_a_track_it_is_silent(self):
        baseband = recording_of(tone(50.0, rate_hz=1000.0))
        gate = Gate.fixed(-1e6, 1e6, time_s=[0.5, 1.5])
        heard = np.abs(compute_doppler_signal(Frames.of(baseband), gate))
        assert heard[500:1501] == pytest.approx(1.0, rel=1e-5)
        assert heard[:495].max() == 0.0
        assert heard[1506:].max() == 0.0

    def test_bursts_and_a_gate_beside_the_frame_are_errors(self):
        values = np.ones((40, 3), dtype=np.complex64)
        times_s = (np.arange(10)[:, None] * 0.1 + np.arange(4) * 1e-3).ravel()
        bursts = make_array(BASEBAND, values, {"slow_time": times_s, "range": np.arange(3.0)})
        with pytest.raises(AnalysisError, match="bursts"):
            compute_doppler_signal(Frames.of(bursts), whole(bursts))
        baseband, _ = moving_echo(ramp_rad=0.0)
        with pytest.raises(AnalysisError, match=r"recorded frame, 1\.98 to 3\.98 m"):
            compute_doppler_signal(Frames.of(baseband), Gate.fixed(20.0, 21.0, time_s=[0.0, 0.999]))


class TestSound:
    @pytest.mark.parametrize("hz", [97.27, -97.27])
    def test_left_plus_j_right_is_the_signal_with_the_sign_of_the_motion(self, hz):
        baseband = recording_of(tone(hz, rate_hz=1000.0))
        rate_hz, sound = make_doppler_sound(Frames.of(baseband), whole(baseband))
        assert (rate_hz, sound.shape, sound.dtype) == (8000, (16000, 2), np.dtype(np.int16))
        assert peak_hz(sound[:, 0] + 1j * sound[:, 1], rate_hz) == pytest.approx(4 * hz, rel=0.01)

    @pytest.mark.parametrize(("hz", "loud", "soft"), [(97.27, 0, 1), (-97.27, 1, 0)])
    def test_sides_puts_approaching_left_and_receding_right(self, hz, loud, soft):
        baseband = recording_of(tone(hz, rate_hz=1000.0))
        rate_hz, sound = make_doppler_sound(Frames.of(baseband), whole(baseband), pitch=2.0, channels="sides")
        rms = np.sqrt((sound[1000:-1000].astype(float) ** 2).mean(axis=0))
        assert rms[soft] < 0.01 * rms[loud]
        assert abs(peak_hz(sound[:, loud], rate_hz)) == pytest.approx(2 * abs(hz), rel=0.01)

    def test_level_and_ends(self):
        baseband = recording_of(1e-6 * tone(50.0, rate_hz=1000.0))
        _, sound = make_doppler_sound(Frames.of(baseband), whole(baseband))
        assert np.abs(sound.astype(int)).max() == round(32767 * 10 ** (-1 / 20))
        assert np.abs(sound[[0, -1]]).max() == 0
        assert np.abs(np.diff(sound.astype(int), axis=0)).max() < 1.3 * 29205 * 2 * np.pi * 200 / 8000
        silence = recording_of(np.zeros(500))
        assert not make_doppler_sound(Frames.of(silence), whole(silence))[1].any()

    def test_without_pitch_the_whole_doppler_band_is_kept(self):
        baseband = recording_of(tone(460.0, rate_hz=1000.0) + tone(20.0, rate_hz=1000.0))
        rate_hz, sound = make_doppler_sound(Frames.of(baseband), whole(baseband), pitch=1.0)
        spectrum = np.abs(np.fft.fft(sound @ [1, 1j]))
        hz = np.fft.fftfreq(spectrum.size, 1 / rate_hz)
        assert spectrum[np.abs(hz - 460) < 1].max() == pytest.approx(spectrum[np.abs(hz - 20) < 1].max(), rel=0.03)
        assert spectrum[np.abs(hz + 540) < 1].max() < 0.01 * spectrum.max()  # the image

    @pytest.mark.parametrize(("prf_hz", "wanted"), [
        (17.05, (4.0, 8000)), (1000.0, (4.0, 8000)), (5434.78, (4.0, 24000)), (20_000.0, (2.4, 48000)),
        (128_000.0, (1.0, 48000)),
    ])  # fmt: skip
    def test_pitch_and_rate_follow_the_frame_rate(self, prf_hz, wanted):
        assert plan_sound(prf_hz) == pytest.approx(wanted)

    def test_a_fast_recording_is_decimated_without_aliases(self):
        values = tone(1000.0, rate_hz=128_000.0, duration_s=0.5) + tone(47_000.0, rate_hz=128_000.0, duration_s=0.5)
        rate_hz, sound = make_doppler_sound(Frames.of(baseband := recording_of(values, 128_000.0)), whole(baseband))
        spectrum = np.abs(np.fft.fft(sound @ [1, 1j]))
        hz = np.fft.fftfreq(spectrum.size, 1 / rate_hz)
        assert hz[spectrum.argmax()] == pytest.approx(1000.0, abs=2)
        assert spectrum[np.abs(hz - 1000) > 300].max() < 0.01 * spectrum.max()

    @pytest.mark.parametrize(("prf_hz", "pitch", "says"), [
        (1000.0, 60.0, "at most 48"), (128_000.0, 4.0, "at most 1$"), (1000.0, 0.0, "0.1 to 5000"),
        (10.0, 1e4, "0.1 to 5000"),
    ])  # fmt: skip
    def test_a_pitch_that_cannot_be_is_an_error(self, prf_hz, pitch, says):
        with pytest.raises(AnalysisError, match=says):
            plan_sound(prf_hz, pitch)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    table = {
        "radar": {"preset": "x4", "range_stop_m": 6.0}, "duration_s": 1.5, "noise": {"kind": "snr", "snr_db": 25.0},
        "targets": [{"label": "human", "range_m": 3.5, "motion": {"kind": "human"}}],
    }  # fmt: skip
    path = tmp_path_factory.mktemp("listen") / "walk.h5"
    write_recording(run_simulation(parse_run(table)), path)
    return path


class TestCommand:
    def test_writes_a_wav_that_other_programs_read(self, file, tmp_path):
        facts = json.loads(run("listen", file, "-o", tmp_path / "walk.wav", "--gate", "truth", "--json").stdout)
        rate_hz, sound = wavfile.read(tmp_path / "walk.wav")
        assert (rate_hz, sound.shape) == (facts["rate_hz"], (12000, 2))
        assert facts["label"] == "human"
        assert peak_hz(sound[:, 0] + 1j * sound[:, 1], rate_hz) == pytest.approx(4 * 2 * 1.2 / 0.0411, rel=0.25)

    @pytest.mark.parametrize(("words", "says"), [
        (["--gate", "truth", "--target", "1"], "--target 1: must be 0"),
        (["--gate", "20:21"], "outside the recorded frame"),
        (["--gate", "truth", "--pitch", "60"], "at most 48"),
        (["--gate", "twice"], "'twice' is not allowed; it must be track, truth or"),
    ])  # fmt: skip
    def test_a_mistake_is_one_error_and_leaves_the_older_file(self, file, tmp_path, words, says):
        (tmp_path / "old.wav").write_bytes(b"kept")
        with pytest.raises(DoppelgaitError, match=re.escape(says)):
            run("listen", file, "-o", tmp_path / "old.wav", *words)
        assert (tmp_path / "old.wav").read_bytes() == b"kept"
        assert [path.name for path in tmp_path.iterdir()] == ["old.wav"]

    def test_the_name_must_say_what_it_is(self, file, tmp_path):
        with pytest.raises(ConfigError):
            run("listen", file, "-o", tmp_path / "walk.mp3")
