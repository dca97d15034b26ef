"""Swaps, jumps and points that are no part of the body: put in at known places, found there and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

from doppelgait.motion import Motion, make_motion
from doppelgait.motion.clean import clean_motion, find_jumps, find_steps, find_useless_points, repair_swaps
from doppelgait.motion.models import boulic_walk, quadruped_gait

RATE_HZ = 120.0


def person(speed_mps: float = 1.4, *, rate_hz: float = RATE_HZ, duration_s: float = 3.0) -> Motion:
    return boulic_walk(speed_mps=speed_mps, height_m=1.75, duration_s=duration_s, rate_hz=rate_hz)


def noise(shape: tuple[int, ...], sd_m: float = 0.002, seed: int = 7) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, sd_m, shape)


def recording(position: np.ndarray, names: list[str], parts: list[str], *, rate_hz: float = RATE_HZ) -> Motion:
    return make_motion(position, rate_hz=rate_hz, markers=names, parts=parts, facts={"kind": "recording"})


@pytest.mark.parametrize(
    ("first", "second"),
    [("left_knee", "right_knee"), ("head", "left_toe"), ("left_hand", "left_hip"), ("left_ankle", "left_toe")],
)
@pytest.mark.parametrize("sd_m", [0.0, 0.002])
def test_a_swap_is_found_where_it_is_and_undone(first: str, second: str, sd_m: float) -> None:
    walk = person()
    names, truth = walk.markers, walk.position_m + noise(walk.positions.shape, sd_m)
    i, j = names.index(first), names.index(second)
    frame = 150
    swapped = truth.copy()
    swapped[frame:, [i, j]] = swapped[frame:, [j, i]]
    assert repair_swaps(swapped, names, rate_hz=RATE_HZ) == [{"frame": frame, "points": sorted([first, second])}]
    np.testing.assert_array_equal(swapped, truth)


def test_three_points_that_change_places_in_a_ring_are_put_back() -> None:
    walk = person()
    names, truth = walk.markers, walk.position_m + noise(walk.positions.shape)
    ring = [names.index(name) for name in ("left_knee", "left_elbow", "head")]
    pairs = [names.index(name) for name in ("left_hip", "right_hand", "right_toe", "right_elbow")]
    swapped = truth.copy()
    swapped[100:, pairs] = swapped[100:, [pairs[k] for k in (1, 0, 3, 2)]]
    assert len(repair_swaps(swapped, names, rate_hz=RATE_HZ)) == 2
    np.testing.assert_array_equal(swapped, truth)
    swapped[100:, ring] = swapped[100:, [ring[k] for k in (1, 2, 0)]]
    assert repair_swaps(swapped, names, rate_hz=RATE_HZ) == []  # no exchange of two mends a ring
    assert {jump["frame"] for jump in find_jumps(swapped, names, rate_hz=RATE_HZ)} == {100}


@pytest.mark.parametrize("missing", [1, 5, 10])
def test_a_swap_across_a_gap_is_undone(missing: int) -> None:
    walk = person()
    names, truth = walk.markers, walk.position_m.copy()
    i, j = names.index("left_knee"), names.index("right_hand")
    truth[140 : 140 + missing, [i, j]] = np.nan
    swapped = truth.copy()
    swapped[140:, [i, j]] = swapped[140:, [j, i]]
    found = repair_swaps(swapped, names, rate_hz=RATE_HZ)
    assert found == [{"frame": 140 + missing, "points": ["left_knee", "right_hand"]}]
    np.testing.assert_array_equal(swapped, truth)


@pytest.mark.parametrize("step_m", [0.08, 0.3])
def test_a_jump_is_reported_and_left_as_it_is(step_m: float) -> None:
    walk = person()
    jumped = walk.position_m + noise(walk.positions.shape)
    jumped[200:, 3, 1] += step_m
    before, names = jumped.copy(), walk.markers
    assert repair_swaps(jumped, names, rate_hz=RATE_HZ) == []
    (jump,) = find_jumps(jumped, names, rate_hz=RATE_HZ)
    assert (jump["frame"], jump["point"]) == (200, names[3])
    assert jump["step_m"] == pytest.approx(step_m, abs=0.02)
    np.testing.assert_array_equal(jumped, before)


def test_a_step_is_what_is_no_constant_acceleration() -> None:
    time = np.arange(20) / 50.0
    path = np.stack([1 + 2 * time, 3 * time**2, 0 * time], axis=1)[:, np.newaxis]
    step, _ = find_steps(path, rate_hz=50.0, floor_m=0.05, jerk_mps3=0.0)
    assert np.isnan(step[[0, 1, -1]]).all()
    np.testing.assert_allclose(step[2:-1], 0.0, atol=1e-12)
    cubic = np.stack([7.0 * time**3 / 6, 0 * time, 0 * time], axis=1)[:, np.newaxis]
    step, limit = find_steps(cubic, rate_hz=50.0, floor_m=0.0, jerk_mps3=12.0)
    np.testing.assert_allclose(step[2:-1], 7.0 / 50**3 / 2, rtol=1e-6)  # by hand: j h^3 / 2
    np.testing.assert_allclose(limit[2:-1], 12.0 / 50**3 / 2)


WALKS = [person(speed) for speed in (0.5, 1.1, 1.7, 2.57)]
DOGS = [quadruped_gait(gait=gait, duration_s=3.0, rate_hz=RATE_HZ) for gait in ("trot", "gallop")]


@pytest.mark.parametrize("sd_m", [0.0, 0.002])
@pytest.mark.parametrize("motion", [*WALKS, *DOGS], ids=lambda motion: str(motion.facts.gait))
def test_clean_motions_raise_no_alarm(motion: Motion, sd_m: float) -> None:
    position, names = motion.position_m + noise(motion.positions.shape, sd_m), motion.markers
    before = position.copy()
    assert repair_swaps(position, names, rate_hz=RATE_HZ) == []
    np.testing.assert_array_equal(position, before)
    assert find_jumps(position, names, rate_hz=RATE_HZ) == []
    assert find_useless_points(position, names, motion.parts) == {}


def test_each_useless_point_goes_for_its_own_reason() -> None:
    walk = person()
    body, n = walk.position_m, walk.n_frames
    double = body[:, [4]] + noise((n, 1, 3), 0.001)
    short = body[:, [2]] + [0.1, 0.0, 0.0]
    short[40:] = np.nan
    far = np.stack([np.linspace(0, 3, n), np.full(n, 6.0), np.ones(n)], axis=1)[:, np.newaxis]
    position = np.concatenate([body, double, short, far], axis=1)
    names, parts = [*walk.markers, "a_double", "short", "far"], [*walk.parts, "", "", ""]
    assert find_useless_points(position, names, parts) == {
        17: f"at the place of {names[4]}", 18: "short-lived unknown point", 19: "far away from the body"
    }  # fmt: skip
    clean = clean_motion(recording(position, names, parts))
    assert clean.report["dropped"] == {
        f"at the place of {names[4]}": ["a_double"],
        "short-lived unknown point": ["short"],
        "far away from the body": ["far"],
    }
    assert clean.markers == walk.markers


def test_of_two_points_at_one_place_the_better_seen_stays() -> None:
    walk = person()
    position = np.concatenate([walk.position_m, walk.position_m[:, [4]]], axis=1)
    position[:30, 4] = np.nan
    names, parts = [*walk.markers, "double"], [*walk.parts, ""]
    assert find_useless_points(position, names, parts) == {4: "at the place of double"}


def test_a_named_point_is_kept_though_it_is_seen_briefly() -> None:
    walk = person()
    position = walk.position_m.copy()
    position[20:, 5] = np.nan
    assert find_useless_points(position, walk.markers, walk.parts) == {}


def test_noise_alone_ends() -> None:
    names = [f"m{i}" for i in range(30)]
    chaos = noise((600, 30, 3), sd_m=1.0)
    assert len(repair_swaps(chaos, names, rate_hz=RATE_HZ)) <= 200
    assert len(find_jumps(chaos, names, rate_hz=RATE_HZ)) > 1000


def spoilt() -> Motion:
    """A walk with one of every fault."""
    walk = person()
    names, position = walk.markers, walk.position_m + noise(walk.positions.shape, 0.001)
    position = np.concatenate([position, position[:, [6]]], axis=1)
    i, j = names.index("left_knee"), names.index("right_elbow")
    position[120:, [i, j]] = position[120:, [j, i]]
    position[60, 8] += 0.4
    position[200:207, 9] = np.nan
    position[:50, [2, 10]] = np.nan
    position[250:, 13, 1] += 0.1
    return recording(position, [*names, "double"], [*walk.parts, ""])


def test_one_of_every_fault_is_reported_with_its_place() -> None:
    clean = clean_motion(spoilt())
    report, names = clean.report, person().markers
    assert report["swaps_repaired"] == [{"frame": 120, "points": ["left_knee", "right_elbow"]}]
    assert [(jump["frame"], jump["point"]) for jump in report["jumps"]] == [(250, names[13])]
    assert (report["spikes_removed"], report["gaps_filled"]) == (1, 2)
    assert report["dropped"] == {
        f"at the place of {names[6]}": ["double"],
        "not seen throughout (gaps up to 0.25 s are filled)": [names[2], names[10]],
    }
    assert report["parts"] == "known"


@pytest.mark.parametrize("seed", range(2))
def test_cleaning_does_not_depend_on_the_order_of_points(seed: int) -> None:
    motion = spoilt()
    order = np.random.default_rng(seed).permutation(len(motion.markers))
    straight, mixed = clean_motion(motion), clean_motion(replace(motion, positions=motion.positions.isel(marker=order)))
    np.testing.assert_allclose(mixed.positions.sel(marker=straight.markers).values, straight.position_m, atol=1e-12)
    for key in ("swaps_repaired", "jumps", "spikes_removed", "gaps_filled", "kept_from_s", "kept_to_s"):
        assert mixed.report[key] == straight.report[key]
    dropped = [{why: sorted(who) for why, who in m.report["dropped"].items()} for m in (straight, mixed)]
    assert dropped[0] == dropped[1]


def test_cleaning_goes_with_the_place_and_the_heading() -> None:
    motion, shift_m = spoilt(), np.array([-40.0, 25.0, 0.0])
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    moved = motion.with_positions(motion.position_m @ turn.T + shift_m)
    straight, other = clean_motion(motion), clean_motion(moved)
    np.testing.assert_allclose(other.position_m, straight.position_m @ turn.T + shift_m, atol=1e-6)
    assert other.report["dropped"] == straight.report["dropped"]
    assert other.report["swaps_repaired"] == straight.report["swaps_repaired"]


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        (["head"] * 3, "known"),
        (["torso", "", ""], "1 of 3 known"),
        (["head", "", ""], "1 of 3 known: equal split"),
        ([""] * 3, "unknown: equal split"),
    ],
)
def test_report_says_how_many_parts_are_known(parts: list[str], said: str) -> None:
    walk = person()
    motion = recording(walk.position_m[:, [0, 2, 14]], ["a", "b", "c"], parts)
    assert clean_motion(motion).report["parts"] == said
