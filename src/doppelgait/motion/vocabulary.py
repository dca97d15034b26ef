"""The words of marker sets and joint skeletons, and the body part that each stands for.

Two kinds of names exist. Markers, and joints named after the joint (knee, wrist) or after the bone that ends there
(femur, humerus in ASF/AMC), are in :data:`PERSON_WORDS` and :data:`ANIMAL_WORDS`. Joints of BVH skeletons carry the
name of the bone that starts there: ``LeftLeg`` is the knee; :data:`PERSON_STARTS` and :data:`ANIMAL_STARTS` say so.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

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
_ANIMAL_STARTS = {
    "trunk": "shoulder clavicle clav upleg upperleg legupper thigh",
    "fore_upper": "arm upperarm forearm lowerarm",
    "fore_lower": "hand",
    "hind_upper": "leg lowerleg",
    "hind_lower": "leg1 foot",
}
_UNSIDED_PARTS = ("head", "neck", "torso", "trunk", "tail")


def _words(midline: Mapping[str, str], sided: Mapping[str, str]) -> dict[str, str]:
    """Part by plain word: every sided word with each spelling of its side before it, then the words of the midline."""
    table: dict[str, str] = {}
    for part, names in sided.items():
        for side, letter in (("left", "l"), ("right", "r")):
            full = part if part in _UNSIDED_PARTS else f"{side}_{part}"
            table |= {f"{start}{name}": full for name in names.split() for start in (letter, side)}
    for part, names in midline.items():
        table |= dict.fromkeys(names.split(), part)
    return table


PERSON_WORDS = _words(_PERSON_MIDLINE, _PERSON_SIDED)
ANIMAL_WORDS = _words(_ANIMAL_MIDLINE, _ANIMAL_SIDED)
PERSON_STARTS = _words({}, _PERSON_STARTS)
ANIMAL_STARTS = _words({}, _ANIMAL_STARTS)

_RIG_PREFIX = re.compile(r"^(b_+|bip\d+[ _]+|mixamorig_?)(?=.)", re.IGNORECASE)
_SIDE_BEHIND = re.compile(r"^(.*[A-Za-z0-9])[_. -]([LlRr])(\d*)$|^(.*[a-z])([LR])(\d*)$")
_END = re.compile(r"[_. -]?(end[_ ]?site|end|site|nub)$", re.IGNORECASE)


def plain_word(name: str) -> str:
    """Name in small letters and digits, its side in front, without a rig's prefix: ``"UpperLeg_L"`` is "lupperleg".

    Parameters
    ----------
    name : str
        Name without subject prefix.
    """
    name, is_end = _END.subn("", _RIG_PREFIX.sub("", name))
    behind = _SIDE_BEHIND.match(name)
    if behind:
        stem, side, number = behind.groups()[:3] if behind[1] else behind.groups()[3:]
        name = f"{side}{stem}{number}"
    return re.sub(r"[^a-z0-9]", "", name.lower()) + ("end" if is_end else "")


def look_up(word: str, table: Mapping[str, str]) -> str:
    """Part of a word, with its number (``"lknee2"``) or else without; ``""`` when neither is known."""
    return table.get(word) or table.get(word.rstrip("0123456789"), "")


def without_end(word: str) -> str:
    """Name of the bone whose free end a word names (``"lefthandend"``), ``""`` for any other word."""
    return word.removesuffix("end") if word.endswith("end") else ""


def starts_bones(words: set[str]) -> bool:
    """Whether joints carry the names of the bones that start there, as in BVH files: there is an upper leg."""
    legs = {word for word in words if re.fullmatch(r"(l|r|left|right)(upleg|upperleg|legupper)\d*", word)}
    return bool(legs) or {"lthigh", "lcalf"} <= words
