"""The viewer from a notebook or script."""

from __future__ import annotations

from pathlib import Path

from doppelgait.core.config import check_type
from doppelgait.pipeline import Tracking
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.gate import GateChoice
from doppelgait.radar.recording import Recording
from doppelgait.viewer.server import View, check_installed


def view(
    source: Recording | str | Path,
    *,
    gate: GateChoice | str | None = None,
    analysis: Analysis | None = None,
    tracking: Tracking | None = None,
    port: int = 0,
) -> View:
    """Show a recording, result file or dataset in the viewer.

    Only this computer can reach the page. In a notebook, make it the last expression of a cell to show the page; in a
    script, open ``.url`` in a browser. The page is served until ``.stop()`` or the end of Python.

    Parameters
    ----------
    source : Recording, str or Path
        A recording in memory, or the path of a recording, a result or the folder of a dataset.
    gate : {"track", "truth"}, (float, float) or text such as ``"1.2:2.8"``, optional
        Source of the gate; ``"track"`` by default, or all ranges if the recording cannot be tracked.
    analysis : Analysis, optional
    tracking : Tracking, optional
    port : int
        Port of the server; 0 for any free port.

    Returns
    -------
    View
        Object with ``url`` and ``stop()``; it is also a context manager.

    Raises
    ------
    DoppelgaitError
        If the viewer's packages are not installed: ``pip install 'doppelgait[viewer]'``.
    RecordingError
        If a file cannot be read.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=2.0)
    >>> recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=640.0))
    >>> with dg.view(recording) as page:
    ...     page.url.startswith("http://127.0.0.1:")
    True
    """
    check_installed()
    from doppelgait.viewer.settings import Settings
    from doppelgait.viewer.source import open_path, open_recording

    check_type(source, (Recording, str, Path), "source", "give a recording, or the path of a recording or dataset")
    choice = "track" if gate is None else Gate.parse(gate, where="gate")
    settings = Settings(
        gate=choice, gate_asked=gate is not None, analysis=analysis or Analysis(), tracking=tracking or Tracking()
    )
    if isinstance(source, Recording):
        opened = open_recording(source, Path(source.source).name or "recording", settings)
    else:
        opened = open_path(source, settings)
    return View(opened, settings, port)
