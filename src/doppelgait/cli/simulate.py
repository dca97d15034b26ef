"""``doppelgait simulate`` and ``demo``: scene, motion or model to recording.

Command-line options are merged into the table of the scene, which is then read like any scene file.
The ending of ``-o`` sets the format of the recording: the HDF5 format of doppelgait, NumPy arrays,
SigMF, or a folder for a XeThru recording.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doppelgait.cli.output import (
    AsJson,
    FigureFormat,
    FigureOption,
    check_output,
    make_folder,
    print_json,
    print_message,
)
from doppelgait.core.errors import ConfigError, list_choices

if TYPE_CHECKING:
    from doppelgait.radar import Recording

START_TIME = "2000-01-01T00:00:00"
"""Default start time of a XeThru recording. It is fixed, because the current time would make equal runs differ."""


def check_destination(path: Path, names: Mapping[str, str]) -> None:
    """Refuse a destination that cannot be written."""
    from doppelgait.radar.readers import list_writers
    from doppelgait.radar.xethru.convert import CONVERTIBLE

    suffix = path.suffix.lower()
    known = list_writers()
    if suffix not in known:
        endings = ", ".join(sorted(filter(None, known)))
        raise ConfigError(f"-o {path}: must end in {endings}, or be a folder for a XeThru recording")
    if suffix and names:
        option = next(iter(names)).replace("_", "-")
        raise ConfigError(f"--{option} is for XeThru recordings: name a folder instead of -o {path}")
    check_output(path, suffix)
    if not suffix:
        _parse_start(names)
        # the scale of counter values can be set from Python only
        allowed = [name for name in CONVERTIBLE if name != "radar_rf"]
        if names.get("data_type", allowed[0]) not in allowed:
            raise ConfigError(f"--data-type {names['data_type']}: is not allowed; writable are {', '.join(allowed)}")


def write_to(recording: Recording, path: Path, names: Mapping[str, str]) -> Path:
    """Write a recording in the format of its destination."""
    from doppelgait.radar.readers import list_writers

    writer = list_writers()[path.suffix.lower()]
    if writer.name != "xethru":
        writer.run(recording, path)
        return path
    options = {"data_type": "baseband_iq", "session_id": f"doppelgait_{recording.seed or 0}", **names}
    made: Path = writer.run(recording, path, **{**options, "start_time": _parse_start(names)})
    return made


def _parse_start(names: Mapping[str, str]) -> datetime:
    text = names.get("start_time", START_TIME)
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise ConfigError(
            f"--start-time {text}: must be a time such as {START_TIME}; without an offset it is UTC"
        ) from None
    return moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)


HEIGHT_FIELDS = ("height_m", "withers_m")
OUTPUT_HELP = "Recording to write: .h5, .npz, .sigmf-meta, or a folder for a XeThru recording."
SET_HELP = "Change the scene, for example radar.prf_hz=900; repeatable. Paths are relative to the scene file."


def simulate(
    scene: Annotated[Path | None, typer.Argument(help="Scene file (TOML); omit it with --motion.")] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help=OUTPUT_HELP)] = Path("recording.h5"),
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Seed of all random numbers.")] = None,
    changes: Annotated[list[str] | None, typer.Option("--set", help=SET_HELP)] = None,
    motion: Annotated[str | None, typer.Option("--motion", help="Motion file, or model: human, quadruped, ...")] = None,
    label: Annotated[str | None, typer.Option("--label", help="Class of the first target.")] = None,
    radar: Annotated[str | None, typer.Option(help="Preset or .toml file; x4 by default.")] = None,
    speed: Annotated[float | None, typer.Option("--speed", help="Speed of a model, m/s.")] = None,
    height: Annotated[float | None, typer.Option("--height", help="Stature or withers height, m.")] = None,
    aspect: Annotated[float | None, typer.Option("--aspect", help="Aspect angle, degrees; 0 approaching.")] = None,
    range_m: Annotated[float | None, typer.Option("--range", help="Ground range at mid-observation, m.")] = None,
    duration: Annotated[float | None, typer.Option("--duration", help="Observation time, s.")] = None,
    snr_db: Annotated[float | None, typer.Option("--snr-db", help="SNR_frame, dB; inf for no noise.")] = None,
    data_type: Annotated[str | None, typer.Option(help="XeThru record, such as datafloat.")] = None,
    start_time: Annotated[str | None, typer.Option(help="Start of a XeThru recording.")] = None,
    session_id: Annotated[str | None, typer.Option(help="Session of a XeThru recording.")] = None,
    as_json: AsJson = False,
) -> None:
    """Simulate the radar recording of a scene.

    Example: doppelgait simulate walk.toml -o walk.h5 --set radar.prf_hz=900

    Example: doppelgait simulate --motion 07_01.c3d --label human --aspect 20 -o walk.h5

    Example: doppelgait simulate walk.toml -o recordings --data-type datafloat
    """
    from doppelgait.core.config import apply_overrides, read_toml
    from doppelgait.pipeline import parse_radar, parse_run, run_simulation

    named = {"data_type": data_type, "start_time": start_time, "session_id": session_id}
    names = {name: value for name, value in named.items() if value is not None}
    check_destination(output, names)
    if (scene is None) == (motion is None):
        raise ConfigError("use either a scene file or --motion FILE_OR_MODEL")
    table, text = read_toml(scene) if scene is not None else (make_motion_table(str(motion)), "")
    if radar is not None:  # a preset replaces the whole radar; its errors name the option, not the scene file
        parse_radar(radar, where="--radar")
        table["radar"] = {"preset": str(Path(radar).resolve()) if radar.lower().endswith(".toml") else radar}
    if snr_db is not None:
        table["noise"] = {"kind": "none"} if snr_db == float("inf") else {"kind": "snr", "snr_db": snr_db}
    table |= {name: value for name, value in (("duration_s", duration), ("seed", seed)) if value is not None}
    target = {"label": label, "aspect_deg": aspect, "range_m": range_m}
    put_target_options(table, {key: value for key, value in target.items() if value is not None}, speed, height)
    folder = scene.resolve().parent if scene is not None else None
    where = str(scene or "--motion")
    spec = parse_run(apply_overrides(table, changes or []), where=where, text=text, folder=folder)
    in_file = output.suffix.lower() == ".h5"
    recording = run_simulation(spec, folder=folder, path=output if in_file else None)
    written = output if in_file else write_to(recording, output, names)
    facts = {
        "file": str(written),
        "n_pulses": recording.n_pulses,
        "n_range_bins": recording.n_range_bins,
        "prf_hz": recording.radar.prf_hz,
        "seed": recording.seed,
        "targets": [truth.label for truth in recording.truth],
    }
    size = f"{recording.n_pulses} frames of {recording.n_range_bins} range bins at {recording.radar.prf_hz:g} Hz"
    print_json(facts) if as_json else print_message(f"{written}: {size}")


def make_motion_table(motion: str) -> dict[str, Any]:
    """Return the target table of a motion file or model."""
    from doppelgait.motion.models import MOTION_MODELS

    if motion in MOTION_MODELS:
        moves = {"kind": motion}
    else:
        if not Path(motion).exists():
            known = list_choices(MOTION_MODELS, motion)
            raise ConfigError(f"--motion {motion}: neither a file nor a model (animals: quadruped); models are {known}")
        moves = {"kind": "file", "path": motion}
    return {"radar": {"preset": "x4"}, "targets": [{"motion": moves}]}


def put_target_options(
    table: dict[str, Any], facts: Mapping[str, Any], speed: float | None, height: float | None
) -> None:
    """Merge options into the first target of a scene."""
    if not facts and speed is None and height is None:
        return
    targets = table.get("targets")
    if not isinstance(targets, list) or not targets or not isinstance(targets[0], dict):
        raise ConfigError("targets: a scene needs at least one [[targets]] entry")
    first = targets[0]
    if speed is not None:
        # A model takes its speed as a parameter; a recording has its own.
        motion = first.get("motion")
        if not isinstance(motion, dict) or motion.get("kind") == "file":
            name = motion.get("path", "file") if isinstance(motion, dict) else "no model"
            raise ConfigError(f"--speed {speed}: a recording ({name}) has its own speed; --speed is for models")
        motion["speed_mps"] = speed
    if height is not None:
        # A model takes its height as a parameter; a recording is scaled.
        from doppelgait.motion.models import MOTION_MODELS

        moved = first.get("motion", {})
        kind = moved.get("kind", "file") if isinstance(moved, dict) else "file"
        model = MOTION_MODELS[kind].parameters if kind in MOTION_MODELS else None
        fields = model.model_fields if model is not None else {}
        own = next((name for name in HEIGHT_FIELDS if name in fields), None)
        if own is None:
            first["height_m"] = height
        else:
            moved[own] = height
    first.update(facts)


def run_demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder for the recording, the results and the figures.")
    ] = Path("demo"),
    figure_format: FigureOption = FigureFormat.png,
    open_viewer: Annotated[bool, typer.Option("--open", help="Open it in the viewer.")] = False,
) -> None:
    """Simulate a person and a dog, analyse and plot both.

    Example: doppelgait demo -o demo --open
    """
    from doppelgait.cli.analyze import print_features
    from doppelgait.cli.figures import save_figures
    from doppelgait.data import sample
    from doppelgait.pipeline import analyze, write_results
    from doppelgait.processing import Analysis
    from doppelgait.radar import write_recording

    make_folder(output, "-o ")
    recording = sample()
    write_recording(recording, output / "recording.h5")
    results = analyze(recording, gate="truth")
    write_results(output / "result.h5", recording, results)
    for path in save_figures(recording, results, Analysis(), folder=output, form=figure_format):
        print_message(f"figure: {path}")
    print_features(results)
    recording_file = output / "recording.h5"
    print_message(f"recording and results: {recording_file}, {output / 'result.h5'}")
    print_message(
        "A person walks towards the radar, and a dog trots away from it. In the signatures the bright "
        "line is the torso, and the arcs around it are legs, two a stride of the person, and more and "
        "faster ones of the dog."
    )
    print_message(f"who is who: doppelgait classify {recording_file}")
    print_message(f"in the browser: doppelgait view {recording_file}")
    if open_viewer:
        from doppelgait.cli.view import view

        view(recording_file, gate="truth")
