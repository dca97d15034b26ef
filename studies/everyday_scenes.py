"""Everyday scenes: who moves how and where before which radar.

For the study ``everyday.py``. Every scene is a function of a random generator. Persons and dogs are sampled, half of
bodies are points or surfaces; the receiver has thermal noise, 4 mrad of phase noise and the clutter of an
office.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from harness import FloatArray

from doppelgait.core.errors import ConfigError
from doppelgait.motion import make_path
from doppelgait.motion.follow import follow, steady_speed_mps
from doppelgait.motion.models import crawling_person, quadruped_gait, sample_dog, sample_person
from doppelgait.motion.models.human import human_gait
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import travel_speed_mps
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target
from doppelgait.scene.placement import leashed_dog, side_by_side

Rng = np.random.Generator

X4, X4_LONG = Radar.preset("x4"), Radar.preset("x4-long", range_stop_m=20.0)
X4_SLOW = Radar.preset("x4", prf_hz=500)
"""For long recordings: a walker's foot does not alias yet."""
X4_UNFOLDED = Radar.preset("x4", fold_echoes=False)
"""Shows nobody from beyond its frame; how far the real chip does is not known."""
LONGEST_S = 8.0
SPARE = 1.8
"""A motion lasts this many times the scene, for paths that are faster than it."""
PHASE_NOISE = {"kind": "phase_noise", "white_rad": 0.004}
X4_OFFICE = {"kind": "static_clutter", "in_units": True, "levels": [[0.85, -51], [2.0, -60], [4.0, -68], [8.0, -80]]}
OFFICE = {"kind": "static_clutter", "rcs_per_metre_m2": 0.1}
SEAT_BACK, SEAT_DOWN, SEAT_LEAN = 0.2, 0.25, 0.15
"""How far trunk and arms of a sitter go back and down, and lean forward half way, in statures; assumed."""
BREATH_HZ, BREATH_M = 0.25, 0.003
STANDING_PARTS = ("foot", "shank")


@dataclass(frozen=True)
class Setup:
    """A scene, its radar and what is unusual about the recording.

    ``bursts`` are pulses of one burst, and time from burst to burst: the sensor sleeps in between.
    """

    scene: Scene
    radar: Radar = X4
    environment: tuple[Mapping[str, Any], ...] = ()
    further: tuple[Mapping[str, Any], ...] = ()
    snr_db: float | None = None
    bursts: tuple[int, float] | None = None

    @property
    def impairments(self) -> tuple[Mapping[str, Any], ...]:
        """Return office clutter as the radar sees it, and others."""
        office = X4_OFFICE if self.radar.volts_per_unit else OFFICE
        return (office, PHASE_NOISE, *self.further)


@dataclass(frozen=True)
class Kind:
    """Scenes of one kind: cause of errors, and drawing."""

    cause: str
    draw: Callable[[Rng], Setup]
    options: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, rng: Rng) -> Setup:
        """Draw one scene."""
        return self.draw(rng, **self.options)


# Bodies --------------------------------------------------------------------------------------------------------------


def person(rng: Rng, seconds: float = LONGEST_S, *, speed_mps: tuple[float, float] | None = None,
           gait: str = "walk", **sampled: Any) -> Motion:  # fmt: skip
    """Sample a walker; steps too long for the legs are drawn again."""
    while True:
        body = sample_person(rng, **sampled)
        usual_mps = float(np.clip(body.speed_mps, 0.6, 1.7)) if body.complaint == "none" else body.speed_mps
        wanted_mps = usual_mps if speed_mps is None else float(rng.uniform(*speed_mps))
        try:
            own = body.parameters(speed_mps=wanted_mps, gait=gait, start_phase=float(rng.random()))
            return human_gait(duration_s=SPARE * seconds, rng=rng, **own)
        except ConfigError:
            continue


def dog(rng: Rng, seconds: float = LONGEST_S, *, gait: str | None = None, speed_mps: float | None = None) -> Motion:
    """Sample a dog in a gait, or at a speed."""
    while True:
        sampled = sample_dog(rng, gait=gait)
        changes = {} if speed_mps is None else {"speed_mps": speed_mps, "gait": "auto"}
        try:
            return quadruped_gait(duration_s=SPARE * seconds, rng=rng, **sampled.parameters(**changes))
        except ConfigError:
            continue


def cat(rng: Rng) -> Motion:
    """Sample a walking cat."""
    return quadruped_gait(
        build="cat", gait="walk", froude=float(rng.uniform(0.1, 0.3)), stride_variation=0.03,
        start_phase=float(rng.random()), duration_s=LONGEST_S, rng=rng,
    )  # fmt: skip


def crawler(rng: Rng) -> Motion:
    """Sample somebody on hands and knees."""
    return crawling_person(
        speed_mps=float(rng.uniform(0.3, 0.6)), height_m=float(rng.uniform(1.55, 1.95)), stride_variation=0.03,
        start_phase=float(rng.random()), duration_s=LONGEST_S, rng=rng,
    )  # fmt: skip


def seen(rng: Rng, motion: Motion, label: str = "human", **place: Any) -> Target:
    """Make a target of points or surfaces, by chance."""
    return Target(motion, label=label, rcs={"kind": str(rng.choice(["body_parts", "auto"])), "total_spread_db": 2.0},
                  **place)  # fmt: skip


def seated(motion: Motion, rng: Rng, *, down_s: float, up_s: float = math.inf) -> Motion:
    """Let a body that faces +x sit down and stand up again. It breathes while it sits."""
    times_s, height_m = motion.time_s - motion.time_s[0], motion.facts.height_m
    lasts_s = float(rng.uniform(1.2, 2.0))
    low = _half_cosine((times_s - down_s) / lasts_s) - _half_cosine((times_s - up_s) / lasts_s)
    feet = np.array([part.endswith(STANDING_PARTS) for part in motion.parts])
    knees = np.array([name.endswith("knee") for name in motion.markers])
    share = np.where(knees, 0.15, np.where(feet, 0.0, 1.0))
    upper = np.array([part.endswith(("head", "torso")) or "arm" in part or "hand" in part for part in motion.parts])
    position_m = motion.position_m.copy()
    position_m[..., 2] -= SEAT_DOWN * height_m * low[:, None] * share
    position_m[..., 0] -= SEAT_BACK * height_m * low[:, None] * share
    position_m[..., 0] += SEAT_LEAN * height_m * (4 * low * (1 - low))[:, None] * upper
    breath_m = BREATH_M * np.sin(2 * np.pi * BREATH_HZ * times_s) * low
    torso = np.array([part == "torso" for part in motion.parts])
    position_m[..., 0] += breath_m[:, None] * torso
    return motion.with_positions(position_m)


def _half_cosine(share: FloatArray) -> FloatArray:
    return np.asarray((1 - np.cos(np.pi * np.clip(share, 0.0, 1.0))) / 2)


def breather(rng: Rng, x_m: float) -> Target:
    """Make somebody who keeps still and breathes."""
    motion = {
        "kind": "breathing", "breathing_hz": float(rng.uniform(0.2, 0.35)),
        "amplitude_m": float(rng.uniform(0.002, 0.005)), "height_m": float(rng.uniform(1.55, 1.95)),
    }  # fmt: skip
    return Target(motion, label="human", start_position_m=(x_m, 0.0), heading_deg=180.0)


# Scenes --------------------------------------------------------------------------------------------------------------


def room(targets: list[Target], seconds: float, rng: Rng) -> Scene:
    """Make a scene before a radar at the height of a shelf."""
    return Scene(targets, radar_position_m=(0.0, 0.0, float(rng.uniform(1.0, 1.5))), duration_s=seconds)


def passing(
    rng: Rng, make: Callable[..., Motion] = person, *, aspect_deg: float | tuple[float, float] = 0.0,
    label: str = "human", radar: Radar = X4, middle_m: float = 5.0, half_m: float = 3.4, companions: int = 0,
    **setup: Any,
) -> Setup:  # fmt: skip
    """Draw one body that goes straight on, at an aspect."""
    psi = float(rng.uniform(*aspect_deg)) if isinstance(aspect_deg, tuple) else aspect_deg
    motion = make(rng)
    depth = max(abs(math.cos(math.radians(psi))), 0.5)
    seconds = min(LONGEST_S, 2 * half_m / (travel_speed_mps(motion) * depth), motion.duration_s)
    side = float(rng.choice([-1.0, 1.0]))
    target = seen(rng, motion, label, range_m=middle_m, bearing_deg=float(rng.uniform(-10, 10)), aspect_deg=side * psi)
    return Setup(room([target, *extras(rng, companions)], seconds, rng), radar, **setup)


def extras(rng: Rng, wanted: int) -> list[Target]:
    """Return things that move as background. 0: none; 1: a fan; 2: a curtain; 3: a robot vacuum cleaner."""
    if wanted == 0:
        return []
    motion, total_m2, place, heading_deg = {
        1: ({"kind": "fan", "rotation_hz": float(rng.uniform(8, 15))}, 0.02, (6.0, 2.0), 0.0),
        2: ({"kind": "curtain", "sway_hz": float(rng.uniform(0.2, 0.6)), "amplitude_m": float(rng.uniform(0.03, 0.1))},
            0.05, (7.5, -1.5), 0.0),
        3: ({"kind": "vacuum", "speed_mps": float(rng.uniform(0.2, 0.35)), "brush_hz": float(rng.uniform(1.5, 3.0)),
             "turn_deg_per_s": float(rng.uniform(-15, 15))}, 0.03, (float(rng.uniform(3, 7)), 0.8),
            float(rng.uniform(-180, 180))),
    }[wanted]  # fmt: skip
    return [Target(motion, rcs={"total_m2": total_m2}, start_position_m=place, heading_deg=heading_deg,
                   background=True)]  # fmt: skip


def alone(rng: Rng, *, what: int, seconds: float = LONGEST_S) -> Setup:
    """Draw an empty room, or one in which only a thing moves."""
    return Setup(room(extras(rng, what), seconds, rng))


def sitting(rng: Rng, *, radar: Radar = X4_SLOW, seconds: float = 20.0, **setup: Any) -> Setup:
    """Draw somebody who keeps still."""
    return Setup(room([breather(rng, float(rng.uniform(1.5, 4.0)))], seconds, rng), radar, **setup)


def on_path(
    rng: Rng, path: Mapping[str, Any], *, start_m: tuple[float, float], heading_deg: float, seconds: float,
    make: Callable[..., Motion] = person, label: str = "human", radar: Radar = X4,
) -> Setup:  # fmt: skip
    """Draw one body on a path."""
    motion = make(rng, seconds)
    target = seen(rng, motion, label, start_position_m=start_m, heading_deg=heading_deg, path=dict(path))
    return Setup(room([target], seconds, rng), radar)


def stops(rng: Rng, *, goes_on: bool, make: Callable[..., Motion] = person, label: str = "human") -> Setup:
    """Draw somebody who stops, for good or for 2 to 4 s."""
    pause_s = float(rng.uniform(2, 4)) if goes_on else 30.0
    path = {"kind": "stop_and_go", "stops": [{"at_m": float(rng.uniform(2.2, 3.5)), "pause_s": pause_s}]}
    start_m = (8.8, float(rng.uniform(-0.5, 0.5)))
    return on_path(rng, path, start_m=start_m, heading_deg=180.0, seconds=9.0, make=make, label=label)


def sits(rng: Rng, *, first: bool, rests_s: float = 30.0, seconds: float = 9.0, radar: Radar = X4) -> Setup:
    """Draw somebody who sits after, before or between walking."""
    walk = person(rng, seconds, speed_mps=(0.8, 1.3))
    at_m = 2.0 if first else float(rng.uniform(2.5, 3.5))
    path = make_path({"kind": "stop_and_go", "stops": [{"at_m": at_m, "pause_s": rests_s}]})
    going = follow(walk, path)
    assert going.facts.path is not None
    speed_mps = steady_speed_mps(walk)
    rest_s = going.facts.path.stops_m[0] / speed_mps + math.pi * speed_mps / 4
    down_s, up_s = (rest_s - 10.0 if first else rest_s + 0.7), rest_s + rests_s - 2.7
    moved = seated(going, rng, down_s=down_s, up_s=up_s)
    begin = round((rest_s + 0.1) * going.rate_hz) if first else 0
    moved = moved.cut(begin, moved.n_frames)
    away = bool(rng.integers(2))
    place = {"start_position_m": (1.8, 0.3) if away else (8.8, 0.3), "heading_deg": 0.0 if away else 180.0}
    return Setup(room([seen(rng, moved, **place)], min(seconds, moved.duration_s), rng), radar)


def laps(rng: Rng, *, seconds: float, radar: Radar = X4) -> Setup:
    """Draw somebody who walks round a room."""
    width_m, depth_m = float(rng.uniform(2.5, 3.5)), float(rng.uniform(3.0, 4.5))
    round_m = [(0.0, 0.0), (depth_m, 0.0), (depth_m, width_m), (0.0, width_m)]
    path = {"kind": "polyline", "points_m": [*(round_m * math.ceil(2.5 * seconds / (depth_m + width_m) + 1)), (0, 0)]}
    return on_path(rng, path, start_m=(2.5, -width_m / 2), heading_deg=0.0, seconds=seconds, radar=radar)


def corner(rng: Rng) -> Setup:
    """Draw somebody who turns off at a right angle."""
    before_m, side = float(rng.uniform(2.5, 3.5)), float(rng.choice([-1.0, 1.0]))
    path = {"kind": "polyline", "points_m": [(0.0, 0.0), (before_m, 0.0), (before_m, 20.0 * side)]}
    return on_path(rng, path, start_m=(7.5, side * 2.0), heading_deg=180.0, seconds=6.0)


def arc(rng: Rng) -> Setup:
    """Draw somebody who walks a part of a circle."""
    turn_deg, radius_m = 720.0 * float(rng.choice([-1.0, 1.0])), float(rng.uniform(1.5, 2.5))
    path = {"kind": "arc", "radius_m": radius_m, "turn_deg": turn_deg}
    return on_path(rng, path, start_m=(5.0, -math.copysign(radius_m, turn_deg)), heading_deg=0.0, seconds=7.0)


def turns(rng: Rng, *, spot: bool) -> Setup:
    """Draw somebody who goes, turns and comes back."""
    way = {"turn_s": float(rng.uniform(1, 2))} if spot else {"radius_m": float(rng.uniform(0.5, 0.9))}
    path = {"kind": "turn_around", "out_m": float(rng.uniform(3.0, 4.0)), **way}
    return on_path(rng, path, start_m=(3.0, 0.3), heading_deg=0.0, seconds=8.0)


def companions(
    rng: Rng, *, side_m: float, ahead_m: float, aspect_deg: float = 0.0, walks_dog: bool = False, child: bool = False
) -> Setup:
    """Draw two who keep together."""
    speed = float(rng.uniform(0.9, 1.3))
    first = person(rng, speed_mps=(speed, speed))
    seconds = min(LONGEST_S, 6.4 / (speed * max(math.cos(math.radians(aspect_deg)), 0.5)))
    turn = math.radians(aspect_deg)
    half_m = speed * seconds / 2
    start_m = (5.2 + half_m * math.cos(turn), -half_m * math.sin(turn))
    lead = seen(rng, first, start_position_m=start_m, heading_deg=180.0 - aspect_deg)
    if walks_dog:
        pair = leashed_dog(lead, dog(rng, speed_mps=speed), side_m=side_m, ahead_m=ahead_m)
    else:
        other_mps = (0.85 * speed, speed) if child else (0.92 * speed, 1.08 * speed)
        second = person(rng, speed_mps=other_mps, age_class="child" if child else "adult")
        pair = side_by_side(lead, seen(rng, second), side_m=side_m, ahead_m=ahead_m)
    return Setup(room(pair, seconds, rng))


def two(rng: Rng, *, first: str, second: str, places: str, radar: Radar = X4, third: bool = False) -> Setup:
    """Draw two who cross, overtake or keep apart. ``first`` and ``second`` are person or dog."""
    fast_slow = {"overtake": ((0.6, 0.85), (1.3, 1.6))}.get(places, ((0.8, 1.3), (0.9, 1.4)))
    starts, headings = {
        "cross": (((8.2, 0.5), (2.0, -0.5)), (180.0, 0.0)),
        "overtake": (((6.8, 0.4), (8.9, -0.4)), (180.0, 180.0)),
        "apart": (((8.9, 0.4), (5.4, -0.4)), (180.0, 180.0)),
    }[places]
    targets = []
    for who, speeds, start, heading in zip((first, second), fast_slow, starts, headings, strict=True):
        speed = float(rng.uniform(*speeds))
        motion = dog(rng, speed_mps=speed) if who == "dog" else person(rng, speed_mps=(speed, speed))
        label = "dog" if who == "dog" else "human"
        targets.append(seen(rng, motion, label, start_position_m=start, heading_deg=heading))
    if third:
        targets.append(seen(rng, person(rng), start_position_m=(7.8, -2.5), heading_deg=90.0))
    return Setup(room(targets, 3.6 if places == "apart" else 5.0, rng), radar)


def circling(rng: Rng) -> Setup:
    """Draw a dog that circles a sitter."""
    radius_m = float(rng.uniform(0.7, 1.2))
    body = dog(rng, speed_mps=float(rng.uniform(0.8, 1.2)))
    path = {"kind": "arc", "radius_m": radius_m, "turn_deg": 3600.0}
    circler = seen(rng, body, "dog", start_position_m=(4.0, -radius_m), heading_deg=0.0, path=path)
    return Setup(room([breather(rng, 4.0), circler], LONGEST_S, rng))


def through_door(rng: Rng, *, enters: bool, radar: Radar) -> Setup:
    """Draw somebody who enters or leaves the frame of the radar."""
    start_m, heading_deg = ((12.5, 0.3), 180.0) if enters else ((4.0, 0.3), 0.0)
    heading_deg += float(rng.uniform(-10, 10))
    return Setup(room([seen(rng, person(rng), start_position_m=start_m, heading_deg=heading_deg)], 7.0, rng),
                 radar)  # fmt: skip


BRICK = ({"kind": "wall", "material": "brick", "thickness_m": 0.115},)
FLOOR = ({"kind": "ground_bounce", "material": "concrete"},)
SIDE = ({"kind": "wall_ghost", "material": "brick", "thickness_m": 0.115, "side_m": 2.0},)
FURNISHED = (*FLOOR, *SIDE, {"kind": "wall", "material": "plasterboard", "thickness_m": 0.0125})
LOST = ({"kind": "dropped_frames", "probability": 0.01},)
LOST_RUNS = ({"kind": "dropped_frames", "probability": 0.05, "mean_length": 5.0},)
FRONT = (0.0, 30.0)
BURSTS = (128, 0.2)
"""As the recorded 24 GHz sensor sends them."""

TI60, XBAND, ANCORTEK = Radar.preset("ti-60"), Radar.preset("xband-fmcw"), Radar.preset("ancortek-24")
CW24, CW10 = Radar.preset("infineon-24"), Radar.preset("xband-cw", prf_hz=2000)
X4_255 = Radar.preset("x4-255fps")


def _one(cause: str, make: Callable[..., Motion] = person, **options: Any) -> Kind:
    return Kind(cause, passing, {"make": make, **options})


def _who(**options: Any) -> Callable[..., Motion]:
    return partial(person, **options)


SCENES: dict[str, Kind] = {
    **{f"walk, aspect {psi:g}": _one("walker" if psi in (0, 15, 30, 45, 135, 180) else "walker sideways",
                                     aspect_deg=float(psi)) for psi in (0, 15, 30, 45, 60, 75, 90, 135, 180)},
    "slow walk": _one("walker", _who(speed_mps=(0.45, 0.7)), aspect_deg=FRONT),
    "fast walk": _one("walker", _who(speed_mps=(1.6, 1.9)), aspect_deg=FRONT),
    "limp": _one("walker", _who(complaint="joint"), aspect_deg=FRONT),
    "weak": _one("walker", _who(complaint="weak"), aspect_deg=FRONT),
    "uneven": _one("walker", _who(complaint="neurological"), aspect_deg=FRONT),
    "senior": _one("walker", _who(age_class="senior"), aspect_deg=FRONT),
    "bag": _one("walker", _who(load="bag"), aspect_deg=FRONT),
    "hands in pockets": _one("walker", _who(load="pockets"), aspect_deg=FRONT),
    "pushes a pram": _one("walker", _who(load="pushing"), aspect_deg=FRONT),
    "child": _one("walker", _who(age_class="child", speed_mps=(0.7, 1.2)), aspect_deg=FRONT),
    "run": _one("runner", _who(gait="run", speed_mps=(2.3, 3.4)), aspect_deg=FRONT, radar=X4_LONG, middle_m=9.0,
                half_m=7.0),
    "child runs": _one("runner", _who(age_class="child", gait="run", speed_mps=(2.0, 2.8)), aspect_deg=FRONT,
                       radar=X4_LONG, middle_m=8.0, half_m=6.0),
    "crawl": _one("limbs outshine the trunk", crawler, aspect_deg=FRONT),
    "crawl away": _one("limbs outshine the trunk", crawler, aspect_deg=180.0),
    "dog walks": _one("limbs outshine the trunk", partial(dog, gait="walk"), aspect_deg=FRONT, label="dog"),
    "dog trots": _one("limbs outshine the trunk", partial(dog, gait="trot"), aspect_deg=FRONT, label="dog"),
    "dog trots, aspect 45": _one("limbs outshine the trunk", partial(dog, gait="trot"), aspect_deg=45.0, label="dog"),
    "dog gallops": _one("limbs outshine the trunk", partial(dog, gait="gallop"), aspect_deg=FRONT, label="dog",
                        radar=X4_LONG, middle_m=10.0, half_m=8.0),
    "cat walks": _one("limbs outshine the trunk", cat, aspect_deg=FRONT, label="cat", middle_m=4.0),
    "stops": Kind("unsteady", stops, {"goes_on": False}),
    "stop and go": Kind("unsteady", stops, {"goes_on": True}),
    "dog stops and goes": Kind(
        "unsteady", stops, {"goes_on": True, "make": partial(dog, speed_mps=1.2), "label": "dog"}
    ),
    "sits down": Kind("unsteady", sits, {"first": False}),
    "stands up": Kind("unsteady", sits, {"first": True, "rests_s": 6.0}),
    "turns on the spot": Kind("unsteady", turns, {"spot": True}),
    "turns in a U": Kind("unsteady", turns, {"spot": False}),
    "corner": Kind("unsteady", corner),
    "arc": Kind("unsteady", arc),
    "room laps": Kind("unsteady", laps, {"seconds": 12.0}),
    "60 s: laps": Kind("unsteady", laps, {"seconds": 60.0, "radar": X4_SLOW}),
    "60 s: sits in between": Kind("unsteady", sits, {"first": False, "rests_s": 53.0, "seconds": 60.0,
                                                     "radar": X4_SLOW}),
    "two abreast": Kind("close bodies", companions, {"side_m": 0.7, "ahead_m": 0.0}),
    "two abreast, aspect 45": Kind("close bodies", companions, {"side_m": 0.7, "ahead_m": 0.0, "aspect_deg": 45.0}),
    "adult and child abreast": Kind("close bodies", companions, {"side_m": 0.6, "ahead_m": 0.0, "child": True}),
    "follows at 0.8 m": Kind("close bodies", companions, {"side_m": 0.0, "ahead_m": -0.8}),
    "follows at 1.2 m": Kind("several", companions, {"side_m": 0.0, "ahead_m": -1.2}),
    "dog on a leash": Kind("close bodies", companions, {"side_m": -0.5, "ahead_m": 0.5, "walks_dog": True}),
    "dog on a leash, ahead": Kind("several", companions, {"side_m": -0.3, "ahead_m": 1.2, "walks_dog": True}),
    "dog circles a sitter": Kind("close bodies", circling),
    "person overtakes": Kind("several", two, {"first": "person", "second": "person", "places": "overtake"}),
    "dog overtakes": Kind("several", two, {"first": "person", "second": "dog", "places": "overtake"}),
    "crossing": Kind("several", two, {"first": "person", "second": "person", "places": "cross"}),
    "person and dog cross": Kind("several", two, {"first": "person", "second": "dog", "places": "cross"}),
    "two apart": Kind("several", two, {"first": "person", "second": "person", "places": "apart"}),
    "three people": Kind("several", two, {"first": "person", "second": "person", "places": "cross", "third": True}),
    "enters": Kind("frame", through_door, {"enters": True, "radar": X4_UNFOLDED}),
    "leaves": Kind("frame", through_door, {"enters": False, "radar": X4_UNFOLDED}),
    "leaves, echoes fold": Kind("frame", through_door, {"enters": False, "radar": X4}),
    "brick wall": _one("room", aspect_deg=FRONT, environment=BRICK),
    "floor": _one("room", aspect_deg=FRONT, environment=FLOOR),
    "side wall": _one("reflection", aspect_deg=FRONT, environment=SIDE),
    "side wall, dog": _one("reflection", partial(dog, gait="trot"), aspect_deg=FRONT, label="dog", environment=SIDE),
    "furnished room": _one("reflection", aspect_deg=FRONT, environment=FURNISHED, companions=1),
    "fan and walker": _one("thing", aspect_deg=FRONT, companions=1),
    "curtain and walker": _one("thing", aspect_deg=FRONT, companions=2),
    "vacuum and walker": _one("thing", aspect_deg=FRONT, companions=3),
    "fan": Kind("thing", alone, {"what": 1}),
    "curtain": Kind("thing", alone, {"what": 2}),
    "vacuum": Kind("thing", alone, {"what": 3}),
    "nobody": Kind("nobody moves", alone, {"what": 0, "seconds": 12.0}),
    "sitter": Kind("nobody moves", sitting),
    **{f"walk, SNR_frame {level:g} dB": _one("noise", aspect_deg=FRONT, snr_db=float(level)) for level in (10, 5, 0)},
    "slow walk, SNR_frame 10 dB": _one("noise", _who(speed_mps=(0.45, 0.7)), aspect_deg=FRONT, snr_db=10.0),
    "run, SNR_frame 10 dB": _one("noise", _who(gait="run", speed_mps=(2.3, 3.4)), aspect_deg=FRONT, radar=X4_LONG,
                                 middle_m=9.0, half_m=7.0, snr_db=10.0),
    "dog trots, SNR_frame 10 dB": _one("noise", partial(dog, gait="trot"), aspect_deg=FRONT, label="dog", snr_db=10.0),
    "1 % of frames lost": _one("lost frames", aspect_deg=FRONT, further=LOST),
    "5 % lost in runs": _one("lost frames", aspect_deg=FRONT, further=LOST_RUNS),
    "ti-60": _one("other radar", aspect_deg=FRONT, radar=TI60, middle_m=4.3, half_m=2.8),
    "ti-60, dog": _one("other radar", partial(dog, gait="trot"), aspect_deg=FRONT, label="dog", radar=TI60,
                       middle_m=4.3, half_m=2.8),
    "X band": _one("other radar", aspect_deg=FRONT, radar=XBAND, middle_m=20.0, half_m=6.0),
    "24 GHz FMCW": _one("other radar", aspect_deg=FRONT, radar=ANCORTEK, middle_m=6.0, half_m=4.0),
    "X4 at 255 fps": _one("other radar", _who(speed_mps=(0.7, 1.1)), aspect_deg=FRONT, radar=X4_255, middle_m=2.8,
                          half_m=1.5),
    "X4 at 255 fps, child": _one("other radar", _who(age_class="child", speed_mps=(0.6, 1.0)), aspect_deg=FRONT,
                                 radar=X4_255, middle_m=2.8, half_m=1.5),
    "X4 at 255 fps, sideways": _one("other radar", aspect_deg=60.0, radar=X4_255, middle_m=2.8, half_m=1.5),
    "CW 24 GHz": _one("CW", aspect_deg=FRONT, radar=CW24),
    "CW 10 GHz": _one("CW", aspect_deg=FRONT, radar=CW10),
    "CW 10 GHz, dog": _one("CW", partial(dog, gait="trot"), aspect_deg=FRONT, label="dog", radar=CW10),
    "CW 10 GHz, two": Kind("CW", two, {"first": "person", "second": "person", "places": "cross", "radar": CW10}),
    "CW 10 GHz, sitter": Kind("CW", sitting, {"radar": CW10, "seconds": 15.0}),
    "CW 24 GHz in bursts": _one("CW", aspect_deg=FRONT, radar=CW24, bursts=BURSTS),
    "CW 24 GHz in bursts, sitter": Kind("CW", sitting, {"radar": CW24, "seconds": 20.0, "bursts": BURSTS}),
}  # fmt: skip
