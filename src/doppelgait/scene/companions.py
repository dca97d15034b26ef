"""Targets that move together: two people, or dog walkers."""

from __future__ import annotations

from doppelgait.core.errors import ConfigError
from doppelgait.motion.follow import steady_speed_mps
from doppelgait.motion.motion import Motion
from doppelgait.motion.paths import StraightPath, TurnAroundPath
from doppelgait.scene.placement import make_scaled_motion
from doppelgait.scene.scene import Target


def side_by_side(first: Target, second: Target, *, side_m: float = 0.7, ahead_m: float = 0.0) -> list[Target]:
    """Make two targets that keep together.

    The second target follows a path parallel to the first target's path, at the first target's speed. Where the path
    curves, the outer target moves faster (:func:`doppelgait.motion.follow.follow`), so that both stay abreast. Each
    target stops in its own stride, at most half a stride from the abreast position.

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
