"""Contract checks of motions, paths, cross sections and environment effects."""

from __future__ import annotations

import inspect
import json
import math
import os
import shutil
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from doppelgait.testing.contracts import require, require_close, require_registered

if TYPE_CHECKING:
    from doppelgait.core.config import FrozenModel


def check_motion_model(model: FrozenModel | str, *, duration_s: float = 2.0, seed: int = 0) -> None:
    """Check that a motion model keeps its contract.

    ``model`` is its parameters, or its kind for the default ones; the motion lasts ``duration_s``.
    An ``AssertionError`` names the broken rule: parameters with defaults that come back from JSON,
    frames over the whole time, finite positions under unique names, facts of its kind, the same
    motion for the same seed, alone and in a batch with longer motions.

    >>> import doppelgait as dg
    >>> dg.testing.check_motion_model("boulic")
    """
    from doppelgait.motion.models import MOTION_MODELS, generate, get_parameters
    from doppelgait.motion.models.registry import generate_all

    kind = model if isinstance(model, str) else str(getattr(model, "kind", ""))
    name = require_registered(MOTION_MODELS, "motion model", kind)
    parameters = MOTION_MODELS.parse(model)
    get_parameters(kind)()  # every parameter has a default
    plain = parameters.model_dump(mode="json")
    require(MOTION_MODELS.parse(plain) == parameters, f"{name}: its parameters are others after JSON")
    motions = [generate(one, duration_s=duration_s, rng=np.random.default_rng(seed)) for one in (parameters, plain)]
    _check_motion(name, motions[0])
    lasts_s, frame_s = motions[0].duration_s, 1.0 / motions[0].rate_hz
    require(-1e-9 <= lasts_s - duration_s < frame_s + 1e-9, f"{name}: lasts {lasts_s:g} s, not {duration_s:g} s")
    require(motions[0].time_s[0] == 0.0, f"{name}: starts at {motions[0].time_s[0]:g} s, must be 0")
    require(motions[0].facts.kind == kind, f"{name}: facts.kind is {motions[0].facts.kind!r}, must be {kind!r}")
    require(np.isfinite(motions[0].position_m).all(), f"{name}: positions are not finite")
    _check_same_motion(name, motions[0], motions[1])
    durations_s = [1.2 * duration_s, duration_s, 1.4 * duration_s]
    rngs = [np.random.default_rng(other) for other in (seed + 1, seed, seed + 2)]
    batch = generate_all([parameters] * 3, durations_s=durations_s, rngs=rngs)
    _check_same_motion(name, motions[0], batch[1], "in a batch")


def check_motion_reader(name: str, path: str | Path, **options: Any) -> None:
    """Check that a motion reader keeps its contract.

    ``path`` is a file of its format, of which it alone takes the content; ``options`` are those of
    the reader. An ``AssertionError`` names the broken rule: a sniffer that goes by content and
    takes nothing else, keyword-only options, the same motion each time, named markers, facts of
    the file, a ``MotionError`` for a damaged file or an unknown option.

    >>> import doppelgait as dg
    >>> import numpy as np
    >>> from pathlib import Path
    >>> Path("motions").mkdir()
    >>> walk, file = dg.motion.boulic_walk(duration_s=1.0), "motions/walk.npz"
    >>> np.savez(file, positions=walk.position_m, names=walk.markers, rate_hz=walk.rate_hz, units="m")
    >>> dg.testing.check_motion_reader("arrays", file)
    """
    from doppelgait.core.errors import DoppelgaitWarning, MotionError
    from doppelgait.core.plugins import HEAD_BYTES
    from doppelgait.motion.readers import MOTION_READERS, read

    path, what = Path(path), require_registered(MOTION_READERS, "motion reader", name)
    reader = MOTION_READERS[name]
    kinds = [parameter.kind for parameter in inspect.signature(reader.run).parameters.values()]
    keyword_only = kinds and all(kind is inspect.Parameter.KEYWORD_ONLY for kind in kinds[1:])
    require(keyword_only, f"{what}: must take one path and keyword-only options")
    content = path.read_bytes()
    sniff = reader.facts["sniff"]
    require(sniff(path, content[:HEAD_BYTES]), f"{what}: does not recognise {path}")
    with TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)
        for other in (b"no motion\n", bytes(range(256)) * 4):
            (Path(folder) / "other").write_bytes(other)
            taken = sniff(Path(folder) / "other", other)
            require(not taken, f"{what}: takes a file that begins with {other[:10]!r}")
        for one in path.parent.iterdir():  # small files of other formats: some readers need one next to theirs
            if one.suffix != path.suffix and one.is_file() and one.stat().st_size < 1e6:
                shutil.copy(one, folder)
        renamed = Path(folder) / f"{path.stem}.unknown"
        renamed.write_bytes(content)
        first, again, other_name = (read(file, clean=False, **options) for file in (path, path, renamed))
        _check_motion(what, first)
        facts = first.facts
        require(facts.source == path.name, f"{what}: facts.source is {facts.source!r}, must be the file's name")
        require(facts.kind == "recording", f"{what}: facts.kind is {facts.kind!r}, must be 'recording'")
        _check_same_motion(what, first, again)
        _check_same_motion(what, first, other_name.with_facts(source=facts.source))
        try:
            read(path, clean=False, no_such_option=1)
        except MotionError:
            pass
        else:
            raise AssertionError(f"{what}: takes the option no_such_option")
        for size in (len(content) // 2, min(len(content), 600)):
            renamed.write_bytes(content[:size])
            try:
                read(renamed, clean=False, **options)
            except MotionError as error:
                require(os.fspath(renamed) in str(error), f"{what}: the error does not name the file: {error}")
    require(path.read_bytes() == content, f"{what}: changed the file")


def check_path(path: FrozenModel) -> None:
    """Check that a kind of path keeps its contract.

    ``path`` is one that a walk of 1.2 m/s follows for 8 s or less. An ``AssertionError`` names the
    broken rule: a model derived from :class:`doppelgait.motion.paths.Path` that comes back from
    JSON, elements of positive length with at most the last one endless, stops in order, a walk on
    it.

    >>> import doppelgait as dg
    >>> dg.testing.check_path(dg.motion.make_path({"kind": "arc", "radius_m": 2.0, "turn_deg": 90.0}))
    """
    from doppelgait.motion import boulic_walk, follow
    from doppelgait.motion.paths import PATHS, Path, lay_out

    kind = str(getattr(path, "kind", ""))
    name = require_registered(PATHS, "path", kind)
    if not isinstance(path, Path):
        raise AssertionError(f"{name}: its model must be derived from doppelgait.motion.paths.Path")
    require(PATHS.parse(path.model_dump(mode="json")) == path, f"{name}: its parameters are others after JSON")
    layout = lay_out(path)
    lengths = [element.length_m for element in layout.elements]
    require(lengths and min(lengths) > 0, f"{name}: needs elements of positive length, has {lengths}")
    require(all(math.isfinite(length) for length in lengths[:-1]), f"{name}: only its last element may be endless")
    stops = [stop.at_m for stop in layout.stops]
    require(stops == sorted(stops), f"{name}: its stops are out of order: {stops}")
    walk = boulic_walk(speed_mps=1.2, duration_s=12.0, rate_hz=100.0)
    followed, moved = follow(walk, path), follow(walk, path, start_position_m=(2.0, -1.0), heading_deg=90.0)
    _check_motion(name, followed)
    require(followed.facts.path is not None and followed.facts.path.kind == kind, f"{name}: facts.path is not its own")
    turned = followed.position_m[..., [1, 0, 2]] * (-1.0, 1.0, 1.0) + (2.0, -1.0, 0.0)
    require_close(moved.position_m, turned, f"{name}: another start or heading changes its shape", rtol=1e-9)


def _check_motion(name: str, motion: Any) -> None:
    """Check type, names, times and facts that every motion has."""
    from doppelgait.motion import Motion

    text = f"{name}: returns a {type(motion).__name__}, must be a doppelgait.motion.Motion"
    require(isinstance(motion, Motion), text)
    require(motion.position_m.dtype == np.float64, f"{name}: positions are {motion.position_m.dtype}, must be float64")
    require(motion.n_frames >= 2, f"{name}: holds {motion.n_frames} frames")
    require(not np.isinf(motion.position_m).any(), f"{name}: a position is infinite")
    names = motion.markers
    require(all(names) and len(set(names)) == len(names), f"{name}: markers need unique names, has {names}")
    times = motion.time_s
    even = np.allclose(np.diff(times), 1.0 / motion.rate_hz, rtol=1e-6)
    require(even, f"{name}: frames are not 1 / rate_hz = {1.0 / motion.rate_hz:g} s apart")
    facts = motion.facts
    require(facts.source, f"{name}: facts.source is empty")
    for fact in ("height_m", "mass_kg", "stride_frequency_hz", "step_frequency_hz", "gait_frequency_hz"):
        value = getattr(facts, fact)
        require(math.isnan(value) or value > 0, f"{name}: facts.{fact} is {value}, must be positive or NaN")
    for foot, touchdowns in facts.footfalls.items():
        inside = all(times[0] - 1e-9 <= t <= times[-1] + 1e-9 for t in touchdowns)
        require(inside and list(touchdowns) == sorted(touchdowns), f"{name}: footfalls of {foot} are not in its time")
    try:
        json.dumps(dict(motion.report))
    except (TypeError, ValueError) as error:
        raise AssertionError(f"{name}: its report is not plain: {error}") from None


def _check_same_motion(name: str, one: Any, other: Any, when: str = "the second time") -> None:
    same = np.array_equal(one.position_m, other.position_m, equal_nan=True) and one.markers == other.markers
    require(same and repr(one.facts) == repr(other.facts), f"{name}: gives another motion {when}")


def check_rcs(parameters: Any) -> None:
    """Check the contract of a radar cross section, :class:`doppelgait.scene.rcs.RcsKind`.

    ``parameters``, for example ``{"kind": "bright_head", "share": 0.9}``, are tried on a walking
    person. An ``AssertionError`` names the broken rule: registration, round trip through TOML,
    shapes, values, the same numbers again, no change to the motion, a total that scales.

    >>> import doppelgait as dg
    >>> dg.testing.check_rcs("surfaces")
    """
    from doppelgait.motion import boulic_walk
    from doppelgait.scene import Scene, Target
    from doppelgait.scene.placement import place
    from doppelgait.scene.rcs import RCS, View

    target = Target({"kind": "boulic"}, rcs=parameters)
    spec, name = target.rcs, f"rcs {target.rcs.kind!r}"
    scene = Scene([target], duration_s=1.0)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        path.write_text(scene.to_toml(), encoding="utf-8")
        require(Scene.from_toml(path) == scene, f"{name}: the parameters are others after TOML")

    motion = place(Scene([Target(boulic_walk(speed_mps=1.2, duration_s=1.0), range_m=4.0)])).targets[0].motion
    before, times_s = motion.position_m.copy(), np.arange(40) / 50.0

    def scatter(own: Any) -> tuple[Any, npt.NDArray[np.float64]]:
        view = View(motion, times_s, np.array([0.0, 0.0, 1.0]), wavelength_m=0.0411, rng=np.random.default_rng(0))
        points, rcs_m2, *phases = RCS.of(own).run(view, own)
        require(all(p.shape == (40, len(points.markers)) for p in phases), f"{name}: phases are not (times, points)")
        return points, rcs_m2

    points, rcs_m2 = scatter(spec)
    require(np.array_equal(motion.position_m, before), f"{name}: changes the motion")
    shapes = ((len(points.markers),), (times_s.size, len(points.markers)))
    require(rcs_m2.shape in shapes, f"{name}: cross sections of shape {rcs_m2.shape}, not {shapes[0]} or {shapes[1]}")
    require(rcs_m2.min() >= 0 < rcs_m2.max() < np.inf, f"{name}: not finite and 0 or larger, or nothing scatters")
    again, same_m2 = scatter(spec)
    same = np.array_equal(same_m2, rcs_m2) and np.array_equal(again.position_m, points.position_m)
    require(same, f"{name}: the same motion gives other cross sections or points")
    one, four = (scatter(spec.model_copy(update={"total_m2": total_m2}))[1] for total_m2 in (1.0, 4.0))
    require_close(four, 4.0 * one, f"{name}: four times total_m2 is not four times the cross sections")


def check_environment(parameters: Any) -> None:
    """Check the contract of an environment effect, :class:`doppelgait.scene.environment.Apply`.

    The effect acts on a person who walks to the radar at the origin. An ``AssertionError`` names
    the broken rule: registration, round trip through JSON, no change to the table, originals
    first, added rows of no target, the same numbers again, finite values, an empty table.

    >>> import doppelgait as dg
    >>> dg.testing.check_environment({"kind": "wall", "loss_db": 3.0})
    """
    from doppelgait.core.labels import maps_table, takes_arrays
    from doppelgait.motion import boulic_walk
    from doppelgait.scene import Scene, Target, assemble
    from doppelgait.scene.environment import ENVIRONMENT, Setting

    spec: Any = ENVIRONMENT.parse(parameters)
    effect, name = ENVIRONMENT.of(spec), f"environment effect {spec.kind!r}"
    require(ENVIRONMENT.parse(spec.model_dump(mode="json")) == spec, f"{name}: the parameters are others after JSON")
    setting = Setting(wavelength_m=0.04, radar_position_m=(0.0, 0.0, 1.0))
    times_s = np.arange(20) / 50.0
    scene = Scene([Target(boulic_walk(speed_mps=1.2, duration_s=1.0), range_m=5.0)])
    table = assemble(scene, times_s)
    before = table.copy(deep=True)
    run: Any = effect.run
    run = maps_table(run) if takes_arrays(run) else run
    after = run(table, spec, setting)
    require(table.identical(before), f"{name}: changes the table of its input")
    require(after.identical(run(table, spec, setting)), f"{name}: the same table gives another one")
    n_before, n_after = table.sizes["scatterer"], after.sizes["scatterer"]
    require(n_after >= n_before, f"{name}: drops scatterers")
    require(after.sizes["slow_time"] == times_s.size, f"{name}: changes the number of pulses")
    for column in ("marker", "part", "target"):
        kept = np.array_equal(after[column].values[:n_before], table[column].values)
        require(kept, f"{name}: the scatterers before are not the first rows, in their order ({column})")
    require((after["target"].values[n_before:] < 0).all(), f"{name}: added rows belong to a target")
    for column in ("range", "radial_velocity", "rcs", "path_gain"):
        require(np.isfinite(after[column].values).all(), f"{name}: {column} is not finite")
    for column in ("rcs", "path_gain"):
        require((after[column].values >= 0).all(), f"{name}: {column} is negative")
    nothing = assemble(Scene([], duration_s=1.0), times_s)
    require(run(nothing, spec, setting).sizes["scatterer"] == 0, f"{name}: an empty room gets scatterers")
