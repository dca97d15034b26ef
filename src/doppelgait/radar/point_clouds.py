"""Point clouds with track numbers from TI's tracking demos: CSV, or JSON of the Industrial Visualizer.

Such a log has no samples and cannot be analysed; its tracks can be compared with other tracks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.config import read_toml
from doppelgait.core.documents import parse_json, read_document
from doppelgait.core.errors import RecordingError
from doppelgait.core.units import FloatArray
from doppelgait.radar.measured import check_number

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["PointTrack", "collect_tracks", "interpolate_ranges", "read_points", "tabulate_tracks"]

MAX_BYTES = 1 << 29
COLUMNS = read_toml(Path(__file__).parent / "readers" / "names.toml")[0]["points"]
NEEDED = ("x_m", "y_m", "doppler_mps", "track")
MAX_TIME_S, MAX_SIZE = 1e13, 1e5  # the times of a clock in ms; coordinates in m and speeds in m/s
NO_TRACK = 250
"""Minimum number without a track: 253 weak, 254 outside the room, 255 noise (TI's "3D people tracking" guide)."""
LEAST_FRAMES = 5
NEW_TRACK_S = 1.0
"""Maximum gap within a track, s: about 15 frames at the usual rate (assumed)."""


@dataclass(frozen=True)
class PointTrack:
    """One body of a log, frame by frame (T,)."""

    track: int
    times_s: FloatArray
    range_m: FloatArray
    velocity_mps: FloatArray
    position_m: FloatArray
    spread_mps: float
    n_points: int


def read_points(
    path: str | Path, *, frame_period_s: float | None = None, approaching_positive: bool = False
) -> pd.DataFrame:
    """Read the points of a log."""
    import pandas as pd

    file = Path(path)
    if not file.is_file():
        raise RecordingError(f"{file}: no such file")
    if frame_period_s is not None:
        check_number(file, "frame_period_s", frame_period_s, above=0)
    read = _read_json if file.suffix.lower() == ".json" else _read_csv
    table = pd.DataFrame(read(file, read_document(file, MAX_BYTES, RecordingError)), dtype=np.float64)
    if table.empty:
        raise RecordingError(f"{file}: holds no points")
    if "time_s" not in table:
        if frame_period_s is None or "frame" not in table:
            raise RecordingError(
                f"{file}: has no times; set frame_period_s if it has a column frame, or add a column time"
            )
        table["time_s"] = table["frame"] * frame_period_s
    for name in table.columns.intersection([*NEEDED, "z_m", "time_s"]):
        most = MAX_TIME_S if name == "time_s" else MAX_SIZE
        if len(bad := np.flatnonzero(~(table[name].abs() <= most))):
            raise RecordingError(f"{file}: point {bad[0] + 1} has no {name} up to {most:g}")
    if (back := np.flatnonzero(np.diff(table["time_s"]) < 0)).size:
        raise RecordingError(f"{file}: point {back[0] + 2} is earlier than the previous one; sort the points by time")
    if "z_m" not in table:
        table["z_m"] = 0.0
    number = table["track"].to_numpy()
    table["track"] = np.where((number >= 0) & (number < NO_TRACK), number, -1).astype(np.int64)
    table["velocity_mps"] = table["doppler_mps"] * (1.0 if approaching_positive else -1.0)
    table["time_s"] -= table["time_s"].iloc[0]
    return table.reindex(columns=["time_s", "x_m", "y_m", "z_m", "velocity_mps", "snr", "track"])


def _read_csv(file: Path, content: bytes) -> dict[str, Any]:
    import pandas as pd

    try:
        raw = pd.read_csv(BytesIO(content), skipinitialspace=True)
    except ValueError as error:
        raise RecordingError(f"{file}: cannot be read as CSV: {str(error).strip()}") from None
    names = {str(name).strip().lower(): name for name in raw.columns}
    present = {key: names[name] for key, accepted in COLUMNS.items() for name in reversed(accepted) if name in names}
    if missing := [key for key in NEEDED if key not in present]:
        raise RecordingError(
            f"{file}: has no column for {', '.join(missing)}; it has {', '.join(map(str, raw.columns))}. Known names "
            f"of {missing[0]} are {', '.join(COLUMNS[missing[0]])}"
        )
    columns = {}
    for key, name in present.items():
        try:
            values = pd.to_numeric(raw[name], errors="coerce")
        except OverflowError:
            raise RecordingError(f"{file}: {name} holds a number that is too large to be read") from None
        if key == "track":
            values = values.fillna(-1)
        bad = np.flatnonzero(~np.isfinite(values.to_numpy(dtype=np.float64)))
        if len(bad) and key != "snr":
            raise RecordingError(f"{file}: line {bad[0] + 2}, {name}: {raw[name].iloc[bad[0]]!r} is no number")
        columns[key] = values.to_numpy(dtype=np.float64)
    return columns


def _read_json(file: Path, content: bytes) -> dict[str, Any]:
    """Read the frames of the Industrial Visualizer: x, y, z, Doppler, SNR, noise, track; ms."""
    rows: list[list[float]] = []
    where, before = "the file", slice(0, 0)
    try:
        for number, entry in enumerate(parse_json(content)["data"], start=1):
            where, frame = f"frame {number}", entry["frameData"]
            indexes = frame.get("trackIndexes") or []
            if len(indexes) == before.stop - before.start:
                for row, index in zip(rows[before], indexes, strict=True):
                    row[-1] = float(index)
            before = slice(len(rows), len(rows) + len(frame.get("pointCloud") or []))
            for point in frame.get("pointCloud") or []:
                x, y, z, doppler, snr, _, track = map(float, point[:7])
                rows.append([float(entry["timestamp"]) / 1e3, x, y, z, doppler, snr, track])
    except ValueError as error:
        raise RecordingError(f"{file}: {where} is no JSON of points with 7 numbers each: {error}") from None
    except (KeyError, TypeError, AttributeError, OverflowError) as error:
        raise RecordingError(
            f"{file}: {where} is not as of the Industrial Visualizer: data, each with timestamp and frameData with "
            f"pointCloud ({error!r})"
        ) from None
    return dict(zip((name for name in COLUMNS if name != "frame"), zip(*rows, strict=True), strict=False))


def collect_tracks(points: pd.DataFrame) -> list[PointTrack]:
    """Collect a log's tracks with five frames or more; sensors reuse numbers."""
    tracks = []
    seen = points[points["track"] >= 0].sort_values("time_s", kind="stable")
    again = seen.groupby("track")["time_s"].diff().gt(NEW_TRACK_S).groupby(seen["track"]).cumsum()
    for (number, _), own in seen.groupby([seen["track"], again.rename("again")]):
        frames = own.assign(range_m=np.sqrt(own["x_m"] ** 2 + own["y_m"] ** 2 + own["z_m"] ** 2)).groupby("time_s")
        middle = frames[["range_m", "velocity_mps", "x_m", "y_m", "z_m"]].median()
        if len(middle) < LEAST_FRAMES:
            continue
        about = own["velocity_mps"] - frames["velocity_mps"].transform("median")
        tracks.append(
            PointTrack(
                track=int(str(number)),
                times_s=middle.index.to_numpy(dtype=np.float64),
                range_m=middle["range_m"].to_numpy(dtype=np.float64),
                velocity_mps=middle["velocity_mps"].to_numpy(dtype=np.float64),
                position_m=middle[["x_m", "y_m", "z_m"]].to_numpy(dtype=np.float64),
                spread_mps=float(about.quantile(0.9) - about.quantile(0.1)),
                n_points=len(own),
            )
        )
    return tracks


def tabulate_tracks(tracks: Sequence[PointTrack]) -> pd.DataFrame:
    """Tabulate tracks: times, ranges and speeds."""
    import pandas as pd

    rows = []
    for one in tracks:
        floor_m = one.position_m[:, :2]
        slopes = np.polyfit(one.times_s, floor_m, 1)
        straight_m = np.linalg.norm(floor_m - (one.times_s[:, None] * slopes[0] + slopes[1]), axis=1)
        speed_mps, length_m = float(np.linalg.norm(slopes[0])), float(np.ptp(one.times_s))
        rows.append(
            {
                "track": one.track,
                "start_s": one.times_s[0],
                "stop_s": one.times_s[-1],
                "frames": one.times_s.size,
                "points": one.n_points,
                "range_start_m": one.range_m[0],
                "range_stop_m": one.range_m[-1],
                "torso_velocity_mps": float(np.median(one.velocity_mps)),
                "range_rate_mps": -float(np.polyfit(one.times_s, one.range_m, 1)[0]),
                "ground_speed_mps": speed_mps if np.median(straight_m) < 0.1 * speed_mps * length_m else math.nan,
                "velocity_spread_mps": one.spread_mps,
            }
        )
    return pd.DataFrame(rows)


def interpolate_ranges(
    tracks: Sequence[PointTrack], times_s: npt.ArrayLike, *, longest_gap_s: float = 0.5
) -> FloatArray:
    """Interpolate the ranges of tracks at times (T,); returns (T, number of tracks)."""
    times = np.asarray(times_s, dtype=np.float64)
    found = np.full((times.size, len(tracks)), np.nan)
    for column, one in enumerate(tracks):
        after = np.clip(np.searchsorted(one.times_s, times), 1, one.times_s.size - 1)
        short = np.diff(one.times_s)[after - 1] <= longest_gap_s
        found[short, column] = np.interp(times[short], one.times_s, one.range_m, left=np.nan, right=np.nan)
    return found
