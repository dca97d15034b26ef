"""The study of chapter 5 on a handful of scenarios, and figures of chapters 4, 5 and the appendix by their numbers."""

from dataclasses import replace

import numpy as np
import pytest

from doppelgait.motion.models import moving_point
from doppelgait_liland2018 import appendix_a, chapter4, chapter4_features, chapter5_study
from doppelgait_liland2018.entry import ENTRIES, collect_entries
from doppelgait_liland2018.material import Material
from doppelgait_liland2018.measures import read_axis, travel_speed_mps
from doppelgait_liland2018.scenarios import AWAY_EVERY, Scenario, is_wrong, make_scenarios, observe, run_study

SEED = 7


@pytest.fixture(scope="module")
def material():
    return Material(seed=SEED)


def made(material, module, number):
    return ENTRIES[number].make(material)


def numbers(outcome):
    return {reading.name: reading for reading in outcome.readings}


def test_recordings_come_first_and_models_fill_up():
    recorded = make_scenarios({}, {}, seed=SEED, counts=(2, 0, 0))[0].motion
    found = make_scenarios({"a": recorded}, {"b": recorded, "c": recorded, "d": recorded}, seed=SEED, counts=(3, 2, 2))
    groups = [scenario.group for scenario in found]
    assert groups == ["recorded person"] + ["model person"] * 2 + ["Boulic walker"] * 2 + ["recorded dog"] * 2
    assert [s.name for s in found if s.group == "recorded dog"] == ["b", "c"]
    assert [s.away for s in found] == [n % AWAY_EVERY == AWAY_EVERY - 1 for n in range(7)]
    assert found[0].seconds == pytest.approx(np.ptp(recorded.time_s))


def test_scenarios_follow_the_seed_alone():
    first, again = (make_scenarios({}, {}, seed=SEED, counts=(3, 1, 3)) for _ in range(2))
    other = make_scenarios({}, {}, seed=SEED + 1, counts=(3, 1, 3))
    more = make_scenarios({}, {}, seed=SEED, counts=(5, 1, 6))
    for one, same in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.motion.position_m, same.motion.position_m)
    assert travel_speed_mps(first[0].motion) != travel_speed_mps(other[0].motion)
    assert [s.name for s in more[:3]] == [s.name for s in first[:3]]
    np.testing.assert_array_equal(more[2].motion.position_m, first[2].motion.position_m)  # more of them change none


def test_point_has_its_speed_and_a_sign(material):
    point = moving_point(speed_mps=1.5, duration_s=2.1)
    coming = Scenario("model person", "human", "point", point, 2.0)
    table = run_study([coming, replace(coming, away=True)], material.radar())
    assert table["method"].tolist() == ["liland2018", "standard"] * 2
    assert table["true_velocity_mps"].to_numpy() == pytest.approx([1.5, 1.5, -1.5, -1.5], abs=0.02)
    ours = table[table["method"] == "standard"]["torso_velocity_mps"].to_numpy()
    assert ours == pytest.approx([1.5, -1.5], abs=0.02)
    # a point fills no Doppler band: the report's gate, from its lowest to its highest Doppler, lets nothing through


def test_frame_rate_is_the_lowest_that_does_not_alias(material):
    scenario = make_scenarios({}, {}, seed=SEED, counts=(0, 1, 0))[0]
    recording = observe(scenario, material.radar())
    fastest_hz = np.abs(recording.truth[0].doppler_hz(recording.radar.wavelength_m)).max()
    assert 2 * fastest_hz < recording.radar.prf_hz < 2 * fastest_hz + 2 * 3 / 0.1 + 15  # E-06 and rounding
    centre_m = recording.truth[0].centre_range_m
    assert centre_m.min() > 1.5
    assert centre_m.max() < recording.radar.range_stop_m - 1.0


def test_scenario_that_cannot_be_observed_is_named(material):
    good = make_scenarios({}, {}, seed=SEED, counts=(1, 0, 0))[0]
    table = run_study([good, replace(good, name="too short", seconds=60.0)], material.radar())
    assert len(table) == 2
    assert list(table.attrs["left_out"]) == ["too short"]
    assert "60" in table.attrs["left_out"]["too short"]


def test_ours_finds_the_steps_of_a_handful(material):
    table = run_study(make_scenarios({}, {}, seed=SEED, counts=(4, 2, 6)), material.radar())
    ours = table[table["method"] == "standard"]
    assert not is_wrong(ours, 0.1).any()
    assert not is_wrong(table[table["group"] == "Boulic walker"], 0.1).any()
    error = (ours["torso_velocity_mps"] - ours["true_velocity_mps"]).abs()
    assert error.median() < 0.2


def test_figures_of_the_study(material, monkeypatch):
    monkeypatch.setattr(
        chapter5_study, "make_scenarios", lambda *a, seed: make_scenarios({}, {}, seed=seed, counts=(5, 3, 6))
    )
    small = Material(seed=SEED)
    lengths, features = (made(small, chapter5_study, number) for number in ("fig-5.8", "fig-5.9"))
    assert len(lengths.table) == 28
    assert (lengths.table["torso_velocity_mps"] >= 0).all()  # people who go away, too
    assert "5 model people, 3 Boulic walkers, 6 model dogs" in lengths.judgement
    wrong = numbers(lengths)["step frequencies off by more than 10 %, ours"]
    assert wrong.ours == pytest.approx(100 * lengths.table.query("method == 'standard'")["wrong"].mean())
    assert len(features.table) == 14
    assert set(features.table["method"]) == {"the report's method", "ours"}


def test_range_doppler_map_is_the_plain_transform(material):
    power, _, lowest_hz = chapter4._map_at_backward_foot(material)
    recording, _ = chapter4.walk(material)
    doppler_hz = recording.truth[0].doppler_hz(recording.radar.wavelength_m)
    frame = round(float(power.coords["time"]) * 1000)
    assert doppler_hz[frame].min() == pytest.approx(lowest_hz)
    window = np.exp(-0.5 * ((np.arange(101) - 50) / (0.4 * 50)) ** 2)
    part = recording.baseband.values[frame - 50 : frame + 51] * window[:, None]
    expected = np.abs(np.fft.fftshift(np.fft.fft(part, axis=0), axes=0)) ** 2
    np.testing.assert_allclose(power.values, expected, rtol=1e-3, atol=1e-5 * expected.max())


def test_five_cycles_are_ten_steps(material):
    found = numbers(made(material, chapter4, "fig-4.11"))
    assert found["steps: peaks of the upper edge"].ours == 10
    assert found["oscillation of the main line over the gait frequency"].agrees
    shorter = material.recording(material.make_walker(cycles=3), prf_hz=1000.0)
    assert shorter.truth[0].stride_frequency_hz * shorter.baseband.sizes["slow_time"] / 1000 == pytest.approx(
        3, abs=0.01
    )


def test_ankle_peaks_near_300_hz(material):
    ankle = numbers(made(material, chapter4, "fig-4.10"))["peak Doppler of the right ankle"]
    recording, _ = chapter4.walk(material)
    place = read_axis(recording.truth[0].scatterers, "marker").tolist().index("right_ankle")
    range_m = recording.truth[0].scatterers["range"].values[:, place]
    speed_mps = -np.gradient(range_m, 1e-3)  # independent of the velocities in the truth
    assert ankle.ours == pytest.approx(2 * speed_mps[5:-5].max() / recording.radar.wavelength_m, rel=0.01)
    assert ankle.agrees


def test_torso_line_and_harmonics(material):
    steps = numbers(made(material, chapter4_features, "fig-4.12"))
    assert steps["Doppler of the strongest constant row"].agrees
    spectrum = numbers(made(material, chapter4_features, "fig-4.13"))
    recording, result = chapter4.walk(material)
    assert spectrum["f_m"].ours == pytest.approx(recording.truth[0].gait_frequency_hz, abs=0.11)
    assert (spectrum["f_2 / f_m"].agrees, spectrum["f_3 / f_m"].agrees) == (True, True)
    # D_1 by its definition: the time mean of columns over their maximum
    columns = result.signature.values / result.signature.values.max(axis=1, keepdims=True)
    height = numbers(made(material, chapter4_features, "fig-4.14"))["A_fd"].ours
    assert height == pytest.approx(columns.mean(axis=0).max(), rel=1e-6)


def test_prominences_fall_with_long_intervals(material):
    table = appendix_a.tabulate_summary(material).set_index("T_d (s)")
    assert list(table.index) == [1.0, 0.5, 0.3, 0.1, 0.05, 0.01]
    assert (table["f_2 (dB)"][[0.3, 0.1]] > table["f_2 (dB)"][[1.0, 0.5]].max()).all()
    assert table["least (dB)"].idxmax() == 0.1
    assert table.loc[1.0, "f_m found (Hz)"] < 0.5 < table.loc[0.1, "f_m found (Hz)"]
    # a modulation at f_m is damped by the window's own spectrum: 0.5 s leaves less of f_2 than 0.1 s
    assert appendix_a.prominences_db(material, 0.1)[1] == pytest.approx(table.loc[0.1, "f_2 (dB)"])


def test_every_peak_of_the_appendix_is_judged_by_its_own_prominence(material):
    table = appendix_a.tabulate_summary(material).set_index("T_d (s)")
    peaks = table[["f_m (dB)", "f_2 (dB)", "f_3 (dB)"]]
    detected, gain_db = peaks >= 6.0, peaks - peaks.loc[0.1]
    best_two = peaks.rank(ascending=False) <= 2
    expected = {  # agrees where: not detected, among the best two, no gain
        1.0: ~detected.loc[1.0], 0.5: ~detected.loc[0.5], 0.3: best_two.loc[0.3], 0.1: best_two.loc[0.1],
        0.05: gain_db.loc[0.05] <= 1.0, 0.01: gain_db.loc[0.01] <= 1.0,
    }  # fmt: skip
    for place, cpi_s in enumerate(table.index, start=1):
        outcome = made(material, appendix_a, f"fig-A.{place}")
        stated = [reading for reading in outcome.readings if reading.stated is not None]
        assert [reading.agrees for reading in stated] == expected[cpi_s].tolist()
        assert outcome.judgement.startswith("Agrees: " if expected[cpi_s].all() else "Differs in: ")
    # f_m stands out with 0.5 s too, and the shorter the interval the more: the report says neither
    assert not expected[0.5].iloc[0]
    assert not expected[0.01].iloc[0]


def test_the_torso_of_the_map_is_a_mean_over_a_step(material):
    found = numbers(made(material, chapter4, "fig-4.5"))["Doppler of the strongest cell, mean over a whole step"]
    assert (found.stated, found.tolerance) == (100.0, 15.0)
    recording, _ = chapter4.walk(material)
    middle = recording.n_pulses // 2
    window = np.exp(-0.5 * ((np.arange(101) - 50) / (0.4 * 50)) ** 2)
    strongest = []
    for frame in range(middle, middle + round(1000 / recording.truth[0].gait_frequency_hz), 5):  # finer than there
        part = recording.baseband.values[frame - 50 : frame + 51] * window[:, None]
        power = np.abs(np.fft.fft(part, axis=0)) ** 2
        strongest.append(np.fft.fftfreq(101, 1e-3)[power.max(axis=1).argmax()])
    assert np.ptp(strongest) > 20.0  # no one moment would do
    assert found.ours == pytest.approx(np.mean(strongest), abs=2.0)


JUDGED = [
    f"fig-{n}" for n in ("4.3", "4.7", "4.8", "4.9", "4.15", "5.1", "5.2", "5.3", "5.4", "5.5", "5.6", "5.7", "5.10")
]


@pytest.mark.parametrize("number", [*JUDGED, "table-5.1", "table-5.2"])
def test_an_entry_is_made_and_judged_by_its_readings(material, number):
    (entry,) = (one for one in collect_entries() if one.number == number)
    outcome = entry.make(material)
    differing = "; ".join(reading.name for reading in outcome.readings if reading.agrees is False)
    assert outcome.judgement.startswith(f"Differs in: {differing}." if differing else ("Agrees", "Set", "Not"))
