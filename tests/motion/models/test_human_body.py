"""Points of the figure from its angles."""

import numpy as np

from doppelgait.motion.models.human_body import (
    LENGTHS,
    POINTS,
    compute_figure_points,
    place_left_hip,
    place_legless_points,
)


def test_a_figure_without_legs_is_the_whole_figure_but_for_them():
    generator = np.random.default_rng(1)
    trunk = {
        name: generator.normal(0, 0.3, 20)
        for name in ("trunk_pitch", "pelvic_torsion", "pelvic_list", "thorax_torsion")
    }
    limbs = {name: generator.normal(0, 0.6, (2, 20)) for name in ("hip", "knee", "ankle", "shoulder", "elbow")}
    base_m = generator.normal(0, 1.0, (3, 20))
    whole = compute_figure_points(trunk, limbs, LENGTHS) + base_m
    upper = place_legless_points(base_m, place_left_hip(trunk, LENGTHS), trunk, limbs, LENGTHS)
    kept = [number for number, name in enumerate(POINTS) if not name.endswith(("knee", "ankle", "toe"))]
    assert len(kept) == 11
    np.testing.assert_allclose(upper[kept], whole[kept], rtol=0, atol=1e-14)
