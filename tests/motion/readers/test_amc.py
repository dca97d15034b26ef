"""ASF/AMC reading on files that these tests write themselves."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from doppelgait.core.errors import MotionError
from doppelgait.motion.readers import read
from doppelgait.motion.readers.amc import find_asf, read_asf

UNIT_M = 0.0254 / 0.45
BONES = {
    # bone: (parent, direction, length, axis, degrees of freedom)
    "lhipjoint": ("root", (0.6, -0.8, 0.0), 2.5, "0 0 0 XYZ", ""),
    "lfemur": ("lhipjoint", (0.34202, -0.939693, 0.0), 7.0, "0 0 20 XYZ", "rx ry rz"),
    "ltibia": ("lfemur", (0.34202, -0.939693, 0.0), 7.2, "0 0 20 XYZ", "rx"),
    "lfoot": ("ltibia", (0.08, -0.219, 0.9724), 2.0, "-90 10 20 ZXY", "rz rx"),
    "rhipjoint": ("root", (-0.6, -0.8, 0.0), 2.5, "0 0 0 XYZ", ""),
    "rfemur": ("rhipjoint", (-0.34202, -0.939693, 0.0), 7.0, "0 0 -20 XYZ", "rx ry rz"),
    "lowerback": ("root", (0.0, 1.0, 0.0), 9.0, "0 0 0 XYZ", "rx ry rz"),
    "rhumerus": ("lowerback", (-1.0, 0.0, 0.0), 5.0, "180 30 90 YZX", "rx ry rz"),
    "head": ("lowerback", (0.0, 1.0, 0.1), 3.0, "0 0 0 XYZ", "rx ry rz"),
}


def asf_text(*, length: str = "0.45", angle: str = "deg", bones: dict | None = None) -> str:
    bones = bones or BONES
    data = "".join(
        f"  begin\n     id {n}\n     name {name}\n     direction {' '.join(map(str, direction))}\n     length {size}\n"
        f"     axis {axis}\n"
        + (f"    dof {dof}\n    limits (-90.0 90.0)\n           (-90.0 90.0)\n" if dof else "")
        + "  end\n"
        for n, (name, (_, direction, size, axis, dof)) in enumerate(bones.items(), start=1)
    )
    tree = "".join(f"    {parent} {name}\n" for name, (parent, *_) in bones.items())
    return (
        f"# comment\n:version 1.10\n:name VICON\n:units\n  mass 1.0\n  length {length}\n  angle {angle}\n"
        ":documentation\n   made for a test: no real body\n:root\n   order TX TY TZ RX RY RZ\n   axis XYZ\n"
        f"   position 1 0 0\n   orientation 0 0 0\n:bonedata\n{data}:hierarchy\n  begin\n{tree}  end\n"
    )


def angles(n_frames: int = 40) -> dict[str, np.ndarray]:
    draw = np.random.default_rng(7)
    time = np.arange(n_frames)[:, None] / 120.0
    found = {
        name: draw.uniform(-40, 40, len(dof.split())) * np.sin(2 * np.pi * time + draw.uniform(0, 6, len(dof.split())))
        for name, (*_, dof) in BONES.items()
        if dof
    }
    root = np.hstack([np.zeros_like(time), np.full_like(time, 17.0), 22.0 * time, 5 * np.sin(time), 0 * time, 3 + time])
    return {"root": root, **found}


def amc_text(values: dict[str, np.ndarray], *, head: str = ":FULLY-SPECIFIED\n:DEGREES\n") -> str:
    frames = [
        f"{t + 1}\n" + "".join(f"{name} {' '.join(f'{x:.9g}' for x in table[t])}\n" for name, table in values.items())
        for t in range(len(values["root"]))
    ]
    return f"#!OML:ASF H:\\My Body\\person.ASF\n{head}" + "".join(frames)


def literal(values: dict[str, np.ndarray], t: int) -> dict[str, np.ndarray]:
    """Bone ends in one frame, rotation by rotation about fixed axes with SciPy."""

    def fixed(order: str, by_axis: dict[str, float]) -> Rotation:
        total = Rotation.identity()
        for axis in order.lower():  # the first letter turns first
            total = Rotation.from_euler(axis, by_axis.get(axis, 0.0), degrees=True) * total
        return total

    root = values["root"][t]
    frames = {"root": fixed("XYZ", dict(zip("xyz", root[3:], strict=True)))}
    places = {"root": root[:3] + np.array([1.0, 0.0, 0.0])}
    for name, (parent, direction, size, axis, dof) in BONES.items():
        numbers, order = axis.split()[:3], axis.split()[3]
        own = fixed(order, dict(zip("xyz", map(float, numbers), strict=True)))
        given = {word[1]: value for word, value in zip(dof.split(), values.get(name, [[]] * (t + 1))[t], strict=True)}
        frames[name] = frames[parent] * own * fixed(order, given) * own.inv()
        unit = np.array(direction) / np.linalg.norm(direction)
        places[name] = places[parent] + frames[name].apply(unit * size)
    return places


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    (tmp_path / "07.asf").write_text(asf_text())
    path = tmp_path / "07_01.amc"
    path.write_text(amc_text(angles()))
    return path


def test_bone_ends_agree_with_a_bone_by_bone_walk(walk: Path) -> None:
    motion = read(walk, clean=False, up_axis="z")
    assert motion.markers == ["root", *BONES]
    for t in (0, 13, 39):
        for name, place in literal(angles(), t).items():
            np.testing.assert_allclose(motion.positions.sel(marker=name).values[t], place * UNIT_M, atol=1e-8)


def test_axes_rate_unit_and_skeleton_are_reported(walk: Path, tmp_path: Path) -> None:
    motion = read(walk, clean=False, up_axis="y")
    report = motion.report
    assert (motion.rate_hz, report["frame_rate_from"]) == (120.0, "assumed")
    assert report["metres_per_unit"] == pytest.approx(UNIT_M)
    assert (report["skeleton"], motion.facts.subject) == ("07.asf", "07")
    # x, y, z of the file are y, z, x of the motion
    upright = read(walk, clean=False, up_axis="z").position_m
    np.testing.assert_allclose(motion.position_m, upright[..., [2, 0, 1]])
    assert read(walk, clean=False, rate_hz=60.0).report["frame_rate_from"] == "option"
    # the unit is inches over its length
    (tmp_path / "07.asf").write_text(asf_text(length="0.9"))
    np.testing.assert_allclose(read(walk, clean=False, up_axis="z").position_m, upright / 2)
    np.testing.assert_allclose(read(walk, clean=False, up_axis="z", units="cmu").position_m, upright)


def test_radians_are_taken_from_motion_and_skeleton_and_bones_without_values_rest(walk: Path, tmp_path: Path) -> None:
    given = angles() | {"head": 0.0 * angles()["head"]}
    walk.write_text(amc_text(given))
    expected = read(walk, clean=False).position_m
    values = {name: np.radians(table) for name, table in given.items() if name != "head"}
    values["root"][:, :3] = given["root"][:, :3]
    walk.write_text(amc_text(values, head=":fully-specified\n:radians\n"))
    np.testing.assert_allclose(read(walk, clean=False).position_m, expected, atol=1e-8)
    bones = {
        name: (*start, " ".join(map(str, np.radians(np.array(axis.split()[:3], float)))) + " " + axis[-3:], dof)
        for name, (*start, axis, dof) in BONES.items()
    }
    (tmp_path / "07.asf").write_text(asf_text(angle="rad", bones=bones))
    walk.write_text(amc_text(values, head=":FULLY-SPECIFIED\n"))
    np.testing.assert_allclose(read(walk, clean=False).position_m, expected, atol=1e-8)


def test_the_skeleton_is_found_by_name_comment_or_alone(tmp_path: Path) -> None:
    def found(motion: str, *skeletons: str, named: str = "") -> str:
        folder = tmp_path / f"{motion}-{len(list(tmp_path.iterdir()))}"
        folder.mkdir()
        for name in skeletons:
            (folder / name).touch()
        return find_asf(folder / motion, named).name

    assert found("07_01.amc", "07.asf", "0.asf", "09.asf") == "07.asf"
    assert found("cmu_07_05-walk.amc", "cmu_07.ASF", "cmu_09.asf", "cmu.asf") == "cmu_07.ASF"
    assert found("walk.amc", "liu.asf", "other.asf", named="LIU.asf") == "liu.asf"
    assert found("walk.amc", "somebody.asf") == "somebody.asf"
    with pytest.raises(MotionError, match=r"walk.amc: .*there is none.*skeleton="):
        found("walk.amc")
    with pytest.raises(MotionError, match=r"several are possible: a.asf, b.asf"):
        found("walk.amc", "a.asf", "b.asf")


def test_a_given_skeleton_is_used(walk: Path, tmp_path: Path) -> None:
    expected = read(walk, clean=False).position_m
    other = tmp_path / "elsewhere" / "x.asf"
    other.parent.mkdir()
    (tmp_path / "07.asf").rename(other)
    np.testing.assert_array_equal(read(walk, clean=False, skeleton=str(other)).position_m, expected)
    with pytest.raises(MotionError, match=r"none.asf: the skeleton cannot be read"):
        read(walk, skeleton=tmp_path / "none.asf")


@pytest.mark.parametrize(
    ("old", "new", "pattern"),
    [
        ("\n3\n", "\nltibia 1\n3\n", "line {line}: 'ltibia 1' in frame 2, where frame 1 has the next frame"),
        ("\n3\n", "\n3\n3\n", "frame 3 ends after 0 of 8 bones"),
        ("ltibia", "tibia", "gives 'tibia' 1 value.*it is not a bone of its skeleton.*skeleton="),
        ("\n3\nroot", "\n3\nrout", "line {line}: 'rout .*' in frame 3, where frame 1 has root with 6 value"),
        ("\n3\nroot", "\n3\nroot nan", "line {line}: 'root nan .*' in frame 3, where"),
        ("\n3\nroot 0 ", "\n3\nroot nan ", "line {line}: 'root nan .*' repeats a bone or does not hold finite"),
    ],
)
def test_damaged_motions_are_named_by_line(walk: Path, old: str, new: str, pattern: str) -> None:
    text = walk.read_text()
    assert old in text
    walk.write_text(text.replace(old, new) if old == "ltibia" else text.replace(old, new, 1))
    line = text[: text.index(old)].count("\n") + 2 + ("root" in old)
    with pytest.raises(MotionError, match=pattern.replace("{line}", str(line))):
        read(walk)


def test_a_frame_that_is_cut_off_is_named(walk: Path) -> None:
    content = walk.read_bytes()
    walk.write_bytes(content[: content.rindex(b"head")])
    with pytest.raises(MotionError, match="ends inside frame 40, after 7 of 8 bones; it is truncated"):
        read(walk)


@pytest.mark.parametrize(
    ("old", "new", "pattern"),
    [
        (":hierarchy", ":tree", "no section :hierarchy"),
        ("length 0.45", "length 0", "length unit 0; it must be above 0"),
        ("length 0.45", "length x", r"line 6: 1 number\(s\) are needed, not 'x'"),
        ("length 7.0", "length nan", "1 number"),
        ("direction 0.6 -0.8 0.0", "direction 0.6 -0.8", r"3 number\(s\)"),
        ("0 0 20 XYZ", "0 0 20 XYY", "axis order 'XYY'"),
        ("dof rx ry rz", "dof rx ry l", "degrees of freedom 'rx ry l'"),
        ("name lfemur", "name ltibia", "'ltibia' is repeated"),
        ("    root lhipjoint\n", "", "lhipjoint.* are not connected to the root"),
        ("    root lhipjoint\n", "    root lhipjoint nobody\n", "names 'nobody', which is not a bone"),
        ("    root rhipjoint\n", "    root rhipjoint lfemur\n", "'lfemur' has two parents"),
        ("  end\n:hierarchy", ":hierarchy", "this bone has no end"),
    ],
)
def test_damaged_skeletons_are_named(walk: Path, tmp_path: Path, old: str, new: str, pattern: str) -> None:
    text = asf_text()
    assert old in text
    (tmp_path / "07.asf").write_text(text.replace(old, new, 1))
    with pytest.raises(MotionError, match=pattern) as error:
        read(walk)
    assert "07.asf" in str(error.value)


def test_a_hierarchy_in_any_order_is_read(tmp_path: Path) -> None:
    text = asf_text()
    lines = text.split("\n")
    first, last = lines.index(":hierarchy") + 2, len(lines) - 2
    lines[first:last] = lines[first:last][::-1]
    (tmp_path / "a.asf").write_text("\n".join(lines))
    (tmp_path / "b.asf").write_text(text)
    for one, other in zip(read_asf(tmp_path / "a.asf").bones, read_asf(tmp_path / "b.asf").bones, strict=True):
        assert (one.name, one.parent, one.freedoms) == (other.name, other.parent, other.freedoms)
