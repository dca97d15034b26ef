"""Tracks of drawn detections: start, crossing, rest, end, and the gate that comes of them."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import chi2, multivariate_normal

from doppelgait.core.config import validate
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.core.frames import Frames
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.processing import Gate
from doppelgait.processing.track import Track, Tracker, kalman, split_tracks, track
from doppelgait.processing.track import tracker as association
from doppelgait.processing.track.kalman import Gaussian
from doppelgait.processing.track.live import Detection, Scan
from doppelgait.radar import Radar
from doppelgait.radar.simulate import label_baseband
from doppelgait.testing.tracking import compare_tracks

TIMES = np.arange(0.05, 6.0, 0.1)


def seen(range_m: float, velocity_mps: float, *, half_m: float = 0.3, half_mps: float = 1.0, **own: float) -> Detection:
    box = (range_m - half_m, range_m + half_m, velocity_mps - half_mps, velocity_mps + half_mps)
    values = {"power_v2": 1.0, "range_sd_m": 0.07, "velocity_sd_mps": 0.2, **own}
    return Detection(
        range_m, velocity_mps, values["power_v2"], values["range_sd_m"], values["velocity_sd_mps"], *box, 20
    )


def noisy(range_m: float, velocity_mps: float, rng: np.random.Generator) -> Detection:
    return seen(range_m + 0.07 * rng.standard_normal(), velocity_mps + 0.2 * rng.standard_normal())


def walk(start_m: float, velocity_mps: float, times_s: np.ndarray = TIMES) -> np.ndarray:
    return start_m - velocity_mps * times_s


def scans_of(bodies: list[tuple[np.ndarray, float]], rng: np.random.Generator, *, detected: float = 1.0) -> list[Scan]:
    return [
        Scan(float(t), tuple(noisy(r[n], v, rng) for r, v in bodies if rng.random() < detected))
        for n, t in enumerate(TIMES)
    ]


def table(tracks: list[Track], times_s: np.ndarray = TIMES) -> np.ndarray:
    found = np.full((times_s.size, len(tracks)), np.nan)
    for n, one in enumerate(tracks):
        found[np.searchsorted(times_s, one.times_s - 1e-6), n] = one.range_m
    return found


def test_one_walker_is_one_consistent_track() -> None:
    """A body with the white acceleration that the filter assumes: errors as claimed, NIS as a gated chi-square."""
    q, dt = 0.75, 0.1
    noise = np.linalg.cholesky(q * np.array([[dt**3 / 3, -(dt**2) / 2], [-(dt**2) / 2, dt]]))
    ratios, nis = [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        states = [np.array([20.0, 1.2])]
        for _ in TIMES[1:]:
            range_m, velocity = states[-1]
            states.append(np.array([range_m - dt * velocity, velocity]) + noise @ rng.standard_normal(2))
        truth = np.array(states)
        scans = [
            Scan(float(t), (noisy(r, v, rng),) if rng.random() < 0.95 else ())
            for t, (r, v) in zip(TIMES, truth, strict=True)
        ]
        one = max(track(scans), key=lambda found: found.measured.sum())
        inside = np.searchsorted(TIMES, one.times_s - 1e-6)
        ratios.append(((one.range_m - truth[inside, 0]) / one.range_sd_m)[5:-5])
        ratios.append(((one.velocity_mps - truth[inside, 1]) / one.velocity_sd_mps)[5:-5])
        nis.append(one.mean_nis)
    assert np.std(np.concatenate(ratios)) == pytest.approx(1.0, abs=0.1)
    limit = -2 * np.log(0.01)
    assert np.mean(nis) == pytest.approx(2 - limit * 0.01 / 0.99, abs=0.12)  # mean of an exponential cut at the gate


def test_noise_alone_confirms_nothing_that_stays() -> None:
    rng = np.random.default_rng(4)
    scans = [
        Scan(0.1 * n, tuple(seen(rng.uniform(0.5, 9.5), rng.uniform(-8, 8)) for _ in range(rng.poisson(1.0))))
        for n in range(1200)
    ]
    assert len(track(scans)) <= 2  # in two minutes


def crossing_scans(rng: np.random.Generator, *, merge_mps: float) -> tuple[list[Scan], np.ndarray]:
    ranges = np.c_[walk(8, 1.0), walk(2, -1.0)]
    scans = []
    for t, (a_m, b_m) in zip(TIMES, ranges, strict=True):
        a, b = noisy(a_m, 1.0, rng), noisy(b_m, -1.0, rng)
        both = (a, b)
        if abs(a.range_m - b.range_m) < 0.8 and abs(a.velocity_mps - b.velocity_mps) < merge_mps:
            r, v = (a.range_m + b.range_m) / 2, (a.velocity_mps + b.velocity_mps) / 2
            low, high = min(a.range_low_m, b.range_low_m), max(a.range_high_m, b.range_high_m)
            slow, fast = min(d.velocity_low_mps for d in both), max(d.velocity_high_mps for d in both)
            both = (Detection(r, v, 2.0, 0.1, 0.3, low, high, slow, fast, 40),)
        scans.append(Scan(float(t), tuple(d for d in both if rng.random() < 0.95)))
    return scans, ranges


@pytest.mark.parametrize("merge_mps", [0.0, 2.0, 9.0])
def test_crossing_keeps_identities(merge_mps: float) -> None:
    """Detections apart throughout, merged at times and always merged; the demand is 90 % of runs."""
    good = 0
    for seed in range(20):
        scans, truth = crossing_scans(np.random.default_rng(seed), merge_mps=merge_mps)
        tracks = track(scans)
        result = compare_tracks(table(tracks), truth)
        good += len(tracks) == 2 and result.switches == 0 and result.gospa < 0.35
    assert good >= 19


@pytest.mark.parametrize("pause_s", [1.5, 5.0])
def test_rest_is_bridged(pause_s: float) -> None:
    """2 s of walking, slowing down in 1 s, unseen while slower than 0.2 m/s, and on."""
    times = np.arange(0.05, 6.0 + pause_s, 0.1)
    speed = np.interp(times, [0, 2, 3, 3 + pause_s, 4 + pause_s], [1.2, 1.2, 0, 0, 1.2])
    ranges = 8 - np.concatenate([[0], np.cumsum((speed[1:] + speed[:-1]) / 2 * 0.1)])
    rng = np.random.default_rng(5)
    scans = [
        Scan(float(t), (noisy(r, v, rng),) if v > 0.2 else ()) for t, r, v in zip(times, ranges, speed, strict=True)
    ]
    (one,) = track(scans)
    assert np.abs(one.range_m - ranges).max() < 0.3
    assert (~one.measured).sum() >= 10 * pause_s - 2
    assert len(track(scans, Tracker(rest_speed_mps=0.0))) == 2


def test_walker_who_vanishes_ends_at_the_last_detection() -> None:
    rng = np.random.default_rng(6)
    scans = scans_of([(walk(8, 1.2), 1.2)], rng)
    scans[30:] = [Scan(scan.time_s) for scan in scans[30:]]
    (one,) = track(scans)
    assert one.last_s == pytest.approx(TIMES[29])
    again = scans[:30] + scans_of([(walk(8, 1.2), 1.2)], rng)[30:]
    again[30:45] = [Scan(scan.time_s) for scan in again[30:45]]
    assert [round(one.last_s, 2) for one in track(again)] == [2.95, 5.95]


def test_slow_confirmation_needs_four_of_six() -> None:
    body = [(walk(8, 1.2), 1.2)]
    scans = scans_of(body, np.random.default_rng(7))
    three_of_six = [scan if n % 6 in (0, 2, 4) else Scan(scan.time_s) for n, scan in enumerate(scans)]
    assert track(three_of_six) == []
    four_of_six = [scan if n % 6 in (0, 2, 3, 5) else Scan(scan.time_s) for n, scan in enumerate(scans)]
    (one,) = track(four_of_six)
    assert one.confirmed_at_s == pytest.approx(TIMES[5])
    assert one.detected_share == pytest.approx(40 / 60, abs=0.01)


def test_limb_far_from_the_body_keeps_the_track() -> None:
    """Every fifth scan the centre of the cluster jumps to a leg: outside the gate, its box still about the body."""
    rng = np.random.default_rng(8)
    scans = scans_of([(walk(8, 1.2), 1.2)], rng)
    for n in range(2, 60, 5):
        scans[n] = Scan(scans[n].time_s, (seen(walk(8, 1.2)[n] - 0.25, 3.6, half_mps=2.8),))
    (one,) = track(scans)
    assert one.measured[one.times_s > one.confirmed_at_s].all()
    assert np.abs(one.range_m - walk(8, 1.2)).max() < 0.2


def test_second_detection_of_a_body_starts_no_track() -> None:
    rng = np.random.default_rng(9)
    scans = [
        Scan(s.time_s, (*s.detections, seen(s.detections[0].range_m + 0.6, 3.0, power_v2=0.1)))
        for s in scans_of([(walk(8, 1.2), 1.2)], rng)
    ]
    assert len(track(scans)) == 1


def test_shadow_of_a_standing_body_is_no_target() -> None:
    still = [Scan(float(t), (seen(4.0, 0.0, half_mps=0.4),)) for t in TIMES]
    assert track(still) == []
    assert len(track(still, Tracker(still_travel_m=0.0))) == 1
    on_the_spot = [Scan(float(t), (seen(4.0, 0.0, half_mps=2.0),)) for t in TIMES]
    assert len(track(on_the_spot)) == 1


def test_what_changes_its_range_without_a_doppler_shift_is_no_target() -> None:
    """Drifting clutter: narrow, at 0 m/s, and now here and now there. A robot is as narrow and moves."""
    places = np.interp(TIMES, [0, 2, 2.5, 4, 4.5, 6], [1.0, 1.0, 1.3, 1.3, 1.6, 1.6])
    sure = {"velocity_sd_mps": 0.05}
    drifts = [Scan(float(t), (seen(float(r), 0.0, half_mps=0.3, **sure),)) for t, r in zip(TIMES, places, strict=True)]
    assert track(drifts) == []
    assert len(track(drifts, Tracker(still_speed_mps=0.0))) == 1
    robot = [Scan(float(t), (seen(float(4 - 0.2 * t), 0.2, half_mps=0.3, **sure),)) for t in TIMES]
    assert len(track(robot)) == 1


def test_at_most_as_many_as_asked_for() -> None:
    rng = np.random.default_rng(10)
    scans = scans_of([(walk(9, 1.2), 1.2), (walk(1.5, -0.2), -0.2)], rng)
    scans[:20] = [Scan(s.time_s, s.detections[:1]) for s in scans[:20]]
    assert len(track(scans)) == 2
    (one,) = track(scans, Tracker(max_targets=1))
    assert one.range_m[0] == pytest.approx(9, abs=0.2)


def with_velocities(scans: list[Scan], change: Callable[[float], float]) -> list[Scan]:
    return [Scan(s.time_s, tuple(seen(d.range_m, change(d.velocity_mps)) for d in s.detections)) for s in scans]


@pytest.mark.parametrize("velocity", [1.2, 4.4, -5.5])
def test_folded_velocities_are_unfolded_by_the_range(velocity: float) -> None:
    """300 frames/s at 7.29 GHz: 6.17 m/s of span, +-3.08 m/s."""
    span = 6.17
    start = 30.0 if velocity > 0 else 2.0
    scans = scans_of([(walk(start, velocity), velocity)], np.random.default_rng(11))
    folded = with_velocities(scans, lambda velocity_mps: (velocity_mps + span / 2) % span - span / 2)
    (one,) = track(folded, velocity_span_mps=span)
    assert one.velocity_mps.mean() == pytest.approx(velocity, abs=0.1)
    assert one.first_s == pytest.approx(TIMES[0])


def test_velocities_of_a_slow_radar_are_left_out() -> None:
    """17 frames/s: 0.35 m/s of span; what is told is not used."""
    rng = np.random.default_rng(12)
    scans = scans_of([(walk(8, 1.2), 1.2)], rng)
    (one,) = track(with_velocities(scans, lambda _: rng.uniform(-0.17, 0.17)), velocity_span_mps=0.35)
    assert one.velocity_mps[10:].mean() == pytest.approx(1.2, abs=0.1)


def test_faults_are_named() -> None:
    scan = Scan(1.0, (seen(3.0, 1.0),))
    with pytest.raises(AnalysisError, match="ascending, different times"):
        track([scan, scan])
    with pytest.raises(AnalysisError, match="at 1 s: range nan"):
        track([Scan(1.0, (seen(float("nan"), 1.0),))])
    with pytest.raises(ConfigError, match="confirm_hits = 7"):
        validate(Tracker, {"confirm_hits": 7})
    assert track([]) == []


def test_gate_covers_the_time_of_the_track_and_no_more() -> None:
    rng = np.random.default_rng(13)
    scans = scans_of([(walk(8, 1.2), 1.2)], rng)
    scans[:20] = [Scan(s.time_s) for s in scans[:20]]
    (one,) = track(scans)
    slow_time = np.arange(6000) / 1000.0
    gate = Gate.from_track(one, span_m=1.6, time_s=slow_time, cpi_s=0.1)
    assert gate.source == "track"
    assert gate.time_s[[0, -1]] == pytest.approx([2.0, 5.999], abs=2e-3)
    middle = (gate.low_m + gate.high_m) / 2
    np.testing.assert_allclose(middle, walk(8, 1.2, gate.time_s), atol=0.12)
    assert middle[0] - middle[50] == pytest.approx(0.05 * one.velocity_mps[0], rel=1e-6)
    np.testing.assert_allclose(gate.high_m - gate.low_m, 1.6)
    radar = Radar.preset("x4")
    baseband = label_baseband(np.zeros((6000, radar.n_range_bins), dtype=np.complex64), slow_time, radar)
    part = gate.crop(Frames.of(baseband)).label()
    np.testing.assert_array_equal(part["slow_time"].values, gate.time_s)
    with pytest.raises(AnalysisError, match="pulses"):
        Gate.from_track(one, span_m=1.6, time_s=slow_time[:1000])


WAVELENGTH_M, PRF_HZ, BIN_M, PULSE_M = 0.0411, 500.0, 0.05, 0.11
TIMES_S = np.arange(0.1, 4.0, 0.1)


def echoes(*ways, seconds=4.1, noise=0.0):
    """Sum Gaussian echoes: (start range, speed, amplitude, swing speed) each, the last for a limb."""
    slow_s = np.arange(round(seconds * PRF_HZ)) / PRF_HZ
    range_m = 1.0 + BIN_M * np.arange(180)
    data = np.zeros((slow_s.size, range_m.size), dtype=np.complex128)
    for start_m, speed_mps, amplitude, swing_mps in ways:
        swing_m = swing_mps / (2 * np.pi * 1.8) * np.sin(2 * np.pi * 1.8 * slow_s)
        place_m = start_m - speed_mps * slow_s + swing_m
        pulse = np.exp(-(((range_m - place_m[:, None]) / PULSE_M) ** 2))
        data += amplitude * pulse * np.exp(-4j * np.pi * place_m / WAVELENGTH_M)[:, None]
    rng = np.random.default_rng(1)
    data += noise * (rng.standard_normal(data.shape) + 1j * rng.standard_normal(data.shape)) / np.sqrt(2)
    return make_array(BASEBAND, data.astype(np.complex64), {"slow_time": slow_s, "range": range_m}, {"units": "V"})


def track_of(start_m, speed_mps, times_s=TIMES_S):
    centre_m, same = start_m - speed_mps * times_s, np.full(times_s.size, speed_mps)
    width, yes = np.full(times_s.size, 0.1), np.ones(times_s.size, dtype=bool)
    return Track(
        times_s=times_s, range_m=centre_m, velocity_mps=same, range_sd_m=width, velocity_sd_mps=width, measured=yes,
        shared=~yes, range_low_m=centre_m - 0.5, range_high_m=centre_m + 0.5, velocity_low_mps=same - 1,
        velocity_high_mps=same + 1, confirmed_at_s=float(times_s[3]), mean_nis=2.0, mean_power_v2=1.0,
    )  # fmt: skip


def divided(clean, *tracks):
    return split_tracks(tracks, Frames.of(clean), wavelength_m=WAVELENGTH_M, cpi_s=0.1)


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize("apart_m", [0.7, 0.85, 1.1])
def test_who_follows_has_a_track_of_its_own(apart_m, noise):
    clean = echoes((7.0, 1.2, 1.0, 0.0), (7.0 + apart_m, 1.2, 0.6, 0.0), noise=noise)
    near, far = divided(clean, track_of(7.0 + apart_m / 2, 1.2))
    for one, start_m in ((near, 7.0), (far, 7.0 + apart_m)):
        assert one.range_m == pytest.approx(start_m - 1.2 * one.times_s, abs=0.06)
        assert one.velocity_mps == pytest.approx(1.2)
    assert far.last_s - far.first_s > 3.0


@pytest.mark.parametrize(
    "others",
    [
        (),
        ((7.45, 1.2, 0.7, 0.0),),  # chest and rump
        ((7.1, 1.2, 0.7, 2.5), (6.9, 1.2, 0.7, -2.5)),  # legs
        ((8.0, 1.2, 0.1, 0.0),),  # 20 dB below
        ((7.9, -1.2, 0.8, 0.0),),  # goes the other way
    ],
)
def test_one_body_stays_one(others):
    (one,) = divided(echoes((7.0, 1.2, 1.0, 0.0), *others, noise=0.02), track_of(7.0, 1.2))
    assert np.array_equal(one.range_m, track_of(7.0, 1.2).range_m)


def test_who_stands_beside_a_slow_body_is_not_followed():
    (one,) = divided(echoes((5.0, 0.2, 1.0, 0.0), (5.9, 0.2, 1.0, 0.0)), track_of(5.0, 0.2))
    assert np.array_equal(one.range_m, track_of(5.0, 0.2).range_m)


def test_an_echo_that_has_a_track_is_not_split_again():
    clean = echoes((7.0, 1.2, 1.0, 0.0), (8.0, 1.2, 0.6, 0.0))
    assert len(divided(clean, track_of(7.0, 1.2), track_of(8.0, 1.2))) == 2


def test_a_second_echo_is_joined_to_the_track_that_continues_it():
    clean = echoes((7.0, 1.2, 1.0, 0.0), (8.0, 1.2, 0.6, 0.0))
    late = track_of(8.0, 1.2, TIMES_S[TIMES_S > 2.9])
    near, far = divided(clean, track_of(7.0, 1.2), late)
    assert far.first_s < 0.3
    assert far.last_s == late.last_s
    assert (np.diff(far.times_s) > 0.05).all()
    assert far.range_m == pytest.approx(8.0 - 1.2 * far.times_s, abs=0.06)
    assert near.range_m == pytest.approx(7.0 - 1.2 * near.times_s, abs=0.06)


MISS = math.log(0.1)
CHANCES = {"detection_probability": 0.9, "gate_probability": 0.99}


def all_events(gain: np.ndarray) -> list[tuple[tuple[int, ...], float]]:
    """Every joint event as detections per track (-1: none) and its log weight."""
    tracks, detections = gain.shape
    events = []
    for event in itertools.product(range(-1, detections), repeat=tracks):
        hits = [d for d in event if d >= 0]
        if len(set(hits)) == len(hits):
            events.append((event, sum(gain[t, d] if d >= 0 else MISS for t, d in enumerate(event))))
    return events


@pytest.mark.parametrize("seed", range(30))
def test_assignment_and_probabilities_equal_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    gain = rng.normal(0, 3, size=(rng.integers(1, 4), rng.integers(1, 5)))
    gain[rng.random(gain.shape) < 0.3] = -np.inf
    events = all_events(gain)
    best = max(weight for _, weight in events)
    chosen = association.find_best_assignment(gain, MISS)
    assert sum(gain[t, d] if d >= 0 else MISS for t, d in enumerate(chosen)) == pytest.approx(best)
    table = np.zeros((gain.shape[0], gain.shape[1] + 1))
    for event, weight in events:
        for t, d in enumerate(event):
            table[t, d] += math.exp(weight)
    np.testing.assert_allclose(
        association.compute_joint_probabilities(gain, MISS), table / table.sum(axis=1, keepdims=True), rtol=1e-9
    )


def test_gate_is_the_chi_square_quantile() -> None:
    assert association.compute_gate_threshold(0.99) == pytest.approx(chi2.ppf(0.99, 2))


def test_single_track_has_the_closed_form_of_pda() -> None:
    """beta_j = L_j / (1 - Pd Pg + sum L), L = Pd N / lambda (Bar-Shalom, Tse 1975)."""
    densities = np.array([[0.8, 0.1, 0.03]])
    found = association.associate(np.log(densities), **CHANCES, clutter_density=0.05, association="jpda")
    likelihood = 0.9 * densities[0] / 0.05
    total = 1 - 0.9 * 0.99 + likelihood.sum()
    np.testing.assert_allclose(found.weights[0], [*(likelihood / total), (1 - 0.9 * 0.99) / total])
    assert found.assigned.tolist() == [0]


def test_auto_is_hard_alone_and_soft_where_gates_overlap() -> None:
    alone = np.log(np.array([[0.5, 0.2]]))
    kwargs = {**CHANCES, "clutter_density": 0.005}
    assert association.associate(alone, **kwargs).weights.tolist() == [[1.0, 0.0, 0.0]]
    both = association.associate(np.log(np.array([[0.5], [0.4]])), **kwargs)
    assert both.assigned.tolist() == [0, -1]
    assert 0 < both.weights[1, 0] < both.weights[0, 0] < 1
    hard = association.associate(np.log(np.array([[0.5], [0.4]])), **kwargs, association="gnn")
    assert hard.weights.tolist() == [[1.0, 0.0], [0.0, 1.0]]
    weak = association.associate(np.log(np.array([[1e-6]])), **CHANCES, clutter_density=0.5)
    assert weak.assigned.tolist() == [-1]


@pytest.mark.parametrize("seed", range(20))
def test_clusters_are_the_connected_components(seed: int) -> None:
    from scipy.sparse.csgraph import connected_components

    rng = np.random.default_rng(seed)
    gate = rng.random((5, 6)) < 0.2
    graph = np.zeros((11, 11))
    graph[:5, 5:] = gate
    _, label = connected_components(graph, directed=False)
    expected = []
    for k in sorted(set(label[:5][gate.any(axis=1)])):
        expected.append((np.flatnonzero(label[:5] == k).tolist(), np.flatnonzero(label[5:] == k).tolist()))
    assert association.find_clusters(gate) == sorted(expected)


Q, DT, RANGE_SD, VELOCITY_SD = 0.75, 0.1, 0.08, 0.2
ERRORS = {"range_sd_m": RANGE_SD, "velocity_sd_mps": VELOCITY_SD}
START = Gaussian(5.0, 1.2, 0.04, -0.01, 0.09)


def van_loan(drift: np.ndarray, diffusion: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition and noise covariance of dx = A x dt + noise of density D (Van Loan 1978)."""
    n = len(drift)
    block = np.block([[-drift, diffusion], [np.zeros((n, n)), drift.T]]) * dt
    power = expm(block)
    transition = power[n:, n:].T
    return transition, transition @ power[:n, n:]


def matrices(model: kalman.Model) -> tuple[np.ndarray, np.ndarray]:
    transition = np.array([[1.0, -model.carry_s], [0.0, model.keep]])
    return transition, np.array([[model.range_m2, model.cross_m2ps], [model.cross_m2ps, model.velocity_m2ps2]])


@pytest.mark.parametrize("dt", [0.02, 0.1, 0.7])
def test_constant_velocity_is_the_sampled_white_acceleration(dt: float) -> None:
    transition, noise = van_loan(np.array([[0.0, -1.0], [0.0, 0.0]]), np.diag([0.0, Q]), dt)
    got = matrices(kalman.make_constant_velocity_model(dt, acceleration_noise_m2ps3=Q))
    np.testing.assert_allclose(got[0], transition, rtol=1e-12)
    np.testing.assert_allclose(got[1], noise, rtol=1e-9)


@pytest.mark.parametrize("dt", [0.02, 0.1, 2.0])
def test_rest_is_the_sampled_ornstein_uhlenbeck_process(dt: float) -> None:
    tau, sd = 0.3, 0.4
    transition, noise = van_loan(np.array([[0.0, -1.0], [0.0, -1 / tau]]), np.diag([0.0, 2 * sd**2 / tau]), dt)
    got = matrices(kalman.make_resting_model(dt, time_constant_s=tau, velocity_sd_mps=sd))
    np.testing.assert_allclose(got[0], transition, rtol=1e-10)
    np.testing.assert_allclose(got[1], noise, rtol=1e-6)


def test_steps_equal_the_matrix_form() -> None:
    model = kalman.make_constant_velocity_model(DT, acceleration_noise_m2ps3=Q)
    transition, noise = matrices(model)
    predicted = kalman.predict(START, model)
    mean, cov = transition @ np.array(START[:2]), transition @ kalman.make_covariance(START) @ transition.T + noise
    np.testing.assert_allclose(predicted[:2], mean)
    np.testing.assert_allclose(kalman.make_covariance(predicted), cov)
    z, r = np.array([4.8, 1.5]), np.diag([RANGE_SD**2, VELOCITY_SD**2])
    seen = kalman.compute_innovation(predicted, range_m=4.8, velocity_mps=1.5, **ERRORS)
    s = cov + r
    assert seen.nis == pytest.approx((z - mean) @ np.linalg.solve(s, z - mean))
    assert seen.log_likelihood == pytest.approx(multivariate_normal(mean, s).logpdf(z))
    gain = cov @ np.linalg.inv(s)
    joseph = (np.eye(2) - gain) @ cov @ (np.eye(2) - gain).T + gain @ r @ gain.T
    updated = kalman.update(predicted, seen)
    np.testing.assert_allclose(updated[:2], mean + gain @ (z - mean))
    np.testing.assert_allclose(kalman.make_covariance(updated), joseph)


def test_mixture_has_the_moments_of_its_samples() -> None:
    rng = np.random.default_rng(1)
    states, weights = [START, Gaussian(5.6, 0.2, 0.02, 0.005, 0.2)], [0.3, 0.7]
    n = 400_000
    draws = np.concatenate([
        rng.multivariate_normal(s[:2], kalman.make_covariance(s), size=round(w * n))
        for s, w in zip(states, weights, strict=True)
    ])  # fmt: skip
    got = kalman.merge_mixture(states, weights)
    np.testing.assert_allclose(got[:2], draws.mean(axis=0), atol=3e-3)
    np.testing.assert_allclose(kalman.make_covariance(got), np.cov(draws.T), atol=3e-3)


def test_smoother_is_the_least_squares_solution() -> None:
    """Smoothed means and covariances equal those of one large linear problem over all states (information form)."""
    n = 12
    rng = np.random.default_rng(3)
    model = kalman.make_constant_velocity_model(DT, acceleration_noise_m2ps3=Q)
    transition, noise = matrices(model)
    truth = rng.multivariate_normal(START[:2], kalman.make_covariance(START))
    filtered, predicted = [START], [START]
    for _ in range(n - 1):
        truth = transition @ truth + rng.multivariate_normal([0, 0], noise)
        z = truth + rng.standard_normal(2) * [RANGE_SD, VELOCITY_SD]
        before = kalman.predict(filtered[-1], model)
        seen = kalman.compute_innovation(before, range_m=z[0], velocity_mps=z[1], **ERRORS)
        predicted.append(before)
        filtered.append(kalman.update(before, seen))
    information, vector = np.zeros((2 * n, 2 * n)), np.zeros(2 * n)
    prior = np.linalg.inv(kalman.make_covariance(START))
    information[:2, :2] += prior
    vector[:2] += prior @ np.array(START[:2])
    for t in range(1, n):
        link = np.hstack([-transition, np.eye(2)])
        part = slice(2 * t - 2, 2 * t + 2)
        information[part, part] += link.T @ np.linalg.inv(noise) @ link
        own = slice(2 * t, 2 * t + 2)
        # what the update added to the information of the prediction
        after, before = (np.linalg.inv(kalman.make_covariance(s[t])) for s in (filtered, predicted))
        information[own, own] += after - before
        vector[own] += after @ np.array(filtered[t][:2]) - before @ np.array(predicted[t][:2])
    means, covs = np.linalg.solve(information, vector), np.linalg.inv(information)
    for t, state in enumerate(kalman.smooth(filtered, predicted, [model] * n)):
        np.testing.assert_allclose(state[:2], means[2 * t : 2 * t + 2], rtol=1e-6)
        np.testing.assert_allclose(kalman.make_covariance(state), covs[2 * t : 2 * t + 2, 2 * t : 2 * t + 2], rtol=1e-5)
