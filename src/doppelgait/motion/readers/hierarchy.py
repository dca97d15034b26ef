"""Joint hierarchies: rotations and forward kinematics on whole recordings at once.

Vectors are columns: a child's frame is ``G_child = G_parent @ R_child`` and its origin
``p_child = p_parent + G_parent @ t_child``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Joints:
    """Positions of the nodes of one hierarchy, with what its file says about them.

    Parameters
    ----------
    names : tuple of str, length J
        Node names as in the file; a nameless end of a chain is called after its joint (``"Head_End"``).
    parents : tuple of int, length J
        Index of each node's parent, smaller than its own; -1 for the root.
    position : ndarray, shape (T, J, 3)
        In the file's unit and axes.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    position: FloatArray


def axis_rotations(axis: str, angle_rad: FloatArray) -> FloatArray:
    """Rotations by angles about one coordinate axis, right-handed.

    Parameters
    ----------
    axis : str
        ``"x"``, ``"y"`` or ``"z"``.
    angle_rad : ndarray, shape (...)
        Any angle.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    k = "xyz".index(axis)
    i, j = (k + 1) % 3, (k + 2) % 3
    rotation = np.zeros((*np.shape(angle_rad), 3, 3))
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    rotation[..., k, k] = 1.0
    rotation[..., i, i] = rotation[..., j, j] = cosine
    rotation[..., i, j], rotation[..., j, i] = -sine, sine
    return rotation


def euler_rotations(axes: str, angles_rad: FloatArray) -> FloatArray:
    """Product of axis rotations, ``R = R_axes[0] @ R_axes[1] @ ...``: the last named turns a vector first.

    Parameters
    ----------
    axes : str
        Axis letters, none or more, ``"zyx"`` for example.
    angles_rad : ndarray, shape (..., len(axes))
        Angles in the order of ``axes``.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        The identity when ``axes`` is empty.
    """
    if not axes:
        return np.broadcast_to(np.eye(3), (*angles_rad.shape[:-1], 3, 3))
    rotation = axis_rotations(axes[0], angles_rad[..., 0])
    for n, axis in enumerate(axes[1:], start=1):
        rotation = rotation @ axis_rotations(axis, angles_rad[..., n])
    return rotation


def vector_rotations(vector_rad: FloatArray) -> FloatArray:
    """Rotations from rotation vectors (exponential maps): ``R = I + sin(a) K + (1 - cos(a)) K K`` (Rodrigues).

    Parameters
    ----------
    vector_rad : ndarray, shape (..., 3)
        Unit axis times angle a; K is the cross-product matrix of the unit axis.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Turns column vectors by +a about the axis.
    """
    angle = np.linalg.norm(vector_rad, axis=-1)
    # sin(a)/a and (1 - cos(a))/a^2 without a division by zero
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    x, y, z = np.moveaxis(vector_rad, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)
    return np.asarray(np.eye(3) + first[..., None, None] * cross + second[..., None, None] * (cross @ cross))


def forward_kinematics(parents: Sequence[int], translation: FloatArray, rotation: FloatArray) -> FloatArray:
    """Positions of all nodes: ``p_j = p_parent + G_parent @ t_j``, ``G_j = G_parent @ R_j``.

    Parameters
    ----------
    parents : sequence of int, length J
        A parent comes before its children; -1 for a root.
    translation : ndarray, shape (J, T, 3)
        Of each node in its parent's frame.
    rotation : ndarray, shape (J, T, 3, 3)
        Of each node against its parent.

    Returns
    -------
    ndarray, shape (T, J, 3)
        In the unit of ``translation``.
    """
    position = np.array(translation)
    frame = np.array(rotation)
    with np.errstate(over="ignore", invalid="ignore"):  # absurd values of a damaged file; its reader checks the result
        for j, parent in enumerate(parents):
            if parent >= 0:
                position[j] = position[parent] + (frame[parent] @ translation[j, :, :, None])[..., 0]
                frame[j] = frame[parent] @ rotation[j]
    return np.ascontiguousarray(position.transpose(1, 0, 2))


def begins_with_rest_pose(root_rotation: FloatArray, position: FloatArray) -> bool:
    """Whether the first frame is a rest pose put in front of a recording, as conversions of the CMU database have it.

    Its root is not turned at all while that of the second frame is, and the body jumps from it into the motion: further
    than five times the median of the other steps.

    Parameters
    ----------
    root_rotation : ndarray, shape (T, k)
        Rotation channels of the root, any unit.
    position : ndarray, shape (T, J, 3)
        Of all nodes.
    """
    if len(position) < 3 or root_rotation[0].any() or not root_rotation[1].any():
        return False
    step = np.linalg.norm(np.diff(position, axis=0), axis=2).max(axis=1)
    return bool(step[0] > 5.0 * np.median(step[1:]))


REST_POSE_NOTE = "frame 0 is a rest pose put in front of the recording; left out"
