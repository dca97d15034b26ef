"""``doppelgait simulate``: one scene -> one recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doppelgait.cli.destination import START_TIME, XethruNames, check_destination, write_to
from doppelgait.cli.output import print_json, say

if TYPE_CHECKING:
    from doppelgait.radar import Recording

HEIGHT_FIELDS = ("height_m", "withers_m")
OUTPUT_HELP = "Recording to write: .h5, .npz, .sigmf-meta, or a folder for a XeThru recording."
SET_HELP = "Change the scene, for example radar.prf_hz=900; repeatable. Paths are relative to the scene file."


def simulate(
    scene: Annotated[Path | None, typer.Argument(help="Scene file (TOML). Or use --motion.")] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help=OUTPUT_HELP)] = Path("recording.h5"),
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Seed of all random numbers.")] = None,
    changes: Annotated[list[str] | None, typer.Option("--set", help=SET_HELP)] = None,
    motion: Annotated[
        str | None, typer.Option("--motion", help="Motion file, or model: boulic, quadruped, ...")
    ] = None,
    label: Annotated[str | None, typer.Option("--label", help="Class of the first target.")] = None,
    radar: Annotated[
        str | None, typer.Option("--radar", help="Radar preset, instead of the scene's radar; x4 by default.")
    ] = None,
    speed: Annotated[float | None, typer.Option("--speed", help="Speed of a model, m/s.")] = None,
    height: Annotated[float | None, typer.Option("--height", help="Stature or withers height, m.")] = None,
    aspect: Annotated[float | None, typer.Option("--aspect", help="Aspect angle, degrees; 0 approaching.")] = None,
    range_m: Annotated[float | None, typer.Option("--range", help="Ground range at mid-observation, m.")] = None,
    duration: Annotated[float | None, typer.Option("--duration", help="Observation time, s.")] = None,
    snr_db: Annotated[float | None, typer.Option("--snr-db", help="SNR_frame, dB; inf for no noise.")] = None,
    data_type: Annotated[
        str | None,
        typer.Option("--data-type", help="XeThru record: baseband_iq (default), datafloat, radar_rf_normalized, ..."),
    ] = None,
    start_time: Annotated[
        str | None, typer.Option("--start-time", help=f"Start of a XeThru recording; {START_TIME} by default.")
    ] = None,
    session_id: Annotated[
        str | None, typer.Option("--session-id", help="Session of a XeThru recording; doppelgait_SEED by default.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Simulate what a radar records of a scene.

    Example: doppelgait simulate walk.toml -o walk.h5 --set radar.prf_hz=900

    Example: doppelgait simulate --motion 07_01.c3d --label human --aspect 20 -o walk.h5

    Example: doppelgait simulate walk.toml -o recordings --data-type datafloat
    """
    from doppelgait.core.config import apply_overrides, read_toml
    from doppelgait.core.errors import ConfigError
    from doppelgait.pipeline import parse_run, run_simulation

    names = XethruNames(data_type, start_time, session_id)
    check_destination(output, names)
    if (scene is None) == (motion is None):
        raise ConfigError("give either a scene file or --motion FILE_OR_MODEL")
    table, text = read_toml(scene) if scene is not None else (motion_table(str(motion)), "")
    put_options(table, radar=radar, duration=duration, snr_db=snr_db, seed=seed)
    put_target_options(table, label=label, speed=speed, height=height, aspect=aspect, range_m=range_m)
    folder = scene.resolve().parent if scene is not None else None
    where = str(scene or "--motion")
    spec = parse_run(apply_overrides(table, changes or []), where=where, text=text, folder=folder)
    recording = run_simulation(spec, folder=folder)
    _tell(recording, write_to(recording, output, names), as_json)


def _tell(recording: Recording, output: Path, as_json: bool) -> None:
    facts = {
        "file": str(output),
        "n_pulses": recording.n_pulses,
        "n_range_bins": recording.n_range_bins,
        "prf_hz": recording.radar.prf_hz,
        "seed": recording.seed,
        "targets": [truth.label for truth in recording.truth],
    }
    if as_json:
        print_json(facts)
    else:
        size = f"{facts['n_pulses']} frames of {facts['n_range_bins']} range bins"
        say(f"{output}: {size} at {recording.radar.prf_hz:g} Hz")


def motion_table(motion: str) -> dict[str, Any]:
    """Scene table of one target from a motion file or the name of a model."""
    from doppelgait.core.errors import ConfigError
    from doppelgait.motion.models import MOTION_MODELS

    if motion in MOTION_MODELS:
        moves = {"kind": motion}
    else:
        if not Path(motion).exists():
            raise ConfigError(f"--motion {motion}: neither a file nor a model; models are {', '.join(MOTION_MODELS)}")
        moves = {"kind": "file", "path": motion}
    return {"radar": {"preset": "x4"}, "targets": [{"motion": moves}]}


def put_options(
    table: dict[str, Any], *, radar: str | None, duration: float | None, snr_db: float | None, seed: int | None
) -> None:
    """Put command-line options into a scene table; a radar preset replaces the scene's whole radar."""
    if radar is not None:
        table["radar"] = {"preset": radar}
    if duration is not None:
        table["duration_s"] = duration
    if seed is not None:
        table["seed"] = seed
    if snr_db is not None:
        table["noise"] = {"kind": "none"} if snr_db == float("inf") else {"kind": "snr", "snr_db": snr_db}


def put_target_options(
    table: dict[str, Any], *, label: str | None, speed: float | None, height: float | None, aspect: float | None,
    range_m: float | None,
) -> None:  # fmt: skip
    """Put command-line options into the first target of a scene table.

    Raises
    ------
    ConfigError
        If there is no target, or a speed is given for a recording.
    """
    from doppelgait.core.errors import ConfigError

    if all(option is None for option in (label, speed, height, aspect, range_m)):
        return
    targets = table.get("targets")
    if not isinstance(targets, list) or not targets or not isinstance(targets[0], dict):
        raise ConfigError("targets: a scene needs at least one [[targets]] entry")
    first = targets[0]
    if label is not None:
        first["label"] = label
    if speed is not None:
        _put_speed(first, speed)
    if height is not None:
        _put_height(first, height)
    if aspect is not None:
        first["aspect_deg"] = aspect
    if range_m is not None:
        first["range_m"] = range_m


def _put_speed(target: dict[str, Any], speed: float) -> None:
    """A model takes its speed as a parameter; a recording has its own."""
    from doppelgait.core.errors import ConfigError

    motion = target.get("motion")
    if not isinstance(motion, dict) or motion.get("kind") == "file":
        name = motion.get("path", "file") if isinstance(motion, dict) else "no model"
        raise ConfigError(f"--speed {speed}: a recording ({name}) has its own speed; --speed is for models")
    motion["speed_mps"] = speed


def _put_height(target: dict[str, Any], height: float) -> None:
    """A model takes its height as a parameter; a recording is scaled."""
    from doppelgait.motion.models import MOTION_MODELS

    motion = target.get("motion", {})
    kind = motion.get("kind", "file") if isinstance(motion, dict) else "file"
    fields = MOTION_MODELS[kind].config.model_fields if kind in MOTION_MODELS else {}
    own = next((name for name in HEIGHT_FIELDS if name in fields), None)
    if own is None:
        target["height_m"] = height
    else:
        motion[own] = height
