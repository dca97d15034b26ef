"""Rows of an index: queries that run no code, orders, weights and pictures for training."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from doppelgait.core.errors import DatasetError
from doppelgait.core.rng import Streams
from doppelgait.dataset.example import suggest_names
from doppelgait.dataset.shard_files import MAX_OPEN
from doppelgait.processing.patches import Levels, Patch, cut, levels_of

Array = npt.NDArray[Any]
As = Literal["array", "picture"] | Patch
"""Form of the arrays: stored arrays, or pictures of the default or of another format."""


@dataclass(frozen=True, eq=False)
class LabelledArrays:
    """Arrays of examples; unpacks as ``values, y, groups``.

    Parameters
    ----------
    values : ndarray, shape (n, ...), or list of ndarray
        Values of the rows; a list if their shapes differ.
    y : ndarray of str, shape (n,)
        Labels.
    groups : ndarray of str, shape (n,)
        Group of each row. Rows of a group share a subject or a scene: keep each group in one fold.
    ids : ndarray of str, shape (n,)
    """

    values: Array | list[Array]
    y: npt.NDArray[np.str_]
    groups: npt.NDArray[np.str_]
    ids: npt.NDArray[np.str_]

    def __iter__(self) -> Iterator[Array | list[Array]]:
        """Iterate over values, y and groups, in this order."""
        return iter((self.values, self.y, self.groups))

    def __len__(self) -> int:
        return len(self.y)


def make_picture(signature: xr.DataArray | None, patch: Patch) -> Levels:
    """Convert the middle of a signature to a picture in dB, (n_velocity, n_time)."""
    whole = levels_of(signature, patch)
    if whole is None:
        return np.zeros((patch.n_velocity, patch.n_time), dtype=np.float32)
    return cut(whole, (whole.shape[1] - patch.n_time) // 2, patch) * np.float32(patch.range_db)


def picture_format(as_: As, fields: Sequence[str]) -> Patch | None:
    """Return the format of the pictures, None for arrays."""
    if as_ == "array":
        return None
    if not (as_ == "picture" or isinstance(as_, Patch)):
        raise DatasetError(f"as_: {as_!r} is not allowed; it must be 'array', 'picture' or a doppelgait.classify.Patch")
    for name in fields:
        if name != "signature":
            raise DatasetError(f"as_: only the field signature has a picture; read {name} with as_='array'")
    return as_ if isinstance(as_, Patch) else Patch()


POOL_SHARDS = MAX_OPEN // 2  # number of shards that are shuffled together


def shuffled_rows(index: pd.DataFrame, rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """Shuffle rows so that shard files open once."""
    # rows of a few shards at a time are shuffled together, so that files open once
    codes, shards = pd.factorize(index["shard"])
    place_of_shard = rng.permutation(len(shards))
    pool = place_of_shard[codes] // POOL_SHARDS
    order = rng.permutation(len(index))
    return order[np.argsort(pool[order], kind="stable")]


def epoch_rows(index: pd.DataFrame, seed: int | None, epoch: int, worker: int, workers: int) -> npt.NDArray[np.int64]:
    """Return the rows of one worker in one epoch, each once."""
    rows = np.arange(len(index))
    if seed is not None:
        rows = shuffled_rows(index, Streams(seed, epoch).generator("batches"))
    return rows[worker::workers]


def balanced_weights(counts: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
    """Return weights of mean 1 that balance all present classes."""
    present = counts > 0
    weights = np.zeros(counts.size)
    weights[present] = counts.sum() / (present.sum() * counts[present])
    return weights


MAX_LENGTH = 10_000
OPERATORS: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
ALLOWED = (
    "allowed are columns, numbers, texts, lists, comparisons (== != < <= > >= in, not in), + - * "
    "/, and, or, not, & | ~ and brackets"
)


def select_rows(index: pd.DataFrame, query: str) -> npt.NDArray[np.bool_]:
    """Mark the rows that fulfil a query."""
    try:
        if len(query) > MAX_LENGTH:
            raise ValueError(f"has {len(query)} characters, allowed are {MAX_LENGTH}")
        found = _evaluate_value(ast.parse(query.strip(), mode="eval").body, index)
    except DatasetError as error:
        raise DatasetError(f"select {query!r}: {error}") from None
    except SyntaxError as error:
        raise DatasetError(f"select {query[:200]!r}: is no query: {error.msg}; {ALLOWED}") from None
    except (ValueError, TypeError, ArithmeticError, RecursionError, MemoryError) as error:
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise DatasetError(f"select {query[:200]!r}: is no query: {reason}") from None
    if not _is_condition(found):
        raise DatasetError(f'select {query!r}: is no condition; compare columns, as in "snr_frame_db > 10"')
    return np.asarray(found.fillna(False).to_numpy(dtype=bool))


def _is_condition(value: Any) -> bool:
    return isinstance(value, pd.Series) and pd.api.types.is_bool_dtype(value)


def _evaluate_value(node: ast.expr, index: pd.DataFrame) -> Any:
    match node:
        case ast.Name(id=name):
            if name not in index.columns:
                raise DatasetError(f"no column {name!r}{suggest_names(name, map(str, index.columns))}")
            return index[name]
        case ast.Constant(value=bool() | int() | float() | str() as value):
            return value
        case ast.List(elts=parts) | ast.Tuple(elts=parts):
            return [_evaluate_value(part, index) for part in parts]
        case ast.BoolOp(op=joint, values=parts):
            join = operator.and_ if isinstance(joint, ast.And) else operator.or_
            return reduce(join, [_evaluate_condition(part, index) for part in parts])
        case ast.BinOp(op=ast.BitAnd() | ast.BitOr() as joint, left=left, right=right):
            join = operator.and_ if isinstance(joint, ast.BitAnd) else operator.or_
            return join(_evaluate_condition(left, index), _evaluate_condition(right, index))
        case ast.UnaryOp(op=ast.Not() | ast.Invert(), operand=part):
            return ~_evaluate_condition(part, index)
        case ast.UnaryOp(op=ast.USub(), operand=part):
            return -_number(part, index)
        case ast.BinOp(op=sign, left=left, right=right) if type(sign) in OPERATORS:
            return OPERATORS[type(sign)](_number(left, index), _number(right, index))
        case ast.Compare(left=left, ops=signs, comparators=parts):
            values = [_evaluate_value(part, index) for part in (left, *parts)]
            pairs = zip(values, signs, values[1:], strict=False)
            return reduce(operator.and_, [_compare(one, sign, two) for one, sign, two in pairs])
    raise DatasetError(f"{ast.unparse(node)[:60]!r} is not allowed; {ALLOWED}")


def _compare(one: Any, sign: ast.cmpop, two: Any) -> Any:
    if isinstance(sign, ast.In | ast.NotIn):
        if not isinstance(one, pd.Series) or not isinstance(two, list) or any(isinstance(v, pd.Series) for v in two):
            raise DatasetError("in needs a column before it and a list of values behind it")
        return one.isin(two) ^ isinstance(sign, ast.NotIn)
    if type(sign) not in OPERATORS or isinstance(one, list) or isinstance(two, list):
        raise DatasetError(f"a comparison is not allowed; {ALLOWED}")
    return OPERATORS[type(sign)](one, two)


def _evaluate_condition(node: ast.expr, index: pd.DataFrame) -> Any:
    value = _evaluate_value(node, index)
    if not _is_condition(value):
        raise DatasetError(f"{ast.unparse(node)[:60]!r} is no condition; compare it with something")
    return value


def _number(node: ast.expr, index: pd.DataFrame) -> Any:
    value = _evaluate_value(node, index)
    if isinstance(value, pd.Series) and pd.api.types.is_numeric_dtype(value):
        return value.astype(np.float64)
    if isinstance(value, int | float):
        return float(value)
    raise DatasetError(f"{ast.unparse(node)[:60]!r} is no number")
