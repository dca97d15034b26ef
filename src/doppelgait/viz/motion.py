"""Figures of moving bodies: side views, range, Doppler."""

from __future__ import annotations

from typing import Any, Unpack

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import MOTION, read_axis
from doppelgait.core.units import FloatArray, velocity_to_doppler_hz
from doppelgait.viz import style
from doppelgait.viz.maps import Shown, check_array, check_wavelength, finish_axes

PART_COLOURS = {
    "torso": style.ACCENT,
    "head": style.PURPLE,
    "neck": style.PURPLE,
    "left arm": style.ORANGE,
    "right arm": style.SKY,
    "left foreleg": style.ORANGE,
    "right foreleg": style.SKY,
    "left leg": style.GREEN,
    "right leg": style.BLUE,
    "left hind leg": style.GREEN,
    "right hind leg": style.BLUE,
    "tail": "#8c564b",
    "other": "#b0b0b0",
}
"""Colour of each group of body parts in all figures; left is warm or green, right is blue."""

FEET = ("foot", "paw")
LIMB_ORDER = ("thigh", "upper_arm", "upper", "shank", "forearm", "lower", "foot", "hand", "paw")
"""Name suffixes of the parts of a limb, from the body outwards."""
LIMB_PARTS = frozenset(
    f"{side}_{rest}"
    for side in ("left", "right")
    for rest in (
        *("upper_arm", "forearm", "hand", "thigh", "shank", "foot"),
        *(f"{limb}_{end}" for limb in ("fore", "hind") for end in ("upper", "lower", "paw")),
    )
)
TORSO = ("torso", "trunk")
THIN, BOLD = 0.7, 2.2


def find_part_group(part: str) -> str:
    """Return the group of a body part of :mod:`doppelgait.motion.skeleton`."""
    if part in TORSO:
        return "torso"
    side, _, rest = part.partition("_")
    if side in ("left", "right"):
        limb = rest.partition("_")[0]
        name = {"upper": "arm", "forearm": "arm", "hand": "arm", "fore": "foreleg", "hind": "hind leg"}.get(limb, "leg")
        return f"{side} {name}"
    return part if part in PART_COLOURS else "other"


def format_bold_name(part: str) -> str | None:
    """Return the legend entry of a part with a bold line."""
    if part in TORSO:
        return "torso"
    return part.replace("_", " ") if part.endswith(FEET) else None


def plot_part_lines(axes: Axes, array: xr.DataArray, *, width: float = THIN, bold: float = BOLD) -> None:
    """Plot lines (slow_time, scatterer) in the colours of their parts."""
    name = array.name or "scatterers"
    if array.dims != ("slow_time", "scatterer") or "slow_time" not in array.coords:
        raise AnalysisError(
            f"{name}: dimensions are {array.dims}, must be ('slow_time', 'scatterer') with slow_time in s"
        )
    if "part" not in array.coords:
        raise AnalysisError(f"{name}: coordinate 'part' (body part of every scatterer) is missing")
    if array.size == 0:
        raise AnalysisError(f"{name}: nothing to plot, its shape is {array.shape}")
    time_s, values = read_axis(array, "slow_time"), np.asarray(array.values, dtype=np.float64)
    parts = [str(part) for part in array.coords["part"].values]
    target = array.coords["target"].values if "target" in array.coords else np.zeros(len(parts))
    numbers = np.unique(target, return_inverse=True)[1]
    dashes = [style.TARGET_STYLES[number % len(style.TARGET_STYLES)] for number in numbers]
    for number in dict.fromkeys(numbers.tolist() if bold else ()):
        names = [format_bold_name(part) if numbers[n] == number else None for n, part in enumerate(parts)]
        for name in dict.fromkeys(name for name in names if name):
            chosen = [n for n, other in enumerate(names) if other == name]
            known = np.isfinite(values[:, chosen])
            total = np.where(known, values[:, chosen], 0.0).sum(axis=1)
            mean = np.full(total.shape, np.nan)
            np.divide(total, known.sum(axis=1), out=mean, where=known.any(axis=1))
            colour, label = PART_COLOURS[find_part_group(parts[chosen[0]])], None if number else f"{name} (mean)"
            axes.plot(time_s, mean, color=colour, lw=bold, ls=dashes[chosen[0]], label=label, zorder=3)
    groups = [find_part_group(part) for part in parts]
    for column, group in enumerate(groups):
        look: Any = {"color": PART_COLOURS[group], "lw": width, "ls": dashes[column], "alpha": 0.8}
        label = group if groups.index(group) == column else None
        axes.plot(time_s, values[:, column], label=label, **look)


SMALL, LARGE = 18.0, 48.0


def _get_variable(scatterers: xr.Dataset, name: str) -> xr.DataArray:
    if not isinstance(scatterers, xr.Dataset) or name not in scatterers:
        raise AnalysisError(f"scatterers must be a Dataset (slow_time, scatterer) with the variable {name!r}")
    return scatterers[name]


def scatterer_doppler(scatterers: xr.Dataset, *, wavelength_m: float) -> xr.DataArray:
    """Compute every scatterer's true Doppler shift (E-05).

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
        With ``radial_velocity`` in m/s, positive when approaching.
    wavelength_m : float

    Returns
    -------
    DataArray (slow_time, scatterer)
        2 v_r / lambda, Hz.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic"}, label="human")], duration_s=3.0)
    >>> table = dg.scene.assemble(scene, [0.0, 0.1, 0.2])
    >>> doppler_hz = dg.viz.scatterer_doppler(table, wavelength_m=0.04)
    >>> round(float(doppler_hz.mean()))  # 2 v / wavelength of the body, Hz
    46
    """
    velocity = _get_variable(scatterers, "radial_velocity")
    check_wavelength(wavelength_m)
    doppler_hz = velocity.copy(data=velocity_to_doppler_hz(velocity.values, wavelength_m)).rename("doppler")
    doppler_hz.attrs["units"] = "Hz"
    return doppler_hz


def range_lines(
    scatterers: xr.Dataset, *, title: str = "Range of every scatterer", ax: Axes | None = None, **shown: Unpack[Shown]
) -> Figure:
    """Plot the range of every scatterer over time.

    Lines are coloured by body part (the report's Fig. 2.13).

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
        With ``range`` in m and the coordinate ``part``; a second target (coordinate ``target``) is
        dashed.
    **shown : bool
        ``legend``, False to leave it out.

    Raises
    ------
    AnalysisError
        If the variable or the coordinate is missing.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic"}, label="human")], duration_s=3.0)
    >>> table = dg.scene.assemble(scene, [0.0, 0.1, 0.2])
    >>> figure = dg.viz.range_lines(table)
    >>> figure.axes[0].get_title(loc="left"), figure.axes[0].get_xlabel()
    ('Range of every scatterer', 'time (s)')
    """
    return _plot_scatterers(scatterers, None, title, ax, shown)


def doppler_lines(
    scatterers: xr.Dataset,
    *,
    wavelength_m: float,
    title: str = "True Doppler frequency of every scatterer",
    ax: Axes | None = None,
    **shown: Unpack[Shown],
) -> Figure:
    """Plot the true Doppler shift of every scatterer over time.

    These are the report's Fig. 2.14 and 2.16.

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
        With ``radial_velocity`` in m/s, positive when approaching, and the coordinate ``part``.
    wavelength_m : float
        Positive.
    **shown : bool
        ``velocity_axis``, ``legend``, False to leave it out.

    Raises
    ------
    AnalysisError
        If the variable or the coordinate is missing, or the wavelength is not positive.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic"}, label="human")], duration_s=3.0)
    >>> table = dg.scene.assemble(scene, [0.0, 0.1, 0.2])
    >>> figure = dg.viz.doppler_lines(table, wavelength_m=0.04)
    >>> figure.axes[0].get_title(loc="left"), figure.axes[0].get_xlabel()
    ('True Doppler frequency of every scatterer', 'time (s)')
    """
    return _plot_scatterers(scatterers, wavelength_m, title, ax, shown)


def _plot_scatterers(
    scatterers: xr.Dataset, wavelength_m: float | None, title: str, ax: Axes | None, shown: Shown
) -> Figure:
    axes = style.make_axes(ax)[1]
    if wavelength_m is None:
        lines = _get_variable(scatterers, "range")
    else:
        lines = scatterer_doppler(scatterers, wavelength_m=wavelength_m)
        axes.axhline(0.0, color="black", lw=0.6, zorder=0)
    plot_part_lines(axes, lines)
    if lines.sizes["slow_time"] > 1:
        axes.set_xlim(*read_axis(lines, "slow_time")[[0, -1]])
    label = style.RANGE_LABEL if wavelength_m is None else style.DOPPLER_LABEL
    return finish_axes(axes, ax, title, style.TIME_LABEL, label, wavelength_m=wavelength_m, **shown)


def stick_frames(
    motion: Any,
    *,
    start_s: float | None = None,
    duration_s: float | None = None,
    n_frames: int = 9,
    title: str = "One gait cycle from the side",
) -> Figure:
    """Plot side views of a body in a gait cycle.

    These are the report's Fig. 2.12 and 2.18.

    Parameters
    ----------
    motion : doppelgait.motion.Motion
        Positions in m with the coordinate ``part``; points that are NaN are omitted.
    start_s : float, optional
        Time of the first frame; the motion's start by default.
    duration_s : float, optional
        Time from first to last frame; by default one stride (``facts.stride_frequency_hz``), or the
        whole motion if the stride is unknown.
    n_frames : int
        2 to 16.

    Returns
    -------
    Figure
        The horizontal axis is along the direction of travel, from the middle of the body; the floor
        is at 0 m.

    Raises
    ------
    AnalysisError
        If the times lie outside the motion, or ``n_frames`` is not allowed.

    Examples
    --------
    >>> import doppelgait as dg
    >>> figure = dg.viz.stick_frames(dg.motion.boulic_walk(duration_s=2.0))
    >>> [axes.get_title() for axes in figure.axes][:3]
    ['0.00 s', '0.14 s', '0.28 s']
    """
    positions = check_array(motion.positions, MOTION)
    times_s, parts = read_axis(positions, "time"), read_axis(positions, "part").astype(str).tolist()
    stride_hz = float(motion.facts.stride_frequency_hz)
    if not 2 <= n_frames <= 16:
        raise AnalysisError(f"n_frames is {n_frames}; 2 to 16 fit on a page")
    start = float(times_s[0]) if start_s is None else start_s
    stride_s = 1.0 / stride_hz if stride_hz > 0 else np.inf
    lasts = min(stride_s, float(times_s[-1]) - start) if duration_s is None else duration_s
    if not (times_s[0] <= start and lasts > 0 and start + lasts <= times_s[-1] + 1e-9):
        raise AnalysisError(
            f"frames from {start:g} s for {lasts:g} s do not lie in the motion, {times_s[0]:g} to {times_s[-1]:g} s"
        )
    frames = [int(np.abs(times_s - time).argmin()) for time in np.linspace(start, start + lasts, n_frames)]
    side_m = side_view_m(positions.values[frames])
    if not np.isfinite(side_m).any():
        raise AnalysisError("the motion has no known point in these frames: nothing to plot")
    figure, panels = _make_panels(side_m, n_frames)
    times_s = times_s[frames]
    for axes, points_m, time_s in zip(panels, side_m, times_s, strict=True):
        # Points, large for torso and feet; the parts of every limb joined from the body outwards.
        for group in dict.fromkeys(find_part_group(part) for part in parts):
            chosen = [n for n, part in enumerate(parts) if find_part_group(part) == group]
            colour = PART_COLOURS[group]
            sizes = [LARGE if format_bold_name(parts[n]) else SMALL for n in chosen]
            axes.scatter(points_m[chosen, 0], points_m[chosen, 1], s=sizes, color=colour, lw=0, label=group)
            inner = {parts[n] for n in chosen} & LIMB_PARTS
            limb = [part for ending in LIMB_ORDER for part in sorted(inner) if part.endswith(f"_{ending}")]
            joints = [points_m[[n for n in chosen if parts[n] == part]].mean(axis=0) for part in limb]
            if len(joints) > 1:
                axes.plot(*np.transpose(joints), color=colour, lw=1.3, alpha=0.7, zorder=1)
        axes.set_title(f"{time_s - times_s[0]:.2f} s")
    figure.suptitle(f"{title}, from {times_s[0]:.2f} s", x=0.01, ha="left")
    style.place_legend(panels[0], columns=8)
    return figure


def side_view_m(position_m: FloatArray) -> FloatArray:
    """Project points (F, P, 3) along the path of the body and height."""
    low, high = np.fmin.reduce(position_m, axis=1), np.fmax.reduce(position_m, axis=1)
    centre = (low + high)[:, :2] / 2.0
    path = centre[-1] - centre[0]
    if not np.linalg.norm(path) > 0.1:
        relative = np.nan_to_num((position_m[..., :2] - centre[:, None]).reshape(-1, 2))
        path = np.linalg.svd(relative, full_matrices=False)[2][0]
        path *= np.sign(path[np.abs(path).argmax()]) or 1.0
    along = (position_m[..., :2] - centre[:, None]) @ (path / np.linalg.norm(path))
    return np.stack([along, position_m[..., 2]], axis=-1)


def _make_panels(side_m: FloatArray, n_frames: int) -> tuple[Figure, list[Axes]]:
    rows = 1 if n_frames <= 5 else 2
    across = -(-n_frames // rows)
    reach = 1.15 * float(np.nanmax(np.abs(side_m[..., 0])))
    low, high = min(-0.05, float(np.nanmin(side_m[..., 1]))), 1.06 * float(np.nanmax(side_m[..., 1]))
    panel_in = min(11.0 / across, 2.9 * 2.0 * reach / (high - low))
    height_in = rows * (panel_in * (high - low) / (2.0 * reach) + 0.5) + 0.6
    figure = style.make_figure(width_in=max(panel_in * across + 0.6, 7.0), height_in=height_in, compressed=True)
    panels = list(figure.subplots(rows, across, sharex=True, sharey=True, squeeze=False).flat)
    for number, axes in enumerate(panels):
        axes.set(xlim=(-reach, reach), ylim=(low, high), aspect="equal", visible=number < n_frames)
        axes.axhline(0.0, color=style.REFERENCE, lw=0.8, zorder=0)
        last = number + across >= n_frames
        axes.tick_params(labelbottom=last)
        axes.set_xlabel("along the path (m)" if last else "")
        axes.set_ylabel("" if number % across else "height (m)")
    return figure, panels[:n_frames]
