"""Scans from basebands whose bodies are known: point echoes, literal transforms, brute-force clusters."""

import itertools

import numpy as np
import pytest

from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.core.frames import Frames
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.core.rng import draw_key
from doppelgait.core.samples import Samples
from doppelgait.processing import Analysis, plan_transform
from doppelgait.processing.detect import Detector, estimate_noise_map, find_scans, noise_factor
from doppelgait.processing.detect.maps import compute_maps, estimate_residue_map
from doppelgait.processing.detect.scans import NO_RANGE_SD_M, find_cells, find_clusters, measure_shapes
from doppelgait.radar import Radar, link
from doppelgait.radar.simulate import label_baseband

WAVELENGTH_M, PRF_HZ, SPACING_M, FIRST_M = 0.0411, 1000.0, 0.05, 0.5
RANGE_M = FIRST_M + SPACING_M * np.arange(120)
PULSE_M = 0.05
"""Standard deviation of the point echo's amplitude in range."""


def noise(n_pulses, seed, power_v2=1.0, n_bins=RANGE_M.size):
    parts = np.random.default_rng(seed).standard_normal((2, n_pulses, n_bins), dtype=np.float32)
    return np.sqrt(power_v2 / 2.0) * (parts[0] + 1j * parts[1])


def echo(range_m, velocity_mps, amplitude, n_pulses, prf_hz=PRF_HZ):
    """Point that starts at ``range_m`` and approaches with ``velocity_mps``: range and phase by its distance."""
    distance_m = range_m - velocity_mps * np.arange(n_pulses) / prf_hz
    envelope = amplitude * np.exp(-((RANGE_M - distance_m[:, None]) ** 2) / (2 * PULSE_M**2))
    return envelope * np.exp(-4j * np.pi * distance_m / WAVELENGTH_M)[:, None]


def baseband(values, range_m=RANGE_M, prf_hz=PRF_HZ, start_s=0.0):
    coords = {"slow_time": start_s + np.arange(len(values)) / prf_hz, "range": range_m}
    return make_array(BASEBAND, np.asarray(values, dtype=np.complex64), coords)


def scans_of(values, settings=None, **axes):
    return find_scans(baseband(values, **axes), settings, wavelength_m=WAVELENGTH_M)


@pytest.mark.parametrize("method", ["noise_map", "os_cfar", "ca_cfar"])
@pytest.mark.parametrize("velocity_mps", [1.3, -2.1])
def test_a_point_is_found_where_it_is(method, velocity_mps):
    start_m = 4.0 + velocity_mps / 2
    scans = scans_of(noise(1001, 1) + echo(start_m, velocity_mps, 3.0, 1001), Detector(method=method))
    assert [scan.time_s for scan in scans] == pytest.approx(0.05 + 0.1 * np.arange(10))
    for scan in scans:
        best = max(scan.detections, key=lambda d: d.power_v2)
        assert best.range_m == pytest.approx(start_m - velocity_mps * scan.time_s, abs=0.02)
        assert best.velocity_mps == pytest.approx(velocity_mps, abs=0.03)
        assert best.range_low_m < best.range_m < best.range_high_m
        assert best.velocity_low_mps < best.velocity_mps < best.velocity_high_mps
        assert best.range_high_m - best.range_low_m < 0.4
        assert best.velocity_high_mps - best.velocity_low_mps < 1.0
        assert 0 < best.range_sd_m < 0.1
        assert 0 < best.velocity_sd_mps < 0.1
    assert sum(len(scan.detections) for scan in scans) <= 11


def test_the_power_of_a_detection_is_that_of_its_echo():
    # the window's energy is divided out: cells of a steady echo add up to K |a|^2 in each bin (Parseval)
    scans = scans_of(1e-3 * noise(1001, 2) + echo(4.5, 1.0, 2.0, 1001))
    n_doppler = plan_transform(Analysis(), n_pulses=1001, prf_hz=PRF_HZ).n_doppler_bins
    expected = n_doppler * 4.0 * np.sqrt(np.pi) * PULSE_M / SPACING_M
    found = [max(detection.power_v2 for detection in scan.detections) for scan in scans]
    assert found == pytest.approx([expected] * 10, rel=0.01)


def test_the_floor_of_every_bin_is_found_beside_bodies():
    generator = np.random.default_rng(6)
    level = np.array([1.0, 4.0, 1e-6, 1e4])
    cells = (level * generator.standard_exponential((200, 128, 4))).astype(np.float32)
    np.testing.assert_allclose(estimate_noise_map(cells), level, rtol=0.04)
    cells[:, 60:85] *= 300.0  # a fifth of the cells
    np.testing.assert_allclose(estimate_noise_map(cells), level, rtol=0.08)


def test_what_stays_in_a_cell_is_known_and_what_passes_is_not():
    cells = np.random.default_rng(7).standard_exponential((4000, 2, 3))
    cells[:, 1] *= 50.0
    cells[:800, 0] += 1e4  # passes: a fifth of the time
    found = estimate_residue_map(cells)
    np.testing.assert_allclose(found[1], 50.0, rtol=0.1)
    assert (found[0] < 1.5).all()
    assert not estimate_residue_map(cells[:9]).any()


@pytest.mark.parametrize("pfa", [1e-2, 1e-3])
def test_cells_of_white_noise_are_above_as_often_as_designed(pfa):
    settings = Detector(pfa=pfa, slow_mps=0.0, clutter="none", near_m=0.0, dynamic_range_db=100.0)
    rates = []
    for seed in range(4):
        (maps,) = compute_maps(Frames.of(baseband(noise(3001, seed))), settings, wavelength_m=WAVELENGTH_M)
        rates.append(find_cells(maps, settings)[0].mean())
    n_cells = 4 * 30 * 101 / 1.46 * 120  # independent ones: 1.46 bins of noise bandwidth (E-23)
    assert np.mean(rates) == pytest.approx(pfa, rel=0.01, abs=2.5 * np.sqrt(pfa / n_cells))


def literal_clusters(mask, join_bins, join_doppler_bins):
    """Partition of the cells by pairwise neighbourhood, one scan at a time."""
    places = np.argwhere(mask)
    number = list(range(len(places)))
    for a, b in itertools.combinations(range(len(places)), 2):
        turn = abs(places[a][1] - places[b][1])
        near = places[a][0] == places[b][0] and abs(places[a][2] - places[b][2]) <= join_bins
        if near and min(turn, mask.shape[1] - turn) <= join_doppler_bins:
            old, new = number[b], number[a]
            number = [new if n == old else n for n in number]
    return {frozenset(tuple(map(int, places[i])) for i in range(len(places)) if number[i] == n) for n in set(number)}


def test_clusters_are_those_of_all_pairs():
    for seed in range(6):
        mask = np.random.default_rng(seed).random((3, 32, 25)) < 0.02
        cells = find_clusters(mask, join_bins=3, join_doppler_bins=5)
        found = {
            frozenset(
                (int(j), int(k), int(n))
                for j, k, n, c in zip(cells.scan, cells.doppler, cells.range_bin, cells.cluster, strict=True)
                if c == number
            )
            for number in range(cells.n_clusters)
        }
        assert found == literal_clusters(mask, 3, 5)


def test_the_shape_of_a_cluster_is_that_of_its_cells():
    mask = np.zeros((2, 16, 20), dtype=bool)
    power = np.ones((2, 16, 20))
    for doppler, range_bin, level in ((4, 7, 11.0), (5, 7, 31.0), (5, 8, 61.0)):
        mask[1, doppler, range_bin], power[1, doppler, range_bin] = True, level
    cells = find_clusters(mask, join_bins=3, join_doppler_bins=3)
    shape = measure_shapes(cells, power, np.ones(20), box_quantile=0.0)
    assert shape.power == pytest.approx([100.0])
    assert shape.snr == pytest.approx([100.0])
    assert shape.range_bin == pytest.approx([7.6])
    assert shape.doppler_bin == pytest.approx([4.9])
    assert shape.range_spread == pytest.approx([np.sqrt(0.24)])
    assert shape.doppler_spread == pytest.approx([0.3])
    np.testing.assert_allclose(shape.range_box, [[6.5, 8.5]])
    np.testing.assert_allclose(shape.doppler_box, [[3.5, 5.5]])
    tight = measure_shapes(
        cells, power, np.ones(20), box_quantile=0.2
    )  # a tenth at Doppler 4 is left out, two fifths stay
    np.testing.assert_allclose(tight.doppler_box, [[4.5, 5.5]])
    np.testing.assert_allclose(tight.range_box, [[6.5, 8.5]])
    assert shape.scan == [1]
    assert shape.n_cells == [3]


def test_an_echo_at_the_end_of_the_doppler_axis_is_one_body():
    limit_mps = WAVELENGTH_M * 200.0 / 4  # 2.06 m/s
    scans = scans_of(noise(401, 8) + echo(6.0, limit_mps, 10.0, 401, prf_hz=200.0), prf_hz=200.0)
    for scan in scans:
        best = max(scan.detections, key=lambda d: d.power_v2)
        assert abs(best.velocity_mps) == pytest.approx(limit_mps, abs=0.1)
        assert best.velocity_high_mps - best.velocity_low_mps < 1.2
    assert sum(len(scan.detections) for scan in scans) <= len(scans) + 1


@pytest.mark.parametrize(
    ("bodies", "expected"),
    [
        ([(4.0, 1.0, 10.0), (4.3, 3.6, 3.0)], 1),  # a foot: weaker, the same way
        ([(4.0, 1.0, 10.0), (4.3, 3.6, 10.0)], 2),  # as strong: somebody else
        ([(4.0, 1.5, 10.0), (4.3, -1.5, 3.0)], 2),  # the other way: somebody else
        ([(4.0, 1.0, 10.0), (4.6, 1.2, 10.0)], 1),  # closer than 0.8 m
        ([(4.0, 1.0, 10.0), (5.1, 1.0, 10.0)], 2),
        ([(3.4, 1.0, 10.0), (4.1, 1.0, 20.0), (4.8, 1.0, 9.0)], 1),
        ([(3.4, 1.0, 20.0), (4.1, 1.0, 10.0), (4.8, 1.0, 9.0)], 2),  # no chain from the strongest to the third
    ],
)
def test_clusters_are_merged_to_bodies(bodies, expected):
    scan = scans_of(noise(201, 9) + sum(echo(*body, 201) for body in bodies))[0]
    assert len(scan.detections) == expected


def test_noise_that_bins_share_is_a_body_as_seldom():
    radar = Radar.preset("x4")
    generator, count = np.random.default_rng(0), 0
    for _ in range(6):
        silence = Samples(np.zeros((5001, radar.n_range_bins), np.complex64))
        shared = silence.with_noise(draw_key(generator), 1.0, link.make_noise_taps(radar)).matrix
        baseband = label_baseband(shared, np.arange(5001) / radar.prf_hz, radar)
        scans = find_scans(baseband, wavelength_m=radar.wavelength_m)
        count += sum(len(scan.detections) for scan in scans)
    assert count <= 16  # 30 s, all cells of an X4; 20 and more without regard to the shared noise


def test_the_direct_path_is_left_out():
    values = noise(1001, 10)
    values = values + echo(0.8, 0.6, 30.0, 1001) * (RANGE_M < 1.2)
    assert any(d.range_m < 1.2 for scan in scans_of(values) for d in scan.detections)
    far = [d for scan in scans_of(values, Detector(near_m=1.5)) for d in scan.detections]
    assert all(d.range_low_m > 1.4 for d in far)


def test_what_is_left_of_drifting_clutter_is_no_body():
    phase_rad = 0.2 * np.sin(2 * np.pi * 0.3 * np.arange(5001) / PRF_HZ)
    clutter = 300.0 * noise(1, 11) * np.exp(1j * phase_rad)[:, None]
    values = noise(5001, 12) + clutter
    left = values - values.mean(axis=0)
    assert sum(len(scan.detections) for scan in scans_of(left, Detector(clutter="none"))) < 10
    assert sum(len(scan.detections) for scan in scans_of(left, Detector(clutter="none", slow_mps=0.0))) >= 45
    # the phase is common to all bins, and nothing is left of it in the first place
    assert sum(len(scan.detections) for scan in scans_of(values, Detector(slow_mps=0.0))) < 10


def test_without_range_there_is_one_detection_for_each_cluster_of_doppler():
    turn = np.exp(4j * np.pi / WAVELENGTH_M * np.array([1.0, -3.0])[:, None] * np.arange(1001) / PRF_HZ)
    values = (noise(1001, 13, n_bins=1)[:, 0] + 2 * turn.sum(axis=0))[:, None]
    for scan in scans_of(values, range_m=np.array([0.0])):
        assert sorted(d.velocity_mps for d in scan.detections) == pytest.approx([-3.0, 1.0], abs=0.05)
        assert all(d.range_sd_m == NO_RANGE_SD_M and d.range_low_m == d.range_high_m == 0.0 for d in scan.detections)
    with pytest.raises(AnalysisError, match=r"1 range bins.*noise_map"):
        scans_of(values, Detector(method="os_cfar"), range_m=np.array([0.0]))


def test_what_cannot_be_analysed_is_refused():
    with pytest.raises(AnalysisError, match="less than one processing interval"):
        scans_of(noise(60, 15))
    with pytest.raises(AnalysisError, match="raise cpi_s"):
        scans_of(noise(100, 15), prf_hz=17.0)
    bursts = baseband(noise(400, 15)).assign_attrs(burst_pulses=4)
    with pytest.raises(AnalysisError, match="a burst has 4 pulses"):
        find_scans(bursts, wavelength_m=WAVELENGTH_M)
    for wrong in ({"peak_pfa": 1e-2}, {"guard_m": 2.5}, {"threshold": 3}):
        with pytest.raises(ConfigError):
            Detector(**wrong)
    assert noise_factor(1e-6) == pytest.approx(6 * np.log(10))
