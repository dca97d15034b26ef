"""Numbers of chapters 2 and 3 against closed forms and brute force that share no code with them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from doppelgait import DoppelgaitError
from doppelgait_liland2018 import chapter2, chapter3_data, chapter3_frame, measures
from doppelgait_liland2018.entry import ENTRIES
from doppelgait_liland2018.material import Material

LIGHT = 299_792_458.0
WAVELENGTH_M = LIGHT / 7.29e9


@pytest.fixture(scope="module")
def material():
    return Material()


def readings_of(made):
    return {reading.name: reading for reading in made.readings}


@pytest.fixture(scope="module")
def made(material):
    """What an entry gives, made once: ``made("fig-3.13")``."""
    return lambda number: material.compute_once(("test", number), lambda: ENTRIES[number].make(material))


def test_the_measured_slope_is_two_over_the_wavelength(made):
    found = readings_of(made("fig-2.6"))
    assert found["measured shift per radial velocity"].ours == pytest.approx(2 / WAVELENGTH_M, rel=1e-4)
    assert found["velocity at 150 Hz"].ours == pytest.approx(WAVELENGTH_M * 300 / 4, rel=1e-9)
    assert found["velocity at 150 Hz"].agrees is False
    # 3.084 m/s is the last that does not alias: of the steps of 0.125 m/s, 3.0
    assert found["highest speed measured without aliasing, in steps of 0.125 m/s"].ours == pytest.approx(3.0)
    wrapped = np.mod(np.linspace(-6.0, 6.0, 97) * 2 / WAVELENGTH_M + 150.0, 300.0) - 150.0
    assert found["highest shift measured at any velocity"].ours == pytest.approx(np.abs(wrapped).max(), abs=0.02)


@pytest.mark.parametrize(("velocity_mps", "shift_hz"), [(2.0, 97.27), (-2.0, -97.27), (4.0, 194.53 - 300.0)])
def test_a_point_aliases_by_whole_frame_rates(material, velocity_mps, shift_hz):
    measured = chapter2._measure_doppler_hz(material.radar(prf_hz=300.0, range_stop_m=16.0), velocity_mps)
    assert measured == pytest.approx(shift_hz, abs=0.02)


@pytest.mark.parametrize("phase_deg", [0.0, 30.0, 90.0, 180.0])
def test_phase_between_lines_does_not_see_drift_or_harmonics(phase_deg):
    time = np.arange(400) / 100.0
    shift = np.radians(phase_deg)
    first = 3.0 - 1.2 * time + 0.3 * np.cos(2 * np.pi * 1.0 * time - 0.7) + 0.2 * np.cos(2 * np.pi * 2.0 * time)
    second = 8.0 - 1.1 * time + 0.1 * np.cos(2 * np.pi * 1.0 * time - 0.7 - shift)
    found = measures.phase_between_deg(first, second, stride_hz=1.0, rate_hz=100.0)
    assert found == pytest.approx(phase_deg, abs=0.5)


def test_phase_and_cycle_need_a_whole_stride(material):
    with pytest.raises(DoppelgaitError, match="shorter than one stride"):
        measures.phase_between_deg(np.arange(50.0), np.arange(50.0), stride_hz=1.0, rate_hz=100.0)
    motion = material.make_walker().motion
    with pytest.raises(DoppelgaitError, match=r"left_paw touches down 0 times where two are needed"):
        measures.one_cycle_s(motion, "left_paw")
    with pytest.raises(DoppelgaitError, match="no point is known to be of the left hind paw"):
        measures.average_part_line(motion.positions.isel(space=0), "left_hind_paw")


def test_departure_is_the_root_mean_square_about_the_line():
    time = np.linspace(0.0, 1.0, 1001)
    assert measures.measure_departure(5.0 - 2.0 * time) == pytest.approx(0.0, abs=1e-12)
    assert measures.measure_departure(5.0 - 2.0 * time + 0.1 * np.sin(2 * np.pi * 10 * time)) == pytest.approx(
        0.1 / np.sqrt(2), rel=0.01
    )


def test_forward_places_follow_the_direction_of_travel(material):
    motion = material.person().motion
    turned = replace(
        motion, positions=motion.positions.copy(data=motion.position_m[:, :, [1, 0, 2]])
    )  # now it walks along +y
    lines = measures.forward_m(turned)
    expected = motion.position_m[:, :, 0] - motion.position_m[:, :, 0].mean(axis=1, keepdims=True)
    np.testing.assert_allclose(lines.values, expected, atol=0.02)


def test_the_ankle_peaks_where_differences_of_its_positions_say(material, made):
    motion, rate_hz = material.make_walker().motion, 500.0
    number = motion.markers.index("right_ankle")
    ankle_m = motion.position_m[: round(rate_hz / motion.facts.stride_frequency_hz), number]
    start_m = material.recording(material.make_walker()).truth[0].scatterers["range"].values[0, number]
    radar_m = ankle_m[0, 0] + np.sqrt(start_m**2 - ankle_m[0, 1] ** 2 - (ankle_m[0, 2] - 1.0) ** 2)
    range_m = np.hypot(np.hypot(radar_m - ankle_m[:, 0], ankle_m[:, 1]), ankle_m[:, 2] - 1.0)
    approach_mps = -np.diff(range_m) * rate_hz
    found = readings_of(made("fig-2.16"))["right ankle, highest shift"]
    assert found.ours == pytest.approx(2 * approach_mps.max() / WAVELENGTH_M, rel=1e-3)
    assert found.agrees is True
    peak = readings_of(made("fig-2.16"))["highest shift, at this share of the gait cycle"]
    assert peak.ours == pytest.approx(approach_mps.argmax() / len(ankle_m), abs=0.01)


def test_the_stand_in_for_the_dog_bounds(material, made):
    found = readings_of(made("fig-2.18"))
    assert found["phase between left and right hind paw"].ours == pytest.approx(0.0, abs=0.1)
    landings = material.find_galloping_dog().motion.facts.footfalls["left_hind"]
    assert found["stride frequency"].ours == pytest.approx(1 / np.diff(landings).mean(), rel=1e-3)
    assert readings_of(made("fig-2.20"))["hind paws, smallest shift"].ours == pytest.approx(0.0, abs=1e-6)


def test_a_rectangular_pulse_has_the_width_of_the_sinc(made):
    half = brentq(lambda x: np.sinc(x) ** 2 - 0.5, 0.1, 0.9)
    found = readings_of(made("fig-3.4"))
    assert found["half-power width, in 1 / pulse duration"].ours == pytest.approx(2 * half, rel=1e-3)
    assert found["first null, in 1 / pulse duration"].ours == pytest.approx(1.0, abs=2e-3)
    lobe = np.max(np.sinc(np.linspace(1.0, 2.0, 10001)) ** 2)
    assert found["highest side lobe"].ours == pytest.approx(10 * np.log10(lobe), abs=0.02)


def test_a_train_has_lines_at_the_repetition_frequency_as_wide_as_its_length(made):
    found = readings_of(made("fig-3.5"))
    assert found["spacing of the spectral lines, in f_p"].ours == pytest.approx(1.0, abs=0.01)
    # closed form of 8 pulses: |sin(8 x) / sin(x)| falls to half its power at 0.4485 / 8 of a repetition frequency
    half = brentq(lambda f: (np.sin(8 * np.pi * f) / (8 * np.sin(np.pi * f))) ** 2 - 0.5, 0.01, 0.1)
    assert found["half-power width of a line, in 1 / T_d"].ours == pytest.approx(2 * half * 8, rel=5e-3)


def test_the_gaussian_pulse_has_a_quarter_of_the_bandwidth_stated(made):
    found = readings_of(made("fig-3.8"))
    assert found["half-power bandwidth"].ours == pytest.approx(np.sqrt(np.log(2)) / np.pi, rel=1e-3)
    assert found["half-power bandwidth"].agrees is False
    assert found["half-power width in range of an echo"].ours == pytest.approx(LIGHT * np.sqrt(np.log(2)) * 1e-9)


def test_down_conversion_leaves_no_image_and_the_printed_one_does(made):
    found = readings_of(made("fig-3.10"))
    assert found["highest power left beyond 7 GHz"].ours < -80
    # cos(a) cos(b): half of the amplitude goes to the sum frequency, aliased, in two lines of a quarter each way
    assert found["the same as printed, without a filter"].ours > -7
    assert found["down-converted frame against the closed form, largest error"].ours < 1e-4


def dirichlet(frequency_hz, frames, prf_hz):
    """Spectrum of a unit tone over an odd number of frames, phase zero in the middle."""
    x = np.pi * np.asarray(frequency_hz) / prf_hz
    return np.sin(frames * x) / np.where(np.abs(np.sin(x)) < 1e-12, 1.0, np.sin(x))


@pytest.mark.parametrize(("letter", "spacing_hz"), chapter3_data.SPACINGS_3_13_HZ.items())
def test_two_points_have_the_spectrum_of_two_dirichlet_kernels(material, letter, spacing_hz):
    radar = chapter3_data._make_radar(material)
    signal = chapter3_data.simulate_tones(radar, 31, [-spacing_hz / 2, spacing_hz / 2])
    frequency_hz, power = chapter3_frame.compute_spectrum(signal, 300.0, points=1 << 15)
    shown = np.abs(frequency_hz) > 1e-9  # away from 0 / 0
    kernels = sum(dirichlet(frequency_hz - side * spacing_hz / 2 + 1e-7, 31, 300.0) for side in (-1, 1)) ** 2
    np.testing.assert_allclose(power[shown], (kernels / kernels.max())[shown], atol=0.01)


def test_resolution_is_one_over_the_interval_and_in_phase_points_need_more(made):
    found = readings_of(made("fig-3.13"))
    assert found["resolution: peak to first null"].ours == pytest.approx(300 / 31, abs=0.02)
    grid = np.linspace(-20.0, 20.0, 8001) + 1e-7
    smallest = next(
        s for s in np.arange(5.0, 30.0, 0.1)
        if abs(dirichlet(grid - s / 2, 31, 300.0) + dirichlet(grid + s / 2, 31, 300.0))[4000]
        < 0.99999 * abs(dirichlet(grid - s / 2, 31, 300.0) + dirichlet(grid + s / 2, 31, 300.0)).max()
    )  # fmt: skip
    assert found["smallest spacing with two peaks, in phase"].ours == pytest.approx(smallest, abs=0.25)
    peaks = [found[f"({x}) peaks at {hz:.0f} Hz"].ours for x, hz in chapter3_data.SPACINGS_3_13_HZ.items()]
    assert peaks == [2, 2, 2, 1]


def test_count_and_dip_of_known_peaks():
    x = np.linspace(-5, 5, 2001)
    two = np.exp(-((x - 2) ** 2)) + np.exp(-((x + 2) ** 2))
    count, dip = chapter3_data.count_and_dip(two)
    assert count == 2
    assert dip == pytest.approx(10 * np.log10(1 / (2 * np.exp(-4))), abs=0.1)
    assert chapter3_data.count_and_dip(np.exp(-(x**2))) == (1, 0.0)
    assert chapter3_data.count_and_dip(two * np.where(x > 0, 1.0, 0.2))[0] == 1  # 7 dB below: a side lobe


def test_a_spectrum_repeats_after_the_frame_rate(made):
    found = readings_of(made("fig-3.12"))
    assert found["period of the spectrum"].ours == 300.0
    assert found["targets, largest error of the shift"].ours < 0.5
    assert found["wall, at shift"].ours == pytest.approx(0.0, abs=0.2)


def test_gain_between_the_ends_goes_with_the_fourth_power_of_range():
    range_m = np.linspace(14.0, 7.0, 1000)
    first, last = range_m[:200].mean(), range_m[-200:].mean()
    assert chapter3_data._gain_db(range_m**-4.0, 1000.0) == pytest.approx(40 * np.log10(first / last), abs=0.15)


def test_the_dog_comes_from_14_m_and_the_two_people_cross_once(made):
    dog = readings_of(made("fig-3.14"))
    assert dog["range at the start"].ours == pytest.approx(14.0, abs=0.1)
    assert dog["frame rate: 1938 frames in 1.3 s"].agrees is False
    assert dog["length of 162 bins, every 8th sample kept"].ours == pytest.approx(162 * 8 * LIGHT / 2 / 23.328e9)
    assert dog["stronger when nearer (1: yes)"].ours == 1.0
    people = readings_of(made("fig-3.15"))
    assert people["times that the ranges cross"].ours == 1
    assert people["they cross at"].ours == pytest.approx(2.0, abs=0.1)  # placed at equal range in the middle


def test_tables_hold_the_sections_and_scales_of_the_report(made):
    sections = made("table-3.2").table.set_index("target")["sum of the scatterers (m²)"]
    assert sections.to_dict() == pytest.approx({"human": 1.0, "dog": 0.2})
    scales = made("table-3.3")
    assert list(scales.table["time (s)"]) == pytest.approx([1 / 7.29e9, 1e-9, 1e-3, 0.1])
    assert readings_of(scales)["bandwidth times pulse width τ"].ours == pytest.approx(0.26501, abs=1e-4)
    width = readings_of(scales)["width of a line times T_d"].ours
    assert width == pytest.approx(2 * brentq(lambda x: np.sinc(x) ** 2 - 0.5, 0.1, 0.9), rel=2e-3)
