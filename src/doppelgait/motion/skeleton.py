"""Body parts, and the markers and joints of known sets with the part that each belongs to."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

HUMAN_PARTS = (
    "head", "torso",
    "left_upper_arm", "left_forearm", "left_hand", "right_upper_arm", "right_forearm", "right_hand",
    "left_thigh", "left_shank", "left_foot", "right_thigh", "right_shank", "right_foot",
)  # fmt: skip
"""Parts of a person."""

DOG_PARTS = (
    "head", "neck", "trunk", "tail",
    "left_fore_upper", "left_fore_lower", "left_fore_paw", "right_fore_upper", "right_fore_lower", "right_fore_paw",
    "left_hind_upper", "left_hind_lower", "left_hind_paw", "right_hind_upper", "right_hind_lower", "right_hind_paw",
)  # fmt: skip
"""Parts of a four-legged animal; "upper" is scapula + humerus or femur, "lower" forearm or tibia + metatarsus."""

BODY_CENTRE_PARTS = ("torso", "trunk")
"""Parts whose mean position is the centre of the body; without any, the mean of all points is."""

FOOT_PARTS = tuple(p for p in (*HUMAN_PARTS, *DOG_PARTS) if p.endswith(("_foot", "_paw")))
"""Parts that stand on the floor."""

BOULIC_PARTS = {
    "base": "torso", "neck": "torso", "head": "head",
    "left_shoulder": "torso", "right_shoulder": "torso",
    "left_elbow": "left_upper_arm", "right_elbow": "right_upper_arm",
    "left_hand": "left_hand", "right_hand": "right_hand",
    "left_hip": "torso", "right_hip": "torso",
    "left_knee": "left_thigh", "right_knee": "right_thigh",
    "left_ankle": "left_shank", "right_ankle": "right_shank",
    "left_toe": "left_foot", "right_toe": "right_foot",
}  # fmt: skip
"""The 17 points of the Boulic walking model. A joint counts to the part above it, as a skin marker there does."""

_MIDLINE = {
    "head": "head head1 head2 head3 head4",
    "torso": "c7 cv7 t8 tv8 t10 t12 clav strn ster sternum sxs snj sacr sac sacrum scr vsac rbac rbak lbac lbak bac7 "
    "neck base pelvis spine mtop mbac",
}
_SIDED = {
    "head": "fhd bhd hd hdf hdb tempd",
    "torso": "sho should shoulder sacwand asi asis ias psi psis ips fwt bwt wt hip crest scap saj off",
    "upper_arm": "upa elb elbow hle hme um1 upperarm arm",
    "forearm": "frm fra wra wrb wri wrist rsp uhe uls rds forearm",
    "hand": "fin hm2 hm5 hand finger palm",
    "thigh": "thi th1 th2 th3 th4 t1 t2 t3 t4 thigh kne knee knein knm knee1 knee2 bar1 fle fme lfc mfc grt ftc fax "
    "antfem postfem fem wand1",
    "shank": "tib tb1 tb2 tb3 tib1 shn sha sh1 sh2 ank ankin ankle anm mall lma mma lmal mmal att fal tam ttc ttb bar2 "
    "sk1 sk2 sk3 sk4 anttib posttib shank wand2",
    "foot": "hee heel toe toe1 mt1 mt2 mt5 met met1 mtp cal fcc fm1 fm2 fm5 pm1 ft1 ft2 ft3 foot lat",
}
_UNSIDED_PARTS = ("head", "torso")


def _build_parts() -> dict[str, str]:
    table = {key.replace("_", ""): part for key, part in BOULIC_PARTS.items()}
    for part, names in _SIDED.items():
        for side, letter in (("left", "l"), ("right", "r")):
            full = part if part in _UNSIDED_PARTS else f"{side}_{part}"
            table |= {f"{start}{name}": full for name in names.split() for start in (letter, side)}
    for part, names in _MIDLINE.items():
        table |= dict.fromkeys(names.split(), part)
    return table | {name: part for part in HUMAN_PARTS for name in (part.replace("_", ""),)}


_PART_OF = _build_parts()

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


def bare_name(marker: str) -> str:
    """Marker name without its subject: ``"liu:LFIN"`` gives ``"LFIN"``."""
    return marker.rsplit(":", 1)[-1].strip()


def part_of(marker: str) -> str:
    """Body part of a named marker or joint of a person.

    Parameters
    ----------
    marker : str
        Name in any case, with or without subject prefix, spaces, dots and underscores (``"liu:LFHD"``, ``"r heel"``).

    Returns
    -------
    str
        One of :data:`HUMAN_PARTS`, or ``""`` when the name is not known.
    """
    return _PART_OF.get(re.sub(r"[^a-z0-9]", "", bare_name(marker).lower()), "")


def complete_set(markers: Iterable[str]) -> frozenset[str]:
    """Names of the known set that these markers (nearly) complete, at least 90 %; empty when there is none.

    Parameters
    ----------
    markers : iterable of str
        Marker names, with or without subject prefix.
    """
    names = {bare_name(marker).upper() for marker in markers}
    found = [known for known in KNOWN_SETS.values() if len(known & names) >= 0.9 * len(known)]
    return max(found, key=lambda known: len(known & names), default=frozenset())
