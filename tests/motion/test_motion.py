"""What no change of a motion can do: one clear refusal each, with the value and what is allowed."""

import math

import numpy as np
import pytest

from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError, MotionError
from doppelgait.motion import blend, loop, retarget
from doppelgait.motion.follow import follow
from doppelgait.motion.hybrid import Hybrid
from doppelgait.motion.models import boulic_walk, human_gait, moving_point, pendulum, quadruped_gait
from doppelgait.motion.paths import make_path
from doppelgait.motion.retime import Variation, resample, scale_to_height, vary

NAN = math.nan
WALK = human_gait(speed_mps=1.2, duration_s=4.0)
LONG = boulic_walk(speed_mps=1.2, duration_s=9.0)
TROT = quadruped_gait(gait="trot", speed_mps=1.6, duration_s=3.0)
HOLED = WALK.with_positions(np.where(np.arange(WALK.n_frames)[:, None, None] == 10, NAN, WALK.position_m))
STILL = WALK.with_positions(np.broadcast_to(WALK.position_m[:1], WALK.position_m.shape).copy())
STILL = STILL.with_facts(stride_frequency_hz=NAN)
NUMBER = "is not allowed: must be a number from"


def walk(**options):
    return human_gait(**{"speed_mps": 1.2, "duration_s": 4.0, **options})


def on_path(motion=LONG, duration_s=None, **table):
    return follow(motion, make_path({"kind": "straight", **table}), duration_s=duration_s)


def stop(motion, *at_m):
    return on_path(motion, kind="stop_and_go", stops=[{"at_m": at, "pause_s": 1.0} for at in at_m])


def bend(motion):
    """Twice the factors: a leg like a rod keeps hip and foot apart only by a bend elsewhere."""
    return retarget(retarget(motion, speed_factor=1.25, stride_factor=1.1), speed_factor=1.25, stride_factor=1.1)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        # loops
        (lambda: loop(boulic_walk(speed_mps=0.8, duration_s=1.0), duration_s=5.0), "a loop needs"),
        (lambda: loop(WALK, duration_s=NAN), "duration_s"),
        (lambda: loop(WALK, duration_s=5.0, variation=-1.0), "variation"),
        (lambda: loop(HOLED, duration_s=5.0), "has gaps, so it cannot be looped; clean it first"),
        (lambda: loop(STILL, duration_s=5.0), "no gait cycle"),
        # hybrids
        (lambda: retarget(WALK, speed_factor=1.4), rf"speed_factor = 1\.4 {NUMBER} 0\.8"),
        (lambda: retarget(WALK, size_factor=0.5), r"size_factor = 0\.5 is not allowed"),
        (lambda: retarget(WALK, stride_factor=1.2), rf"stride_factor = 1\.2 {NUMBER} 0\.896 to 1\.12"),
        (lambda: retarget(walk(speed_mps=1.7), speed_factor=1.2), r"speed 0\.7\d, but recordings have 0\.17"),
        (lambda: retarget(WALK, speed_factor="1"), f"speed_factor = '1' {NUMBER}"),
        (lambda: retarget(walk(duration_s=0.8)), "shows no whole stride"),
        (lambda: retarget(HOLED, speed_factor=1.1), "has gaps, so it cannot be retargeted or blended"),
        (lambda: bend(walk(speed_mps=0.9)), r"would bend \d+ degrees further than in the recordings"),
        (lambda: blend(WALK, WALK, share="a"), f"share: 'a' {NUMBER} 0 to 1"),
        (lambda: blend(WALK, WALK, share=1.5), "share: 1.5 is not allowed"),
        (lambda: blend(WALK, TROT, share=0.5), "they share 10 of 17 and 29 points, none of left_foot"),
        (lambda: blend(WALK, walk(speed_mps=2.9), share=0.5), "the gait is human walk and human run"),
        (lambda: blend(walk(speed_mps=0.7), walk(speed_mps=1.5), share=0.5), r"is 2\.1\d times as fast"),
        (
            lambda: blend(TROT, quadruped_gait(gait="walk", speed_mps=1.3, duration_s=3.0), share=0.5),
            "the gait is dog trot and dog walk",
        ),
        # paths
        (
            lambda: on_path(kind="arc", radius_m=1.0, turn_deg=90, duration_s=3.0),
            r"'arc'.*1\.57 m long and takes 1\.309 s, but 3 s are wanted.*lengthen",
        ),
        (lambda: on_path(duration_s=9.5), r"boulic: lasts 9\.000 s on its path, but 9\.5 s are wanted; shorten"),
        (lambda: stop(LONG, 11.0), r"boulic: travels 10\.80 m, too short for a stop at 11\.00 m"),
        (lambda: on_path(pendulum(duration_s=3.0)), "a path needs a motion that travels"),
        (lambda: on_path(on_path(kind="arc", radius_m=2.0, turn_deg=120)), "away from straight and even travel"),
        (lambda: stop(quadruped_gait(gait="gallop", duration_s=4.0), 5.0), r"cannot stop.*not gallop"),
        (lambda: stop(moving_point(duration_s=5.0), 1.0), "cannot stop"),
        # times, sizes and variations
        (lambda: resample(WALK, [0.0, 4.5]), "lasts"),
        (lambda: resample(WALK, [-0.1]), "lasts"),
        (lambda: resample(HOLED, [0.1]), "without gaps"),
        (lambda: resample(WALK.frames(0, 3), [0.001]), "4 frames"),
        (
            lambda: scale_to_height(WALK.with_facts(height_m=NAN), height_m=1.5),
            r"height is unknown.*1\.5 m.*recorded_height_m",
        ),
        (lambda: vary(STILL, Variation(), np.random.default_rng(0)), "stride frequency is unknown"),
        (lambda: vary(WALK.frames(0, 100), Variation(), np.random.default_rng(0)), "too short to be varied"),
    ],
)
def test_what_a_motion_cannot_do_is_refused(make, says):
    with pytest.raises(MotionError, match=says):
        make()


BAND = r"speed_mps makes .* of a motion at 1\.2 m/s; allowed are 0\.84 to 1\.56"
OTHER = {"kind": "file", "path": "b"}


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: on_path(speed_mps=0.83), BAND),
        (lambda: on_path(speed_mps=1.57), BAND),
        (
            lambda: on_path(kind="arc", radius_m=1.0, turn_deg=90, side_m=0.5),
            r"side_m = 0.5 on an arc of radius 1 m makes 0\.6 m/s",
        ),
        (lambda: stop(LONG, 3.0, 3.9), r"a stop needs 1\.13 m to slow down.*move the stops apart"),
    ],
)
def test_a_path_that_a_motion_cannot_follow_is_refused(make, says):
    with pytest.raises(ConfigError, match=says):
        make()


ARC, LINE, TURN = ({"kind": kind} for kind in ("arc", "polyline", "turn_around"))
ABOUT = {"kind": "wander", "room_m": [0, 6, -2, 2]}


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({}, "kind None is not allowed: known are arc, polyline, stop_and_go, straight, turn_around"),
        ({"kind": "spiral"}, "'spiral' is not allowed: known are arc"),
        (ARC | {"radius_m": 2}, "path kind 'arc': turn_deg: is required"),
        (ARC | {"radius_m": 2, "turn_deg": 0}, 'turn_deg: 0.*must not be 0; for a line take kind = "straight"'),
        (ARC | {"radius_m": 0.1, "turn_deg": 9}, "radius_m: 0.1 is not allowed.*0.3"),
        (LINE | {"points_m": [[0, 0]]}, "points_m"),
        (LINE | {"points_m": [[0, 0], [0, 0], [1, 1]]}, "0 and 1 are at the same place"),
        (LINE | {"points_m": [[0, 0], [3, 0], [1, 0.01]]}, "turns back at point 1.*turn_around"),
        (
            LINE | {"points_m": [[0, 0], [3, 0], [3, 0.6], [0, 0.6]]},
            r"corners at 1 and 2 take 1 m of the 0\.6 m between them; lower corner_radius_m = 0\.5",
        ),
        (
            {"kind": "stop_and_go", "stops": [{"at_m": 2, "pause_s": 1}, {"at_m": 1, "pause_s": 1}]},
            "at_m must rise from stop to stop, but 1 follows 2",
        ),
        (TURN | {"out_m": 2, "radius_m": 1, "turn_s": 2}, "belong to a turn on the spot"),
        (TURN | {"out_m": 2, "side_m": 1}, "on the spot has no side_m.*radius_m"),
        (ABOUT | {"leg_m": [3, 1]}, "leg_m"),
        (ABOUT | {"room_m": [0, 1, 0, 6]}, "room_m"),
        (ABOUT | {"rest_s": [0, 1]}, "rest_s"),
        # hybrids
        ({"speed_factor": 2.0}, r"speed_factor"),
        ({"other": {"kind": "boulic"}, "share": 0.5}, "must be an unchanged recording"),
        ({"other": {**OTHER, "hybrid": {}}}, "must be an unchanged recording"),
        ({"share": 0.5}, "share without other is not allowed: a blend needs both"),
        ({"other": OTHER}, "other without share is not allowed: a blend needs both"),
    ],
)
def test_mistakes_in_a_table_are_named(table, says):
    with pytest.raises(ConfigError, match=says):
        make_path(table) if table.keys() <= {"kind"} or "kind" in table else validate(Hybrid, table, where="hybrid")
