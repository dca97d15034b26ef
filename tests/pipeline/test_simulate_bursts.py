"""Sensors in bursts: simulated pulses against those without pauses, files, and the analysis of recorded bursts."""

from dataclasses import replace

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.core.errors import ConfigError, DoppelgaitWarning
from doppelgait.radar import Radar, Recording, open_stream, read_recording, write_recording
from doppelgait.radar.frames import write_frames

PRESETS = ("infineon-24-burst", "infineon-60-burst", "ti-60-burst")
WALK = dg.motion.human_gait(speed_mps=1.2, duration_s=3.0)
SCENE = dg.Scene(targets=[dg.Target(WALK, range_m=4.0)], duration_s=2.0)


def simulate(radar: Radar, **options: object) -> Recording:
    return dg.simulate(SCENE, radar, **options)


@pytest.mark.parametrize(
    ("preset", "changes", "pulses", "period"),
    [
        ("infineon-24", {}, 128, 600),
        ("ti-60", {"prf_hz": 5000.0, "range_stop_m": 6.0}, 96, 275),
        ("x4", {"range_stop_m": 6.0}, 32, 100),
    ],
)
def test_bursts_are_the_same_pulses_as_without_pauses(preset, changes, pulses, period):
    whole = simulate(Radar.preset(preset, **changes))
    prf_hz = whole.radar.prf_hz
    radar = Radar.preset(preset, **changes, burst_pulses=pulses, burst_period_s=period / prf_hz)
    bursts = simulate(radar)
    taken = (np.arange(0, whole.n_pulses - pulses + 1, period)[:, None] + np.arange(pulses)).ravel()
    np.testing.assert_allclose(bursts.slow_time_s, whole.slow_time_s[taken], rtol=0, atol=1e-12)
    wanted = whole.samples.matrix[taken]
    assert np.abs(bursts.samples.matrix - wanted).max() < 1e-6 * np.abs(wanted).max()
    assert bursts.facts["burst_pulses"] == pulses
    np.testing.assert_allclose(bursts.truth[0].centre_range_m, whole.truth[0].centre_range_m[taken], rtol=0, atol=1e-9)


@pytest.mark.parametrize("preset", PRESETS)
def test_a_simulated_and_a_recorded_recording_take_the_same_path(preset, tmp_path):
    made = simulate(Radar.preset(preset), rng=dg.rng(3), snr_db=20)
    write_recording(made, tmp_path / "walk.h5")
    back = read_recording(tmp_path / "walk.h5")
    assert back.radar == made.radar
    # as a reader of a measured recording makes it: the bursts are a fact of the samples alone
    plain = made.radar.model_copy(update={"burst_pulses": None, "burst_period_s": None})
    recorded = replace(made, radar=plain, facts={"burst_pulses": made.radar.burst_pulses}, truth=())
    gate = (2.0, 5.5) if made.n_range_bins > 1 else None
    options = {} if gate is None else {"gate": gate}
    rows = [dg.analyze(one, **options)[0] for one in (made, back, recorded)]
    for one in rows[1:]:
        np.testing.assert_array_equal(one.signature.values, rows[0].signature.values)
        assert one.features == rows[0].features
    times_s = rows[0].signature["time"].values
    np.testing.assert_allclose(np.diff(times_s), made.radar.burst_period_s, rtol=1e-9)
    assert rows[0].signature.attrs["cpi_pulses"] == made.radar.burst_pulses


@pytest.mark.parametrize("preset", ["infineon-60-burst", "ti-60-burst"])
def test_targets_are_tracked_in_bursts_as_without_pauses(preset):
    gaits = dg.motion.human_gait(speed_mps=1.2, duration_s=6.0), dg.motion.boulic_walk(speed_mps=0.9, duration_s=6.0)
    targets = [dg.Target(gaits[0], range_m=4.0), dg.Target(gaits[1], range_m=3.0, aspect_deg=180.0)]
    scene, radar = dg.Scene(targets=targets, duration_s=5.0), Radar.preset(preset)
    even = radar.model_copy(update={"burst_pulses": None, "burst_period_s": None})
    recording, whole = (dg.simulate(scene, one, rng=dg.rng(5), snr_db=15) for one in (radar, even))
    found, wanted = ({np.sign(one.torso_doppler_hz): one for one in dg.analyze(each)} for each in (recording, whole))
    assert set(found) == set(wanted) == {-1.0, 1.0}
    for side, one in found.items():
        truth = recording.truth[0 if side > 0 else 1]
        assert one.signature.attrs["cpi_pulses"] == radar.burst_pulses
        error_m = one.gate.centre_m - np.interp(one.gate.time_s, recording.slow_time_s, truth.centre_range_m)
        assert np.median(np.abs(error_m)) < 0.2
        velocity_mps = wanted[side].features.torso_velocity_mps
        assert one.features.torso_velocity_mps == pytest.approx(velocity_mps, abs=0.1)


def test_frames_in_bursts_are_streamed_with_their_times(tmp_path):
    made = simulate(Radar.preset("infineon-24-burst"))
    plain = made.radar.model_copy(update={"burst_pulses": None, "burst_period_s": None})
    recorded = replace(made, radar=plain, facts={"burst_pulses": made.radar.burst_pulses}, truth=())
    write_recording(recorded, tmp_path / "walk.h5")
    write_frames(recorded, tmp_path / "walk.dgf")
    back = read_recording(tmp_path / "walk.dgf")
    np.testing.assert_allclose(back.slow_time_s, made.slow_time_s, rtol=0, atol=1e-12)
    assert back.facts["burst_pulses"] == 128
    for name in ("walk.h5", "walk.dgf"):
        with open_stream(tmp_path / name, timeout_s=0) as stream:
            items = list(stream)
            assert (stream.radar.burst_pulses, stream.radar.burst_period_s) == (128, pytest.approx(0.2))
        np.testing.assert_allclose([time_s for time_s, _ in items], made.slow_time_s, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(np.stack([row for _, row in items]), made.samples.matrix)


def test_of_a_file_with_lost_frames_whole_bursts_are_kept_at_their_times(tmp_path):
    made = simulate(Radar.preset("infineon-24-burst"))
    write_frames(made, tmp_path / "walk.dgf")
    content = (tmp_path / "walk.dgf").read_bytes()
    size = 16 + 16 + 8
    start = len(content) - 16 - size * made.n_pulses
    lost = start + size * 300, start + size * 310  # in the third burst
    (tmp_path / "walk.dgf").write_bytes(content[: lost[0]] + content[lost[1] :])
    with pytest.warns(DoppelgaitWarning, match="1 incomplete bursts are ignored"):
        back = read_recording(tmp_path / "walk.dgf")
    kept = np.delete(np.arange(made.n_pulses), np.s_[256:384])
    np.testing.assert_array_equal(back.samples.matrix, made.samples.matrix[kept])
    np.testing.assert_allclose(back.slow_time_s, made.slow_time_s[kept], rtol=0, atol=1e-12)


def test_only_whole_bursts_are_simulated():
    radar = Radar.preset("infineon-24-burst")
    times_s = radar.pulse_times_s(1.0 + 127 / 3000)
    assert times_s.size == 5 * 128
    assert radar.pulse_times_s(1.0 + 128 / 3000).size == 6 * 128
    assert radar.pulse_times_s(0.04).size == 0
    with pytest.raises(ConfigError, match="less than a burst of 128 frames"):
        dg.simulate(SCENE.model_copy(update={"duration_s": 0.04}), radar)


def test_radars_without_bursts_are_stored_as_before():
    assert not {key for key in Radar.preset("x4").model_dump(mode="json") if key.startswith("burst")}
    radar = Radar.preset("ti-60-burst")
    assert Radar.model_validate(radar.model_dump(mode="json")) == radar
