"""Body parts, the points of known marker sets, and the bones that figures draw."""

from __future__ import annotations

HUMAN_PARTS = (
    "head", "torso",
    "left_upper_arm", "left_forearm", "left_hand", "right_upper_arm", "right_forearm", "right_hand",
    "left_thigh", "left_shank", "left_foot", "right_thigh", "right_shank", "right_foot",
)  # fmt: skip
"""Parts of a person."""

DOG_PARTS = (
    "head", "neck", "trunk", "tail",
    "left_fore_upper", "left_fore_lower", "left_fore_paw", "right_fore_upper", "right_fore_lower", "right_fore_paw",
    "left_hind_upper", "left_hind_lower", "left_hind_paw", "right_hind_upper", "right_hind_lower", "right_hind_paw",
)  # fmt: skip
"""Parts of a four-legged animal; "upper" is scapula + humerus or femur, "lower" forearm or tibia + metatarsus."""

BODY_CENTRE_PARTS = ("torso", "trunk")
"""Parts whose mean position is the centre of the body; without any, the mean of all points is."""
