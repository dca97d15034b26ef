"""BVH files (joint hierarchies of animation programs): points are the joints and the ends of their chains."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import MotionError
from doppelgait.core.plugins import plugin
from doppelgait.motion.motion import Motion
from doppelgait.motion.readers.bvh_content import BvhContent, Node, read_bvh_content
from doppelgait.motion.readers.hierarchy import (
    REST_POSE_NOTE,
    Joints,
    begins_with_rest_pose,
    euler_rotations,
    forward_kinematics,
)
from doppelgait.motion.readers.joint_points import joint_motion

FloatArray = npt.NDArray[np.float64]


def sniff_bvh(path: Path, head: bytes) -> bool:
    """Whether a file looks like BVH: its first word is HIERARCHY."""
    return head.removeprefix(b"\xef\xbb\xbf").lstrip()[:9].upper() == b"HIERARCHY"


@plugin("motion_reader", "bvh", sniff=sniff_bvh, suffixes=(".bvh",))
def read_bvh(
    path: Path, *, units: str | None = None, up_axis: str | None = None, rate_hz: float | None = None
) -> Motion:
    """Joints of the body in a BVH file, not cleaned.

    Rotations are applied in the order of their channels. A position channel of any joint replaces that coordinate of
    its OFFSET. Ends of chains are kept where they are away from their joint: they are finger tips, toes, paws, the
    nose. Rig helpers, a root that only carries the body, and nodes on top of others are left out,
    and so is a rest pose that was put in front of the recording.

    Parameters
    ----------
    path : Path
        An existing file.
    units : str, optional
        ``"mm"``, ``"cm"``, ``"m"``, ``"in"``, ``"ft"`` or ``"cmu"`` (1/0.45 inch); default: found from the size of the
        skeleton, since the format names none.
    up_axis : str, optional
        ``"x"``, ``"y"``, ``"z"``, ``"-x"``, ``"-y"`` or ``"-z"``; default: found; y is the convention.
    rate_hz : float, optional
        Frames per second, up to 10000; default: one over the file's Frame Time.

    Returns
    -------
    Motion
        Motion (time, marker, space) in m, z up; ``report`` tells what was read and left out.

    Raises
    ------
    MotionError
        If the file cannot be read right, or holds no joints of a body.
    """
    content = read_bvh_content(path)
    names, parents = zip(*((node.name, node.parent) for node in content.nodes), strict=True)
    position = bvh_positions(content)
    turns = [n for n, channel in enumerate(content.nodes[0].channels) if channel[0] == "r"]
    rest_pose = begins_with_rest_pose(content.values[:, turns], position)
    return joint_motion(
        path,
        Joints(names, parents, position[1:] if rest_pose else position),
        kind="bvh",
        rate_hz=_declared_rate(path, content) if rate_hz is None else rate_hz,
        rate_from="file" if rate_hz is None else "option",
        unit=units,
        unit_from="option",
        up_axis=up_axis,
        report={"notes": [REST_POSE_NOTE] if rest_pose else []},
    )


def bvh_positions(content: BvhContent) -> FloatArray:
    """Positions of all nodes in the file's unit and axes, shape (T, J, 3).

    Parameters
    ----------
    content : BvhContent
        A parsed file.
    """
    n_frames, n_nodes = len(content.values), len(content.nodes)
    translation = np.empty((n_nodes, n_frames, 3))
    rotation = np.empty((n_nodes, n_frames, 3, 3))
    first = np.cumsum([0, *(len(node.channels) for node in content.nodes)])
    for j, node in enumerate(content.nodes):
        translation[j] = node.offset
        for n, channel in enumerate(node.channels):
            if channel[0] == "p":
                translation[j, :, "xyz".index(channel[1])] = content.values[:, first[j] + n]
    for order, members in _by_order(content.nodes).items():
        columns = [
            [first[j] + n for n, channel in enumerate(content.nodes[j].channels) if channel[0] == "r"] for j in members
        ]
        angles = np.radians(content.values[:, np.array(columns, dtype=np.intp)])
        rotation[members] = euler_rotations(order, angles).swapaxes(0, 1)
    return forward_kinematics([node.parent for node in content.nodes], translation, rotation)


def _by_order(nodes: Sequence[Node]) -> dict[str, list[int]]:
    """Nodes by the order of their rotations, ``"zyx"`` for example; ``""`` has none."""
    table: dict[str, list[int]] = {}
    for j, node in enumerate(nodes):
        order = "".join(channel[1] for channel in node.channels if channel[0] == "r")
        table.setdefault(order, []).append(j)
    return table


def _declared_rate(path: Path, content: BvhContent) -> float:
    if not 0.0 < content.frame_time_s < float("inf"):
        raise MotionError(
            f"{path}: declares a Frame Time of {content.frame_time_s:g} s; it must be above 0. "
            "Give the true rate: rate_hz=..."
        )
    return 1.0 / content.frame_time_s
