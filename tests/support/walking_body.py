"""A walking body of 16 markers in closed form, for tests of readers; the bones of the body of the models."""

import numpy as np

HEIGHTS_M = {
    "LFHD": 1.7, "RFHD": 1.7, "C7": 1.5, "STRN": 1.3, "LSHO": 1.45, "RSHO": 1.45, "LELB": 1.1, "RELB": 1.1,
    "LFIN": 0.8, "RFIN": 0.8, "LKNE": 0.5, "RKNE": 0.5, "LANK": 0.1, "RANK": 0.1, "LTOE": 0.03, "RTOE": 0.03,
}  # fmt: skip
NAMES = list(HEIGHTS_M)
BONES = [("neck", "head", "head"), ("base", "neck", "torso")] + [
    (f"{side}_{a}", f"{side}_{b}", bone)
    for side in ("left", "right")
    for a, b, bone in (
        ("shoulder", "elbow", "upper_arm"), ("elbow", "hand", "forearm"), ("hip", "knee", "thigh"),
        ("knee", "ankle", "shank"), ("ankle", "toe", "foot"),
    )
]  # fmt: skip


def walking_body(*, n_frames: int = 40, rate_hz: float = 100.0, speed_mps: float = 1.3) -> np.ndarray:
    """Positions (T, P, 3) in m, z up, of a body that walks along +x with a stride of 1 Hz, left of it +y."""
    time_s = np.arange(n_frames)[:, None] / rate_hz
    height = np.array(list(HEIGHTS_M.values()))
    side = np.array([{"L": 1.0, "R": -1.0}.get(name[0], 0.0) for name in NAMES])
    x = speed_mps * time_s + 0.25 * (1.0 - height / 1.7) * side * np.sin(2 * np.pi * time_s)
    y = np.broadcast_to(0.15 * side, x.shape)
    z = height + 0.02 * np.cos(4 * np.pi * time_s)
    return np.stack([x, y, z], axis=2)


def y_up(position_m: np.ndarray) -> np.ndarray:
    """The same body in axes x forward, y up, z to the right."""
    return np.stack([position_m[..., 0], position_m[..., 2], -position_m[..., 1]], axis=-1)
