"""Signatures from pictures of spectrograms, as in published data sets."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel, read_toml, validate
from doppelgait.core.errors import AnalysisError, ConfigError, RecordingError
from doppelgait.core.lazy import xr
from doppelgait.core.units import carrier_to_wavelength_m, velocity_to_doppler_hz
from doppelgait.pipeline.spectrogram import MIN_COLUMNS, MIN_ROWS, convert_levels_to_signature

SUFFIXES = (".png", ".jpg", ".jpeg")
SETTINGS_NAME = "picture.toml"
FOLDERS_ABOVE = 3
MAX_PIXELS = 50_000_000
COLOURS = 256
FAR = 0.25
"""Distance from the colour map (red, green and blue from 0 to 1) above which a pixel is not one of its colours."""
MOST_FAR = 0.2  # share of such pixels above which a picture is rejected

SAME_COLOUR, SAME_LEVEL = 4.0 / 255, 8
"""Distance below which colours are the same in a picture, and largest difference of their levels in steps."""

Span = tuple[float, float]


class PictureSettings(FrozenModel):
    """Axes and colours of a picture of a spectrogram.

    velocity_mps: Radial velocity at the lower and the upper edge, positive when approaching. Set
        this or ``doppler_hz``.
    doppler_hz: Doppler frequency at the lower and the upper edge, positive when approaching.
    duration_s: Time from the left to the right edge.
    carrier_hz: Carrier frequency of the radar.
    cpi_s: Processing interval of a column of the spectrogram. It has no default, because it
        determines whether steps can be distinguished.
    level_db: Levels of the first and the last colour of the map.
    colormap: Colour map of Matplotlib. Use ``jet`` for MATLAB's ``jet``, and the similar
        ``viridis`` for ``parula``.
    crop: Left, upper, right and lower edge of the spectrogram in the picture, pixels from the upper
        left corner.
    prf_hz: Pulses per second; by default the picture is assumed to show the whole Doppler span.
    range_m: Nearest and farthest possible range of the target.
    blank_below_mps: Rows slower than this are set to zero.
    """

    velocity_mps: Span | None = None
    doppler_hz: Span | None = None
    duration_s: float = Field(gt=0, le=3600)
    carrier_hz: float = Field(gt=1e6, lt=1e12)
    cpi_s: float = Field(gt=0, le=10)
    level_db: Span
    colormap: str
    crop: tuple[int, int, int, int] | None = None
    prf_hz: float | None = Field(default=None, ge=1, le=1e6)
    range_m: Span = (0.0, 10.0)
    blank_below_mps: float = Field(default=0.0, ge=0, le=10)

    @model_validator(mode="after")
    def _check_axes(self) -> Self:
        if (self.velocity_mps is None) == (self.doppler_hz is None):
            raise ValueError(
                "velocity_mps or doppler_hz: one of the two is needed, as the lower and upper edge of the picture"
            )
        low, high = self.rows
        if low == high:
            raise ValueError(f"velocity_mps or doppler_hz: {low:g} to {high:g} is not allowed; the edges must differ")
        for name, span in {"level_db": self.level_db, "range_m": self.range_m}.items():
            if span[0] >= span[1]:
                raise ValueError(f"{name}: {span} is not allowed; the first must be below the last")
        return self

    @property
    def rows(self) -> Span:
        """Doppler or velocity at both edges."""
        return self.velocity_mps or self.doppler_hz or (0.0, 0.0)


def is_picture(path: str | Path) -> bool:
    """Return True if a path has the extension of a picture."""
    return str(path).lower().endswith(SUFFIXES)


def find_settings_file(path: Path) -> Path | None:
    """Return a picture's settings: its stem, or picture.toml in it or three folders above."""
    above = list(path.absolute().parents)[: FOLDERS_ABOVE + 1]
    candidates = (path.with_suffix(".toml"), *(folder / SETTINGS_NAME for folder in above))
    return next((candidate for candidate in candidates if candidate.is_file()), None)


def read_picture(
    path: str | Path, settings: PictureSettings | None = None, *, config: str | Path | None = None
) -> xr.DataArray:
    """Read the picture of a spectrogram as a signature, by the nearest colours."""
    file = Path(path)
    if settings is None:
        found = find_settings_file(file)
        if config is not None:
            found = Path(config) if Path(config).is_file() else file.parent / config
        if found is None or not found.is_file():
            name = f"{file.stem}.toml or {SETTINGS_NAME}" if config is None else str(Path(config))
            raise RecordingError(
                f"{file}: a picture needs a file {name} with its axes; write velocity_mps, duration_s, carrier_hz, "
                "cpi_s, level_db and colormap into it"
            )
        try:
            table, text = read_toml(found)
            settings = validate(PictureSettings, table, where=str(found), text=text)
        except ConfigError as error:
            raise RecordingError(str(error)) from None
    from matplotlib import colormaps
    from scipy.spatial import KDTree

    if settings.colormap not in colormaps:
        raise RecordingError(
            f"{file}: colormap = {settings.colormap!r} is not known; it must be one of Matplotlib's, such as jet or "
            "gray"
        )
    # rounded to 8 bits as in a picture
    shades = colormaps[settings.colormap](np.linspace(0.0, 1.0, COLOURS), bytes=True)[:, :3]
    colours = KDTree(np.asarray(shades, dtype=np.float64) / 255.0)
    if any(abs(one - other) > SAME_LEVEL for one, other in colours.query_pairs(SAME_COLOUR)):
        raise RecordingError(
            f"{file}: colormap = {settings.colormap!r} has the same colour for several levels; use another colormap"
        )
    pixels = _read_pixels(file, settings.crop)
    distance, number = map(np.asarray, colours.query(pixels))
    far = float((distance > FAR).mean())
    if far > MOST_FAR:
        raise RecordingError(
            f"{file}: {100 * far:.0f} % of the pixels are not colours of {settings.colormap!r}; set crop to the "
            "spectrogram without its frame, or set the right colormap"
        )
    low_db, high_db = settings.level_db
    step_db = (high_db - low_db) / COLOURS  # a colour represents the middle of its step; the first and last are clipped
    of_colour_db = low_db + step_db * (np.arange(COLOURS) + 0.5)
    of_colour_db[[0, -1]] = low_db, high_db
    level_db = of_colour_db[number[::-1].T]  # from the lower edge up; time first
    n_columns, n_rows = level_db.shape
    bottom, top = settings.rows
    rows = bottom + (top - bottom) * (np.arange(n_rows) + 0.5) / n_rows
    wavelength_m = carrier_to_wavelength_m(settings.carrier_hz)
    edges_hz = np.asarray(velocity_to_doppler_hz(np.array(settings.rows), wavelength_m))
    span_hz = float(np.ptp(settings.rows if settings.doppler_hz else edges_hz))
    prf_hz = settings.prf_hz or span_hz
    # columns at integer pulse numbers
    column_s = settings.duration_s / n_columns
    hop = max(1, round(column_s * prf_hz))
    seen_s = (np.arange(n_columns) + 0.5) * column_s
    times_s = np.arange(seen_s[0], seen_s[-1] + 1e-9, hop / prf_hz)
    if times_s.size < MIN_COLUMNS:
        raise RecordingError(
            f"{file}: {settings.duration_s:g} s in {n_columns} columns give {times_s.size} columns at {prf_hz:g} "
            f"pulses/s; at least {MIN_COLUMNS} are needed"
        )
    place = (times_s - seen_s[0]) / column_s
    left = np.minimum(place.astype(int), n_columns - 2)
    part = (place - left)[:, None]
    level_db = (1.0 - part) * level_db[left] + part * level_db[left + 1]
    try:
        mu = convert_levels_to_signature(
            level_db,
            time_s=times_s,
            wavelength_m=wavelength_m,
            prf_hz=prf_hz,
            hop=hop,
            cpi_pulses=max(1, round(settings.cpi_s * prf_hz)),
            range_m=settings.range_m,
            floor_db=low_db,
            ceiling_db=high_db,
            blank_below_mps=settings.blank_below_mps,
            **{"velocity_mps" if settings.doppler_hz is None else "doppler_hz": rows},
        )
    except AnalysisError as error:
        raise RecordingError(f"{file}: {error}") from None
    facts = {"colormap": settings.colormap, "other_colours_share": far, "level_step_db": step_db}
    mu.attrs["picture"] = json.dumps(facts)
    return mu


def _read_pixels(file: Path, crop: tuple[int, int, int, int] | None) -> npt.NDArray[np.float64]:
    """Read pixel colours, 0 to 1, (rows, columns, 3)."""
    from PIL import Image  # a dependency of Matplotlib

    try:
        with Image.open(file, formats=("PNG", "JPEG")) as image:
            width, height = image.size
            if width * height > MAX_PIXELS:
                raise RecordingError(f"{file}: has {width} x {height} pixels; at most {MAX_PIXELS:,} are read")
            left, upper, right, lower = crop or (0, 0, width, height)
            if not (0 <= left < right <= width and 0 <= upper < lower <= height):
                raise RecordingError(
                    f"{file}: crop = {crop} is not allowed; the picture has {width} x {height} pixels: left, upper, "
                    "right and lower edge"
                )
            if right - left < MIN_COLUMNS or lower - upper < MIN_ROWS:
                raise RecordingError(
                    f"{file}: {right - left} x {lower - upper} pixels are too few; at least {MIN_COLUMNS} x {MIN_ROWS}"
                )
            pixels: Any = np.asarray(image.convert("RGB").crop((left, upper, right, lower)))
    except FileNotFoundError:
        raise RecordingError(f"{file}: no such file") from None
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError, EOFError) as error:
        raise RecordingError(f"{file}: cannot be read as a PNG or JPEG picture: {error}") from None
    return np.asarray(pixels, dtype=np.float64) / 255.0
