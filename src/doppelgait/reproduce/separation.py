"""How far apart the classes of a feature table lie, and how often a step frequency is wrong."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    import pandas as pd

FloatArray = npt.NDArray[np.float64]


def _known(values: npt.ArrayLike) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    return np.asarray(array[np.isfinite(array)])


def cohens_d(first: npt.ArrayLike, second: npt.ArrayLike) -> float:
    """Difference of the means over the pooled standard deviation; NaN with fewer than two values in a class.

    Parameters
    ----------
    first, second : array_like
        Values of the two classes; NaN are left out.

    Returns
    -------
    float
        ``(mean_1 - mean_2) / sqrt(((n_1 - 1) s_1^2 + (n_2 - 1) s_2^2) / (n_1 + n_2 - 2))``.
    """
    a, b = _known(first), _known(second)
    if min(a.size, b.size) < 2:
        return math.nan
    pooled = ((a.size - 1) * a.var(ddof=1) + (b.size - 1) * b.var(ddof=1)) / (a.size + b.size - 2)
    return float((a.mean() - b.mean()) / math.sqrt(pooled)) if pooled > 0 else math.nan


def roc_area(first: npt.ArrayLike, second: npt.ArrayLike) -> float:
    """Area under the ROC curve: share of pairs in which the first class has the larger value, ties counted half.

    0.5 says nothing about the class, 0 and 1 tell it apart; NaN are left out, NaN without a value in either class.
    """
    a, b = _known(first), np.sort(_known(second))
    if not a.size or not b.size:
        return math.nan
    below = np.searchsorted(b, a, side="left") + np.searchsorted(b, a, side="right")
    return float(below.sum() / (2.0 * a.size * b.size))


def separation_table(table: pd.DataFrame, features: Sequence[str], *, classes: tuple[str, str]) -> pd.DataFrame:
    """Median of every feature in both classes, Cohen's d and area under the ROC curve, by method.

    Parameters
    ----------
    table : DataFrame
        With the columns ``method``, ``label`` and the features.
    features : sequence of str
    classes : (str, str)
        d and the area are those of the first against the second.
    """
    import pandas as pd

    rows = []
    for method, part in table.groupby("method", sort=False):
        for name in features:
            one, other = (part.loc[part["label"] == label, name] for label in classes)
            rows.append(
                {
                    "method": method, "feature": name, **{f"median {c}": v.median() for c, v in
                    zip(classes, (one, other), strict=True)}, "cohens_d": cohens_d(one, other),
                    "roc_area": roc_area(one, other), "unknown": int(one.isna().sum() + other.isna().sum()),
                }
            )  # fmt: skip
    return pd.DataFrame(rows)


def is_wrong(table: pd.DataFrame, share: float, *, bins: float = 0.0) -> pd.Series:
    """Whether a gait frequency is missing or off by more than a share of the true one; NaN truths give False.

    Parameters
    ----------
    table : DataFrame
        With ``gait_frequency_hz``, ``true_gait_frequency_hz`` and ``observation_s``.
    share : float
        Relative error that is still right.
    bins : float
        Errors up to so many bins of 1 / T_o are right, too: what a spectrum that is not zero-padded cannot tell.
    """
    error_hz = (table["gait_frequency_hz"] - table["true_gait_frequency_hz"]).abs()
    allowed_hz = np.maximum(share * table["true_gait_frequency_hz"], bins / table["observation_s"])
    return ~(error_hz <= allowed_hz) & table["true_gait_frequency_hz"].notna()


def line_through(x: npt.ArrayLike, y: npt.ArrayLike) -> tuple[float, float]:
    """Slope and offset of a straight line through most points: the median of the slopes of all pairs (Theil, Sen).

    Up to 29 % of the points may be anywhere without carrying it off. Offset: the median of ``y - slope x``. NaN are
    left out; NaN below three points.
    """
    from scipy.stats import theilslopes

    a, b = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    known = np.isfinite(a) & np.isfinite(b)
    if known.sum() < 3 or np.ptp(a[known]) == 0:
        return math.nan, math.nan
    slope = float(theilslopes(b[known], a[known])[0])
    return slope, float(np.median(b[known] - slope * a[known]))
