"""Whether classes that declare motion show any, and classes of nobody show none."""

from __future__ import annotations

from typing import Any

import pandas as pd

from doppelgait.dataset.verify.contents import Contents
from doppelgait.dataset.verify.report import Check
from doppelgait.dataset.verify.truth import SHOWN_DB, column, off_as_a_whole

LEAST_SEEN = 0.5
"""Share of a class's rows in which its targets must be seen; none of ten rows is beyond chance."""
MOVING_MPS = 0.2
MOST_SEEN_OF_NOBODY = 0.05


def check_movers(contents: Contents) -> Check:
    """A class that declares motion but is only noise, or mostly, fails; a class of nobody that moves is a warning.

    A row shows something where the strongest Doppler cell of its columns stands 3 dB and more above the noise floor
    (``quality_snr_mu_db``); a target that no track follows shows nothing. Noise alone is below 0 dB where the gate
    averages many range bins, and at most ln 1000 + 0.58 - 1 = 6.5 (8 dB) in a single bin with 1000 cells; there the
    check of the torso velocity, which noise meets by chance in 2 % of rows, decides.
    """
    if contents.measured:
        return Check("movers", "skipped", "imported recordings declare no motion")
    index = contents.index
    seen = column(index, "quality_snr_mu_db") >= SHOWN_DB
    moving = seen & (abs(column(index, "feature_torso_velocity_mps")) >= MOVING_MPS)
    nobody = (index["source"] == "none").to_numpy(dtype=bool)
    table = pd.DataFrame({"label": index["label"], "nobody": nobody, "seen": seen, "moving": moving})
    empty, odd, numbers = [], [], {}
    for (label, none), part in table.groupby(["label", "nobody"]):
        share = float(part["moving" if none else "seen"].mean())
        numbers[str(label)] = {"rows": len(part), "nobody": bool(none), "share_seen": share}
        if none and share > MOST_SEEN_OF_NOBODY:
            odd.append(f"{label} declares nobody, but something moves in {100 * share:.0f} % of {len(part)} rows")
        elif not none and off_as_a_whole(int(part["seen"].sum()), len(part), LEAST_SEEN):
            empty.append(f"{label} declares motion, but only {100 * share:.0f} % of {len(part)} rows show any")
    return _check(empty, odd, numbers)


def _check(empty: list[str], odd: list[str], numbers: dict[str, Any]) -> Check:
    if empty:
        return Check("movers", "failed", "noise instead of motion: " + "; ".join([*empty, *odd]), numbers)
    if odd:
        return Check("movers", "warning", "; ".join(odd), numbers)
    listed = ", ".join(f"{label} {100 * found['share_seen']:.0f} %" for label, found in numbers.items())
    return Check("movers", "passed", f"rows that show something that moves: {listed}", numbers)
