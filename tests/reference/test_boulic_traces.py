"""The walker against traces of the published program (Chen 2011), defects D2 and D3 repaired."""

import numpy as np
import pytest

from doppelgait.motion.models import boulic, boulic_walk
from doppelgait.motion.models.boulic import compute_boulic_points
from doppelgait.motion.models.human_body import POINTS

pytestmark = pytest.mark.shared
TRACES = ("boulic_rv1.00_h1.80.npz", "boulic_rv1.50_h1.70.npz")
SAMPLES = 200


@pytest.fixture(params=TRACES)
def trace(request, shared):
    with np.load(shared / "reference" / "boulic" / request.param) as data:
        return dict(data)


def test_the_points_in_place_are_those_of_the_published_program(trace):
    ours = compute_boulic_points(
        np.arange(SAMPLES) / SAMPLES, float(trace["rv"]), float(trace["height"]), offset_scale_m=1.0
    )
    np.testing.assert_allclose(ours.transpose(1, 2, 0), trace["pos_inplace_fixed"], rtol=0, atol=1e-9)
    assert [name.replace("left_", "l").replace("right_", "r") for name in POINTS] == list(trace["names"])


def test_the_compatibility_form_is_the_published_walk_but_for_its_seam(trace):
    q, height_m, cycle_s = (float(trace[key]) for key in ("rv", "height", "cycle_duration_s"))
    walk = boulic_walk(
        speed_mps=q * boulic.LEG_LENGTH * height_m,
        height_m=height_m,
        form="chen2011",
        rate_hz=SAMPLES / cycle_s,
        duration_s=(2 * SAMPLES - 1) * cycle_s / SAMPLES,
    )
    np.testing.assert_allclose(walk.positions.time, trace["time_s"], rtol=0, atol=1e-12)
    # The program samples the advance D of one cycle at D i / (N + 1) * N / (N - 1) and starts the next cycle at D, so
    # that speed jumps at the seam. Each side's own advance is taken out; what is left must be the same walk.
    stride_m = 1.346 * np.sqrt(q)
    one_cycle = np.linspace(0, stride_m - stride_m / (SAMPLES + 1), SAMPLES)
    theirs = trace["pos_forward_fixed"].transpose(2, 0, 1).copy()
    theirs[:, :, 0] -= np.concatenate([one_cycle, stride_m + one_cycle])[:, None]
    ours = walk.position_m.copy()
    ours[:, :, 0] -= stride_m * np.arange(2 * SAMPLES)[:, None] / SAMPLES
    # Their height counts from the pelvis, ours from the floor: one constant, the lowest foot point of the cycle.
    feet = [n for n, name in enumerate(POINTS) if name.endswith(("ankle", "toe"))]
    floor_m = (theirs - ours)[0, 0, 2]
    assert floor_m == pytest.approx(theirs[:, feet, 2].min(), abs=1e-4)
    theirs[:, :, 2] -= floor_m
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9)


def test_the_driving_curves_are_the_published_ones(trace):
    q, phase = float(trace["rv"]), np.arange(SAMPLES) / SAMPLES
    offset, trunk, limb = (
        boulic.compute_body_offset(phase, q),
        boulic.trunk_angles_deg(phase, q),
        boulic.limb_angles_deg(phase, q),
    )
    ours = {
        "trunk_vertical_m": offset[2], "trunk_lateral_m": offset[1], "trunk_forward_m": offset[0],
        "trunk_pitch_deg": trunk["trunk_pitch"], "pelvis_list_deg": trunk["pelvic_list"],
        "pelvis_torsion_deg": trunk["pelvic_torsion"], "thorax_torsion_deg": trunk["thorax_torsion"],
        **{f"{joint}_flex_deg": limb[joint] for joint in ("hip", "knee", "ankle", "shoulder", "elbow")},
    }  # fmt: skip
    for name, curve in zip(trace["curve_names"], trace["curves_fixed"].T, strict=True):
        np.testing.assert_allclose(ours[name], curve, rtol=0, atol=1e-9, err_msg=name)
    assert boulic.compute_support_fraction(q) == pytest.approx(float(trace["support_fraction"]), abs=1e-12)
