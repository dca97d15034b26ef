"""Scenes from which the evidence of verdicts is learned: bodies and things, their ways and radars by chance.

For the study ``verdicts.py``. No scene imitates a known device: bodies follow paths of every kind, things are
points on rigid, turning, rolling, swinging or waving shapes with parameters over decades.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from everyday_scenes import BURSTS, X4, Kind, Rng, Setup, breather, cat, crawler, dog, person, room, seen
from harness import FloatArray

from doppelgait.core.errors import ConfigError, MotionError
from doppelgait.motion.models.quadruped import quadruped_gait
from doppelgait.motion.motion import Motion, make_motion
from doppelgait.radar import Radar
from doppelgait.scene import Target
from doppelgait.scene.placement import leashed_dog, place, side_by_side

RATE_HZ = 250.0
RADARS: dict[str, tuple[Radar, float, float]] = {  # with the nearest and the farthest place of a body
    "x4": (X4, 1.2, 9.0),
    "x4-high": (Radar.preset("x4-high"), 1.2, 9.0),
    "x4-long": (Radar.preset("x4-long", range_stop_m=20.0), 2.0, 18.0),
    "x4-250": (Radar.preset("x4", prf_hz=250.0), 1.2, 9.0),
    "x4-125": (Radar.preset("x4", prf_hz=125.0), 1.2, 9.0),
    "x4-255fps": (Radar.preset("x4-255fps"), 1.0, 4.7),
    "ti-60": (Radar.preset("ti-60"), 1.0, 7.5),
    "ti-77": (Radar.preset("ti-77"), 1.5, 14.0),
    "ancortek-24": (Radar.preset("ancortek-24"), 1.5, 11.0),
    "xband-fmcw": (Radar.preset("xband-fmcw"), 5.0, 40.0),
    "infineon-24": (Radar.preset("infineon-24"), 1.0, 7.0),
    "xband-cw": (Radar.preset("xband-cw", prf_hz=2000), 1.0, 8.0),
}


# Things --------------------------------------------------------------------------------------------------------------


def rise(time_s: FloatArray, start_s: float, lasts_s: float) -> FloatArray:
    """Rise from 0 to 1 with the least jerk."""
    x = np.clip((time_s - start_s) / lasts_s, 0.0, 1.0)
    return np.asarray(x**3 * (10 - 15 * x + 6 * x * x))


def to_and_fro(rng: Rng, time_s: FloatArray, longest_s: float) -> FloatArray:
    """Go from 0 to 1 and back, with rests."""
    share, now_s, up = np.zeros_like(time_s), float(rng.uniform(0.1, 1.5)), 1.0
    while now_s < time_s[-1]:
        lasts_s = float(rng.uniform(0.5, longest_s))
        share += up * rise(time_s, now_s, lasts_s)
        now_s, up = now_s + lasts_s + float(rng.uniform(0.1, 3.0)), -up
    return share


def turned(along: Any, across: Any, height: Any, angle_rad: Any) -> FloatArray:
    """Place a point, turned about the vertical; shape (T, 3)."""
    x, y = (
        along * np.cos(angle_rad) - across * np.sin(angle_rad),
        along * np.sin(angle_rad) + across * np.cos(angle_rad),
    )
    return np.stack(np.broadcast_arrays(x, y, height), axis=-1).astype(np.float64)


def leaf(rng: Rng, time_s: FloatArray) -> list[FloatArray]:
    """Swing a door, gate or lid about its hinge."""
    width_m, side = rng.uniform(0.4, 1.2), rng.choice([-1.0, 1.0])
    angle = rng.uniform(-np.pi, np.pi) + side * math.radians(rng.uniform(30, 120)) * to_and_fro(rng, time_s, 2.5)
    return [turned(r * width_m, 0.0, z, angle) for r in (0.15, 0.4, 0.6, 0.8, 1.0) for z in (0.3, 1.0, 1.7)]


def slider(rng: Rng, time_s: FloatArray) -> list[FloatArray]:
    """Push a door, drawer or curtain along its rail."""
    way_m, width_m = rng.uniform(0.3, 1.5) * to_and_fro(rng, time_s, 2.5), rng.uniform(0.3, 1.2)
    phi = rng.uniform(-np.pi, np.pi)
    return [turned(way_m, y * width_m, z, phi) for y in (-0.5, 0.0, 0.5) for z in (0.3, 1.0, 1.7)]


def rotor(rng: Rng, time_s: FloatArray) -> list[FloatArray]:
    """Turn blades about an upright or level axis; some heads turn to and fro."""
    radius_m, turns_hz, count = rng.uniform(0.1, 0.8), 10.0 ** rng.uniform(-0.5, 1.2), int(rng.integers(2, 6))
    yaw = rng.uniform(0, 2 * np.pi) + rng.choice([0.0, 0.7]) * np.sin(2 * np.pi * rng.uniform(0.05, 0.2) * time_s)
    level, points = bool(rng.integers(2)), [turned(0.0 * time_s, 0.0, 1.0, 0.0)]
    for blade in range(count):
        turn = 2 * np.pi * (turns_hz * time_s + blade / count)
        for r in (0.4, 0.7, 1.0):
            out_m = r * radius_m * np.cos(turn), r * radius_m * np.sin(turn)
            points.append(turned(*out_m, 1.8, 0.0) if level else turned(0.0, out_m[0], 1.0 + out_m[1], yaw))
    return points


def sweeper(rng: Rng, time_s: FloatArray) -> list[FloatArray]:
    """Drive a robot that sweeps or mows."""
    return roller(rng, time_s, size_m=rng.uniform(0.25, 0.6), top_mps=rng.uniform(0.12, 0.5), parts="brush")


def cart(rng: Rng, time_s: FloatArray, speed_mps: float) -> list[FloatArray]:
    """Roll straight ahead, with wheels."""
    parts = str(rng.choice(["plain", "wheels"]))
    return roller(rng, time_s, size_m=rng.uniform(0.3, 1.0), top_mps=speed_mps, parts=parts, path="straight")


def roller(rng: Rng, time_s: FloatArray, **chosen: Any) -> list[FloatArray]:
    """Drive or roll a box, with wheels, a brush, a spin, or none, on a path by chance."""
    size_m = chosen.get("size_m", 10.0 ** rng.uniform(-1.0, 0.2))
    top_mps = chosen.get("top_mps", 10.0 ** rng.uniform(-0.8, 0.4))
    speed_mps, turn_radps = np.full_like(time_s, top_mps), np.zeros_like(time_s)
    path = chosen.get("path", rng.choice(["straight", "arc", "wander", "stop", "back", "spot", "dashes"]))
    if path == "arc":
        turn_radps += rng.uniform(0.2, 1.0) * rng.choice([-1.0, 1.0])
    elif path == "wander":
        knots_s = np.arange(0.0, time_s[-1] + 1.0)
        turn_radps = np.interp(time_s, knots_s, rng.normal(0.0, 0.5, knots_s.size))
    elif path == "stop":
        speed_mps = top_mps * (1.0 - rise(time_s, rng.uniform(0.5, 3.0), rng.uniform(0.4, 4.0)))
    elif path == "back":
        speed_mps = top_mps * np.tanh(4.0 * np.sin(2 * np.pi * rng.uniform(0.1, 0.5) * time_s + rng.uniform(0, 6)))
    elif path == "spot":
        turns = np.sin(2 * np.pi * rng.uniform(0.1, 0.3) * time_s) > 0.5
        speed_mps, turn_radps = np.where(turns, 0.0, top_mps), np.where(turns, rng.uniform(0.5, 2.0), 0.0)
    elif path == "dashes":
        go, each_s = np.zeros_like(time_s), rng.uniform(1.0, 4.0)
        for start_s in np.arange(-rng.uniform(0, each_s), time_s[-1], each_s):
            pause_s = rng.uniform(0.1, 0.6) * each_s
            go += rise(time_s, start_s, 0.4) - rise(time_s, start_s + each_s - pause_s, 0.4)
            turn_radps += rng.uniform(-2.0, 2.0) / pause_s * (np.abs(time_s - start_s - each_s) < pause_s / 2)
        speed_mps = speed_mps * go
    heading = np.cumsum(turn_radps) / RATE_HZ
    centre_m = np.cumsum(turned(speed_mps, 0.0, 0.0, heading), axis=0) / RATE_HZ
    rolled, brush_hz = np.cumsum(speed_mps) / RATE_HZ, rng.uniform(1.0, 4.0)
    parts = chosen.get("parts", rng.choice(["plain", "wheels", "brush", "spin"]))
    if parts == "spin":
        turn, r = rolled / (size_m / 2), size_m / 2
        rim = [(r * math.cos(q) * np.cos(turn + p), r * math.sin(q), r - r * math.cos(q) * np.sin(turn + p))
               for p in (0.0, 2.0, 4.0) for q in (-0.7, 0.0, 0.7)]  # fmt: skip
        return [centre_m + turned(*point, heading) for point in rim]
    box = [(x * size_m / 2, y * size_m / 3, z * size_m) for x in (-1, 0, 1) for y in (-1, 1) for z in (0.3, 0.8)]
    box = [box[n] for n in rng.permutation(12)[: int(rng.integers(2, 13))]]
    points, around = [centre_m + turned(*corner, heading) for corner in box], int(rng.integers(1, 4))
    r = rng.uniform(0.1, 0.35) * size_m
    for k in range({"wheels": 4, "brush": 3}.get(str(parts), 0)):
        for n in range(around):
            if parts == "wheels":
                turn = rolled / r + 2 * np.pi * n / around + k
                spot = (
                    (-1) ** (k // 2) * 0.35 * size_m + r * np.cos(turn),
                    (-1) ** k * size_m / 3,
                    r - r * np.sin(turn),
                )
            else:
                turn = 2 * np.pi * (brush_hz * time_s + k / 3)
                spot = (size_m / 3 + (n + 1) / around * r * np.cos(turn), (n + 1) / around * r * np.sin(turn), 0.02)
            points.append(centre_m + turned(*spot, heading))
    return points


def swing(rng: Rng, time_s: FloatArray) -> list[FloatArray]:
    """Swing on a rope, with decay."""
    length_m, decay = rng.uniform(0.3, 2.2), np.exp(-rng.uniform(0.0, 0.3) * time_s)
    swing_hz = math.sqrt(9.81 / length_m) / (2 * np.pi)
    angle = math.radians(rng.uniform(5, 45)) * decay * np.sin(2 * np.pi * swing_hz * time_s + rng.uniform(0, 6))
    phi, width_m = rng.uniform(-np.pi, np.pi), rng.uniform(0.05, 0.6)
    return [
        turned(length_m * np.sin(angle), y * width_m, 2.4 - length_m * np.cos(angle), phi) for y in (-0.5, 0.0, 0.5)
    ]


def waves(rng: Rng, time_s: FloatArray) -> list[FloatArray]:
    """Wave cloth, leaves or water: every point has its own lag and rate."""
    wave_hz, wide_m, reach_m = 10.0 ** rng.uniform(-0.7, 0.5), 10.0 ** rng.uniform(-1.5, -0.3), rng.uniform(0.3, 1.5)
    apart, phi, points = rng.choice([0.0, 0.3]), rng.uniform(-np.pi, np.pi), []
    gust = 1.0 + 0.7 * np.sin(2 * np.pi * rng.uniform(0.05, 0.3) * time_s + rng.uniform(0, 6))
    for _ in range(16):
        phase = 2 * np.pi * wave_hz * (1 + apart * rng.uniform(-1, 1)) * time_s + rng.uniform(0, 3)
        way_m = wide_m * gust * (np.sin(phase) + 0.2 * np.sin(2.3 * phase + 1))
        points.append(
            turned(
                rng.uniform(-0.5, 0.5) * reach_m + way_m,
                rng.uniform(-0.5, 0.5) * reach_m + 0.3 * way_m,
                rng.uniform(0.3, 2),
                phi,
            )
        )
    return points


def drift(rng: Rng, time_s: FloatArray) -> list[FloatArray]:
    """Drift like a balloon or shake like a machine: correlated noise of any pace."""
    pace_hz, wide_mps = 10.0 ** rng.uniform(-0.7, 1.3), 10.0 ** rng.uniform(-1.2, 0.0)
    knots_s = np.arange(0.0, time_s[-1] + 2 / pace_hz, 1 / pace_hz)
    speed = np.stack([np.interp(time_s, knots_s, rng.normal(0.0, wide_mps, knots_s.size)) for _ in range(2)], axis=1)
    speed += rng.choice([0.0, 1.0]) * 10.0 ** rng.uniform(-1.0, 0.0) * np.array([1.0, rng.uniform(-0.5, 0.5)])
    way_m = np.cumsum(speed - speed.mean(axis=0) * (rng.random() < 0.3), axis=0) / RATE_HZ
    radius_m, turn = rng.uniform(0.05, 0.4), 2 * np.pi * 10.0 ** rng.uniform(-1.5, 0.5) * time_s
    bob_m = 10.0 ** rng.uniform(-2.0, -0.5) * np.sin(2 * np.pi * rng.uniform(0.2, 2.0) * time_s)
    return [
        turned(way_m[:, 0] + radius_m * np.cos(a + turn), way_m[:, 1] + radius_m * np.sin(a + turn), z + bob_m, 0.0)
        for a in np.arange(0, 6, 1)
        for z in (1.0, 1.0 + radius_m)
    ]


THINGS: dict[str, Callable[[Rng, FloatArray], list[FloatArray]]] = {
    "leaf": leaf, "slider": slider, "rotor": rotor, "roller": roller, "swing": swing, "waves": waves, "drift": drift,
    "sweeper": sweeper, "cart": cart,
}  # fmt: skip


def thing(
    rng: Rng, kind: str, seconds: float, place_m: tuple[float, float], heading_deg: float | None = None, *speed: float
) -> Target:
    """Make a thing at a place, with a heading by chance if none is given."""
    points = THINGS[kind](rng, np.arange(0.0, seconds + 0.1, 1 / RATE_HZ), *speed)
    motion = make_motion(
        np.stack(points, axis=1), rate_hz=RATE_HZ, markers=[f"p{n}" for n in range(len(points))],
        parts=[""] * len(points), facts={"source": kind, "kind": kind, "mass_kg": 5.0},
    )  # fmt: skip
    size_m2 = float(10.0 ** rng.uniform(-2.0, 0.2))
    if heading_deg is None:
        heading_deg = float(rng.uniform(-180, 180))
    return Target(motion, label="thing", rcs={"total_m2": size_m2, "kind": "equal"}, background=True,
                  start_position_m=place_m, heading_deg=heading_deg)  # fmt: skip


# Bodies --------------------------------------------------------------------------------------------------------------


def mover(rng: Rng, seconds: float) -> tuple[Motion, str]:
    """Sample somebody who moves, and the label."""
    who = rng.choice(["adult", "adult", "child", "runner", "dog", "dog", "cat", "crawler", "horse"])
    if who == "dog":
        return dog(rng, seconds), "dog"
    if who == "cat":
        return cat(rng), "cat"
    if who == "crawler":
        return crawler(rng), "human"
    if who == "horse":
        size = {"build": "horse", "withers_m": float(rng.uniform(1.2, 1.7)), "start_phase": float(rng.random())}
        return quadruped_gait(gait=str(rng.choice(["walk", "trot"])), duration_s=2 * seconds, rng=rng, **size), "horse"
    if who == "runner":
        return person(rng, seconds, gait="run", speed_mps=(2.0, 3.2)), "human"
    speeds = (0.4, 1.7) if who == "adult" else (0.4, 1.2)
    return person(rng, seconds, speed_mps=speeds, age_class=str(who)), "human"


def path(rng: Rng) -> dict[str, Any] | None:
    """Draw a path: straight in half of the scenes."""
    side = float(rng.choice([-1.0, 1.0]))
    out_m = float(rng.uniform(1.5, 5.0))
    paths: list[dict[str, Any]] = [
        {"kind": "arc", "radius_m": float(rng.uniform(0.6, 3.0)), "turn_deg": 1500.0 * side},
        {"kind": "stop_and_go", "stops": [{"at_m": out_m, "pause_s": float(rng.uniform(0.5, 4.0))}]},
        {"kind": "turn_around", "out_m": out_m, "radius_m": float(rng.uniform(0.4, 1.0))},
        {"kind": "turn_around", "out_m": out_m, "turn_s": float(rng.uniform(0.8, 2.0))},
        {"kind": "polyline", "points_m": [(0.0, 0.0), (out_m, 0.0), (out_m + 10.0, 17.0 * side)]},
    ]
    return None if rng.random() < 0.5 else paths[int(rng.integers(len(paths)))]


def bodies(rng: Rng, low_m: float, high_m: float, seconds: float, count: int) -> list[Target]:
    """Draw bodies; two are companions, part, meet, or go their own ways; a third one is a companion."""
    away = bool(rng.integers(2))
    middle_m = (low_m + high_m) / 2
    start_m = float(rng.uniform(low_m, middle_m) if away else rng.uniform(middle_m, high_m))
    where: dict[str, Any] = {
        "start_position_m": (start_m, float(rng.uniform(-1.0, 1.0))),
        "heading_deg": (0.0 if away else 180.0) + float(rng.uniform(-1, 1) ** 3) * 90.0,
    }
    route = path(rng)
    if count == 1:
        motion, label = mover(rng, seconds)
        return [seen(rng, motion, label, **where, **({"path": route} if route else {}))]
    how = rng.choice(["companion", "companion", "leash", "leash", "parting", "meeting", "alone"])
    side_m, ahead_m = float(rng.uniform(0.3, 1.1) * rng.choice([-1, 1])), float(rng.uniform(-0.9, 0.9))
    if how == "alone":
        return [*bodies(rng, low_m, high_m, seconds, 1), *bodies(rng, low_m, high_m, seconds, count - 1)]
    gait, least_mps, most_mps = ("run", 1.8, 3.0) if not rng.integers(5) else ("walk", 0.6, 1.6)
    speed = float(rng.uniform(least_mps, most_mps))
    companions = how in ("companion", "leash") and route and route["kind"] != "turn_around"
    lead = seen(rng, person(rng, seconds, speed_mps=(speed, speed), gait=gait), **where,
                **({"path": route} if companions else {}))  # fmt: skip
    if how == "leash":
        found = leashed_dog(lead, dog(rng, seconds, speed_mps=speed), side_m=side_m, ahead_m=ahead_m)
    else:
        age = str(rng.choice(["adult", "child"])) if gait == "walk" else "adult"
        other = person(rng, seconds, speed_mps=(0.9 * speed, 1.1 * speed), age_class=age, gait=gait)
        found = side_by_side(lead, seen(rng, other), side_m=side_m, ahead_m=ahead_m)
    if how in ("parting", "meeting"):
        joint_m, x_m, y_m = float(rng.uniform(1, 4)), *where["start_position_m"]
        last_m, side = (joint_m + 10.0, 15.0) if how == "parting" else (joint_m + 20.0, 0.0)
        turn = {"kind": "polyline", "points_m": [(0.0, 0.0), (joint_m, side_m if how == "meeting" else 0.0),
                                                 (last_m, side or side_m)]}  # fmt: skip
        beside = (x_m + 0.3 * ahead_m, y_m + (2.0 if how == "meeting" else 1.0) * side_m)
        found = [lead, seen(rng, other, start_position_m=beside, heading_deg=where["heading_deg"], path=turn)]
    if count == 3:
        third = person(rng, seconds, speed_mps=(speed, speed), gait=gait)
        found += side_by_side(lead, seen(rng, third), side_m=-side_m, ahead_m=float(rng.uniform(-0.9, 0.9)))[1:]
    return found


def pushed(rng: Rng, low_m: float, high_m: float, seconds: float) -> list[Target]:
    """Draw somebody who pushes or pulls a cart."""
    speed, start_m, sign = float(rng.uniform(0.4, 1.5)), float(rng.uniform(low_m, high_m)), rng.choice([-1.0, 1.0])
    y_m, heading_deg = float(rng.uniform(-1, 1)), 90.0 - 90.0 * sign
    walker = seen(rng, person(rng, seconds, speed_mps=(speed, speed)), start_position_m=(start_m, y_m),
                  heading_deg=heading_deg)  # fmt: skip
    ahead_m = float(rng.uniform(0.4, 1.0) * rng.choice([1.0, 1.0, -1.0]))
    cart = thing(rng, "cart", seconds, (start_m + sign * ahead_m, y_m), heading_deg, speed)
    return [walker, cart]


def draw_targets(rng: Rng, what: str, low_m: float, high_m: float, seconds: float) -> list[Target]:
    """Draw bodies, a thing, both, or a cart that is pushed."""
    kind, _, beside = what.partition("+")
    targets: list[Target] = []
    if kind == "cart":  # somebody pushes it
        targets += pushed(rng, low_m, high_m, seconds)
    elif beside or kind not in THINGS:
        targets += bodies(rng, low_m, high_m, seconds, {"two": 2, "three": 3}.get(kind, 1))
    if kind in THINGS and kind != "cart":
        place_m = (float(rng.uniform(low_m + 0.5, high_m - 0.5)), float(rng.uniform(-1.5, 1.5)))
        if targets and rng.integers(2):  # where somebody passes
            x_m, y_m = targets[0].start_position_m or place_m
            place_m = (x_m + float(rng.uniform(-1.5, 1.5)), y_m + float(rng.uniform(-1.0, 1.0)))
        targets.append(thing(rng, kind, seconds, place_m))
    if not rng.integers(6):
        targets.append(breather(rng, float(rng.uniform(low_m, high_m))))
    return targets


def anything(rng: Rng, *, what: str, radar: str) -> Setup:
    """Draw a scene: ``body``, ``two``, ``three``, a thing, or a thing and a body."""
    device, low_m, high_m = RADARS[radar]
    seconds = float(rng.uniform(2.5, 8.0))
    while True:
        try:
            scene = room(draw_targets(rng, what, low_m, high_m, seconds), seconds, rng)
            place(scene)
        except (ConfigError, MotionError):  # a speed that the path or the companion does not allow
            continue
        weak = not rng.integers(3) and bool(scene.observed_targets)
        bursts = BURSTS if radar == "infineon-24" and not rng.integers(4) else None
        return Setup(scene, device, snr_db=float(rng.uniform(5, 25)) if weak else None, bursts=bursts)


ALONE = ("leaf", "slider", "rotor", "roller", "sweeper", "swing", "waves", "drift", "roller", "drift")
BESIDE = (*ALONE[:8], "leaf", "cart")
WHAT = (*6 * ("body",), *8 * ("two",), "three", *2 * ALONE, *(f"{kind}+body" for kind in BESIDE))
SCENES: dict[str, Kind] = {
    f"{what} {number}, {radar}": Kind(what, anything, {"what": what, "radar": radar})
    for radar in RADARS
    for number, what in enumerate(WHAT)
}
