"""The palette: colours of a figure stay distinct in every colour-vision deficiency."""

import itertools

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from doppelgait.viz.motion import PART_COLOURS
from doppelgait.viz.style import (
    CLASS_COLOURS,
    LINE_COLOURS,
    OTHER_CLASS_COLOURS,
    SERIES_COLOURS,
    choose_class_colours,
    describe_flag,
    map_lines,
)

SEEN_AS = {
    "normal": np.eye(3),
    "protanopia": np.array([
        [0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998],
    ]),
    "deuteranopia": np.array([
        [0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881],
    ]),
    "tritanopia": np.array([
        [1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900],
    ]),
}  # fmt: skip
"""Machado, Oliveira and Fernandes (2009), severity 1, on linear red, green and blue."""
TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
DISTINCT = 11.0
"""CIE 1976 distance; 2.3 can just be noticed."""


def lab(colour: str, sight: str) -> np.ndarray:
    c = np.array(to_rgb(colour))
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    xyz = TO_XYZ @ np.clip(SEEN_AS[sight] @ linear, 0, 1) / (TO_XYZ @ np.ones(3))
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("sight", SEEN_AS)
@pytest.mark.parametrize(
    "colours",
    [(*CLASS_COLOURS.values(), *OTHER_CLASS_COLOURS), SERIES_COLOURS, LINE_COLOURS, tuple(set(PART_COLOURS.values()))],
    ids=["classes", "series", "lines on a map", "body parts"],
)
def test_colours_of_a_figure_are_distinct_for_everybody(colours: tuple[str, ...], sight: str) -> None:
    near = {
        (one, other): round(float(np.linalg.norm(lab(one, sight) - lab(other, sight))), 1)
        for one, other in itertools.combinations(colours, 2)
    }
    assert {pair: distance for pair, distance in near.items() if distance < DISTINCT} == {}


def test_a_class_has_one_colour_in_every_figure() -> None:
    assert choose_class_colours(["dog", "human"]) == {"dog": CLASS_COLOURS["dog"], "human": CLASS_COLOURS["human"]}
    looks = map_lines(["0: human", "1: dog", "2: human", "3: target"])
    assert looks[0][0] == looks[2][0] != looks[1][0] == CLASS_COLOURS["dog"]
    assert [style for _, style in looks] == ["-", "-", "--", "-"]


def test_flags_are_words_with_the_quantities_of_the_tables():
    flag = "harmonic_ratio_3:no_peak_6_db_above_its_surroundings"
    assert describe_flag(flag) == "third harmonic ratio: no peak 6 dB above its surroundings"
    flag = "torso_velocity_mps:uncertain_by_more_than_10_per_cent"
    assert describe_flag(flag) == "torso velocity: uncertain by more than 10 %"
