"""C3D files with damage that ends or hangs the C3D library: reading ends with our own error."""

from pathlib import Path

import numpy as np
import pytest

from doppelgait.core.errors import MotionError
from doppelgait.motion.readers import read

ezc3d = pytest.importorskip("ezc3d")

LABELS = ["LFHD", "RFHD", "C7", "STRN", "LKNE", "LTOE"]


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A small walk with two analog channels and a list of model outputs."""
    moment = np.arange(80)[:, None] / 100.0
    height = np.array([1700.0, 1700, 1500, 1300, 500, 30])
    x = 1300 * moment + 60 * np.arange(6) * np.sin(2 * np.pi * moment)
    position = np.stack([x, np.broadcast_to(100.0 * np.arange(6), x.shape), np.broadcast_to(height, x.shape)])
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["LABELS"]["value"] = LABELS
    file["parameters"]["ANALOG"]["RATE"]["value"] = [200.0]
    file["parameters"]["ANALOG"]["LABELS"]["value"] = ["Fx", "Fz"]
    file.add_parameter("POINT", "ANGLES", ["LHipAngles"])
    file["data"]["points"] = np.concatenate([position.transpose(0, 2, 1), np.ones((1, 6, 80))])
    file["data"]["analogs"] = np.zeros((1, 2, 160))
    path = tmp_path_factory.mktemp("c3d") / "good.c3d"
    file.write(str(path))
    return path.read_bytes()


# with each of these bytes, counted from the start of a name, the C3D library alone ends the process or runs for ever
@pytest.mark.parametrize(
    ("name", "offset", "value"),
    [
        (b"RATE", 7, 4),  # four dimensions, hence no value
        (b"USED", 7, 2),
        (b"GEN_SCALE", 12, 4),
        (b"FRAMES", 9, 2),
        (b"UNITS", 8, 0x80),
        (b"LABELS", -1, 0x80),  # another group
        (b"LABELS", 9, 0x7F),
        (b"RATIO", 10, 0x80),
    ],
)
def test_known_killers_are_stopped(good: bytes, tmp_path: Path, name: bytes, offset: int, value: int) -> None:
    content = bytearray(good)
    content[content.index(name, 512) + offset] = value
    path = tmp_path / "bad.c3d"
    path.write_bytes(content)
    with pytest.raises(MotionError, match=r"bad\.c3d"):
        read(path)


def test_a_table_of_analog_channels_that_is_missing_does_not_matter(good: bytes, tmp_path: Path) -> None:
    content = bytearray(good)
    content[content.index(b"OFFSET", 512)] = 0x7F
    paths = [tmp_path / "good.c3d", tmp_path / "other.c3d"]
    for path, data in zip(paths, (good, content), strict=True):
        path.write_bytes(data)
    first, second = (read(path) for path in paths)
    np.testing.assert_array_equal(first.position_m, second.position_m)


@pytest.mark.parametrize("size", [600, 734, 771, 845, 1000])
def test_cuts_inside_the_parameters_are_stopped(good: bytes, tmp_path: Path, size: int) -> None:
    path = tmp_path / "bad.c3d"
    path.write_bytes(good[:size])
    with pytest.raises(MotionError, match=r"bad\.c3d: is truncated"):
        read(path)
