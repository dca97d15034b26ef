"""Self-occlusion (E-08e) against rays marched step by step, and its border."""

from dataclasses import replace

import numpy as np
import pytest

from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.motion.models.quadruped import quadruped_gait
from doppelgait.scene import Scene, Target, assemble, bodies, place


def ball(centre, radius=0.2):
    shape = (1, 1, 3)
    z = np.broadcast_to([0.0, 0.0, 1.0], shape)
    return bodies.Ellipsoids(
        np.broadcast_to(centre, shape).astype(float), z.copy(), np.zeros(shape), np.full((1, 3), radius)
    )


def none_own(n_points, n_ellipsoids=1):
    return np.zeros((n_points, n_ellipsoids), dtype=bool)


def matrices(body):
    """Inverse shape matrices of all ellipsoids from their axes, shape (I, S, 3, 3)."""
    across, upright, along = np.moveaxis(body.semi_axes_m, -1, 0)
    side = body.across.copy()
    bare = (np.abs(side).sum(axis=-1) == 0)[..., None]
    # an ellipsoid of revolution has any side
    guess = np.cross(body.along, np.where(np.abs(body.along[..., :1]) < 0.9, [1.0, 0, 0], [0, 1.0, 0]))
    side = np.where(bare, guess / np.linalg.norm(guess, axis=-1, keepdims=True), side)
    up = np.cross(body.along, side)
    return sum(
        np.einsum("isj,isk->isjk", e, e) / (s**2)[None, :, None, None]
        for e, s in ((side, across), (up, upright), (body.along, along))
    )


def marched(points, body, own, radar, n_steps=1500):
    """Smallest quadratic form along every line of sight over all ellipsoids that may hide, shape (I, P)."""
    inverse = matrices(body)
    smallest = np.full(points.shape[:2], np.inf)
    for step in np.linspace(0, 1, n_steps) ** 2 * 0.5:  # the nearer half, finer near the point
        ray = points + step * (radar - points)
        offset = ray[:, :, None] - body.centre_m[:, None]
        form = np.einsum("ipsj,isjk,ipsk->ips", offset, inverse, offset)
        smallest = np.minimum(smallest, np.where(own[None], np.inf, form).min(axis=-1))
    return smallest


@pytest.mark.parametrize("aspect_deg", [0.0, 60.0, 90.0, 170.0])
@pytest.mark.parametrize("body", [boulic_walk(duration_s=1.0), quadruped_gait(duration_s=1.0)])
def test_who_is_hidden_is_what_marched_rays_say(body, aspect_deg):
    scene = Scene([Target(body, aspect_deg=aspect_deg)])
    placed = place(scene).targets[0].motion
    motion = replace(placed, positions=placed.positions.isel(time=slice(0, 250, 50)))
    body = bodies.compute_ellipsoids(bodies.build_skeleton(motion))
    points, radar = motion.position_m, np.array(scene.radar_position_m)
    own = bodies.find_own_points(points, body)
    gain = bodies.compute_visible_power(points, body, own, radar, edge_m=1e-5)
    form = marched(points, body, own, radar)
    within = marched(points, body, own, points, n_steps=1) < 1  # in another limb of the model: not a line past it
    clear = (np.abs(form - 1) > 1e-2) & ~within  # the steps of the march are not finer than that
    hidden = form < 1
    np.testing.assert_array_equal(gain[clear] < 0.5, hidden[clear])
    assert clear[~within].mean() > 0.98
    assert within.mean() < 0.06  # shoulders and elbows of a dog reach into its chest, which bends with the trunk
    assert set(np.unique(gain[clear])) <= {0.0, 1.0}
    assert (hidden.any(), (~hidden).any()) == (True, True)


def test_the_border_of_a_ball_is_where_and_as_wide_as_stated():
    radius, radar = 0.2, np.array([1e8, 0.0, 0.0])
    height = np.linspace(0, 0.4, 401)
    points = np.stack([np.full(401, -2.0), np.zeros(401), height], axis=-1)[None]
    gain = bodies.compute_visible_power(points, ball([0, 0, 0], radius), none_own(401), radar)[0]
    assert (gain[height < radius - bodies.EDGE_M * 1.2] == 0).all()
    assert (gain[height > radius + bodies.EDGE_M * 1.2] == 1).all()
    assert (np.diff(gain) >= 0).all()
    assert gain[200] == pytest.approx(0.25, abs=0.01)  # at the edge half the amplitude
    # first-order clearance of a ball, (h^2 - r^2) / (2 h), and the ramp of degree 5
    clearance = (height[1:] ** 2 - radius**2) / (2 * height[1:])
    x = np.clip((clearance + bodies.EDGE_M) / (2 * bodies.EDGE_M), 0, 1)
    np.testing.assert_allclose(gain[1:], (6 * x**5 - 15 * x**4 + 10 * x**3) ** 2, atol=1e-6)


def test_a_point_that_comes_from_behind_to_before_does_not_click():
    """Through a ball along the line of sight and across it: no step of amplitude beyond the slope of the ramps."""
    radar, step_m = np.array([100.0, 0.0, 0.0]), 1e-4
    for direction in (np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0.7, 0.7, 0.1])):
        for aside in (0.0, 0.1, 0.22):
            way = np.arange(-1, 1, step_m)[:, None] * direction + np.array([0, 0, aside])
            amplitude = np.sqrt(
                bodies.compute_visible_power(way[None], ball([0, 0, 0]), none_own(way.shape[0]), radar)[0]
            )
            # 15/8 is the steepest slope of the ramp; the clearance of a ball deeper than its edge changes faster
            assert np.abs(np.diff(amplitude)).max() < 3 * (15 / 8) * step_m / bodies.EDGE_M


def test_an_ellipsoid_does_not_hide_what_it_contains():
    walk = boulic_walk(duration_s=1.0)
    skeleton = bodies.build_skeleton(walk)
    own = bodies.find_own_points(walk.position_m, bodies.compute_ellipsoids(skeleton))
    names, points = [s.name for s in skeleton.segments], walk.markers
    for n, segment in ((n, s) for n, s in enumerate(skeleton.segments) if not s.joint):
        assert own[points.index(segment.start), n], names[n]
        assert own[points.index(segment.end), n], names[n]
    assert not own[points.index("left_hand"), names.index("torso")]
    assert own.sum() < 0.25 * own.size


def test_without_the_option_every_path_gain_is_1():
    table = assemble(Scene([Target(boulic_walk(duration_s=1.0), aspect_deg=90.0)]), np.arange(0, 1, 0.1))
    assert (table["path_gain"].values == 1).all()
