"""BVH reading on files that these tests write themselves; positions are held against 4x4 matrices, joint by joint."""

import re
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.motion.readers import read
from doppelgait.motion.readers.bvh import Node, compute_bvh_positions
from doppelgait.motion.readers.points import connect_kept, measure_skeleton

ROTATIONS = "CHANNELS 3 Zrotation Xrotation Yrotation"
ALL = "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation"
PERSON = {
    # joint: (parent, offset in cm)
    "Hips": ("", (0, 0, 0)),
    "Spine": ("Hips", (0, 20, 0)),
    "Chest": ("Spine", (0, 15, 0)),
    "Neck": ("Chest", (0, 20, 0)),
    "Head": ("Neck", (0, 10, 2)),
    **{
        side + name: (side + parent if parent not in ("Hips", "Chest") else parent, offset)
        for side, sign in (("Left", 1), ("Right", -1))
        for name, parent, offset in (
            ("UpLeg", "Hips", (9 * sign, -5, 0)),
            ("Leg", "UpLeg", (0, -42, 0)),
            ("Foot", "Leg", (0, -40, 0)),
            ("ToeBase", "Foot", (0, -6, 12)),
            ("Shoulder", "Chest", (3 * sign, 15, 0)),
            ("Arm", "Shoulder", (14 * sign, 0, 0)),
            ("ForeArm", "Arm", (27 * sign, 0, 0)),
            ("Hand", "ForeArm", (25 * sign, 0, 0)),
        )
    },
}


def hierarchy(tree: dict[str, tuple[str, tuple]], name: str, channels: str = ROTATIONS, depth: int = 0) -> str:
    """Text of a joint and all below it; chains end in End Sites 8 units on."""
    tab = "\t" * depth
    children = [child for child, (parent, _) in tree.items() if parent == name]
    below = "".join(hierarchy(tree, child, channels, depth + 1) for child in children)
    below = below or f"{tab}\tEnd Site\n{tab}\t{{\n{tab}\t\tOFFSET 0 0 8\n{tab}\t}}\n"
    word, mine = ("JOINT", channels) if tree[name][0] else ("ROOT", ALL)
    offset = " ".join(map(str, tree[name][1]))
    return f"{tab}{word} {name}\n{tab}{{\n{tab}\tOFFSET {offset}\n{tab}\t{mine}\n{below}{tab}}}\n"


def rows(values: np.ndarray) -> str:
    return "".join(" ".join(f"{value:.6f}" for value in row) + " \n" for row in values)


def person_values(n_frames: int = 120) -> np.ndarray:
    """Channel values of a person who walks along z at 1.2 m/s, 120 frames/s, in cm and degrees."""
    values = np.zeros((n_frames, 6 + 3 * (len(PERSON) - 1)))
    time = np.arange(n_frames) / 120.0
    values[:, 1], values[:, 2] = 100.0, 120.0 * time
    names = list(PERSON)
    for name, swing in (("LeftUpLeg", 25), ("RightUpLeg", -25), ("LeftLeg", 20), ("RightArm", 20)):
        values[:, 6 + 3 * (names.index(name) - 1) + 1] = swing * np.sin(2 * np.pi * time + 0.3)
    return values


def write(path: Path, tree: str, values: str, n_frames: int, frame_time: str = "0.0083333") -> Path:
    text = f"HIERARCHY\n{tree}MOTION\nFrames: {n_frames}\nFrame Time: {frame_time}\n{values}"
    path.write_text(text, encoding="utf-8", newline="")
    return path


def person(path: Path, values: np.ndarray | None = None) -> Path:
    values = person_values() if values is None else values
    return write(path, hierarchy(PERSON, "Hips"), rows(values), len(values))


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    return person(tmp_path / "walk.bvh")


def literal(nodes: list[Node], values: np.ndarray) -> np.ndarray:
    """Positions of all nodes by 4x4 matrices, one joint and frame at a time."""
    result = np.empty((len(values), len(nodes), 3))
    for t, row in enumerate(values):
        rest = list(row)
        world: list[np.ndarray] = []
        for j, node in enumerate(nodes):
            local = np.eye(4)
            local[:3, 3] = node.offset
            for channel in node.channels:
                value = rest.pop(0)
                if channel[0] == "p":
                    local["xyz".index(channel[1]), 3] = value
                else:
                    turn = np.eye(4)
                    turn[:3, :3] = Rotation.from_euler(channel[1], value, degrees=True).as_matrix()
                    local = local @ turn
            world.append(world[node.parent] @ local if node.parent >= 0 else local)
            result[t, j] = world[j][:3, 3]
    return result


@pytest.mark.parametrize("seed", range(3))
def test_positions_agree_with_a_matrix_walk(seed: int) -> None:
    draw = np.random.default_rng(seed)
    nodes = []
    for j in range(12):
        turns = list(draw.permutation(["rx", "ry", "rz"]))[: draw.integers(0, 4)]
        places = [f"p{axis}" for axis in "xyz" if draw.random() < 0.4]
        offset = tuple(float(x) for x in draw.normal(size=3))
        nodes.append(Node(f"n{j}", -1 if j == 0 else int(draw.integers(0, j)), offset, [*places, *turns]))
    values = draw.uniform(-180, 180, (5, sum(len(node.channels) for node in nodes)))
    np.testing.assert_allclose(compute_bvh_positions(nodes, values), literal(nodes, values), atol=1e-9)


def test_a_person_is_read(walk: Path) -> None:
    motion = read(walk, clean=False)
    report = motion.report
    assert (report["length_unit"], report["up_axis"], motion.facts.species) == ("cm", "y", "human")
    assert report["points_in_file"] == len(PERSON) + 5
    assert motion.rate_hz == pytest.approx(120, rel=1e-5)
    assert motion.positions.sel(marker="Hips").values[:, 2] == pytest.approx(1.0)
    # y up, walking along z: z becomes x
    step = np.diff(motion.positions.sel(marker="Hips").values, axis=0)
    np.testing.assert_allclose(step, np.tile([0.01, 0.0, 0.0], (len(step), 1)), atol=1e-6)
    assert motion.positions.sel(marker="LeftUpLeg").values[:, 1] == pytest.approx(0.09)
    assert {"LeftToeBase_End", "Head_End", "RightHand_End"} <= set(motion.markers)
    assert report["dropped"] == {}


@pytest.mark.parametrize(("factor", "unit"), [(1.0, "cm"), (0.01, "m"), (10.0, "mm"), (1 / 2.54, "in")])
def test_the_size_of_the_body_tells_the_unit(tmp_path: Path, factor: float, unit: str) -> None:
    tree = {name: (parent, tuple(x * factor for x in offset)) for name, (parent, offset) in PERSON.items()}
    values = person_values()
    values[:, :3] *= factor
    text = hierarchy(tree, "Hips").replace("OFFSET 0 0 8", f"OFFSET 0 0 {8 * factor}")
    motion = read(write(tmp_path / "a.bvh", text, rows(values), len(values)), clean=False)
    assert motion.report["length_unit"] == unit
    assert motion.positions.sel(marker="Hips").values[0, 2] == pytest.approx(1.0, rel=1e-4)


def test_an_unclear_unit_is_said_and_can_be_given(tmp_path: Path) -> None:
    tree = {"a": ("", (0, 0, 0)), "b": ("a", (0, 1, 0)), "c": ("b", (0, 1, 0))}
    values = np.tile(np.arange(10.0)[:, None], (1, 12))
    path = write(tmp_path / "a.bvh", hierarchy(tree, "a"), rows(values), 10)
    with pytest.warns(DoppelgaitWarning, match="names no length unit.*units="):
        read(path, clean=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        motion = read(path, clean=False, units="cmu", up_axis="z", rate_hz=60.0)
    assert motion.report["length_unit_from"] == motion.report["up_axis_from"] == "option"
    np.testing.assert_allclose(motion.positions.sel(marker="a").values[3], 3 * 0.0254 / 0.45)
    assert motion.rate_hz == 60.0


def test_helpers_fixed_root_and_doubles_are_left_out(tmp_path: Path) -> None:
    tree = {"joint_Root": ("", (0, 0, 0))} | {
        name: (parent or "joint_Root", (0, 90, 0) if name == "Hips" else offset)
        for name, (parent, offset) in PERSON.items()
    }
    tree |= {"LHipJoint": ("Hips", (0, 0, 0)), "Bip01_HeadNub": ("Head", (0, 9, 0))}
    tree |= {"Bip01_Footsteps": ("Hips", (0, -90, 0))}
    text = hierarchy(tree, "joint_Root", ALL)
    names = re.findall(r"(?:ROOT|JOINT) (\w+)", text)
    values = np.zeros((60, 6 + 6 * (len(tree) - 1)))
    for n, name in enumerate(names[1:]):
        values[:, 6 + 6 * n : 9 + 6 * n] = tree[name][1]
    values[:, 6 + 6 * names[1:].index("Hips") + 2] += np.arange(60)
    path = write(tmp_path / "a.bvh", text, rows(values), 60)
    dropped = read(path, clean=False).report["dropped"]
    assert dropped["root node, no joint of the body (by its name)"] == ["joint_Root"]
    assert set(dropped["rig helper (by its name)"]) == {
        "Bip01_HeadNub", "Bip01_HeadNub_End", "Bip01_Footsteps", "Bip01_Footsteps_End",
    }  # fmt: skip
    assert dropped["same place as Hips"] == ["LHipJoint"]
    # the same without the telling name: it never moves and bears one joint
    renamed = write(tmp_path / "b.bvh", text.replace("joint_Root", "Place"), rows(values), 60)
    assert read(renamed, clean=False).report["dropped"]["root node, no joint of the body (it never moves)"]


def test_bones_of_a_rig_push_out_the_rest(tmp_path: Path) -> None:
    tree = {"Bip01": ("", (0, 0, 0))} | {
        f"b_{name}": (f"b_{parent}" if parent else "Bip01", offset) for name, (parent, offset) in PERSON.items()
    }
    tree["Dog_Armor"] = ("b_Hips", (30, 0, 0))
    values = np.zeros((30, 6 + 3 * (len(tree) - 1)))
    values[:, 2] = np.arange(30)
    motion = read(write(tmp_path / "a.bvh", hierarchy(tree, "Bip01"), rows(values), 30), clean=False)
    assert motion.report["dropped"]["rig helper (no b_ bone)"] == [
        "Bip01", "Dog_Armor", "Dog_Armor_End",
    ]  # fmt: skip
    assert all(name.startswith("b_") for name in motion.markers)


def test_a_rest_pose_in_front_is_left_out(tmp_path: Path) -> None:
    values = person_values()
    values[:, 4] = 2.0
    values[0, 3:] = 0.0
    values[0, 6 + 1 :: 3] = 30.0
    motion = read(person(tmp_path / "a.bvh", values), clean=False)
    assert motion.n_frames == len(values) - 1
    assert "rest pose" in motion.report["notes"][0]
    smooth = person_values()
    smooth[1:, 4] = 0.01  # a recording that begins unturned but does not jump keeps its first frame
    smooth[:, :3] = 100.0
    kept = read(person(tmp_path / "b.bvh", smooth), clean=False)
    assert kept.n_frames == len(smooth)
    assert "Hips" in kept.markers  # which only turn


def test_line_ends_blanks_and_names_do_not_matter(walk: Path, tmp_path: Path) -> None:
    expected = read(walk, clean=False)
    text = walk.read_text().replace("LeftHand\n", "Left  Händ 手\n")
    odd = tmp_path / "odd name.txt"
    odd.write_bytes(b"\xef\xbb\xbf\r\n" + text.replace(" ", "\t").replace("\n", " \r\n").encode() + b"\r\n\r\n")
    motion = read(odd, clean=False)
    np.testing.assert_array_equal(motion.position_m, expected.position_m)
    assert "Left Händ 手" in motion.markers
    packed = tmp_path / "packed.bvh"
    packed.write_text(walk.read_text().replace("\n\t", "\n").replace("Hips\n{", "Hips {"))
    np.testing.assert_array_equal(read(packed, clean=False).position_m, expected.position_m)


@pytest.mark.parametrize(
    ("edit", "pattern"),
    [
        (lambda rows: [*rows[:4], " ".join(rows[4].split()[:-2]), *rows[5:]], "frame 5 holds 64 values, but 66 are"),
        (lambda rows: [*rows[:4], rows[4].replace(" ", " x ", 1), *rows[5:]], "frame 5 holds 'x', which is not a"),
        (lambda rows: [*rows[:4], "nan " + rows[4].split(" ", 1)[1], *rows[5:]], "frame 5 holds 'nan'"),
        (lambda rows: [*rows[:4], "1e999 " + rows[4].split(" ", 1)[1], *rows[5:]], "frame 5 holds '1e999'"),
        (lambda rows: [*rows[:4], rows[4][:30]], r"frame 5 holds \d+ values, but 66 are needed; the file is truncated"),
        (lambda rows: rows[:50], "declares 120 frames but holds 50"),
        (lambda rows: [rows[0], *rows], "declares 120 frames but holds 121"),
    ],
)
def test_damaged_values_are_named_by_line(walk: Path, edit: Callable[[list[str]], list[str]], pattern: str) -> None:
    lines = walk.read_text().split("\n")
    first = lines.index("MOTION") + 3
    walk.write_text("\n".join([*lines[:first], *edit(lines[first:])]))
    line = f", line {first + 5}: " if pattern.startswith("frame") else ": "
    with pytest.raises(MotionError, match=rf"walk\.bvh{line}{pattern}"):
        read(walk)


@pytest.mark.parametrize(
    ("old", "new", "pattern"),
    [
        ("MOTION\n", "", "no line MOTION"),
        ("Frames: 120", "Frames: many", "must be numbers"),
        ("Frames: 120\n", "", "line {line}: 'Frames: N' is needed here"),
        ("Frame Time: 0.0083333", "Frame Time: 0", "Frame Time of 0 s.*rate_hz"),
        ("CHANNELS 3 Z", "CHANNELS 4 Z", "line {line}: CHANNELS .* is invalid"),
        ("Zrotation", "Wrotation", "line {line}: CHANNELS"),
        ("OFFSET 0 20 0", "OFFSET 0 20", "line {line}: OFFSET needs three numbers"),
        ("OFFSET 0 20 0", "OFFSET 0 inf 0", "line {line}: OFFSET needs three numbers"),
        ("OFFSET 0 20 0", "OFFSET 0 1.7e308 0", "too large to be those of a body"),
        ("JOINT Spine", "BONE Spine", "line {line}: 'BONE Spine' is not a statement"),
        ("}\nMOTION", "MOTION", "a '}' is missing"),
        ("}\nMOTION", "}\n}\nMOTION", "closes nothing"),
        ("}\nMOTION", "}\nROOT Other\n{\n}\nMOTION", "a second ROOT, 'Other'"),
    ],
)
def test_a_damaged_hierarchy_is_named_by_line(walk: Path, old: str, new: str, pattern: str) -> None:
    text = walk.read_text()
    assert old in text
    walk.write_text(text.replace(old, new, 1))
    line = text[: text.index(old)].count("\n") + 1
    with pytest.raises(MotionError, match=pattern.replace("{line}", str(line))):
        read(walk)


def test_skeleton_size_is_the_longest_chain() -> None:
    #      0 -1- 1 -2- 2      and      0 -4- 3 -1- 4,  0 -3- 5
    parents, lengths = [-1, 0, 1, 0, 3, 0], np.array([0.0, 1, 2, 4, 1, 3])
    assert measure_skeleton(parents, lengths) == 8.0
    assert connect_kept(parents, [1, 2, 4, 5]) == [-1, 0, 0, 0]
