"""Pictures of spectrograms: levels from colours, axes from settings."""

import json

import numpy as np
import pytest
from matplotlib import colormaps
from matplotlib.image import imsave
from PIL import Image

from doppelgait.core.errors import ConfigError, RecordingError
from doppelgait.pipeline.pictures import PictureSettings, find_settings_file, is_picture, read_picture

LIGHT_MPS = 299_792_458.0
TABLE = {
    "velocity_mps": [-4.0, 4.0], "duration_s": 4.0, "carrier_hz": 10e9, "cpi_s": 0.1, "level_db": [-45.0, 0.0],
    "colormap": "jet",
}  # fmt: skip


def settings(**changes):
    return PictureSettings(**(TABLE | changes))


def draw(path, level_db, *, low_db=-45.0, high_db=0.0, colormap="jet", **options):
    """Levels (time, velocity, lowest first) as a picture with time to the right and velocity up."""
    share = np.clip((level_db - low_db) / (high_db - low_db), 0, 1)
    image = colormaps[colormap](share.T[::-1], bytes=True)
    if path.suffix == ".png":
        imsave(path, image)
    else:
        Image.fromarray(image[..., :3].copy()).save(path, **options)
    return path


def levels(n_columns=100, n_rows=80, seed=0):
    """Smooth levels of -50 to 5 dB: both ends are clipped."""
    t, v = np.meshgrid(np.linspace(0, 1, n_columns), np.linspace(-4, 4, n_rows), indexing="ij")
    return -50.0 + 55.0 * np.exp(-((v - 1.5 - np.sin(9 * t + seed)) ** 2))


@pytest.mark.parametrize("colormap", ["jet", "viridis", "hot", "gray", "turbo"])
def test_levels_come_back_within_their_step(tmp_path, colormap):
    level_db = levels()
    path = draw(tmp_path / "a.png", level_db, colormap=colormap)
    mu = read_picture(path, settings(colormap=colormap))
    assert mu.dims == ("time", "doppler")
    # 4 s in 100 columns and 8 m/s of 10 GHz: 533.7 Hz as the rate, 21 pulses of 39.35 ms a column
    prf_hz = 2 * 8.0 * 10e9 / LIGHT_MPS
    assert mu.attrs["prf_hz"] == pytest.approx(prf_hz)
    assert mu.attrs["hop"] == 21
    assert mu.time.values == pytest.approx(0.02 + np.arange(mu.sizes["time"]) * 21 / prf_hz)
    assert mu.velocity.values == pytest.approx(-4 + 0.1 * (np.arange(80) + 0.5))
    found_db = 10 * np.log10(mu.values)
    step_db = json.loads(mu.attrs["picture"])["level_step_db"]
    assert step_db == pytest.approx(45 / 256)
    clipped = np.clip(level_db, -45, 0)
    seen_s = 0.04 * (np.arange(100) + 0.5)
    expected = np.stack([np.interp(mu.time.values, seen_s, row) for row in clipped.T], axis=1)
    # half a step, a whole one at the clipped ends; more where neighbouring colours are the same in 8 bits
    steps = {"hot": 1.0, "turbo": 1.0, "gray": 1.5, "viridis": 1.5, "jet": 2.5}[colormap]
    assert np.abs(found_db - expected).max() < (steps + 0.01) * step_db
    facts = json.loads(mu.attrs["levels"])
    assert (facts["floor_db"], facts["ceiling_db"]) == (-45.0, 0.0)


def test_jpeg_crop_and_axes(tmp_path):
    level_db = levels()
    plain = read_picture(draw(tmp_path / "a.png", level_db), settings(prf_hz=1000.0))
    jpeg = read_picture(draw(tmp_path / "a.jpg", level_db, quality=95, subsampling=0), settings(prf_hz=1000.0))
    error_db = 10 * np.log10(jpeg.values / plain.values)
    assert np.sqrt((error_db**2).mean()) < 1.0
    with Image.open(tmp_path / "a.png") as image:
        framed = Image.new("RGB", (140, 120), "white")
        framed.paste(image, (30, 10))
    framed.save(tmp_path / "b.png")
    with pytest.raises(RecordingError, match=r"b\.png: \d+ % of the pixels are not colours of 'jet'; set crop"):
        read_picture(tmp_path / "b.png", settings())
    cropped = read_picture(tmp_path / "b.png", settings(prf_hz=1000.0, crop=(30, 10, 130, 90)))
    assert cropped.values == pytest.approx(plain.values)
    # upside down, and the axis in Doppler
    turned = read_picture(tmp_path / "a.png", settings(prf_hz=1000.0, velocity_mps=(4, -4)))
    assert turned.values == pytest.approx(plain.values[:, ::-1])
    hz = 4.0 * 2 * 10e9 / LIGHT_MPS
    doppler = read_picture(tmp_path / "a.png", settings(prf_hz=1000.0, velocity_mps=None, doppler_hz=(-hz, hz)))
    assert doppler.velocity.values == pytest.approx(plain.velocity.values)


def test_where_the_settings_are(tmp_path):
    folder = tmp_path / "set" / "class" / "anna"
    folder.mkdir(parents=True)
    path = draw(folder / "1.png", levels())
    assert find_settings_file(path) is None
    with pytest.raises(RecordingError, match=r"a picture needs a file .* with its axes; write"):
        read_picture(path)
    text = "".join(f"{key} = {json.dumps(value)}\n" for key, value in TABLE.items())
    (tmp_path / "set" / "picture.toml").write_text(text)
    assert find_settings_file(path) == tmp_path / "set" / "picture.toml"
    assert read_picture(path).identical(read_picture(path, settings()))
    (folder / "1.toml").write_text(text.replace("jet", "hot"))
    assert find_settings_file(path) == folder / "1.toml"
    assert read_picture(path, config=tmp_path / "set" / "picture.toml").identical(read_picture(path, settings()))
    with pytest.raises(RecordingError, match=r"a file none\.toml with its axes"):
        read_picture(path, config="none.toml")
    assert is_picture("A.JPG")
    assert not is_picture("a.dat")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"carrier_hz": None}, "carrier_hz"),
        ({"velocity_mps": None}, "velocity_mps or doppler_hz: one of the two"),
        ({"doppler_hz": [-9, 9]}, "one of the two"),
        ({"velocity_mps": [4, 4]}, "the edges must differ"),
        ({"level_db": [0, -45]}, "the first must be below the last"),
        ({"range_m": [3, 3]}, "range_m"),
        ({"colourmap": "jet"}, "colourmap"),
        ({"duration_s": 0}, "duration_s"),
        ({"colormap": "rainbows"}, "colormap = 'rainbows' is not known"),
        ({"colormap": "twilight"}, "colormap = 'twilight' has the same colour for several levels"),
        ({"crop": [0, 0, 200, 50]}, r"crop = \(0, 0, 200, 50\) is not allowed; the picture has 100 x 80 pixels"),
        ({"crop": [0, 0, 5, 50]}, "5 x 50 pixels are too few"),
        ({"prf_hz": 1.0}, "4 s in 100 columns give 4 columns at 1 pulses/s; at least 8"),
    ],
)
def test_settings_that_are_wrong(tmp_path, changes, message):
    path = draw(tmp_path / "a.png", levels())
    table = {key: value for key, value in (TABLE | changes).items() if value is not None}
    text = "".join(f"{key} = {json.dumps(value)}\n" for key, value in table.items())
    (tmp_path / "picture.toml").write_text(text)
    with pytest.raises(RecordingError, match=message) as caught:
        read_picture(path)
    assert str(tmp_path) in str(caught.value)
    with pytest.raises(ConfigError):
        PictureSettings()


def test_hostile_pictures(tmp_path):
    whole = draw(tmp_path / "a.png", levels()).read_bytes()
    Image.new("RGB", (50, 50)).save(tmp_path / "bitmap.bmp")
    bitmap = (tmp_path / "bitmap.bmp").read_bytes()
    for content in (b"", b"\x89PNG\r\n\x1a\n", whole[: len(whole) // 2], whole[:40], bitmap):
        (tmp_path / "b.png").write_bytes(content)
        with pytest.raises(RecordingError, match=r"b\.png: cannot be read as a PNG or JPEG picture"):
            read_picture(tmp_path / "b.png", settings())
    with pytest.raises(RecordingError, match="no such file"):
        read_picture(tmp_path / "c.png", settings())
    huge = bytearray(whole)
    huge[16:24] = (60_000).to_bytes(4, "big") * 2  # a header of 3.6 thousand million pixels
    (tmp_path / "b.png").write_bytes(huge)
    with pytest.raises(RecordingError, match=r"cannot be read|at most 50,000,000"):
        read_picture(tmp_path / "b.png", settings())
