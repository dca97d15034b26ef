"""Body parts of known markers and joints, the height of a body from them (E-01), and its bones.

The words are in ``markers.toml``: markers, joints with the name of the joint (knee, wrist) or of the
bone that ends there (femur in ASF/AMC) or starts there (``LeftLeg`` is the knee of BVH skeletons).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache, lru_cache
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from doppelgait.core.config import read_toml
from doppelgait.core.units import FloatArray

_UNSIDED_PARTS = ("head", "neck", "torso", "trunk", "tail")


@cache
def load_markers() -> dict[str, Any]:
    """Return words of names by species and list, and marker sets."""
    return read_toml(Path(__file__).with_name("markers.toml"))[0]


def _expand(text: str) -> list[str]:
    """List the words of a text; ``{a,b}c`` is ac and bc."""
    choices = [[piece.split(",") for piece in re.split(r"[{}]", word)] for word in text.split()]
    # pieces inside braces are the odd ones; outside, there is no comma
    return ["".join(chosen) for pieces in choices for chosen in product(*pieces)]


@cache
def _list_words(species: Species, *kinds: str) -> dict[str, str]:
    """Return body parts by word, with its side if it has one."""
    table: dict[str, str] = {}
    for kind in kinds:
        for part, text in load_markers()[species][kind].items():
            for side in SIDES if kind != "midline" else ("",):
                full = part if part in _UNSIDED_PARTS or not side else f"{side}_{part}"
                table |= {f"{start}{word}": full for word in _expand(text) for start in (side[:1], side)}
    return table


@cache
def list_marker_sets() -> dict[str, frozenset[str]]:
    """Return the physical markers of whole-body sets, without subject prefix."""
    return {name: frozenset(_expand(text)) for name, text in load_markers()["sets"].items()}


_RIG_PREFIX = re.compile(r"^(b_+|bip\d+[ _]+|mixamorig_?)(?=.)", re.IGNORECASE)
_SIDE_BEHIND = re.compile(r"^(.*[A-Za-z0-9])[_. -]([LlRr])(\d*)$|^(.*[a-z])([LR])(\d*)$")
_END = re.compile(r"[_. -]?(end[_ ]?site|end|site|nub)$", re.IGNORECASE)


def reduce_word(name: str) -> str:
    """Reduce a name to lower-case letters and digits: "UpperLeg_L" to "lupperleg"."""
    name, is_end = _END.subn("", _RIG_PREFIX.sub("", name))
    behind = _SIDE_BEHIND.match(name)
    if behind:
        stem, side, number = behind.groups()[:3] if behind[1] else behind.groups()[3:]
        name = f"{side}{stem}{number}"
    return re.sub(r"[^a-z0-9]", "", name.lower()) + ("end" if is_end else "")


_TOKEN = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+")


@lru_cache(2**14)
def list_spellings(name: str, species: Species = "human") -> list[str]:
    """List the words that a name may stand for, the most exact first."""
    # "WaistLFront" is "waistlfront", "lwaistfront", and without the place on the part "lwaist"
    tokens = [token.lower() for token in _TOKEN.findall(_RIG_PREFIX.sub("", name))]
    side = next((n for n, token in enumerate(tokens) if token in ("l", "r", *SIDES)), -1)
    if side < 0 and (compact := re.fullmatch(r"(.+)(left|right)", tokens[-1] if tokens else "")):
        tokens, side = [*tokens[:-1], compact[1], compact[2]], len(tokens)
    if side > 0:
        tokens = [tokens.pop(side), *tokens]
    where, start = load_markers()["where"][species].split(), int(side >= 0)
    short = [*tokens[:start], *([t for t in tokens[start:] if t not in where] or tokens[start : start + 1])]
    return list(dict.fromkeys((reduce_word(name), "".join(tokens), "".join(short))))


def look_up(word: str, table: Mapping[str, str]) -> str:
    """Return the body part of a word ("lknee", "lknee2"), or ``""``."""
    return table.get(word) or table.get(word.rstrip("0123456789"), "")


def name_bones(words: set[str]) -> bool:
    """Return True if joints have the names of bones."""
    # so have BVH files, which have an upper leg; markers on thigh and shin come with the knee's
    limbs = {"lthigh", "lshin", "lfoot"} <= words and not any("kne" in word for word in words)
    legs = {word for word in words if re.fullmatch(r"(l|r|left|right)(upleg|upperleg|legupper)\d*", word)}
    return bool(legs) or limbs or {"lthigh", "lcalf"} <= words


Species = Literal["human", "dog"]

SIDES = ("left", "right")


def _list_limbs(*limbs: str) -> list[str]:
    return [f"{side}_{part}" for limb in limbs for side in SIDES for part in limb.split()]


HUMAN_PARTS = ("head", "torso", *_list_limbs("upper_arm forearm hand", "thigh shank foot"))
"""Parts of a person."""

DOG_PARTS = (
    *("head", "neck", "trunk", "tail"),
    *_list_limbs("fore_upper fore_lower fore_paw", "hind_upper hind_lower hind_paw"),
)
"""Parts of an animal; upper: scapula + humerus or femur, lower: forearm or tibia + metatarsus."""

BODY_CENTRE_PARTS = ("torso", "trunk")
"""Parts whose mean is the centre of the body. Without them, it is the mean of all points."""

FOOT_PARTS = tuple(p for p in (*HUMAN_PARTS, *DOG_PARTS) if p.endswith(("_foot", "_paw")))
"""Parts that stand on the floor."""


def list_points(words: str) -> dict[str, str]:
    """Return parts by point, where ``*`` in both stands for the two sides."""
    sided = ((word, SIDES if "*" in word else ("",)) for word in words.split())
    return dict(word.replace("*", side).split(":") for word, sides in sided for side in sides)


BOULIC_PARTS = list_points(
    "base:torso neck:torso head:head *_shoulder:torso *_elbow:*_upper_arm *_hand:*_hand "
    "*_hip:torso *_knee:*_thigh *_ankle:*_shank *_toe:*_foot"
)
"""The 17 points of the Boulic walk. A joint belongs to the part above, like a skin marker on it."""

_ONLY_ANIMALS = re.compile(r"tail|paw|withers|hock|stifle|fetlock|muzzle|snout|hoof")
MIN_HUMAN_PARTS = 10
"""Minimum number of named parts, of 14, from which names alone identify a person."""


def strip_subject(marker: str) -> str:
    """Return a marker name without its subject: ``"liu:LFIN"`` is ``"LFIN"``."""
    return marker.rsplit(":", 1)[-1].strip()


def find_part(name: str, species: Species = "human") -> str:
    """Return the body part of a marker or joint name; find_parts resolves more names."""
    return _find(strip_subject(name), species, starts=False)


@lru_cache(2**14)
def _find(name: str, species: Species, *, starts: bool) -> str:
    words, bones = _list_words(species, "sided", "midline"), _list_words(species, "starts")
    first, second = (bones, words) if starts else (words, bones)
    for word in list_spellings(name, species):
        bone = word.removesuffix("end") if word.endswith("end") else ""  # of a free end: "lefthandend"
        if part := look_up(word, first) or look_up(word, second) or look_up(bone, words):
            return part
    return ""


def guess_species(names: Iterable[str]) -> Species | Literal[""]:
    """Guess the species from marker or joint names."""
    names = list(names)
    if any(_ONLY_ANIMALS.search(reduce_word(strip_subject(name))) for name in names):
        return "dog"
    return "human" if len(set(_find_species_parts(names, "human")) - {""}) >= MIN_HUMAN_PARTS else ""


def find_parts(names: Iterable[str]) -> list[str]:
    """Return the body parts of one body's names. The part of an unknown name is ``""``."""
    names = list(names)
    return _find_species_parts(names, guess_species(names) or "human")


def _find_species_parts(names: Sequence[str], species: Species) -> list[str]:
    names = [strip_subject(name) for name in names]
    if len(names) > 1:  # a common prefix of all names, up to a separator, is removed
        first, last = min(names), max(names)
        apart = (i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b)
        same = next(apart, min(len(first), len(last)))
        start = max(first.rfind(mark, 0, same) for mark in "_ .-") + 1
        names = [name[start:] for name in names]
    starts = name_bones({reduce_word(name) for name in names})
    return [_find(name, species, starts=starts) for name in names]


def complete_set(markers: Iterable[str]) -> frozenset[str]:
    """Return the marker set of which at least 90 % are present, or an empty one."""
    names = {strip_subject(marker).upper() for marker in markers}
    found = [known for known in list_marker_sets().values() if len(known & names) >= 0.9 * len(known)]
    return max(found, key=lambda known: len(known & names), default=frozenset())


LEG_SHARE = 0.245 + 0.246
"""Hip over knee to ankle over stature (Drillis and Contini 1966; Winter 2009, figure 4.1)."""
SKULL_SHARE = 0.93
"""Height of the eyes over stature (Drillis and Contini 1966): a lower head lacks the skull."""
MODEL_JOINTS = {"spine1", "spinebase"}
"""Joints of SMPL and Kinect, whose other joints have names that markers have, too."""
PERSON_M = (0.6, 2.4)
UPRIGHT = 0.75
"""Minimum height of standing withers over their 95th percentile, and of hips over the legs."""


def measure_height(position: FloatArray, names: Sequence[str], parts: Sequence[str]) -> tuple[float, str]:
    """Measure the height of a body. Shapes: position (T, P, 3)."""
    # the height of a person with a head is that of its highest point
    z = position[:, :, 2]
    if "trunk" in parts:
        # of the withers above the lower fore paw: the median of the frames in which it stands
        trunk = [i for i, part in enumerate(parts) if part == "trunk"]
        named = [i for i in trunk if "withers" in reduce_word(strip_subject(names[i]))]
        fore = [i for i, part in enumerate(parts) if part.endswith("_fore_paw")]
        above = z[:, named or trunk].max(axis=1) - (z[:, fore].min(axis=1) if fore else 0.0)
        return float(np.median(above[above >= UPRIGHT * np.percentile(above, 95)])), ""
    head = [i for i, part in enumerate(parts) if part == "head"]
    leg_m, hip_m = measure_leg_length(position, names)
    height_m = leg_m / LEG_SHARE
    if head:
        top_m = float(np.median(z[:, head].max(axis=1)))
        words = {reduce_word(strip_subject(name)) for name in names}
        is_skeleton = name_bones(words) or bool(words & MODEL_JOINTS)
        if not (is_skeleton and top_m < SKULL_SHARE * height_m < PERSON_M[1] and hip_m > UPRIGHT * leg_m):
            return top_m, ""
        return height_m, (
            f"the joints of the head end at {top_m:.2f} m, below the top of the head of a person with legs of "
            f"{leg_m:.2f} m: height_m = {height_m:.2f} m is estimated from the legs"
        )
    if PERSON_M[0] < height_m < PERSON_M[1] and hip_m > UPRIGHT * leg_m:
        return height_m, (
            f"no head among the points: height_m = {height_m:.2f} m is estimated from the legs, {leg_m:.2f} m from hip "
            "to ankle"
        )
    return float("nan"), "no head among the points, and no hips, knees and ankles: the height is unknown"


def measure_leg_length(position: FloatArray, names: Sequence[str]) -> tuple[float, float]:
    """Measure hip to knee to ankle, and hip height, m, of both legs; NaN without a whole one."""
    spellings = [list_spellings(strip_subject(name)) for name in names]
    bones = name_bones({words[0] for words in spellings})  # "UpperLeg" is not the leg, whose start is the knee
    joints = load_markers()["legs"]["bones" if bones else "joints"]
    spellings = [[word.rstrip("0123456789") for word in words[: 1 if bones else None]] for words in spellings]
    lengths, hips = [], []
    for side in ("left", "right"):
        sided = [{start + name for name in one.split() for start in (side, side[0])} for one in joints]
        points = [[i for i, words in enumerate(spellings) if allowed.intersection(words)] for allowed in sided]
        if all(points):
            hip, knee, ankle = (position[:, these].mean(axis=1) for these in points)
            links = (np.linalg.norm(hip - knee, axis=1), np.linalg.norm(knee - ankle, axis=1))
            lengths.append(sum(float(np.median(link)) for link in links))
            hips.append(float(np.median(hip[:, 2])))
    return (float(np.mean(lengths)), float(np.mean(hips))) if lengths else (float("nan"), float("nan"))


RIGID_M = 0.008
"""Maximum spread of the distance between two points of one segment. Skin movement is smaller."""
SWAY_WEIGHT = 40.0
"""Weight of a distance's variation relative to its mean: points across a joint are no bone."""
FEWEST_FRAMES, MOST_FRAMES = 2, 64
TIES = 9
"""Number of decimals to which costs and lengths in m are compared."""


def find_bones(position_m: npt.ArrayLike) -> npt.NDArray[np.int32]:
    """Return the bones of a moving body: a tree of short branches of constant length."""
    # the minimum spanning tree of mean(d) + 40 sd(d) with the distance d of two points over time
    from scipy.sparse.csgraph import minimum_spanning_tree

    points = np.asarray(position_m, dtype=np.float64)
    points = points[:: max(1, points.shape[0] // MOST_FRAMES)]
    known = np.flatnonzero(np.isfinite(points).all(axis=-1).sum(axis=0) >= min(FEWEST_FRAMES, points.shape[0]))
    distance = np.linalg.norm(points[:, known, None] - points[:, None, known], axis=-1)
    seen = np.isfinite(distance)
    count = np.maximum(seen.sum(axis=0), 1)
    mean = np.where(seen, distance, 0.0).sum(axis=0) / count
    sway = np.sqrt(np.where(seen, (distance - mean) ** 2, 0.0).sum(axis=0) / count)
    # pairs that are never seen together have no cost, hence no branch
    cost = np.where(seen.any(axis=0), np.maximum(mean + SWAY_WEIGHT * sway, 1e-9), 0.0)
    cost = np.round(cost, TIES)  # both sides of a body have equal costs, whatever the heading
    tree = minimum_spanning_tree(np.triu(cost, k=1)).tocoo()
    pairs = np.sort(known[np.stack([tree.row, tree.col], axis=1)], axis=1)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].astype(np.int32)


NEAR_POINTS = 2
"""Number of rigid neighbours of each point with distances that are kept, besides the bones."""


def find_rigid_pairs(position: FloatArray) -> npt.NDArray[np.int32]:
    """Return bones and neighbouring points of one segment, shape (B, 2)."""
    some = position[:: max(1, len(position) // MOST_FRAMES)]
    distance = np.linalg.norm(some[:, :, np.newaxis] - some[:, np.newaxis], axis=-1)
    near = np.where(np.round(distance.std(axis=0), TIES) < RIGID_M, np.round(distance.mean(axis=0), TIES), np.inf)
    np.fill_diagonal(near, np.inf)
    nearest = np.argsort(near, axis=1, kind="stable")[:, :NEAR_POINTS]
    points, ranks = np.nonzero(np.isfinite(np.take_along_axis(near, nearest, axis=1)))
    pairs = np.sort(np.stack([points, nearest[points, ranks]], axis=1), axis=1)
    return np.unique(np.concatenate([find_bones(position), pairs]), axis=0).astype(np.int32)


def restore_lengths(
    position: FloatArray,
    pairs: npt.NDArray[np.int32],
    wanted_m: FloatArray,
    weights: FloatArray,
    *,
    ridge: float,
    steps: int,
) -> FloatArray:
    """Move points as little as possible to wanted pair distances, by Newton's method."""
    if not len(pairs):
        return position
    ends = np.zeros((len(pairs), len(weights)))
    rows = np.arange(len(pairs))
    ends[rows, pairs[:, 0]], ends[rows, pairs[:, 1]] = 1.0, -1.0
    light = ends.T / weights[:, np.newaxis]
    coupling = ends @ light
    position = position.copy()
    for _ in range(steps):
        apart = position[:, pairs[:, 0]] - position[:, pairs[:, 1]]
        length = np.maximum(np.linalg.norm(apart, axis=2), 1e-9)
        along = apart / length[..., np.newaxis]
        normal = coupling * (along @ along.transpose(0, 2, 1))
        normal[:, rows, rows] += ridge
        pull = np.linalg.solve(normal, (wanted_m - length)[..., np.newaxis])
        position += light @ (pull * along)
    return position


def measure_pair_lengths(position: FloatArray, pairs: npt.NDArray[np.int32]) -> FloatArray:
    """Return the distances of point pairs over time."""
    return np.asarray(np.linalg.norm(position[:, pairs[:, 0]] - position[:, pairs[:, 1]], axis=2))
