"""Sound of a target as a WAV file."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import get_args

from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.processing.sound import Channels, doppler_sound, why_silent, write_wav
from doppelgait.viewer.query import Gate, number_of, whole_of
from doppelgait.viewer.run import Run
from doppelgait.viewer.settings import Clutter

MOST_PITCH = 1e6


def sound_wav(run: Run, gate: Gate | None, parameters: Mapping[str, str], clutter: Clutter | None = None) -> bytes:
    """WAV file of one target, as long as the recording.

    Parameters
    ----------
    run : Run
    gate : str, (float, float) or None
    parameters : mapping
        ``target`` (number, the first by default), ``pitch`` and ``channels`` as for
        :func:`doppelgait.processing.sound.doppler_sound`.
    clutter : {"kept", "removed"}, optional

    Raises
    ------
    ConfigError
        If a parameter is not allowed.
    DoppelgaitError
        If there is no recording, or no such target in it.
    """
    pitch = number_of("pitch", parameters["pitch"], least=0.0, most=MOST_PITCH) if "pitch" in parameters else None
    channels = parameters.get("channels", get_args(Channels)[0])
    if channels not in get_args(Channels):
        raise ConfigError(f"channels: {channels!r} is not allowed; it must be {' or '.join(get_args(Channels))}")
    baseband = run.needed_recording().baseband
    silent = why_silent(baseband)
    if silent is not None:  # said at once: no analysis changes it
        raise AnalysisError(silent)
    targets = run.targets(gate, clutter)
    number = whole_of(parameters, "target", 0, least=0, most=max(len(targets) - 1, 0))
    limits = targets[number].gate_limits if targets else None
    if limits is None:
        raise AnalysisError(f"{run.name}: there is no target with a gate to listen to")
    rate_hz, samples = doppler_sound(baseband, limits, run.analysis(gate, clutter), pitch=pitch, channels=channels)
    file = io.BytesIO()
    write_wav(file, rate_hz, samples)
    return file.getvalue()
