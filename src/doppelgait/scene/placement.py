"""Motions of a scene: made or read, scaled, placed; targets that move together."""

from __future__ import annotations

import json
import math
import warnings
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.documents import parse_json
from doppelgait.core.errors import ConfigError, DoppelgaitError, DoppelgaitWarning, MotionError, warn_caller
from doppelgait.core.notebook import show_html
from doppelgait.core.rng import Streams
from doppelgait.core.units import FloatArray
from doppelgait.motion.follow import follow, steady_speed_mps
from doppelgait.motion.motion import Motion
from doppelgait.motion.paths import StraightPath, TurnAroundPath
from doppelgait.motion.retime import place as place_motion
from doppelgait.motion.retime import scale_to_height, travel_speed_mps, vary
from doppelgait.scene.scene import DEFAULT_DURATION_S, Scene, Target

BACKGROUND = -2
"""Target number of background bodies and their reflections; reflections of targets have -1."""

GOES_ON_FRAMES = 8
"""Frames for which a body that is away still moves: a spline's kink fades to 4e-5 over them."""
KEPT_BYTES = 128 * 2**20
"""Maximum size of the cache of motions, bytes: about three hundred segments of motion capture."""

_read_before: OrderedDict[tuple[Path, tuple[int, int], str], tuple[Motion, list[str]]] = OrderedDict()
_reading = Lock()


@dataclass(frozen=True, eq=False)
class PlacedTarget:
    """Target with its motion in the frame of the scene.

    Parameters
    ----------
    number : int
        Number in the scatterer table: the index among the observed targets, -2 for background.
    motion : Motion
        Motion after scaling, path, rotation and translation; it covers the observation, and a body
        that is not in the scene holds its first or last posture. Its facts are those of the whole
        motion.
    ground_speed_mps : float
        Speed along the path; without a path, net displacement divided by the time in the scene.
    stay_s : (float, float)
        Times at which the body comes and goes, infinite if it does not.
    """

    target: Target
    number: int
    motion: Motion
    ground_speed_mps: float
    stay_s: tuple[float, float] = (-math.inf, math.inf)

    def is_there(self, time_s: FloatArray) -> npt.NDArray[np.bool_]:
        """Return at which times the body is in the scene."""
        return np.asarray((time_s >= self.stay_s[0]) & (time_s <= self.stay_s[1]))


@dataclass(frozen=True, eq=False)
class PlacedScene:
    """Scene with made and placed motions.

    Parameters
    ----------
    targets : tuple of PlacedTarget
        Targets in the order of the scene.
    observation_s : float
        Observation time: ``scene.duration_s``, or the duration of the shortest motion.
    """

    scene: Scene
    targets: tuple[PlacedTarget, ...]
    observation_s: float

    @property
    def observed(self) -> tuple[PlacedTarget, ...]:
        """Targets that are not background, in the order of their numbers."""
        return tuple(target for target in self.targets if target.number != BACKGROUND)


def place(scene: Scene, streams: Streams | None = None, *, folder: Path | None = None) -> PlacedScene:
    """Make or read, scale and place every motion, each once.

    Parameters
    ----------
    streams : Streams, optional
        Random streams for motions with variation; the targets use the stream ``motion`` one after the other.
    folder : Path, optional
        Base folder of relative motion paths; the working folder by default.

    Raises
    ------
    ConfigError
        If a motion is shorter than the scene, or its parameters are not allowed; the message names the target.
    MotionError
        If a motion file cannot be used, or a motion cannot follow its path.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2})], duration_s=2.0)
    >>> placed = dg.scene.place(scene)
    >>> placed.observation_s, placed.targets[0].motion.facts.gait
    (2.0, 'walk')
    """
    return next(place_all([scene], [streams], folder=folder))


def place_all(
    scenes: Sequence[Scene], streams: Sequence[Streams | None], *, folder: Path | None = None
) -> Iterator[PlacedScene]:
    """Place many scenes; the motions of their models are made together."""
    # the models' motions are made at the first step, and each scene is read and placed at its own, with its warnings
    rows = [*zip(scenes, streams, strict=True)]
    # the shortest file determines the duration of the models' motions if the scene states none
    read = [{} if row[0].duration_s else _read_motions(*row, folder) for row in rows]
    models = _make_motions(rows, [_find_needed_s(*row) for row in zip(scenes, read, strict=True)])
    for row, files, made in zip(rows, read, models, strict=True):
        motions = made | (files or _read_motions(*row, folder))
        yield _place_motions(row[0], [motions[number] for number in range(len(row[0].targets))])


def _place_motions(scene: Scene, unscaled: list[Motion]) -> PlacedScene:
    motions = []
    for number, (target, motion) in enumerate(zip(scene.targets, unscaled, strict=True)):
        stay_s = None if scene.duration_s is None else -float(np.subtract(*target.find_stay_s(scene.duration_s)))
        try:
            motions.append(_scale(target, motion, stay_s))
        except (ConfigError, MotionError) as error:
            raise type(error)(f"targets.{number}: {error}") from None
        lasts_s = motions[-1].duration_s
        if stay_s is not None and lasts_s < stay_s - 1e-6:
            remedy = "duration_s" if stay_s == scene.duration_s else "leave_s - enter_s"
            raise ConfigError(
                f"targets.{number}: its motion ({motion.facts.source}) lasts {lasts_s:.3f} s, but the body is in the "
                f"scene for {stay_s:g} s; lower {remedy} to {math.floor(lasts_s * 100) / 100} or less"
            )
    observation_s = scene.duration_s or min(motion.duration_s for motion in motions)
    numbers, placed = iter(range(len(scene.targets))), []
    for target, motion in zip(scene.targets, motions, strict=True):
        enter_s, leave_s = target.find_stay_s(observation_s)
        path, whole = motion.facts.path, _place(target, motion, scene, leave_s - enter_s)
        placed.append(
            PlacedTarget(
                target=target,
                number=BACKGROUND if target.background else next(numbers),
                motion=_hold(whole, enter_s, leave_s, observation_s),
                ground_speed_mps=path.mean_speed_mps if path else travel_speed_mps(motion, first_s=leave_s - enter_s),
                stay_s=(enter_s or -math.inf, leave_s if leave_s < observation_s else math.inf),
            )
        )
    return PlacedScene(scene, tuple(placed), observation_s)


def _hold(motion: Motion, enter_s: float, leave_s: float, observation_s: float) -> Motion:
    # the first posture before the body comes, the last one after it has gone
    if enter_s == 0 and leave_s == observation_s:
        return motion
    rate_hz, first_s = motion.rate_hz, float(motion.time_s[0])
    before, stays = round(enter_s * rate_hz), math.ceil((leave_s - enter_s) * rate_hz - 1e-6) + 1
    frames = np.arange(math.ceil(observation_s * rate_hz - 1e-6) + 2) - before
    last = min(stays, motion.n_frames) - 1
    held = np.clip(frames, 0, last)
    # the body first goes on as it was, so that the spline is not bent where it is still seen
    beyond = np.clip(frames - held, -GOES_ON_FRAMES, GOES_ON_FRAMES)[:, np.newaxis, np.newaxis]
    steps_m = np.diff(motion.position_m[: last + 1], axis=0)
    step_m = np.where(beyond < 0, steps_m[0], steps_m[-1])
    facts = motion.facts
    moved = {foot: [t - first_s + before / rate_hz for t in times] for foot, times in facts.footfalls.items()}
    facts = replace(facts, footfalls=moved, file_time_s=facts.file_time_s - before / rate_hz)
    return motion.remake(motion.position_m[held] + beyond * step_m, facts)


def as_placed(scene: Scene | PlacedScene, streams: Streams | None = None) -> PlacedScene:
    """Place a scene; return a placed scene unchanged."""
    return scene if isinstance(scene, PlacedScene) else place(scene, streams)


def make_scaled_motion(target: Target) -> Motion:
    """Make or read a target's motion, on its path."""
    motion = target.motion
    if not isinstance(motion, Motion):
        motion = build_motion(motion, duration_s=DEFAULT_DURATION_S)
    return _scale(target, motion, None)


def _scale(target: Target, motion: Motion, wanted_s: float | None) -> Motion:
    # a motion on a path is then in the frame of the scene
    if target.height_m is not None:
        motion = scale_to_height(motion, height_m=target.height_m, mode=target.scaling)
    if target.path is None or target.start_position_m is None or target.heading_deg is None:
        return motion
    on_path = partial(follow, start_position_m=target.start_position_m, heading_deg=target.heading_deg)
    whole = on_path(motion, target.path)
    if wanted_s is None:
        return whole
    frames = math.ceil(wanted_s * whole.rate_hz - 1e-6) + 1
    if frames <= whole.n_frames:
        return whole.frames(0, frames)
    covering = on_path(motion, target.path, duration_s=wanted_s)  # raises an error if more than a frame is missing
    return replace(covering, facts=whole.facts)


def _place(target: Target, motion: Motion, scene: Scene, observation_s: float) -> Motion:
    # a motion on a path is already in position
    if target.path is not None:
        return motion
    if target.start_position_m is not None and target.heading_deg is not None:
        return place_motion(motion, position_m=target.start_position_m, heading_deg=target.heading_deg, at_s=0.0)
    range_m = _choose_range_m(motion, observation_s) if target.range_m is None else target.range_m
    bearing = math.radians(target.bearing_deg)
    x, y, _ = scene.radar_position_m
    middle_m = (x + range_m * math.cos(bearing), y + range_m * math.sin(bearing))
    heading_deg = target.bearing_deg + 180.0 + target.aspect_deg
    return place_motion(motion, position_m=middle_m, heading_deg=heading_deg, at_s=observation_s / 2.0)


def _is_model(target: Target) -> bool:
    return not isinstance(target.motion, Motion) and target.motion["kind"] != "file"


def _lengthen(target: Target, duration_s: float) -> float:
    return duration_s if target.vary is None else target.vary.needed_s(duration_s)


def _read_motions(scene: Scene, streams: Streams | None, folder: Path | None) -> dict[int, Motion]:
    """Read the motions of files, and take those that are given, by the numbers of their targets."""
    motions = {}
    for number, target in enumerate(scene.targets):
        if _is_model(target):
            continue
        motion = target.motion
        if not isinstance(motion, Motion):
            # the offset of a loop does not affect models
            rng = None if streams is None else streams.generator("motion", f"targets.{number}")
            lasts_s = _lengthen(target, DEFAULT_DURATION_S)
            try:
                motion = build_motion(motion, duration_s=lasts_s, folder=folder, rng=rng)
            except ConfigError as error:
                raise ConfigError(f"targets.{number}.motion: {error}") from None
        motions[number] = _vary(number, target, motion, streams)
    return motions


def _find_needed_s(scene: Scene, files: Mapping[int, Motion]) -> float:
    """Return the duration of the motions of models."""
    if scene.duration_s is None:
        return min((motion.duration_s for motion in files.values()), default=DEFAULT_DURATION_S)
    # a model scaled dynamically to a smaller height runs faster, and a path may be faster than its
    # motion (twice 30 %: in its speed, and next to a curve), so its motion must be longer
    froude = 2.0 if any(target.scaling == "froude" for target in scene.targets) else 1.0
    return scene.duration_s * froude * (1.7 if any(t.path is not None for t in scene.targets) else 1.0)


def _make_motions(rows: Sequence[tuple[Scene, Streams | None]], needed_s: Sequence[float]) -> list[dict[int, Motion]]:
    """Make the motions of models, by the numbers of their targets in each scene."""
    from doppelgait.motion.models.registry import generate_all

    made: list[dict[int, Motion]] = [{} for _ in rows]
    rngs = [None if streams is None else streams.generator("motion") for _, streams in rows]
    # a target of every scene at a time, since those of a scene draw from a common generator
    for number in range(max((len(scene.targets) for scene, _ in rows), default=0)):
        several = {row: scene.targets[number] for row, (scene, _) in enumerate(rows) if number < len(scene.targets)}
        batch = {row: target for row, target in several.items() if _is_model(target)}
        lasts_s = [_lengthen(target, needed_s[row]) for row, target in batch.items()]
        try:
            models = [_check_model(target.motion) for target in batch.values()]
            motions = generate_all(models, durations_s=lasts_s, rngs=[rngs[row] for row in batch])
        except ConfigError as error:
            raise ConfigError(f"targets.{number}.motion: {error}") from None
        for (row, target), motion in zip(batch.items(), motions, strict=True):
            made[row][number] = _vary(number, target, motion, rows[row][1])
    return made


def _vary(number: int, target: Target, motion: Motion, streams: Streams | None) -> Motion:
    if target.vary is None:
        return motion
    if streams is None:
        raise ConfigError(f"targets.{number}.vary draws random numbers: pass rng=doppelgait.rng(SEED)")
    try:
        return vary(motion, target.vary, streams.generator("motion", f"targets.{number}.vary"))
    except MotionError as error:
        raise MotionError(f"targets.{number}: {error}") from None


def _choose_range_m(motion: Motion, observation_s: float) -> float:
    # it is 5 m, or more where the closest approach would be below 2 m
    return max(5.0, travel_speed_mps(motion) * observation_s / 2.0 + 2.0)


def state_ranges(scene: Scene) -> Scene:
    """Return a scene that states where :func:`place` puts its targets."""
    # variations of the motion are left out: they need random numbers. The scene is unchanged if it
    # cannot be placed.
    if all(target.range_m is not None or target.start_position_m is not None for target in scene.targets):
        return scene
    plain = tuple(target.model_copy(update={"vary": None}) for target in scene.targets)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DoppelgaitWarning)
            placed = place(scene.model_copy(update={"targets": plain}))
    except DoppelgaitError:
        return scene
    stated = []
    for target, found in zip(scene.targets, placed.targets, strict=True):
        if target.range_m is None and target.start_position_m is None:
            target = target.model_copy(update={"range_m": _choose_range_m(found.motion, placed.observation_s)})
        stated.append(target)
    return scene.model_copy(update={"targets": tuple(stated)})


# a notebook shows the targets where they are placed; here, because placement is built on the scene
Scene._repr_html_ = lambda scene: show_html(  # type: ignore[attr-defined]
    "Scene", scene.tabulate_facts(), "scene", state_ranges(scene)
)


def build_motion(
    table: Mapping[str, Any], *, duration_s: float, folder: Path | None = None, rng: np.random.Generator | None = None
) -> Motion:
    """Make a motion from a ``{ kind = ... }`` table."""
    # the table is a model with duration_s, or a file that is read, cleaned, combined to a hybrid
    # and looped
    options = {key: value for key, value in table.items() if key != "kind"}
    if table["kind"] != "file":
        from doppelgait.motion.models.registry import generate

        return generate(_check_model(table), duration_s=duration_s, rng=rng)
    from doppelgait.motion.hybrid import Hybrid, make_hybrid
    from doppelgait.motion.loop import loop
    from doppelgait.motion.readers import check_types

    wanted = None if "hybrid" not in options else validate(Hybrid, options.pop("hybrid"), where="hybrid")
    made_later = {} if options.get("clean") is False else {"loop_to_s": None, "loop_variation": 1.0}
    loop_options = {name: options.pop(name, default) for name, default in made_later.items()}
    check_types(Path(str(options.get("path", ""))), loop_options)
    motion = _read_clip(options, folder)
    if wanted is not None:
        motion = make_hybrid(motion, wanted, lambda table: build_motion(table, duration_s=duration_s, folder=folder))
    if loop_options.get("loop_to_s") is None:
        return motion
    return loop(motion, duration_s=loop_options["loop_to_s"], variation=loop_options["loop_variation"], rng=rng)


def _check_model(table: Mapping[str, Any]) -> FrozenModel:
    """Return the checked parameters of a model's table."""
    from doppelgait.motion.models.registry import check_table

    return check_table(table, where=f"kind {table['kind']!r}").parameters


def _read_clip(options: dict[str, Any], folder: Path | None) -> Motion:
    """Read and clean the clip of a motion file."""
    from doppelgait.motion.readers import read

    path = options.pop("path", None)
    if not isinstance(path, str) or not path:
        raise ConfigError('kind "file" needs path = "..."')
    file = (folder or Path()) / path
    try:
        stamp = file.stat().st_mtime_ns, file.stat().st_size
    except OSError:
        return read(file, **options)  # its error describes the fault of the file
    try:
        return _read_once(file, stamp, json.dumps(options, sort_keys=True))
    except TypeError as error:
        raise MotionError(f"{path}: {error}") from None


def _read_once(file: Path, stamp: tuple[int, int], options: str) -> Motion:
    """Read a motion file, cached while it is unchanged."""
    # the examples of a dataset use the same segments of the same files repeatedly
    from doppelgait.motion.readers import read

    key = (file, stamp, options)
    with _reading:
        if key not in _read_before:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", DoppelgaitWarning)
                motion = read(file, **parse_json(options))
            motion.position_m.setflags(write=False)  # all scenes share it
            texts = [str(w.message) for w in caught if issubclass(w.category, DoppelgaitWarning)]
            _read_before[key] = motion, texts
            for other in (w for w in caught if not issubclass(w.category, DoppelgaitWarning)):
                warnings.warn_explicit(other.message, other.category, other.filename, other.lineno)
            while len(_read_before) > 1 and sum(one.position_m.nbytes for one, _ in _read_before.values()) > KEPT_BYTES:
                _read_before.popitem(last=False)
        _read_before.move_to_end(key)
        motion, texts = _read_before[key]
    for text in texts:
        warn_caller(text)
    return motion


def side_by_side(first: Target, second: Target, *, side_m: float = 0.7, ahead_m: float = 0.0) -> list[Target]:
    """Make two targets that keep together.

    The second target follows a path parallel to the first target's path, at the first target's
    speed. Where the path curves, the outer target moves faster
    (:func:`doppelgait.motion.follow.follow`), so that both stay abreast. Each target stops in its
    own stride, at most half a stride from the abreast position.

    Parameters
    ----------
    first : Target
        Target with ``start_position_m`` and ``heading_deg``. Without a path it moves straight.
    second : Target
        Its own position and path are ignored. Its own speed must be within 30 % of the speed along the path.
    side_m : float
        Lateral distance of the second target to the left of the first, negative to the right.
    ahead_m : float
        Distance of the second target ahead of the first along the path, negative behind.

    Returns
    -------
    list of Target
        The first target and the second target, each on its path.

    Raises
    ------
    ConfigError
        If the first target has no start, the second target's motion cannot reach the speed, or the
        path turns on the spot.
    MotionError
        If a motion does not travel straight and steadily, or cannot stop where the path does.

    See Also
    --------
    leashed_dog : a person with a dog on a leash.

    Examples
    --------
    >>> import doppelgait as dg
    >>> first, second = (
    ...     dg.Target(
    ...         {"kind": "boulic", "speed_mps": 1.2},
    ...         label="human",
    ...         start_position_m=(4.0, 0.0),
    ...         heading_deg=180.0,
    ...     )
    ...     for _ in range(2)
    ... )
    >>> pair = dg.scene.side_by_side(first, second)
    >>> pair[1].path.side_m  # distance between their paths
    0.7
    """
    if first.start_position_m is None:
        raise ConfigError("companions: the first target needs start_position_m and heading_deg")
    path = first.path or StraightPath()
    if isinstance(path, TurnAroundPath) and path.radius_m is None:
        raise ConfigError("companions: two targets side by side cannot turn on the spot; set radius_m of the path")
    companion_path = {
        **path.model_dump(exclude_none=True),
        "speed_mps": path.speed_mps or steady_speed_mps(make_scaled_motion(first.replace(path=None))),
        "side_m": path.side_m + side_m,
        "ahead_m": path.ahead_m + ahead_m,
    }
    companion = second.replace(
        range_m=None,
        bearing_deg=0.0,
        aspect_deg=0.0,
        start_position_m=first.start_position_m,
        heading_deg=first.heading_deg,
        path=companion_path,
    )
    make_scaled_motion(companion)  # refuses a motion that cannot follow the path
    return [first.replace(path=path), companion]


def leashed_dog(
    person: Target, dog_motion: Motion, *, side_m: float = -0.5, ahead_m: float = 0.5, label: str = "dog"
) -> list[Target]:
    """Make a person and a dog on a leash.

    The dog moves at the person's speed and keeps its position relative to the person; see :func:`side_by_side`.

    Parameters
    ----------
    person : Target
        Target with ``start_position_m`` and ``heading_deg``.
    dog_motion : Motion
        Straight, steady motion with a speed within 30 % of the person's; set ``speed_mps`` of a model accordingly.
    side_m, ahead_m : float
        Position of the dog: by default to the right of the person and ahead. The leash does not scatter.
    label : str
        Label of the dog's target.

    See Also
    --------
    side_by_side : two people next to each other.

    Examples
    --------
    >>> import doppelgait as dg
    >>> person = dg.Target(
    ...     {"kind": "boulic", "speed_mps": 1.2}, label="human", start_position_m=(4.0, 0.0), heading_deg=180.0
    ... )
    >>> dog = dg.motion.quadruped_gait(speed_mps=1.2, duration_s=3.0)
    >>> [target.label for target in dg.scene.leashed_dog(person, dog)]
    ['human', 'dog']
    """
    return side_by_side(person, Target(dog_motion, label=label), side_m=side_m, ahead_m=ahead_m)
