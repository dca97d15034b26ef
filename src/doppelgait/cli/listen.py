"""``doppelgait listen``: recording to Doppler sound."""

from __future__ import annotations

import math
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doppelgait.cli.analyze import Changes, ReaderOptions, open_recording, parse_analysis, takes_windows
from doppelgait.cli.output import AsJson, check_output, print_json, print_message
from doppelgait.core.errors import AnalysisError

if TYPE_CHECKING:
    from doppelgait.pipeline import Tracking
    from doppelgait.processing import Analysis, Gate
    from doppelgait.radar import Recording

    LabelledGate = tuple[str | None, Gate]

DEEP_HZ = 250.0
"""Frequency, Hz, below which a sound is hardly audible."""


class StereoChannels(StrEnum):
    """Options for the contents of the two stereo channels."""

    iq = "iq"
    sides = "sides"


@takes_windows("window_s", "hop_s")
def listen(
    recording: Annotated[Path, typer.Argument(help="Recording: our .h5, XeThru, or any format of 'radar formats'.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Sound to write, .wav.")],
    target: Annotated[int, typer.Option("--target", min=0, help="Number of the target, from 0.")] = 0,
    pitch: Annotated[
        float | None,
        typer.Option(
            "--pitch",
            help="Factor on every Doppler frequency; the duration stays. By default 4, or the largest that fits.",
        ),
    ] = None,
    channels: Annotated[
        StereoChannels,
        typer.Option(
            "--channels", help="iq: I left, Q right; sides: approaching targets left, receding targets right."
        ),
    ] = StereoChannels.iq,
    changes: Changes = None,
    options: ReaderOptions = None,
    as_json: AsJson = False,
    **windows: Any,
) -> None:
    """Make the Doppler signal of one target audible.

    The stereo WAV file is as long as the recording. Static clutter is removed first for every gate,
    as in 'analyze --gate track'; --set clutter=none keeps it.

    Example: doppelgait listen walk.h5 -o walk.wav --gate truth --pitch 6 --channels sides
    """
    from doppelgait.core.files import open_atomically
    from doppelgait.processing.sound import make_doppler_sound, plan_sound, write_wav

    check_output(output, ".wav")
    analysis, tracking = parse_analysis({}, changes)
    settings = analysis.resolved("track")
    loaded = open_recording(recording, options)
    factor, _ = plan_sound(loaded.radar.prf_hz, pitch)
    prf_hz = loaded.radar.prf_hz
    highest_hz = factor * prf_hz / 2.0
    if highest_hz < DEEP_HZ:
        print_message(
            f"note: at {prf_hz:g} frames per second and pitch {factor:g} the highest frequency is "
            f"{highest_hz:.0f} Hz, too low for most ears and speakers; try --pitch {math.ceil(4.0 * DEEP_HZ / prf_hz)}"
        )
    found = _list_gates(loaded, windows["gate"], settings, tracking)
    if not found:
        raise AnalysisError(f"{recording}: no target found; set a range, for example --gate 1.2:2.8")
    if target >= len(found):
        allowed = "0" if len(found) == 1 else f"0 to {len(found) - 1}"
        raise AnalysisError(f"--target {target}: must be {allowed}; {recording} has no more targets")
    label, limits = found[target]
    rate_hz, samples = make_doppler_sound(
        loaded.frames.find_bursts(), limits, settings, pitch=pitch, channels=channels.value
    )
    with open_atomically(output) as partial:
        write_wav(str(partial), rate_hz, samples)
    facts = {
        "file": str(output),
        "rate_hz": rate_hz,
        "duration_s": samples.shape[0] / rate_hz,
        "pitch": factor,
        "channels": channels.value,
        "target": target,
        "label": label,
        "n_targets": len(found),
    }
    if as_json:
        print_json(facts)
    else:
        name = label or "target"
        print_message(f"{output}: {name} ({target} of {len(found)}), {facts['duration_s']:.1f} s, pitch {factor:g}")


def _list_gates(recording: Recording, gate: str, settings: Analysis, tracking: Tracking) -> list[LabelledGate]:
    from doppelgait.pipeline import analyze
    from doppelgait.processing import Gate

    choice, times_s = Gate.parse(gate, where="--gate"), recording.slow_time_s
    if isinstance(choice, tuple):
        return [(None, Gate.fixed(*choice, time_s=times_s, range_m=recording.range_m))]
    if choice == "truth" and recording.truth:
        gate_of = partial(Gate.from_truth, time_s=times_s, analysis=settings, wavelength_m=recording.radar.wavelength_m)
        return [(truth.label or None, gate_of(truth)) for truth in recording.truth]
    results = analyze(recording, gate=choice, analysis=settings, tracking=tracking)
    return [(result.label, result.gate) for result in results]
