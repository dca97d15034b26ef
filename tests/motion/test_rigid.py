"""Segments found by constant distances, against bodies whose segments are known."""

import numpy as np
import pytest

from doppelgait.motion.models import boulic_walk
from doppelgait.motion.rigid import find_rigid_clusters, measure_distance_spread, propose_parts

RATE_HZ = 120.0


def linked_boxes(n_boxes: int = 4, points: int = 5, *, n_frames: int = 360, sd_m: float = 0.0) -> np.ndarray:
    """Boxes that turn and travel each in its own way; points of one box are neighbours in the list."""
    rng = np.random.default_rng(3)
    time = np.arange(n_frames) / RATE_HZ
    columns = []
    for k in range(n_boxes):
        corners = rng.uniform(-0.15, 0.15, (points, 3))
        angle = (0.6 + 0.1 * k) * np.sin(2 * np.pi * (0.7 + 0.3 * k) * time)
        turn = np.zeros((n_frames, 3, 3))
        turn[:, 0, 0] = turn[:, 2, 2] = np.cos(angle)
        turn[:, 0, 2], turn[:, 2, 0], turn[:, 1, 1] = np.sin(angle), -np.sin(angle), 1.0
        centre = np.stack([time, 0.3 * k + 0 * time, 0.3 + 0.4 * k + 0.05 * np.sin(5 * time + k)], axis=1)
        columns.append(np.einsum("tij,pj->tpi", turn, corners) + centre[:, np.newaxis])
    return np.concatenate(columns, axis=1) + rng.normal(0.0, sd_m, (n_frames, n_boxes * points, 3))


@pytest.mark.parametrize("sd_m", [0.0, 0.002])
def test_boxes_are_found(sd_m: float) -> None:
    assert find_rigid_clusters(linked_boxes(sd_m=sd_m)) == [list(range(5 * k, 5 * k + 5)) for k in range(4)]


def test_boxes_are_found_in_any_order_and_with_gaps() -> None:
    body = linked_boxes(sd_m=0.001)
    body[50:120, 3] = np.nan
    body[:, 7] = np.nan
    order = np.random.default_rng(1).permutation(20)
    found = {frozenset(order[group]) for group in find_rigid_clusters(body[:, order])}
    assert found == {frozenset(range(5 * k, 5 * k + 5)) - {7} for k in range(4)}


def test_spread_is_the_standard_deviation_of_a_noisy_distance() -> None:
    rng = np.random.default_rng(2)
    pair = np.zeros((1000, 2, 3))
    pair[:, 1, 0] = 0.5 + rng.normal(0.0, 0.01, 1000)
    assert measure_distance_spread(pair)[0, 1] == pytest.approx(pair[:, 1, 0].std(), rel=0.08)
    assert measure_distance_spread(pair)[0, 0] == 0.0


def marked_walker(*, heading_deg: float = 0.0) -> tuple[np.ndarray, dict[str, list[int]]]:
    """A person of the Boulic model with three markers on each foot and four on the trunk."""
    walk = boulic_walk(speed_mps=1.3, height_m=1.75, duration_s=4.0, rate_hz=RATE_HZ)
    names = walk.markers
    columns = [walk.position_m[:, names.index(name)] for name in ("head", "left_hand", "right_hand")]
    groups: dict[str, list[int]] = {}
    for side in ("left", "right"):
        ankle, toe = (walk.position_m[:, names.index(f"{side}_{joint}")] for joint in ("ankle", "toe"))
        groups[f"{side}_foot"] = list(range(len(columns), len(columns) + 3))
        columns += [ankle, toe, 0.5 * (ankle + toe)]
    base = walk.position_m[:, names.index("base")]
    groups["segment_1"] = list(range(len(columns), len(columns) + 4))
    columns += [base + np.array(offset) for offset in ([0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.3], [-0.1, 0, 0.2])]
    angle = np.radians(heading_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return np.stack(columns, axis=1) @ turn.T, groups


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 200.0])
def test_feet_of_a_walker_are_proposed_with_their_side(heading_deg: float) -> None:
    body, groups = marked_walker(heading_deg=heading_deg)
    parts = propose_parts(body, rate_hz=RATE_HZ)
    for side in ("left_foot", "right_foot"):
        assert [i for i, part in enumerate(parts) if part == side] == groups[side]
    assert {parts[i] for i in groups["segment_1"]} == {"segment_1"}


def test_a_mirrored_walker_has_mirrored_feet() -> None:
    body, _ = marked_walker()
    mirrored = propose_parts(body * [1, -1, 1], rate_hz=RATE_HZ)
    swap = {"left_foot": "right_foot", "right_foot": "left_foot"}
    assert mirrored == [swap.get(part, part) for part in propose_parts(body, rate_hz=RATE_HZ)]


def test_a_body_that_does_not_walk_has_no_feet() -> None:
    parts = propose_parts(linked_boxes(), rate_hz=RATE_HZ)
    assert parts == [f"segment_{k}" for k in range(1, 5) for _ in range(5)]
    still = np.repeat(np.random.default_rng(0).uniform(0, 1.8, (1, 9, 3)), 50, axis=0)
    assert propose_parts(still, rate_hz=RATE_HZ) == ["segment_1"] * 9


def test_one_point_is_no_segment() -> None:
    assert find_rigid_clusters(np.zeros((10, 1, 3))) == []
    assert propose_parts(linked_boxes()[:, [0, 5, 10]], rate_hz=RATE_HZ) == ["", "", ""]
