"""Body parts of known markers and joints. Also the height of a body from them (E-01).

There are two kinds of names. :data:`PERSON_WORDS` and :data:`ANIMAL_WORDS` contain markers, and joints with the name of
the joint (knee, wrist) or of the bone that ends there (femur, humerus in ASF/AMC). Joints of BVH skeletons have the
name of the bone that starts there (``LeftLeg`` is the knee): :data:`PERSON_STARTS` and :data:`ANIMAL_STARTS`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


_PERSON_MIDLINE = {
    "head": "head headtop nose jaw chin forehead eyes",
    "torso": "c7 cv7 t8 tv8 t10 t12 l5 s2 clav strn ster sternum sxs snj sacr sac sacrum scr vsac rbac rbak lbac lbak "
    "bac7 neck upperneck lowerneck lowerback upperback thorax base pelvis hip hips root jointroot bip spine chest "
    "belly abdomen mtop mbac pv",
}
_PERSON_SIDED = {
    "head": "fhd bhd hd hdf hdb tempd eye ear eyesmplhf",
    "torso": "sho should shoulder acromion clavicle clav collar sacwand asi asis ias psi psis ips fwt bwt wt hip hjc "
    "hipjoint crest iliaccrest scap scapula saj off pv",
    "upper_arm": "upa uarm elb elbow ejc hle hme um1 upperarm arm biceps humerus",
    "forearm": "frm fra wra wrb wri wrist wjc rsp uhe uls rds forearm lowerarm radius ulna",
    "hand": "fin hm2 hm5 hand finger fingers fingerbase palm thumb index middle ring pinky handthumb handindex "
    "handmiddle handring handpinky handfinger glove",
    "thigh": "thi th th1 th2 th3 th4 t1 t2 t3 t4 thigh kne knee knein kneemedial knm kjc knee1 knee2 bar1 fle fme lfc "
    "mfc grt gtr ftc fax antfem postfem fem femur wand1",
    "shank": "tib tb1 tb2 tb3 tib1 shn sha sh1 sh2 sh3 sh4 shin calf ank ankin ankle anklemedial ajc anm mall lma mma "
    "lmal mmal att fal tam ttc ttb tt hf bar2 sk sk1 sk2 sk3 sk4 anttib posttib tibia shank leg lowerleg wand2",
    "foot": "hee heel toe toes toebase toe1 mt1 mt2 mt5 met met1 mtp cal fcc fm1 fm2 fm5 pm1 ft ft1 ft2 ft3 foot ball "
    "lat",
}
_PERSON_STARTS = {
    "torso": "upleg upperleg legupper thigh upperarm arm uparm clavicle shoulder hip hipjoint",
    "upper_arm": "forearm lowerarm",
    "forearm": "hand",
    "thigh": "leg lowerleg legleg calf shin",
    "shank": "foot",
}
_ANIMAL_MIDLINE = {
    "head": "head headtop nose jaw muzzle snout forehead poll chin",
    "neck": "neck neckbase throat",
    "trunk": "hips hip pelvis root bip base spine withers chest back belly rump croup loin sternum thorax ribs trunk "
    "body tailbase sacrum",
    "tail": "tail tailmiddle tailtip",
}
_ANIMAL_SIDED = {
    "head": "ear eye",
    "trunk": "hip hipjoint crest iliaccrest asis psis",
    "fore_upper": "shoulder scapula clavicle clav arm upperarm humerus elbow frontelbow foreelbow",
    "fore_lower": "forearm lowerarm radius ulna carpus wrist carpal metacarpus",
    "fore_paw": "hand finger fingers forepaw frontpaw forefoot frontfoot forehoof fronthoof foretoe fronttoe",
    "hind_upper": "thigh upleg upperleg legupper femur knee stifle",
    "hind_lower": "leg lowerleg tibia shank hock ankle tarsus tarsal metatarsus heel calcaneus",
    "hind_paw": "foot toe toes toebase mtp hindpaw hindfoot rearpaw rearfoot backpaw hindhoof hindtoe",
}
_HOOVES = {
    f"h{end[0]}{side[0]}": f"{side}_{'fore' if end == 'front' else 'hind'}_paw"
    for end in ("front", "hind")
    for side in ("left", "right")
}
"""Hooves of the Vienna Horse Data Collection: HFL is the hoof front left, HHR the hoof hind right."""
_ANIMAL_STARTS = {
    "trunk": "shoulder clavicle clav upleg upperleg legupper thigh",
    "fore_upper": "arm upperarm forearm lowerarm",
    "fore_lower": "hand",
    "hind_upper": "leg lowerleg",
    "hind_lower": "leg1 foot",
}
_UNSIDED_PARTS = ("head", "neck", "torso", "trunk", "tail")


def _list_words(midline: Mapping[str, str], sided: Mapping[str, str]) -> dict[str, str]:
    """Return body parts by plain word."""
    # each sided word is prefixed with all spellings of its side. The words of the midline follow.
    table: dict[str, str] = {}
    for part, names in sided.items():
        for side, letter in (("left", "l"), ("right", "r")):
            full = part if part in _UNSIDED_PARTS else f"{side}_{part}"
            table |= {f"{start}{name}": full for name in names.split() for start in (letter, side)}
    for part, names in midline.items():
        table |= dict.fromkeys(names.split(), part)
    return table


PERSON_WORDS = _list_words(_PERSON_MIDLINE, _PERSON_SIDED)
ANIMAL_WORDS = _list_words(_ANIMAL_MIDLINE, _ANIMAL_SIDED) | _HOOVES
PERSON_STARTS = _list_words({}, _PERSON_STARTS)
ANIMAL_STARTS = _list_words({}, _ANIMAL_STARTS)

_RIG_PREFIX = re.compile(r"^(b_+|bip\d+[ _]+|mixamorig_?)(?=.)", re.IGNORECASE)
_SIDE_BEHIND = re.compile(r"^(.*[A-Za-z0-9])[_. -]([LlRr])(\d*)$|^(.*[a-z])([LR])(\d*)$")
_END = re.compile(r"[_. -]?(end[_ ]?site|end|site|nub)$", re.IGNORECASE)


def reduce_word(name: str) -> str:
    """Reduce a name to lower-case letters and digits."""
    # the prefix of a rig is removed. "UpperLeg_L" becomes "lupperleg".
    name, is_end = _END.subn("", _RIG_PREFIX.sub("", name))
    behind = _SIDE_BEHIND.match(name)
    if behind:
        stem, side, number = behind.groups()[:3] if behind[1] else behind.groups()[3:]
        name = f"{side}{stem}{number}"
    return re.sub(r"[^a-z0-9]", "", name.lower()) + ("end" if is_end else "")


def look_up(word: str, table: Mapping[str, str]) -> str:
    """Return the body part of a word, with or without a number."""
    # an example is "lknee2". The result is "" if the word is unknown.
    return table.get(word) or table.get(word.rstrip("0123456789"), "")


def name_bones(words: set[str]) -> bool:
    """Return True if joints have the names of bones."""
    # that is so in BVH files, which have an upper leg
    legs = {word for word in words if re.fullmatch(r"(l|r|left|right)(upleg|upperleg|legupper)\d*", word)}
    return bool(legs) or {"lthigh", "lcalf"} <= words


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
"""Parts of a four-legged animal; "upper" is scapula + humerus or femur, "lower" forearm or tibia + metatarsus."""

BODY_CENTRE_PARTS = ("torso", "trunk")
"""Parts that define the centre of the body by their mean position. Without them, it is the mean of all points."""

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
"""The 17 points of the Boulic walking model. A joint belongs to the part above it, like a skin marker on it."""

_PART_OF = {
    "human": (
        {part.replace("_", ""): part for part in HUMAN_PARTS}
        | PERSON_WORDS
        | {key.replace("_", ""): part for key, part in BOULIC_PARTS.items()},
        PERSON_STARTS,
    ),
    "dog": ({part.replace("_", ""): part for part in DOG_PARTS} | ANIMAL_WORDS, ANIMAL_STARTS),
}
_ONLY_ANIMALS = re.compile(r"tail|paw|withers|hock|stifle|fetlock|muzzle|snout|hoof")
MIN_HUMAN_PARTS = 10
"""Minimum number of named parts, of the 14 of a person, from which names alone identify a person."""

_CMU_SIDED = "FHD BHD SHO UPA ELB FRM WRA WRB FIN FWT BWT THI KNE SHN ANK HEE TOE MT5"
_PIG_SIDED = "FHD BHD SHO UPA ELB FRA WRA WRB FIN ASI PSI THI KNE TIB ANK HEE TOE"
KNOWN_SETS: Mapping[str, frozenset[str]] = {
    "CMU 41": frozenset(
        ["C7", "T10", "CLAV", "STRN", "RBAC", *(side + name for side in "LR" for name in _CMU_SIDED.split())]
    ),
    "Plug-in Gait": frozenset(
        ["C7", "T10", "CLAV", "STRN", "RBAK", *(side + name for side in "LR" for name in _PIG_SIDED.split())]
    ),
}
"""Physical markers of whole-body sets, without subject prefix."""


def strip_subject(marker: str) -> str:
    """Return a marker name without its subject: ``"liu:LFIN"`` is ``"LFIN"``."""
    return marker.rsplit(":", 1)[-1].strip()


def find_part(name: str, species: Species = "human") -> str:
    """Return the body part of a marker or joint name."""
    # find_parts resolves more names, because it uses the whole set
    return _find(reduce_word(strip_subject(name)), species, starts=False)


def _find(word: str, species: Species, *, starts: bool) -> str:
    words, bones = _PART_OF[species]
    first, second = (bones, words) if starts else (words, bones)
    bone = word.removesuffix("end") if word.endswith("end") else ""  # of a free end: "lefthandend"
    return look_up(word, first) or look_up(word, second) or look_up(bone, words)


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
    words = [reduce_word(name) for name in names]
    starts = name_bones(set(words))
    return [_find(word, species, starts=starts) for word in words]


def complete_set(markers: Iterable[str]) -> frozenset[str]:
    """Return the known marker set that the markers contain."""
    # at least 90 % of the set must be present. The result is empty if there is no such set.
    names = {strip_subject(marker).upper() for marker in markers}
    found = [known for known in KNOWN_SETS.values() if len(known & names) >= 0.9 * len(known)]
    return max(found, key=lambda known: len(known & names), default=frozenset())


LEG_SHARE = 0.245 + 0.246
"""Length from hip to knee and from knee to ankle over stature (Drillis and Contini 1966, as in
Winter 2009, figure 4.1)."""
SKULL_SHARE = 0.93
"""Height of the eyes over stature (Drillis and Contini 1966). A skeleton's head that ends lower lacks the skull."""
PERSON_M = (0.6, 2.4)
UPRIGHT = 0.75
"""Minimum height of an animal's withers, relative to their 95th percentile, in the frames in which it stands, and
minimum height of a person's hips relative to the length of the leg (those of a rat are lower)."""
MARKERS_OF_JOINTS = (
    "hip hjc hipjoint grt gtr ftc trochanter greatertrochanter",
    "kne knee kjc kneelat kneelateral kneemed kneemedial kneein knm fle fme lfc mfc",
    "ank ankle ajc anklelat anklelateral anklemed anklemedial ankin anm lma mma mall lmal mmal fal tam",
)
"""Names of hip, knee and ankle without the side: of markers, and of joints with the name of the joint."""
JOINTS_OF_BONES = ("upleg upperleg legupper thigh", "leg lowerleg calf shin", "foot")
"""Names of hip, knee and ankle without the side, if joints have the name of the bone that starts there."""


def measure_height(position: FloatArray, names: Sequence[str], parts: Sequence[str]) -> tuple[float, str]:
    """Measure the height of a body. Shapes: position (T, P, 3)."""
    # the height of a person with a head is that of its highest point
    z = position[:, :, 2]
    if "trunk" in parts:
        # of the withers above the lower fore paw: the median over the frames in which the animal stands
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
        is_skeleton = name_bones({reduce_word(strip_subject(name)) for name in names})
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
    """Measure leg length and hip height, m."""
    # the leg is from hip over knee to ankle. Values are means of both legs, or NaN if the names
    # include no whole leg.
    words = [reduce_word(strip_subject(name)) for name in names]
    joints = JOINTS_OF_BONES if name_bones(set(words)) else MARKERS_OF_JOINTS
    words = [word.rstrip("0123456789") for word in words]
    lengths, hips = [], []
    for side in ("left", "right"):
        sided = [{start + name for name in one.split() for start in (side, side[0])} for one in joints]
        points = [[i for i, word in enumerate(words) if word in allowed] for allowed in sided]
        if all(points):
            hip, knee, ankle = (position[:, these].mean(axis=1) for these in points)
            bones = (np.linalg.norm(hip - knee, axis=1), np.linalg.norm(knee - ankle, axis=1))
            lengths.append(sum(float(np.median(bone)) for bone in bones))
            hips.append(float(np.median(hip[:, 2])))
    return (float(np.mean(lengths)), float(np.mean(hips))) if lengths else (float("nan"), float("nan"))
