"""Left and right of a recording, judged along its path."""

import numpy as np
import pytest

from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.motion import Motion
from doppelgait.motion.clean import clean_motion
from doppelgait.motion.models import human_gait


def circle_walk(*, turns: float) -> Motion:
    """Return a walk bent to a circle; over whole turns its ends face all ways."""
    walk = human_gait(speed_mps=1.2, height_m=1.75, duration_s=8.0, rate_hz=60)
    position = walk.position_m
    length_m = 1.2 * 8.0
    radius_m = length_m / (2 * np.pi * turns)
    angle = position[..., 0] / radius_m
    from_centre = radius_m - position[..., 1]
    bent = np.stack([from_centre * np.sin(angle), radius_m - from_centre * np.cos(angle), position[..., 2]], axis=-1)
    return walk.with_positions(bent)


def side_notes(motion: Motion) -> list[str]:
    return [note for note in clean_motion(motion).report["notes"] if "side" in note]


@pytest.mark.parametrize("turns", [0.6, 0.9])
def test_sides_are_judged_along_the_path(turns: float) -> None:
    motion = circle_walk(turns=turns)
    assert side_notes(motion) == []
    mirrored = motion.with_positions(motion.position_m * [1.0, -1.0, 1.0])
    assert ["left parts are on the right side" in note for note in side_notes(mirrored)] == [True]


def test_one_exchanged_pair_of_feet_is_noted_and_warned_of() -> None:
    walk = human_gait(speed_mps=1.2, height_m=1.75, duration_s=4.0, rate_hz=60)
    swap = {"left_foot": "right_foot", "right_foot": "left_foot"}
    exchanged = walk.with_points(walk.position_m, walk.markers, [swap.get(part, part) for part in walk.parts])
    with pytest.warns(DoppelgaitWarning, match="left_foot and right_foot are on each other's side"):
        assert len(side_notes(exchanged)) == 1
